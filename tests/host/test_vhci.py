"""Attaching a device of a USB/IP server, with a folder in place of the kernel's; `tests/guest` has the kernel."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from phasewire.base.errors import DeviceAccessError, DeviceNotFoundError
from phasewire.host.transports.vhci import Attached, attach, follow

from ..cli.runner import runner
from .serving import LOOPBACK, Served

STATUS = """hub port sta spd dev      sockfd local_busid
hs  0000 006 003 00010001 000004 1-1
hs  0001 004 000 00000000 000000 0-0
ss  0008 004 000 00000000 000000 0-0
"""
"""As Linux 6.1 prints it: one device is attached."""


@pytest.fixture
def controller(tmp_path: Path) -> Path:
    (tmp_path / "status").write_text(STATUS)
    (tmp_path / "attach").write_text("")
    return tmp_path


@pytest.fixture(scope="module")
def server() -> Iterator[int]:
    with Served(pty=True) as served:
        yield served.usbip_port


def test_the_kernel_is_given_the_socket_and_the_device(server: int, controller: Path) -> None:
    attached = attach(LOOPBACK, server, "1-1", controller)
    assert attached == Attached(1, "1-1", 0x1209, 0x0001)
    port, descriptor, device, speed = map(int, (controller / "attach").read_text().split())
    assert (port, device, speed) == (1, 0x0001_0001, 3)  # the first free one of high speed
    assert descriptor > 2


def test_a_device_that_the_server_has_not_is_named(server: int, controller: Path) -> None:
    with pytest.raises(DeviceNotFoundError, match=r"does not give device 1-7: there is no such device"):
        attach(LOOPBACK, server, "1-7", controller)
    assert (controller / "attach").read_text() == ""


def test_without_the_kernel_module_the_error_says_how_to_load_it(server: int, tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFoundError, match="modprobe vhci-hcd"):
        attach(LOOPBACK, server, controller=tmp_path / "vhci_hcd.0")


def test_no_port_may_be_free(server: int, controller: Path) -> None:
    (controller / "status").write_text(STATUS.replace("hs  0001 004", "hs  0001 006"))
    with pytest.raises(DeviceNotFoundError, match="no free port"):
        attach(LOOPBACK, server, "1-1", controller)


@pytest.mark.parametrize("said", [b"", b"SSH-2.0-OpenSSH_9.2\r\n", bytes.fromhex("0111000300000000") + b"short"])
def test_another_kind_of_server_is_refused(said: bytes, controller: Path) -> None:
    with socket.create_server((LOOPBACK, 0)) as listener:

        def serve() -> None:
            line, _ = listener.accept()
            with line:
                line.recv(1000)
                line.sendall(said)

        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(DeviceNotFoundError):
            attach(LOOPBACK, listener.getsockname()[1], "1-1", controller)
    assert (controller / "attach").read_text() == ""


def test_missing_permission_to_attach_is_an_error(
    server: int, controller: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, text: str) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "write_text", refuse)
    with pytest.raises(DeviceAccessError, match=r"attach cannot be written: attach devices as root"):
        attach(LOOPBACK, server, "1-1", controller)


class Clock:
    """Time that passes during a wait, with planned changes."""

    def __init__(self) -> None:
        self.now = 0.0
        self.plans: list[tuple[float, Path, str]] = []

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        for moment, path, text in self.plans:
            if moment <= self.now:
                path.write_text(text)


def test_a_device_that_has_left_is_attached_again(controller: Path) -> None:
    clock = Clock()
    status, taken = controller / "status", STATUS.replace("hs  0001 004", "hs  0001 006")
    status.write_text(taken)
    clock.plans = [(1.0, status, STATUS)]
    came: list[float] = []

    def connect() -> Attached:
        if 1 < clock.now < 3:
            raise DeviceNotFoundError("it is starting")
        came.append(clock.now)
        return Attached(1, "1-1", 0x1209, 0x0001)

    attachments = follow(connect, clock, 5.0, controller)
    assert [next(attachments).port, next(attachments).port] == [1, 1]
    assert came == [0.0, pytest.approx(3.0, abs=0.1)]


def test_a_device_that_does_not_come_back_is_missed(controller: Path) -> None:
    clock = Clock()

    def connect() -> Attached:
        if clock.now:
            raise DeviceNotFoundError("it is gone")
        clock.now = 1.0
        return Attached(1, "1-1", 0x1209, 0x0001)

    attachments = follow(connect, clock, 5.0, controller)
    next(attachments)
    with pytest.raises(DeviceNotFoundError, match="it is gone"):
        next(attachments)
    assert clock.now == pytest.approx(6.0, abs=0.1)


@pytest.mark.parametrize("server", ["", ":3240", "a:b", "a:0", "a:65536", "::1", "[::1", "a:1:2"])
def test_an_invalid_address_is_refused(server: str, capsys: pytest.CaptureFixture[str]) -> None:
    ended = runner(capsys)("attach", server)
    assert ended.code == 2
    assert "must be HOST or HOST:PORT" in " ".join(ended.err.split())
