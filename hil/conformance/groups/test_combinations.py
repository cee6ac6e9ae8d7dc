"""Two things at once: what plays, is queued or waits meets what replaces, ends or disables it.

STATUS, records and PULSES are judged without a capture, in cases of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import SILENCE, Words, check_play, check_silent, expected_words
from phasewire.hil.conformance.tools.planning import (
    APART,
    PLACE,
    SAMPLE,
    SETTLED,
    check_nothing_is_read_back,
    check_rest,
    some_time,
    store_for_plans,
)
from phasewire.hil.conformance.tools.player import check_in_time, in_time, is_fast
from phasewire.hil.conformance.tools.playing import (
    PLAYS,
    ROUND_SECONDS,
    check_falls_one_by_one,
    check_falls_silent,
    heat,
    play,
    silent_from,
    start,
    told,
)
from phasewire.hil.conformance.tools.steps import LONG_MS, SILENT, enable, expect_all, require
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
)
from phasewire.protocol.board import PROCESSORS, TICKS_PER_PERIOD
from phasewire.protocol.codes import (
    ENTRIES_PER_BLOCK,
    SAMPLES_PER_BLOCK,
    SILENT_PERIODS,
    Action,
    Feature,
    Request,
    State,
    StatusFlag,
)

CAPTURE = (Need.CAPTURE,)
FAULTY = (Need.FAULTS, Need.SPARE)
SUSPENDS = (Need.SUSPEND,)
UNATTENDED = Feature.SEQUENCES | Feature.UNATTENDED
SLOT = 9
HOT_PERIODS = 400
SHORT_MS = 10


# What was planned, and what disables the outputs


@dataclass(frozen=True)
class Ending:
    """A way to disable the outputs, after which they can be enabled again.

    `planned` queues before all else what happens at a period; `over` brings the device to OFF from another `state`.
    """

    happens: Callable[[Bench, int], None]
    planned: Callable[[Bench, int], None] = lambda _bench, _period: None
    state: State = State.OFF
    over: Callable[[Bench], None] = lambda _: None


def let_watchdog_fire(bench: Bench, _: int) -> None:
    """Give no sign of life for the shortest watchdog time."""
    bench.order(Request.WATCHDOG, SHORT_MS)
    expect("the state in the record after the watchdog has fired", bench.await_unasked(1).state, State.OFF)
    bench.order(Request.WATCHDOG, LONG_MS)


def suspend(bench: Bench, _: int) -> None:
    """The bus is suspended for a while."""
    bench.levers.suspend()
    bench.wait(0.01)
    bench.levers.resume()


def cool_down(bench: Bench) -> None:
    """Wait until no board is too hot and the controller knows it, then clear the fault."""
    bench.wait_periods(HOT_PERIODS)
    bench.wait(ROUND_SECONDS)
    bench.order(Request.CLEAR_FAULTS)


def queue_disable(bench: Bench, period: int) -> None:
    """Queue an OUTPUT that disables."""
    check_in_time(bench.must(Output(Action.DISABLE, period)), period)


ENDINGS = {
    "disable": Ending(lambda bench, _: bench.order(Request.DISABLE)),
    "disabling-block": Ending(lambda bench, period: bench.wait_until(period + 1), queue_disable),
    "watchdog": Ending(let_watchdog_fire),
    "set-configuration": Ending(lambda bench, _: bench.usb.set_configuration()),
    "set-interface": Ending(lambda bench, _: bench.usb.set_interface(0)),
    "suspend": Ending(suspend),
    "fault": Ending(lambda bench, _: heat(bench, HOT_PERIODS), state=State.FAULT, over=cool_down),
}
BY_ANY_HOST = ("disable", "disabling-block", "watchdog")
BY_USB_HOST = ("set-configuration", "set-interface")


def plan_beginnings(bench: Bench) -> int:
    """Queue one change of each kind that begins something; returns the period from which all would play."""
    due, features = bench.period() + some_time(bench), bench.info.features
    changes: list[Change] = [Update(bench.weak(), due)]
    if Feature.SEQUENCES in features:
        changes.append(PlaySequence(PLACE, 1, due + APART, unattended=Feature.UNATTENDED in features))
    if Feature.MODULATION in features:
        changes.append(AmplitudeModulation(PLACE, 1, 1, due + 2 * APART))
    for change in changes:
        check_in_time(bench.must(change), change.period)
    return due + len(changes) * APART


def plan_ends(bench: Bench) -> int:
    """Queue one change of each kind that ends something; returns the period by which all would have taken effect."""
    due, actions = bench.period() + some_time(bench), [Action.SILENCE, Action.DISABLE]
    if Feature.MODULATION in bench.info.features:
        actions.insert(0, Action.END_MODULATION)
    for number, action in enumerate(actions):
        check_in_time(bench.must(Output(action, due + number * APART)), due + number * APART)
    return due + len(actions) * APART


def plan_last_repeat(bench: Bench, *, unattended: bool) -> int:
    """Play a sequence with repeats and wait until it plays; returns the period in which its last repeat would end."""
    require(bench, UNATTENDED if unattended else Feature.SEQUENCES)
    ack = bench.must(PlaySequence(PLACE, 1, repeats=2, unattended=unattended))
    bench.wait_until(ack.commit_period + 1)
    return ack.commit_period + 2 * (some_time(bench) // 2)


PLANS: dict[str, Callable[[Bench], int]] = {
    "beginnings": plan_beginnings,
    "ends": plan_ends,
    "last-repeat": lambda bench: plan_last_repeat(bench, unattended=False),
    "unattended-last-repeat": lambda bench: plan_last_repeat(bench, unattended=True),
}
"""What can be planned; each function returns the period by which all of it would have happened."""
QUEUED = ("beginnings", "ends")
"""The planned things that are queued; the others play."""


def disable_by(bench: Bench, how: str, plan: str) -> tuple[int, int]:
    """Plan, disable and enable again; returns the period from which all is silent, and that by which all was due."""
    ending = ENDINGS[how]
    store_for_plans(bench)
    enable(bench)
    bench.must(NoOp())
    ends = bench.period() + some_time(bench) // 2
    with in_time(bench, ends):
        if plan in QUEUED:
            ending.planned(bench, ends)
        due = PLANS[plan](bench)
        if plan not in QUEUED:  # as soon as possible: what disables would come before it
            ending.planned(bench, ends)
    with in_time(bench, due - 3 * APART):
        ending.happens(bench, ends)
        since = bench.period() + SILENT_PERIODS + 1
        check_rest(bench.status(), bench, ending.state, "when the outputs were disabled")
        ending.over(bench)
        bench.wait_periods(SILENT_PERIODS)
        check_rest(bench.status(), bench, State.OFF, "before ENABLE")
        check_nothing_is_read_back(bench, "before ENABLE")
        store_for_plans(bench)  # nothing that was planned is still in use (clause BLK-022)
        told(bench)
        bench.enable()
    return since, due


def check_nothing_outlives(bench: Bench, how: str, plan: str) -> None:
    """Disable and enable a device with something planned; fails if any of it still happens."""
    _, due = disable_by(bench, how, plan)
    with in_time(bench, due - 3 * APART):
        before = bench.status()
        expect("the state after ENABLE", before.state, State.READY)
        if plan != "beginnings":  # what ends something needs something to end
            if Feature.MODULATION in bench.info.features:
                bench.must(AmplitudeModulation(PLACE, 1, 1))
            play(bench)
            before = bench.status()
            expect("the state after something new begins", before.state, State.PLAYING)
    bench.wait_until(due + SETTLED)
    expect_all(
        bench.status(),
        " after the planned period",
        state=before.state,
        since_period=before.since_period,
        flags=before.flags,
        free=bench.info.queue_blocks,
        late=before.late,
    )
    expect("the unsolicited records", [status.state for status in told(bench)], [])
    if plan == "beginnings":
        check_nothing_is_read_back(bench, "when what was planned is due")


every_plan = pytest.mark.parametrize("plan", PLANS)
CLAUSES = ("SAF-004", "STA-003", "REQ-003", "BLK-022")


ENDED = [(plan, how) for plan in PLANS for how in BY_ANY_HOST if (plan, how) != ("unattended-last-repeat", "watchdog")]


@pytest.mark.parametrize(("plan", "how"), ENDED)
@case(*CLAUSES, "SAF-003", "BLK-018", "BLK-015")
def test_nothing_that_was_planned_outlives_the_end(bench: Bench, plan: str, how: str) -> None:
    """What was queued, or was to end by itself, never happens after the outputs were disabled, nor to what plays next.

    STATUS, the records and PULSES show it; the outputs are not captured.
    """
    check_nothing_outlives(bench, how, plan)


@pytest.mark.parametrize("how", BY_USB_HOST)
@every_plan
@case(*CLAUSES, "USB-003", "USB-016", line="usb")
def test_nothing_that_was_planned_outlives_a_new_session(bench: Bench, plan: str, how: str) -> None:
    """The same if a host configures the device again."""
    check_nothing_outlives(bench, how, plan)


@pytest.mark.parametrize("plan", [plan for plan in PLANS if not plan.startswith("unattended")])
@case(*CLAUSES, "USB-020", line="usb", needs=SUSPENDS, allow=(Risk.RESET,))
def test_nothing_that_was_planned_outlives_a_suspended_bus(bench: Bench, plan: str) -> None:
    """The same if the bus is suspended and resumes."""
    check_nothing_outlives(bench, "suspend", plan)


@every_plan
@case(*CLAUSES, "SAF-007/1", "REQ-011", needs=FAULTY)
def test_nothing_that_was_planned_outlives_a_fault(bench: Bench, plan: str) -> None:
    """The same if a silencing fault appears and is cleared."""
    check_nothing_outlives(bench, "fault", plan)


@pytest.mark.parametrize("how", BY_ANY_HOST)
@case("SAF-004/2", "SAF-004/1", "STA-001", "BLK-018", needs=CAPTURE)
def test_no_output_moves_when_what_was_planned_is_due(bench: Bench, how: str) -> None:
    """Once the outputs are disabled, queued changes move no output, even after the outputs are enabled again."""
    since, due = disable_by(bench, how, "beginnings")
    bench.judge(since, max(since, due) + SETTLED, check_silent)


@case("BLK-018", "STA-003", "SAF-004")
def test_the_first_of_two_disabling_blocks_disables(bench: Bench) -> None:
    """Of two disabling OUTPUTs the first takes effect in its period, and the second is dropped with the queue."""
    enable(bench)
    field = play(bench)
    first = bench.period() + some_time(bench) // 2
    second = first + some_time(bench)
    queue_disable(bench, first)
    queue_disable(bench, second)
    bench.wait_until(first - APART)
    seen = bench.status()
    if seen.now < first * TICKS_PER_PERIOD:
        expect_all(seen, " before the first", state=State.PLAYING, since_period=field.period)
    bench.wait_until(first + 1)
    seen = bench.status()
    if seen.now >= second * TICKS_PER_PERIOD:
        raise TooSlow("this line is too slow: the second was due before the first could be observed")
    check_rest(seen, bench, State.OFF, "after the first")
    bench.enable()
    again = play(bench)
    bench.wait_until(second + SETTLED)
    expect_all(bench.status(), " after the period of the second", state=State.PLAYING, since_period=again.period)


def begin_close_behind(bench: Bench, distance: int) -> tuple[int, Words, Words]:
    """Queue a disabling OUTPUT, and an update some periods later; returns its period, and what plays around it."""
    enable(bench)
    field, following = play(bench), bench.weak()
    ends = bench.period() + some_time(bench) // 2
    queue_disable(bench, ends)
    bench.must(Update(following, ends + distance))
    bench.wait_until(ends + SETTLED)
    return ends, field.words, expected_words(following, bench.wiring)


CLOSE = pytest.mark.parametrize("distance", [1, 2, 5])


@CLOSE
@case("BLK-018", "STA-001", "STA-003", "SAF-004")
def test_a_change_close_behind_a_disabling_block_is_dropped(bench: Bench, distance: int) -> None:
    """An UPDATE for a period just after a disabling OUTPUT has no effect and holds no place."""
    begin_close_behind(bench, distance)
    check_rest(bench.status(), bench, State.OFF, "after the period of both")
    check_nothing_is_read_back(bench, "after the period of both")
    bench.enable()
    bench.wait_periods(SETTLED)
    check_rest(bench.status(), bench, State.READY, "after ENABLE")
    check_nothing_is_read_back(bench, "after ENABLE")


@CLOSE
@case("BLK-018", "STA-001", "SAF-004/1", needs=CAPTURE)
def test_a_change_close_behind_a_disabling_block_falls_silent(bench: Bench, distance: int) -> None:
    """An UPDATE just after a disabling OUTPUT begins on no output, or on all and is silent within six periods."""
    ends, playing, following = begin_close_behind(bench, distance)

    def check(seen: Seen) -> None:
        since = silent_from(seen)
        assert since <= ends + SILENT_PERIODS, (
            f"the outputs are silent from period {since} on, should be from {ends + SILENT_PERIODS} on at the latest"
        )
        begun = [(ends + distance, following), (since, SILENCE)] if since > ends + distance else []
        check_play(seen, [(ends - APART, playing), (ends, SILENCE), *begun])

    bench.judge(ends - APART, ends + SETTLED, check)


# What disables the outputs, and what waits or happens meanwhile


MEANWHILE: dict[str, Callable[[Bench], object]] = {
    "disable": lambda bench: bench.order(Request.DISABLE),
    "enable": lambda bench: bench.enable(),
    "clear-faults": lambda bench: bench.order(Request.CLEAR_FAULTS),
}
"""What a host may do right after DISABLE."""


@pytest.mark.parametrize("then", MEANWHILE)
@pytest.mark.parametrize("what", ["update", "unattended"])
@case("SAF-004/1", "SAF-004", "REQ-005", needs=CAPTURE)
def test_nothing_puts_off_the_silence_after_disable(bench: Bench, what: str, then: str) -> None:
    """All outputs are silent six periods after DISABLE, whatever the host asks for meanwhile, even another DISABLE."""
    enable(bench)
    field = start(bench, what)
    before = bench.clock().now
    bench.order(Request.DISABLE)
    after = bench.clock().now
    for _ in range(3):
        MEANWHILE[then](bench)
    end = bench.period() + SETTLED
    bench.judge(field.period, end, lambda seen: check_falls_silent(seen, field.words, before, after))


@pytest.mark.parametrize("what", PLAYS)
@case("SAF-004", "STA-003", "REQ-007", features=Feature.READ_BACK)
def test_what_begins_right_after_enable_is_not_silenced(bench: Bench, what: str) -> None:
    """An update right after DISABLE and ENABLE plays on: the earlier silence does not overtake it."""
    enable(bench)
    start(bench, what)
    bench.order(Request.DISABLE)
    bench.enable()
    pulses = bench.weak()
    began = bench.must(Update(pulses)).commit_period
    bench.wait_until(began + SETTLED)
    expect_all(bench.status(), state=State.PLAYING, since_period=began, flags=StatusFlag(0))
    expect("whether PULSES answers the update", bench.read_back().pulses == pulses, True)


STORED_AT_ONCE = 14
"""Blocks that together keep the chain busy for dozens of periods."""


def stores(bench: Bench) -> list[Body]:
    """The largest stores, enough of them to keep the chain busy."""
    places = [number % 8 for number in range(STORED_AT_ONCE)]
    if Feature.SEQUENCES in bench.info.features:
        return [Entries((Entry(SLOT, 1),) * ENTRIES_PER_BLOCK, ENTRIES_PER_BLOCK * place) for place in places]
    require(bench, Feature.MODULATION)
    return [Samples(bytes([SAMPLE]) * SAMPLES_PER_BLOCK, SAMPLES_PER_BLOCK * place) for place in places]


AT_ONCE = {how: ENDINGS[how].happens for how in ("disable", *BY_USB_HOST)}


def let_stores_wait(bench: Bench) -> None:
    """Send stores in one go, so that some still wait when the next request comes."""
    if not is_fast(bench):
        raise Inconclusive("this line is slower than the chain: no store waits on the device")
    bench.send_all(stores(bench))


@pytest.mark.parametrize("how", AT_ONCE)
@case("SAF-004/1", "CHN-019", "USB-003", needs=CAPTURE)
def test_silence_does_not_wait_for_stores(bench: Bench, how: str) -> None:
    """All outputs are silent six periods after DISABLE or an equivalent, even while stores wait for the chain."""
    enable(bench)
    field = play(bench)
    let_stores_wait(bench)
    before = bench.clock().now
    AT_ONCE[how](bench, 0)
    after = bench.clock().now
    end = after // TICKS_PER_PERIOD + 100
    bench.judge(field.period, end, lambda seen: check_falls_silent(seen, field.words, before, after))


@pytest.mark.parametrize("how", AT_ONCE)
@case("SAF-004", "BLK-007", "USB-026", features=Feature.SEQUENCES | Feature.READ_BACK)
def test_stores_that_wait_outlive_disable(bench: Bench, how: str) -> None:
    """Stores that wait for the chain when the outputs are disabled are kept: later changes play them."""
    enable(bench)
    bench.must(Slot(SLOT, SILENT))
    let_stores_wait(bench)
    pulses = bench.weak()
    bench.send_all([Slot(SLOT, pulses), Entries((Entry(SLOT, 1000),), 1023)])
    AT_ONCE[how](bench, 0)
    bench.enable()
    began = bench.must(PlaySequence(1023, 1)).commit_period
    bench.wait_until(began + 1)
    expect("whether PULSES answers what was stored", bench.read_back().pulses == pulses, True)


@pytest.mark.parametrize("what", PLAYS)
@case("SAF-007/2", "SAF-007/1", "SAF-004/1", "SAF-005", needs=(*FAULTY, *CAPTURE))
def test_a_fault_silences_all_boards_whatever_plays(bench: Bench, what: str) -> None:
    """When the controller learns that one board is too hot, all ten processors fall silent."""
    enable(bench)
    field = start(bench, what)
    at = bench.period()
    heat(bench, HOT_PERIODS)
    learned = bench.await_unasked(1)
    expect("the state in the record", learned.state, State.FAULT)
    latest = learned.now // TICKS_PER_PERIOD + SILENT_PERIODS
    bench.judge(
        field.period,
        max(bench.period(), latest) + SETTLED,
        lambda seen: check_falls_one_by_one(seen, field.words, [at] * PROCESSORS, [latest] * PROCESSORS),
    )
