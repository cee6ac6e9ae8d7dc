"""The structures and numbers of <linux/usbdevice_fs.h>, on a little-endian machine of 64 bits."""

from __future__ import annotations

from ctypes import Structure, c_char, c_int32, c_uint8, c_uint16, c_uint32, c_uint64, sizeof
from enum import IntEnum, IntFlag

__all__ = [
    "BulkTransfer",
    "Capability",
    "ConnectInfo",
    "ControlTransfer",
    "DisconnectClaim",
    "DriverIoctl",
    "GetDriver",
    "Ioctl",
    "SetInterface",
    "UrbFields",
    "UrbFlag",
    "UrbType",
]


class ControlTransfer(Structure):
    """struct usbdevfs_ctrltransfer."""

    _fields_ = (
        ("bRequestType", c_uint8),
        ("bRequest", c_uint8),
        ("wValue", c_uint16),
        ("wIndex", c_uint16),
        ("wLength", c_uint16),
        ("timeout", c_uint32),
        ("data", c_uint64),
    )


class BulkTransfer(Structure):
    """struct usbdevfs_bulktransfer."""

    _fields_ = (("ep", c_uint32), ("len", c_uint32), ("timeout", c_uint32), ("data", c_uint64))


class SetInterface(Structure):
    """struct usbdevfs_setinterface."""

    _fields_ = (("interface", c_uint32), ("altsetting", c_uint32))


class GetDriver(Structure):
    """struct usbdevfs_getdriver."""

    _fields_ = (("interface", c_uint32), ("driver", c_char * 256))


class ConnectInfo(Structure):
    """struct usbdevfs_connectinfo."""

    _fields_ = (("devnum", c_uint32), ("slow", c_uint8))


class DriverIoctl(Structure):
    """struct usbdevfs_ioctl."""

    _fields_ = (("ifno", c_int32), ("ioctl_code", c_int32), ("data", c_uint64))


class DisconnectClaim(Structure):
    """struct usbdevfs_disconnect_claim."""

    _fields_ = (("interface", c_uint32), ("flags", c_uint32), ("driver", c_char * 256))


class UrbFields(Structure):
    """struct usbdevfs_urb."""

    _fields_ = (
        ("type", c_uint8),
        ("endpoint", c_uint8),
        ("status", c_int32),
        ("flags", c_uint32),
        ("buffer", c_uint64),
        ("buffer_length", c_int32),
        ("actual_length", c_int32),
        ("start_frame", c_int32),
        ("number_of_packets", c_int32),
        ("error_count", c_int32),
        ("signr", c_uint32),
        ("usercontext", c_uint64),
    )


def _number(direction: int, number: int, argument: type[Structure] | type[c_uint32] | type[c_uint64] | None) -> int:
    """The number of an ioctl of type 'U' (<asm-generic/ioctl.h>)."""
    size = sizeof(argument) if argument else 0
    return direction << 30 | size << 16 | ord("U") << 8 | number


_NONE, _WRITE, _READ = 0, 1, 2


class Ioctl(IntEnum):
    """The supported ioctls (<linux/usbdevice_fs.h>, in which each name begins with USBDEVFS_)."""

    CONTROL = _number(_READ | _WRITE, 0, ControlTransfer)
    BULK = _number(_READ | _WRITE, 2, BulkTransfer)
    RESETEP = _number(_READ, 3, c_uint32)
    SETINTERFACE = _number(_READ, 4, SetInterface)
    SETCONFIGURATION = _number(_READ, 5, c_uint32)
    GETDRIVER = _number(_WRITE, 8, GetDriver)
    SUBMITURB = _number(_READ, 10, UrbFields)
    DISCARDURB = _number(_NONE, 11, None)
    REAPURB = _number(_WRITE, 12, c_uint64)
    REAPURBNDELAY = _number(_WRITE, 13, c_uint64)
    CLAIMINTERFACE = _number(_READ, 15, c_uint32)
    RELEASEINTERFACE = _number(_READ, 16, c_uint32)
    CONNECTINFO = _number(_WRITE, 17, ConnectInfo)
    IOCTL = _number(_READ | _WRITE, 18, DriverIoctl)
    RESET = _number(_NONE, 20, None)
    CLEAR_HALT = _number(_READ, 21, c_uint32)
    DISCONNECT = _number(_NONE, 22, None)
    CONNECT = _number(_NONE, 23, None)
    GET_CAPABILITIES = _number(_READ, 26, c_uint32)
    DISCONNECT_CLAIM = _number(_READ, 27, DisconnectClaim)
    GET_SPEED = _number(_NONE, 31, None)


class Capability(IntFlag):
    """Bits of the answer to GET_CAPABILITIES (USBDEVFS_CAP_...)."""

    ZERO_PACKET = 0x01
    NO_PACKET_SIZE_LIM = 0x04
    REAP_AFTER_DISCONNECT = 0x10


class UrbType(IntEnum):
    """Types of transfers (USBDEVFS_URB_TYPE_...)."""

    ISO = 0
    INTERRUPT = 1
    CONTROL = 2
    BULK = 3


class UrbFlag(IntFlag):
    """Supported flags of a transfer (USBDEVFS_URB_...)."""

    SHORT_NOT_OK = 0x01
    ZERO_PACKET = 0x40
