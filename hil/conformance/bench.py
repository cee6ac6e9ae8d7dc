"""The bench: a device under test, everything that a case may ask of it, and a log of all traffic.

A case gets the device disabled, without faults and without records that wait; its first block restarts the numbering. A
case need not restore what it changes, except what lasts: firmware, power, the bus.
"""

from __future__ import annotations

import random
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cached_property
from math import ceil
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from ...base.errors import DeviceError, DeviceVersionError, InputFileError, ReplyError
from ...protocol.blocks import Block, Body, Change, NoOp, Slot, Update, pack
from ...protocol.board import CARRIER_HZ, CHANNELS, MAX_WIDTH_TICKS, TICK_HZ, TICKS_PER_PERIOD
from ...protocol.codes import (
    BLOCK_BYTES,
    PROTOCOL_VERSION,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    RESTART_SECONDS,
    SILENT_PERIODS,
    Flag,
    Reason,
    Request,
    State,
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
    decode_wiring,
    records,
)
from ...protocol.requests import VALUES, Setup
from ...protocol.wiring import Wiring
from ..traffic.traffic import Traffic
from .cases import NOT_USB, Inconclusive, Need, Risk, TooSlow, unmet
from .levers import METHODS, LeverFailed, PluggedLevers
from .log import CaseLog
from .profile import Profile
from .sight.capture import Observer, Seen, Unseen
from .sight.marks import MARK_PULSES, Mark
from .transports.line import RawLine
from .transports.serial import CdcWire, RawSerialLine
from .transports.usb import RawUsbLine

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    from .verdicts import Evidence

__all__ = [
    "LOW_DRIVE",
    "MOST_SLOWNESS",
    "OUTPUTS",
    "POWERS",
    "TOLD_PERIODS",
    "TRIED_SECONDS",
    "Bench",
    "Lost",
]

LOW_DRIVE = 32
"""Transducers' worth of total drive that a case may use if hard driving is not allowed: a tenth of the array."""
ACK_SECONDS = 10.0
"""A device answers at once; the rest is margin for a busy computer."""
AHEAD_PERIODS = 1000
"""The lead of a change that must be in time: 25 ms."""
LAST_LOOK_SECONDS = 0.1
"""Time for a device's data to reach this program."""
BLOCK_SECONDS = {"usb": 0.01, "serial": 0.1}
"""Time for one block at the lowest speed of a line (clause SER-014), doubled."""
TRIED_SECONDS = 2.0
"""Time of the line for the values of a case that is the same for each of them."""
MEASURED_BLOCKS = 8
QUIET_SECONDS = 0.002
SLICE_SECONDS, LONGEST_SLICE_SECONDS = 0.01, 0.2
"""How long to wait for a transfer of blocks, which may be larger than the device's buffers, before records are read."""
WAIT_SECONDS = 1.0
"""What a line and a computer may add to a wait for a tick."""
PACE_SECONDS = 0.1
"""The least time over which the device's clock is compared with the host's."""
MOST_SLOWNESS = 64
"""Periods are then named 3.2 s ahead."""
OFF_SECONDS = 0.1
"""How long a device is without power."""
LEAVES_SECONDS = 2.0
"""Time for a device without power or cable to leave the bus."""
RETURN_SECONDS = RESTART_SECONDS + 1.0
"""Time for a device to come back after a restart (clause TIM-002), and for the computer to find it."""
NOTED_BLOCKS = 8
"""Blocks of one transfer that are kept as evidence."""
OUTPUTS = "outputs"
"""Label of the evidence on judged outputs."""
COUNTERS = ("accepted", "refused", "late", "lost", "missed_commits", "damaged_messages", "dropped_frames")
"""Counters of STATUS (clause REQ-003)."""
FLAGS_OFFSET = 26  # clause BLK-002
POWERS = np.floor(1000 * np.sin(np.pi * np.arange(MAX_WIDTH_TICKS + 1) / TICKS_PER_PERIOD) ** 2 + 0.5).astype(int)
"""Power of a pulse of each width, in thousandths of the widest (clause SAF-006)."""
TOLD_PERIODS = 800
"""20 ms, within which a device sends an unsolicited record (clause ACK-006)."""
FAR_SECONDS = 0.03
"""The delay that a real line and the programs at its end may add to a record."""
NO_DOOR = "this run has no {what}: pass --door {url}; if the device has none, let the profile say so under {clause}"
DOORS: Mapping[str, str] = {
    "usb": NO_DOOR.format(what="USB line", url="usb:", clause="USB-002"),
    "cdc": NO_DOOR.format(what="console on USB", url="usb:", clause="USB-002"),
    "uart": NO_DOOR.format(what="UART", url="serial:///dev/…", clause="SER-001"),
}
"""The lines that a device may have, and why one cannot be judged that this run lacks."""


class Lost(Exception):
    """The device cannot be brought back; no further case can be judged."""


class LostByLever(Lost, Inconclusive):
    """The device cannot be brought back, and a lever failed meanwhile: it may not be the device's fault."""


class Bench:
    """A device under test.

    Parameters
    ----------
    line : RawLine
        The line for blocks and requests.
    levers : PluggedLevers
        Control of the device's surroundings.
    observer : Observer or None
        Observation of its outputs.
    allowed : frozenset of Risk
        What may be risked.
    seed : int
        Seed of all random numbers.
    profile : Profile
        What the makers declare of the device.
    spare : callable, optional
        Returns, as a context manager, a bench with a fresh device of the same kind, which trusts a key or, given None,
        has no keys.
    doors : mapping of str to callable
        Further lines of the same device by their names in `DOORS`, each opened by a context manager.

    Attributes
    ----------
    line : RawLine
    levers : PluggedLevers
    info : Info
        The device's first answer.
    slowness : int
        Factor on the waiting time of cases before something happens.
    random : random.Random
        For this case: the same for the same seed, whatever ran before.
    marks : list of Mark
        All marks that were played in this run.
    looks : list of callable
        The judgements of the outputs in this case, in order. Each returns what was seen, or raises what was wrong.
    block_seconds : float
        How long a block and its acknowledgement take on this line, as measured at the first case.
    pace : float
        The time of the device for one second of the host, as last measured; at most 1.
    tried : list of int
        Of how many values this case tried how many.
    unasked : list of Status
        Unsolicited status records since the case began or `unasked` was cleared.
    """

    def __init__(
        self,
        line: RawLine,
        levers: PluggedLevers,
        observer: Observer | None,
        allowed: frozenset[Risk],
        seed: int,
        *,
        profile: Profile,
        spare: Callable[[Ed25519PrivateKey | None], AbstractContextManager[Bench]] | None = None,
        free_time: bool = True,
        doors: Mapping[str, Callable[[], AbstractContextManager[RawLine]]] = MappingProxyType({}),
    ) -> None:
        self.line = line
        self._doors = doors
        self.levers = levers
        levers.done = self._lever_done
        self.observer = observer
        self.allowed = allowed
        self._seed = seed
        self._spare = spare
        self._free_time = free_time
        self.profile = profile
        self._serial: RawSerialLine | None = line if isinstance(line, RawSerialLine) else None
        self._log = CaseLog()
        self.looks: list[Callable[[], str]] = []
        self._marks: list[Mark] = []
        self.marks: list[Mark] = []
        self.random = random.Random(seed)
        self.unasked: list[Status] = []
        self.slowness = 1
        self.block_seconds = 0.0
        self.tried = [0, 0]
        self._tried_seconds = 0.0
        self._number: int | None = None
        self._first: Status | None = None
        self._known_tick, self._known_at = 0, 0.0
        self.pace = 1.0
        self._paced_from = 0, 0.0
        try:
            self.info = Info.decode(self.ask(Request.INFO))
        except (AssertionError, ReplyError) as error:
            raise DeviceError(f"{line.name} does not say what it is: {error}") from error
        if not self.info.speaks(PROTOCOL_VERSION):
            raise DeviceVersionError(
                f"{line.name} speaks versions {self.info.oldest_version} to {self.info.newest_version} of the "
                f"protocol; this suite judges version {PROTOCOL_VERSION}, and sends nothing else (clause VER-006)"
            )

    # Parts of the bench

    @cached_property
    def wiring(self) -> Wiring:
        """The device's first answer."""
        return decode_wiring(self.ask(Request.WIRING))

    @property
    def usb(self) -> RawUsbLine:
        """The line as a USB line; inconclusive if it is none."""
        if not isinstance(self.line, RawUsbLine):
            raise Inconclusive(NOT_USB)
        return self.line

    @property
    def serial(self) -> RawSerialLine:
        """A serial line of the device: the line itself, or on USB its console's endpoints, which start as a console."""
        if self._serial is None:
            self._serial = RawSerialLine(CdcWire(self.usb))
            self._serial.watch = self.line.watch
        self._serial.noted = self._note_bytes
        return self._serial

    @contextmanager
    def door(self, name: str) -> Iterator[RawLine]:
        """A line of the device by its name in `DOORS`, a serial one with frames; inconclusive if this run lacks it."""
        opened: AbstractContextManager[RawLine]
        if name == ("usb" if self.line.kind == "usb" else "uart"):
            opened = nullcontext(self.line)
        elif name == "cdc" and self.line.kind == "usb":
            opened = nullcontext(self.serial)
        elif name in self._doors:
            opened = self._doors[name]()
        else:
            raise Inconclusive(DOORS[name])
        with opened as line:
            if line is not self.line:
                line.watch = self.line.watch
            if isinstance(line, RawSerialLine):
                line.noted = self._note_bytes
                line.wire.set_dtr(True)
                line.enter_frames()
            yield line
            if isinstance(line, RawSerialLine):
                self.leave(line)

    def leave(self, line: RawSerialLine) -> None:
        """Leave a serial line in frames if it carries blocks, else as an unused console."""
        if line is self.line:
            line.enter_frames()
        else:
            line.wire.set_dtr(False)
            line.assume_console()

    def check_doors(self) -> None:
        """Raise ValueError if a further line leads to another device."""
        for name in self._doors:
            with self.door(name) as line:
                answer = line.request(Setup(REQUEST_TYPE_IN, Request.INFO, 0, 0, ANSWER_BYTES[Request.INFO]))
                found = Info.decode(answer or b"").unique_id
                if found != self.info.unique_id:
                    raise ValueError(
                        f"--door: {line.name} leads to the device {found.hex()}, but this run judges "
                        f"{self.info.unique_id.hex()}, {self.line.name}"
                    )

    def can(self, need: Need) -> bool:
        """Whether the bench can see or do something."""
        if need is Need.CAPTURE:
            return self.observer is not None or need in self.levers.can
        if need in (Need.SPARE, Need.FREE_TIME):
            return self._spare is not None and (self._free_time or need is Need.SPARE)
        return need in self.levers.can

    @contextmanager
    def spare(self, key: Ed25519PrivateKey | None = None) -> Iterator[Bench]:
        """A bench with a fresh device of the same kind, which may be broken for good; its traffic is logged here too.

        With a key the device trusts only that key, which has signed its firmware (clause FWU-012).
        """
        if self._spare is None:
            raise Inconclusive(unmet(Need.SPARE))
        with self._spare(key) as other:
            other._log, other.looks = self._log, self.looks
            other.line.watch.wrong, other.block_seconds = self.line.watch.wrong, self.block_seconds
            yield other

    @property
    def drive_limit(self) -> int:
        """Transducers' worth of total drive that a case may use."""
        return self.info.drive_limit if Risk.DRIVE in self.allowed else min(LOW_DRIVE, self.info.drive_limit)

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

    def forget(self) -> None:
        """Start with no evidence."""
        self._log.forget()
        self.looks.clear()

    # Cases

    def begin_case(self, name: str) -> None:
        """Bring the device to the state in which every case begins.

        Raises
        ------
        Lost
            If no allowed action can do so.
        """
        self.forget()
        self._marks = []
        if self._serial is not self.line:
            self._serial = None  # whatever an earlier case left
        elif self._serial is not None:
            self._serial.noted = None  # until a case uses the line itself: what it asks of the bench is noted there
        self.random = random.Random(zlib.crc32(name.encode()) ^ self._seed)
        self.tried, self._tried_seconds = [0, 0], 0.0
        try:
            self._settle()
            if not self.block_seconds:
                self._measure()
        except (DeviceError, ReplyError, AssertionError) as first:
            self.note("recovery", f"the device was not as at the start of a case: {first}")
            self._recover()
        self.forget()
        self.unasked.clear()

    def _measure(self) -> None:
        """Find how long a block takes on this line; the device is off, and refuses them."""
        blocks = [pack(Block(NoOp(), number, number == 0)) for number in range(MEASURED_BLOCKS)]
        began = self.line.time.monotonic()
        self.send_raw(*blocks)
        self.block_seconds = max((self.line.time.monotonic() - began) / len(blocks), 1e-9)
        self._settle()

    def tries(self, of: int, least: int, blocks: float = 1, seconds: float = TRIED_SECONDS) -> int:
        """How many of so many tries a case makes: all, or those for which this line has the time.

        Parameters
        ----------
        of, least : int
            All, and how many are made on any line.
        blocks : float
            How many blocks, or what takes as long, a try needs.
        seconds : float
            The time for all tries of the case.
        """
        each = blocks * self.block_seconds
        fit = of if each * of <= (left := seconds - self._tried_seconds) else int(max(left, 0) / each)
        made = min(of, max(least, fit))
        self._tried_seconds += made * each
        self.tried = [self.tried[0] + made, self.tried[1] + of]
        if made < of:
            self.note("tried", f"{made} of {of}: a block takes {1000 * self.block_seconds:.3g} ms on this line")
        return made

    def end_case(self) -> None:
        """Leave the device off."""
        try:
            self.line.request(Setup(REQUEST_TYPE_OUT, Request.DISABLE, 0, 0, 0))
            setup = Setup(REQUEST_TYPE_IN, Request.STATUS, 0, 0, Status.BYTES)
            self.note("status at the end", self.line.request(setup) or "STALL", Traffic.REQUEST, setup.encode())
        except DeviceError as error:
            self.note("end", f"the device cannot be left off: {error}")

    def leave_off(self) -> None:
        """Leave the device as at power-up after the last case, if it can be reached: off, with INFO's limits."""
        with suppress(DeviceError, AssertionError):
            self.try_order(Request.DISABLE)
            self.try_order(Request.WATCHDOG, self.info.watchdog_ms)
            self.try_order(Request.LIMIT, self.info.drive_limit)

    def _settle(self) -> None:
        """Restore the initial state by requests alone."""
        if isinstance(self.line, RawSerialLine):
            self.line.enter_frames()
        asked = self.line.time.monotonic()
        self.order(Request.DISABLE)
        trip = self.line.time.monotonic() - asked
        self.wait_periods(2 * SILENT_PERIODS)
        for _ in range(1000):
            if not self.line.receive_records(max(QUIET_SECONDS, 2 * trip)):
                break
        status = self.status()
        if status.state is State.FAULT or status.faults:
            self.order(Request.CLEAR_FAULTS)
            status = self.status()
        if status.state is not State.OFF:
            raise DeviceError(f"the device is {status.state.name} after DISABLE and CLEAR_FAULTS")
        self.order(Request.WATCHDOG, self.info.watchdog_ms)
        self.order(Request.LIMIT, self.drive_limit)
        self._number, self._first = None, status

    def _recover(self) -> None:
        """Bring back a device that does not answer properly: open it again, reset the bus, cut its power."""
        ways: list[Callable[[], None]] = [lambda: self.line.reopen(self.return_seconds)]
        if Risk.RESET in self.allowed and isinstance(self.line, RawUsbLine):
            ways.append(self.usb.reset)
        if Risk.RESET in self.allowed and Need.POWER in self.levers.can:
            ways.append(self.power_cycle)
        problems: list[Exception] = []
        for way in ways:
            try:
                way()
                self._settle()
            except (DeviceError, ReplyError, AssertionError, OSError, LeverFailed) as error:
                problems.append(error)
            else:
                return
        lost = LostByLever if any(isinstance(problem, LeverFailed) for problem in problems) else Lost
        raise lost("the device cannot be brought back: " + "; then ".join(map(str, problems)))

    # Time

    @property
    def is_far(self) -> bool:
        """Whether the device's time is not that of this process: either may lag."""
        return self.line.time is time

    def slow_down(self) -> bool:
        """Give cases more time from now on, because one had too little; returns whether more could be given."""
        if not self.is_far or self.slowness >= MOST_SLOWNESS:
            return False
        self.slowness *= 4
        return True

    def wait(self, seconds: float) -> None:
        """Let time pass for the host; a simulated device may lag."""
        self.line.time.sleep(seconds)

    def outlast(self, seconds: float) -> None:
        """Let time pass for the device, which must answer CLOCK: this is neither a sign of life nor a change."""
        due = self.clock().now + ceil(seconds * TICK_HZ) if self.is_far else 0
        self.wait(seconds)
        if self.is_far:
            self._wait_until_tick(due)

    def paced(self, seconds: float) -> float:
        """How long so much time of a device takes for the host, by its pace before: it may have no clock to ask for."""
        return seconds / self.pace

    @property
    def return_seconds(self) -> float:
        """The longest time until a device is back after a restart."""
        return self.paced(RETURN_SECONDS)

    def wait_periods(self, periods: float) -> None:
        """Let carrier periods of the device pass."""
        self.outlast(periods / CARRIER_HZ)

    def wait_until(self, period: int) -> None:
        """Let time pass until a carrier period of the device has begun by its own clock, while that comes nearer."""
        self._wait_until_tick(period * TICKS_PER_PERIOD)

    def _wait_until_tick(self, tick: int) -> None:
        for left in self._left_until(tick):
            self.wait((left + 1) / TICK_HZ)

    def _left_until(self, tick: int) -> Iterator[int]:
        """The ticks that the device still has to go, asked repeatedly.

        No wait is longer than the case asked for when it named the tick, and the waits end if the clock does not come
        nearer, or hardly: it may be as slow as cases can be made (`MOST_SLOWNESS`).
        """
        now, began, first = self.line.time.monotonic, self.line.time.monotonic(), None
        least = named = self.line.watch.highest
        while (left := tick - (told := self.clock().now)) > 0:
            first = told if first is None else first
            due = (now() - began - WAIT_SECONDS) * TICK_HZ / (MOST_SLOWNESS if self.is_far else 1)
            comes_nearer = told >= least and told - first >= due
            assert comes_nearer, (
                f"the clock does not reach tick {tick}: it named tick {named} before the wait, {first} at its begin "
                f"and {told} after {now() - began:.3f} s"
            )
            yield left
            least = told + 1

    def _looks(self, seconds: float) -> Iterator[float]:
        """Repeat while the device may still send something, until the time is over.

        It is over when host and device agree that it is, and what was sent before has arrived.
        """
        due = self.clock().now + ceil(seconds * TICK_HZ) if self.is_far else 0
        end = self.line.time.monotonic() + seconds
        while (left := end - self.line.time.monotonic()) > 0:
            yield left
        if self.is_far:
            for ticks in self._left_until(due):
                yield (ticks + 1) / TICK_HZ
            yield LAST_LOOK_SECONDS

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

    def _know(self, tick: int) -> None:
        """Note the device's tick, and after some time how fast it counts."""
        self._known_tick, self._known_at = tick, self.line.time.monotonic()
        first, at = self._paced_from
        passed = self._known_at - at
        if at and tick >= first and passed < PACE_SECONDS:
            return
        if at and tick >= first:
            self.pace = min(max((tick - first) / TICK_HZ / passed, 1 / MOST_SLOWNESS), 1.0) if self.is_far else 1.0
        self._paced_from = tick, self._known_at

    def measure_pace(self) -> None:
        """Compare the device's clock with the host's, before the device has none to ask for."""
        if self.is_far:
            self._paced_from = self.clock().now, self.line.time.monotonic()
            self.wait(PACE_SECONDS)
            self.clock()

    def _is_over(self, began: float, seconds: float) -> bool:
        """Whether time is over by the host's clock and, if the device is slower, by the device's."""
        passed = self.line.time.monotonic() - began
        if passed >= seconds and self.is_far:
            self.clock()
        return passed >= self.paced(seconds)

    def read_back(self) -> ReadBack:
        """Ask for PULSES."""
        return ReadBack.decode(self.ask(Request.PULSES))

    def processors(self) -> list[ProcessorReport]:
        """Ask for PROCESSORS."""
        return decode_reports(self.ask(Request.PROCESSORS))

    def period(self) -> int:
        """The device's present carrier period, by its own clock."""
        return self.clock().now // TICKS_PER_PERIOD

    def enable(self) -> None:
        """Enable the outputs."""
        self.order(Request.ENABLE)

    def disable(self) -> None:
        """Disable the outputs, and wait until they are silent."""
        self.order(Request.DISABLE)
        self.wait_periods(SILENT_PERIODS)

    # Blocks

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

        Raises
        ------
        TooSlow
            If it is a change for a period that was far ahead when the case began to send it, but over when it arrived:
            the computer or the line was too slow.
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

    # Drives

    def weak(self, share: float = 1.0) -> Pulses:
        """Random pulses of all transducers with the greatest allowed total drive, or a share of it."""
        rng = np.random.default_rng(self.random.randrange(2**32))
        phase, width = rng.integers(0, 100, CHANNELS), rng.integers(1, 26, CHANNELS)
        order = rng.permutation(CHANNELS)
        drawn = np.cumsum(POWERS[width[order]])
        width[order[drawn > 1000 * self.drive_limit * share]] = 0
        return Pulses(phase, width)

    # Restarts

    def restart(self, how: Callable[[], None]) -> None:
        """Restart the device in some way, and find it again."""
        how()
        self.line.reopen(self.return_seconds)
        self._number = None

    def begin_anew(self) -> bool:
        """Restart the device, so that nothing of what was asked of it is left; returns False if this is not allowed.

        It is False also if the device does not take the order or does not come back, which the next case shows.
        """
        if Risk.RESET not in self.allowed:
            return False
        try:
            if isinstance(self.line, RawSerialLine):
                self.line.enter_frames()
            self.restart(lambda: self.order(Request.RESET))
        except (DeviceError, ReplyError, AssertionError):
            return False
        return True

    def power_cycle(self) -> None:
        """Cut the power for a tenth of a second.

        Raises
        ------
        LeverFailed
            If the lever is not the emulator's, and the device's clock ran on meanwhile. A clock that stood still for
            the cut and then went on is a failure of the device, which the case shows.
        """

        def cut() -> None:
            self.levers.power_down()
            self.wait(OFF_SECONDS)
            self.levers.power_up()

        tick, at = self._known_tick, self._known_at
        self.restart(cut)
        if lever := self.levers.outside.get(Need.POWER):
            passed = (self.clock().now - tick) / TICK_HZ
            if passed > self._known_at - at - OFF_SECONDS / 2:
                raise LeverFailed(
                    f"the lever {lever!r} reported success, but the device kept its time: it was not without power"
                )

    def _lever_done(self, action: str, said: str) -> None:
        """Keep an action of a lever as evidence; a device without power or cable must leave the bus."""
        self.note("lever", said)
        for need in self.levers.outside.keys() & {Need.POWER, Need.PLUG}:
            off, on = METHODS[need]
            if action == off and isinstance(self.line, RawUsbLine):
                self._await_leaving(self.line, self.levers.outside[need], getattr(self.levers, on))

    def _await_leaving(self, line: RawUsbLine, lever: str, restore: Callable[[], None]) -> None:
        end = line.time.monotonic() + LEAVES_SECONDS
        while line.is_there:
            if line.time.monotonic() >= end:
                restore()
                raise LeverFailed(f"the lever {lever!r} reported success, but the device is still on the bus")
            self.wait(0.01)

    # Outputs

    def judge(self, first: int, last: int, check: Callable[[Seen], None], *, over: bool = False) -> None:
        """Judge the outputs from a period to another, not included, by a function that fails like a case.

        It waits until the periods are over by the device's clock, unless the caller says that they are, as when the
        device answers no request. The case goes on after a failure, which `looks` keep. If the outputs are only seen
        after the run, the judgement comes then.
        """
        observer, marks = self.observer, self._marks
        if not over:
            self.wait_until(last + 1)

        def look() -> str:
            if observer is None:
                raise Inconclusive(unmet(Need.CAPTURE))
            try:
                part = observer.between(marks[0], marks[-1]) if observer.deferred else observer
                seen = part.seen(first, last)
            except (Unseen, InputFileError, OSError) as error:
                raise Inconclusive(str(error)) from None
            check(seen)
            moved = np.bitwise_count(np.bitwise_or.reduce(seen.words)).sum()
            watched = np.bitwise_count(seen.observed).sum()
            return f"{watched} of {CHANNELS} seen in periods {first} to {last - 1}, {moved} of them high at some time"

        self.looks.append(look if observer is not None and observer.deferred else self._done(look))

    def _done(self, look: Callable[[], str]) -> Callable[[], str]:
        """Judge now, and report later."""
        done = Future[str]()
        try:
            done.set_result(look())
        except Exception as error:
            done.set_exception(error)
            if not isinstance(error, Inconclusive):
                self._log.mark_wrong()
        return done.result

    def play_mark(self) -> None:
        """Let the outputs show a mark, which identifies this case in a recording (see `Mark`).

        Meanwhile the watchdog has its longest time, so that a slow host does not end the mark.
        """
        self._settle()
        self.order(Request.WATCHDOG, VALUES[Request.WATCHDOG][-1])
        self.enable()
        changes = []
        for gap, is_on in Mark.plan(random.Random()):  # never the same, so that another run's recording is refused
            period = self.period() + gap + 8
            ack = self.must(Update(MARK_PULSES if is_on else Pulses.silent(CHANNELS), period))
            self.wait_until(ack.commit_period)
            changes.append((ack.commit_period, is_on))
        self.disable()
        self.order(Request.WATCHDOG, self.info.watchdog_ms)
        self._marks.append(Mark(tuple(changes)))
        self.marks.append(self._marks[-1])


def _name(code: int) -> str:
    return getattr(code, "name", str(code))
