"""Firmware upgrade over USB: states, refusals and times of DFU 1.1 as this device uses it (SPEC.md, chapter DFU).

`TRANSITIONS` is the standard's state diagram for a device that tolerates manifestation and leaves the bus by itself,
with every pair of state and event defined. Host and emulator both follow it; the tests hold it against the standard's
tables.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum, auto
from itertools import product
from typing import NamedTuple

from construct import ConstructError

from ..base.errors import ReplyError
from .codes import DFU_REASON_STRINGS, DFU_TRANSFER_BYTES, FLASH_SECTOR_BYTES, DfuState, DfuStatus, ImageReason
from .layout import build
from .layout.firmware import DFU_STATUS

__all__ = [
    "BUSY_LONGEST_MS",
    "MANIFEST_MS",
    "TRANSITIONS",
    "DfuEvent",
    "DfuReply",
    "Step",
    "check_block",
    "program_ms",
    "reason_string",
    "status_of",
]

SECTOR_ERASE_MS = 60
PAGE_PROGRAM_MS = 1
PAGE_BYTES = 256
MANIFEST_MS = 2500
BUSY_LONGEST_MS = 10_000


class DfuEvent(Enum):
    """What can happen to a device: requests, as it judges them, and what happens by itself."""

    DETACH = auto()
    DNLOAD = auto()
    """A block that is next in turn."""
    DNLOAD_END = auto()
    """No data, after the last block of the image."""
    UPLOAD = auto()
    """Answered with as many bytes as were asked for."""
    UPLOAD_END = auto()
    """Answered with fewer, since there are no more."""
    GETSTATUS = auto()
    """Nothing is being done."""
    GETSTATUS_BUSY = auto()
    """A block is still being written, or manifestation is not over."""
    CLRSTATUS = auto()
    GETSTATE = auto()
    ABORT = auto()
    REFUSED = auto()
    """Any other request of the class, or one of these with values that cannot be served."""
    REATTACHED = auto()
    """The device has left the bus by itself and come back."""
    POLL_TIMEOUT = auto()
    """The time that GETSTATUS told the host to wait is over."""
    FAILURE = auto()
    """Flash or image turned out to be bad."""
    BUS_RESET = auto()


REQUESTS = frozenset(DfuEvent) - {
    DfuEvent.REATTACHED,
    DfuEvent.POLL_TIMEOUT,
    DfuEvent.FAILURE,
    DfuEvent.BUS_RESET,
}
QUESTIONS = frozenset({DfuEvent.GETSTATUS, DfuEvent.GETSTATUS_BUSY, DfuEvent.GETSTATE})
RUN_TIME = frozenset({DfuState.APP_IDLE, DfuState.APP_DETACH})
DEAF = frozenset({DfuState.DNBUSY, DfuState.MANIFEST, DfuState.MANIFEST_WAIT_RESET})
"""States in which even a question is an error."""


class Step(NamedTuple):
    """What an event leads to."""

    state: DfuState
    stalls: bool = False


_DIAGRAM = {
    (DfuState.APP_IDLE, DfuEvent.DETACH): DfuState.APP_DETACH,
    (DfuState.APP_DETACH, DfuEvent.REATTACHED): DfuState.DFU_IDLE,
    (DfuState.APP_DETACH, DfuEvent.BUS_RESET): DfuState.DFU_IDLE,
    (DfuState.DFU_IDLE, DfuEvent.DNLOAD): DfuState.DNLOAD_SYNC,
    (DfuState.DFU_IDLE, DfuEvent.UPLOAD): DfuState.UPLOAD_IDLE,
    (DfuState.DFU_IDLE, DfuEvent.UPLOAD_END): DfuState.UPLOAD_IDLE,
    (DfuState.DFU_IDLE, DfuEvent.ABORT): DfuState.DFU_IDLE,
    (DfuState.DNLOAD_SYNC, DfuEvent.GETSTATUS_BUSY): DfuState.DNBUSY,
    (DfuState.DNLOAD_SYNC, DfuEvent.GETSTATUS): DfuState.DNLOAD_IDLE,
    (DfuState.DNBUSY, DfuEvent.POLL_TIMEOUT): DfuState.DNLOAD_SYNC,
    (DfuState.DNLOAD_IDLE, DfuEvent.DNLOAD): DfuState.DNLOAD_SYNC,
    (DfuState.DNLOAD_IDLE, DfuEvent.DNLOAD_END): DfuState.MANIFEST_SYNC,
    (DfuState.DNLOAD_IDLE, DfuEvent.ABORT): DfuState.DFU_IDLE,
    (DfuState.MANIFEST_SYNC, DfuEvent.GETSTATUS_BUSY): DfuState.MANIFEST,
    (DfuState.MANIFEST_SYNC, DfuEvent.GETSTATUS): DfuState.DFU_IDLE,
    (DfuState.MANIFEST, DfuEvent.POLL_TIMEOUT): DfuState.MANIFEST_SYNC,
    (DfuState.UPLOAD_IDLE, DfuEvent.UPLOAD): DfuState.UPLOAD_IDLE,
    (DfuState.UPLOAD_IDLE, DfuEvent.UPLOAD_END): DfuState.DFU_IDLE,
    (DfuState.UPLOAD_IDLE, DfuEvent.ABORT): DfuState.DFU_IDLE,
    (DfuState.ERROR, DfuEvent.CLRSTATUS): DfuState.DFU_IDLE,
}


def _step(state: DfuState, event: DfuEvent) -> Step:
    """The diagram, and what clause DFU-006 says of all that is not drawn in it."""
    if (state, event) in _DIAGRAM:
        return Step(_DIAGRAM[state, event])
    if event in QUESTIONS and state not in DEAF:
        return Step(state)
    if event in REQUESTS:
        return Step(DfuState.APP_IDLE if state in RUN_TIME else DfuState.ERROR, stalls=True)
    if state in RUN_TIME or event in {DfuEvent.REATTACHED, DfuEvent.POLL_TIMEOUT}:
        return Step(state)
    return Step(DfuState.APP_IDLE if event is DfuEvent.BUS_RESET else DfuState.ERROR)


TRANSITIONS = {(state, event): _step(state, event) for state, event in product(DfuState, DfuEvent)}
"""The next state, and whether the request is answered with STALL, for every state and event."""


@dataclass(frozen=True)
class DfuReply:
    """The answer to GETSTATUS (clause DFU-007).

    Parameters
    ----------
    status : DfuStatus
        `DfuStatus.OK`, or what went wrong.
    poll_ms : int
        How long the host must wait before it asks again, in ms, 24 bits.
    state : DfuState
        The state that the device enters with this answer.
    string : int
        String descriptor that says more, or 0.
    """

    status: DfuStatus
    poll_ms: int
    state: DfuState
    string: int = 0

    BYTES = 6

    def encode(self) -> bytes:
        """Encode as 6 bytes; raise `ValueError` if a field does not fit."""
        return build(DFU_STATUS, asdict(self), self)

    @classmethod
    def decode(cls, data: bytes) -> DfuReply:
        """Decode 6 bytes; raise `ReplyError` if they break the layout."""
        try:
            fields = DFU_STATUS.parse(data)
        except ConstructError as error:
            raise ReplyError(f"a DFU status {data.hex()} breaks its layout: {error}") from error
        return cls(DfuStatus(fields.status), fields.poll_ms, DfuState(fields.state), fields.string)


def program_ms(number: int) -> int:
    """How long the device is expected to be busy with a block of a download, in ms; never 0 (clause DFU-008).

    A block at the beginning of a sector waits for its erasure, and block 0 also for that of the boot record.
    """
    erasures = (number * DFU_TRANSFER_BYTES % FLASH_SECTOR_BYTES == 0) + (number == 0)
    return erasures * SECTOR_ERASE_MS + DFU_TRANSFER_BYTES // PAGE_BYTES * PAGE_PROGRAM_MS


def check_block(number: int, length: int, received: int, total: int) -> DfuStatus:
    """Judge the next block of a download by its number and length (clause DFU-009).

    Parameters
    ----------
    number : int
        wBlockNum of the request.
    length : int
        wLength of the request; 0 ends the download.
    received : int
        Bytes of the image that have been taken so far.
    total : int
        Bytes of the image, as its header says (`ImageHeader.total`).

    Returns
    -------
    DfuStatus
        `OK`; `ADDRESS` for a block that is out of turn, too short or beyond the end; `NOTDONE` for an early end.
    """
    if length == 0:
        return DfuStatus.OK if received == total else DfuStatus.NOTDONE
    expected = min(DFU_TRANSFER_BYTES, total - received)
    in_turn = number * DFU_TRANSFER_BYTES == received
    return DfuStatus.OK if in_turn and length == expected else DfuStatus.ADDRESS


def status_of(reason: ImageReason) -> DfuStatus:
    """What GETSTATUS says of an image that was refused (clause DFU-012)."""
    if reason is ImageReason.ACCEPTED:
        return DfuStatus.OK
    return DfuStatus.TARGET if reason in {ImageReason.MAGIC, ImageReason.HARDWARE} else DfuStatus.FILE


def reason_string(reason: ImageReason) -> int:
    """The string descriptor whose text is that of the reason; 0 if nothing was refused (clause DFU-012)."""
    return 0 if reason is ImageReason.ACCEPTED else DFU_REASON_STRINGS + reason
