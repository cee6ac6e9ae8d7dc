"""Bulk transfers that a bus carries by itself, several at a time.

A stream must not wait for the way there and back: while the device takes one transfer, the next must be there already.
pyusb knows only calls that wait for their transfer. A second thread that makes such calls would not do, for nothing
says which of two calls comes first. Another binding (python-libusb1) would have to open the device for itself, and a
kernel lets one handle claim an interface. So libusb's own asynchronous functions are called here, some by ctypes, on
the handle that pyusb has opened; libusb's structure of a transfer is part of its stable interface. Another bus derives
from `Flight` (`usbip`).

No Python runs within libusb, where an exception such as Ctrl-C would be lost: at the end of a transfer libusb calls a
harmless function of its own, and the end is seen by the transfer's status.
"""

from __future__ import annotations

import ctypes
import errno
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable
from ctypes import c_int, c_long, c_ubyte, c_uint, c_void_p
from typing import Any, Protocol

from usb.core import USBError

from ...protocol.codes import BLOCK_BYTES
from ...protocol.enumeration import ENDPOINT_IN, ENDPOINT_OUT

__all__ = ["MOST_OUT", "Flight", "FlightTransfer", "LibusbFlight"]

MOST_OUT, MOST_IN = 8, 4
"""Transfers that are on their way at a time."""
READ_BYTES = 4 * BLOCK_BYTES
END_SECONDS = 1.0
"""For transfers that were cancelled to end."""

BULK = 2
COMPLETED, CANCELLED = 0, 3
PENDING = -1
"""No status of libusb's."""
INTERRUPTED = -10
ERRNOS = {1: errno.EIO, 2: errno.ETIMEDOUT, 4: errno.EPIPE, 5: errno.ENODEV, 6: errno.EOVERFLOW}
"""Of the statuses of a transfer, as libusb's functions that wait have it."""
CALL_ERRNOS = {-1: errno.EIO, -3: errno.EACCES, -4: errno.ENODEV, -5: errno.ENOENT, -6: errno.EBUSY, -11: errno.ENOMEM}


class _Raw(ctypes.Structure):
    """libusb_transfer, without its isochronous packets."""

    _fields_ = (
        ("dev_handle", c_void_p),
        ("flags", c_ubyte),
        ("endpoint", c_ubyte),
        ("type", c_ubyte),
        ("timeout", c_uint),
        ("status", c_int),
        ("length", c_int),
        ("actual_length", c_int),
        ("callback", c_void_p),
        ("user_data", c_void_p),
        ("buffer", c_void_p),
        ("num_iso_packets", c_int),
    )


class _TimeValue(ctypes.Structure):
    _fields_ = (("seconds", c_long), ("microseconds", c_long))


class _Library:
    """The functions of libusb that are needed."""

    def __init__(self, path: str) -> None:
        library = ctypes.CDLL(path)  # the one that pyusb has loaded
        self.alloc, self.free = library.libusb_alloc_transfer, library.libusb_free_transfer
        self.submit, self.cancel = library.libusb_submit_transfer, library.libusb_cancel_transfer
        self.handle_events = library.libusb_handle_events_timeout_completed
        self.alloc.argtypes, self.alloc.restype = (c_int,), ctypes.POINTER(_Raw)
        for call in (self.free, self.submit, self.cancel):
            call.argtypes = (ctypes.POINTER(_Raw),)
        self.handle_events.argtypes = (c_void_p, ctypes.POINTER(_TimeValue), c_void_p)
        self.does_nothing = ctypes.cast(library.libusb_error_name, c_void_p)


class _Transfer:
    """One transfer; its buffer lives as long as it."""

    def __init__(self, library: _Library, handle: Any, endpoint: int, buffer: Any, length: int) -> None:
        self._library, self._buffer = library, buffer
        self.raw = library.alloc(0)
        if not self.raw:
            raise USBError("no memory for a transfer", None, errno.ENOMEM)
        fields = self.raw.contents
        fields.dev_handle, fields.endpoint, fields.type = handle, endpoint, BULK
        fields.buffer, fields.length = ctypes.cast(buffer, c_void_p), length
        fields.callback = library.does_nothing
        self.fields = fields

    def submit(self) -> None:
        self.fields.status = PENDING
        if code := self._library.submit(self.raw):
            self.fields.status = CANCELLED
            raise USBError("a transfer cannot be submitted", code, CALL_ERRNOS.get(code))

    def cancel(self) -> None:
        self._library.cancel(self.raw)

    @property
    def left(self) -> int:
        return int(self.fields.length - self.fields.actual_length)

    @property
    def received(self) -> bytes:
        return bytes(memoryview(self._buffer)[: self.fields.actual_length])

    @property
    def ended(self) -> bool:
        return bool(self.fields.status != PENDING)

    def check(self) -> None:
        """Raise `USBError` if it did not end well."""
        status = self.fields.status
        if status != COMPLETED:
            raise USBError("a transfer failed", status, ERRNOS.get(status, errno.EIO))

    def free(self) -> None:
        """Forget it; one that has not ended still belongs to libusb."""
        if self.ended:
            self._library.free(self.raw)


class FlightTransfer(Protocol):
    """One transfer of a flight."""

    @property
    def ended(self) -> bool:
        """Whether it has ended, well or not."""

    @property
    def received(self) -> bytes:
        """Its data, if it goes to the host."""

    @property
    def left(self) -> int:
        """How many of its bytes were not carried."""

    def submit(self) -> None:
        """Begin it, also again after its end."""

    def cancel(self) -> None:
        """Have it end soon."""

    def check(self) -> None:
        """Raise `USBError` if it did not end well."""

    def free(self) -> None:
        """Forget it; one that has not ended still belongs to the bus."""


class Flight(ABC):
    """The bulk transfers of one device.

    Its methods raise pyusb's `USBError` if a transfer has failed, perhaps one that was begun earlier.
    """

    def __init__(self) -> None:
        self._outs, self._ins = deque[FlightTransfer](), deque[FlightTransfer]()
        self._records = bytearray()

    @abstractmethod
    def _make(self, endpoint: int, data: bytes | None) -> FlightTransfer:
        """A transfer of data, or one for `READ_BYTES`."""

    @abstractmethod
    def _wait(self, seconds: float) -> None:
        """Wait at most so long for some transfer to end."""

    def write(self, data: bytes, seconds: float) -> bool:
        """Begin a transfer, once there are fewer than `MOST_OUT`; whether that came in time."""
        self._look(0)
        end = time.monotonic() + seconds
        while len(self._outs) == MOST_OUT:
            left = end - time.monotonic()
            if left < 0:
                return False
            self._look(left)
        transfer = self._make(ENDPOINT_OUT, data)
        try:
            transfer.submit()
        except BaseException:
            transfer.free()
            raise
        self._outs.append(transfer)
        return True

    def read(self, seconds: float) -> bytes:
        """What has come, or what comes next in time."""
        self._look(0)
        end = time.monotonic() + seconds
        while not self._records and (left := end - time.monotonic()) > 0:
            self._look(left)
        records = bytes(self._records)
        self._records.clear()
        return records

    def take_back(self) -> int:
        """Cancel what is on its way to the device; how many of its bytes the device did not take."""
        outs = list(self._outs)
        self._cancel(reversed(outs))  # so that the device does not go on with the next
        self._outs.clear()
        left = sum(each.left for each in outs)
        for each in outs:
            each.free()
        return left

    def close(self) -> None:
        """Cancel everything; the handle can be closed then."""
        both = [*self._outs, *self._ins]
        self._outs.clear()
        self._ins.clear()
        self._cancel(reversed(both))
        for each in both:
            each.free()

    def _look(self, seconds: float) -> None:
        """Wait so long for a transfer to end, and see which have."""
        while len(self._ins) < MOST_IN:
            transfer = self._make(ENDPOINT_IN, None)
            transfer.submit()
            self._ins.append(transfer)
        self._wait(seconds)
        while self._ins and self._ins[0].ended:
            transfer = self._ins.popleft()
            try:
                transfer.check()
                self._records += transfer.received
                transfer.submit()
                self._ins.append(transfer)
            except BaseException:
                transfer.free()
                raise
        while self._outs and self._outs[0].ended:
            transfer = self._outs.popleft()
            try:
                transfer.check()
            finally:
                transfer.free()

    def _cancel(self, transfers: Iterable[FlightTransfer]) -> None:
        pending = [each for each in transfers if not each.ended]
        for each in pending:
            each.cancel()
        end = time.monotonic() + END_SECONDS
        while not all(each.ended for each in pending) and time.monotonic() < end:
            self._wait(END_SECONDS / 10)


class LibusbFlight(Flight):
    """The bulk transfers of one device, by libusb.

    Parameters
    ----------
    path : str
        The path of libusb, as pyusb has loaded it.
    context : pointer
        The context of libusb.
    handle : pointer
        The handle of the device, opened, with its interface claimed.
    """

    def __init__(self, path: str, context: Any, handle: Any) -> None:
        super().__init__()
        self._library, self._context, self._handle = _Library(path), context, handle

    def _make(self, endpoint: int, data: bytes | None) -> FlightTransfer:
        if data is None:
            return _Transfer(self._library, self._handle, endpoint, (c_ubyte * READ_BYTES)(), READ_BYTES)
        return _Transfer(self._library, self._handle, endpoint, ctypes.c_char_p(data), len(data))

    def _wait(self, seconds: float) -> None:
        whole, part = divmod(max(seconds, 0.0), 1)
        code = self._library.handle_events(self._context, ctypes.byref(_TimeValue(int(whole), int(part * 1e6))), None)
        if code not in (0, INTERRUPTED):
            raise USBError("libusb cannot wait for a transfer", code, CALL_ERRNOS.get(code))
