"""Two fields that take turns on a device, each for half of the modulation's period, while they keep changing.

Section 3.4 of the paper plays two fields in turn at 200 Hz; a hand that moves makes new ones up to a thousand times a
second. Three ways to the device were weighed:

- A sequence of two slots, which the device repeats by itself. What plays cannot be overwritten (clause BLK-022), so
  each pose costs two slots, entries and a sequence, stored beside those that play; and a sequence that keeps the phase
  begins at the start of a period of the modulation, so that a pose waits up to 5 ms at 200 Hz.
- One update per half, sent ahead of its boundary: a pose waits 2.5 ms for the next boundary.
- Updates as they come: each pose sends the field whose turn it is, to begin at once; and ahead of each boundary the
  other field is sent, named for that boundary.

`StreamedTurns` does the last. Whose turn it is follows from the device's own count of periods, t = ⌊P / half⌋, even or
odd, whatever was sent and when: so the modulation keeps its phase, also after the host was held up. A pose is on the
skin after one block (10 µs on USB) and three to five carrier periods; a pose that comes less than a lead before a
boundary, 0.5 ms on USB, begins with the boundary. 1000 poses/s make 1200 to 1400 blocks/s.

A line that cannot carry a block for each turn, such as a UART below some 3 Mbaud, and a modulation above 900 Hz leave
the turns to the device: `StoredTurns` is the first way, at the rate that the line has.
"""

from __future__ import annotations

from math import ceil, floor, inf
from typing import Protocol

from ...protocol.board import CARRIER_HZ
from ...protocol.codes import NOW, AckFlag
from ...protocol.quantise import PulseFrames
from ...protocol.replies import Ack
from ..playing.clock import DeviceClock, Reading
from ..playing.device import Device

__all__ = ["StoredTurns", "StreamedTurns", "Turns", "turns_for"]

LEAST_LEAD_PERIODS = 6
"""A change for the fifth period after its arrival is in time (clause BLK-005); one more for the way there."""
RESERVE_PERIODS = 14
"""0.35 ms, by which this program may be late for a boundary: a computer needs as long to wake up."""
FIRST_READINGS = 8
READING_SECONDS = 0.05
BLOCKS_PER_POSE = 4
"""Two slots, an entry table and a sequence."""
PAIRS = 3
"""Of slots: one plays, one waits for its period, one is free."""
MOST_PACE_PERIODS = 100
"""2.5 ms between two steps of a ramp."""
ROUNDING_SECONDS = 1e-6
"""So much after a turn is due it is due for certain, in spite of rounding."""
LIFE = 1 / 3
"""Of the watchdog's time may pass until the next sign of life."""


class Turns(Protocol):
    """Two fields in turn on a device.

    Attributes
    ----------
    blocks : int
        That were sent for fields.
    late : int
        Of these, changes that began later than they named.
    slipped : int
        Turns at whose beginning the host was held up, so that the field before played on.
    half : int
        Carrier periods for which each field plays.
    frequency : float
        Of the modulation as it comes out, in Hz.
    pace : float
        Seconds between two poses while only ramps change.
    """

    blocks: int
    late: int
    slipped: int
    half: int
    frequency: float
    pace: float

    @property
    def due(self) -> float:
        """Moment by the device's clock, in seconds, at which `keep` is to be called."""

    def show(self, fields: PulseFrames) -> bool:
        """Play two fields, (2, n), from now on; false if the line has no room, and the next turn will bring them.

        Raises
        ------
        DeviceError
            If the device refuses them, or the line fails.
        """

    def keep(self) -> None:
        """Do what is due: begin the next turn, or give a sign of life."""

    def silence(self) -> None:
        """Play nothing from now on; the outputs stay enabled."""

    def forget(self) -> None:
        """The device plays nothing: it has fallen silent by itself."""


def turns_for(device: Device, frequency: float, watchdog: float) -> StreamedTurns | StoredTurns:
    """The way that suits a device and its line.

    Parameters
    ----------
    device : Device
        To play on.
    frequency : float
        Of the modulation, in Hz; a turn lasts the nearest whole number of carrier periods.
    watchdog : float
        Seconds for which the device waits for a sign of life.

    Raises
    ------
    ValueError
        If the frequency is not possible.
    """
    half = round(CARRIER_HZ / (2 * frequency)) if 0 < frequency < inf else 0
    if not 1 <= half < 2**16:
        raise ValueError(f"a modulation of {frequency:g} Hz must lie between 0.31 and {CARRIER_HZ // 2} Hz")
    block_periods = ceil(CARRIER_HZ / device.most_updates_per_second)
    if LEAST_LEAD_PERIODS + RESERVE_PERIODS + block_periods <= half:
        return StreamedTurns(device, half, block_periods, watchdog)
    return StoredTurns(device, half, block_periods, watchdog)


class _Clocked:
    """What both ways have: the device's clock, and its signs of life."""

    def __init__(self, device: Device, half: int, block_periods: int, watchdog: float) -> None:
        self._device, self.half, self._block_periods = device, half, block_periods
        self._life_seconds = watchdog * LIFE
        self.frequency = CARRIER_HZ / (2 * half)
        self.pace = max(min(half, MOST_PACE_PERIODS), BLOCKS_PER_POSE * block_periods) / CARRIER_HZ
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
        super().__init__(device, half, block_periods, watchdog)
        self._lead = LEAST_LEAD_PERIODS + block_periods
        self._guard = self._lead + RESERVE_PERIODS
        self._fields: PulseFrames | None = None
        self._sent = 0
        """The last turn for which a field was sent."""

    @property
    def due(self) -> float:
        """When the next turn must be on its way, or, in silence, the next sign of life."""
        if self._fields is None:
            return self._heard + self._life_seconds
        return self._clock.moment_of((self._sent + 1) * self.half - self._guard) + ROUNDING_SECONDS

    def show(self, fields: PulseFrames) -> bool:
        """Play two fields from now on."""
        begun = self._fields is not None
        self._fields = fields
        now = self._now()
        if begun and self._turn(now) == self._sent and self._turn(now + self._block_periods - 1) > self._sent:
            return False  # this block would be in the way of the next turn's
        self._send(now, begun=begun)
        return True

    def keep(self) -> None:
        """Begin the next turn, or give a sign of life."""
        if self._fields is None:
            self._live()
        elif self._turn(now := self._now()) > self._sent:
            self._send(now, begun=True)

    def forget(self) -> None:
        """The device plays nothing: it has fallen silent by itself."""
        self._fields = None

    def _turn(self, now: float) -> int:
        """The turn in which a block begins to play, or for which it is kept, if it is sent now."""
        return floor((now + self._guard) / self.half)

    def _send(self, now: float, *, begun: bool) -> None:
        """Send the field whose turn it is when it arrives."""
        assert self._fields is not None
        turn = self._turn(now)
        if begun:  # by a reading of the clock the host's estimate may go back by a little
            turn = max(turn, self._sent)
        begins = turn * self.half
        named = turn > self._sent and begins >= now + self._lead
        if begun:
            self.slipped += max(turn - self._sent - 1 + (turn > self._sent and begins < now), 0)
        self._sent = turn
        pulses = self._fields.pulses(turn % 2)
        before = self._device.time.monotonic()
        self._count(before, self._device.show(pulses, begins if named else NOW), 1)


class StoredTurns(_Clocked):
    """Two slots in turn, which the device repeats; see the module."""

    def __init__(self, device: Device, half: int, block_periods: int, watchdog: float) -> None:
        super().__init__(device, half, block_periods, watchdog)
        self._pair = 0

    @property
    def due(self) -> float:
        """The next sign of life."""
        return self._heard + self._life_seconds

    def show(self, fields: PulseFrames) -> bool:
        """Store two fields, and play them in turn from the start of a period of the modulation on."""
        self._pair = (self._pair + 1) % PAIRS
        slots = 2 * self._pair, 2 * self._pair + 1
        before = self._device.time.monotonic()
        for number, slot in enumerate(slots):
            self._device.store(slot, fields.pulses(number))
        whole = 2 * self.half
        ready = self._now() + LEAST_LEAD_PERIODS + RESERVE_PERIODS + BLOCKS_PER_POSE * self._block_periods
        steps = [(slot, self.half) for slot in slots]
        ack = self._device.play(steps, period=ceil(ready / whole) * whole)
        self._count(before, ack, BLOCKS_PER_POSE)
        return True

    def keep(self) -> None:
        """Give a sign of life."""
        self._live()
