"""Time: when changes take effect, and the device's clock (chapters TIM and BLK, the sync line)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from itertools import pairwise

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, NotApplicable, Risk, case, expect
from phasewire.hil.conformance.tools.clocks import compare_clocks
from phasewire.hil.conformance.tools.player import Player, check_in_time, soon
from phasewire.hil.conformance.tools.steps import check_sync, enable
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Change,
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
from phasewire.protocol.board import CARRIER_HZ, TICK_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import NOW, PROMISED_PERIODS, SYNC_PERIODS, Action, Fault, Feature, Reason, Request, State
from phasewire.protocol.replies import Ack

COUNTER_TICKS = 65_536
HORIZON_PERIODS = 2**32
SETTLED_PERIODS = 200
"""Time for all stores to go onto the chain, and for all due changes to take effect."""


BOTH = Feature.SEQUENCES | Feature.MODULATION


class ChangeKind(StrEnum):
    """Changes of every kind."""

    UPDATE = "update"
    SEQUENCE = "sequence"
    MODULATION = "modulation"
    END_MODULATION = "end-of-modulation"
    SILENCE = "silence"


EVERY_KIND = pytest.mark.parametrize("kind", list(ChangeKind), ids=str)
NEEDED = {
    ChangeKind.SEQUENCE: Feature.SEQUENCES,
    ChangeKind.MODULATION: Feature.MODULATION,
    ChangeKind.END_MODULATION: Feature.MODULATION,
}


def behind_periods(bench: Bench) -> int:
    """Within how many periods of one change the next takes effect, if its block had arrived long before.

    Five are promised if nothing waits (clause BLK-005); after another change the chain may need longer (BLK-023).
    """
    return max(PROMISED_PERIODS, bench.info.periods_per_update)


def changes(player: Player, kind: ChangeKind) -> Callable[[int], Change]:
    """Changes of a kind, one for each requested period; their data are stored, and a modulated update plays."""
    bench = player.bench
    if NEEDED.get(kind, Feature(0)) & ~bench.info.features:
        raise NotApplicable(f"INFO does not name the feature {NEEDED[kind].name}")
    pulses = [bench.weak(), bench.weak()]
    player.send(Update(pulses[0]))
    if kind is ChangeKind.SEQUENCE:
        player.send_all([Slot(7, bench.weak()), Slot(200, bench.weak())])
        player.send(Entries((Entry(200, 3), Entry(7, 2)), 500))
    if Feature.MODULATION in NEEDED.get(kind, Feature(0)):
        player.send(Samples(bytes([250, 90, 200, 140]), 1000))
    if kind is ChangeKind.END_MODULATION:
        player.send(AmplitudeModulation(1000, 4, 2))
    bench.wait_periods(SETTLED_PERIODS)

    def change(period: int) -> Change:
        match kind:
            case ChangeKind.UPDATE:
                pulses.reverse()
                return Update(pulses[0], period)
            case ChangeKind.SEQUENCE:
                return PlaySequence(500, 2, period)
            case ChangeKind.MODULATION:
                return AmplitudeModulation(1000, 4, 1, period)
            case ChangeKind.END_MODULATION:
                return Output(Action.END_MODULATION, period)
            case ChangeKind.SILENCE:
                return Output(Action.SILENCE, period)

    return change


# When changes take effect


@case("BLK-005", "BUD-003", "TIM-003", "CHN-005", needs=[Need.CAPTURE])
@EVERY_KIND
def test_a_change_plays_from_the_period_that_it_names(player: Player, kind: ChangeKind) -> None:
    """A change for a distant period begins at the first tick of that period on all ten processors."""
    change = changes(player, kind)
    period = player.soon()
    player.send(change(period))
    player.judge(period - 20, period + 60)


@case("BLK-005", "BUD-003")
@EVERY_KIND
def test_a_change_for_now_is_never_late(bench: Bench, player: Player, kind: ChangeKind) -> None:
    """A change for period 0 takes effect as early as a named one is promised to, and does not count as late."""
    change = changes(player, kind)
    before = bench.status()
    for _ in range(4):
        ack = player.send(change(NOW))
        assert ack.commit_period <= ack.now_period + PROMISED_PERIODS, (
            f"a change for now takes effect at period {ack.commit_period}, its block had arrived in {ack.now_period}"
        )
        bench.wait_until(ack.commit_period + 1)
    expect("the count of late changes", bench.status().late, before.late)


@case("BLK-005", "BUD-003", "TIM-003", needs=[Need.CAPTURE])
@EVERY_KIND
def test_a_change_for_now_plays_from_the_period_acknowledged(bench: Bench, player: Player, kind: ChangeKind) -> None:
    """A change for period 0 begins exactly at the period in its acknowledgement, which the device chose."""
    change = changes(player, kind)
    first = bench.period()
    for _ in range(3):
        ack = player.send(change(NOW))
        bench.wait_until(ack.commit_period + 3)
    player.judge(first, ack.commit_period + 20)


@case("BLK-005/1", "REQ-003")
@EVERY_KIND
@pytest.mark.parametrize("back", [0, 1, 300, 2**40], ids=["this-period", "one-ago", "long-ago", "at-the-beginning"])
def test_a_late_change_is_counted_and_said(bench: Bench, player: Player, kind: ChangeKind, back: int) -> None:
    """A change for a period that has begun is late: accepted with LATE, counted once, and plays within five periods."""
    change = changes(player, kind)
    before = bench.status()
    ack = bench.must(change(max(bench.period() - back, 1)))
    expect("LATE", ack.late, True)
    check_late(ack)
    after = bench.status()
    expect("the count of late changes", after.late - before.late, 1)
    expect("the count of accepted blocks", after.accepted - before.accepted, 1)
    expect("the count of refused blocks", after.refused - before.refused, 0)
    bench.wait_until(ack.commit_period)
    since = {ChangeKind.UPDATE: ack.commit_period, ChangeKind.SEQUENCE: ack.commit_period, ChangeKind.SILENCE: 0}
    expect("since_period", bench.status().since_period, since.get(kind, before.since_period))


def check_late(ack: Ack) -> None:
    """Fail unless a late change, with none before it, takes effect soon, at a period that can still be met."""
    assert ack.now_period < ack.commit_period <= ack.now_period + PROMISED_PERIODS, (
        f"a late change takes effect at period {ack.commit_period}, should be within {PROMISED_PERIODS} of "
        f"{ack.now_period}, in which its block had arrived"
    )


@case("BLK-005/1", "TIM-003", needs=[Need.CAPTURE])
@EVERY_KIND
def test_a_late_change_plays_at_the_period_acknowledged(bench: Bench, player: Player, kind: ChangeKind) -> None:
    """A late change is not dropped: it plays from the period in its acknowledgement."""
    change = changes(player, kind)
    body = change(bench.period())
    ack = bench.must(body)
    expect("LATE", ack.late, True)
    player.follow(body, ack)
    player.judge(ack.commit_period - 10, ack.commit_period + 40)


@case("BLK-005/2", "BLK-005/1")
@EVERY_KIND
def test_the_fifth_period_is_promised(bench: Bench, player: Player, kind: ChangeKind) -> None:
    """A change five periods after its block's arrival is in time, one for a period that has begun is late."""
    change = changes(player, kind)
    wanted = bench.tries(12, 1, 42)
    rounds = 14 * wanted
    late = bench.status().late
    hits, latency = 0, 0
    for attempt in range(rounds):
        bench.wait_periods(bench.random.random())
        asked = bench.period()
        period = asked + latency + (PROMISED_PERIODS if attempt % 4 else bench.random.randrange(-1, PROMISED_PERIODS))
        ack = bench.send(change(period))  # which may come late here: then it is tried again
        expect("the reason", ack.reason, Reason.ACCEPTED)
        lead = period - ack.now_period
        latency = ack.now_period - asked
        late += ack.late
        hits += lead == PROMISED_PERIODS
        if lead >= PROMISED_PERIODS:
            expect(f"LATE of a change for period {period}, whose block came at tick {ack.now}", ack.late, False)
        elif lead <= 0:
            expect(f"LATE of a change for period {period}, whose block came at tick {ack.now}", ack.late, True)
        if ack.late:
            check_late(ack)
        else:
            expect("the commit period", ack.commit_period, period)
        bench.wait_until(ack.commit_period + 1)
        if hits == wanted:
            break
    expect("the count of late changes", bench.status().late, late)
    if not hits:
        raise Inconclusive(f"in {rounds} attempts no block came exactly {PROMISED_PERIODS} periods ahead of its change")


@case("BLK-007", "BLK-005/1", "BLK-005", outputs=("BLK-007", "CHN-007"))
def test_changes_take_effect_in_the_order_of_acceptance(bench: Bench, player: Player) -> None:
    """After a queued change one for the same period, an earlier one, or none, begins next, in the order of arrival."""
    pulses = [bench.weak(), bench.weak()]
    player.send(Update(pulses[1]))
    before = bench.status()
    period = player.soon(4)
    bodies = [Update(pulses[number % 2], named) for number, named in enumerate([period, period, period - 30, NOW])]
    acks = bench.send_all(bodies)
    check_in_time(acks[0], period)
    expect("LATE", [ack.late for ack in acks], [False, True, True, False])
    for one, other in pairwise(acks):
        assert one.commit_period < other.commit_period <= one.commit_period + behind_periods(bench), (
            f"after a change at period {one.commit_period} the next takes effect at {other.commit_period}"
        )
    for body, ack in zip(bodies, acks, strict=True):
        player.follow(body, ack)
    after = bench.status()
    expect("the count of late changes", after.late - before.late, 2)
    expect("missed commits", after.missed_commits, before.missed_commits)
    player.judge(period - 40, acks[-1].commit_period + 30)


@case("BLK-007", "BLK-012", "CHN-014/2", outputs=("BLK-007", "BLK-012", "CHN-029", "TIM-003"), features=BOTH)
def test_changes_of_all_kinds_follow_each_other(bench: Bench, player: Player) -> None:
    """Updates, sequences, modulations and their ends queued a few periods apart begin each at its own period."""
    player.send_all([Slot(1, bench.weak()), Slot(2, bench.weak()), Samples(bytes([0, 255, 30, 180, 90]), 9)])
    player.send_all([Entries((Entry(1, 1), Entry(2, 3), Entry(1, 2)), 9), Update(bench.weak())])
    before = bench.status()
    period = player.soon(12)
    story: list[Change] = [
        AmplitudeModulation(9, 3, 2),
        Update(bench.weak()),
        PlaySequence(9, 3),
        AmplitudeModulation(10, 4, 1),
        PlaySequence(10, 2, repeats=2),
        Output(Action.END_MODULATION),
        Update(bench.weak()),
        Output(Action.SILENCE),
        AmplitudeModulation(9, 5, 3),
        PlaySequence(10, 1),
        Update(bench.weak()),
    ]
    apart = behind_periods(bench) + 2
    player.send_all(replace(change, period=period + apart * number) for number, change in enumerate(story))
    last = period + apart * len(story)
    bench.wait_until(last + SETTLED_PERIODS)
    after = bench.status()
    expect("missed commits", after.missed_commits, before.missed_commits)
    expect("late changes", after.late, before.late)
    expect("the period since which the last one plays", after.since_period, last - apart)
    player.judge(period - 10, last + 30)


@case("BLK-007", "BLK-005/1", outputs=("BLK-007", "BLK-005/1"), features=Feature.MODULATION)
def test_an_update_and_a_modulation_cannot_begin_together(bench: Bench, player: Player) -> None:
    """An update for the period of a modulation that was accepted before it is late, and begins soon after it."""
    player.send_all([Update(bench.weak()), Samples(bytes([60, 250, 128]))])
    period = player.soon(2)
    update = Update(bench.weak(), period)
    first, second = bench.send_all([AmplitudeModulation(0, 3, 1, period), update])
    expect("LATE of the modulation", first.late, False)
    expect("LATE of the update", second.late, True)
    assert period < second.commit_period <= period + behind_periods(bench), (
        f"the update takes effect at period {second.commit_period}, should be soon after {period}"
    )
    player.score.modulate(first.commit_period, [60, 250, 128], 1)
    player.score.update(second.commit_period, update.pulses)
    player.judge(period - 10, period + 30)


@case("BLK-010", "TIM-002")
@EVERY_KIND
def test_the_horizon_is_exact(bench: Bench, player: Player, kind: ChangeKind) -> None:
    """A change 2³² periods after its block's arrival is accepted, and one a period later refused with HORIZON."""
    change = changes(player, kind)
    asked = bench.period()
    latency = bench.must(Clock()).now_period - asked
    seen = set()
    for attempt in range(60):
        offset = latency + (attempt % 2 if attempt < 40 else bench.random.randrange(-3, 4))
        asked = bench.period()
        period = asked + HORIZON_PERIODS + offset
        before = bench.status() if attempt < 2 else None
        ack = bench.send(change(period))
        ahead = period - ack.now_period - HORIZON_PERIODS
        latency = latency if before else ack.now_period - asked
        seen.add(ahead)
        if ahead > 0:
            expect(f"the reason for a period {ahead} beyond the horizon", ack.reason, Reason.HORIZON)
            expect("the commit period of a refused change", ack.commit_period, 0)
        else:
            expect(f"the reason for a period {-ahead} within the horizon", ack.reason, Reason.ACCEPTED)
            expect("the commit period", (ack.commit_period, ack.late), (period, False))
            bench.disable()
            bench.enable()
        if {0, 1} <= seen:
            break
    for period in (2**63, 2**64 - 1):
        expect(f"the reason for period {period}", bench.send(change(period)).reason, Reason.HORIZON)
    if not {0, 1} <= seen:
        raise Inconclusive(f"no block came exactly 2³² periods ahead of its change, and one more: {sorted(seen)}")


@case("CHN-020", "BLK-023", "BUD-001/1", "BUD-004", outputs=("CHN-005", "CHN-007", "TIM-003", "BUD-001/1"))
def test_all_processors_change_in_the_same_tick(bench: Bench, player: Player) -> None:
    """Updates at the rate of INFO begin on all ten processors at their periods, none late and none missed."""
    spacing = bench.info.periods_per_update
    count = min(bench.info.queue_blocks, 16)
    player.send(Update(bench.weak()))
    before = bench.status()
    period = player.soon(count)
    last = period + count * spacing
    player.send_all([Update(bench.weak(), named) for named in range(period, last, spacing)])
    bench.wait_until(last + SETTLED_PERIODS)
    after = bench.status()
    expect("missed commits", after.missed_commits - before.missed_commits, 0)
    expect("damaged messages", after.damaged_messages - before.damaged_messages, 0)
    expect("late changes", after.late - before.late, 0)
    expect("faults", after.faults, before.faults)
    expect("the period since which the last one plays", after.since_period, last - spacing)
    player.judge(period - 10, last + 10)


# The count of ticks and periods


def wraps(first: int) -> list[int]:
    """The first periods, from one on, in which a 16-bit counter of ticks returns to 0."""
    number = -(-first * TICKS_PER_PERIOD // COUNTER_TICKS)
    return [(number + wrap) * COUNTER_TICKS // TICKS_PER_PERIOD for wrap in range(64)]


@case("TIM-004", "TIM-003", needs=[Need.CAPTURE])
def test_outputs_stay_in_step_across_wraps_of_the_port_counter(bench: Bench, player: Player) -> None:
    """Pulses keep their place in the period when a 16-bit counter wraps, and changes there begin at first ticks."""
    spacing = bench.info.periods_per_update
    begun = player.send(Update(bench.weak())).commit_period
    for places in ([0, spacing], [-spacing, 0], [1], []):
        wrap = wraps(player.soon(3))[0]
        player.send_all([Update(bench.weak(), wrap + place) for place in places])
        bench.wait_until(wrap + 10)
    for wrap in [wrap for wrap in wraps(begun + 8) if wrap + 8 <= bench.period()]:
        player.judge(wrap - 7, wrap + 8)


@case("TIM-001", "TIM-002", "BLK-019", "REQ-006", "REQ-003", "ACK-002")
def test_every_clock_tells_the_same_time(bench: Bench) -> None:
    """Acknowledgements, CLOCK and STATUS count the same ticks, and a later answer names a later tick."""
    bench.order(Request.WATCHDOG, 60_000)
    told = []
    for _ in range(12):
        told.append(("CLOCK", bench.clock().now))
        told.append(("the acknowledgement of a NO_OP", bench.must(NoOp()).now))
        told.append(("STATUS", bench.status().now))
        told.append(("the acknowledgement of a CLOCK", bench.must(Clock()).now))
        bench.wait(bench.random.random() / 100)
    for (name, tick), (next_name, next_tick) in pairwise(told):
        assert tick < next_tick, f"{next_name} names tick {next_tick} after {name} named {tick}: should be later"
    ticks = [ack.now for ack in bench.send_all([NoOp()] * 8)]
    assert all(one < other for one, other in pairwise(ticks)), (
        f"consecutive blocks had arrived at ticks {ticks}: should be rising"
    )


TOLERANCE = 0.01
"""Tolerance for the host's clock and for waiting, coarse."""


def check_clock_runs_on(bench: Bench, disturb: Callable[[], object]) -> None:
    """Fail if the device's ticks over a disturbance do not match the host's clock."""

    def meanwhile() -> None:
        disturb()
        bench.wait(0.02)

    compare_clocks(bench, meanwhile, TOLERANCE)


@case("TIM-002", "TIM-001")
def test_nothing_that_a_host_asks_for_sets_the_clock(bench: Bench) -> None:
    """Ticks run on through ENABLE, DISABLE, new numbering and all else: they are never shifted or reset."""

    def disturb() -> None:
        bench.order(Request.WATCHDOG, 60_000)
        bench.order(Request.LIMIT, bench.drive_limit)
        bench.enable()
        bench.must(NoOp(), restart=True)
        bench.must(Update(bench.weak()))
        bench.must(Output(Action.DISABLE))
        bench.wait_periods(50)
        bench.enable()
        bench.order(Request.DISABLE)
        bench.order(Request.CLEAR_FAULTS)
        bench.order(Request.WATCHDOG, 1000)
        bench.order(Request.LIMIT, 1)
        bench.must(Clock())

    check_clock_runs_on(bench, disturb)


@case("TIM-002", line="usb")
@pytest.mark.parametrize("how", ["SET_CONFIGURATION", "SET_INTERFACE"])
def test_configuring_the_device_anew_does_not_set_the_clock(bench: Bench, how: str) -> None:
    """Ticks run on when a host configures the device again, although that ends everything else."""
    again = {"SET_CONFIGURATION": bench.usb.set_configuration, "SET_INTERFACE": lambda: bench.usb.set_interface(0)}
    check_clock_runs_on(bench, again[how])


@case("TIM-002", line="usb", allow=[Risk.RESET])
def test_a_bus_reset_does_not_set_the_clock(bench: Bench) -> None:
    """Ticks run on over a bus reset in run-time mode, which does not reset the device."""
    check_clock_runs_on(bench, bench.usb.reset)


LONGEST_WAIT_PERIODS = 10 * CARRIER_HZ


@case("TIM-002/1", "TIM-002", needs=[Need.CAPTURE])
@pytest.mark.parametrize("unit", ["ticks", "periods"])
def test_counts_go_on_beyond_32_bits(bench: Bench, unit: str) -> None:
    """Beyond 2³² ticks (36 minutes) and periods (30 hours) the counts go on, and changes near them begin in time."""
    edge = 2**32 // TICKS_PER_PERIOD if unit == "ticks" else 2**32
    if bench.can(Need.FREE_TIME):
        with bench.spare() as fresh:
            check_counts_beyond(fresh, edge, edge)
    else:
        check_counts_beyond(bench, edge, LONGEST_WAIT_PERIODS)


def check_counts_beyond(bench: Bench, edge: int, longest_wait: int) -> None:
    """Fail unless counts go on and changes begin in time beyond a period that may be waited for."""
    left = edge - bench.period()
    if left > 0:
        if left > longest_wait:
            raise Inconclusive(f"the device has been on for too short a time: {left} periods are left")
        bench.wait_periods(edge - 4 * (soon(bench, 4) - bench.period()) - bench.period())
    player = Player(bench)
    apart = max(bench.info.periods_per_update, 3)
    middle = edge if left > 0 else player.soon(3) + apart
    periods = [middle - apart, middle, middle + apart]
    player.send(Update(bench.weak()))
    player.send_all([Update(bench.weak(), period) for period in periods])
    bench.wait_until(periods[-1] + 20)
    reading, status = bench.clock(), bench.status()
    assert reading.now // TICKS_PER_PERIOD > periods[-1], f"the clock names tick {reading.now}"
    expect("the period since which the last update plays", status.since_period, periods[-1])
    check_sync(bench)
    player.judge(periods[0] - 10, periods[-1] + 10)


# The sync line


@case("CHN-026", "REQ-006")
def test_a_sync_pulse_comes_every_4096_periods(bench: Bench) -> None:
    """CLOCK answers the newest multiple of 4096 periods and one more pulse for each, for comparing devices."""
    check_sync(bench)
    first = bench.clock()
    for _ in range(2):
        edge = (bench.period() // SYNC_PERIODS + 1) * SYNC_PERIODS
        bench.wait_until(edge + 2)
        check_sync(bench)
    second = bench.clock()
    pulses = (second.sync_period - first.sync_period) // SYNC_PERIODS
    expect("the pulses that came", second.sync_pulses - first.sync_pulses, pulses)


@case("BLK-019", "CHN-026", "BLK-024", "ACK-002")
def test_a_clock_block_tells_the_sync_period_and_does_nothing(bench: Bench, player: Player) -> None:
    """A CLOCK is answered with the period of the last sync pulse, and changes neither what plays nor the queue."""
    update = player.send(Update(bench.weak()))
    bench.wait_until(update.commit_period + 2)
    before = bench.status()
    for _ in range(2):
        bench.wait_until((bench.period() // SYNC_PERIODS + 1) * SYNC_PERIODS + 2)
        ack = player.send(Clock())
        expect("commit_period of a CLOCK", ack.commit_period, ack.now_period - ack.now_period % SYNC_PERIODS)
        expect("free places", ack.free, before.free)
        expect("the state", ack.state, State.PLAYING)
        assert not ack.flags, f"flags of a CLOCK are {ack.flags!r}, should be none"
    after = bench.status()
    expect("since_period", after.since_period, before.since_period)
    expect("accepted blocks", after.accepted - before.accepted, 2)
    if Feature.READ_BACK in bench.info.features:
        expect("PULSES", bench.read_back().pulses == player.score.at(before.since_period)[0], True)


# The start


def check_begins_anew(bench: Bench, what: str, restart: Callable[[], None]) -> None:
    """Fail unless time begins anew, and the first sync pulse and the whole chain come before the first answer."""
    began = bench.line.time.monotonic()
    restart()
    first = bench.clock()  # this is the first question
    assert first.sync_pulses >= 1, f"at tick {first.now} no pulse on the sync line had come, should one at period 0"
    missing = [number for number, report in enumerate(bench.processors()) if report.bank is None]
    if Fault.PROCESSOR not in bench.status().faults:
        expect("missing processors", missing, [])
    check_sync(bench)
    tick = bench.clock().now
    elapsed = bench.line.time.monotonic() - began
    assert tick <= elapsed * TICK_HZ * (1 + TOLERANCE), (
        f"{elapsed:.3f} s after {what} the clock names tick {tick}, should be less than {elapsed * TICK_HZ:.0f}"
    )


@case("TIM-002/2", "TIM-002", "CHN-026", allow=[Risk.RESET])
def test_after_a_reset_the_device_answers_from_period_0_on(bench: Bench) -> None:
    """After RESET time restarts at 0, and the first answer knows the processors and the sync pulse of period 0."""
    enable(bench)
    check_begins_anew(bench, "RESET", lambda: bench.restart(lambda: bench.order(Request.RESET)))


@case("TIM-002/2", "TIM-002", "CHN-026", allow=[Risk.RESET], needs=[Need.POWER])
def test_after_power_up_the_device_answers_from_period_0_on(bench: Bench) -> None:
    """After power-up time restarts at 0, and the first answer knows the processors and the sync pulse of period 0."""
    check_begins_anew(bench, "power was cut", bench.power_cycle)
