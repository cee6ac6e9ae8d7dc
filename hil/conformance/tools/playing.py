"""A device that plays and falls silent: steps of several groups, and their observations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ....emulator.faults import HotBoard
from ....protocol.blocks import (
    AmplitudeModulation,
    Body,
    Entries,
    Entry,
    NoOp,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
)
from ....protocol.board import CARRIER_HZ, PROCESSORS, PROCESSORS_PER_BOARD, TICKS_PER_PERIOD
from ....protocol.codes import SILENT_PERIODS, Feature, Request, State
from ....protocol.pulses import Pulses
from ....protocol.replies import Status
from ..bench import Bench
from ..cases import Inconclusive, expect
from ..sight.capture import Seen
from ..sight.waveforms import SILENCE, Words, check_play, check_silent, expected_words, modulated
from .forge import forged
from .steps import LONG_MS, require

SAMPLE = 128
SLOT, PLACE = 7, 5
CLOCK_ERROR = 0.01
"""The greatest difference between the clocks of host and device."""
OFF_PERIODS = 400
"""10 ms, within which the outputs are off after the bus fell silent (clause USB-020)."""
HOT_C, HOT_PERIODS = 90, 20_000
"""A fault that must end, but be seen before on any line."""
ROUND_SECONDS = 0.012
"""Time in which the controller asks every processor (clause CHN-017) and gets the answers."""


@dataclass(frozen=True, eq=False)
class Played:
    """Something that plays: pulses as the host sent them, the outputs in each period, and the period of the first."""

    pulses: Pulses
    words: Words
    period: int


def play(bench: Bench, pulses: Pulses | None = None) -> Played:
    """Play an update, some weak one by default, and wait until it plays."""
    return _play(bench, pulses or bench.weak(), Update)


def start(bench: Bench, what: str) -> Played:
    """Play one of `PLAYS`, whose outputs are the same in all periods, and wait until it plays."""
    return PLAYS[what](bench)


def reach(bench: Bench, state: State, share: float = 1.0) -> Played | None:
    """Bring the device from OFF to a state, with a long watchdog time; returns what plays, by a share of the drive."""
    bench.must(NoOp())
    bench.order(Request.WATCHDOG, LONG_MS)
    if state is not State.OFF:
        bench.enable()
    played = None
    if state is State.PLAYING:
        played = play(bench, bench.weak(share))
    if state is State.UNATTENDED:
        played = _sequence(bench, unattended=True, share=share)
    expect_state(bench, state)
    bench.unasked.clear()
    return played


def heat(bench: Bench, periods: int | None = None) -> None:
    """Overheat a board, for some periods or for good, and wait until the controller knows (clause CHN-017)."""
    bench.levers.cause(HotBoard(board=bench.random.randrange(bench.info.boards), celsius=HOT_C, periods=periods))
    bench.wait(ROUND_SECONDS)


def expect_state(bench: Bench, state: State) -> None:
    """Fail unless all reports agree on a state; a refused block asks for it without effect."""
    (ack,) = bench.send_raw(forged(pack(bench.numbered(NoOp())), magic=0))
    expect("the state in an acknowledgement", ack.state, state)
    expect("the state in the status", bench.status().state, state)


def _play(bench: Bench, pulses: Pulses, change: Callable[[Pulses], Body]) -> Played:
    ack = bench.must(change(pulses))
    bench.wait_until(ack.commit_period + 1)
    return Played(pulses, expected_words(pulses, bench.wiring), ack.commit_period)


def _modulated(bench: Bench) -> Played:
    require(bench, Feature.MODULATION)
    bench.must(Samples(bytes([SAMPLE])))
    pulses = play(bench).pulses
    ack = bench.must(AmplitudeModulation(first=0, count=1, hold=3))
    bench.wait_until(ack.commit_period + 1)
    return Played(pulses, expected_words(modulated(pulses, SAMPLE), bench.wiring), ack.commit_period)


def _sequence(bench: Bench, *, unattended: bool = False, share: float = 1.0) -> Played:
    require(bench, Feature.SEQUENCES | (Feature.UNATTENDED if unattended else Feature(0)))
    pulses = bench.weak(share)
    bench.must(Slot(SLOT, pulses))
    bench.must(Entries((Entry(SLOT, 3),), PLACE))
    return _play(bench, pulses, lambda _: PlaySequence(PLACE, 1, unattended=unattended))


PLAYS: Mapping[str, Callable[[Bench], Played]] = MappingProxyType(
    {
        "update": play,
        "modulated": _modulated,
        "sequence": _sequence,
        "unattended": lambda bench: _sequence(bench, unattended=True),
    }
)
"""What can play, by name."""


def told(bench: Bench) -> list[Status]:
    """The unsolicited records, in order."""
    came = bench.listen()
    statuses, bench.unasked = [*bench.unasked, *(record for record in came if isinstance(record, Status))], []
    return statuses


def judge_silence_since(bench: Bench, began: float) -> None:
    """Judge that all outputs are low from 10 ms after a time of the line's clock until now."""
    passed = bench.line.time.monotonic() - began
    last = bench.period()
    first = last - int(CARRIER_HZ * passed * (1 - CLOCK_ERROR)) + OFF_PERIODS + 1
    bench.judge(first, last, check_silent)


def silent_from(seen: Seen) -> int:
    """The period from which all observed outputs are low, to the end of what was seen."""
    loud = np.flatnonzero((seen.words & seen.observed).any(axis=1))
    return seen.first_period + (int(loud[-1]) // TICKS_PER_PERIOD + 1 if loud.size else 0)


def check_falls_silent(seen: Seen, words: Words, first_tick: int, last_tick: int) -> None:
    """Fail unless all outputs fall silent at one boundary, after an event at one of some ticks (clause SAF-004).

    They must play these words in every period before, and be low in every one after. It is inconclusive if none of the
    observed outputs plays.
    """
    if not (words & seen.observed).any():
        raise Inconclusive("none of the observed outputs was driven")
    since = silent_from(seen)
    earliest = -(-first_tick // TICKS_PER_PERIOD)
    latest = last_tick // TICKS_PER_PERIOD + SILENT_PERIODS
    assert earliest <= since <= latest, (
        f"the outputs are silent from period {since} on, should be from one of {earliest} to {latest} on"
    )
    check_play(seen, [(seen.first_period, words), (since, SILENCE)])


def _silent_since(first_period: int, loud: NDArray[np.bool_]) -> int | None:
    """The period from which a processor is silent, given whether it is in each; None if it always is."""
    return first_period + int(np.flatnonzero(loud)[-1]) + 1 if loud.any() else None


def check_falls_one_by_one(seen: Seen, words: Words, earliest: Sequence[int], latest: Sequence[int]) -> None:
    """Fail unless the outputs of each processor fall silent at a boundary of its own.

    Before they must play these words. Each of the ten may be silent from its earliest period on, must from its latest.
    """
    loud = np.asarray((seen.words & seen.observed).reshape(-1, TICKS_PER_PERIOD, PROCESSORS).any(axis=1))
    since = [_silent_since(seen.first_period, loud[:, place]) for place in range(PROCESSORS)]
    for place, period in enumerate(since):
        board, number = divmod(place, PROCESSORS_PER_BOARD)
        assert period is None or earliest[place] <= period <= latest[place], (
            f"processor {number} of board {board} is silent from period {period} on, should be from one of "
            f"{earliest[place]} to {latest[place]} on"
        )
    steps, playing = [(seen.first_period, words)], words.copy()
    for period in sorted({period for period in since if period is not None and period < seen.last_period}):
        playing = playing.copy()
        playing[:, [place for place in range(PROCESSORS) if since[place] == period]] = 0
        steps.append((period, playing))
    check_play(seen, steps)
