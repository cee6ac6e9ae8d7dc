"""Fields that take turns on a device, each for some carrier periods, while they keep changing.

Section 3.4 of the paper plays two fields in turn at 200 Hz; a hand that moves makes new ones up to a thousand times a
second. Three ways to the device were weighed:

- A sequence of two slots, which the device repeats by itself. What plays cannot be overwritten (clause BLK-022), so
  each pose costs two slots, entries and a sequence, stored beside those that play.
- One update per half, sent ahead of its boundary: a pose waits 2.5 ms for the next boundary.
- Updates as they come: each pose sends the field whose turn it is, to begin at once; and ahead of each boundary the
  other field is sent, named for that boundary.

`StreamedTurns` does the last. Whose turn it is follows from the device's own count of periods, t = ⌊P / half⌋, even or
odd, whatever was sent and when: so the modulation keeps its phase, also after the host was held up. A pose is on the
skin after one block (10 µs on USB) and three to five carrier periods; a pose that comes less than a lead before a
boundary, 0.5 ms on USB, begins with the boundary. 1000 poses/s make 1200 to 1400 blocks/s.

`StoredTurns` is the first way, for cycles of any number of fields, for a line that cannot carry a block for each turn,
such as a UART below some 3 Mbaud, and for a modulation above 900 Hz. A pose costs a block for each field that differs,
and two more, so `StoredTurns.most_frames` limits the fields by the rate of the line. The new cycle begins as soon as
its blocks have arrived, in the middle of itself: the entries are rotated so that the cycle goes on where the one before
is. Cycles of the same length are in phase with the device's count of periods; if the length changes, the share of the
cycle that has passed stays the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor, inf
from typing import Protocol

import numpy as np

from ...base.errors import DeviceRefusedError
from ...protocol.board import CARRIER_HZ
from ...protocol.codes import NOW, AckFlag, Reason
from ...protocol.replies import Ack
from ...solver.rendering.renderer import LEAST_FRAMES
from ...solver.rendering.ways import Halves, Way
from ..streaming.clock import DeviceClock, Reading
from ..streaming.cycles import split_steps
from ..streaming.device import Device
from ..streaming.envelopes import sine
from ..streaming.lanes import LEAST_LEAD_PERIODS
from .fields import PulseCycle

__all__ = ["Alternation", "StoredTurns", "StreamedTurns", "Turns", "turns_for"]

RESERVE_PERIODS = 14
"""0.35 ms, by which this program may be late for a boundary: a computer needs as long to wake up."""
FIRST_READINGS = 8
READING_SECONDS = 0.05
BLOCKS_BESIDE = 2
"""Of a stored pose beside its fields: an entry table and a sequence."""
MOST_FRAMES = 24
"""Of a cycle."""
STORING_SECONDS = 0.02
"""In which a line is to carry a pose, if `LEAST_FRAMES` allow that."""
SETS = 3
"""Of slots: one plays, one waits for its period, one is free."""
MOST_PACE_PERIODS = 100
"""2.5 ms between two steps of a ramp."""
ROUNDING_SECONDS = 1e-6
"""So much after a turn is due it is due for certain, in spite of rounding."""
LIFE = 1 / 3
"""Of the watchdog's time may pass until the next sign of life."""


@dataclass(frozen=True)
class Alternation:
    """Fields that take turns.

    Parameters
    ----------
    hold : int
        Carrier periods for which each plays.
    begins : int
        A period at which the first one begins.
    count : int
        Fields.
    """

    hold: int
    begins: int = 0
    count: int = 2

    @property
    def frequency(self) -> float:
        """How often all of them are repeated in a second."""
        return CARRIER_HZ / (self.hold * self.count)

    def number(self, period: int) -> int:
        """Which of them plays in a period, from 0."""
        return (period - self.begins) // self.hold % self.count


class Turns(Protocol):
    """Fields in turn on a device.

    Attributes
    ----------
    blocks : int
        Blocks that were sent for fields.
    late : int
        How many of these began later than they named.
    slipped : int
        Turns at whose beginning the host was held up, so that the field before played on.
    pace : float
        Seconds between two poses while only ramps change.
    alternation : Alternation or None
        How the newest fields take turns; None before the first.
    """

    blocks: int
    late: int
    slipped: int
    pace: float
    alternation: Alternation | None

    @property
    def due(self) -> float:
        """Moment by the device's clock, in seconds, at which `keep` is to be called."""

    @property
    def most_frames(self) -> int:
        """Fields of a cycle, at most."""

    def show(self, cycle: PulseCycle) -> bool:
        """Play a cycle from now on; false if the line has no room, and the next turn will bring it.

        Raises
        ------
        DeviceError
            If the device refuses its fields, or the line fails.
        """

    def keep(self) -> None:
        """Do what is due: begin the next turn, or give a sign of life."""

    def silence(self) -> None:
        """Play nothing from now on; the outputs stay enabled."""

    def forget(self) -> None:
        """The device plays nothing: it has fallen silent by itself."""


def turns_for(device: Device, way: Way | None, watchdog: float) -> StreamedTurns | StoredTurns:
    """The turns that suit a way of rendering, a device and its line.

    Parameters
    ----------
    device : Device
        The device to play on.
    way : Way, optional
        Two fields that simply alternate can be streamed; any other way, and None for ``auto``, is stored.
    watchdog : float
        Seconds for which the device waits for a sign of life.
    """
    block_periods = ceil(CARRIER_HZ / device.most_updates_per_second)
    if isinstance(way, Halves) and way.envelope == "square":
        half = max(round(CARRIER_HZ / (2 * way.frequency)), 1)
        if LEAST_LEAD_PERIODS + RESERVE_PERIODS + block_periods <= half:
            return StreamedTurns(device, half, block_periods, watchdog)
    return StoredTurns(device, block_periods, watchdog)


class _Clocked:
    """What both have: the device's clock, and its signs of life."""

    def __init__(self, device: Device, block_periods: int, watchdog: float) -> None:
        self._device, self._block_periods = device, block_periods
        self.alternation: Alternation | None = None
        self._life_seconds = watchdog * LIFE
        self.blocks = self.late = self.slipped = 0
        self._clock = DeviceClock()
        self._read_at = -inf
        self._heard = -inf
        for _ in range(FIRST_READINGS):
            self._live()

    def _now(self) -> float:
        """Carrier period, with its fraction."""
        return self._clock.period_at(self._device.time.monotonic())

    def _live(self) -> None:
        """Give a sign of life, and read the device's clock."""
        before = self._device.time.monotonic()
        now = self._device.status().now
        self._read(before, now)

    def _read(self, before: float, tick: int) -> None:
        """Learn that the device's clock stood at a tick between a moment and now."""
        after = self._heard = self._device.time.monotonic()
        if after - self._read_at > READING_SECONDS or self._clock.uncertainty == inf:
            self._read_at = after
            self._clock.add(Reading(before, after, tick))

    def _count(self, before: float, ack: Ack, blocks: int) -> None:
        self.blocks += blocks
        self.late += bool(ack.flags & AckFlag.LATE)
        arrives = before + (self._block_periods - 1) / CARRIER_HZ  # its last byte; that is when the device looks
        self._read(arrives, ack.now)

    def silence(self) -> None:
        """Play nothing from now on; the outputs stay enabled."""
        self.forget()
        before = self._device.time.monotonic()
        self._count(before, self._device.silence(), 0)

    def forget(self) -> None:
        """The device plays nothing: it has fallen silent by itself."""


class StreamedTurns(_Clocked):
    """Updates as they come; see the module."""

    def __init__(self, device: Device, half: int, block_periods: int, watchdog: float) -> None:
        super().__init__(device, block_periods, watchdog)
        self.alternation, self._half = Alternation(half), half
        self.pace = max(min(half, MOST_PACE_PERIODS), 2 * BLOCKS_BESIDE * block_periods) / CARRIER_HZ
        self._lead = LEAST_LEAD_PERIODS + block_periods
        self._guard = self._lead + RESERVE_PERIODS
        self._cycle: PulseCycle | None = None
        self._sent = 0
        """The last turn for which a field was sent."""

    @property
    def due(self) -> float:
        """When the next turn must be on its way, or, in silence, the next sign of life."""
        if self._cycle is None:
            return self._heard + self._life_seconds
        return self._clock.moment_of((self._sent + 1) * self._half - self._guard) + ROUNDING_SECONDS

    @property
    def most_frames(self) -> int:
        """Two."""
        return 2

    def show(self, cycle: PulseCycle) -> bool:
        """Play two fields from now on."""
        begun = self._cycle is not None
        self._cycle = cycle
        now = self._now()
        if begun and self._turn(now) == self._sent and self._turn(now + self._block_periods - 1) > self._sent:
            return False  # this block would be in the way of the next turn's
        self._send(now, begun=begun)
        return True

    def keep(self) -> None:
        """Begin the next turn, or give a sign of life."""
        if self._cycle is None:
            self._live()
        elif self._turn(now := self._now()) > self._sent:
            self._send(now, begun=True)

    def forget(self) -> None:
        """The device plays nothing: it has fallen silent by itself."""
        self._cycle = None

    def _turn(self, now: float) -> int:
        """The turn in which a block begins to play, or for which it is kept, if it is sent now."""
        return floor((now + self._guard) / self._half)

    def _send(self, now: float, *, begun: bool) -> None:
        """Send the field whose turn it is when it arrives."""
        assert self._cycle is not None
        turn = self._turn(now)
        if begun:  # by a reading of the clock the host's estimate may go back by a little
            turn = max(turn, self._sent)
        begins = turn * self._half
        named = turn > self._sent and begins >= now + self._lead
        if begun:
            self.slipped += max(turn - self._sent - 1 + (turn > self._sent and begins < now), 0)
        self._sent = turn
        pulses = self._cycle.frames.pulses(turn % 2)
        before = self._device.time.monotonic()
        self._count(before, self._device.show(pulses, begins if named else NOW), 1)


class StoredTurns(_Clocked):
    """Slots in turn, which the device repeats; see the module."""

    def __init__(self, device: Device, block_periods: int, watchdog: float) -> None:
        super().__init__(device, block_periods, watchdog)
        self._pace(BLOCKS_BESIDE + 2)
        self._stops, self._set, self._envelope = device.stops, 0, 0.0
        self._begins = 0, 0
        """Periods from which the last two cycles play."""
        self._request = self._clock.longest * CARRIER_HZ
        """Carrier periods of a request and its answer, and so more than the error of the device's time."""

    def _pace(self, blocks: int) -> None:
        self.pace = max(MOST_PACE_PERIODS, blocks * self._block_periods) / CARRIER_HZ

    @property
    def due(self) -> float:
        """The next sign of life."""
        return self._heard + self._life_seconds

    @property
    def most_frames(self) -> int:
        """As many as the line carries in `STORING_SECONDS`, within `LEAST_FRAMES` and `MOST_FRAMES`."""
        carried = int(STORING_SECONDS * CARRIER_HZ / self._block_periods) - BLOCKS_BESIDE
        return min(max(carried, LEAST_FRAMES), MOST_FRAMES)

    def show(self, cycle: PulseCycle) -> bool:
        """Store a cycle beside the one that plays, and go on with it as soon as it is there."""
        waits = self._begins[0] + self._request - self._now()  # until then the oldest set plays, and for certain
        self._device.time.sleep(max(waits, 0.0) / CARRIER_HZ)
        slots, longest = self._store(cycle)
        if self._device.stops != self._stops:  # what follows would enable the outputs again
            raise DeviceRefusedError(f"{self._device.name} has turned its outputs off: it was stopped", Reason.DISABLED)
        self._modulate(cycle.envelope)
        before = self._device.time.monotonic()
        lead = LEAST_LEAD_PERIODS + RESERVE_PERIODS + BLOCKS_BESIDE * (longest + self._request)
        begins = max(ceil(self._now() + lead), self._begins[1] + 1)
        passed = _passed(self.alternation, begins, cycle.periods)
        self.alternation = Alternation(cycle.hold, (begins - passed) % cycle.periods, len(slots))
        ack = self._device.play(_rotated(slots, cycle.hold, passed), period=begins)
        self._begins = self._begins[1], ack.commit_period or begins
        blocks = len(set(slots)) + BLOCKS_BESIDE
        self._count(before, ack, blocks)
        self._pace(blocks)
        return True

    def _store(self, cycle: PulseCycle) -> tuple[list[int], float]:
        """Keep the fields that differ in slots: the slot of each field, and the periods that the slowest block took."""
        self._set = (self._set + 1) % SETS
        kept: dict[bytes, int] = {}
        slots, longest = [], 0.0
        for number, rows in enumerate(zip(*cycle.frames, strict=True)):
            slot = kept.get(field := np.concatenate(rows).tobytes())
            if slot is None:
                slot = kept[field] = self._set * MOST_FRAMES + len(kept)
                before = self._device.time.monotonic()
                self._device.store(slot, cycle.frames.pulses(number))
                longest = max(longest, self._device.time.monotonic() - before)
            slots.append(slot)
        return slots, longest * CARRIER_HZ

    def _modulate(self, envelope: float) -> None:
        """Let the device modulate whatever plays at a frequency in hertz, 0 for not at all."""
        if envelope == self._envelope:
            return
        if envelope:
            self._device.modulate(*sine(envelope))
        else:
            self._device.end_modulation()
        self._envelope = envelope

    def keep(self) -> None:
        """Give a sign of life."""
        self._live()

    def forget(self) -> None:
        """The device plays nothing, and modulates nothing: it has fallen silent by itself."""
        self._envelope = 0.0


def _passed(before: Alternation | None, begins: int, periods: int) -> int:
    """How many carrier periods of a cycle are over if it takes the place of another at a period."""
    if before is None:
        return begins % periods
    length = before.hold * before.count
    at = (begins - before.begins) % length
    return at if length == periods else at * periods // length


def _rotated(slots: Sequence[int], hold: int, passed: int) -> Iterator[tuple[int, int]]:
    """The steps of a cycle of which so many carrier periods are over."""
    first, over = divmod(passed, hold)
    whole = [(slot, hold) for slot in (*slots[first + 1 :], *slots[:first])]
    return split_steps([(slots[first], hold - over), *whole, (slots[first], over)])
