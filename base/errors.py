"""Everything that phasewire raises on purpose, besides ``ValueError`` for a wrong argument.

::

    PhasewireError
    ├── InputFileError        a file is not what it should be       "points.csv, line 3: …"
    ├── BlockError            bytes that are no valid block         a flipped bit, a wrong length
    ├── ReplyError            bytes that are no valid answer        an acknowledgement with a wrong checksum
    ├── FrameError            bytes that are no valid frame         a serial line that lost a byte
    ├── CommandError          a line that is no console command     "limit 400"
    ├── ChainError            bytes that are no valid message       a slice that ends too early
    ├── ImageError            bytes that are no valid firmware      a flipped bit, a signature that is wrong
    ├── MissingExtraError     an optional package is missing        a signing key without cryptography
    ├── BenchError            what is around a device under test    a relay's program that ends with an error
    ├── ClusterError          a cluster cannot run a sweep          other versions than here, its workers are gone
    │   └── ClusterNotFoundError  nothing answers to its address    a wrong port, no workers
    ├── TrackerError          a source of hands went wrong          frames that are no hands
    │   ├── TrackerNotFoundError  nothing answers to this URL       no such scheme, no tracker running
    │   └── TrackerLostError      it went away                      a recording that ended
    └── DeviceError           anything between a URL and the boards
        ├── DeviceNotFoundError   nothing answers to this URL       no such scheme, nothing plugged in
        │   └── DeviceUrlError        the URL says what cannot be   a baud rate that is no number
        ├── DeviceAccessError     it is there, but not for us       no permission, open elsewhere
        ├── DeviceVersionError    no version of the protocol fits   firmware that is too new
        ├── DeviceRefusedError    it said no, and why               a block refused with a reason code
        ├── DeviceStalledError    it said no, without a reason      ENABLE while a fault is not cleared
        ├── DeviceTimeoutError    it did not answer in time         a stuck endpoint
        └── DeviceLostError       it went away                      unplugged in mid-stream

``InputFileError``, ``BlockError``, ``ReplyError``, ``FrameError``, ``CommandError``, ``ChainError`` and ``ImageError``
are also ``ValueError``, because they concern a value.
`visible` shows any text safely. This module stands below every other one and may import none of them.
"""

from __future__ import annotations

import re

__all__ = [
    "BenchError",
    "BlockError",
    "ChainError",
    "ClusterError",
    "ClusterNotFoundError",
    "CommandError",
    "DeviceAccessError",
    "DeviceError",
    "DeviceLostError",
    "DeviceNotFoundError",
    "DeviceRefusedError",
    "DeviceStalledError",
    "DeviceTimeoutError",
    "DeviceUrlError",
    "DeviceVersionError",
    "FrameError",
    "ImageError",
    "InputFileError",
    "MissingExtraError",
    "PhasewireError",
    "ReplyError",
    "TrackerError",
    "TrackerLostError",
    "TrackerNotFoundError",
    "visible",
]

_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]")


def visible(text: str) -> str:
    """A text for a terminal: what would steer it, or turn the direction of writing, as an escape sequence of Python.

    Texts of peers and files may contain anything. Tabs and ends of lines stay.
    """
    return _UNSEEN.sub(lambda match: ascii(match[0])[1:-1], text)


class PhasewireError(Exception):
    """Root of every error that phasewire raises on purpose."""


class InputFileError(PhasewireError, ValueError):
    """A file could not be used: truncated, corrupted, or not of the expected kind."""


class _Refusal(PhasewireError):
    """Something was refused with a reason code.

    Attributes
    ----------
    reason : int
        The code of the specification: a ``phasewire.protocol.Reason`` for a block, a ``ConsoleCode`` for a command, an
        ``ImageReason`` for a firmware image.
    """

    def __init__(self, message: str, reason: int) -> None:
        super().__init__(message)
        self.reason = reason


class BlockError(_Refusal, ValueError):
    """Bytes that are no valid block; `reason` says why."""


class ReplyError(PhasewireError, ValueError):
    """Bytes that are no valid answer of a device."""


class FrameError(PhasewireError, ValueError):
    """Bytes on a serial line that are no valid frame."""


class CommandError(_Refusal, ValueError):
    """A line that is no valid command of the console; `reason` says why."""


class ImageError(_Refusal, ValueError):
    """Bytes that are no valid firmware image; `reason` says why."""


class ChainError(PhasewireError, ValueError):
    """Bytes that are no valid message between the controller and its processors.

    Attributes
    ----------
    clause : str
        The clause of the specification that is broken.
    """

    def __init__(self, message: str, clause: str) -> None:
        super().__init__(message)
        self.clause = clause


class MissingExtraError(PhasewireError):
    """An optional package is not installed; the message names the extra of phasewire that brings it."""


class BenchError(PhasewireError):
    """What is around a device under test failed: a lever that moves its power or its cable."""


class ClusterError(PhasewireError):
    """A cluster of Dask cannot run a sweep."""


class ClusterNotFoundError(ClusterError):
    """No scheduler answers at the address, or it has no workers."""


class DeviceError(PhasewireError):
    """Something between a device's URL and its boards went wrong.

    Attributes
    ----------
    device : str or None
        The device, one of several, if its name is in the message.
    """

    device: str | None = None


class DeviceNotFoundError(DeviceError):
    """No device answers to this URL."""


class DeviceUrlError(DeviceNotFoundError):
    """The URL has an option or a value that its scheme does not have."""


class DeviceAccessError(DeviceError):
    """The device is there, but this process may not use it."""


class DeviceVersionError(DeviceError):
    """Host and device have no version of the protocol in common."""


class DeviceRefusedError(_Refusal, DeviceError):
    """The device understood and said no; `reason` says why."""


class DeviceStalledError(DeviceError):
    """The device answered STALL: it does not know the request, or not in this state, or its endpoint is halted."""


class DeviceTimeoutError(DeviceError):
    """The device did not answer in time."""


class DeviceLostError(DeviceError):
    """The device went away while it was in use."""


class TrackerError(PhasewireError):
    """A source of hands went wrong."""


class TrackerNotFoundError(TrackerError):
    """No source of hands answers to this URL."""


class TrackerLostError(TrackerError):
    """The source of hands went away while it was in use."""
