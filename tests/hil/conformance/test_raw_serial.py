"""The raw serial line over a UART and over the console's endpoints, against an emulated device."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from phasewire.base.errors import DeviceLostError, DeviceNotFoundError, DeviceTimeoutError
from phasewire.emulator import Emulator
from phasewire.emulator.doors.serial_port import EmulatedPort
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.tools.frames import console_frame, request_frame
from phasewire.hil.conformance.transports.serial import CdcWire, PortWire, RawSerialLine
from phasewire.hil.conformance.transports.usb import RawUsbLine
from phasewire.protocol.codes import FrameKind, Request
from phasewire.protocol.framing import LineMode
from phasewire.protocol.replies import Info, Status
from phasewire.protocol.requests import Setup

from tests.host.serving import served_url

INFO = Setup(0xC1, Request.INFO, 0, 0, Info.BYTES)
STATUS = Setup(0xC1, Request.STATUS, 0, 0, Status.BYTES)


@pytest.fixture(params=["UART", "USB"])
def line(request: pytest.FixtureRequest) -> Iterator[RawSerialLine]:
    with Emulator() as emulator:
        wire = PortWire(f"{emulator.url}?door=serial") if request.param == "UART" else CdcWire(RawUsbLine(emulator.url))
        opened = RawSerialLine(wire)
        yield opened
        opened.close()


@pytest.mark.parametrize(
    "before", [b"", b"stat", b"\0", b"\0" + request_frame(1, INFO)[:7], b"\0" + console_frame() + b"ech"]
)
@pytest.mark.parametrize("deaf", [False, True], ids=["heard", "unheard"])
def test_frames_are_entered_from_any_state(line: RawSerialLine, before: bytes, deaf: bool) -> None:
    line.write(before)
    if not deaf:
        line.rest()
    line.enter_frames()
    assert line.mode is LineMode.FRAMES
    assert (line.events, line.damaged) == ([], [])
    assert Info.decode(line.request(INFO) or b"").channels == 320


def test_a_console_that_does_not_answer_is_no_console(line: RawSerialLine) -> None:
    line.enter_frames()
    with pytest.raises(DeviceTimeoutError, match="shows no prompt after 'status'"):
        line.command("status")


def test_a_late_answer_is_not_taken_for_that_of_a_request(line: RawSerialLine) -> None:
    line.enter_frames()
    line.write(request_frame(99, STATUS))
    assert Info.decode(line.request(INFO) or b"").carrier_hz == 40_000
    assert line.request(Setup(0xC1, 99, 0, 0, 1)) is None
    assert len(line.events) == 1, "the reply under tag 99"


def test_a_missing_or_closed_port_is_an_error() -> None:
    with pytest.raises(DeviceNotFoundError, match="no device at"):
        PortWire("serial:///dev/there-is-none")
    with Emulator() as emulator:
        wire = PortWire(f"{emulator.url}?door=serial")
        wire.close()
        with pytest.raises(DeviceLostError, match="the port is gone"):
            wire.write(b"x")
        wire.reopen(1)
        RawSerialLine(wire).enter_frames()


def test_a_pseudo_terminal_and_a_socket_cannot_hang_up() -> None:
    for scheme in ("serial", "socket"):
        with served_url(scheme) as (url, _):
            line = RawSerialLine(PortWire(url))
            line.wire.set_dtr(True)  # without effect
            line.enter_frames()
            assert not line.wire.has_break
            with pytest.raises(Inconclusive, match="neither a break nor DTR"):
                line.hang_up()
            line.close()


def test_a_port_says_itself_that_it_has_no_break_or_is_a_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a port of another package may, whatever its scheme."""
    with Emulator() as emulator:
        url = f"{emulator.url}?door=serial"
        plain = PortWire(url)
        assert (plain.has_break, plain.is_connection) == (True, False)
        plain.close()
        monkeypatch.setattr(EmulatedPort, "has_break", False, raising=False)
        monkeypatch.setattr(EmulatedPort, "is_connection", True, raising=False)
        telling = PortWire(url)
        assert (telling.has_break, telling.is_connection) == (False, True)
        telling.close()


def test_a_line_whose_other_end_is_gone_can_be_closed() -> None:
    with served_url("serial") as (url, _):
        line = RawSerialLine(PortWire(url))
    with pytest.raises(DeviceLostError):
        line.write(bytes(4096))
    line.close()


def test_a_reply_to_an_older_request_with_the_same_tag_is_not_taken_for_the_answer() -> None:
    with Emulator() as emulator:
        line = RawSerialLine(PortWire(f"{emulator.url}?door=serial"))
        line.enter_frames()
        line.write(request_frame(2, INFO))
        line.listen(1, lambda: bool(line.frames(FrameKind.REPLY)))
        assert len(line.request(STATUS) or b"") == Status.BYTES
        assert [body[0] for body in line.frames(FrameKind.REPLY)] == [2]  # the older one is still there
