"""One host of the usbredir door, such as QEMU: its messages, and the transfers of its device.

The layouts are those of the usbredir protocol, version 0.7 (usbredir-protocol.md); every number in them is
little-endian. Unlike a client of USB/IP the host reports bus resets, and a device may leave the bus and come back on
one connection. A host must support 64-bit message numbers and 32-bit lengths, as QEMU does.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum, IntFlag

from ...protocol.board import CORE_HZ
from ...protocol.codes import StandardRequest
from ...protocol.descriptors import Endpoint, Interface, descriptors
from ...protocol.enumeration import HIGH_SPEED
from ...protocol.requests import DIRECTION_IN, Setup
from .usb_bus import Transfer, TransferOutcome, UsbBus
from .usb_conversation import UsbConversation
from .usbip_session import MOST_BYTES, MOST_PENDING, MOST_TRANSFERS, Exported

__all__ = ["UsbRedirSession"]

_HELLO = struct.Struct("<64sI")
_HELLO_HEADER, _HEADER = struct.Struct("<III"), struct.Struct("<IIQ")
_CONNECT = struct.Struct("<BBBBHHH")
_CONTROL, _BULK, _INTERRUPT = struct.Struct("<BBBBHHH"), struct.Struct("<BBHIH"), struct.Struct("<BBH")
_MOST_MESSAGE_BYTES = 1 << 24
_MOST_INTERRUPT_BYTES = 1024
_NO_SETUP = Setup(0, 0, 0, 0, 0)
_PLACES = 32
_NONE = 255
_FULL_SPEED, _HIGH_SPEED = 1, 2
_TO_INTERFACE = 0x01
_LINGER_CYCLES = CORE_HZ
"""How long time passes at the fast pace for a device that is about to attach itself."""


class _Cap(IntFlag):
    """The capabilities that a host must have."""

    CONNECT_DEVICE_VERSION = 1 << 1
    EP_INFO_MAX_PACKET_SIZE = 1 << 4
    IDS_OF_64_BITS = 1 << 5
    LENGTHS_OF_32_BITS = 1 << 6


_CAPS = _Cap.CONNECT_DEVICE_VERSION | _Cap.EP_INFO_MAX_PACKET_SIZE | _Cap.IDS_OF_64_BITS | _Cap.LENGTHS_OF_32_BITS


class _Type(IntEnum):
    """Kinds of messages."""

    HELLO = 0
    DEVICE_CONNECT = 1
    DEVICE_DISCONNECT = 2
    RESET = 3
    INTERFACE_INFO = 4
    EP_INFO = 5
    SET_CONFIGURATION = 6
    GET_CONFIGURATION = 7
    CONFIGURATION_STATUS = 8
    SET_ALT_SETTING = 9
    GET_ALT_SETTING = 10
    ALT_SETTING_STATUS = 11
    START_INTERRUPT_RECEIVING = 15
    STOP_INTERRUPT_RECEIVING = 16
    INTERRUPT_RECEIVING_STATUS = 17
    CANCEL_DATA_PACKET = 21
    FILTER_FILTER = 23
    CONTROL_PACKET = 100
    BULK_PACKET = 101
    INTERRUPT_PACKET = 103


_HEADS: dict[int, int] = {
    _Type.CONTROL_PACKET: _CONTROL.size,
    _Type.BULK_PACKET: _BULK.size,
    _Type.INTERRUPT_PACKET: _INTERRUPT.size,
}
_SUCCESS, _CANCELLED, _INVALID, _IO_ERROR, _STALL, _BABBLE = 0, 1, 2, 3, 4, 6
_STATUS = {
    TransferOutcome.DONE: _SUCCESS,
    TransferOutcome.SHORT: _SUCCESS,
    TransferOutcome.STALLED: _STALL,
    TransferOutcome.OVERFLOW: _BABBLE,
    TransferOutcome.TAKEN_BACK: _CANCELLED,
}


class UsbRedirSession(UsbConversation):
    """A conversation with one host, which sees the device whenever it is attached.

    Parameters
    ----------
    exported : Exported
        The device; no other client may hold it.

    Attributes
    ----------
    greeted : bool
        Whether the host's greeting has come.
    """

    def __init__(self, exported: Exported) -> None:
        super().__init__()
        self._exported = exported
        exported.taken = True
        exported.station.conversations.append(self)
        self._scheduler = exported.station.scheduler
        self.greeted = False
        self._generation = 0
        self._absent_since = self._scheduler.now
        self._transfers: dict[int, Transfer] = {}
        self._bytes = 0
        self._interrupts: dict[int, Transfer] = {}  # by endpoint
        self._pending += _HELLO_HEADER.pack(_Type.HELLO, _HELLO.size, 0)
        self._pending += _HELLO.pack(b"phasewire", _CAPS)

    @property
    def full(self) -> bool:
        """Whether the host should pause its output."""
        return len(self._pending) > MOST_PENDING

    @property
    def presses(self) -> bool:
        """Whether some data are under way, so that time must pass at the fast pace too."""
        if self._bus is None:
            return self.greeted and self._scheduler.now < self._absent_since + _LINGER_CYCLES
        return self._bus.presses and not self.full

    def receive(self, data: bytes) -> None:
        """Take bytes of the host; it is dropped if they make no sense."""
        self._received += data
        while not self.over and self._read():
            self._check_attachment()

    def next_time(self, event: int | None) -> int | None:
        """The time of its next action, if no one else acts; the device's own is `event`."""
        if self._bus is None:
            return event if self.greeted else None
        return None if self.full else self._bus.next_time(event)

    def run(self) -> None:
        """Perform the actions that are due."""
        self._check_attachment()
        if self._bus and not self.full:
            self._bus.run()
            self._check_attachment()

    def _read(self) -> bool:
        """Carry out the next message, if it has arrived."""
        header = _HEADER if self.greeted else _HELLO_HEADER
        if len(self._received) < header.size:
            return False
        kind, length, number = header.unpack_from(self._received)
        if length > _MOST_MESSAGE_BYTES:
            self._leave(f"it sent a message of {length} bytes; at most {_MOST_MESSAGE_BYTES} are taken")
            return False
        end = header.size + length
        if len(self._received) < end:
            return False
        data = bytes(memoryview(self._received)[header.size : end])
        del self._received[:end]
        try:
            if self.greeted:
                self._obey(kind, number, data)
            else:
                self._greet(kind, data)
        except (struct.error, ValueError, IndexError) as error:
            self._leave(f"it sent message {kind} of {length} bytes: {error}")
        return True

    def _greet(self, kind: int, data: bytes) -> None:
        known = int.from_bytes(data[64:68], "little")
        if kind != _Type.HELLO or known & _CAPS != _CAPS:
            self._leave(f"it began with message {kind} and capabilities {known:#x}; it needs those in {int(_CAPS):#x}")
        self.greeted = True

    def _obey(self, kind: int, number: int, data: bytes) -> None:
        if self._bus is None or kind == _Type.FILTER_FILTER:
            if kind in (_Type.CONTROL_PACKET, _Type.BULK_PACKET, _Type.INTERRUPT_PACKET):
                self._answer_early(kind, number, data, _IO_ERROR)
            return
        match kind:
            case _Type.RESET:
                self._forget_all()
                self._exported.device.reset()
            case _Type.SET_CONFIGURATION:
                setup = Setup(0, StandardRequest.SET_CONFIGURATION, data[0], 0, 0)
                self._ask(number, setup, lambda status, _: self._tell_configuration(number, status))
            case _Type.GET_CONFIGURATION:
                self._tell_configuration(number, _SUCCESS)
            case _Type.SET_ALT_SETTING:
                setup = Setup(_TO_INTERFACE, StandardRequest.SET_INTERFACE, data[1], data[0], 0)
                self._ask(number, setup, lambda status, _: self._tell_setting(number, status, data[:2]))
            case _Type.GET_ALT_SETTING:
                setup = Setup(DIRECTION_IN | _TO_INTERFACE, StandardRequest.GET_INTERFACE, 0, data[0], 1)
                self._ask(number, setup, lambda status, got: self._tell_setting(number, status, data[:1] + got))
            case _Type.START_INTERRUPT_RECEIVING:
                self._start_interrupts(number, data[0])
            case _Type.STOP_INTERRUPT_RECEIVING:
                self._stop_interrupts(data[0])
                self._say(_Type.INTERRUPT_RECEIVING_STATUS, number, bytes([_SUCCESS, data[0]]))
            case _Type.CANCEL_DATA_PACKET:
                transfer = self._transfers.get(number)
                if transfer is not None:
                    self._bus.cancel(transfer)
                    transfer.on_end(transfer, TransferOutcome.TAKEN_BACK)
            case _Type.CONTROL_PACKET:
                self._control(number, data)
            case _Type.BULK_PACKET:
                self._bulk(number, data)
            case _:
                self._answer_early(kind, number, data, _INVALID)

    def _control(self, number: int, data: bytes) -> None:
        endpoint, request, request_type, _, value, index, length = _CONTROL.unpack_from(data)
        setup = Setup(request_type, request, value, index, length)

        def answer(transfer: Transfer, outcome: TransferOutcome) -> None:
            size = len(transfer.received) if setup.is_in else transfer.sent
            status = _STATUS.get(outcome, _IO_ERROR)
            head = _CONTROL.pack(endpoint, request, request_type, status, value, index, size)
            self._say(_Type.CONTROL_PACKET, number, head + bytes(transfer.received))

        sent = data[_CONTROL.size :]
        self._begin(number, Transfer(endpoint, length, sent, setup, False, False, answer))

    def _bulk(self, number: int, data: bytes) -> None:
        endpoint, _, low, stream, high = _BULK.unpack_from(data)
        length, sent = high << 16 | low, data[_BULK.size :]
        if not endpoint & DIRECTION_IN and len(sent) != length:
            raise ValueError(f"{len(sent)} bytes of data; {length} were announced")

        def answer(transfer: Transfer, outcome: TransferOutcome) -> None:
            size = len(transfer.received) if transfer.is_in else transfer.sent
            status = _STATUS.get(outcome, _IO_ERROR)
            head = _BULK.pack(endpoint, status, size & 0xFFFF, stream, size >> 16)
            self._say(_Type.BULK_PACKET, number, head + bytes(transfer.received))

        self._begin(number, Transfer(endpoint, length, sent, _NO_SETUP, False, False, answer))

    def _ask(self, number: int, setup: Setup, then: Callable[[int, bytes], None]) -> None:
        """Make a request that the host has sent as a message of its own."""

        def answer(transfer: Transfer, outcome: TransferOutcome) -> None:
            then(_STATUS.get(outcome, _IO_ERROR), bytes(transfer.received))

        endpoint = DIRECTION_IN if setup.is_in else 0
        self._begin(number, Transfer(endpoint, setup.length, b"", setup, False, False, answer))

    def _begin(self, number: int, transfer: Transfer) -> None:
        assert self._bus
        self._bytes += len(transfer.data)
        if number in self._transfers or len(self._transfers) == MOST_TRANSFERS or self._bytes > MOST_BYTES:
            raise ValueError(f"transfer {number} is under way, or more than {MOST_TRANSFERS} or {MOST_BYTES} bytes are")
        answer = transfer.on_end

        def end(transfer: Transfer, outcome: TransferOutcome) -> None:
            if self._transfers.pop(number, None) is not None:
                self._bytes -= len(transfer.data)
                answer(transfer, outcome)

        transfer.on_end = end
        self._transfers[number] = transfer
        self._bus.submit(transfer)

    def _start_interrupts(self, number: int, endpoint: int) -> None:
        self._stop_interrupts(endpoint)
        self._say(_Type.INTERRUPT_RECEIVING_STATUS, number, bytes([_SUCCESS, endpoint]))
        self._listen(endpoint, 0)

    def _listen(self, endpoint: int, count: int) -> None:
        """Poll an interrupt endpoint for its next packet."""
        assert self._bus

        def answer(transfer: Transfer, outcome: TransferOutcome) -> None:
            head = _INTERRUPT.pack(endpoint, _STATUS.get(outcome, _IO_ERROR), len(transfer.received))
            self._say(_Type.INTERRUPT_PACKET, count, head + bytes(transfer.received))
            del self._interrupts[endpoint]
            if outcome is TransferOutcome.DONE:
                self._listen(endpoint, count + 1)

        transfer = Transfer(endpoint, _MOST_INTERRUPT_BYTES, b"", _NO_SETUP, False, False, answer)
        self._interrupts[endpoint] = transfer
        self._bus.submit(transfer)

    def _stop_interrupts(self, endpoint: int) -> None:
        assert self._bus
        transfer = self._interrupts.pop(endpoint, None)
        if transfer is not None:
            self._bus.cancel(transfer)

    def _answer_early(self, kind: int, number: int, data: bytes, status: int) -> None:
        """Refuse a transfer, whose answer repeats its head; other unknown messages are ignored."""
        size = _HEADS.get(kind)
        if size is not None:
            head = bytearray(data[:size])
            head[3 if kind == _Type.CONTROL_PACKET else 1] = status
            self._say(kind, number, bytes(head))

    def _tell_configuration(self, number: int, status: int) -> None:
        self._describe()
        configuration = self._exported.device.configuration
        self._say(_Type.CONFIGURATION_STATUS, number, bytes([status, configuration]))

    def _tell_setting(self, number: int, status: int, interface_and_setting: bytes) -> None:
        told = bytes([status]) + interface_and_setting.ljust(2, b"\0")
        self._say(_Type.ALT_SETTING_STATUS, number, told)

    def _describe(self) -> None:
        """Tell the host of interfaces and endpoints, which it needs before it sees the device."""
        found = descriptors(self._exported.device.enumeration.configuration)
        interfaces = [each for each in found if isinstance(each, Interface) and not each.bAlternateSetting]
        rows = bytearray(4 * _PLACES)
        kinds, intervals, owners = bytearray([_NONE] * _PLACES), bytearray(_PLACES), bytearray(_PLACES)
        sizes = [0] * _PLACES
        for place, each in enumerate(interfaces):
            rows[place::_PLACES] = bytes(
                [each.bInterfaceNumber, each.bInterfaceClass, each.bInterfaceSubClass, each.bInterfaceProtocol]
            )
        kinds[0] = kinds[_PLACES // 2] = 0
        owner = 0
        for part in found:
            if isinstance(part, Interface):
                owner = part.bInterfaceNumber
            elif isinstance(part, Endpoint):
                place = (part.bEndpointAddress & DIRECTION_IN) >> 3 | part.bEndpointAddress & 0x0F
                kinds[place], intervals[place], owners[place] = part.bmAttributes & 3, part.bInterval, owner
                sizes[place] = part.wMaxPacketSize
        self._say(_Type.INTERFACE_INFO, 0, struct.pack("<I", len(interfaces)) + rows)
        self._say(_Type.EP_INFO, 0, bytes(kinds + intervals + owners) + struct.pack(f"<{_PLACES}H", *sizes))

    def _check_attachment(self) -> None:
        """Tell the host whether the device is there; one that comes back at once was away too."""
        device = self._exported.device
        if self.over or not self.greeted:
            return
        if self._bus and not (device.attached and device.generation == self._generation):
            self._forget_all()
            self._bus = None
            self._absent_since = self._scheduler.now
            self._say(_Type.DEVICE_DISCONNECT, 0, b"")
        if self._bus is None and device.attached:
            self._bus = UsbBus(device, self._scheduler)
            self._generation = device.generation
            self._describe()
            head = device.enumeration.device
            speed = _HIGH_SPEED if device.speed == HIGH_SPEED else _FULL_SPEED
            kind = (head.bDeviceClass, head.bDeviceSubClass, head.bDeviceProtocol)
            told = _CONNECT.pack(speed, *kind, head.idVendor, head.idProduct, head.bcdDevice)
            self._say(_Type.DEVICE_CONNECT, 0, told)

    def _forget_all(self) -> None:
        """End all transfers, as after a reset or when a device leaves."""
        assert self._bus
        for endpoint in tuple(self._interrupts):
            self._stop_interrupts(endpoint)
        for transfer in tuple(self._transfers.values()):
            self._bus.cancel(transfer)
            transfer.on_end(transfer, TransferOutcome.GONE)

    def _say(self, kind: int, number: int, data: bytes) -> None:
        self._pending += _HEADER.pack(kind, len(data), number) + data

    def _leave(self, reason: str) -> None:
        """End the conversation with the host; for the device its cable is unplugged."""
        if not self.over:
            self.over = True
            self.end = reason
            self._received.clear()
            self._transfers.clear()
            self._exported.station.conversations.remove(self)
            self._exported.taken = False
            self._exported.device.unplug()
            self._exported.device.plug()
