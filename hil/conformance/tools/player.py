"""The player: it sends what shall play, and holds the score of what must play by the words of SPEC.md.

A case sends blocks through a `Player`, which checks the acknowledgements and writes the `Score`; then the outputs are
judged by the score. This module does not know how a device makes its outputs.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import accumulate
from math import ceil
from typing import Generic, TypeVar

from ....protocol.blocks import (
    AmplitudeModulation,
    Body,
    Change,
    Entries,
    Entry,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from ....protocol.board import CARRIER_HZ, CHANNELS
from ....protocol.codes import NOW, PROMISED_PERIODS, Action, Reason, Request
from ....protocol.pulses import Pulses
from ....protocol.replies import Ack
from ....protocol.wiring import Wiring
from ..bench import Bench
from ..cases import TooSlow
from ..sight.capture import Seen
from ..sight.waveforms import Words, check_play, expected_words, modulated

PATIENCE_MS = 60_000
"""The longest watchdog time (clause REQ-009)."""
LATENCY_PERIODS = 2000
"""Time of a host, its drivers and the line besides carrying the blocks: 50 ms."""
FAST_PERIODS = 20
"""A USB line carries a block in this time even at full speed."""
SERIAL_BLOCK_BYTES = 600
"""A block's frame, its acknowledgement's, and pauses."""
FULL = 255
FOREVER = 2**62

Item = TypeVar("Item")


def block_periods(bench: Bench) -> int:
    """The periods that the line needs for a block, on a serial one with its acknowledgement."""
    if bench.line.kind == "usb":
        return FAST_PERIODS
    return ceil((bench.serial.transit(SERIAL_BLOCK_BYTES) + bench.serial.latency) * CARRIER_HZ)


def is_fast(bench: Bench) -> bool:
    """Whether the line is fast enough for thousands of blocks."""
    return block_periods(bench) <= FAST_PERIODS


def soon(bench: Bench, blocks: int = 1) -> int:
    """A period before which so many blocks, if sent now, have certainly arrived."""
    return bench.period() + bench.slowness * (LATENCY_PERIODS + blocks * block_periods(bench))


@contextmanager
def in_time(bench: Bench, period: int) -> Iterator[None]:
    """The statements here must end before a period begins; inconclusive if the host or the line was too slow."""
    failure: Exception | None = None
    try:
        yield
    except Exception as error:  # slowness may have caused it; a signal was not
        failure = error
    if (now := bench.period()) >= period:
        raise TooSlow(f"what had to be over before period {period} was over in period {now}: a slow line") from failure
    if failure is not None:
        raise failure


@dataclass(frozen=True)
class _Loop(Generic[Item]):
    """Items one after the other, each for its periods, and again from the first: so many times, or for ever."""

    begin: int
    items: Sequence[Item]
    ends: Sequence[int]
    repeats: int = 0

    def at(self, period: int) -> tuple[Item | None, int]:
        """The item of a period, None after the last repeat, and the first period after it."""
        total = self.ends[-1]
        played, place = divmod(period - self.begin, total)
        if self.repeats and played >= self.repeats:
            return None, FOREVER
        number = bisect_right(self.ends, place)
        return self.items[number], period - place + self.ends[number]


def _loop(begin: int, items: Iterable[tuple[Item, int]], repeats: int = 0) -> _Loop[Item]:
    known = list(items)
    return _Loop(begin, [item for item, _ in known], list(accumulate(periods for _, periods in known)), repeats)


class Score:
    """What must play in each period."""

    def __init__(self, wiring: Wiring) -> None:
        self._wiring = wiring
        self._silence = Pulses.silent(CHANNELS)
        self._played: list[_Loop[Pulses]] = [_loop(0, [(self._silence, FOREVER)])]
        self._modulating: list[_Loop[int]] = [_loop(0, [(FULL, FOREVER)])]
        self._words: dict[tuple[int, int], Words] = {}

    def play(self, begin: int, items: Iterable[tuple[Pulses, int]], repeats: int = 0) -> None:
        """From a period on play pulses, each for its periods; the period must be later than all before."""
        self._played.append(_loop(begin, items, repeats))

    def update(self, begin: int, pulses: Pulses) -> None:
        """From a period on play pulses until something else begins."""
        self.play(begin, [(pulses, FOREVER)])

    def modulate(self, begin: int, samples: Iterable[int], hold: int) -> None:
        """From a period on modulate what plays."""
        self._modulating.append(_loop(begin, [(sample, hold) for sample in samples]))

    def end_modulation(self, begin: int) -> None:
        """From a period on modulate no longer."""
        self.modulate(begin, [FULL], FOREVER)

    def silence(self, begin: int) -> None:
        """From a period on play and modulate nothing."""
        self.update(begin, self._silence)
        self.end_modulation(begin)

    def at(self, period: int) -> tuple[Pulses, int, int]:
        """The pulses of a period, the sample that modulates them, and the period of the next change."""
        play, next_play = _current(self._played, period)
        modulation, next_modulation = _current(self._modulating, period)
        pulses, pulses_end = play.at(period)
        sample, sample_end = modulation.at(period)
        assert sample is not None
        return pulses or self._silence, sample, min(pulses_end, sample_end, next_play, next_modulation)

    def steps(self, first: int, last: int) -> list[tuple[int, Words]]:
        """The expected outputs from a period to another, not included, as `check_play` takes them."""
        steps = []
        while first < last:
            pulses, sample, end = self.at(first)
            steps.append((first, self._expected(pulses, sample)))
            first = end
        return steps

    def check(self, seen: Seen) -> None:
        """Fail if the observed outputs differ."""
        check_play(seen, self.steps(seen.first_period, seen.last_period))

    def _expected(self, pulses: Pulses, sample: int) -> Words:
        key = id(pulses), sample
        if key not in self._words:
            self._words[key] = expected_words(pulses if sample == FULL else modulated(pulses, sample), self._wiring)
        return self._words[key]


def _current(loops: list[_Loop[Item]], period: int) -> tuple[_Loop[Item], int]:
    """What began last, and when the next begins."""
    after = bisect_right(loops, period, key=lambda loop: loop.begin)
    return loops[after - 1], loops[after].begin if after < len(loops) else FOREVER


class Player:
    """An enabled device whose watchdog does not interfere, and the score of all accepted blocks."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.score = Score(bench.wiring)
        self._slots: dict[int, Pulses] = {}
        self._entries: dict[int, Entry] = {}
        self._samples: dict[int, int] = {}
        bench.order(Request.WATCHDOG, PATIENCE_MS)
        bench.enable()

    def soon(self, blocks: int = 1) -> int:
        """A period before which so many blocks, if sent now, have certainly arrived."""
        return soon(self.bench, blocks)

    def begin(self, change: Change, blocks: int = 1) -> int:
        """Send a change for a period before which so many blocks have certainly arrived; returns that period."""
        period = self.soon(blocks)
        self.send(replace(change, period=period))
        return period

    def send(self, body: Body) -> Ack:
        """Send a block that must be accepted and, if it names a period far enough ahead, be in time."""
        return self.send_all([body])[0]

    def send_all(self, bodies: Iterable[Body]) -> list[Ack]:
        """Send such blocks in one go."""
        known = list(bodies)
        acks = self.bench.send_all(known)
        for body, ack in zip(known, acks, strict=True):
            self.follow(body, ack)
            if isinstance(body, Change):
                check_in_time(ack, body.period)
        return acks

    def follow(self, body: Body, ack: Ack) -> None:
        """Enter a block, which must be accepted and may be late, into the score."""
        name = body.KIND.name
        assert ack.reason is Reason.ACCEPTED, f"{name} is refused with {ack.reason.name}"
        begin = ack.commit_period
        match body:
            case Slot():
                self._slots[body.number] = body.pulses
            case Entries():
                self._entries.update(enumerate(body.entries, body.first))
            case Samples():
                self._samples.update(enumerate(body.samples, body.first))
            case Update():
                self.score.update(begin, body.pulses)
            case PlaySequence():
                entries = [self._entries[place] for place in range(body.first, body.first + body.count)]
                self.score.play(begin, [(self._slots[slot], periods) for slot, periods in entries], body.repeats)
            case AmplitudeModulation():
                samples = [self._samples[place] for place in range(body.first, body.first + body.count)]
                self.score.modulate(begin, samples, body.hold)
            case Output(action=Action.END_MODULATION):
                self.score.end_modulation(begin)
            case Output():
                self.score.silence(begin)
            case _:
                pass

    def judge(self, first: int, last: int) -> None:
        """Judge the outputs by the score, from a period to another, not included."""
        self.bench.judge(first, last, self.score.check)


def check_in_time(ack: Ack, named: int) -> None:
    """Fail unless an accepted change takes effect at its named period or, without one, after its arrival.

    It is inconclusive if its block arrived too late for that promise.
    """
    assert ack.commit_period > ack.now_period, (
        f"a change takes effect at period {ack.commit_period}, its block had arrived in period {ack.now_period}"
    )
    if named == NOW:
        assert not ack.late, "a change as soon as possible is reported as late"
    elif ack.late and ack.now_period + PROMISED_PERIODS > named:
        raise TooSlow(f"the block for period {named} had arrived in period {ack.now_period}: a slow line")
    else:
        assert not ack.late, (
            f"a change for period {named} is reported as late, though its block had arrived in period {ack.now_period}"
        )
        assert ack.commit_period == named, f"a change for period {named} takes effect at period {ack.commit_period}"
