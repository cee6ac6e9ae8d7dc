"""The raw USB line, by pyusb: any packet to any endpoint, any control request, in either mode of the device."""

from __future__ import annotations

import errno
from collections.abc import Collection
from contextlib import suppress
from typing import Any

import usb.core
import usb.util

from ....base.errors import DeviceError, DeviceLostError, DeviceStalledError
from ....host.transports.transport import Timekeeper
from ....host.transports.usb_find import (
    ANY_MODE,
    DFU_MODE,
    RUN_TIME,
    DeviceMode,
    Sighting,
    UsbFinder,
    configure,
    translated,
)
from ....protocol.codes import BLOCK_BYTES, StandardRequest
from ....protocol.enumeration import ENDPOINT_IN, ENDPOINT_OUT
from ....protocol.requests import DIRECTION_IN, Setup
from ..cases import Inconclusive, LineKind
from .watch import ClockWatch

__all__ = ["CONSOLE_IN", "CONSOLE_OUT", "REQUEST_SECONDS", "RawUsbLine"]

REQUEST_SECONDS = 10.0
"""A device answers at once; the rest is margin for a busy computer."""
READ_BYTES = 32 * BLOCK_BYTES
CONSOLE_OUT, CONSOLE_IN = 0x03, 0x83
"""Clause USB-005."""
CONFIGURATION = 1
NOT_LET_THROUGH = (errno.ENOENT, errno.EINVAL, errno.EIO)
"""The text of libusb for a request to an endpoint that no configuration has: Linux does not send it."""
RECIPIENT, ENDPOINT = 0x1F, 0x02
"""Bits in the type of a request (USB 2.0, table 9-2)."""


class RawUsbLine:
    """A device on a USB bus, which may leave the bus and come back in either mode.

    Parameters
    ----------
    url : str
        As `UsbFinder` reads it.

    Attributes
    ----------
    device : usb.core.Device
        The present pyusb device.
    from_kernel : set of int
        The interfaces that a kernel driver held, and holds again after a restart.
    watch : ClockWatch

    Raises
    ------
    DeviceError
        If there is none, or it may not be opened.
    """

    kind: LineKind = "usb"

    def __init__(self, url: str) -> None:
        self._bus = UsbFinder(url)
        self.from_kernel: set[int] = set()
        self.watch = ClockWatch()
        self.device: Any = None
        try:
            self._take(self._bus.find(ANY_MODE))
        except BaseException:
            self.close()
            raise
        if self.mode == DFU_MODE:
            raise DeviceError(
                f"{self.name} waits for new firmware; reset it, or flash it, so that it comes back in run-time mode"
            )

    def _take(self, seen: Sighting, *, configured: bool = True) -> None:
        self._seen = seen
        self.watch.restarted()
        self.device = seen.device
        self.time: Timekeeper = seen.time
        self.name = seen.name
        if not configured:
            return
        with translated(f"opening {self.name}"):
            configure(self.device)
            if seen.mode == RUN_TIME:
                self._claim()

    def _claim(self) -> None:
        """Claim all interfaces; those of the console are taken from the kernel, which gets them back in `close`."""
        for interface in self.device.get_active_configuration():
            number = interface.bInterfaceNumber
            with suppress(usb.core.USBError, NotImplementedError):
                if self.device.is_kernel_driver_active(number):
                    self.device.detach_kernel_driver(number)
                    self.from_kernel.add(number)
            usb.util.claim_interface(self.device, number)

    @property
    def mode(self) -> DeviceMode:
        """Whether the device plays or waits for firmware, as last seen."""
        return self._seen.mode

    @property
    def serial(self) -> str:
        """Its serial number."""
        return self._seen.serial or ""

    @property
    def bulk_bytes(self) -> int:
        """The largest packet of its bulk endpoints, as its descriptors say."""
        return next(
            int(endpoint.wMaxPacketSize)
            for interface in self.device.get_active_configuration()
            for endpoint in interface
            if endpoint.bEndpointAddress == ENDPOINT_OUT
        )

    # Methods of any line

    def send_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks to 01 OUT in one transfer; returns how many bytes were taken in time."""
        return self.write(ENDPOINT_OUT, blocks, seconds)

    def receive_records(self, seconds: float) -> bytes:
        """Wait for a transfer of records from 81 IN."""
        found = self.read(ENDPOINT_IN, READ_BYTES, seconds) or b""
        self.watch.came(self, found)
        return found

    def request(self, setup: Setup, data: bytes = b"") -> bytes | None:
        """Make a control request; returns the answer, or None for STALL."""
        what = setup.length if setup.is_in else data or None
        told = self.watch.told
        with translated(setup.name):
            try:
                answer = self.device.ctrl_transfer(
                    setup.request_type, setup.request, setup.value, setup.index, what, round(1000 * REQUEST_SECONDS)
                )
            except usb.core.USBError as error:
                if error.errno == errno.EPIPE:
                    return None
                to_endpoint = setup.request_type & RECIPIENT == ENDPOINT
                if to_endpoint and error.errno in NOT_LET_THROUGH and self.is_there:
                    raise Inconclusive("this computer's system does not send such a request") from error
                raise
        got = bytes(answer) if setup.is_in else b""
        self.watch.answered(setup, got, told)
        return got

    @property
    def is_there(self) -> bool:
        """Whether the device still answers GET_STATUS."""
        try:
            self.device.ctrl_transfer(DIRECTION_IN, StandardRequest.GET_STATUS, 0, 0, 2, round(1000 * REQUEST_SECONDS))
        except usb.core.USBError:
            return False
        return True

    def reopen(self, seconds: float, modes: Collection[DeviceMode] = (RUN_TIME,), *, configured: bool = True) -> None:
        """Find the device again in one of some modes, and configure it unless told otherwise."""
        usb.util.dispose_resources(self.device)
        end = self.time.monotonic() + seconds
        while True:
            seen = self._bus.find_again(self._seen, modes, max(end - self.time.monotonic(), 0))
            try:
                self._take(seen, configured=configured)
            except (DeviceLostError, DeviceStalledError):  # it left again
                if self.time.monotonic() >= end:
                    raise
                self.time.sleep(0.05)
            else:
                return

    def close(self) -> None:
        """Release the device, and return to the kernel the interfaces that it held."""
        if self.device is None:
            return
        usb.util.dispose_resources(self.device)
        for number in self.from_kernel:
            with suppress(usb.core.USBError, NotImplementedError):
                self.device.attach_kernel_driver(number)
        usb.util.dispose_resources(self.device)
        self._bus.close()

    # Methods of USB alone

    def write(self, endpoint: int, data: bytes, seconds: float) -> int:
        """Send bytes to an endpoint in one transfer, or an empty packet; returns how many were taken in time.

        Raises `DeviceStalledError` if the endpoint is halted.
        """
        with translated(f"sending to endpoint {endpoint:02X}"):
            try:
                return int(self.device.write(endpoint, data, _milliseconds(seconds)))
            except usb.core.USBTimeoutError:
                return 0

    def read(self, endpoint: int, size: int, seconds: float) -> bytes | None:
        """Receive one transfer of at most so many bytes, which ends with a short packet; None if none came.

        Raises `DeviceStalledError` if the endpoint is halted.
        """
        with translated(f"receiving from endpoint {endpoint:02X}"):
            try:
                return bytes(self.device.read(endpoint, size, _milliseconds(seconds)))
            except usb.core.USBTimeoutError:
                return None

    def clear_halt(self, endpoint: int) -> None:
        """End the halt of an endpoint."""
        with translated(f"ending the halt of endpoint {endpoint:02X}"):
            self.device.clear_halt(endpoint)

    def set_configuration(self) -> None:
        """Configure the device again."""
        with translated("configuring the device"):
            usb.util.dispose_resources(self.device)
            self.device.set_configuration(CONFIGURATION)
            self._claim()

    def set_interface(self, interface: int) -> None:
        """Select setting 0 of an interface, as a kernel does."""
        with translated(f"selecting setting 0 of interface {interface}"):
            usb.util.claim_interface(self.device, interface)
            self.device.set_interface_altsetting(interface, 0)

    @property
    def is_configured(self) -> bool:
        """Whether the device is configured, as far as the computer knows."""
        try:
            self.device.get_active_configuration()
        except usb.core.USBError:
            return False
        return True

    def reset(self, *, configured: bool = True) -> None:
        """Reset the bus; a configured device is configured again, and found again if it came back as another."""
        with translated("resetting the bus"):
            try:
                self.device.reset()
            except usb.core.USBError as error:
                if error.errno not in (errno.ENOENT, errno.ENODEV):
                    raise
                self.reopen(10, ANY_MODE, configured=configured)
            else:
                if self.mode == RUN_TIME and self.is_configured:
                    self._claim()  # pyusb has let go of all of them

    def wait_for(self, mode: DeviceMode, seconds: float, *, configured: bool = True) -> None:
        """Wait until the device is back on the bus in a mode, and configure it unless told otherwise."""
        self.reopen(seconds, (mode,), configured=configured)


def _milliseconds(seconds: float) -> int:
    return max(1, round(1000 * seconds))
