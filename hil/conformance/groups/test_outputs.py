"""Endings, blocks without an effect, and that no change takes effect while the outputs are off (chapter BLK)."""

from __future__ import annotations

from itertools import pairwise

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import SILENCE, Words, check_play, expected_words, modulated
from phasewire.hil.conformance.tools.player import check_in_time, in_time
from phasewire.hil.conformance.tools.steps import (
    SILENT,
    Wrong,
    begin,
    check_same,
    enable,
    expect_all,
    far,
    features_of,
    forge,
    later,
    let_stores_go,
    refuse,
    require,
)
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.codes import SYNC_PERIODS, AckFlag, Action, Feature, Reason, Request, State, StatusFlag
from phasewire.protocol.pulses import Pulses

FEATURES = Feature.SEQUENCES | Feature.MODULATION
SAMPLE = 0x60

ended = pytest.mark.parametrize("action", list(Action), ids=lambda action: action.name.lower().replace("_", "-"))


def play_modulated(bench: Bench) -> tuple[Pulses, int]:
    """Play an update under one sample, with a slot and an entry for more; returns the update and its period."""
    begin(bench)
    pulses = bench.weak()
    bench.must(Slot(4, bench.weak(0.5)))
    bench.must(Entries((Entry(4, 7),), 30))
    bench.must(Samples(bytes([SAMPLE]), 40))
    let_stores_go(bench)
    bench.must(Update(pulses))
    return pulses, bench.must(AmplitudeModulation(40, 1, 9)).commit_period


# OUTPUT


@case("BLK-018", "BLK-012", outputs=("BLK-018", "BLK-012"), features=FEATURES)
@ended
def test_an_output_ends_at_its_period(bench: Bench, action: Action) -> None:
    """From its period END_MODULATION leaves the update unmodulated; SILENCE and DISABLE leave silence."""
    pulses, since = play_modulated(bench)
    named = later(bench)
    ack = bench.must(Output(action, named))
    check_in_time(ack, named)
    bench.wait_until(named + 1)
    status = bench.status()
    plays = action is Action.END_MODULATION
    states = {Action.END_MODULATION: State.PLAYING, Action.SILENCE: State.READY, Action.DISABLE: State.OFF}
    expect_all(status, " in STATUS", state=states[action], flags=StatusFlag(0))
    expect("whether something plays since a period", bool(status.since_period), plays)
    left = expected_words(pulses, bench.wiring) if plays else SILENCE
    steps = [(since, expected_words(modulated(pulses, SAMPLE), bench.wiring)), (named, left)]
    bench.judge(since, named + 60, lambda seen: check_play(seen, steps))


@case("BLK-018", "BLK-015", needs=(Need.CAPTURE,), features=FEATURES)
@ended
def test_an_output_ends_a_sequence(bench: Bench, action: Action) -> None:
    """END_MODULATION lets the sequence go on, unmodulated and in step; SILENCE and DISABLE end it at their period."""
    begin(bench)
    slots = [bench.weak(), bench.weak()]
    for number, pulses in enumerate(slots):
        bench.must(Slot(number, pulses))
    bench.must(Entries((Entry(0, 3), Entry(1, 2)), 60))
    bench.must(Samples(bytes([SAMPLE]), 40))
    let_stores_go(bench)
    began = bench.must(PlaySequence(60, 2)).commit_period
    since = bench.must(AmplitudeModulation(40, 1, 1)).commit_period
    named = later(bench)
    bench.must(Output(action, named))
    plain = [expected_words(pulses, bench.wiring) for pulses in slots]
    quiet = [expected_words(modulated(pulses, SAMPLE), bench.wiring) for pulses in slots]

    def words(period: int) -> Words:
        place = int((period - began) % 5 >= 3)
        if period < named:
            return quiet[place]
        return plain[place] if action is Action.END_MODULATION else SILENCE

    steps = [(period, words(period)) for period in range(since, named + 30)]
    bench.judge(since, named + 30, lambda seen: check_play(seen, steps))


@case("BLK-018", outputs=("BLK-018",), features=FEATURES)
def test_silence_leaves_the_outputs_enabled(bench: Bench) -> None:
    """After SILENCE the outputs are enabled: the next update plays, without the modulation that ended."""
    play_modulated(bench)
    ends = bench.must(Output(Action.SILENCE)).commit_period
    again = bench.weak()
    period = later(bench)
    began = bench.must(Update(again, period)).commit_period
    steps = [(ends, SILENCE), (began, expected_words(again, bench.wiring))]
    bench.judge(ends, began + 40, lambda seen: check_play(seen, steps))


@case("BLK-018", "BLK-007", features=FEATURES)
@ended
def test_an_output_with_nothing_to_end_is_accepted(bench: Bench, action: Action) -> None:
    """If nothing plays each action is accepted all the same, because its host need not know what has ended."""
    begin(bench)
    ack = bench.must(Output(action))
    expect("flags", ack.flags, AckFlag(0))
    bench.wait_until(ack.commit_period)
    expect("the state", bench.status().state, State.OFF if action is Action.DISABLE else State.READY)


@case("BLK-018", "BLK-007", "SAF-004/1")
@ended
def test_an_output_takes_effect_behind_what_is_queued(bench: Bench, action: Action) -> None:
    """An OUTPUT as soon as possible takes effect after all queued changes; the request DISABLE overtakes them."""
    require(bench, features_of(Output(action)))
    begin(bench)
    named = far(bench)
    expect("commit_period of the update", bench.must(Update(bench.weak(), named)).commit_period, named)
    ack = bench.must(Output(action))
    assert ack.commit_period > named, f"the OUTPUT takes effect at {ack.commit_period}, should be after {named}"
    expect_all(ack, flags=AckFlag(0), free=bench.info.queue_blocks - 2)
    expect("the state", bench.status().state, State.READY)
    bench.disable()
    expect_all(bench.status(), " after DISABLE", state=State.OFF, free=bench.info.queue_blocks)


@case("BLK-018", "SAF-002", outputs=("BLK-018", "SAF-002"))
def test_what_is_behind_a_disable_is_dropped(bench: Bench) -> None:
    """Changes accepted after OUTPUT with DISABLE are dropped with it: they never play, and count only as accepted."""
    begin(bench)
    pulses = bench.weak()
    began = bench.must(Update(pulses)).commit_period
    named = later(bench)
    bench.must(Output(Action.DISABLE, named))
    before = bench.status()
    with in_time(bench, named):
        for body in (Update(bench.weak(), named + 50), Update(bench.weak()), Output(Action.SILENCE, named + 90)):
            ack = bench.must(body)
            assert ack.commit_period > named, f"commit_period is {ack.commit_period}, should be after {named}"
            expect("flags", ack.flags, AckFlag(0))
    bench.wait_until(named + 1)
    moved = {"state": State.OFF, "since_period": 0, "accepted": (before.accepted + 3) % 2**32}
    check_same(before, bench.status(), **moved, free=bench.info.queue_blocks)
    bench.enable()
    steps = [(began, expected_words(pulses, bench.wiring)), (named, SILENCE)]
    bench.judge(began, named + 200, lambda seen: check_play(seen, steps))


# CLOCK and NO_OP


@case("BLK-019", "BLK-020", "BLK-024", "ACK-002", features=FEATURES)
@pytest.mark.parametrize("body", [Clock(), NoOp()], ids=["clock", "no-op"])
def test_it_has_no_effect(bench: Bench, body: Clock | NoOp) -> None:
    """CLOCK and NO_OP do not change what plays or waits, take no place in the queue, and count as accepted."""
    play_modulated(bench)
    bench.must(Update(SILENT, far(bench)))
    bench.wait_until(bench.period() + 20)
    before = bench.status()
    for _ in range(5):
        expect_all(bench.must(body), free=bench.info.queue_blocks - 1, flags=AckFlag(0), state=State.PLAYING)
    check_same(before, bench.status(), accepted=(before.accepted + 5) % 2**32)


@case("BLK-019", "CHN-026")
def test_a_clock_tells_the_last_pulse_of_the_sync_line(bench: Bench) -> None:
    """A CLOCK is answered with the period of the last sync pulse, the multiple of 4096 before its arrival."""
    for _ in range(bench.tries(12, 4)):
        ack = bench.must(Clock())
        expect("commit_period of a CLOCK", ack.commit_period, ack.now_period - ack.now_period % SYNC_PERIODS)
        bench.wait_periods(bench.random.randrange(500, 1500))


@case("BLK-020", "SAF-003")
@pytest.mark.parametrize("body", [Clock(), NoOp()], ids=["clock", "no-op"])
def test_it_is_a_sign_of_life(bench: Bench, body: Clock | NoOp) -> None:
    """While CLOCK or NO_OP come the watchdog does not fire: their host is present, with nothing to change."""
    enable(bench, ms := 200 * bench.slowness)
    acks = []
    for _ in range(6):
        bench.wait(ms / 2500)
        acks.append(bench.must(body))
    gap = max(other.now - one.now for one, other in pairwise(acks)) / 2000
    if gap >= ms:
        raise TooSlow(f"the host was held up for {gap:.0f} ms, longer than the watchdog's time")
    expect("the state", acks[-1].state, State.READY)


# While the outputs are off

BODIES: dict[str, Body] = {
    "update": Update(SILENT),
    "sequence": PlaySequence(30, 1),
    "modulation": AmplitudeModulation(40, 1, 9),
    "end-modulation": Output(Action.END_MODULATION),
    "silence": Output(Action.SILENCE),
    "disable": Output(Action.DISABLE),
    "slot": Slot(4, SILENT),
    "entries": Entries((Entry(4, 7),), 30),
    "samples": Samples(bytes([SAMPLE]), 40),
    "clock": Clock(),
    "no-op": NoOp(),
}
CHANGES = ("update", "sequence", "modulation", "end-modulation", "silence", "disable")


def check_off(bench: Bench) -> None:
    """Check that changes are refused with DISABLED and all else is accepted."""
    for name, body in BODIES.items():
        if name not in CHANGES:
            bench.must(body)
    let_stores_go(bench)
    refuse(bench, [Wrong(name, forge(bench, BODIES[name]), Reason.DISABLED) for name in CHANGES])


@case("SAF-002", "ACK-003", features=FEATURES)
def test_changes_are_refused_until_enable(bench: Bench) -> None:
    """Before ENABLE changes are refused with DISABLED, and stores, CLOCK and NO_OP accepted; afterwards all are."""
    bench.must(NoOp())
    check_off(bench)
    enable(bench)
    for name in CHANGES:
        bench.must(BODIES[name])


@case("SAF-002", "BLK-018", features=FEATURES)
@pytest.mark.parametrize("how", ["request", "block", "watchdog"])
def test_changes_are_refused_after_disable(bench: Bench, how: str) -> None:
    """After DISABLE, by request, by block or by the watchdog, changes are refused again until the next ENABLE."""
    begin(bench)
    bench.must(Update(SILENT))
    if how == "request":
        bench.order(Request.DISABLE)
    elif how == "block":
        bench.wait_until(bench.must(Output(Action.DISABLE)).commit_period)
    else:
        bench.order(Request.WATCHDOG, 10)
        bench.await_unasked(1)
    bench.wait_periods(6)
    check_off(bench)
    enable(bench)
    bench.must(Update(SILENT))
