"""DFU mode: the device while its firmware is replaced (SPEC.md, chapter DFU).

`DfuMode` answers the class requests of the only interface that there is in this mode, and writes blocks and boot record
to the bank that does not run. States follow `protocol.dfu.TRANSITIONS`; what takes time is a job, a generator that the
scheduler goes on with. It touches no bank but that one, and does not boot: a bus reset does.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from ...base.errors import ImageError
from ...protocol.codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    DFU_TRANSFER_BYTES,
    FLASH_SECTOR_BYTES,
    IMAGE_MAX_BYTES,
    Bank,
    DfuRequest,
    DfuState,
    DfuStatus,
    ImageReason,
)
from ...protocol.dfu import (
    BUSY_LONGEST_MS,
    MANIFEST_MS,
    PAGE_BYTES,
    PAGE_PROGRAM_MS,
    TRANSITIONS,
    DfuEvent,
    DfuReply,
    check_block,
    program_ms,
    reason_string,
    status_of,
)
from ...protocol.firmware import BootRecord, Image, ImageHeader, Trust, idle_bank, trust
from ...protocol.requests import Setup
from ..door import Stall
from ..scheduler import Scheduler
from .flash import CYCLES_PER_MS, ERASED_BYTE, Flash
from .loader import next_image, read_record

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

__all__ = ["DfuMode"]

MARKS_BYTES = 8
"""At the end of a boot record, for the loader and the firmware to write."""


class _Wait(NamedTuple):
    """What a job waits for."""

    until: int
    """Core cycle."""
    too_long: DfuStatus
    """What is said if the work takes too long by that."""


_Job = Generator[_Wait, None, None]


class _Failure(Exception):
    """What a job ends with if flash or image turn out to be bad."""

    def __init__(self, status: DfuStatus, string: int = 0) -> None:
        super().__init__(status.name)
        self.status = status
        self.string = string


class DfuMode:
    """A device in DFU mode.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the device and of its flash.
    flash : Flash
        The flash, with power.
    running : Bank
        The bank of the firmware that ran until now; it is not touched.
    keys : sequence of Ed25519PublicKey
        Keys that may sign images; without any, an image need not be signed (clause FWU-012).

    Attributes
    ----------
    state : DfuState
        The state at the moment.
    """

    def __init__(self, scheduler: Scheduler, flash: Flash, running: Bank, keys: Sequence[Ed25519PublicKey]) -> None:
        self.state = DfuState.DFU_IDLE
        self._scheduler = scheduler
        self._flash = flash
        self._bank = idle_bank(running)
        self._keys = keys
        self._status = DfuStatus.OK
        self._string = 0
        self._poll_ms = 0
        """What is answered while the job goes on."""
        self._polled_at = 0
        """When the last poll time-out is over, in core cycles."""
        self._job: _Job | None = None
        self._deadline = 0
        self._received = self._total = 0
        """Bytes of the image that have come, and those that its header announces."""
        self._upload = b""
        self._next_upload = 0

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a class request to interface 0 with its OUT data stage and return its IN data stage.

        Raises
        ------
        Stall
            If the request is refused, as clause DFU-006 says.
        """
        handler = _HANDLERS.get((setup.request_type, setup.request))
        if handler is None:
            self._refuse()
        return handler(self, setup, data)[: setup.length]

    def bus_reset(self, configured: bool) -> bool:
        """Reset the bus; a reset counts if a host had configured the device in DFU mode (clause DFU-015).

        Returns
        -------
        bool
            Whether the device boots: as soon as the flash is not busy any more.
        """
        if configured:
            self._apply(DfuEvent.BUS_RESET)
        return configured

    def stop(self) -> None:
        """Begin nothing more, as when the power is gone; the flash finishes what it is doing while it has any."""
        self._job = None

    # Requests

    def _get_status(self, setup: Setup, _: bytes) -> bytes:
        self._check_plain(setup)
        self._apply(DfuEvent.GETSTATUS if self._job is None else DfuEvent.GETSTATUS_BUSY)
        busy = self.state in {DfuState.DNBUSY, DfuState.MANIFEST}
        if busy:
            self._polled_at = self._scheduler.now + self._poll_ms * CYCLES_PER_MS
            self._scheduler.at(self._polled_at, self._time_out)
        return DfuReply(self._status, self._poll_ms if busy else 0, self.state, self._string).encode()

    def _time_out(self) -> None:
        """Leave the busy state, unless this is the time-out of an earlier one that an error has ended."""
        if self._scheduler.now == self._polled_at:
            self._apply(DfuEvent.POLL_TIMEOUT)

    def _get_state(self, setup: Setup, _: bytes) -> bytes:
        self._check_plain(setup)
        self._apply(DfuEvent.GETSTATE)
        return bytes([self.state])

    def _clear_status(self, setup: Setup, data: bytes) -> bytes:
        return self._back_to_idle(DfuEvent.CLRSTATUS, setup, data)

    def _abort(self, setup: Setup, data: bytes) -> bytes:
        return self._back_to_idle(DfuEvent.ABORT, setup, data)

    def _back_to_idle(self, event: DfuEvent, setup: Setup, data: bytes) -> bytes:
        self._check_plain(setup, data)
        self._apply(event)
        self._status, self._string = DfuStatus.OK, 0
        return b""

    def _detach(self, _setup: Setup, _data: bytes) -> bytes:
        self._apply(DfuEvent.DETACH)
        return b""

    def _check_plain(self, setup: Setup, data: bytes = b"") -> None:
        if setup.value or data:
            self._refuse()

    def _download(self, setup: Setup, data: bytes) -> bytes:
        begins = self.state is DfuState.DFU_IDLE
        if TRANSITIONS[self.state, DfuEvent.DNLOAD].stalls or (begins and not data):
            self._refuse()
        if begins:
            if setup.value:
                self._refuse(DfuStatus.ADDRESS)
            try:
                self._total, self._received = ImageHeader.decode(data).total, 0
            except ImageError as refused:
                return self._refuse_header(ImageReason(refused.reason))
        status = check_block(setup.value, len(data), self._received, self._total)
        if status is not DfuStatus.OK:
            self._refuse(status)
        if data:
            self._apply(DfuEvent.DNLOAD)
            self._received += len(data)
            self._begin(self._write(setup.value, data), program_ms(setup.value))
        else:
            self._apply(DfuEvent.DNLOAD_END)
            self._begin(self._manifest(), MANIFEST_MS)
        return b""

    def _refuse_header(self, reason: ImageReason) -> bytes:
        """Refuse an image by its first block: one that is too short by itself, another one as an image."""
        if reason is ImageReason.LENGTH:
            self._refuse(status_of(reason), reason_string(reason))
        self._apply(DfuEvent.DNLOAD)
        self._fail(status_of(reason), reason_string(reason))
        return b""

    def _send(self, setup: Setup, _: bytes) -> bytes:
        """Answer UPLOAD."""
        begins = self.state is DfuState.DFU_IDLE
        if TRANSITIONS[self.state, DfuEvent.UPLOAD].stalls:
            self._refuse()
        if setup.length != DFU_TRANSFER_BYTES or setup.value != (0 if begins else self._next_upload):
            self._refuse(DfuStatus.ADDRESS)
        if begins:
            self._upload = next_image(self._flash)
        block = self._upload[setup.value * DFU_TRANSFER_BYTES :][:DFU_TRANSFER_BYTES]
        self._next_upload = setup.value + 1
        self._apply(DfuEvent.UPLOAD if len(block) == DFU_TRANSFER_BYTES else DfuEvent.UPLOAD_END)
        return block

    # States

    def _apply(self, event: DfuEvent) -> None:
        """Go where an event leads; raise `Stall` if that is how the request is answered."""
        if TRANSITIONS[self.state, event].stalls:
            self._refuse()
        self._enter(TRANSITIONS[self.state, event].state)

    def _refuse(self, status: DfuStatus = DfuStatus.STALLEDPKT, string: int = 0) -> NoReturn:
        """Answer a request with STALL, and say why in the next GETSTATUS."""
        before = self.state
        self._enter(TRANSITIONS[before, DfuEvent.REFUSED].state, status, string)
        raise Stall(f"in {before.name} this is refused with {status.name}")

    def _fail(self, status: DfuStatus, string: int) -> None:
        """Flash or image turned out to be bad."""
        self._enter(TRANSITIONS[self.state, DfuEvent.FAILURE].state, status, string)

    def _enter(self, state: DfuState, status: DfuStatus = DfuStatus.OK, string: int = 0) -> None:
        """Enter a state; the status belongs to ERROR, where that of the first error stays."""
        if state is DfuState.ERROR and self.state is not DfuState.ERROR:
            self._status, self._string = status, string
        if state in {DfuState.ERROR, DfuState.APP_IDLE}:
            self.stop()
        self.state = state

    # Jobs

    def _begin(self, job: _Job, poll_ms: int) -> None:
        self._job = job
        self._poll_ms = poll_ms
        self._deadline = self._scheduler.now + BUSY_LONGEST_MS * CYCLES_PER_MS
        self._go_on(job)

    def _go_on(self, job: _Job, failure: _Failure | None = None) -> None:
        if job is not self._job:
            return  # it was given up
        try:
            if failure is not None:
                raise failure
            wait = next(job)
        except StopIteration:
            self._job = None
        except _Failure as failed:
            self._fail(failed.status, failed.string)
        else:
            late = wait.until > self._deadline
            then = partial(self._go_on, job, _Failure(wait.too_long) if late else None)
            self._scheduler.at(min(wait.until, self._deadline), then)

    def _write(self, number: int, data: bytes) -> _Job:
        """Write a block of the image where it belongs, erasing what was there (clauses FWU-018 and DFU-010)."""
        if self._flash.busy:  # an earlier download that ended in an error, or a mark
            yield _Wait(self._flash.busy_until, DfuStatus.WRITE)
        if number == 0:
            yield from self._empty_bank()
        address = self._bank.image_address + number * DFU_TRANSFER_BYTES
        if address % FLASH_SECTOR_BYTES == 0:
            yield from self._erase(address)
        for begin in range(0, len(data), PAGE_BYTES):
            yield from self._program(address + begin, data[begin : begin + PAGE_BYTES])

    def _empty_bank(self) -> _Job:
        record = read_record(self._flash, self._bank)
        if record is not None and not record.may_boot:
            # An erasure that is cut short may leave bits of either value: the mark of an image that never came up could
            # then say that it had. Without its record, nobody reads the mark.
            yield from self._program(self._bank.record_address, bytes(BootRecord.BYTES - MARKS_BYTES))
        yield from self._erase(self._bank.record_address)

    def _manifest(self) -> _Job:
        """Check the image as it stands in flash, and write its record last of all (clause DFU-011)."""
        checking_ms = (MANIFEST_MS - PAGE_PROGRAM_MS) * self._total // IMAGE_MAX_BYTES
        yield _Wait(self._scheduler.now + checking_ms * CYCLES_PER_MS, DfuStatus.VERIFY)
        stored = self._flash.read(self._bank.image_address, self._total)
        reason = self._judge(stored)
        if reason is not ImageReason.ACCEPTED:
            raise _Failure(status_of(reason), reason_string(reason))
        other = read_record(self._flash, idle_bank(self._bank))
        yield from self._program(self._bank.record_address, BootRecord.of(stored, other).encode()[:-MARKS_BYTES])

    def _judge(self, stored: bytes) -> ImageReason:
        try:
            signed = trust(Image.decode(stored), self._keys) is Trust.SIGNED
        except ImageError as refused:
            return ImageReason(refused.reason)
        return ImageReason.ACCEPTED if signed or not self._keys else ImageReason.SIGNATURE

    def _erase(self, address: int) -> _Job:
        self._check_writable()
        self._flash.erase(address)
        yield _Wait(self._flash.busy_until, DfuStatus.ERASE)
        if self._flash.failed:
            raise _Failure(DfuStatus.ERASE)
        if self._flash.read(address, FLASH_SECTOR_BYTES) != bytes([ERASED_BYTE]) * FLASH_SECTOR_BYTES:
            raise _Failure(DfuStatus.CHECK_ERASED)

    def _program(self, address: int, data: bytes) -> _Job:
        self._check_writable()
        self._flash.program(address, data)
        yield _Wait(self._flash.busy_until, DfuStatus.PROG)
        if self._flash.failed:
            raise _Failure(DfuStatus.PROG)
        if self._flash.read(address, len(data)) != data:
            raise _Failure(DfuStatus.VERIFY)

    def _check_writable(self) -> None:
        if not self._flash.writable:
            raise _Failure(DfuStatus.WRITE)


_HANDLERS: Mapping[tuple[int, int], Callable[[DfuMode, Setup, bytes], bytes]] = MappingProxyType(
    {
        (CLASS_REQUEST_TYPE_OUT, DfuRequest.DETACH): DfuMode._detach,
        (CLASS_REQUEST_TYPE_OUT, DfuRequest.DNLOAD): DfuMode._download,
        (CLASS_REQUEST_TYPE_IN, DfuRequest.UPLOAD): DfuMode._send,
        (CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATUS): DfuMode._get_status,
        (CLASS_REQUEST_TYPE_OUT, DfuRequest.CLRSTATUS): DfuMode._clear_status,
        (CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATE): DfuMode._get_state,
        (CLASS_REQUEST_TYPE_OUT, DfuRequest.ABORT): DfuMode._abort,
    }
)
