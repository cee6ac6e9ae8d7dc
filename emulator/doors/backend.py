"""A pyusb backend whose bus holds emulators, so that the real host driver and pyusb run unchanged.

It behaves like libusb on Linux: its errors have libusb's numbers, transfers are cut into packets of the endpoint's
size, a device that left the bus and came back is another one, and an interface is claimed by one handle at a time.

Each transfer takes the least time that it would take on a bus: bulk packets follow each other as closely as USB allows,
and a control transfer takes a frame, or a microframe at high speed. After a NAK the device's time passes until it can
answer, or the transfer times out. Time also passes with each look at a bus without news, and for a host that waits by
the device's time (`EmulatorBackend.time_of`).
"""

from __future__ import annotations

import errno
from array import array
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property, partial
from types import SimpleNamespace
from typing import Any, ClassVar, NoReturn
from weakref import WeakKeyDictionary

from usb.core import USBError, USBTimeoutError

from ...base.libusb import SET_CONFIGURATION, Bus, BusHandle
from ...protocol.board import CORE_HZ, CYCLES_PER_MS
from ...protocol.enumeration import FULL_SPEED, HIGH_SPEED, Enumeration, Speed
from ...protocol.parsed_configuration import ParsedConfiguration, parsed
from ...protocol.requests import Setup
from ...protocol.timing import FULL_SPEED_PACKET_CYCLES, MICROFRAME_CYCLES, PACKET_CYCLES
from ..door import Handshake, Stall
from ..interfaces.usb_device import UsbDevice
from ..machine import NOT_OPEN, Emulator, open_emulators
from .address import EmulatorUrl
from .device_time import DeviceTime

__all__ = ["EmulatorBackend", "open_backend"]

RESET_CYCLES = CORE_HZ // 20  # 50 ms, USB 2.0, 7.1.7.5
FRAME_CYCLES = CYCLES_PER_MS
FOREVER_MS = 10**9  # eleven days: a time-out of 0 means none

LOOK_CYCLES = CORE_HZ // 100
"""Time that passes with each look at a bus without news, so that a waiting host sees a device arrive."""

_PACKET_CYCLES: dict[Speed, int] = {FULL_SPEED: FULL_SPEED_PACKET_CYCLES, HIGH_SPEED: PACKET_CYCLES}
_CONTROL_CYCLES: dict[Speed, int] = {FULL_SPEED: FRAME_CYCLES, HIGH_SPEED: MICROFRAME_CYCLES}

_LIBUSB_SPEEDS = {FULL_SPEED: 2, HIGH_SPEED: 3}


def open_backend(url: str) -> EmulatorBackend:
    """The bus for an ``emulator:`` URL (`EmulatorUrl.parse`): with a fresh emulator, or with all that are plugged in.

    Raises
    ------
    DeviceNotFoundError
        If the URL is wrong.
    InputFileError
        If its scenario cannot be used.
    """
    address = EmulatorUrl.parse(url)
    return EmulatorBackend(open_emulators() if address.serial else [address.make()])


class Port:
    """The host kernel's state of a device, shared by all backends of this process.

    Attributes
    ----------
    generation : int
        The last enumerated attachment of the device, 0 before the first.
    claims : dict of int to int
        The number of the handle for each claimed interface.
    """

    _of: ClassVar[WeakKeyDictionary[UsbDevice, Port]] = WeakKeyDictionary()

    def __init__(self) -> None:
        self.generation = 0
        self.claims: dict[int, int] = {}

    @classmethod
    def of(cls, device: UsbDevice) -> Port:
        """The port into which a device is plugged."""
        return cls._of.setdefault(device, cls())

    def has_news(self, device: UsbDevice) -> bool:
        """Whether the device has come to the bus since its last enumeration."""
        return device.attached and device.generation != self.generation

    def enumerate(self, device: UsbDevice) -> None:
        """Note that the device has come; reset it if it was there before, because it may have been in use."""
        came_back = self.generation > 0
        self.generation = device.generation
        self.claims.clear()
        if came_back:
            device.reset()


class Attachment:
    """A device from its arrival on the bus until it leaves; pyusb calls this a device."""

    def __init__(self, emulator: Emulator, address: int) -> None:
        self.usb = emulator.usb
        self.scheduler = emulator.scheduler
        self.port = Port.of(emulator.usb)
        self.address = address
        self.generation = emulator.usb.generation
        self.enumeration: Enumeration = emulator.usb.enumeration

    @property
    def there(self) -> bool:
        """Whether the device is still on the bus."""
        return self.usb.attached and self.usb.generation == self.generation

    @property
    def configuration(self) -> int:
        """The selected configuration, 0 for none."""
        return self.usb.configuration

    @property
    def claims(self) -> dict[int, int]:
        """For each claimed interface, the number of the handle."""
        return self.port.claims

    @cached_property
    def configurations(self) -> list[ParsedConfiguration]:
        """Its only configuration, in pyusb's form."""
        return [ParsedConfiguration(self.enumeration.configuration)]


class Handle(BusHandle[Attachment]):
    """An opened device, as held by one program."""

    def spend(self, cycles: int, began: int | None = None) -> None:
        """Let time pass, from now or an earlier core cycle, for a device that stays reachable.

        Raises
        ------
        USBError
            If the device has left the bus, or the bus is suspended; Linux then refuses all transfers, which libusb
            calls an I/O error.
        """
        self.check_awake()
        scheduler = self.device.scheduler
        scheduler.run_until(max(scheduler.now, (scheduler.now if began is None else began) + cycles))
        self.check_awake()

    def check_awake(self) -> None:
        """Raise `USBError` if a transfer cannot reach the device."""
        self.check_there()
        if self.device.usb.suspended:
            raise USBError("Input/Output Error", None, errno.EIO)

    def deadline(self, timeout_ms: int) -> int:
        """The core cycle at which a time-out ends."""
        return self.device.scheduler.now + (timeout_ms or FOREVER_MS) * FRAME_CYCLES

    def insist(
        self, deadline: int, endpoint: int, transact: Callable[[], bytes | Handshake], began: int | None = None
    ) -> bytes:
        """Repeat a bulk transaction, begun now or before, until the answer is not NAK; returns the packet, if any.

        Raises
        ------
        USBTimeoutError
            If the time-out ends before.
        USBError
            If the endpoint is halted, or the device out of reach.
        """
        scheduler = self.device.scheduler
        self.spend(_PACKET_CYCLES[self.device.usb.speed], began)
        while scheduler.now > deadline or (answer := transact()) is Handshake.NAK:
            upcoming = scheduler.next_time()
            if upcoming is None or upcoming > deadline:
                scheduler.run_until(deadline)
                raise USBTimeoutError("Operation timed out", None, errno.ETIMEDOUT)
            scheduler.run_until(upcoming)
            self.check_awake()
        if answer is Handshake.STALL:
            _stalled(f"endpoint 0x{endpoint:02x}")
        return answer if isinstance(answer, bytes) else b""


class EmulatorBackend(Bus[Handle]):
    """The bus. What pyusb calls a device is an `Attachment`."""

    hint = NOT_OPEN

    def __init__(self, emulators: Iterable[Emulator]) -> None:
        super().__init__()
        self._emulators = list(emulators)

    def enumerate_devices(self) -> Iterator[Attachment]:
        """Every emulator that is attached to the bus."""
        for address, emulator in enumerate(self._emulators, start=1):
            port = Port.of(emulator.usb)
            if not port.has_news(emulator.usb):
                emulator.scheduler.run_until(emulator.scheduler.now + LOOK_CYCLES)
            if port.has_news(emulator.usb):
                port.enumerate(emulator.usb)
            if emulator.usb.attached:
                yield Attachment(emulator, address)

    def time_of(self, address: int) -> DeviceTime:
        """The time of the device with an address on this bus."""
        return DeviceTime(self._emulators[address - 1].scheduler)

    def get_device_descriptor(self, dev: Attachment) -> SimpleNamespace:
        """The device descriptor, with its place on the bus."""
        place = {"bus": 0, "address": dev.address, "port_number": dev.address, "port_numbers": (dev.address,)}
        return SimpleNamespace(**vars(parsed(dev.enumeration.device)), **place, speed=_LIBUSB_SPEEDS[dev.usb.speed])

    def open_device(self, dev: Attachment) -> Handle:
        """A new handle."""
        return Handle(dev)

    def is_kernel_driver_active(self, dev_handle: Handle, intf: int) -> bool:
        """No kernel is involved."""
        return False

    def bulk_write(self, dev_handle: Handle, ep: int, intf: int, data: Any, timeout: int) -> int:
        """Send data in packets, or an empty one; returns the number of bytes that the device took in time."""
        dev_handle.claim(intf)
        device = dev_handle.device.usb
        deadline = dev_handle.deadline(timeout)
        payload, sent, began = bytes(data), 0, dev_handle.device.scheduler.now
        while True:
            dev_handle.check_awake()
            taken, began = device.stream_out(ep, memoryview(payload)[sent:], began, deadline)
            sent += taken
            if taken and sent == len(payload):
                return sent
            packet = payload[sent : sent + device.speed.bulk_bytes]
            try:
                dev_handle.insist(deadline, ep, partial(device.bulk_out, ep, packet), began)
                began = dev_handle.device.scheduler.now
            except USBTimeoutError:
                if sent:
                    return sent  # as pyusb does over libusb
                raise
            sent += len(packet)
            if sent == len(payload):
                return sent

    def bulk_read(self, dev_handle: Handle, ep: int, intf: int, buff: Any, timeout: int) -> int:
        """Receive packets until the buffer is full or a packet is short; returns the number of bytes received."""
        dev_handle.claim(intf)
        device = dev_handle.device.usb
        deadline = dev_handle.deadline(timeout)
        room, received = len(buff) * buff.itemsize, 0
        while True:
            try:
                packet = dev_handle.insist(deadline, ep, partial(device.bulk_in, ep))
            except USBTimeoutError:
                if received:
                    return received  # as pyusb does over libusb
                raise
            if received + len(packet) > room:
                raise USBError("Overflow", None, errno.EOVERFLOW)
            buff[received : received + len(packet)] = array("B", packet)
            received += len(packet)
            if received == room or len(packet) < device.speed.bulk_bytes:
                return received

    intr_read = bulk_read  # a packet of an interrupt endpoint is shorter than the limit of a bulk endpoint

    def ctrl_transfer(
        self,
        dev_handle: Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        timeout: int,
    ) -> int:
        """Carry out a control transfer; returns the number of bytes transferred."""
        device = dev_handle.device.usb
        dev_handle.spend(_CONTROL_CYCLES[device.speed])
        setup = Setup(bmRequestType, bRequest, wValue, wIndex, len(data))
        try:
            answer = device.control(setup, b"" if setup.is_in else bytes(data))
        except Stall as stall:
            _stalled(str(stall))
        if not setup.is_in:
            return len(data)
        data[: len(answer)] = array("B", answer)
        return len(answer)

    def reset_device(self, dev_handle: Handle) -> None:
        """Reset the port and configure the device as it was.

        Raises
        ------
        USBError
            Not found, if the device came back as another one: it must be found again.
        """
        dev_handle.check_there()
        attachment = dev_handle.device
        configuration = attachment.usb.configuration
        attachment.scheduler.run_until(attachment.scheduler.now + RESET_CYCLES)
        if attachment.there:
            attachment.usb.reset()
        if not attachment.there:
            raise USBError("Entity not found", None, errno.ENOENT)
        if configuration:
            self.command(dev_handle, SET_CONFIGURATION, configuration, 0)


def _stalled(what: str) -> NoReturn:
    raise USBError(f"Pipe error: {what}", None, errno.EPIPE)
