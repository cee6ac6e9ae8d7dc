"""Sequences: slots, entries of the table, and what plays them (clauses BLK-013 to BLK-015, BLK-021 and BLK-022)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import only
from phasewire.hil.conformance.tools.stage import PROMISED_PERIODS, Stage, in_time, is_fast
from phasewire.hil.conformance.tools.steps import check_refused, require
from phasewire.protocol.blocks import Change, Entries, Entry, NoOp, Output, Sequence, Slot, Update
from phasewire.protocol.board import CHANNELS
from phasewire.protocol.codes import SILENT_PERIODS, Action, Feature, Reason, Request, State, StatusFlag
from phasewire.protocol.pulses import Pulses

TABLE, SLOTS, ENTRIES_PER_BLOCK = 1024, 256, 120
SETTLED_PERIODS = 400
"""In which every store has gone onto the chain, and every change that was due has taken effect."""

WATCHDOG_MS, PERIODS_PER_MS = 200, 40

SEQUENCES = Feature.SEQUENCES
CAPTURE = [Need.CAPTURE]


def store(stage: Stage, entries: list[Entry], first: int = 0) -> None:
    """Store entries, as many blocks as they need, and weak pulses in the slots that they name."""
    slots = sorted({entry.slot for entry in entries})
    stage.send_all(Slot(slot, stage.bench.weak()) for slot in slots)
    stage.send_all(
        Entries(tuple(entries[at : at + ENTRIES_PER_BLOCK]), first + at)
        for at in range(0, len(entries), ENTRIES_PER_BLOCK)
    )


# What a sequence plays


@case("BLK-015", "BLK-013", "BLK-014", "TIM-003", "CHN-014", features=SEQUENCES, needs=CAPTURE)
@pytest.mark.parametrize(
    "periods",
    [[1], [7], [1, 1], [3, 1, 5], [1, 2, 1, 9, 4], [100, 100], [257, 512, 4], [1] * 50],
    ids=["one-period", "one-entry", "two-periods", "three", "five", "two-sides", "long-ones", "fifty-of-a-period"],
)
def test_a_sequence_loops_without_a_gap(bench: Bench, periods: list[int]) -> None:
    """Entries play each for its periods, and again from the first with no period between, on all ten processors."""
    stage = Stage(bench)
    slots = bench.random.sample(range(SLOTS), min(len(periods), 8))
    first = bench.random.randrange(TABLE - len(periods))
    store(stage, [Entry(slots[place % len(slots)], each) for place, each in enumerate(periods)], first)
    begin = stage.soon()
    stage.send(Sequence(first, len(periods), begin))
    stage.judge(begin - 5, begin + 4 * sum(periods) + 7)


@case("BLK-015", "BLK-014", "CHN-012/2", "CHN-015", features=SEQUENCES, needs=CAPTURE)
def test_the_whole_table_plays(bench: Bench) -> None:
    """A sequence of all 1024 entries, of one to three periods each, plays every one of them, and the first again."""
    stage = Stage(bench)
    slots = bench.random.sample(range(SLOTS), 6)
    store(stage, [Entry(bench.random.choice(slots), bench.random.randrange(1, 4)) for _ in range(TABLE)])
    begin = stage.soon()
    stage.send(Sequence(0, TABLE, begin))
    stage.judge(begin - 1, begin + 3 * TABLE + 50)


@case("BLK-014", "BLK-015", features=SEQUENCES, needs=CAPTURE)
@pytest.mark.parametrize(("first", "count"), [(0, 1), (1023, 1), (904, 120), (1012, 12), (119, 3), (11, 2), (12, 13)])
def test_a_sequence_plays_its_part_of_the_table(bench: Bench, first: int, count: int) -> None:
    """A sequence plays `count` entries from `first` on, up to the end of the table, and none beside them."""
    stage = Stage(bench)
    store(stage, [Entry(bench.random.choice((9, 10, 11)), bench.random.randrange(1, 4)) for _ in range(count)], first)
    stage.send(Slot(12, bench.weak()))
    beside = [place for place in (first - 1, first + count) if 0 <= place < TABLE]
    stage.send_all(Entries((Entry(12, 2),), place) for place in beside)
    begin = stage.soon()
    stage.send(Sequence(first, count, begin))
    stage.judge(begin - 2, begin + 7 * count)


@case("BLK-013", "BLK-014", "CHN-012", features=SEQUENCES, needs=CAPTURE)
def test_slots_of_every_number_are_kept_apart(bench: Bench) -> None:
    """Each slot plays what was stored in it last and nobody else's, all 256, a dozen of them on slow lines."""
    stage = Stage(bench)
    numbers = [0, 1, 127, 128, 129, 254, 255, 64, 63, 32, 192, 16]
    if is_fast(bench):
        numbers = bench.random.sample(range(SLOTS), SLOTS)
    stage.send_all(Slot(number, bench.weak()) for number in numbers)
    stage.send_all(Slot(number, bench.weak()) for number in numbers[:3])
    entries = [Entry(number, 1) for number in bench.random.sample(numbers, len(numbers))]
    for at in range(0, len(entries), ENTRIES_PER_BLOCK):
        stage.send(Entries(tuple(entries[at : at + ENTRIES_PER_BLOCK]), at))
    begin = stage.soon()
    stage.send(Sequence(0, len(entries), begin))
    stage.judge(begin - 2, begin + len(entries) + 10)


@case("BLK-014", "CHN-012", features=SEQUENCES, needs=CAPTURE)
def test_what_is_stored_last_plays(bench: Bench) -> None:
    """Entries and slots that are stored over others take their place, and leave those beside them as they were."""
    stage = Stage(bench)
    store(stage, [Entry(slot, 1 + slot) for slot in (1, 2, 3, 4, 5, 6)], 30)
    stage.send_all([Entries((Entry(6, 3), Entry(1, 1)), 32), Slot(2, bench.weak()), Entries((Entry(3, 1),), 32)])
    begin = stage.soon()
    stage.send(Sequence(30, 6, begin))
    stage.judge(begin - 2, begin + 40)


@case("BLK-014", "BLK-015", "CHN-015", features=SEQUENCES, needs=CAPTURE)
def test_an_entry_of_65535_periods_ends_in_time(bench: Bench) -> None:
    """The longest entry, 1.6 s, gives way to the next one exactly behind its last period."""
    stage = Stage(bench)
    store(stage, [Entry(3, 65_535), Entry(4, 2)], 512)
    begin = stage.soon()
    stage.send(Sequence(512, 2, begin))
    for place in (0, 127, 255, 300, 32_767, 65_535):
        stage.judge(begin + place - 5, begin + place + 20)


@case("CHN-015", "TIM-003", "BLK-015", features=SEQUENCES, needs=CAPTURE)
def test_entries_stay_in_step_long_after_the_start(bench: Bench) -> None:
    """Long after its start, with stores and questions beside, a sequence has the entry that the period asks for."""
    stage = Stage(bench)
    store(stage, [Entry(slot, periods) for slot, periods in [(20, 1), (21, 3), (22, 1), (23, 2), (20, 4)]], 700)
    begin = stage.send(Sequence(700, 5)).commit_period
    for number in range(20 if is_fast(bench) else 4):
        stage.send_all([Slot(100 + number, bench.weak()), Entries((Entry(100, 1),) * 120, 120 * (number % 5)), NoOp()])
        bench.status()
        bench.wait_periods(2000)
    last = bench.period()
    assert last > begin, f"period {last} should be later than {begin}"
    stage.judge(last - 600, last)


# How it ends


@case("BLK-015", "ACK-006", "STA-003", "REQ-003", outputs=("BLK-015",), features=SEQUENCES)
@pytest.mark.parametrize("repeats", [1, 2, 3, 7, 256])
def test_repeats_are_exact_and_then_there_is_silence(bench: Bench, repeats: int) -> None:
    """A sequence plays as often as it says and falls silent in the next period; the device says so and is READY."""
    stage = Stage(bench)
    store(stage, [Entry(40, 2), Entry(41, 1), Entry(42, 3)], 60)
    begin = stage.soon()
    bench.unasked.clear()
    stage.send(Sequence(60, 3, begin, repeats=repeats))
    end = begin + 6 * repeats
    bench.wait_until(end)
    said = bench.await_unasked(1)
    expect("the state that is said", (said.state, said.since_period, said.flags), (State.READY, 0, StatusFlag(0)))
    assert said.period >= end, f"the end is said in period {said.period}, should be {end} or soon after"
    status = bench.status()
    expect("the state", (status.state, status.since_period, status.flags), (State.READY, 0, StatusFlag(0)))
    stage.judge(begin - 2, end + 30)


@case("BLK-015", "REQ-003", "STA-003", features=SEQUENCES)
@pytest.mark.parametrize("unattended", [False, True], ids=["attended", "unattended"])
def test_a_sequence_is_told_in_the_status(bench: Bench, unattended: bool) -> None:
    """While a sequence plays the status has its flag, the period of its start, and PLAYING or UNATTENDED."""
    stage = Stage(bench)
    store(stage, [Entry(50, 1), Entry(51, 1)], 0)
    before = bench.status()
    expect("the state before", (before.state, before.since_period), (State.READY, 0))
    ack = stage.send(Sequence(0, 2, unattended=unattended and bool(bench.info.features & Feature.UNATTENDED)))
    bench.wait_until(ack.commit_period + 1)
    status = bench.status()
    playing = State.UNATTENDED if unattended and bench.info.features & Feature.UNATTENDED else State.PLAYING
    expect(
        "state, since_period and flags",
        (status.state, status.since_period, status.flags),
        (playing, ack.commit_period, StatusFlag.SEQUENCE),
    )


ENDS: dict[str, Change] = {
    "update": Update(only(100)),
    "sequence": Sequence(1, 1),
    "the-same-sequence": Sequence(0, 3),
    "silence": Output(Action.SILENCE),
    "disable": Output(Action.DISABLE),
}


@case("BLK-015", "BLK-012", "BLK-018", outputs=("BLK-015", "BLK-012", "BLK-018", "TIM-003"), features=SEQUENCES)
@pytest.mark.parametrize("end", ENDS)
def test_a_sequence_is_ended_at_a_period(bench: Bench, end: str) -> None:
    """An update, another sequence, the same from its beginning, SILENCE and DISABLE end a sequence at their periods."""
    stage = Stage(bench)
    store(stage, [Entry(0, 3), Entry(1, 2), Entry(2, 4)])
    begin = stage.send(Sequence(0, 3)).commit_period
    period = stage.soon()
    stage.send(replace(ENDS[end], period=period))
    bench.wait_until(period + 10)
    status = bench.status()
    states = {"silence": State.READY, "disable": State.OFF}
    expect("the state", status.state, states.get(end, State.PLAYING))
    expect("since_period", status.since_period, 0 if end in states else period)
    expect("whether a sequence plays", StatusFlag.SEQUENCE in status.flags, "sequence" in end)
    assert begin < period, f"the sequence began at {begin}, behind what ends it at {period}"
    stage.judge(period - 30, period + 40)


@case("SAF-004", outputs=("SAF-004", "BLK-015", "BLK-022"), features=SEQUENCES)
def test_disable_ends_a_sequence(bench: Bench) -> None:
    """DISABLE silences a sequence within six periods, and it does not play again when the outputs are enabled."""
    stage = Stage(bench)
    store(stage, [Entry(0, 3), Entry(1, 2)])
    stage.send(Sequence(0, 2))
    bench.wait_periods(100)
    bench.order(Request.DISABLE)
    off = bench.period() + SILENT_PERIODS
    bench.wait_until(off + 1)
    bench.enable()
    expect("the state", bench.status().state, State.READY)
    bench.wait_periods(100)
    last = bench.period()
    stage.score.silence(off)
    stage.judge(off, last)


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
    """ENABLE, END_MODULATION, a new numbering, a refused update and CLEAR_FAULTS leave a sequence playing in step."""
    if what == "end-of-modulation":
        require(bench, Feature.MODULATION)
    stage = Stage(bench)
    store(stage, [Entry(0, 3), Entry(1, 2), Entry(2, 4)])
    ack = stage.send(Sequence(0, 3))
    bench.wait_periods(SETTLED_PERIODS)
    before = bench.period()
    NOT_ENDS[what](bench)
    bench.wait_periods(40)
    after = bench.period()
    expect("since_period", bench.status().since_period, ack.commit_period)
    stage.judge(before, after)


@case("CHN-014/2", outputs=("CHN-014/2", "BLK-007", "BLK-015"), features=SEQUENCES)
def test_sequences_queued_behind_each_other_begin_in_time(bench: Bench) -> None:
    """Sequences queued a few periods apart begin each at its own period: a program waits for the one before to play."""
    stage = Stage(bench)
    store(stage, [Entry(slot, 1) for slot in (30, 31, 32, 33, 34, 35)])
    before = bench.status()
    period = stage.soon(4)
    apart = PROMISED_PERIODS + 1
    stage.send_all(Sequence(number, 2, period + apart * number) for number in range(4))
    bench.wait_until(period + 4 * apart)
    expect("missed commits", bench.status().missed_commits, before.missed_commits)
    stage.judge(period - 5, period + 4 * apart + 20)


@case("SAF-005", "STA-003", outputs=("SAF-005",), features=SEQUENCES | Feature.UNATTENDED)
def test_an_unattended_sequence_plays_without_its_host(bench: Bench) -> None:
    """With UNATTENDED a sequence plays on beyond the watchdog's time, to its last repeat; then the watchdog runs."""
    stage = Stage(bench)
    store(stage, [Entry(0, 10), Entry(1, 10)])
    bench.order(Request.WATCHDOG, WATCHDOG_MS)
    repeats = 5 * WATCHDOG_MS * PERIODS_PER_MS // 20
    begin = stage.send(Sequence(0, 2, repeats=repeats, unattended=True)).commit_period
    end = begin + 20 * repeats
    bench.wait_until(end + 2 * WATCHDOG_MS * PERIODS_PER_MS)
    expect("the state, the watchdog's time after the end", bench.status().state, State.OFF)
    expect("whether the watchdog fired", bench.status().watchdog_fired, True)
    stage.judge(end - 200, end + 50)


@case("SAF-005", "SAF-003", outputs=("SAF-005",), features=SEQUENCES)
def test_a_sequence_needs_its_host_unless_it_says_otherwise(bench: Bench) -> None:
    """Without UNATTENDED a sequence is silenced by the watchdog like an update."""
    stage = Stage(bench)
    store(stage, [Entry(0, 10), Entry(1, 10)])
    bench.order(Request.WATCHDOG, WATCHDOG_MS)
    ack = stage.send(Sequence(0, 2))
    fires = ack.now_period + WATCHDOG_MS * PERIODS_PER_MS
    bench.wait_until(fires + 20)
    status = bench.status()
    expect("the state", (status.state, status.watchdog_fired), (State.OFF, True))
    stage.score.silence(fires + 2 + SILENT_PERIODS)
    stage.judge(fires - 1000, fires)
    stage.judge(fires + 2 + SILENT_PERIODS, fires + 100)


# Reading back


@case("REQ-007", "BLK-015", "BLK-013", features=SEQUENCES | Feature.READ_BACK)
def test_the_entry_that_plays_is_read_back(bench: Bench) -> None:
    """PULSES answers the slot of the entry that plays and the period at which this entry, not the sequence, began."""
    stage = Stage(bench)
    each = min(12_000 * bench.slowness, 60_000) if is_fast(bench) else 40_000
    store(stage, [Entry(60, each), Entry(61, each)], 5)
    begin = stage.send(Sequence(5, 2)).commit_period
    for number in range(3):
        bench.wait_until(begin + each * number + each // 4)
        back = bench.read_back()
        if back.read_period >= begin + each * (number + 1):
            raise TooSlow(f"this line is too slow: in period {back.read_period} the next entry plays")
        expect("since_period", back.since_period, begin + each * number)
        expect("whether they are its slot's pulses", back.pulses == stage.score.at(back.read_period)[0], True)
        expect("since_period of the status", bench.status().since_period, begin)


# What may be stored while it plays


@case("BLK-022", "BLK-008", outputs=("BLK-022", "BLK-008"), features=SEQUENCES)
def test_what_a_sequence_plays_is_not_overwritten(bench: Bench) -> None:
    """Stores over an entry or a slot of a playing sequence are refused with IN_USE, the same bytes too; it plays on."""
    stage = Stage(bench)
    store(stage, [Entry(70, 2), Entry(71, 1), Entry(72, 3)], 200)
    same = Slot(71, bench.weak())
    stage.send(same)
    ack = stage.send(Sequence(200, 3))
    bench.wait_until(ack.commit_period + 5)
    before = bench.period()
    check_refused(bench, same, Reason.IN_USE)
    check_refused(bench, Slot(70, bench.weak()), Reason.IN_USE)
    check_refused(bench, Slot(72, bench.weak()), Reason.IN_USE)
    check_refused(bench, Entries((Entry(71, 1),), 201), Reason.IN_USE)
    check_refused(bench, Entries((Entry(73, 1),) * 2, 199), Reason.IN_USE)
    check_refused(bench, Entries((Entry(73, 1),) * 2, 202), Reason.IN_USE)
    check_refused(bench, Entries((Entry(73, 1),) * 120, 150), Reason.IN_USE)
    bench.wait_periods(SETTLED_PERIODS)
    after = bench.period()
    stage.judge(after - min(after - before, 2000), after)


@case("BLK-022", outputs=("BLK-022", "CHN-019"), features=SEQUENCES)
def test_what_a_sequence_does_not_play_may_be_stored(bench: Bench) -> None:
    """Beside a playing sequence every other slot and entry may be stored, right up to its own, and it plays on."""
    stage = Stage(bench)
    store(stage, [Entry(75, 1), Entry(80, 1)], 302)
    store(stage, [Entry(70, 2), Entry(71, 1)], 300)
    ack = stage.send(Sequence(300, 2))
    bench.wait_until(ack.commit_period + 5)
    before = bench.period()
    stage.send_all([Slot(69, bench.weak()), Slot(72, bench.weak()), Slot(75, bench.weak()), Slot(80, bench.weak())])
    stage.send_all([Entries((Entry(69, 1),) * 20, 280), Entries((Entry(72, 1),) * 20, 302)])
    bench.wait_periods(SETTLED_PERIODS)
    after = bench.period()
    stage.judge(after - min(after - before, 2000), after)


@case("BLK-022", "BLK-008", outputs=("BLK-022",), features=SEQUENCES)
def test_what_will_play_is_not_overwritten(bench: Bench) -> None:
    """From its acceptance on, before it begins, the entries and slots of a queued sequence are refused with IN_USE."""
    stage = Stage(bench)
    store(stage, [Entry(1, 3), Entry(2, 2)], 10)
    store(stage, [Entry(3, 3), Entry(4, 2)], 20)
    stage.send(Sequence(10, 2))
    period = stage.soon(6) + SETTLED_PERIODS
    stage.send(Sequence(20, 2, period))
    with in_time(bench, period):
        for body in (
            Slot(3, bench.weak()),
            Entries((Entry(5, 1),), 21),
            Slot(1, bench.weak()),
            Entries((Entry(5, 1),), 10),
        ):
            check_refused(bench, body, Reason.IN_USE)
    stage.judge(period - 20, period + 20)


def ended_by_update(stage: Stage) -> None:
    """Let an update end what plays."""
    ack = stage.send(Update(stage.bench.weak(), stage.soon()))
    stage.bench.wait_until(ack.commit_period)


def ended_by_silence(stage: Stage) -> None:
    """Let SILENCE end what plays."""
    ack = stage.send(Output(Action.SILENCE))
    stage.bench.wait_until(ack.commit_period)


def ended_by_sequence(stage: Stage) -> None:
    """Let another sequence end what plays."""
    store(stage, [Entry(90, 1)], 900)
    ack = stage.send(Sequence(900, 1))
    stage.bench.wait_until(ack.commit_period)


def ended_by_last_repeat(stage: Stage) -> None:
    """Let what plays begin again and come to its end."""
    ack = stage.send(Sequence(10, 2, repeats=2))
    stage.bench.wait_until(ack.commit_period + 2 * 5)


def ended_by_disable(stage: Stage) -> None:
    """Disable the outputs and enable them again."""
    stage.bench.disable()
    stage.bench.wait_periods(1)
    stage.bench.enable()


@case("BLK-022", features=SEQUENCES)
@pytest.mark.parametrize(
    "end",
    [ended_by_update, ended_by_silence, ended_by_sequence, ended_by_last_repeat, ended_by_disable],
    ids=["update", "silence", "sequence", "last-repeat", "disable"],
)
def test_what_has_ended_may_be_overwritten(bench: Bench, end: Callable[[Stage], None]) -> None:
    """As soon as what ends a sequence has taken effect its slots and entries may be stored again."""
    stage = Stage(bench)
    store(stage, [Entry(1, 3), Entry(2, 2)], 10)
    ack = stage.send(Sequence(10, 2))
    bench.wait_until(ack.commit_period + 1)
    check_refused(bench, Slot(2, bench.weak()), Reason.IN_USE)
    end(stage)
    bench.wait_periods(2)
    stage.send_all([Slot(1, bench.weak()), Slot(2, bench.weak()), Entries((Entry(2, 2), Entry(1, 1)), 10)])


@case("BLK-022", features=SEQUENCES)
def test_what_two_sequences_share_stays_in_use(bench: Bench) -> None:
    """A slot that a queued sequence plays too stays in use when the sequence that played it first has ended."""
    stage = Stage(bench)
    store(stage, [Entry(1, 1), Entry(2, 1), Entry(1, 2)])
    stage.send(Sequence(0, 2))
    ack = stage.send(Sequence(2, 1, stage.soon()))
    bench.wait_until(ack.commit_period + 2)
    check_refused(bench, Slot(1, bench.weak()), Reason.IN_USE)
    stage.send_all([Slot(2, bench.weak()), Entries((Entry(2, 1),) * 2)])


@case("BLK-022", features=SEQUENCES)
def test_what_is_about_to_end_is_still_in_use(bench: Bench) -> None:
    """A queued end does not free what plays: only when it has taken effect may the slots be stored again."""
    stage = Stage(bench)
    store(stage, [Entry(1, 3), Entry(2, 2)], 10)
    stage.send(Sequence(10, 2))
    period = stage.soon(3) + SETTLED_PERIODS
    stage.send(Update(bench.weak(), period))
    check_refused(bench, Slot(2, bench.weak()), Reason.IN_USE)
    bench.wait_until(period + 1)
    stage.send(Slot(2, bench.weak()))


@case("BLK-007", "BLK-013", "CHN-019", features=SEQUENCES, needs=CAPTURE)
def test_stores_take_effect_before_the_sequence_behind_them(bench: Bench) -> None:
    """A sequence for now, sent in one go behind the stores of its slots and entries, plays what they say at once."""
    stage = Stage(bench)
    store(stage, [Entry(1, 1), Entry(2, 1)])
    stage.send(Sequence(0, 2))
    fresh = [Slot(slot, bench.weak()) for slot in (100, 101, 102)]
    entries = tuple(Entry(100 + number % 3, 1 + number % 2) for number in range(ENTRIES_PER_BLOCK))
    first = bench.period()
    acks = stage.send_all([*fresh, Entries(entries, 400), Sequence(400, ENTRIES_PER_BLOCK)])
    stage.judge(max(first, acks[-1].commit_period - 200), acks[-1].commit_period + 2 * ENTRIES_PER_BLOCK)


@case("BLK-013", "BLK-014", "SAF-002", "SAF-004", outputs=("BLK-013", "BLK-014"), features=SEQUENCES)
def test_what_is_stored_stays_over_disable(bench: Bench) -> None:
    """Slots and entries are stored while the outputs are off too, and stay over DISABLE and another session."""
    stage = Stage(bench)
    bench.disable()
    store(stage, [Entry(6, 2), Entry(7, 1)], 50)
    expect("the reason for a sequence while off", bench.send(Sequence(50, 2)).reason, Reason.DISABLED)
    bench.must(NoOp(), restart=True)
    bench.enable()
    bench.disable()
    bench.enable()
    ack = stage.send(Sequence(50, 2))
    stage.judge(ack.commit_period, ack.commit_period + 10)


@case("USB-026", outputs=("USB-026", "BLK-013", "BLK-014"), features=SEQUENCES, line="usb")
@pytest.mark.parametrize("how", ["SET_CONFIGURATION", "SET_INTERFACE"])
def test_what_is_stored_stays_over_a_new_configuration(bench: Bench, how: str) -> None:
    """Slots and entries stay where a host configures the device anew, though what plays ends: they last until RESET."""
    again = {"SET_CONFIGURATION": bench.usb.set_configuration, "SET_INTERFACE": lambda: bench.usb.set_interface(0)}
    check_stored_over(bench, again[how])


@case("USB-026", outputs=("USB-026", "BLK-013", "BLK-014"), features=SEQUENCES, line="usb", allow=[Risk.RESET])
def test_what_is_stored_stays_over_a_bus_reset(bench: Bench) -> None:
    """Slots and entries stay over a bus reset in run-time mode, which is no reset of the device."""
    check_stored_over(bench, bench.usb.reset)


def check_stored_over(bench: Bench, disturb: Callable[[], None]) -> None:
    """Fail unless what is stored plays behind a disturbance that ends what plays."""
    stage = Stage(bench)
    store(stage, [Entry(6, 2), Entry(7, 1)], 50)
    bench.wait_periods(SETTLED_PERIODS)
    disturb()
    bench.enable()
    ack = stage.send(Sequence(50, 2))
    stage.judge(ack.commit_period, ack.commit_period + 10)


# What was never stored


@case("BLK-021", "BLK-013", "REQ-013", features=SEQUENCES, allow=[Risk.RESET])
def test_what_was_never_stored_does_not_play(bench: Bench) -> None:
    """After RESET slots and entries are empty: a sequence is refused with EMPTY until all that it plays is stored."""
    bench.restart(lambda: bench.order(Request.RESET))
    stage = Stage(bench)
    check_refused(bench, Sequence(0, 1), Reason.EMPTY)
    check_refused(bench, Sequence(0, TABLE), Reason.EMPTY)
    stage.send(Entries((Entry(8, 1), Entry(9, 1)), 500))
    check_refused(bench, Sequence(500, 2), Reason.EMPTY)
    stage.send(Slot(8, bench.weak()))
    check_refused(bench, Sequence(500, 2), Reason.EMPTY)
    check_refused(bench, Sequence(501, 1), Reason.EMPTY)
    check_refused(bench, Sequence(499, 2), Reason.EMPTY)
    stage.send(Sequence(500, 1))
    stage.send(Slot(9, bench.weak()))
    check_refused(bench, Sequence(500, 3), Reason.EMPTY)
    check_refused(bench, Sequence(499, 3), Reason.EMPTY)
    stage.send(Sequence(500, 2))
    expect("missed commits", bench.status().missed_commits, 0)
