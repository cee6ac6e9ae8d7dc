"""The USB line, by pyusb. Which bus it looks on, a real one or an emulated one, is the URL's scheme (`usb_find`)."""

from __future__ import annotations

from array import array
from contextlib import suppress

import usb.core
import usb.util

from ...base.errors import DeviceLostError, DeviceStalledError
from ...protocol.board import CORE_HZ
from ...protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Request
from ...protocol.enumeration import ARRAY_INTERFACE, ENDPOINT_IN, ENDPOINT_OUT, FULL_SPEED
from ...protocol.timing import FULL_SPEED_PACKET_CYCLES, PACKET_CYCLES
from .flight import Flight
from .transport import Found
from .usb_find import REQUEST_MS, RUN_TIME, Sighting, UsbFinder, configure, find_on, is_timeout, translated, translation

__all__ = ["USB", "UsbTransport", "open_usb"]

READ_BYTES = 32 * BLOCK_BYTES
WINDOWS = 8
"""How many times as many blocks may be unanswered as the device can acknowledge, if records are read as they come."""
LEFT_OVER_SECONDS = 0.001
MOST_LEFT_OVER = 64
"""Reads of records that wait from an earlier session; a device holds at most some thousands."""
REST_SECONDS = 0.02
"""For the rest of a block that has begun; the device gets no sign of life meanwhile."""
LOOK_SECONDS = 0.05
"""After a device has left once more, until it is looked for again."""


def open_usb(url: str) -> UsbTransport:
    """Open the device in run-time mode that a URL names, as `UsbFinder` reads it.

    Raises
    ------
    DeviceNotFoundError
        If there is none, or several and no serial number to choose by.
    DeviceError
        If it cannot be used.
    """
    bus = UsbFinder(url)
    return UsbTransport(bus, bus.find((RUN_TIME,)))


class UsbTransport:
    """A line to a device over pyusb.

    Parameters
    ----------
    bus : UsbFinder
        The bus where it is.
    seen : Sighting
        What was found there, perhaps not yet configured.

    Notes
    -----
    Bulk transfers call pyusb's backend directly: `usb.core.Device` looks the endpoint up again for each of them, which
    takes as long as all that the host does for a block besides. pyusb has no public name for the backend's handle.
    """

    lossy = False

    def __init__(self, bus: UsbFinder, seen: Sighting) -> None:
        self.serial = seen.serial or ""
        self.time = seen.time
        self.name = seen.name
        self._bus = bus
        self._flight: Flight | None = None
        self._records = array("B", bytes(READ_BYTES))
        self._begin(seen)

    @property
    def most_blocks_per_second(self) -> float:
        """As the speed of the bus allows (clauses USB-010 and BUD-004)."""
        cycles = PACKET_CYCLES
        if self._device.speed != usb.util.SPEED_HIGH:
            cycles = BLOCK_BYTES // FULL_SPEED.bulk_bytes * FULL_SPEED_PACKET_CYCLES
        return CORE_HZ / cycles

    def _begin(self, seen: Sighting) -> None:
        """Make a device ours, without what whoever used it before left behind, and without touching what it plays."""
        self._seen, self._device = seen, seen.device
        device = self._device
        with translated(f"opening device {self.serial}"):
            try:
                configure(device)
                usb.util.claim_interface(device, ARRAY_INTERFACE)
                self._bus_calls, self._handle = device.backend, device._ctx.managed_open()
                for endpoint in (ENDPOINT_OUT, ENDPOINT_IN):
                    device.clear_halt(endpoint)  # and forget a part of a block (clause USB-015)
                if hasattr(device.backend, "open_flight"):
                    self._flight = device.backend.open_flight(self._handle)
                for _ in range(MOST_LEFT_OVER):
                    if not self.read_records(LEFT_OVER_SECONDS):
                        break
            except BaseException:
                self.close()
                raise

    @property
    def posts(self) -> bool:
        """Whether libusb carries blocks while this program does other things."""
        return self._flight is not None

    def window(self, free: int | None, records: int) -> int:  # NAK, not credit, holds the rest back
        """As many as the device can acknowledge (clause ACK-007); some times as many if they are read at once."""
        return records if self._flight is None else WINDOWS * records

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks in one transfer."""
        try:
            if self._flight is not None:
                return len(blocks) if self._flight.write(blocks, seconds) else 0
            sent = self._write(blocks, seconds)
            if part := sent % BLOCK_BYTES:  # at full speed; a block that has begun is finished, or forgotten (USB-017)
                rest = blocks[sent : sent + BLOCK_BYTES - part]
                if self._write(rest, REST_SECONDS) == len(rest):
                    return sent + len(rest)
                self._device.clear_halt(ENDPOINT_OUT)
                return sent - part
        except usb.core.USBError as error:
            raise translation("sending blocks", error) from error
        return sent

    def _write(self, data: bytes, seconds: float) -> int:
        octets = array("B", data)
        try:
            taken: int = self._bus_calls.bulk_write(
                self._handle, ENDPOINT_OUT, ARRAY_INTERFACE, octets, _milliseconds(seconds)
            )
        except usb.core.USBError as error:
            if not is_timeout(error):
                raise
            return 0
        return taken

    def read_records(self, seconds: float) -> bytes:
        """Wait for packets of acknowledgements and statuses."""
        try:
            if self._flight is not None:
                return self._flight.read(seconds)
            came = self._bus_calls.bulk_read(
                self._handle, ENDPOINT_IN, ARRAY_INTERFACE, self._records, _milliseconds(seconds)
            )
        except usb.core.USBError as error:
            if not is_timeout(error):
                raise translation("waiting for an acknowledgement", error) from error
            return b""
        return self._records[:came].tobytes()

    def take_back(self) -> int:
        """Cancel the transfers that are on their way to the device."""
        if self._flight is None:
            return 0
        with translated("taking blocks back"):
            left = self._flight.take_back()
            if part := -left % BLOCK_BYTES:  # of a block, at full speed; the device forgets it (clause USB-017)
                self._device.clear_halt(ENDPOINT_OUT)
            return left + part

    def query(self, request: Request, size: int) -> bytes:
        """Make a control request with an answer."""
        with translated(f"asking for {request.name}"):
            return bytes(self._device.ctrl_transfer(REQUEST_TYPE_IN, request, 0, ARRAY_INTERFACE, size, REQUEST_MS))

    def command(self, request: Request, value: int = 0) -> None:
        """Make a control request without an answer."""
        with translated(f"ordering {request.name}"):
            self._device.ctrl_transfer(REQUEST_TYPE_OUT, request, value, ARRAY_INTERFACE, None, REQUEST_MS)

    def reopen(self, seconds: float) -> None:
        """Look for the same serial number on the bus until it is there."""
        self.close()
        end = self.time.monotonic() + seconds
        while True:
            seen = self._bus.find_again(self._seen, (RUN_TIME,), max(end - self.time.monotonic(), 0))
            try:
                self._begin(seen)
            except (DeviceLostError, DeviceStalledError):  # it left once more
                if self.time.monotonic() >= end:
                    raise
                self.time.sleep(LOOK_SECONDS)
            else:
                return

    def close(self) -> None:
        """Release the interface and the device."""
        flight, self._flight = self._flight, None
        if flight is not None:
            with suppress(usb.core.USBError):
                flight.close()
        usb.util.dispose_resources(self._device)
        self._bus.close()


def _milliseconds(seconds: float) -> int:
    return max(1, round(seconds * 1000))  # 0 would be for ever


class UsbScheme:
    """The devices on the real bus."""

    def open(self, url: str) -> UsbTransport:
        """Open the device that a URL names."""
        return open_usb(url)

    def find(self) -> list[Found]:
        """The devices on the bus."""
        return find_on("usb")


USB = UsbScheme()
