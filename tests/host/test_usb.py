from __future__ import annotations

import ctypes
import dataclasses
import errno
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import libusb_package
import pytest
import usb.core
from phasewire import Emulator, Pulses, open_device
from phasewire.base.errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStalledError,
    DeviceTimeoutError,
)
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.door import Handshake
from phasewire.emulator.doors.backend import EmulatorBackend, Port
from phasewire.emulator.interfaces.usb_device import UsbDevice
from phasewire.emulator.machine import open_emulators
from phasewire.host.transports import libusb
from phasewire.host.transports.usb import UsbTransport, open_usb
from phasewire.protocol import Ack, Info, NoOp, Reason, Status
from phasewire.protocol.codes import Request
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed
from phasewire.protocol.replies import records
from phasewire.protocol.requests import Setup

from tests.host.buses import raising
from tests.strategies import update


def test_a_usb_url_has_no_options() -> None:
    with pytest.raises(DeviceNotFoundError, match="a usb: URL has no options"):
        open_device("usb:?link=5wire")


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize(
    ("library", "told"),
    [
        (None, "libusb could not be loaded on this system: no such library"),
        (-99, r"libusb could not be started: LIBUSB_ERROR_OTHER \(-99\)"),
        (-3, r"libusb could not be started: LIBUSB_ERROR_ACCESS \(-3\)"),
    ],
)
def test_libusb_that_cannot_be_loaded_or_started_is_an_error(
    library: int | None, told: str, there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("libusb_package.get_libusb1_backend", lambda: None)
    monkeypatch.setattr(libusb, "BUS", tmp_path if there else tmp_path / "bus")
    real = ctypes.CDLL(str(libusb_package.get_library_path()))

    def load(_path: str) -> object:
        if library is None:
            raise OSError("no such library")
        return SimpleNamespace(libusb_init=lambda _context: library, libusb_error_name=real.libusb_error_name)

    monkeypatch.setattr(libusb, "CDLL", load)
    with pytest.raises(DeviceNotFoundError, match=told) as error:
        open_device("usb:")
    if library is not None:
        assert ("allow this program" if there else "start that with `--device") in str(error.value)


@pytest.mark.parametrize(
    ("number", "expected", "message"),
    [
        (errno.ETIMEDOUT, DeviceTimeoutError, "did not take a block for 1 s: its queue is full; wait, or stop it"),
        (errno.ENODEV, DeviceLostError, "sending blocks: the device is gone"),
        (errno.EIO, DeviceLostError, "the device is gone"),
        (errno.ENOENT, DeviceLostError, "the device is gone"),
        (errno.ESHUTDOWN, DeviceLostError, "the device is gone"),
        (errno.EACCES, DeviceAccessError, "permission denied"),
        (errno.EBUSY, DeviceAccessError, "another program is using the device"),
        (errno.EPIPE, DeviceStalledError, "the device answers STALL"),
        (None, DeviceError, "as it happens"),
    ],
)
@pytest.mark.parametrize("transfer", ["bulk_write", "bulk_read", "ctrl_transfer"])
def test_errors_of_the_bus_become_ours(
    emulator: Emulator,
    monkeypatch: pytest.MonkeyPatch,
    transfer: str,
    number: int | None,
    expected: type[DeviceError],
    message: str,
) -> None:
    if number == errno.ETIMEDOUT and transfer != "bulk_write":
        message = "did not acknowledge" if transfer == "bulk_read" else "asking for STATUS: no answer in time"
    device = open_device(emulator.url)
    with monkeypatch.context() as patch:
        patch.setattr(EmulatorBackend, transfer, raising(usb.core.USBError("as it happens", None, number)))
        with pytest.raises(expected, match=message.replace("sending blocks: ", "")) as raised:
            device.status() if transfer == "ctrl_transfer" else device._session.send(NoOp())
    assert type(raised.value) is expected
    assert device.show(Pulses.silent(320)).reason is Reason.ACCEPTED
    device.stop()


def test_a_device_that_is_open_elsewhere_is_not_disturbed(emulator: Emulator) -> None:
    with open_device(emulator.url) as first:
        first.show(Pulses.silent(320))
        with pytest.raises(DeviceAccessError, match="another program is using the device"):
            open_device(emulator.url)
        assert first.status().enabled
    with open_device(emulator.url) as second:
        assert not second.status().enabled


def test_a_device_that_cannot_be_opened_is_released(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = Info.encode
    with monkeypatch.context() as patch:
        patch.setattr(Info, "encode", lambda self: genuine(dataclasses.replace(self, oldest_version=9)))
        with pytest.raises(DeviceError, match="versions 9 to 1") as raised:
            open_device(emulator.url)
    assert not Port.of(emulator.usb).claims, raised  # while the error, and with it every frame, is still alive


# Transfers


def silent(numbers: range, period: int = 0) -> bytes:
    return b"".join(update(Pulses.silent(320), number, period) for number in numbers)


@pytest.fixture(params=[HIGH_SPEED, FULL_SPEED], ids=["high", "full"])
def line(request: pytest.FixtureRequest) -> Iterator[UsbTransport]:
    """To a device whose outputs are enabled."""
    with Emulator(serial="LINE", speed=request.param) as emulator:
        line = open_usb(emulator.url)
        line.command(Request.ENABLE)
        yield line
        line.close()


def acks(line: UsbTransport) -> list[Ack]:
    found = records(line.read_records(0.05))
    return [record for record in found if isinstance(record, Ack)]


def test_a_write_says_how_much_was_taken_in_time(line: UsbTransport) -> None:
    begun = line.time.monotonic()
    assert line.write_blocks(silent(range(QUEUE_BLOCKS + 5), 10**6), 0.02) == QUEUE_BLOCKS * 512
    assert line.time.monotonic() - begun == pytest.approx(0.02, rel=0.01)
    assert line.write_blocks(silent(range(QUEUE_BLOCKS, QUEUE_BLOCKS + 5), 10**6), 0.02) == 0
    assert [ack.sequence for ack in acks(line)] == list(range(QUEUE_BLOCKS))


def test_a_read_waits_no_longer_than_it_may(line: UsbTransport) -> None:
    begun = line.time.monotonic()
    assert line.read_records(0.03) == b""
    assert line.time.monotonic() - begun == pytest.approx(0.03, rel=0.01)
    assert line.read_records(0.0) == b""  # libusb takes a time-out of 0 as endless
    assert line.time.monotonic() - begun < 0.04


@pytest.mark.parametrize("milliseconds", [1, 2, 3])
def test_a_block_that_has_begun_is_finished(milliseconds: int) -> None:
    """Clause USB-017: at full speed the time may be over within a block of eight packets."""
    with Emulator(serial="SLOW", speed=FULL_SPEED) as emulator:
        line = open_usb(emulator.url)
        line.command(Request.ENABLE)
        blocks, sent = silent(range(30)), 0
        while sent < len(blocks):
            taken = line.write_blocks(blocks[sent:], milliseconds / 1000)
            assert taken > 0
            assert taken % 512 == 0
            sent += taken
        found = acks(line)
        assert [ack.sequence for ack in found] == list(range(30))
        assert {ack.reason for ack in found} == {Reason.ACCEPTED}


def test_a_block_that_cannot_be_finished_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the blocks after it keep their place."""
    with Emulator(serial="SLOW", speed=FULL_SPEED) as emulator:
        line = open_usb(emulator.url)
        line.command(Request.ENABLE)
        genuine = UsbDevice.bulk_out
        packets = [0]

        def deaf(self: UsbDevice, endpoint: int, packet: bytes) -> Handshake:
            packets[0] += 1
            return genuine(self, endpoint, packet) if packets[0] <= 2 * 8 + 3 else Handshake.NAK

        with monkeypatch.context() as patch:
            patch.setattr(UsbDevice, "bulk_out", deaf)
            patch.setattr(UsbDevice, "stream_out", lambda self, endpoint, data, began, deadline: (0, began))
            assert line.write_blocks(silent(range(5)), 0.03) == 2 * 512
        assert line.write_blocks(silent(range(2, 5)), 0.1) == 3 * 512
        found = acks(line)
        assert [(ack.sequence, ack.reason) for ack in found] == [(n, Reason.ACCEPTED) for n in range(5)]


def test_a_device_that_takes_parts_of_blocks_only_is_given_up(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = open_device(emulator.url)
    with monkeypatch.context() as patch:
        patch.setattr(EmulatorBackend, "bulk_write", lambda *arguments: 100)
        with pytest.raises(DeviceTimeoutError, match="did not take a block for 1 s"):
            device.show(Pulses.silent(320))
    assert device.show(Pulses.silent(320)).reason is Reason.ACCEPTED


def test_what_an_earlier_session_left_is_forgotten(line: UsbTransport) -> None:
    """Unread records, a part of a block, a halted endpoint; the outputs play on."""
    emulator = open_emulators()[-1]
    assert line.write_blocks(silent(range(100, 140)), 1.0) == 40 * 512
    if line.most_blocks_per_second < 40_000:
        emulator.usb.bulk_out(0x01, bytes(64))
    emulator.usb.control(Setup(0x02, 3, 0, 0x81, 0))
    line.close()
    again = open_usb(emulator.url)
    assert Status.decode(again.query(Request.STATUS, 64)).enabled
    assert again.write_blocks(silent(range(140, 143)), 1.0) == 3 * 512
    assert [ack.sequence for ack in acks(again)] == [140, 141, 142]
    again.close()


@pytest.mark.parametrize(("speed", "blocks"), [(HIGH_SPEED, 104_000), (FULL_SPEED, 2375)], ids=["high", "full"])
def test_what_the_bus_can_carry(speed: Speed, blocks: float) -> None:
    """Clause USB-010: 13 packets of 512 bytes in 125 µs, or 19 of 64 in 1 ms."""
    with Emulator(speed=speed) as emulator:
        line = open_usb(emulator.url)
        assert line.most_blocks_per_second == pytest.approx(blocks, rel=1e-3)
        line.close()


# Coming back


def test_a_device_that_stays_away_is_given_up(line: UsbTransport) -> None:
    open_emulators()[-1].usb.unplug()
    begun = line.time.monotonic()
    with pytest.raises(DeviceLostError, match="has not come back"):
        line.reopen(2.0)
    assert line.time.monotonic() - begun == pytest.approx(2, abs=0.2)
