"""USB/IP as bytes: a client's requests and a server's answers, for both sides (protocol version 1.1.1).

The layouts are those of the Linux kernel's Documentation/usb/usbip_protocol.rst; every number in them is big-endian,
except in the eight bytes of a setup stage. A connection begins with one request: for the list of devices, which ends
it, or for a device, after which commands follow. This module knows neither sockets nor devices. Its functions that
read take a buffer that may hold only the beginning of a message, and return the message and its length in bytes, or
None if more bytes must come first.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from .descriptors import Configuration, Interface, descriptors
from .enumeration import HIGH_SPEED, Enumeration, Speed
from .requests import DIRECTION_IN, Setup

__all__ = [
    "ANSWER_BYTES",
    "MOST_URB_BYTES",
    "PORT",
    "Answer",
    "Export",
    "ImportStatus",
    "Importing",
    "Listing",
    "Offer",
    "Submit",
    "Unlink",
    "encode_command",
    "encode_import",
    "encode_list",
    "encode_request",
    "encode_submitted",
    "encode_unlinked",
    "read_answer",
    "read_command",
    "read_import",
    "read_list",
    "read_request",
]

PORT = 3240
"""The registered TCP port of USB/IP."""

MOST_URB_BYTES = 1 << 24
"""The longest accepted transfer: Linux's default limit for all transfers of a user together."""

_VERSION = 0x0111
_REQUEST_HEADER = struct.Struct(">HHI")
_REQUEST_LIST, _REPLY_LIST = 0x8005, 0x0005
_REQUEST_IMPORT, _REPLY_IMPORT = 0x8003, 0x0003
_BUS_ID_BYTES = 32
_DEVICE = struct.Struct(f">256s{_BUS_ID_BYTES}sIIIHHHBBBBBB")
_FULL_SPEED, _HIGH_SPEED = 2, 3

_SUBMIT, _UNLINK, _SUBMITTED, _UNLINKED = 1, 2, 3, 4
_COMMAND = struct.Struct(">5I")
_SUBMIT_REST = struct.Struct(">4Ii8s")
_SUBMITTED_REST = struct.Struct(">iIII12x")
_UNLINKED_REST = struct.Struct(">i24x")
_COMMAND_BYTES = _COMMAND.size + _SUBMIT_REST.size
ANSWER_BYTES = _COMMAND.size + _SUBMITTED_REST.size
"""The length of an answer to a command, without the data after it."""
_DIRECTION_IN = 1
_HIGHEST_ENDPOINT = 15
_MOST_NUMBER = 0xFFFF
_SHORT_NOT_OK, _ZERO_PACKET = 0x0001, 0x0040  # flags of a transfer
_NOT_ISOCHRONOUS = (0, 0xFFFF_FFFF)  # numbers of packets; the kernel sends the first, its document says the second


class ImportStatus(IntEnum):
    """Answers to a request for a device; the kernel's tools have texts for these numbers."""

    OK = 0
    NOT_AVAILABLE = 1
    BUSY = 2
    NO_DEVICE = 4


class Export(NamedTuple):
    """A device as a server offers it: its address on a bus, and its descriptors.

    Parameters
    ----------
    bus, number : int
        Numbers of the bus, and of the device on it.
    enumeration : Enumeration
        The device's descriptors.
    speed : Speed
        The device's speed.
    configuration : int
        The selected configuration, 0 for none.
    """

    bus: int
    number: int
    enumeration: Enumeration
    speed: Speed
    configuration: int

    @property
    def bus_id(self) -> str:
        """The name by which a client requests it."""
        return f"{self.bus}-{self.number}"

    @property
    def device_id(self) -> int:
        """Its number in commands."""
        return self.bus << 16 | self.number


class Offer(NamedTuple):
    """A device as a client reads of it.

    Parameters
    ----------
    bus_id : str
        The name by which it is requested.
    bus, number : int
        Numbers of the bus, and of the device on it.
    speed : int
        Linux's number of its speed.
    vendor, product : int
        The device's numbers.
    interfaces : tuple of (int, int, int)
        Class, subclass and protocol of each interface; only a list tells them.
    """

    bus_id: str
    bus: int
    number: int
    speed: int
    vendor: int
    product: int
    interfaces: tuple[tuple[int, int, int], ...] = ()

    @property
    def device_id(self) -> int:
        """Its number in commands."""
        return self.bus << 16 | self.number


class Answer(NamedTuple):
    """The answer to a command, without its data.

    Parameters
    ----------
    unlinked : bool
        Whether it answers `Unlink`.
    number : int
        The number of the command.
    status : int
        0, or the negative number of an error of Linux.
    actual : int
        Number of bytes sent or received; the received ones follow.
    """

    unlinked: bool
    number: int
    status: int
    actual: int


class Listing(NamedTuple):
    """The request for the list of devices."""


class Importing(NamedTuple):
    """The request for a device."""

    bus_id: str


class Submit(NamedTuple):
    """The command to carry out a transfer.

    Parameters
    ----------
    number : int
        The number of the command; the answer repeats it.
    device_id : int
        The device.
    endpoint : int
        Address of the endpoint, with the bit of its direction.
    zero_packet : bool
        Whether an empty packet follows if the last one sent is full.
    short_not_ok : bool
        Whether it is an error to receive less than the room.
    length : int
        Bytes to be sent, or room for those to be received.
    start_frame, packets : int
        Used only by isochronous transfers; the answer repeats them.
    setup : Setup
        The setup stage of a control transfer; unused for others.
    data : bytes
        The data to send.
    interval : int
        The interval of an interrupt endpoint, in frames or microframes; 0 for others.
    """

    number: int
    device_id: int
    endpoint: int
    zero_packet: bool
    short_not_ok: bool
    length: int
    start_frame: int
    packets: int
    setup: Setup
    data: bytes
    interval: int = 0


class Unlink(NamedTuple):
    """The command to cancel a transfer."""

    number: int
    device_id: int
    target: int
    """The number of the transfer's command."""


def read_request(buffer: bytes | bytearray) -> tuple[Listing | Importing, int] | None:
    """Read the request at the beginning of a connection.

    Returns
    -------
    (request, int) or None
        The request and its length in bytes; None if more bytes must come first.

    Raises
    ------
    ValueError
        If the bytes are no request.
    """
    if len(buffer) < _REQUEST_HEADER.size:
        return None
    version, code, _ = _REQUEST_HEADER.unpack_from(buffer)
    if version != _VERSION:
        raise ValueError(f"version {version:#06x} of USB/IP; this is version {_VERSION:#06x}")
    if code == _REQUEST_LIST:
        return Listing(), _REQUEST_HEADER.size
    if code != _REQUEST_IMPORT:
        raise ValueError(f"request {code:#06x}; there are {_REQUEST_LIST:#06x} and {_REQUEST_IMPORT:#06x}")
    end = _REQUEST_HEADER.size + _BUS_ID_BYTES
    if len(buffer) < end:
        return None
    bus_id = bytes(buffer[_REQUEST_HEADER.size : end]).partition(b"\0")[0]
    return Importing(bus_id.decode("ascii", "replace")), end


def read_command(buffer: bytes | bytearray) -> tuple[Submit | Unlink, int] | None:
    """Read a command of a client that has a device.

    Returns
    -------
    (command, int) or None
        The command and its length in bytes, its data included; None if more bytes must come first.

    Raises
    ------
    ValueError
        If the bytes are no command, or one for an isochronous or too long transfer.
    """
    if len(buffer) < _COMMAND_BYTES:
        return None
    code, number, device_id, direction, endpoint = _COMMAND.unpack_from(buffer)
    flags, length, start_frame, packets, interval, setup = _SUBMIT_REST.unpack_from(buffer, _COMMAND.size)
    if code == _UNLINK:
        return Unlink(number, device_id, target=flags), _COMMAND_BYTES
    if code != _SUBMIT:
        raise ValueError(f"command {code}; there are {_SUBMIT} and {_UNLINK}")
    if endpoint > _HIGHEST_ENDPOINT or direction > _DIRECTION_IN:
        raise ValueError(f"endpoint {endpoint} in direction {direction}; they go to {_HIGHEST_ENDPOINT} and 1")
    if packets not in _NOT_ISOCHRONOUS:
        raise ValueError(f"an isochronous transfer of {packets} packets; the device has no endpoint for these")
    if length > MOST_URB_BYTES:
        raise ValueError(f"a transfer of {length} bytes; at most {MOST_URB_BYTES} are taken")
    is_in = direction == _DIRECTION_IN
    end = _COMMAND_BYTES if is_in else _COMMAND_BYTES + length
    if len(buffer) < end:
        return None
    address = endpoint | (DIRECTION_IN if is_in else 0)
    data = bytes(memoryview(buffer)[_COMMAND_BYTES:end])
    submit = Submit(
        number,
        device_id,
        address,
        bool(flags & _ZERO_PACKET),
        bool(flags & _SHORT_NOT_OK),
        length,
        start_frame,
        packets,
        Setup.decode(setup),
        data,
        interval,
    )
    return submit, end


def encode_list(exports: Sequence[Export]) -> bytes:
    """The answer to `Listing`."""
    head = _REQUEST_HEADER.pack(_VERSION, _REPLY_LIST, 0) + struct.pack(">I", len(exports))
    return head + b"".join(_device(export) + _interfaces(export) for export in exports)


def encode_import(status: ImportStatus, export: Export | None = None) -> bytes:
    """The answer to `Importing`, with the device if it is available."""
    return _REQUEST_HEADER.pack(_VERSION, _REPLY_IMPORT, status) + (b"" if export is None else _device(export))


def encode_submitted(submit: Submit, status: int, actual: int, data: bytes | bytearray = b"") -> bytes:
    """The answer to `Submit`.

    Parameters
    ----------
    submit : Submit
        The command.
    status : int
        0, or the negative number of an error of Linux.
    actual : int
        Number of bytes sent or received.
    data : bytes
        The received data.
    """
    head = _COMMAND.pack(_SUBMITTED, submit.number, 0, 0, 0)
    return head + _SUBMITTED_REST.pack(status, actual, submit.start_frame, submit.packets) + data


def encode_unlinked(unlink_number: int, status: int) -> bytes:
    """The answer to `Unlink`: the negative number of an error if the transfer was cancelled, 0 if it had ended."""
    return _COMMAND.pack(_UNLINKED, unlink_number, 0, 0, 0) + _UNLINKED_REST.pack(status)


def _device(export: Export) -> bytes:
    device, configuration = export.enumeration.device, _configuration(export)
    return _DEVICE.pack(
        f"/sys/devices/phasewire/usb{export.bus}/{export.bus_id}".encode(),
        export.bus_id.encode(),
        export.bus,
        export.number,
        _HIGH_SPEED if export.speed == HIGH_SPEED else _FULL_SPEED,
        device.idVendor,
        device.idProduct,
        device.bcdDevice,
        device.bDeviceClass,
        device.bDeviceSubClass,
        device.bDeviceProtocol,
        export.configuration,
        device.bNumConfigurations,
        configuration.bNumInterfaces,
    )


def _configuration(export: Export) -> Configuration:
    head = descriptors(export.enumeration.configuration)[0]
    assert isinstance(head, Configuration)
    return head


def _interfaces(export: Export) -> bytes:
    found = (each for each in descriptors(export.enumeration.configuration) if isinstance(each, Interface))
    return b"".join(
        bytes([each.bInterfaceClass, each.bInterfaceSubClass, each.bInterfaceProtocol, 0]) for each in found
    )


def encode_request(request: Listing | Importing) -> bytes:
    """The beginning of a connection."""
    if isinstance(request, Listing):
        return _REQUEST_HEADER.pack(_VERSION, _REQUEST_LIST, 0)
    head = _REQUEST_HEADER.pack(_VERSION, _REQUEST_IMPORT, 0)
    return head + request.bus_id.encode().ljust(_BUS_ID_BYTES, b"\0")


def read_list(buffer: bytes | bytearray) -> tuple[list[Offer], int] | None:
    """Read the answer to `Listing`; raises `ValueError` if the bytes are not one, or name a device out of range."""
    if not _is_reply(buffer, _REPLY_LIST) or len(buffer) < _REQUEST_HEADER.size + 4:
        return None
    (count,) = struct.unpack_from(">I", buffer, _REQUEST_HEADER.size)
    offers, at = list[Offer](), _REQUEST_HEADER.size + 4
    for _ in range(count):
        if len(buffer) < at + _DEVICE.size:
            return None
        offer, interfaces = _read_device(buffer, at)
        at, start = at + _DEVICE.size + 4 * interfaces, at + _DEVICE.size
        if len(buffer) < at:
            return None
        classes = tuple((buffer[each], buffer[each + 1], buffer[each + 2]) for each in range(start, at, 4))
        offers.append(offer._replace(interfaces=classes))
    return offers, at


def read_import(buffer: bytes | bytearray) -> tuple[Offer | int, int] | None:
    """Read the answer to `Importing`: the device, or the status of a refusal; raises `ValueError` as `read_list`."""
    if not _is_reply(buffer, _REPLY_IMPORT):
        return None
    *_, status = _REQUEST_HEADER.unpack_from(buffer)
    if status:
        return int(status), _REQUEST_HEADER.size
    end = _REQUEST_HEADER.size + _DEVICE.size
    return None if len(buffer) < end else (_read_device(buffer, _REQUEST_HEADER.size)[0], end)


def encode_command(command: Submit | Unlink) -> bytes:
    """A command of a client that has a device."""
    if isinstance(command, Unlink):
        return _COMMAND.pack(_UNLINK, command.number, command.device_id, 0, 0) + struct.pack(">I24x", command.target)
    is_in, endpoint = bool(command.endpoint & DIRECTION_IN), command.endpoint & ~DIRECTION_IN
    flags = _ZERO_PACKET * command.zero_packet | _SHORT_NOT_OK * command.short_not_ok
    head = _COMMAND.pack(_SUBMIT, command.number, command.device_id, is_in, endpoint)
    rest = flags, command.length, command.start_frame, command.packets, command.interval, command.setup.encode()
    return head + _SUBMIT_REST.pack(*rest) + command.data


def read_answer(buffer: bytes | bytearray) -> Answer | None:
    """Read an answer to a command, of `ANSWER_BYTES`; raises `ValueError` if the bytes are not one."""
    if len(buffer) < ANSWER_BYTES:
        return None
    code, number, *_ = _COMMAND.unpack_from(buffer)
    if code not in (_SUBMITTED, _UNLINKED):
        raise ValueError(f"answer {code}; there are {_SUBMITTED} and {_UNLINKED}")
    status, actual, *_ = _SUBMITTED_REST.unpack_from(buffer, _COMMAND.size)
    return Answer(code == _UNLINKED, number, status, 0 if code == _UNLINKED else actual)


def _is_reply(buffer: bytes | bytearray, wanted: int) -> bool:
    """Whether the head of a reply is there; raises `ValueError` if it is that of anything else."""
    if len(buffer) < _REQUEST_HEADER.size:
        return False
    version, code, _ = _REQUEST_HEADER.unpack_from(buffer)
    if (version, code) != (_VERSION, wanted):
        raise ValueError(f"{bytes(buffer[:4]).hex()}, no reply {wanted:#06x} of USB/IP {_VERSION:#06x}")
    return True


def _read_device(buffer: bytes | bytearray, at: int) -> tuple[Offer, int]:
    """A device, and its number of interfaces."""
    _, bus_id, bus, number, speed, vendor, product, *_, interfaces = _DEVICE.unpack_from(buffer, at)
    name = bus_id.partition(b"\0")[0].decode("ascii", "replace")
    if max(bus, number) > _MOST_NUMBER:  # they share 32 bits in commands
        raise ValueError(f"a device with bus {bus} and number {number}; both go to {_MOST_NUMBER}")
    return Offer(name, bus, number, speed, vendor, product), interfaces
