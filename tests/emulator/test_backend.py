from __future__ import annotations

import errno

import pytest
import usb.core
from phasewire import Emulator, Pulses
from phasewire.emulator.backend import EmulatorBackend, open_backend
from phasewire.errors import DeviceNotFoundError

from tests.emulator.passing import now
from tests.strategies import update


@pytest.fixture
def plain() -> tuple[Emulator, usb.core.Device]:
    emulator = Emulator()
    device = usb.core.find(backend=EmulatorBackend([emulator]))
    return emulator, device


def test_reading_when_nothing_comes_times_out_in_the_device_s_time(plain: tuple[Emulator, usb.core.Device]) -> None:
    emulator, device = plain
    device.set_configuration()
    before = now(emulator)
    with pytest.raises(usb.core.USBTimeoutError) as timed_out:
        device.read(0x81, 64, timeout=20)
    assert timed_out.value.errno == errno.ETIMEDOUT
    assert (now(emulator) - before) / 400e6 == pytest.approx(20e-3)


def test_a_long_write_is_cut_in_packets(plain: tuple[Emulator, usb.core.Device]) -> None:
    _, device = plain
    device.set_configuration()
    blocks = b"".join(update(Pulses.silent(320), n) for n in range(5))
    assert device.write(0x01, blocks) == 5 * 512
    packet = bytes(device.read(0x81, 512))
    sequences = [int.from_bytes(packet[at + 4 : at + 8], "little") for at in range(0, len(packet), 32)]
    assert sequences == [0, 1, 2, 3, 4]


def test_transfers_take_bus_time(plain: tuple[Emulator, usb.core.Device]) -> None:
    """At best 13 bulk packets of 512 bytes fit a microframe of 125 µs."""
    emulator, device = plain
    device.set_configuration()
    before = now(emulator)
    device.write(0x01, bytes(512 * 26))
    assert (now(emulator) - before) / 400e6 == pytest.approx(250e-6, rel=1e-3)


def test_an_unknown_request_is_a_pipe_error(plain: tuple[Emulator, usb.core.Device]) -> None:
    _, device = plain
    with pytest.raises(usb.core.USBError) as stalled:
        device.ctrl_transfer(0xC1, 0x55, 0, 0, 4)
    assert stalled.value.errno == errno.EPIPE


def test_too_small_a_buffer_overflows(plain: tuple[Emulator, usb.core.Device]) -> None:
    _, device = plain
    device.set_configuration()
    device.write(0x01, bytes(512))
    with pytest.raises(usb.core.USBError) as overflow:
        device.read(0x81, 16)
    assert overflow.value.errno == errno.EOVERFLOW


def test_an_unplugged_device_is_gone() -> None:
    with Emulator() as emulator:
        device = usb.core.find(backend=open_backend(emulator.url))
        device.set_configuration()
    with pytest.raises(usb.core.USBError) as gone:
        device.write(0x01, bytes(512))
    assert gone.value.errno == errno.ENODEV


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("emulator:?speed=9", "the emulator has no option 'speed'"),
        ("emulator:?link=3wire", "unknown link '3wire'; known are 5wire, 2wire"),
        ("emulator:EMU-1?link=2wire", "options go with a fresh emulator"),
    ],
)
def test_bad_options_are_named(url: str, message: str) -> None:
    with pytest.raises(DeviceNotFoundError, match=message):
        open_backend(url)


def test_the_link_can_be_chosen() -> None:
    (emulator,) = open_backend("emulator:?link=2wire").enumerate_devices()
    device = usb.core.find(backend=EmulatorBackend([emulator]))
    device.set_configuration()
    assert bytes(device.ctrl_transfer(0xC1, 1, 0, 0, 64))[31] == 2


def test_a_time_out_comes_before_later_events(plain: tuple[Emulator, usb.core.Device]) -> None:
    """The watchdog, 100 ms ahead, is something to wait for, but not for this transfer."""
    emulator, device = plain
    device.set_configuration()
    device.ctrl_transfer(0x41, 4, 0, 0, None)
    before = now(emulator)
    with pytest.raises(usb.core.USBTimeoutError):
        device.read(0x81, 64, timeout=20)
    assert (now(emulator) - before) / 400e6 == pytest.approx(20e-3)


def test_a_long_write_that_times_out_says_how_much_was_taken(plain: tuple[Emulator, usb.core.Device]) -> None:
    """As pyusb does over libusb; the queue holds eight blocks."""
    _, device = plain
    device.set_configuration()
    device.ctrl_transfer(0x41, 4, 0, 0, None)
    blocks = b"".join(update(Pulses.silent(320), n, period=10**6) for n in range(10))
    assert device.write(0x01, blocks, timeout=10) == 8 * 512
    with pytest.raises(usb.core.USBTimeoutError):
        device.write(0x01, blocks[8 * 512 :], timeout=10)


def test_a_bus_reset_turns_off_and_unconfigures(plain: tuple[Emulator, usb.core.Device]) -> None:
    emulator, device = plain
    device.set_configuration()
    device.ctrl_transfer(0x41, 4, 0, 0, None)
    device.write(0x01, update(Pulses([25] * 320, [25] * 320), 0))
    emulator.run(5)
    assert emulator.capture().bits(emulator.capture().end_tick - 50, emulator.capture().end_tick).any()
    device.reset()
    emulator.run(10)
    assert not emulator.capture().bits(emulator.capture().end_tick - 50, emulator.capture().end_tick).any()
    assert emulator.usb.configuration == 0
