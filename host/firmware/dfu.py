"""DFU 1.1 as a host speaks it: to DFU mode, an image down or up, and a bus reset to boot (SPEC.md, chapter DFU).

Here is how one thing is asked of a device; what is to be done with an image, and what to do when the line fails, is
`flashing`'s business. Waits go through the time by which the device lives.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from contextlib import suppress
from types import TracebackType
from typing import Self

import usb.core
import usb.util

from ...base.errors import DeviceError, DeviceRefusedError, DeviceStalledError, DeviceTimeoutError
from ...protocol.codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    DFU_DETACH_TIMEOUT_MS,
    DFU_REASON_STRINGS,
    DFU_TRANSFER_BYTES,
    IMAGE_MAX_BYTES,
    DfuRequest,
    DfuState,
    DfuStatus,
    ImageReason,
)
from ...protocol.dfu import BUSY_LONGEST_MS, DfuReply
from ...protocol.enumeration import ARRAY_INTERFACE, DFU_INTERFACE
from ...protocol.requests import Setup
from ..transports.transport import understood
from ..transports.usb_find import Sighting, configure, control, opened, translated

__all__ = ["DfuLine", "detach"]

INTERFACE = 0
"""The only one in DFU mode."""
ROUNDS_TO_REST = 5
LONGEST_WORK_SECONDS = 2 * BUSY_LONGEST_MS / 1000
"""A device gives up after half of that, and may be asked a poll time-out later."""
GONE = (errno.ENOENT, errno.ENODEV, errno.EIO, errno.ESHUTDOWN)

_FLASH_FAILURES = {
    DfuStatus.WRITE: "it does not answer, or is write-protected",
    DfuStatus.ERASE: "a sector was not erased",
    DfuStatus.CHECK_ERASED: "a sector is not empty after it was erased",
    DfuStatus.PROG: "a page was not programmed",
    DfuStatus.VERIFY: "it holds something else than what was written",
}


def detach(seen: Sighting) -> None:
    """Have a device in run-time mode silence its outputs and leave the bus for DFU mode (clause DFU-002).

    Raises
    ------
    DeviceAccessError
        If another program uses it.
    DeviceStalledError
        If it has no firmware upgrade.
    DeviceError
        If line or device fail.
    """
    with opened(seen, f"asking {seen.name} to go to DFU mode") as device:
        usb.util.claim_interface(device, ARRAY_INTERFACE)  # whoever plays holds it, and is not to be cut off
        control(device, Setup(CLASS_REQUEST_TYPE_OUT, DfuRequest.DETACH, DFU_DETACH_TIMEOUT_MS, DFU_INTERFACE, 0))


class DfuLine:
    """The line to a device in DFU mode; as a context manager it is closed in the end.

    Parameters
    ----------
    seen : Sighting
        A device in DFU mode.

    Raises
    ------
    DeviceAccessError
        If another program gives it firmware.
    DeviceError
        If it cannot be opened.

    Notes
    -----
    Every method raises a `DeviceError` if line or device fail: `DeviceLostError`, `DeviceTimeoutError` or
    `DeviceStalledError` if it may help to begin anew, `DeviceRefusedError` if the device had a reason.
    """

    def __init__(self, seen: Sighting) -> None:
        self._device = seen.device
        self._name = seen.name
        self._time = seen.time
        with translated(f"opening {self._name} in DFU mode"):
            try:
                configure(self._device)
                usb.util.claim_interface(self._device, INTERFACE)
            except BaseException:
                usb.util.dispose_resources(self._device)
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        usb.util.dispose_resources(self._device)

    def status(self) -> DfuReply:
        """Ask for the state, which is a step in it, too (clauses DFU-006 and DFU-007)."""
        with understood(self._name):
            return DfuReply.decode(self._ask(DfuRequest.GETSTATUS, 0, DfuReply.BYTES))

    def make_idle(self) -> None:
        """Bring the device to DFU_IDLE, from whatever state somebody left it in."""
        for _ in range(ROUNDS_TO_REST):
            with suppress(DeviceStalledError):  # in a busy state, which the refusal has ended (clause DFU-006)
                state = self._rest().state
                if state is DfuState.DFU_IDLE:
                    return
                self._order(DfuRequest.CLRSTATUS if state is DfuState.ERROR else DfuRequest.ABORT)
        raise DeviceStalledError(f"{self._name} does not come to rest in DFU mode; switch it off and on")

    def download(self, stored: bytes, on_bytes: Callable[[int], None] = lambda _: None) -> None:
        """Send an image to a device in DFU_IDLE, and have it checked and its record written.

        Parameters
        ----------
        stored : bytes
            The image as it lies in flash, without a suffix.
        on_bytes : callable
            Told after each block how many bytes have been written.

        Raises
        ------
        DeviceRefusedError
            If the device refuses the image, with an `ImageReason`, or its flash fails, with a `DfuStatus`.
        """
        blocks = [stored[at : at + DFU_TRANSFER_BYTES] for at in range(0, len(stored), DFU_TRANSFER_BYTES)]
        written = 0
        for number, block in enumerate(blocks):
            self._send(number, block, DfuState.DNLOAD_IDLE)
            written += len(block)
            on_bytes(written)
        self._send(len(blocks), b"", DfuState.DFU_IDLE)

    def upload(self) -> Iterator[bytes]:
        """The image that would boot next, block by block, of a device in DFU_IDLE (clause DFU-014).

        Whoever needs the device in DFU_IDLE again makes it so.
        """
        for number in range(IMAGE_MAX_BYTES // DFU_TRANSFER_BYTES + 1):
            block = self._ask(DfuRequest.UPLOAD, number, DFU_TRANSFER_BYTES)
            yield block
            if len(block) < DFU_TRANSFER_BYTES:
                return
        raise DeviceError(f"{self._name} uploads more than the largest image has, {IMAGE_MAX_BYTES} bytes")

    def holds(self, stored: bytes, on_bytes: Callable[[int], None] = lambda _: None) -> bool:
        """Whether this image would boot next; the device is in DFU_IDLE before and after.

        Parameters
        ----------
        stored : bytes
            The image as it lies in flash.
        on_bytes : callable
            Told after each block how many bytes were found to be the same.
        """
        same, differs = 0, False
        for block in self.upload():
            if differs := block != stored[same : same + DFU_TRANSFER_BYTES]:
                break
            same += len(block)
            on_bytes(same)
        self.make_idle()  # a first block that is short ends nothing (clause DFU-006)
        return not differs

    def boot(self) -> None:
        """Reset the bus: the device leaves it and comes back with the image that boots next (clause DFU-015)."""
        with translated(f"restarting {self._name}"):
            try:
                self._device.reset()
            except usb.core.USBError as error:
                if error.errno not in GONE:  # it has left the bus, as it should
                    raise

    def _send(self, number: int, block: bytes, afterwards: DfuState) -> None:
        """Send a block, and wait until it is written."""
        try:
            self._order(DfuRequest.DNLOAD, number, block)
        except DeviceStalledError as error:
            raise self._failure(self.status()) from error
        reply = self._rest()
        if reply.state is DfuState.ERROR:
            raise self._failure(reply)
        if reply.state is not afterwards:
            raise DeviceStalledError(
                f"{self._name} is in the state {reply.state.name} after block {number}, not in {afterwards.name}; does "
                "another program speak to it?"
            )

    def _rest(self) -> DfuReply:
        """Ask until the device is not busy, as often as it allows (clause DFU-008)."""
        end = self._time.monotonic() + LONGEST_WORK_SECONDS
        while (reply := self.status()).poll_ms:
            if reply.poll_ms > BUSY_LONGEST_MS or self._time.monotonic() > end:
                raise DeviceTimeoutError(
                    f"{self._name} is busy for longer than the {BUSY_LONGEST_MS / 1000:g} s that it may be; switch it "
                    "off and on"
                )
            self._time.sleep(reply.poll_ms / 1000)
        return reply

    def _failure(self, reply: DfuReply) -> DeviceError:
        """What the device says in ERROR."""
        if reply.status in (DfuStatus.TARGET, DfuStatus.FILE):
            number = reply.string - DFU_REASON_STRINGS
            reason = ImageReason(number) if number in set(ImageReason) else reply.status
            why = self._string(reply.string) or f"status {reply.status.name}"
            return DeviceRefusedError(f"{self._name} refuses the image: {why}", reason)
        if reply.status in _FLASH_FAILURES:
            return DeviceRefusedError(
                f"{self._name} could not write its flash ({reply.status.name}): {_FLASH_FAILURES[reply.status]}; if "
                "this happens again, it needs repair",
                reply.status,
            )
        return DeviceStalledError(
            f"{self._name} refuses a request of the upgrade ({reply.status.name}); does another program speak to it?"
        )

    def _string(self, index: int) -> str:
        """A text of the device, none if it has none (clause DFU-012)."""
        if not index:
            return ""
        try:
            return str(usb.util.get_string(self._device, index) or "")
        except (ValueError, usb.core.USBError):
            return ""

    def _ask(self, request: DfuRequest, value: int, size: int) -> bytes:
        with translated(f"asking {self._name} for {request.name}"):
            return control(self._device, Setup(CLASS_REQUEST_TYPE_IN, request, value, INTERFACE, size))

    def _order(self, request: DfuRequest, value: int = 0, data: bytes = b"") -> None:
        with translated(f"sending {request.name} to {self._name}"):
            control(self._device, Setup(CLASS_REQUEST_TYPE_OUT, request, value, INTERFACE, len(data)), data)
