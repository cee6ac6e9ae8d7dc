"""The bus as pyusb sees it: what libusb on Linux would do."""

from __future__ import annotations

import errno
from collections.abc import Callable
from functools import partial

import pytest
import usb.core
import usb.util
from phasewire import Emulator
from phasewire.emulator.door import Handshake
from phasewire.emulator.doors.backend import EmulatorBackend, open_backend
from phasewire.protocol.enumeration import FULL_SPEED


def found(emulator: Emulator) -> usb.core.Device:
    return usb.core.find(backend=EmulatorBackend([emulator]))


@pytest.fixture
def emulator() -> Emulator:
    return Emulator()


@pytest.fixture
def device(emulator: Emulator) -> usb.core.Device:
    return found(emulator)


def fails(number: int, action: Callable[[], object]) -> bool:
    """Whether an action raises the libusb error with this number."""
    with pytest.raises(usb.core.USBError) as raised:
        action()
    return bool(raised.value.errno == number)


# Transfers


def test_a_read_that_times_out_gives_what_has_come() -> None:
    emulator = Emulator(speed=FULL_SPEED)
    device = found(emulator)
    device.set_configuration()
    give = iter([bytes(64), Handshake.NAK, Handshake.NAK])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(emulator.usb, "bulk_in", lambda endpoint: next(give))
        assert len(device.read(0x81, 512, timeout=5)) == 64
        with pytest.raises(usb.core.USBTimeoutError):
            device.read(0x81, 512, timeout=5)


def test_a_time_out_of_0_waits_without_limit(emulator: Emulator, device: usb.core.Device) -> None:
    device.set_configuration()

    def acknowledge() -> None:
        emulator.usb.bulk_out(0x01, bytes(512))

    emulator.scheduler.at(emulator.scheduler.now + 2_000_000_000, acknowledge)
    assert len(device.read(0x81, 512, timeout=0)) == 32


def test_a_read_of_the_notifications_times_out(device: usb.core.Device) -> None:
    device.set_configuration()
    assert fails(errno.ETIMEDOUT, partial(device.read, 0x82, 16, timeout=40))


def test_too_small_a_buffer_overflows(device: usb.core.Device) -> None:
    device.set_configuration()
    device.write(0x01, bytes(512))
    assert fails(errno.EOVERFLOW, partial(device.read, 0x81, 16))


def test_a_time_out_comes_before_later_events(emulator: Emulator, device: usb.core.Device) -> None:
    """The watchdog's event, 100 ms ahead, does not extend this transfer's time-out."""
    device.set_configuration()
    device.ctrl_transfer(0x41, 4, 0, 0, None)
    before = emulator.scheduler.now
    with pytest.raises(usb.core.USBTimeoutError):
        device.read(0x81, 64, timeout=20)
    assert (emulator.scheduler.now - before) / 400e6 == pytest.approx(20e-3)


# Claims


def test_an_interface_is_held_by_one_handle(emulator: Emulator, device: usb.core.Device) -> None:
    device.set_configuration()
    other = found(emulator)
    usb.util.claim_interface(device, 0)
    usb.util.claim_interface(device, 0)
    usb.util.claim_interface(other, 2)
    assert fails(errno.EBUSY, partial(usb.util.claim_interface, other, 0))
    assert fails(errno.EBUSY, partial(other.write, 0x01, bytes(512)))
    assert fails(errno.EBUSY, partial(other.ctrl_transfer, 0xA1, 1, 0, 0, 64))
    assert len(other.ctrl_transfer(0xC1, 1, 0, 0, 64)) == 64  # as pyusb and Linux let vendor requests pass
    assert device.write(0x01, bytes(512)) == 512
    assert other.ctrl_transfer(0x80, 6, 0x0100, 0, 18)[17] == 1
    usb.util.release_interface(device, 0)
    assert other.write(0x01, bytes(512)) == 512
    usb.util.claim_interface(device, 3)
    usb.util.dispose_resources(other)
    assert fails(errno.EBUSY, partial(usb.util.claim_interface, other, 3))
    usb.util.claim_interface(device, 0)
    usb.util.claim_interface(device, 2)


def test_a_held_interface_prevents_set_configuration(emulator: Emulator, device: usb.core.Device) -> None:
    """Linux refuses it even to the program that holds the interface."""
    device.set_configuration()
    usb.util.claim_interface(device, 3)
    assert fails(errno.EBUSY, device.set_configuration)
    assert fails(errno.EBUSY, found(emulator).set_configuration)
    usb.util.release_interface(device, 3)
    device.set_configuration()


def test_what_is_not_there_is_not_found(emulator: Emulator, device: usb.core.Device) -> None:
    assert fails(errno.ENOENT, partial(usb.util.claim_interface, device, 0))  # not configured
    device.set_configuration()
    assert fails(errno.ENOENT, partial(usb.util.claim_interface, device, 4))
    bus = EmulatorBackend([emulator])
    handle = bus.open_device(next(bus.enumerate_devices()))
    assert fails(errno.ENOENT, partial(bus.release_interface, handle, 0))


# Coming and going


def test_an_unplugged_device_is_gone() -> None:
    with Emulator() as emulator:
        device = usb.core.find(backend=open_backend(emulator.url))
        device.set_configuration()
    assert fails(errno.ENODEV, partial(device.write, 0x01, bytes(512)))
    assert fails(errno.ENODEV, partial(device.ctrl_transfer, 0x80, 6, 0x0100, 0, 18))
    assert fails(errno.ENODEV, partial(usb.util.claim_interface, device, 3))
    assert fails(errno.ENODEV, device.reset)
    usb.util.dispose_resources(device)
    assert fails(errno.ENODEV, device.set_configuration)


def test_a_device_that_comes_back_is_another_one(emulator: Emulator, device: usb.core.Device) -> None:
    device.set_configuration()
    usb.util.claim_interface(device, 0)
    emulator.usb.unplug()
    assert found(emulator) is None
    emulator.usb.plug()
    assert fails(errno.ENODEV, partial(device.write, 0x01, bytes(512)))
    again = found(emulator)
    again.set_configuration()
    usb.util.claim_interface(again, 0)
    usb.util.dispose_resources(device)
    assert again.write(0x01, bytes(512)) == 512


def test_a_device_that_comes_back_is_reset_when_a_program_looks_for_it(
    emulator: Emulator, device: usb.core.Device
) -> None:
    """Clause USB-020: a program that opens it again finds it reset."""
    device.set_configuration()
    resets: list[int] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(emulator.usb, "reset", lambda: resets.append(emulator.usb.generation))
        assert found(emulator) is not None
        assert resets == []
        emulator.usb.unplug()
        emulator.usb.plug()
        assert found(emulator) is not None
        assert found(emulator) is not None
    assert resets == [2]


def test_a_device_that_goes_while_a_transfer_waits_is_gone(emulator: Emulator, device: usb.core.Device) -> None:
    device.set_configuration()
    emulator.scheduler.at(emulator.scheduler.now + 400_000, emulator.usb.unplug)
    assert fails(errno.ENODEV, partial(device.read, 0x81, 512, timeout=1000))
    assert emulator.scheduler.now < 10 * 400_000


def test_a_suspended_bus_carries_nothing(emulator: Emulator, device: usb.core.Device) -> None:
    """Linux submits nothing to a device that is suspended (EHOSTUNREACH); libusb calls that an I/O error."""
    device.set_configuration()
    emulator.usb.suspend()
    assert fails(errno.EIO, partial(device.write, 0x01, bytes(512)))
    assert fails(errno.EIO, partial(device.ctrl_transfer, 0x80, 6, 0x0100, 0, 18))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(emulator.usb, "stream_out", lambda endpoint, data, began, deadline: (len(data), began))
        assert fails(errno.EIO, partial(device.write, 0x01, bytes(5120)))
    emulator.usb.resume()
    assert device.write(0x01, bytes(512)) == 512


def test_a_reset_leaves_an_unconfigured_device_unconfigured(emulator: Emulator, device: usb.core.Device) -> None:
    device.reset()
    assert emulator.usb.configuration == 0


def test_a_device_that_leaves_on_a_reset_is_not_found(emulator: Emulator, device: usb.core.Device) -> None:
    """The error of libusb for a device that has to be found again."""
    device.set_configuration()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(emulator.usb, "reset", emulator.usb.disconnect)
        assert fails(errno.ENOENT, device.reset)


# URLs


def test_link_and_speed_can_be_chosen() -> None:
    device = usb.core.find(backend=open_backend("emulator:?speed=full&link=2wire"))
    device.set_configuration()
    assert bytes(device.ctrl_transfer(0xC1, 1, 0, 0, 64))[31] == 2
    assert device.speed == usb.util.SPEED_FULL
    assert {endpoint.wMaxPacketSize for endpoint in device[0][0, 0]} == {64}
    assert usb.core.find(backend=open_backend("emulator:")).speed == usb.util.SPEED_HIGH


# Time


def test_waiting_by_a_device_s_clock_lets_its_time_pass() -> None:
    emulators = [Emulator(), Emulator()]
    backend = EmulatorBackend(emulators)
    device = list(usb.core.find(backend=backend, find_all=True))[1]
    time = backend.time_of(device.address)
    before, others = time.monotonic(), emulators[0].scheduler.now
    time.sleep(0.25)
    assert time.monotonic() - before == pytest.approx(0.25)
    assert (emulators[1].scheduler.now, emulators[0].scheduler.now) == (round(time.monotonic() * 400e6), others)
    time.sleep(1e-12)
    assert emulators[1].scheduler.now > round((before + 0.25) * 400e6)  # each wait takes time
    with pytest.raises(ValueError, match=r"-1 seconds cannot pass"):
        time.sleep(-1)
