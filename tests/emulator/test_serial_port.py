"""An emulated UART as a port of pyserial. Times are calculated by hand: ten bits a byte."""

from __future__ import annotations

import errno
from collections.abc import Iterator

import pytest
import serial
from phasewire import Emulator
from phasewire.base.errors import DeviceNotFoundError
from phasewire.emulator.doors.serial_port import EmulatedPort, port_for_url

CONSOLE = bytes.fromhex("06 05 02 1b 68 a2 00")  # the vector frame-console
STATUS_REQUEST = bytes.fromhex("05032AC102 01 0101 0240 05CDC288CE 00")  # the worked example of chapter SER


@pytest.fixture
def port(emulator: Emulator) -> Iterator[EmulatedPort]:
    with port_for_url(f"{emulator.url}?door=serial") as opened:
        opened.timeout = 1.0
        yield opened


def passed(port: EmulatedPort, since: float) -> float:
    return port.time.monotonic() - since


@pytest.mark.parametrize("baud", [9_600, 115_200, 3_000_000])
def test_a_request_and_its_reply_take_their_time(baud: int) -> None:
    """The worked example has 16 bytes; the zero that the device answers and a reply of 66 content bytes have 1 + 73.

    The reply is kind, tag, outcome, 64 bytes and checksum: 71, one byte of COBS and the zero.
    """
    port = port_for_url(f"emulator:?door=serial&baud={baud}")
    port.timeout = 10.0
    port.open()
    port.write(b"\0" + STATUS_REQUEST)
    start = port.time.monotonic()
    assert len(port.read(1 + 73)) == 1 + 73
    byte = 10 / baud
    # The first byte on the line is answered while the others come; no byte is delayed by more than 0.1 ms.
    assert (16 + 1 + 73) * byte <= passed(port, start) <= (16 + 1 + 73 + 2) * byte + 2e-4


def test_a_time_out_is_in_the_device_s_time(port: EmulatedPort) -> None:
    start = port.time.monotonic()
    port.timeout = 0.25
    assert port.read(5) == b""
    assert passed(port, start) == pytest.approx(0.25)
    port.timeout = 0
    assert port.read(5) == b""
    assert passed(port, start) == pytest.approx(0.25)
    port.time.sleep(0.5)
    assert passed(port, start) == pytest.approx(0.75)


def test_bytes_that_come_during_a_wait_can_be_read_afterwards(port: EmulatedPort) -> None:
    port.write(b"\r")
    assert port.in_waiting == 0
    port.time.sleep(0.01)
    assert port.in_waiting == 4
    assert port.read(port.in_waiting) == b"\r\n> "


def test_many_bytes_wait_for_room_as_in_a_full_buffer() -> None:
    """65 536 bytes may wait, and the next write then waits for room; at 12 Mbaud a byte takes 0.83 µs."""
    with port_for_url("emulator:?door=serial&baud=12000000") as port:
        port.write(b"x" * 65_537)
        port.write_timeout = 0.0001
        start = port.time.monotonic()
        assert port.write(b"x" * 65_536) == 65_536
        assert passed(port, start) <= 0.0001
        with pytest.raises(serial.SerialTimeoutException):
            port.write(b"x")
        assert passed(port, start) == pytest.approx(0.0002, rel=0.1)


def test_a_port_is_for_one_at_a_time(port: EmulatedPort, emulator: Emulator) -> None:
    again = port_for_url(f"{emulator.url}?door=serial")
    with pytest.raises(serial.SerialException, match="in use") as raised:
        again.open()
    assert raised.value.errno == errno.EBUSY
    port.close()
    again.open()
    again.close()


def test_closing_sends_the_rest_and_the_device_does_not_notice(port: EmulatedPort) -> None:
    """As on a real UART: the line stays in frames until a host leaves them."""
    port.write(b"\0")
    port.close()
    port.open()
    assert port.in_waiting == 0  # the zero that the device answered was lost
    port.timeout = 0.1
    port.write(STATUS_REQUEST)
    assert len(port.read(100)) == 73
    port.write(CONSOLE)
    assert port.read(100) == CONSOLE + b"> "


def test_a_break_returns_to_the_console(port: EmulatedPort) -> None:
    """Clause SER-010; the device gets earlier bytes before the break."""
    port.timeout = 0.1
    port.write(b"\0")
    port.send_break(0.1)
    assert port.read(10) == b"\0"
    port.write(b"\r")
    assert port.read(10) == b"\r\n> "


def test_control_lines_are_not_connected(port: EmulatedPort) -> None:
    port.dtr = port.rts = False
    port.write(b"\r")
    assert port.read(4) == b"\r\n> "


def test_both_ends_have_the_same_rate(port: EmulatedPort) -> None:
    with pytest.raises(ValueError, match=r"9600 baud; emulator:.* has 115200"):
        port.baudrate = 9_600


# A device that cannot receive


def test_a_device_without_power_or_in_dfu_mode_or_closed_is_silent(emulator: Emulator) -> None:
    port = port_for_url(f"{emulator.url}?door=serial")
    port.timeout = 0.05
    port.open()
    port.write(b"echo 0\rdfu\r")
    assert port.read(100).endswith(b"ok\r\n> ")
    for _ in range(2):
        port.write(b"\r")
        assert port.read(100) == b""
        emulator.power_down()
    start = port.time.monotonic()
    port.time.sleep(1.0)
    assert passed(port, start) == pytest.approx(1.0)
    emulator.power_up()
    emulator.run_until_started()
    port.write(b"\r")
    assert port.read(100) == b"\r\n> "
    emulator.closed = True
    port.write(b"\r")
    assert port.read(100) == b""


def test_an_endless_wait_for_a_device_without_power_ends(port: EmulatedPort, emulator: Emulator) -> None:
    """A real port would wait; in one process nothing else could end the wait."""
    port.timeout = None
    emulator.power_down()
    assert port.read(1) == b""


# URLs


def test_the_error_for_an_unknown_serial_number_lists_the_known() -> None:
    with pytest.raises(DeviceNotFoundError, match=r"no device at 'emulator:Z\?door=serial': nothing is plugged in"):
        port_for_url("emulator:Z?door=serial")
    with Emulator(serial="A"), Emulator(serial="B"), pytest.raises(DeviceNotFoundError, match="there are 'A', 'B'"):
        port_for_url("emulator:Z?door=serial")
