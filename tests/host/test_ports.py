"""Serial ports by URL: pseudo-terminals, sockets and RFC 2217, on loopback."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from phasewire import open_device
from phasewire.base.errors import DeviceAccessError, DeviceLostError, DeviceNotFoundError, DeviceTimeoutError
from phasewire.host.transports.ports import RFC2217, SERIAL, SOCKET, port_for_url
from phasewire.host.transports.transport import Found

from tests.host.serving import LOOPBACK, served_url

# pyserial 3.5 names the thread of RFC 2217 in a way that Python 3.10 deprecated.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")


@contextlib.contextmanager
def terminal() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: our end, and the path of the other."""
    ours, theirs = pty.openpty()
    try:
        yield ours, os.ttyname(theirs)
    finally:
        os.close(ours)
        os.close(theirs)


# URLs


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("serial:", "names no port; write serial:///dev/ttyACM0 or, on Windows, serial:COM3"),
        ("serial://?baud=9600", "names no port"),
        ("serial:COM3?bauds=9600", "serial: has no option 'bauds'; it has baud"),
        ("serial:COM3?baud=fast", "baud 'fast' is no rate; write bits per second, such as baud=115200"),
        ("serial:COM3?baud=0", "baud '0' is no rate"),
        ("serial:COM3?baud=", "baud '' is no rate"),
        ("socket:", "names no host and port; write socket://HOST:PORT, such as socket://127.0.0.1:7000"),
        ("socket://localhost", "names no host and port"),
        ("socket://:7000", "names no host and port"),
        ("socket://localhost:port", "names no host and port"),
        ("socket://localhost:70000", "names no host and port"),
        ("socket://localhost:1?colour=red", "socket: has no option 'colour'; it has baud, logging"),
        ("rfc2217://localhost:1?colour=red", "it has baud, logging, ign_set_control, poll_modem, timeout"),
        ("rfc2217:localhost:2217", "write rfc2217://HOST:PORT, such as rfc2217://127.0.0.1:2217"),
    ],
)
def test_a_wrong_url_says_what_would_be_right(url: str, message: str) -> None:
    with pytest.raises(DeviceNotFoundError, match=f"^{re.escape(repr(url))}.*{re.escape(message)}"):
        open_device(url)


@pytest.mark.parametrize(
    ("url", "path", "baud"),
    [
        ("serial:///dev/ttyACM0", "/dev/ttyACM0", 115_200),
        ("serial:/dev/ttyACM0?baud=3000000", "/dev/ttyACM0", 3_000_000),
        ("serial:///dev/with%20space", "/dev/with space", 115_200),
        ("serial:COM3?baud=9600", "COM3", 9_600),
        ("serial://COM3", "COM3", 115_200),
    ],
)
def test_a_local_port_is_ours_alone_and_bounded_in_time(url: str, path: str, baud: int) -> None:
    port = port_for_url(url)
    assert isinstance(port, serial.Serial)
    assert (port.port, port.baudrate, port.exclusive, port.is_open) == (path, baud, True, False)
    assert port.write_timeout == pytest.approx(1 + 2 * 658 * 10 / baud)


# Ports that cannot be used


@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_a_port_without_a_server_is_not_found(scheme: str) -> None:
    with socket.create_server((LOOPBACK, 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(DeviceNotFoundError, match=f"no device at {scheme}://.*refused"):
        open_device(f"{scheme}://{LOOPBACK}:{port}")


def test_missing_permission_for_a_port_leads_to_the_doctor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("serial.serialposix.os.open", refuse)
    with pytest.raises(DeviceAccessError, match="phasewire doctor"):
        open_device("serial:///dev/ttyACM0")


def test_a_port_that_another_program_has_open_is_not_disturbed() -> None:
    with terminal() as (_, path), serial.Serial(path, exclusive=True), pytest.raises(DeviceAccessError, match="in use"):
        open_device(f"serial://{path}")


def test_a_terminal_that_chatters_is_no_device() -> None:
    with terminal() as (ours, path):
        stop = threading.Event()

        def chatter() -> None:
            while not stop.wait(0.001):
                if select.select([ours], [], [], 0)[0]:
                    os.read(ours, 4096)
                if select.select([], [ours], [], 0)[1]:
                    os.write(ours, b"\x00\xffboot\r\n" * 8)

        thread = threading.Thread(target=chatter, daemon=True)
        thread.start()
        with pytest.raises(DeviceTimeoutError, match="what comes from there makes no sense"):
            open_device(f"serial://{path}?baud=3000000")
        stop.set()
        thread.join(5)


@pytest.mark.parametrize("scheme", ["socket", "serial", "rfc2217"])
def test_a_server_that_ends_is_a_lost_device(scheme: str) -> None:
    with contextlib.ExitStack() as stack, served_url(scheme) as (url, _):
        device = stack.enter_context(open_device(url))
        stack.pop_all()
    with pytest.raises(DeviceLostError, match="the port is gone"):
        device.status()
    device.close()


# Ports that are found


def test_ports_with_our_numbers_are_listed_and_no_others(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def port(device: str, vid: int | None, pid: int | None, serial_number: str | None = None) -> SimpleNamespace:
        return SimpleNamespace(device=device, vid=vid, pid=pid, product="array", serial_number=serial_number)

    ports = [
        port("/dev/ttyS0", None, None),
        port("/dev/ttyUSB0", 0x0403, 0x6001, "FT1"),
        port("COM3", 0x1209, 0x0001, "S-2"),
        port("/dev/ttyACM0", 0x1209, 0x0001, "S-1"),
        port("/dev/ttyACM1", 0x1209, 0x0002, "in DFU mode"),
        port(str(tmp_path), 0x1209, 0x0001),
    ]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
    monkeypatch.setattr("os.access", lambda path, mode: False)
    common = {"product": "array", "mode": "run time", "firmware": ""}
    denied = "permission denied; `phasewire doctor` says how to get it"
    assert SERIAL.find() == [
        Found("serial:COM3", serial="S-2", location="COM3", **common),  # type: ignore[arg-type]
        Found("serial:///dev/ttyACM0", serial="S-1", location="/dev/ttyACM0", **common),  # type: ignore[arg-type]
        Found(f"serial://{tmp_path}", serial=None, location=str(tmp_path), problem=denied, **common),  # type: ignore[arg-type]
    ]
    assert SOCKET.find() == RFC2217.find() == []
    known = port_for_url("serial:///dev/ttyACM0")
    assert (known.product, known.serial_number, known.bytes_per_second) == ("array", "S-1", 53_248_000)
    assert not hasattr(port_for_url("serial:///dev/ttyUSB0"), "bytes_per_second")
