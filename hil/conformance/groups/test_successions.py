"""Successions: a sequence and the next change, unattended playing and the watchdog, a change and the next."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import check_play, check_silent
from phasewire.hil.conformance.tools.forge import forged
from phasewire.hil.conformance.tools.planning import (
    APART,
    PLACE,
    SAMPLE,
    SETTLED,
    check_rest,
    some_time,
    store_for_plans,
)
from phasewire.hil.conformance.tools.player import check_in_time, soon
from phasewire.hil.conformance.tools.playing import play, start, told
from phasewire.hil.conformance.tools.steps import LONG_MS, SILENT, enable, expect_all, require, store_entry
from phasewire.hil.conformance.tools.watchdog import PERIODS_PER_MS, TICKS_PER_MS, await_firing, check_not_yet, patience
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Change,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.board import TICKS_PER_PERIOD
from phasewire.protocol.codes import (
    PROMISED_PERIODS,
    SILENT_PERIODS,
    Action,
    Feature,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.replies import Status

UNATTENDED = Feature.SEQUENCES | Feature.UNATTENDED
SLOT = 9
SHORT_MS = 10


# A sequence, and what takes its place


def by_silence(bench: Bench, period: int) -> int:
    """End what plays by SILENCE, then begin an update."""
    bench.must(Output(Action.SILENCE, period))
    return bench.must(Update(bench.weak(), period + APART)).commit_period


SUCCESSORS: dict[str, tuple[Callable[[Bench, int], int], State]] = {
    "update": (lambda bench, at: bench.must(Update(bench.weak(), at)).commit_period, State.PLAYING),
    "silence-and-update": (by_silence, State.PLAYING),
    "sequence": (lambda bench, at: bench.must(PlaySequence(PLACE + 1, 1, at)).commit_period, State.PLAYING),
    "unattended-sequence": (
        lambda bench, at: bench.must(PlaySequence(PLACE + 1, 1, at, unattended=True)).commit_period,
        State.UNATTENDED,
    ),
}
"""What can replace a sequence at a period; each returns the period at which what plays then began."""


def check_successor(bench: Bench, by: str, unattended: bool, at: Callable[[int, int], int]) -> None:
    """Replace a sequence during its time; fails unless the replacement plays on after that time."""
    successor, state = SUCCESSORS[by]
    needed = UNATTENDED if unattended or state is State.UNATTENDED else Feature.SEQUENCES
    require(bench, needed)
    store_entry(bench, some_time(bench) // 2, PLACE)
    store_entry(bench, 7, PLACE + 1)
    enable(bench)
    began = bench.must(PlaySequence(PLACE, 1, repeats=2, unattended=unattended)).commit_period
    ends = began + 2 * (some_time(bench) // 2)
    replaced = at(began, ends)
    since = successor(bench, replaced)
    if not replaced <= since <= replaced + APART:
        raise TooSlow("this line is too slow: the sequence was over before something could replace it")
    bench.unasked.clear()
    bench.wait_until(max(since, ends) + SETTLED)
    status = bench.status()
    expect_all(status, " after the time of what was replaced", state=state, since_period=since)
    sequence = StatusFlag(0) if "update" in by else StatusFlag.SEQUENCE
    expect_all(status, flags=sequence, free=bench.info.queue_blocks)


every_successor = pytest.mark.parametrize("by", SUCCESSORS)
attended_or_not = pytest.mark.parametrize("unattended", [False, True], ids=["attended", "unattended"])


@attended_or_not
@every_successor
@case("STA-003", "BLK-012", "BLK-015", "ACK-006", features=Feature.SEQUENCES)
def test_a_sequence_that_was_replaced_does_not_end(bench: Bench, by: str, unattended: bool) -> None:
    """After the time of a replaced sequence has passed what plays goes on, and no record comes."""
    check_successor(bench, by, unattended, lambda began, ends: (began + ends) // 2)
    expect("the unsolicited records", [status.state for status in told(bench)], [])


@attended_or_not
@every_successor
@case("STA-003", "BLK-012", "BLK-015", "SAF-003", "SAF-005", features=Feature.SEQUENCES)
def test_what_begins_as_a_sequence_ends_goes_on(bench: Bench, by: str, unattended: bool) -> None:
    """A change for the very period after a sequence's last repeat begins there, and goes on.

    The watchdog then runs if what plays needs its host, and rests if it does not.
    """
    check_successor(bench, by, unattended, lambda _, ends: ends)
    told(bench)
    bench.order(Request.WATCHDOG, SHORT_MS)
    if SUCCESSORS[by][1] is State.UNATTENDED:
        bench.wait(3 * SHORT_MS / 1000)
        expect("the records while the watchdog rests", [status.state for status in told(bench)], [])
    else:
        expect("the state in the record after the watchdog has fired", bench.await_unasked(1).state, State.OFF)


@attended_or_not
@case("STA-003", "BLK-015", "ACK-006", features=Feature.SEQUENCES)
def test_a_sequence_that_begins_anew_ends_once(bench: Bench, unattended: bool) -> None:
    """A sequence with repeats that replaces itself ends after its second run, and this is reported once."""
    require(bench, UNATTENDED if unattended else Feature.SEQUENCES)
    lasts = some_time(bench) // 2
    store_entry(bench, lasts, PLACE)
    enable(bench)
    began = bench.must(PlaySequence(PLACE, 1, repeats=1, unattended=unattended)).commit_period
    again = began + lasts // 2
    if bench.must(PlaySequence(PLACE, 1, again, repeats=1, unattended=unattended)).commit_period != again:
        raise TooSlow("this line is too slow: the first run was over before the second could be queued")
    bench.wait_until(again + lasts + SETTLED)
    check_rest(bench.status(), bench, State.READY, "after both runs")
    ends = [(status.state, status.now // TICKS_PER_PERIOD) for status in told(bench)]
    expect("the states of the unsolicited records, and their periods", ends, [(State.READY, again + lasts)])


# What plays unattended, and the watchdog


def over_unattended(bench: Bench, body: Body) -> None:
    """Send a block that is accepted, and wait until it has taken effect."""
    ack = bench.must(body)
    bench.wait_until(max(ack.commit_period, ack.now_period) + 1)


def modulate(bench: Bench, *, ends: bool = False) -> None:
    """Begin and end a modulation."""
    require(bench, Feature.MODULATION)
    bench.must(Samples(bytes([SAMPLE]), PLACE))
    over_unattended(bench, AmplitudeModulation(PLACE, 1, 1))
    if ends:
        over_unattended(bench, Output(Action.END_MODULATION))


def follow(bench: Bench) -> None:
    """Begin another unattended sequence."""
    store_entry(bench, 7, PLACE + 1)
    over_unattended(bench, PlaySequence(PLACE + 1, 1, unattended=True))


DISTURBANCES: dict[str, Callable[[Bench], object]] = {
    "modulation": modulate,
    "end-of-modulation": lambda bench: modulate(bench, ends=True),
    "another-unattended-sequence": follow,
    "no-op": lambda bench: over_unattended(bench, NoOp()),
    "store": lambda bench: store_entry(bench, 7, PLACE + 1),
    "queued-update": lambda bench: bench.must(Update(SILENT, bench.period() + LONG_MS * PERIODS_PER_MS)),
    "late-end-of-modulation": lambda bench: over_unattended(bench, Output(Action.END_MODULATION, 1)),
    "refused-block": lambda bench: bench.send_raw(forged(pack(bench.numbered(NoOp())), checksum=1)),
    "new-numbering": lambda bench: bench.must(NoOp(), restart=True),
    "status": lambda bench: bench.status(),
    "enable": lambda bench: bench.enable(),
    "clear-faults": lambda bench: bench.order(Request.CLEAR_FAULTS),
}
"""Actions that end no sequence."""


@pytest.mark.parametrize("what", DISTURBANCES)
@pytest.mark.parametrize("set_before", [False, True], ids=["watchdog-after", "watchdog-before"])
@case("SAF-005", "SAF-003", "STA-003", features=UNATTENDED)
def test_nothing_but_its_end_starts_the_watchdog_of_what_plays_unattended(
    bench: Bench, what: str, set_before: bool
) -> None:
    """Whatever is sent, accepted or takes effect over an unattended sequence, the watchdog rests until it ends."""
    enable(bench)
    field = start(bench, "unattended")
    if set_before:
        bench.order(Request.WATCHDOG, SHORT_MS)
    DISTURBANCES[what](bench)
    if not set_before:
        bench.order(Request.WATCHDOG, SHORT_MS)
    came = [record for record in bench.listen(4 * SHORT_MS / 1000) if isinstance(record, Status)]
    expect("the unsolicited records", [*bench.unasked, *came], [])
    status = bench.status()
    expect("the state", status.state, State.UNATTENDED)
    assert not status.watchdog_fired, "the watchdog fired while a sequence played unattended"
    if what != "another-unattended-sequence":
        expect("what plays since", status.since_period, field.period)


def beginning(kind: str, period: int) -> Change:
    """A change of a kind, for a period."""
    match kind:
        case "update":
            return Update(SILENT, period)
        case "sequence":
            return PlaySequence(PLACE, 1, period)
        case "modulation":
            return AmplitudeModulation(PLACE, 1, 1, period)
        case "end-of-modulation":
            return Output(Action.END_MODULATION, period)
    return Output(Action.SILENCE, period)


NEEDED = {"sequence": Feature.SEQUENCES, "modulation": Feature.MODULATION, "end-of-modulation": Feature.MODULATION}


@pytest.mark.parametrize("kind", ["update", "sequence", "modulation", "end-of-modulation", "silence"])
@case("SAF-003", "BLK-005")
def test_what_takes_effect_is_no_sign_of_life(bench: Bench, kind: str) -> None:
    """A queued change that takes effect is no sign of life: its acceptance was."""
    ms = patience(bench)
    require(bench, NEEDED.get(kind, Feature(0)))
    store_for_plans(bench)
    enable(bench)
    play(bench)
    at = bench.period() + ms * PERIODS_PER_MS // 2
    last = bench.must(beginning(kind, at))
    check_in_time(last, at)
    bench.order(Request.WATCHDOG, ms)
    check_not_yet(bench, at * TICKS_PER_PERIOD)
    await_firing(bench, last.now, last.now, ms)


# The shortest notice for a change


def restart_sequence(bench: Bench, unattended: bool) -> None:
    """Play a sequence, with nothing queued or on the chain."""
    ack = bench.must(PlaySequence(PLACE, 2, unattended=unattended))
    bench.wait_until(ack.commit_period + 2)


@attended_or_not
@pytest.mark.parametrize("modulated", [False, True], ids=["plain", "modulated"])
@pytest.mark.parametrize("kind", ["update", "sequence", "silence"])
@case("BLK-005/2", "BLK-005/1", features=Feature.SEQUENCES)
def test_the_fifth_period_is_promised_while_a_sequence_plays(
    bench: Bench, kind: str, modulated: bool, unattended: bool
) -> None:
    """A change five periods after its block's arrival is in time even while a sequence plays, modulated or not."""
    require(bench, UNATTENDED if unattended else Feature.SEQUENCES)
    bench.must(Slot(SLOT, bench.weak()))
    bench.must(Entries((Entry(SLOT, 1), Entry(SLOT, 2)), PLACE))
    enable(bench)
    if modulated:
        require(bench, Feature.MODULATION)
        bench.must(Samples(bytes([SAMPLE, 255]), PLACE))
    wanted = bench.tries(4, 1, 60)
    rounds = 20 * wanted
    hits, latency = 0, PROMISED_PERIODS
    for _ in range(rounds):
        if modulated:
            bench.must(AmplitudeModulation(PLACE, 2, 1))
        restart_sequence(bench, unattended)
        bench.wait_periods(bench.random.random())
        asked = bench.period()
        period = asked + latency + PROMISED_PERIODS
        ack = bench.send(beginning(kind, period))  # which may come late here: then it is tried again
        expect("the reason", ack.reason, Reason.ACCEPTED)
        lead = period - ack.now_period
        latency = ack.now_period - asked
        hits += lead == PROMISED_PERIODS
        if lead >= PROMISED_PERIODS:
            expect(f"LATE of a change {lead} periods ahead, whose block came at tick {ack.now}", ack.late, False)
            expect("the commit period", ack.commit_period, period)
        if hits == wanted:
            return
    if not hits:
        raise Inconclusive(f"in {rounds} attempts no block came exactly {PROMISED_PERIODS} periods ahead of its change")


# Changes that are on the chain when the outputs are disabled

CHAIN_TICKS = 3 * TICKS_PER_PERIOD
"""The greatest lead with which a change goes onto the chain before its period (chapter BUD)."""
TRIES = 100


def fire_over_the_chain(bench: Bench, change: Callable[[int], Change]) -> tuple[int, int]:
    """Let the watchdog fire within `CHAIN_TICKS` before the period of a change; returns that of silence, and that.

    It fires a whole number of milliseconds after the last sign of life, so the right moment must be met.
    """
    due = soon(bench, 2 * TRIES)
    check_in_time(bench.must(change(due)), due)
    for _ in range(TRIES):
        ms, rest = divmod(due * TICKS_PER_PERIOD - bench.status().now, TICKS_PER_MS)
        if ms < SHORT_MS:
            break
        if 0 < rest <= CHAIN_TICKS:
            bench.order(Request.WATCHDOG, ms)
            fired = bench.await_unasked(ms / 1000 + 1)
            expect("the state in the record after the watchdog has fired", fired.state, State.OFF)
            if fired.now >= due * TICKS_PER_PERIOD:
                break
            bench.order(Request.WATCHDOG, LONG_MS)
            return fired.now // TICKS_PER_PERIOD + SILENT_PERIODS + 1, due
        bench.wait_periods(PERIODS_PER_MS * bench.random.random())
    raise Inconclusive("no sign of life came a whole number of milliseconds before the change went onto the chain")


BEGINNINGS: dict[str, Callable[[Bench], Callable[[int], Change]]] = {
    "update": lambda bench: partial(Update, bench.weak()),
    "sequence": lambda _: partial(PlaySequence, PLACE, 1),
}


@pytest.mark.parametrize("what", BEGINNINGS)
@case("SAF-004/1", "STA-001", "SAF-003", needs=(Need.CAPTURE,))
def test_no_output_moves_for_what_was_on_the_chain(bench: Bench, what: str) -> None:
    """If the watchdog fires while only a change on the chain is about to play, that change is silenced too."""
    if what == "sequence":
        require(bench, Feature.SEQUENCES)
    store_for_plans(bench)
    enable(bench)
    since, due = fire_over_the_chain(bench, BEGINNINGS[what](bench))
    bench.judge(since, max(since, due) + SETTLED, check_silent)


@case("SAF-004", "BLK-017", needs=(Need.CAPTURE,), features=Feature.MODULATION)
def test_no_modulation_outlives_disable_that_was_on_the_chain(bench: Bench) -> None:
    """A modulation that is on the chain when the watchdog fires does not modulate what plays after the next ENABLE."""
    store_for_plans(bench)
    enable(bench)
    play(bench)
    fire_over_the_chain(bench, partial(AmplitudeModulation, PLACE, 1, 1))
    bench.enable()
    field = play(bench)
    bench.wait_until(field.period + SETTLED)
    bench.judge(field.period, field.period + SETTLED, lambda seen: check_play(seen, [(field.period, field.words)]))
