"""Widths of numbers: sums, products, differences and counts that need more bits than firmware may use.

Each case chooses numbers of which too few bits leave almost nothing, so that a mistake shows in milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, NotApplicable, Risk, case, expect
from phasewire.hil.conformance.tools.drives import widths_for
from phasewire.hil.conformance.tools.player import in_time, soon
from phasewire.hil.conformance.tools.steps import (
    MOST_ENTRY_PERIODS,
    SILENT,
    Wrong,
    begin,
    check_sync,
    enable,
    features_of,
    forge,
    known,
    let_stores_go,
    packed,
    refuse,
    require,
    some,
)
from phasewire.hil.conformance.tools.watchdog import await_firing
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
from phasewire.protocol.board import CARRIER_HZ, CHANNELS, TICK_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import (
    ENTRIES_PER_BLOCK,
    HORIZON_PERIODS,
    MODULATION_SAMPLES,
    PROMISED_PERIODS,
    SAMPLES_PER_BLOCK,
    SEQUENCE_ENTRIES,
    Action,
    Feature,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.pulses import Pulses

TICKS_PER_MS = TICK_HZ // 1000
MOST_MS = 60_000
BITS = (8, 15, 16, 24, 31, 32)
"""Widths in bits that are too narrow; 15 and 31 stand for signed numbers of 16 and 32 bits."""
PER_PERIOD = {"periods": 1, "ticks": TICKS_PER_PERIOD, "cycles of a timer at 100 MHz": 2_500, "core cycles": 10_000}
"""Units in which firmware may count time, and how many there are in a period."""
PER_MS = {"ms": 1, "µs": 1_000, **{name: 40 * count for name, count in PER_PERIOD.items()}}


class NarrowTime(NamedTuple):
    """A time of which a narrow number keeps almost nothing."""

    what: str
    time: int


def spans(units: dict[str, int], least: int, most: int = 2**63) -> list[NarrowTime]:
    """For each unit and width the shortest time, not below the minimum, that leaves less than 1 in that width.

    It is an odd multiple, so that a signed number of one more bit is negative. Times above `most` are left out.
    """
    found = []
    for name, count in units.items():
        for bits in BITS:
            laps = -(-least * count // 2**bits) | 1
            time = -(-laps * 2**bits // count)
            if time <= most:
                found.append(NarrowTime(f"{bits} bits of {name}", time))
    return found


# The watchdog


@case("REQ-009", "SAF-003")
def test_a_watchdog_time_is_counted_whole(bench: Bench) -> None:
    """Watchdog times that leave almost nothing in few bits of ms, µs, ticks or cycles do not fire at once."""
    bench.must(NoOp())
    for what, ms in some(bench, spans(PER_MS, 2000, MOST_MS)):
        enable(bench)
        began = bench.must(NoOp()).now
        bench.order(Request.WATCHDOG, ms)
        bench.wait(0.005)
        status = bench.status()
        if status.now - began >= ms * TICKS_PER_MS:
            raise Inconclusive(f"this line is too slow: {ms} ms went by before the device was asked")
        expect(f"the state 5 ms into a watchdog time of {ms} ms ({what})", status.state, State.READY)


@case("SAF-003", "REQ-009", "STA-003")
def test_a_long_watchdog_time_ends(bench: Bench) -> None:
    """A watchdog time beyond 2³² core cycles fires in time: 10.7 s, and 60 s on a device that simulates time."""
    ms = MOST_MS if bench.can(Need.FREE_TIME) else 2**32 // PER_MS["core cycles"] + 1
    enable(bench, ms)
    last = bench.must(NoOp()).now
    await_firing(bench, last, last, ms)


# Total drives

LIMITS = pytest.mark.parametrize("limit", [0, 1])
TOTAL_BITS = range(7, 19)


def totals(limit: int) -> list[int]:
    """Total drives above a limit, in thousandths; a narrow number keeps at most half of the limit, or is negative."""
    return [2**bits + 500 * limit for bits in TOTAL_BITS if 2**bits > 1000 * limit]


def driven(total: int) -> Pulses:
    """Pulses of a total drive in thousandths."""
    widths = widths_for(total)
    return Pulses([0] * CHANNELS, widths + [0] * (CHANNELS - len(widths)))


def too_heavy(bench: Bench, body: Slot | Update, limit: int) -> list[Wrong]:
    """Blocks like a given silent one, with each of the total drives, which are above a limit."""
    payloads = {total: packed((0, width) for width in widths_for(total)) for total in totals(limit)}
    return [
        Wrong(f"a total drive of {total} thousandths", forge(bench, body, payload), Reason.DRIVE)
        for total, payload in some(bench, payloads.items())
    ]


@case("SAF-006", "REQ-010", features=Feature.SEQUENCES)
@LIMITS
def test_the_drive_of_a_slot_is_summed_up_whole(bench: Bench, limit: int) -> None:
    """Above a low limit a slot is refused with DRIVE for any drive up to 262 transducers; none of them plays."""
    bench.order(Request.LIMIT, limit)
    bench.must(NoOp())
    try:
        refuse(bench, too_heavy(bench, Slot(0, SILENT), limit))
    finally:
        bench.must(Slot(0, SILENT))  # in any case no heavy slot is left


@case("SAF-006", "REQ-010", allow=(Risk.DRIVE,))
@LIMITS
def test_the_drive_of_an_update_is_summed_up_whole(bench: Bench, limit: int) -> None:
    """Above a low limit an update is refused with DRIVE for any drive up to 262 transducers."""
    bench.order(Request.LIMIT, limit)
    begin(bench)
    refuse(bench, too_heavy(bench, Update(SILENT), limit))


@case("SAF-006", "REQ-010", features=Feature.SEQUENCES)
@LIMITS
def test_the_drive_of_a_stored_slot_is_kept_whole(bench: Bench, limit: int) -> None:
    """No slot that was stored under a higher limit plays above a lower one, for any drive."""
    stored = some(bench, [total for total in totals(limit) if total <= 1000 * bench.drive_limit])
    for slot, total in enumerate(stored):
        bench.must(Slot(slot, driven(total)))
    bench.must(Entries(tuple(Entry(slot, 1) for slot in range(len(stored)))))
    bench.order(Request.LIMIT, limit)
    enable(bench)
    let_stores_go(bench)
    wrong = [
        Wrong(f"a slot of {total} thousandths", forge(bench, PlaySequence(slot, 1)), Reason.DRIVE)
        for slot, total in enumerate(stored)
    ]
    refuse(bench, wrong)


@case("SAF-006", "REQ-010", allow=(Risk.DRIVE,), features=Feature.SEQUENCES)
@pytest.mark.parametrize("limit", [33, 66, 132, 197, 256, 263])
def test_a_drive_limit_is_kept_whole(bench: Bench, limit: int) -> None:
    """Limits of which 8 or 16 bits of transducers or of their thousandths leave almost nothing still allow 20."""
    if limit > bench.info.drive_limit:
        raise NotApplicable(f"the device allows {bench.info.drive_limit} transducers at most")
    bench.order(Request.LIMIT, limit)
    expect("drive_limit in STATUS", bench.status().drive_limit, limit)
    bench.must(Slot(0, driven(20_000)))


# Sequences

LONG_PERIODS = 40_000
"""A second: a case examines what plays in less."""
AT_ONCE_PERIODS = 400
"""Time after which a sequence is over if a narrow number counts its periods."""


def parts(periods: int) -> tuple[list[int], int]:
    """Entries and repeats of a sequence of such a duration, or up to one repeat longer, with few repeats."""
    repeats = -(-periods // (SEQUENCE_ENTRIES * MOST_ENTRY_PERIODS))
    once = -(-periods // repeats)
    whole, rest = divmod(once, MOST_ENTRY_PERIODS)
    return [MOST_ENTRY_PERIODS] * whole + [rest] * (rest > 0), repeats


LONGEST_PERIODS = SEQUENCE_ENTRIES * MOST_ENTRY_PERIODS * 100
DURATIONS = [
    *((what, *parts(time + 1)) for what, time in spans(PER_PERIOD, LONG_PERIODS, LONGEST_PERIODS)),
    ("16 bits of periods, 256 times 256", [256], 256),
    ("32 bits of periods, 131 072 times 32 768", [65_535, 65_535, 2], 32_768),
    ("16 bits of an entry's end, twice", [40_000, 25_600], 2),
    ("15 bits of repeats", [1], 40_000),
    ("the longest entry, as often as can be", [65_535], 65_535),
]
"""For each the defect that it shows, the periods of its entries, and its repeats."""


@case("BLK-015", "STA-003", "BLK-022", "REQ-003", features=Feature.SEQUENCES)
def test_the_duration_of_a_sequence_is_counted_whole(bench: Bench) -> None:
    """Sequences whose duration leaves almost nothing in few bits play on, and their data stay in use."""
    enable(bench)
    pulses = bench.weak()
    bench.must(Slot(7, pulses))
    for what, periods, repeats in some(bench, DURATIONS):
        entries = [Entry(7, each) for each in periods]
        for at in range(0, len(entries), ENTRIES_PER_BLOCK):
            bench.must(Entries(tuple(entries[at : at + ENTRIES_PER_BLOCK]), at))
        bench.unasked.clear()
        began = bench.must(PlaySequence(0, len(periods), repeats=repeats)).commit_period
        bench.wait_until(began + AT_ONCE_PERIODS)
        ack = bench.send(Slot(7, SILENT))
        status = bench.status()
        if status.period >= began + sum(periods) * repeats:
            raise Inconclusive(f"this line is too slow: {sum(periods)} periods, {repeats} times, went by")
        told = (status.state, status.flags, status.since_period)
        wanted = (State.PLAYING, StatusFlag.SEQUENCE, began)
        expect(f"state, flags and since_period of a sequence that is too long for {what}", told, wanted)
        expect(f"the reason for a slot of a sequence that is too long for {what}", ack.reason, Reason.IN_USE)
        expect("the unsolicited records", bench.unasked, [])
        bench.wait_until(bench.must(Output(Action.SILENCE)).commit_period)


@case("BLK-015", "STA-003", "ACK-006", features=Feature.SEQUENCES)
@pytest.mark.parametrize(
    ("once", "repeats"), [(16, 16), (1, 257), (256, 256), (65_535, 1), (2, 32_769), (1, 65_535)], ids=str
)
def test_a_sequence_ends_with_the_last_period_of_its_duration(bench: Bench, once: int, repeats: int) -> None:
    """A sequence whose duration is a power of two, or near one, ends in time, to the tick."""
    enable(bench)
    bench.must(Slot(7, bench.weak()))
    bench.must(Entries((Entry(7, once),)))
    bench.unasked.clear()
    began = bench.must(PlaySequence(0, 1, repeats=repeats)).commit_period
    told = bench.await_unasked((once * repeats + 4000) / CARRIER_HZ + 1)
    expect("the state in the record", (told.state, told.since_period), (State.READY, 0))
    expect("the tick of the end", told.now, (began + once * repeats) * TICKS_PER_PERIOD)


@case("REQ-007", "BLK-015", "CHN-015", features=Feature.SEQUENCES | Feature.READ_BACK)
def test_the_place_in_a_sequence_is_counted_whole(bench: Bench) -> None:
    """After 2¹⁶ periods of a sequence PULSES answers the entry that plays, in the first pass and in the second."""
    enable(bench)
    slots = [bench.weak(), bench.weak()]
    for number, pulses in enumerate(slots):
        bench.must(Slot(number, pulses))
    bench.must(Entries((Entry(0, 40_000), Entry(1, 30_000))))
    let_stores_go(bench)
    began = bench.must(PlaySequence(0, 2)).commit_period
    for at, since, slot in ((66_000, 40_000, 1), (71_000, 70_000, 0)):
        bench.wait_until(began + at)
        reading = bench.read_back()
        if reading.read_period >= began + since + 30_000:
            raise Inconclusive("this line is too slow for the sequence")
        expect(f"since_period {at} periods into the sequence", reading.since_period, began + since)
        expect(f"whether PULSES are those of slot {slot}", reading.pulses == slots[slot], True)


# What is stored and looked for

LATE_ENTRIES = (ENTRIES_PER_BLOCK, 255, 256, 512, 1023)
LATE_SAMPLES = (SAMPLES_PER_BLOCK, 511, 512, 1024, 2048, 4095)
"""Places after the first block of either, and at the ends of tables of 8 bits or other powers of two."""


def store_but(bench: Bench, size: int, gaps: tuple[int, ...], at_once: int, store: Callable[[int, int], Body]) -> None:
    """Store everything of a table or a buffer except some places."""
    for gap, behind in pairwise((-1, *gaps, size)):
        for first in range(gap + 1, behind, at_once):
            bench.must(store(first, min(at_once, behind - first)))


def silent_entries(first: int, count: int) -> Body:
    """Entries of slot 0, for a period each."""
    return Entries((Entry(0, 1),) * count, first)


def empty(bench: Bench, what: str, body: Body) -> None:
    """Check that a block is refused with EMPTY."""
    refuse(bench, [Wrong(f"all, if {what} was never stored", forge(bench, body), Reason.EMPTY)])


@case("BLK-021", "BLK-014", allow=(Risk.RESET,), features=Feature.SEQUENCES)
def test_what_a_sequence_lacks_is_missed_wherever_it_stands(bench: Bench) -> None:
    """A SEQUENCE of all 1024 entries is refused with EMPTY for one entry, and for one slot, from place 120 on."""
    bench.restart(lambda: bench.order(Request.RESET))
    begin(bench)
    bench.must(Slot(0, SILENT))
    store_but(bench, SEQUENCE_ENTRIES, LATE_ENTRIES, ENTRIES_PER_BLOCK, silent_entries)
    for place in LATE_ENTRIES:
        empty(bench, f"entry {place}", PlaySequence(0, SEQUENCE_ENTRIES))
        bench.must(silent_entries(place, 1))
    for slot, place in enumerate(LATE_ENTRIES, 1):
        bench.must(Entries((Entry(slot, 1),), place))
    for slot, place in enumerate(LATE_ENTRIES, 1):
        empty(bench, f"the slot of entry {place}", PlaySequence(0, SEQUENCE_ENTRIES))
        bench.must(Slot(slot, SILENT))
    bench.must(PlaySequence(0, SEQUENCE_ENTRIES))


@case("BLK-021", "BLK-016", allow=(Risk.RESET,), features=Feature.MODULATION)
def test_what_a_modulation_lacks_is_missed_wherever_it_stands(bench: Bench) -> None:
    """A MODULATION of all 4096 samples is refused with EMPTY for one sample from place 480 on."""
    bench.restart(lambda: bench.order(Request.RESET))
    begin(bench)
    store_but(
        bench, MODULATION_SAMPLES, LATE_SAMPLES, SAMPLES_PER_BLOCK, lambda first, count: Samples(b"\xff" * count, first)
    )
    for place in LATE_SAMPLES:
        empty(bench, f"sample {place}", AmplitudeModulation(0, MODULATION_SAMPLES, 1))
        bench.must(Samples(b"\xff", place))
    bench.must(AmplitudeModulation(0, MODULATION_SAMPLES, 1))


@case("SAF-006", "BLK-022", "REQ-010", features=Feature.SEQUENCES)
@pytest.mark.parametrize("place", LATE_ENTRIES)
def test_a_slot_is_judged_and_guarded_wherever_it_stands(bench: Bench, place: int) -> None:
    """The slot of a late entry of a whole-table SEQUENCE is judged by the limit, and is in use while it plays."""
    bench.must(Slot(0, SILENT))
    bench.must(Slot(1, driven(1004)))
    store_but(bench, SEQUENCE_ENTRIES, (), ENTRIES_PER_BLOCK, silent_entries)
    bench.must(Entries((Entry(1, 1),), place))
    bench.order(Request.LIMIT, 1)
    enable(bench)
    refuse(bench, [Wrong("a slot above the limit", forge(bench, PlaySequence(0, SEQUENCE_ENTRIES)), Reason.DRIVE)])
    bench.must(Slot(1, SILENT))
    bench.must(PlaySequence(0, SEQUENCE_ENTRIES))
    let_stores_go(bench)
    over = (Slot(1, SILENT), silent_entries(place, 1))
    refuse(bench, [Wrong("a store over what plays", forge(bench, body), Reason.IN_USE) for body in over])


@case("BLK-022", features=Feature.MODULATION)
def test_a_sample_is_guarded_wherever_it_stands(bench: Bench) -> None:
    """While all 4096 samples modulate none of them can be overwritten, not even from place 480 on."""
    enable(bench)
    store_but(bench, MODULATION_SAMPLES, (), SAMPLES_PER_BLOCK, lambda first, count: Samples(b"\xff" * count, first))
    bench.must(AmplitudeModulation(0, MODULATION_SAMPLES, 1))
    let_stores_go(bench)
    wrong = [Wrong(f"sample {place}", forge(bench, Samples(b"\xff", place)), Reason.IN_USE) for place in LATE_SAMPLES]
    refuse(bench, wrong)


# Periods far ahead

CHANGES: dict[str, Callable[[int], Change]] = {
    "update": lambda period: Update(SILENT, period),
    "sequence": lambda period: PlaySequence(0, 1, period),
    "modulation": lambda period: AmplitudeModulation(0, 1, 1, period),
    "end-of-modulation": lambda period: Output(Action.END_MODULATION, period),
    "silence": lambda period: Output(Action.SILENCE, period),
    "disable": lambda period: Output(Action.DISABLE, period),
}
FAR_SPANS = spans(PER_PERIOD, LONG_PERIODS, HORIZON_PERIODS - LONG_PERIODS)


@case("BLK-005", "BLK-010", "BLK-018", "TIM-002")
@pytest.mark.parametrize("kind", CHANGES)
def test_a_change_waits_for_its_period_however_far_it_is(bench: Bench, kind: str) -> None:
    """A change for a period that is near in few bits of periods, ticks or cycles takes a place, and has no effect."""
    change = CHANGES[kind]
    require(bench, features_of(change(0)))
    enable(bench)
    for body in known(bench, Slot(0, SILENT), Entries((Entry(0, 1),)), Samples(b"\xff")):
        bench.must(body)
    let_stores_go(bench)
    for what, ahead in some(bench, FAR_SPANS):
        bench.enable()
        playing = bench.must(Update(SILENT)).commit_period
        modulated = kind == "end-of-modulation"
        if modulated:
            bench.wait_until(bench.must(AmplitudeModulation(0, 1, 1)).commit_period)
        near = soon(bench, 2)
        ack = bench.must(change(near + ahead))
        told = (ack.commit_period, ack.late)
        expect(f"commit_period and LATE of a change that is near in {what}", told, (near + ahead, False))
        bench.wait_until(near + PROMISED_PERIODS)
        status = bench.status()
        if status.period >= near + ahead:
            raise Inconclusive(f"this line is too slow: period {near + ahead} has come")
        flags = StatusFlag.MODULATION if modulated else StatusFlag(0)
        expect(
            f"state, flags, since_period and free while a change waits that is near in {what}",
            (status.state, status.flags, status.since_period, status.free),
            (State.PLAYING, flags, playing, bench.info.queue_blocks - 1),
        )
        bench.disable()


@case("BLK-010", "BLK-008", "TIM-002")
@pytest.mark.parametrize("kind", ["update", "silence"])
def test_what_is_beyond_the_horizon_is_refused_however_it_is_counted(bench: Bench, kind: str) -> None:
    """Periods that are near in 32 to 63 bits, or in 64 bits of ticks or cycles, are refused, whatever is queued."""
    begin(bench)
    near = soon(bench, 20)
    bench.must(Output(Action.SILENCE, near + 2**31))  # the arrival counts, not what is queued
    beyond = {f"{bits} bits of periods": 2**bits for bits in (32, 33, 40, 48, 56, 62, 63)}
    for name, count in PER_PERIOD.items():
        beyond |= {f"{bits} bits of {name}": -(-(2**bits) // count) for bits in (63, 64) if count > 1}
    wrong = {what: forge(bench, CHANGES[kind](near + ahead)) for what, ahead in beyond.items()}
    with in_time(bench, near):
        refuse(bench, some(bench, [Wrong(f"near in {what}", block, Reason.HORIZON) for what, block in wrong.items()]))


@case("BLK-023")
def test_how_far_updates_are_apart_is_counted_whole(bench: Bench) -> None:
    """Two updates that are far apart, but one period apart in few bits, are not refused with RATE."""
    if bench.info.periods_per_update == 1:
        raise NotApplicable("its chain can carry an update in every period")
    enable(bench)
    for bits in BITS[:-1]:
        bench.enable()
        first = bench.must(Update(SILENT, soon(bench, 2))).commit_period
        bench.must(Update(SILENT, first + 2**bits + 1))
        bench.disable()


# Wraps of counters

PER_SECOND = {"ms": 1_000, "µs": 1_000_000, **{name: 40_000 * count for name, count in PER_PERIOD.items()}}
AROUND_SECONDS = 20
"""The time before and after a wrap, because a counter may have started some seconds before period 0."""


@case("TIM-002/1", "SAF-003", "SAF-005", "BLK-005", "BLK-015", "CHN-026", needs=(Need.FREE_TIME,))
@pytest.mark.parametrize("unattended", [False, True], ids=["attended", "unattended"])
def test_nothing_goes_wrong_where_a_count_wraps(bench: Bench, unattended: bool) -> None:
    """Watchdog, queue, sequences and lateness hold when 31 and 32 bits of ms, µs, ticks, cycles or periods wrap."""
    require(bench, Feature.SEQUENCES | Feature.READ_BACK | (Feature.UNATTENDED if unattended else Feature(0)))
    for name, count in PER_SECOND.items():
        for bits in (31, 32):
            edge = 2**bits * CARRIER_HZ // count
            bench.note("a count wraps", f"{bits} bits of {name}, at period {edge}")
            with bench.spare() as device:
                device.wait_periods(max(edge - AROUND_SECONDS * CARRIER_HZ - device.period(), 0))
                check_wrap(device, edge, unattended)
                check_beyond(device)


def check_wrap(device: Bench, edge: int, unattended: bool) -> None:
    """Let a sequence end, an update begin and the watchdog fire near the wrap of a counter."""
    enable(device)
    device.must(Slot(0, SILENT))
    device.must(Slot(1, pulses := device.weak()))
    device.must(Entries((Entry(0, 30),)))
    device.unasked.clear()
    ends = edge + (-10 if unattended else 250)  # the watchdog's time counts from the end of an unattended one
    device.must(PlaySequence(0, 1, ends - 300, repeats=10, unattended=unattended))
    device.must(Update(pulses, edge + 1000))
    last = device.must(NoOp()).now
    since = ends * TICKS_PER_PERIOD if unattended else last
    ms = ((edge + AROUND_SECONDS * CARRIER_HZ) * TICKS_PER_PERIOD - since) // TICKS_PER_MS
    device.order(Request.WATCHDOG, ms)
    expect("the tick at which the sequence ends", device.await_unasked(2 * AROUND_SECONDS).now, ends * TICKS_PER_PERIOD)
    device.wait_until(edge + 1001)
    expect("since when the update plays", device.read_back().since_period, edge + 1000)
    await_firing(device, since, since, ms)


def check_beyond(device: Bench) -> None:
    """Check lateness, the horizon, and the clock itself."""
    enable(device)
    ack = device.must(Update(SILENT, 1))
    expect("LATE of a change for period 1", ack.late, True)
    assert ack.commit_period <= ack.now_period + PROMISED_PERIODS, (
        f"a change for period 1 takes effect at period {ack.commit_period}, its block had arrived in {ack.now_period}"
    )
    horizon = device.period() + HORIZON_PERIODS
    device.must(Output(Action.SILENCE, horizon - 100))
    refuse(device, [Wrong("beyond", forge(device, Output(Action.SILENCE, horizon + LONG_PERIODS)), Reason.HORIZON)])
    check_sync(device)
