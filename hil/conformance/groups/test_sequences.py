"""Sequences: slots, entries of the table, and how they play (clauses BLK-013 to BLK-015, BLK-021 and BLK-022)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import only
from phasewire.hil.conformance.tools.player import Player, in_time, is_fast
from phasewire.hil.conformance.tools.steps import check_refused, expect_all, require
from phasewire.protocol.blocks import Body, Change, Entries, Entry, NoOp, Output, PlaySequence, Slot, Update
from phasewire.protocol.board import CHANNELS
from phasewire.protocol.codes import (
    ENTRIES_PER_BLOCK,
    PROMISED_PERIODS,
    SEQUENCE_ENTRIES,
    SILENT_PERIODS,
    SLOTS,
    Action,
    Feature,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.pulses import Pulses

SETTLED_PERIODS = 400
"""Time for all stores to go onto the chain, and for all due changes to take effect."""

WATCHDOG_MS, PERIODS_PER_MS = 200, 40

SEQUENCES = Feature.SEQUENCES
CAPTURE = [Need.CAPTURE]


def store(player: Player, entries: list[Entry], first: int = 0) -> None:
    """Store entries, in as many blocks as they need, and weak pulses in the slots that they name."""
    slots = sorted({entry.slot for entry in entries})
    player.send_all(Slot(slot, player.bench.weak()) for slot in slots)
    player.send_all(
        Entries(tuple(entries[at : at + ENTRIES_PER_BLOCK]), first + at)
        for at in range(0, len(entries), ENTRIES_PER_BLOCK)
    )


# How it plays


@case("BLK-015", "BLK-013", "BLK-014", "TIM-003", "CHN-014", features=SEQUENCES, needs=CAPTURE)
@pytest.mark.parametrize(
    "periods",
    [[1], [7], [1, 1], [3, 1, 5], [1, 2, 1, 9, 4], [100, 100], [257, 512, 4], [1] * 50],
    ids=["one-period", "one-entry", "two-periods", "three", "five", "two-sides", "long-ones", "fifty-of-a-period"],
)
def test_a_sequence_loops_without_a_gap(bench: Bench, player: Player, periods: list[int]) -> None:
    """Entries play each for its periods, and the first follows the last without a gap, on all ten processors."""
    slots = bench.random.sample(range(SLOTS), min(len(periods), 8))
    first = bench.random.randrange(SEQUENCE_ENTRIES - len(periods))
    store(player, [Entry(slots[place % len(slots)], each) for place, each in enumerate(periods)], first)
    begin = player.begin(PlaySequence(first, len(periods)))
    player.judge(begin - 5, begin + 4 * sum(periods) + 7)


@case("BLK-015", "BLK-014", "CHN-012/2", "CHN-015", features=SEQUENCES, needs=CAPTURE)
def test_the_whole_table_plays(bench: Bench, player: Player) -> None:
    """A sequence of all 1024 entries, of one to three periods each, plays each of them, and then the first again."""
    slots = bench.random.sample(range(SLOTS), 6)
    store(player, [Entry(bench.random.choice(slots), bench.random.randrange(1, 4)) for _ in range(SEQUENCE_ENTRIES)])
    begin = player.begin(PlaySequence(0, SEQUENCE_ENTRIES))
    player.judge(begin - 1, begin + 3 * SEQUENCE_ENTRIES + 50)


@case("BLK-014", "BLK-015", features=SEQUENCES, needs=CAPTURE)
@pytest.mark.parametrize(("first", "count"), [(0, 1), (1023, 1), (904, 120), (1012, 12), (119, 3), (11, 2), (12, 13)])
def test_a_sequence_plays_its_part_of_the_table(bench: Bench, player: Player, first: int, count: int) -> None:
    """A sequence plays exactly `count` entries from `first`, up to the end of the table."""
    store(player, [Entry(bench.random.choice((9, 10, 11)), bench.random.randrange(1, 4)) for _ in range(count)], first)
    player.send(Slot(12, bench.weak()))
    beside = [place for place in (first - 1, first + count) if 0 <= place < SEQUENCE_ENTRIES]
    player.send_all(Entries((Entry(12, 2),), place) for place in beside)
    begin = player.begin(PlaySequence(first, count))
    player.judge(begin - 2, begin + 7 * count)


@case("BLK-013", "BLK-014", "CHN-012", features=SEQUENCES, needs=CAPTURE)
def test_slots_of_every_number_are_kept_apart(bench: Bench, player: Player) -> None:
    """Each slot plays what was stored in it last: all 256, or fewer on a slow line."""
    edges = [0, 1, 127, 128, 129, 254, 255, 64, 63, 32, 192, 16]
    others = bench.random.sample([number for number in range(SLOTS) if number not in edges], SLOTS - len(edges))
    numbers = [*edges, *others][: bench.tries(SLOTS, len(edges))]
    player.send_all(Slot(number, bench.weak()) for number in numbers)
    player.send_all(Slot(number, bench.weak()) for number in numbers[:3])
    entries = [Entry(number, 1) for number in bench.random.sample(numbers, len(numbers))]
    for at in range(0, len(entries), ENTRIES_PER_BLOCK):
        player.send(Entries(tuple(entries[at : at + ENTRIES_PER_BLOCK]), at))
    begin = player.begin(PlaySequence(0, len(entries)))
    player.judge(begin - 2, begin + len(entries) + 10)


@case("BLK-014", "CHN-012", features=SEQUENCES, needs=CAPTURE)
def test_what_is_stored_last_plays(bench: Bench, player: Player) -> None:
    """Entries and slots stored over others replace them, and do not change their neighbours."""
    store(player, [Entry(slot, 1 + slot) for slot in (1, 2, 3, 4, 5, 6)], 30)
    player.send_all([Entries((Entry(6, 3), Entry(1, 1)), 32), Slot(2, bench.weak()), Entries((Entry(3, 1),), 32)])
    begin = player.begin(PlaySequence(30, 6))
    player.judge(begin - 2, begin + 40)


@case("BLK-014", "BLK-015", "CHN-015", features=SEQUENCES, needs=CAPTURE)
def test_an_entry_of_65535_periods_ends_in_time(player: Player) -> None:
    """The longest entry, 1.6 s, ends exactly after its last period."""
    store(player, [Entry(3, 65_535), Entry(4, 2)], 512)
    begin = player.begin(PlaySequence(512, 2))
    for place in (0, 127, 255, 300, 32_767, 65_535):
        player.judge(begin + place - 5, begin + place + 20)


@case("CHN-015", "TIM-003", "BLK-015", features=SEQUENCES, needs=CAPTURE)
def test_entries_stay_in_step_long_after_the_start(bench: Bench, player: Player) -> None:
    """Long after its start, with stores and questions meanwhile, a sequence plays the entry that is due."""
    store(player, [Entry(slot, periods) for slot, periods in [(20, 1), (21, 3), (22, 1), (23, 2), (20, 4)]], 700)
    begin = player.send(PlaySequence(700, 5)).commit_period
    for number in range(bench.tries(20, 4, 3)):
        player.send_all([Slot(100 + number, bench.weak()), Entries((Entry(100, 1),) * 120, 120 * (number % 5)), NoOp()])
        bench.status()
        bench.wait_periods(2000)
    last = bench.period()
    assert last > begin, f"period {last} should be later than {begin}"
    player.judge(last - 600, last)


# How it ends


@case("BLK-015", "ACK-006", "STA-003", "REQ-003", outputs=("BLK-015",), features=SEQUENCES)
@pytest.mark.parametrize("repeats", [1, 2, 3, 7, 256])
def test_repeats_are_exact_and_then_there_is_silence(bench: Bench, player: Player, repeats: int) -> None:
    """A sequence plays as often as specified and falls silent in the next period; a record says so, with READY."""
    store(player, [Entry(40, 2), Entry(41, 1), Entry(42, 3)], 60)
    begin = player.soon()
    bench.unasked.clear()
    player.send(PlaySequence(60, 3, begin, repeats=repeats))
    end = begin + 6 * repeats
    bench.wait_until(end)
    said = bench.await_unasked(1)
    expect("the state in the record", (said.state, said.since_period, said.flags), (State.READY, 0, StatusFlag(0)))
    assert said.period >= end, f"the record names period {said.period}, should name {end} or soon after"
    status = bench.status()
    expect("the state", (status.state, status.since_period, status.flags), (State.READY, 0, StatusFlag(0)))
    player.judge(begin - 2, end + 30)


@case("BLK-015", "REQ-003", "STA-003", features=SEQUENCES)
@pytest.mark.parametrize("unattended", [False, True], ids=["attended", "unattended"])
def test_a_sequence_is_told_in_the_status(bench: Bench, player: Player, unattended: bool) -> None:
    """While a sequence plays the status has its flag, the period of its start, and PLAYING or UNATTENDED."""
    store(player, [Entry(50, 1), Entry(51, 1)], 0)
    expect_all(bench.status(), " before", state=State.READY, since_period=0)
    ack = player.send(PlaySequence(0, 2, unattended=unattended and bool(bench.info.features & Feature.UNATTENDED)))
    bench.wait_until(ack.commit_period + 1)
    status = bench.status()
    playing = State.UNATTENDED if unattended and bench.info.features & Feature.UNATTENDED else State.PLAYING
    expect_all(status, state=playing, since_period=ack.commit_period, flags=StatusFlag.SEQUENCE)


ENDS: dict[str, Change] = {
    "update": Update(only(100)),
    "sequence": PlaySequence(1, 1),
    "the-same-sequence": PlaySequence(0, 3),
    "silence": Output(Action.SILENCE),
    "disable": Output(Action.DISABLE),
}


@case("BLK-015", "BLK-012", "BLK-018", outputs=("BLK-015", "BLK-012", "BLK-018", "TIM-003"), features=SEQUENCES)
@pytest.mark.parametrize("end", ENDS)
def test_a_sequence_is_ended_at_a_period(bench: Bench, player: Player, end: str) -> None:
    """An update, another sequence, the same one anew, SILENCE and DISABLE end a sequence at their periods."""
    store(player, [Entry(0, 3), Entry(1, 2), Entry(2, 4)])
    begin = player.send(PlaySequence(0, 3)).commit_period
    period = player.soon()
    player.send(replace(ENDS[end], period=period))
    bench.wait_until(period + 10)
    status = bench.status()
    states = {"silence": State.READY, "disable": State.OFF}
    expect_all(status, state=states.get(end, State.PLAYING), since_period=0 if end in states else period)
    expect("whether a sequence plays", StatusFlag.SEQUENCE in status.flags, "sequence" in end)
    assert begin < period, f"the sequence began at {begin}, after what ends it at {period}"
    player.judge(period - 30, period + 40)


@case("SAF-004", outputs=("SAF-004", "BLK-015", "BLK-022"), features=SEQUENCES)
def test_disable_ends_a_sequence(bench: Bench, player: Player) -> None:
    """DISABLE silences a sequence within six periods, and it does not play again after the next ENABLE."""
    store(player, [Entry(0, 3), Entry(1, 2)])
    player.send(PlaySequence(0, 2))
    bench.wait_periods(100)
    bench.order(Request.DISABLE)
    off = bench.period() + SILENT_PERIODS
    bench.wait_until(off + 1)
    bench.enable()
    expect("the state", bench.status().state, State.READY)
    bench.wait_periods(100)
    last = bench.period()
    player.score.silence(off)
    player.judge(off, last)


NOT_ENDS: dict[str, Callable[[Bench], object]] = {
    "enable": lambda bench: bench.enable(),
    "end-of-modulation": lambda bench: bench.must(Output(Action.END_MODULATION)),
    "a-new-numbering": lambda bench: bench.must(NoOp(), restart=True),
    "a-refused-update": lambda bench: bench.send(Update(Pulses.silent(CHANNELS), 2**64 - 1)),
    "clear-faults": lambda bench: bench.order(Request.CLEAR_FAULTS),
}


@case("BLK-015", "BLK-008", "BLK-018", "REQ-005", outputs=("BLK-015",), features=SEQUENCES)
@pytest.mark.parametrize("what", NOT_ENDS)
def test_nothing_else_ends_a_sequence(bench: Bench, what: str) -> None:
    """ENABLE, END_MODULATION, a new numbering, a refused update and CLEAR_FAULTS do not disturb a sequence."""
    if what == "end-of-modulation":
        require(bench, Feature.MODULATION)
    player = Player(bench)
    store(player, [Entry(0, 3), Entry(1, 2), Entry(2, 4)])
    ack = player.send(PlaySequence(0, 3))
    bench.wait_periods(SETTLED_PERIODS)
    before = bench.period()
    NOT_ENDS[what](bench)
    bench.wait_periods(40)
    after = bench.period()
    expect("since_period", bench.status().since_period, ack.commit_period)
    player.judge(before, after)


@case("CHN-014/2", outputs=("CHN-014/2", "BLK-007", "BLK-015"), features=SEQUENCES)
def test_sequences_queued_behind_each_other_begin_in_time(bench: Bench, player: Player) -> None:
    """Sequences queued a few periods apart begin each at its own period, while the one before still plays."""
    store(player, [Entry(slot, 1) for slot in (30, 31, 32, 33, 34, 35)])
    before = bench.status()
    period = player.soon(4)
    apart = PROMISED_PERIODS + 1
    player.send_all(PlaySequence(number, 2, period + apart * number) for number in range(4))
    bench.wait_until(period + 4 * apart)
    expect("missed commits", bench.status().missed_commits, before.missed_commits)
    player.judge(period - 5, period + 4 * apart + 20)


@case("SAF-005", "STA-003", outputs=("SAF-005",), features=SEQUENCES | Feature.UNATTENDED)
def test_an_unattended_sequence_plays_without_its_host(bench: Bench, player: Player) -> None:
    """With UNATTENDED a sequence plays on beyond the watchdog's time, to its last repeat; then the watchdog runs."""
    store(player, [Entry(0, 10), Entry(1, 10)])
    bench.order(Request.WATCHDOG, WATCHDOG_MS)
    repeats = 5 * WATCHDOG_MS * PERIODS_PER_MS // 20
    begin = player.send(PlaySequence(0, 2, repeats=repeats, unattended=True)).commit_period
    end = begin + 20 * repeats
    bench.wait_until(end + 2 * WATCHDOG_MS * PERIODS_PER_MS)
    expect("the state, the watchdog's time after the end", bench.status().state, State.OFF)
    expect("whether the watchdog fired", bench.status().watchdog_fired, True)
    player.judge(end - 200, end + 50)


@case("SAF-005", "SAF-003", outputs=("SAF-005",), features=SEQUENCES)
def test_a_sequence_needs_its_host_unless_it_says_otherwise(bench: Bench, player: Player) -> None:
    """Without UNATTENDED a sequence is silenced by the watchdog like an update."""
    store(player, [Entry(0, 10), Entry(1, 10)])
    bench.order(Request.WATCHDOG, WATCHDOG_MS)
    ack = player.send(PlaySequence(0, 2))
    fires = ack.now_period + WATCHDOG_MS * PERIODS_PER_MS
    bench.wait_until(fires + 20)
    status = bench.status()
    expect("the state", (status.state, status.watchdog_fired), (State.OFF, True))
    player.score.silence(fires + 2 + SILENT_PERIODS)
    player.judge(fires - 1000, fires)
    player.judge(fires + 2 + SILENT_PERIODS, fires + 100)


# Reading back


@case("REQ-007", "BLK-015", "BLK-013", features=SEQUENCES | Feature.READ_BACK)
def test_the_entry_that_plays_is_read_back(bench: Bench, player: Player) -> None:
    """PULSES answers the slot of the entry that plays and the period at which this entry, not the sequence, began."""
    each = min(12_000 * bench.slowness, 60_000) if is_fast(bench) else 40_000
    store(player, [Entry(60, each), Entry(61, each)], 5)
    begin = player.send(PlaySequence(5, 2)).commit_period
    for number in range(3):
        bench.wait_until(begin + each * number + each // 4)
        back = bench.read_back()
        if back.read_period >= begin + each * (number + 1):
            raise TooSlow(f"this line is too slow: in period {back.read_period} the next entry plays")
        expect("since_period", back.since_period, begin + each * number)
        expect("whether they are its slot's pulses", back.pulses == player.score.at(back.read_period)[0], True)
        expect("since_period of the status", bench.status().since_period, begin)


# What may be stored while it plays


@case("BLK-022", "BLK-008", outputs=("BLK-022", "BLK-008"), features=SEQUENCES)
def test_what_a_sequence_plays_is_not_overwritten(bench: Bench, player: Player) -> None:
    """A store over a playing entry or slot is refused with IN_USE, even with the same bytes; the sequence plays on."""
    store(player, [Entry(70, 2), Entry(71, 1), Entry(72, 3)], 200)
    same = Slot(71, bench.weak())
    player.send(same)
    ack = player.send(PlaySequence(200, 3))
    bench.wait_until(ack.commit_period + 5)
    before = bench.period()
    entries = [Entries((Entry(73, 1),) * count, first) for count, first in ((2, 199), (2, 202), (120, 150))]
    stored: list[Body] = [same, Slot(70, bench.weak()), Slot(72, bench.weak()), Entries((Entry(71, 1),), 201), *entries]
    for body in stored:
        check_refused(bench, body, Reason.IN_USE)
    bench.wait_periods(SETTLED_PERIODS)
    after = bench.period()
    player.judge(after - min(after - before, 2000), after)


@case("BLK-022", "BLK-008", outputs=("BLK-022",), features=SEQUENCES)
def test_what_will_play_is_not_overwritten(bench: Bench, player: Player) -> None:
    """The entries and slots of a queued sequence are in use from its acceptance, before it begins."""
    store(player, [Entry(1, 3), Entry(2, 2)], 10)
    store(player, [Entry(3, 3), Entry(4, 2)], 20)
    player.send(PlaySequence(10, 2))
    period = player.soon(6) + SETTLED_PERIODS
    player.send(PlaySequence(20, 2, period))
    with in_time(bench, period):
        for slot, place in ((3, 21), (1, 10)):
            check_refused(bench, Slot(slot, bench.weak()), Reason.IN_USE)
            check_refused(bench, Entries((Entry(5, 1),), place), Reason.IN_USE)
    player.judge(period - 20, period + 20)


@case("BLK-022", features=SEQUENCES)
def test_what_two_sequences_share_stays_in_use(bench: Bench, player: Player) -> None:
    """A slot that a queued sequence also plays stays in use when the sequence that played it first has ended."""
    store(player, [Entry(1, 1), Entry(2, 1), Entry(1, 2)])
    player.send(PlaySequence(0, 2))
    ack = player.send(PlaySequence(2, 1, player.soon()))
    bench.wait_until(ack.commit_period + 2)
    check_refused(bench, Slot(1, bench.weak()), Reason.IN_USE)
    player.send_all([Slot(2, bench.weak()), Entries((Entry(2, 1),) * 2)])


@case("BLK-022", features=SEQUENCES)
def test_what_is_about_to_end_is_still_in_use(bench: Bench, player: Player) -> None:
    """A queued end does not free what plays: its slots may be stored again only after it has taken effect."""
    store(player, [Entry(1, 3), Entry(2, 2)], 10)
    player.send(PlaySequence(10, 2))
    period = player.soon(3) + SETTLED_PERIODS
    player.send(Update(bench.weak(), period))
    check_refused(bench, Slot(2, bench.weak()), Reason.IN_USE)
    bench.wait_until(period + 1)
    player.send(Slot(2, bench.weak()))


@case("BLK-013", "BLK-014", "SAF-002", "SAF-004", outputs=("BLK-013", "BLK-014"), features=SEQUENCES)
def test_what_is_stored_stays_over_disable(bench: Bench, player: Player) -> None:
    """Slots and entries can be stored while the outputs are off, and survive DISABLE and another session."""
    bench.disable()
    store(player, [Entry(6, 2), Entry(7, 1)], 50)
    expect("the reason for a sequence while off", bench.send(PlaySequence(50, 2)).reason, Reason.DISABLED)
    bench.must(NoOp(), restart=True)
    bench.enable()
    bench.disable()
    bench.enable()
    ack = player.send(PlaySequence(50, 2))
    player.judge(ack.commit_period, ack.commit_period + 10)


@case("USB-026", outputs=("USB-026", "BLK-013", "BLK-014"), features=SEQUENCES, line="usb")
@pytest.mark.parametrize("how", ["SET_CONFIGURATION", "SET_INTERFACE"])
def test_what_is_stored_stays_over_a_new_configuration(bench: Bench, how: str) -> None:
    """Slots and entries survive SET_CONFIGURATION, although what plays ends: they last until RESET."""
    again = {"SET_CONFIGURATION": bench.usb.set_configuration, "SET_INTERFACE": lambda: bench.usb.set_interface(0)}
    check_stored_over(bench, again[how])


@case("USB-026", outputs=("USB-026", "BLK-013", "BLK-014"), features=SEQUENCES, line="usb", allow=[Risk.RESET])
def test_what_is_stored_stays_over_a_bus_reset(bench: Bench) -> None:
    """Slots and entries survive a bus reset in run-time mode, which does not reset the device."""
    check_stored_over(bench, bench.usb.reset)


def check_stored_over(bench: Bench, disturb: Callable[[], None]) -> None:
    """Fail unless the stored data play after a disturbance that ends what plays."""
    player = Player(bench)
    store(player, [Entry(6, 2), Entry(7, 1)], 50)
    bench.wait_periods(SETTLED_PERIODS)
    disturb()
    bench.enable()
    ack = player.send(PlaySequence(50, 2))
    player.judge(ack.commit_period, ack.commit_period + 10)


# What was never stored


@case("BLK-021", "BLK-013", "REQ-013", features=SEQUENCES, allow=[Risk.RESET])
def test_what_was_never_stored_does_not_play(bench: Bench) -> None:
    """After RESET slots and entries are empty: a sequence is refused with EMPTY until all that it plays is stored."""
    bench.restart(lambda: bench.order(Request.RESET))
    player = Player(bench)
    check_refused(bench, PlaySequence(0, 1), Reason.EMPTY)
    check_refused(bench, PlaySequence(0, SEQUENCE_ENTRIES), Reason.EMPTY)
    player.send(Entries((Entry(8, 1), Entry(9, 1)), 500))
    check_refused(bench, PlaySequence(500, 2), Reason.EMPTY)
    player.send(Slot(8, bench.weak()))
    check_refused(bench, PlaySequence(500, 2), Reason.EMPTY)
    check_refused(bench, PlaySequence(501, 1), Reason.EMPTY)
    check_refused(bench, PlaySequence(499, 2), Reason.EMPTY)
    player.send(PlaySequence(500, 1))
    player.send(Slot(9, bench.weak()))
    check_refused(bench, PlaySequence(500, 3), Reason.EMPTY)
    check_refused(bench, PlaySequence(499, 3), Reason.EMPTY)
    player.send(PlaySequence(500, 2))
    expect("missed commits", bench.status().missed_commits, 0)
