"""What a device and a case say to each other: requests, blocks and records, and a log of all of it."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.errors import DeviceError, DeviceVersionError, ReplyError
from ...protocol.blocks import Block, Body, Change, Slot, Update, pack
from ...protocol.board import CHANNELS, MAX_WIDTH_TICKS, TICKS_PER_PERIOD
from ...protocol.codes import (
    BLOCK_BYTES,
    PROTOCOL_VERSION,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    SILENT_PERIODS,
    Flag,
    Reason,
    Request,
)
from ...protocol.framing import MAX_FRAME_BYTES, LineMode
from ...protocol.plain import plain
from ...protocol.pulses import Pulses
from ...protocol.replies import (
    ANSWER_BYTES,
    Ack,
    ClockReading,
    Info,
    ProcessorReport,
    ReadBack,
    Status,
    decode_reports,
    records,
)
from ...protocol.requests import Setup
from ..traffic.traffic import Traffic
from .cases import Risk, TooSlow
from .log import CaseLog
from .pacing import Pacing
from .transports.line import RawLine
from .transports.serial import RawSerialLine

if TYPE_CHECKING:
    from .verdicts import Evidence

__all__ = ["POWERS", "QUIET_SECONDS", "TOLD_PERIODS", "Dialogue"]

LOW_DRIVE = 32
"""Transducers' worth of total drive that a case may use if hard driving is not allowed: a tenth of the array."""
ACK_SECONDS = 10.0
"""A device answers at once; the rest is margin for a busy computer."""
AHEAD_PERIODS = 1000
"""The lead of a change that must be in time: 25 ms."""
BLOCK_SECONDS = {"usb": 0.01, "serial": 0.1}
"""Time for one block at the lowest speed of a line (clause SER-014), doubled."""
QUIET_SECONDS = 0.002
SLICE_SECONDS, LONGEST_SLICE_SECONDS = 0.01, 0.2
"""How long to wait for a transfer of blocks, which may be larger than the device's buffers, before records are read."""
NOTED_BLOCKS = 8
"""Blocks of one transfer that are kept as evidence."""
COUNTERS = ("accepted", "refused", "late", "lost", "missed_commits", "damaged_messages", "dropped_frames")
"""Counters of STATUS (clause REQ-003)."""
FLAGS_OFFSET = 26  # clause BLK-002
POWERS = np.floor(1000 * np.sin(np.pi * np.arange(MAX_WIDTH_TICKS + 1) / TICKS_PER_PERIOD) ** 2 + 0.5).astype(int)
"""Power of a pulse of each width, in thousandths of the widest (clause SAF-006)."""
TOLD_PERIODS = 800
"""20 ms, within which a device sends an unsolicited record (clause ACK-006)."""
FAR_SECONDS = 0.03
"""The delay that a real line and the programs at its end may add to a record."""


class Dialogue(Pacing):
    """Requests and blocks to a device, its answers and records, and a log of all traffic.

    Parameters
    ----------
    line : RawLine
        The line for blocks and requests.
    allowed : frozenset of Risk
        What may be risked.
    seed : int
        Seed of all random numbers.

    Attributes
    ----------
    info : Info
        The device's first answer.
    random : random.Random
        The generator for this case: the same for the same seed, whatever ran before.
    unasked : list of Status
        Unsolicited status records since the case began or `unasked` was cleared.
    """

    def __init__(self, line: RawLine, allowed: frozenset[Risk], seed: int) -> None:
        super().__init__(line)
        self.allowed = allowed
        self.random = random.Random(seed)
        self.unasked: list[Status] = []
        self._log = CaseLog()
        self._number: int | None = None
        self._first: Status | None = None
        try:
            self.info = Info.decode(self.ask(Request.INFO))
        except (AssertionError, ReplyError) as error:
            raise DeviceError(f"{line.name} does not say what it is: {error}") from error
        if not self.info.speaks(PROTOCOL_VERSION):
            raise DeviceVersionError(
                f"{line.name} speaks versions {self.info.oldest_version} to {self.info.newest_version} of the "
                f"protocol; this suite judges version {PROTOCOL_VERSION}, and sends nothing else (clause VER-006)"
            )

    # Evidence

    def note(self, label: str, what: object, traffic: Traffic = Traffic.OTHER, setup: bytes = b"") -> None:
        """Keep something as evidence; see `CaseLog.note`."""
        self._log.note(label, what, traffic, setup)

    def note_blocks(self, blocks: Sequence[bytes]) -> None:
        """Keep blocks that are sent in one go as evidence: the first ones, if there are many."""
        for block in blocks[:NOTED_BLOCKS]:
            self.note("block", block, Traffic.BLOCK)
        if len(blocks) > NOTED_BLOCKS:
            self.note("blocks", f"and {len(blocks) - NOTED_BLOCKS} more")

    def _note_bytes(self, label: str, data: bytes, mode: LineMode) -> None:
        self._log.note_line(label, data, Traffic.TEXT if mode is LineMode.CONSOLE else Traffic.FRAME)

    def evidence(self, *, whole: bool = False) -> tuple[Evidence, ...]:
        """The log since the case began; see `CaseLog.evidence`."""
        return self._log.evidence(whole=whole)

    def over(self, error: BaseException | None = None) -> None:
        """The case is over, or has failed: what is noted from now on is clean-up."""
        self._log.end(error)

    # Requests

    def request(self, setup: Setup, data: bytes = b"") -> bytes | None:
        """Make any control request; returns the answer, or None for STALL."""
        self.note("request", setup.encode() + data, Traffic.REQUEST)
        answer = self.line.request(setup, data)
        self.note("answer", "STALL" if answer is None else answer or "done", Traffic.REQUEST, setup.encode())
        return answer

    def ask(self, request: Request, value: int = 0) -> bytes:
        """Make a vendor request with an answer; fails if it is answered with STALL or with another length."""
        size = ANSWER_BYTES[request]
        setup = Setup(REQUEST_TYPE_IN, request, value, 0, size)
        answer = self.line.request(setup)
        self.note(request.name, "STALL" if answer is None else answer, Traffic.REQUEST, setup.encode())
        assert answer is not None, f"{request.name} is answered with STALL"
        assert len(answer) == size, f"{request.name} answers {len(answer)} bytes, should be {size}"
        return answer

    def order(self, request: Request, value: int = 0) -> None:
        """Make a vendor request without an answer; fails if it is answered with STALL."""
        assert self.try_order(request, value), f"{request.name} with value {value} is answered with STALL"

    def try_order(self, request: Request, value: int = 0) -> bool:
        """Make a vendor request without an answer; returns False for STALL."""
        return self.request(Setup(REQUEST_TYPE_OUT, request, value, 0, 0)) is not None

    def status(self) -> Status:
        """Ask for STATUS."""
        status = Status.decode(self.ask(Request.STATUS))
        self._know(status.now)
        return status

    def clock(self) -> ClockReading:
        """Ask for CLOCK."""
        reading = ClockReading.decode(self.ask(Request.CLOCK))
        self._know(reading.now)
        return reading

    def read_back(self) -> ReadBack:
        """Ask for PULSES."""
        return ReadBack.decode(self.ask(Request.PULSES))

    def processors(self) -> list[ProcessorReport]:
        """Ask for PROCESSORS."""
        return decode_reports(self.ask(Request.PROCESSORS))

    def enable(self) -> None:
        """Enable the outputs."""
        self.order(Request.ENABLE)

    def disable(self) -> None:
        """Disable the outputs, and wait until they are silent."""
        self.order(Request.DISABLE)
        self.wait_periods(SILENT_PERIODS)

    # Blocks

    @property
    def drive_limit(self) -> int:
        """Transducers' worth of total drive that a case may use."""
        return self.info.drive_limit if Risk.DRIVE in self.allowed else min(LOW_DRIVE, self.info.drive_limit)

    def weak(self, share: float = 1.0) -> Pulses:
        """Random pulses of all transducers with the greatest allowed total drive, or a share of it."""
        rng = np.random.default_rng(self.random.randrange(2**32))
        phase, width = rng.integers(0, 100, CHANNELS), rng.integers(1, 26, CHANNELS)
        order = rng.permutation(CHANNELS)
        drawn = np.cumsum(POWERS[width[order]])
        width[order[drawn > 1000 * self.drive_limit * share]] = 0
        return Pulses(phase, width)

    def numbered(self, body: Body, *, restart: bool = False, number: int | None = None) -> Block:
        """A block with the next number, or with a given one, from which the numbering continues.

        The first block of a case restarts the numbering.
        """
        if number is None:
            first = self._number is None
            number = self.random.randrange(2**32) if self._number is None else (self._number + 1) % 2**32
            restart = restart or first
        self._number = number
        if isinstance(body, Update | Slot):
            power = body.pulses.total_drive / 1000
            if power > self.drive_limit:
                raise RuntimeError(f"a case drives {power:g} transducers; {self.drive_limit} are allowed here")
        return Block(body, number, restart)

    def send(self, body: Body, *, restart: bool = False, number: int | None = None) -> Ack:
        """Send a block, numbered as by `numbered`; returns its acknowledgement."""
        return self.send_raw(pack(self.numbered(body, restart=restart, number=number)))[0]

    def send_all(self, bodies: Iterable[Body]) -> list[Ack]:
        """Send blocks in one go, and collect their acknowledgements, in order."""
        return self.send_raw(*(pack(self.numbered(body)) for body in bodies))

    def must(self, body: Body, *, restart: bool = False, number: int | None = None) -> Ack:
        """Send a block that must be accepted, numbered as by `numbered`.

        Raises `TooSlow` if it is a change for a period that was far ahead when the case began to send it, but over when
        it arrived: the computer or the line was too slow.
        """
        known = self._known_tick // TICKS_PER_PERIOD
        ack = self.send(body, restart=restart, number=number)
        assert ack.reason is Reason.ACCEPTED, f"{body.KIND.name} is refused with {_name(ack.reason)}"
        if isinstance(body, Change) and ack.late and known + AHEAD_PERIODS <= body.period <= ack.now_period:
            raise TooSlow(
                f"a block for period {body.period}, sent in period {known} or soon after, arrived in "
                f"{ack.now_period}: this computer or the line is too slow"
            )
        return ack

    def send_raw(self, *blocks: bytes) -> list[Ack]:
        """Send blocks of 512 bytes unchanged; returns their acknowledgements, which must come in order by number.

        Fails if one does not come in time, or another one comes.
        """
        self._write(blocks)
        acks = [self._next_ack(block, noted=place < NOTED_BLOCKS) for place, block in enumerate(blocks)]
        if acks:
            self._know(acks[-1].now)
        if acks and acks[0].reason is not Reason.ACCEPTED and self._begins(blocks[0]):
            self._number = None  # a refused block has restarted nothing
        return acks

    @staticmethod
    def _begins(block: bytes) -> bool:
        """Whether a block restarts the numbering."""
        return len(block) == BLOCK_BYTES and bool(block[FLAGS_OFFSET] & Flag.RESTART)

    def _write(self, blocks: Sequence[bytes]) -> None:
        self.note_blocks(blocks)
        data = b"".join(blocks)
        self._acks: deque[Ack] = deque()
        patience = ACK_SECONDS + len(blocks) * BLOCK_SECONDS[self.line.kind]
        sent, began = 0, self.line.time.monotonic()
        at_once = len(data) if self.line.kind == "usb" else BLOCK_BYTES
        wait = SLICE_SECONDS
        while sent < len(data):
            before = sent, len(self._acks)
            sent += self.line.send_blocks(data[sent : sent + at_once], wait)
            behind = len(blocks) - len(self._acks) > 1 and self.line.kind == "serial"
            self._collect(ACK_SECONDS if behind else wait - SLICE_SECONDS)
            # A line may be so slow that it completes no transfer in so short a time.
            stuck = before == (sent, len(self._acks))
            wait = min(2 * wait, LONGEST_SLICE_SECONDS) if stuck else SLICE_SECONDS
            assert sent == len(data) or not self._is_over(began, patience), (
                f"only {sent} of {len(data)} bytes of blocks were taken in {patience:g} s"
            )

    def _collect(self, seconds: float) -> None:
        """Sort records: acknowledgements wait for `send`, status records are unsolicited."""
        for record in self._records(self.line.receive_records(max(seconds, QUIET_SECONDS / 2))):
            if isinstance(record, Ack):
                self._acks.append(record)
            else:
                self.note("status, unasked", record.encode(), Traffic.RECORD)
                self.unasked.append(record)

    def _records(self, data: bytes) -> list[Ack | Status]:
        """The records in bytes; these are evidence if they are none."""
        try:
            return records(data)
        except ReplyError as error:
            broken = error
        self.note("came", data, Traffic.RECORD)  # no sooner: what is noted while its error is handled is clean-up
        raise broken

    def _next_ack(self, block: bytes, *, noted: bool) -> Ack:
        """The next acknowledgement, evidence if that is wished, or if it is not the expected one that accepts."""
        number = int.from_bytes(block[4:8], "little")
        began = self.line.time.monotonic()
        while not self._acks:
            assert not self._is_over(began, ACK_SECONDS), (
                f"block {number} is not acknowledged within {ACK_SECONDS:g} s; {self._moved()}"
            )
            self._collect(max(began + ACK_SECONDS - self.line.time.monotonic(), SLICE_SECONDS))
        ack = self._acks.popleft()
        if noted or (ack.sequence, ack.reason) != (number, Reason.ACCEPTED):
            self.note("acknowledgement", ack.encode(), Traffic.RECORD)
        assert ack.sequence == number, f"the acknowledgement of block {number} should come, not of {ack.sequence}"
        return ack

    def _moved(self) -> str:
        """The counters of STATUS that have risen since the case began, which may explain a missing answer."""
        try:
            answer = self.line.request(Setup(REQUEST_TYPE_IN, Request.STATUS, 0, 0, Status.BYTES))
            now, first = plain(Status.decode(answer or b"")), plain(self._first)
        except (DeviceError, ReplyError):
            return "nor is STATUS answered"
        rises = {name: now[name] - first[name] for name in COUNTERS}
        told = " and ".join(f"{name} rose by {rise}" for name, rise in rises.items() if rise > 0)
        return f"since the case began {told or 'no counter of STATUS rose'}"

    # Unsolicited records

    def await_unasked(self, seconds: float) -> Status:
        """Wait for an unsolicited status record; returns the oldest one since `unasked` was cleared."""
        self._acks = deque()
        looks = self._looks(seconds)
        while not self.unasked:
            left = next(looks, None)
            assert left is not None, f"no unsolicited status record comes within {seconds:g} s"
            self._collect(left)
        return self.unasked.pop(0)

    def listen(self, seconds: float | None = None) -> list[Ack | Status]:
        """All unsolicited records in this time.

        By default until all past events must have been reported, by the device's clock.
        """
        if seconds is None:
            self.wait_until(self.period() + TOLD_PERIODS + 1)
            seconds = QUIET_SECONDS + (FAR_SECONDS if self.is_far else 0.0)
            seconds += self.line.transit(2 * MAX_FRAME_BYTES) if isinstance(self.line, RawSerialLine) else 0.0
        found = b"".join([self.line.receive_records(left) for left in self._looks(seconds)])
        if found:
            self.note("came", found, Traffic.RECORD)
        return records(found)

    def keep_alive(self, seconds: float, every: float = 0.02) -> None:
        """Let time pass with a sign of life every so often (clause SAF-003)."""
        end = self.line.time.monotonic() + seconds
        while (left := end - self.line.time.monotonic()) > 0:
            self.wait(min(left, every))
            self.line.request(Setup(REQUEST_TYPE_IN, Request.STATUS, 0, 0, Status.BYTES))


def _name(code: int) -> str:
    return getattr(code, "name", str(code))
