"""Stores: slots, entries and samples are required before they play, and protected while they play."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import only
from phasewire.hil.conformance.tools.exchange import at_the_console
from phasewire.hil.conformance.tools.player import Player
from phasewire.hil.conformance.tools.steps import (
    SILENT,
    Wrong,
    begin,
    check_same,
    far,
    forge,
    late_phase,
    later,
    let_stores_go,
    refuse,
    require,
    some,
)
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Entries,
    Entry,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.codes import (
    ENTRIES_PER_BLOCK,
    MODULATION_SAMPLES,
    SAMPLES_PER_BLOCK,
    SEQUENCE_ENTRIES,
    SLOTS,
    Action,
    Feature,
    Reason,
    Request,
    State,
)

FIRST_ENTRY, PLAYED_ENTRIES, FIRST_SAMPLE, PLAYED_SAMPLES = 10, 3, 102, 4
"""What plays in the cases of IN_USE: entries 10 to 12, of slots 1 and 202, and samples 102 to 105."""
SAMPLES = bytes(range(100, 100 + 12))
ENTRIES = (Entry(1, 40), Entry(202, 30), Entry(1, 20), Entry(3, 10))
LOW_BITS = [202 % 2**bits for bits in (4, 6, 7)]
"""What slot 202 is in fewer bits than eight."""


def must_all(bench: Bench, bodies: Sequence[Body]) -> None:
    """Send stores in one go; all must be accepted."""
    for body, ack in zip(bodies, bench.send_all(bodies), strict=True):
        expect(f"the reason for {body.KIND.name}", ack.reason, Reason.ACCEPTED)


def entries_blocks(entries: list[Entry], first: int, size: int = ENTRIES_PER_BLOCK) -> list[Entries]:
    """Blocks that store entries from a place on."""
    return [Entries(tuple(entries[at : at + size]), first + at) for at in range(0, len(entries), size)]


# What was never stored


def forget(bench: Bench) -> None:
    """Make the device forget what is stored, and enable it."""
    bench.restart(lambda: bench.order(Request.RESET))
    begin(bench)


@case("BLK-021", "BLK-013", "BLK-014", allow=(Risk.RESET,), features=Feature.SEQUENCES)
def test_a_sequence_of_what_was_never_stored_is_refused(bench: Bench) -> None:
    """After a restart no entry and no slot is stored: a SEQUENCE of them is refused with EMPTY."""
    forget(bench)
    places = [0, 1, SEQUENCE_ENTRIES - 1, *(bench.random.randrange(SEQUENCE_ENTRIES) for _ in range(20))]
    wrong = [Wrong(f"entry {place}", forge(bench, PlaySequence(place, 1)), Reason.EMPTY) for place in places]
    wrong.append(Wrong("all entries", forge(bench, PlaySequence(0, SEQUENCE_ENTRIES)), Reason.EMPTY))
    refuse(bench, some(bench, wrong))
    blocks = entries_blocks([Entry(number, 1) for number in range(SLOTS)], 0)
    must_all(bench, blocks)
    let_stores_go(bench)
    numbers = some(bench, range(SLOTS))
    refuse(bench, [Wrong(f"slot {number}", forge(bench, PlaySequence(number, 1)), Reason.EMPTY) for number in numbers])


@case("BLK-021", allow=(Risk.RESET,), features=Feature.SEQUENCES)
def test_one_gap_in_a_sequence_is_enough(bench: Bench) -> None:
    """A SEQUENCE is refused with EMPTY if its first, its last or one between is missing, until it is stored."""
    forget(bench)
    must_all(bench, [Entries((Entry(0, 50), Entry(1, 50), Entry(0, 50)), 20), Entries((Entry(0, 50),), 24)])
    must_all(bench, [Slot(0, SILENT)])
    let_stores_go(bench)
    wrong = [
        Wrong(what, forge(bench, PlaySequence(first, count)), Reason.EMPTY)
        for what, first, count in (
            ("an entry before the first", 19, 2),
            ("an entry after the last", 22, 2),
            ("an entry between", 22, 3),
            ("a slot at the end", 20, 2),
            ("a slot at the beginning", 21, 2),
            ("a slot between", 20, 3),
        )
    ]
    refuse(bench, wrong)
    bench.must(PlaySequence(20, 1))
    bench.must(PlaySequence(22, 1))
    bench.must(Slot(1, SILENT))
    bench.must(PlaySequence(20, 3))
    refuse(bench, [Wrong("an entry that is still missing", forge(bench, PlaySequence(20, 4)), Reason.EMPTY)])
    bench.must(Entries((Entry(1, 50),), 23))
    bench.must(PlaySequence(20, 5))


@case("BLK-021", "BLK-016", allow=(Risk.RESET,), features=Feature.MODULATION)
def test_a_modulation_of_what_was_never_stored_is_refused(bench: Bench) -> None:
    """After a restart no sample is stored: a MODULATION is refused with EMPTY until its samples are stored."""
    forget(bench)
    places = [0, MODULATION_SAMPLES - 1, *(bench.random.randrange(MODULATION_SAMPLES) for _ in range(20))]
    wrong = [Wrong(f"sample {place}", forge(bench, AmplitudeModulation(place, 1, 1)), Reason.EMPTY) for place in places]
    wrong.append(Wrong("all samples", forge(bench, AmplitudeModulation(0, MODULATION_SAMPLES, 1)), Reason.EMPTY))
    refuse(bench, some(bench, wrong))
    must_all(bench, [Samples(bytes(5), 30), Samples(bytes(5), 36)])
    let_stores_go(bench)
    wrong = [
        Wrong(
            f"samples {first} to {first + count - 1}", forge(bench, AmplitudeModulation(first, count, 1)), Reason.EMPTY
        )
        for first, count in ((29, 2), (34, 2), (35, 2), (30, 11), (40, 2))
    ]
    refuse(bench, wrong)
    bench.must(AmplitudeModulation(30, 5, 1))
    bench.must(AmplitudeModulation(36, 5, 1))
    bench.must(Samples(bytes(1), 35))
    bench.must(AmplitudeModulation(30, 11, 1))


@case("BLK-021", "BLK-008", allow=(Risk.RESET,), features=Feature.SEQUENCES | Feature.MODULATION)
def test_what_was_refused_was_not_stored(bench: Bench) -> None:
    """A refused slot, entries or samples count as never stored, because a refused block has no effect."""
    forget(bench)
    bench.must(Slot(0, SILENT))
    bench.must(Entries((Entry(5, 10),), 1))
    let_stores_go(bench)
    wrong = [
        Wrong("a SLOT whose last phase is 127", forge(bench, Slot(5, SILENT), late_phase(SILENT)), Reason.PULSE),
        Wrong("ENTRIES without a checksum", forge(bench, Entries((Entry(0, 10),)), checksum=0), Reason.CHECKSUM),
        Wrong("SAMPLES with hold", forge(bench, Samples(b"\1"), hold=1), Reason.FIELD),
        Wrong("the slot", forge(bench, PlaySequence(1, 1)), Reason.EMPTY),
        Wrong("the entry", forge(bench, PlaySequence(0, 1)), Reason.EMPTY),
        Wrong("the sample", forge(bench, AmplitudeModulation(0, 1, 1)), Reason.EMPTY),
    ]
    refuse(bench, wrong)
    bench.must(Samples(bytes(2), 5))
    bench.must(AmplitudeModulation(5, 2, 1))
    wrong = [
        Wrong("SAMPLES of which some are in use", forge(bench, Samples(bytes(3), 6)), Reason.IN_USE),
        Wrong("one of them that is not", forge(bench, AmplitudeModulation(7, 1, 1)), Reason.EMPTY),
    ]
    refuse(bench, wrong)


# What is in use


def store_all(bench: Bench) -> None:
    """Slots 0, 1, 3 and 202, entries 0 to 133 and samples 0 to 599: those that play, and their neighbours."""
    begin(bench)
    for number in (0, 1, 3, 202):
        bench.must(Slot(number, only(number, width=3)))
    bench.must(Entries((Entry(0, 1),) * FIRST_ENTRY + ENTRIES))
    bench.must(Samples(bytes(100) + SAMPLES))
    let_stores_go(bench)


def play_slots(bench: Bench, period: int = 0) -> int:
    """Play entries without end; returns the period at which they begin."""
    return bench.must(PlaySequence(FIRST_ENTRY, PLAYED_ENTRIES, period)).commit_period


def play_samples(bench: Bench, period: int = 0) -> int:
    """Modulate by samples without end; returns the period at which this begins."""
    return bench.must(AmplitudeModulation(FIRST_SAMPLE, PLAYED_SAMPLES, 2, period)).commit_period


TAKEN: dict[str, list[Body]] = {
    "slots": [Slot(1, SILENT), Slot(202, SILENT), Slot(1, only(1, width=3))],
    "entries": [
        *(Entries((Entry(0, 1),) * count, first) for first, count in ((10, 1), (12, 1), (9, 2), (12, 2), (0, 120))),
        Entries(ENTRIES[:3], 10),
    ],
    "samples": [
        *(
            Samples(bytes(count), first)
            for first, count in ((102, 1), (105, 1), (101, 2), (105, 2), (0, SAMPLES_PER_BLOCK))
        ),
        Samples(SAMPLES[2:6], 102),
    ],
}
"""Stores that overwrite what plays, the last of each sort with the same bytes."""
FREE: dict[str, list[Body]] = {
    "slots": [Slot(number, SILENT) for number in (0, 3, *LOW_BITS, 255)],
    "entries": [*(Entries((Entry(0, 1),) * count, first) for first, count in ((9, 1), (13, 1), (0, 10), (13, 120)))],
    "samples": [
        *(Samples(bytes(count), first) for first, count in ((101, 1), (106, 1), (0, 102), (106, SAMPLES_PER_BLOCK)))
    ],
}
"""Stores next to what plays."""

of_each = pytest.mark.parametrize("what", ["slots", "entries", "samples"])
FEATURES = Feature.SEQUENCES | Feature.MODULATION


@case("BLK-022", "BLK-008", features=FEATURES)
@of_each
@pytest.mark.parametrize("when", ["playing", "queued"])
def test_a_store_cannot_overwrite_what_plays(bench: Bench, what: str, when: str) -> None:
    """A store that overlaps what plays or waits is refused with IN_USE, even with the same bytes; others are not."""
    store_all(bench)
    period = 0 if when == "playing" else far(bench)
    began = play_samples(bench, period) if what == "samples" else play_slots(bench, period)
    if when == "playing":
        bench.wait_until(began)
        let_stores_go(bench)
    wrong = [
        Wrong(f"{what}, store {number}", forge(bench, body), Reason.IN_USE) for number, body in enumerate(TAKEN[what])
    ]
    refuse(bench, wrong)
    for body in FREE[what]:
        bench.must(body)


@case("BLK-022", features=FEATURES)
def test_what_does_not_end_it_does_not_free_it(bench: Bench) -> None:
    """A MODULATION frees no slot, and an UPDATE no sample: each ends only its own kind."""
    store_all(bench)
    play_slots(bench)
    play_samples(bench)
    bench.must(Output(Action.END_MODULATION))
    began = play_samples(bench)
    bench.wait_until(began)
    let_stores_go(bench)
    refuse(bench, [Wrong("a slot", forge(bench, body), Reason.IN_USE) for body in TAKEN["slots"]])
    began = bench.must(Update(SILENT)).commit_period
    bench.wait_until(began)
    let_stores_go(bench)
    refuse(bench, [Wrong("a sample", forge(bench, body), Reason.IN_USE) for body in TAKEN["samples"][:3]])
    bench.must(TAKEN["slots"][0])


ENDS: dict[str, Callable[[int], Body]] = {
    "update": lambda period: Update(SILENT, period),
    "sequence": lambda period: PlaySequence(0, 1, period),
    "silence": lambda period: Output(Action.SILENCE, period),
    "disable": lambda period: Output(Action.DISABLE, period),
    "modulation": lambda period: AmplitudeModulation(0, 1, 1, period),
    "end-modulation": lambda period: Output(Action.END_MODULATION, period),
}
"""Changes that end something, by their period."""


@case("BLK-022", "BLK-012", "BLK-018", features=FEATURES)
@pytest.mark.parametrize(
    ("what", "end"),
    [
        *(("slots", end) for end in ("update", "sequence", "silence", "disable")),
        *(("entries", end) for end in ("update", "silence")),
        *(("samples", end) for end in ("modulation", "end-modulation", "silence", "disable")),
    ],
)
@pytest.mark.parametrize("named", [True, False], ids=["named", "as-soon-as-possible"])
def test_a_store_is_free_when_the_end_has_taken_effect(bench: Bench, what: str, end: str, named: bool) -> None:
    """A store is refused with IN_USE until the change that ends what plays has taken effect, and then accepted.

    A change for as soon as possible waits for what is queued.
    """
    store_all(bench)
    play_slots(bench)
    play_samples(bench)
    period = later(bench)
    if not named:
        bench.must(Update(SILENT, period) if what == "samples" else Output(Action.END_MODULATION, period))
    ends = bench.must(ENDS[end](period if named else 0)).commit_period
    free_from(bench, TAKEN[what][0], ends)


@case("BLK-022", "BLK-015", features=Feature.SEQUENCES)
def test_a_store_is_free_when_the_last_repeat_has_played(bench: Bench) -> None:
    """The data of a sequence with repeats are IN_USE until its last repeat is over, and free afterwards.

    Entries that were refused before change nothing about how long it plays.
    """
    store_all(bench)
    play_slots(bench)
    refuse(bench, [Wrong("entries", forge(bench, TAKEN["entries"][1]), Reason.IN_USE)])
    repeats = 40 * bench.slowness if bench.line.kind == "usb" else 200
    began = bench.must(PlaySequence(FIRST_ENTRY, PLAYED_ENTRIES, repeats=repeats)).commit_period
    free_from(bench, TAKEN["entries"][1], began + 90 * repeats)


def free_from(bench: Bench, body: Body, period: int) -> None:
    """Send a store repeatedly: it must be refused with IN_USE before a period, and accepted from it on."""
    refused = 0
    while (ack := bench.send(body)).reason is Reason.IN_USE:
        now = ack.now_period
        assert now < period, f"a store is refused with IN_USE in period {now}, should be free from {period} on"
        refused += 1
        bench.wait_periods(min(max((period - now) // 2, 1), 1000))
    expect("the reason", ack.reason, Reason.ACCEPTED)
    assert ack.now_period >= period, f"a store is accepted in period {ack.now_period}, should be IN_USE until {period}"
    if not refused:
        raise TooSlow("the line was too slow to send a store before what played had ended")


@case("BLK-022", "SAF-004/1", features=FEATURES, since=2)
@of_each
@pytest.mark.parametrize("when", ["playing", "queued"])
def test_disable_frees_what_played(bench: Bench, what: str, when: str) -> None:
    """After DISABLE has silenced the outputs nothing is in use, neither what played nor what waited."""
    store_all(bench)
    period = 0 if when == "playing" else far(bench)
    play_slots(bench, period)
    play_samples(bench, period and period + 10)
    bench.disable()
    expect("the state", bench.status().state, State.OFF)
    for body in TAKEN[what]:
        bench.must(body)


@case("BLK-022", "CON-008", features=FEATURES | Feature.CONSOLE)
def test_a_test_frees_what_played(bench: Bench) -> None:
    """`test` of the console ends a sequence, whose data are free then; those of a modulation are not."""
    store_all(bench)
    began = play_slots(bench)
    play_samples(bench)
    with at_the_console(bench) as line:
        expect("the answer to test", line.command("test 17"), "ok\r\n")
    for _ in range(100):
        if bench.status().since_period > began:
            break
        bench.wait_periods(10)
    for body in (*TAKEN["slots"], *TAKEN["entries"]):
        bench.must(body)
    refuse(bench, [Wrong("a sample", forge(bench, body), Reason.IN_USE) for body in TAKEN["samples"]])


# What is stored while something plays

UNDER = {
    "update": Feature(0),
    "sequence": Feature.SEQUENCES,
    "modulation": Feature.MODULATION,
    "both": Feature.SEQUENCES | Feature.MODULATION,
}
"""What plays meanwhile, and what it needs; a modulation without a sequence lies over an update."""
OWN = range(301, 304)
"""The entries and the samples of what plays meanwhile, with whole blocks behind them; the slots are 0 to 2."""
ENTRY_PERIODS, MEANWHILE = 3, 500
"""Periods of the longest entry, and those judged before new content plays."""


def begin_to_play(player: Player, under: str) -> None:
    """Play what plays meanwhile."""
    if Feature.SEQUENCES in UNDER[under]:
        player.send_all(Slot(number, player.bench.weak()) for number in range(len(OWN)))
        player.send(Entries(tuple(Entry(number, 2 + number) for number in range(len(OWN))), OWN[0]))
        player.send(PlaySequence(OWN[0], len(OWN)))
    else:
        player.send(Update(player.bench.weak()))
    if Feature.MODULATION in UNDER[under]:
        player.send(Samples(player.bench.random.randbytes(len(OWN)), OWN[0]))
        player.send(AmplitudeModulation(OWN[0], len(OWN), 5))


def beside(bench: Bench, size: int, a_block: int) -> list[range]:
    """The places of a memory behind what plays and before it: all, or fewer on a slow line, at least a block."""
    room = bench.tries(size, a_block, 1 / a_block)
    return [range(OWN.stop, min(OWN.stop + room, size)), range(max(OWN.start - room, 0), OWN.start)]


def renewals(player: Player, what: str) -> list[tuple[list[Body], PlaySequence | AmplitudeModulation]]:
    """New content for places that do not play, in two parts, each with a change that plays it; stores the rest."""
    bench, draw = player.bench, player.bench.random
    if what == "samples":
        return [
            (
                [
                    Samples(draw.randbytes(len(cut := part[at : at + SAMPLES_PER_BLOCK])), cut[0])
                    for at in range(0, len(part), SAMPLES_PER_BLOCK)
                ],
                AmplitudeModulation(part[0], len(part), 1),
            )
            for part in beside(bench, MODULATION_SAMPLES, SAMPLES_PER_BLOCK)
        ]
    numbers = draw.sample(range(len(OWN), SLOTS), bench.tries(24, 4, 2))
    places = [Entry(number, ENTRY_PERIODS) for number in numbers]
    player.send_all([*(Slot(number, bench.weak()) for number in numbers), Entries(tuple(places), OWN.stop)])
    if what == "slots":
        half = len(numbers) // 2
        return [
            ([Slot(number, bench.weak()) for number in numbers[at : at + half]], PlaySequence(OWN.stop + at, half))
            for at in (0, half)
        ]
    return [
        (
            [*entries_blocks([Entry(draw.choice(numbers), draw.randint(1, ENTRY_PERIODS)) for _ in part], part[0])],
            PlaySequence(part[0], len(part)),
        )
        for part in beside(bench, SEQUENCE_ENTRIES, ENTRIES_PER_BLOCK)
    ]


@case(
    *("BLK-007", "BLK-013", "BLK-014", "BLK-016", "BLK-022", "REQ-007"),
    outputs=("BLK-007", "BLK-013", "BLK-014", "BLK-016", "BLK-022", "CHN-012/2", "CHN-019"),
)
@of_each
@pytest.mark.parametrize("under", UNDER)
def test_what_is_stored_while_something_plays_is_right(bench: Bench, what: str, under: str) -> None:
    """What is stored while something plays is whole and right on all ten processors, and disturbs nothing.

    PULSES shows slots and entries, and the outputs show all of it, played at once or later.
    """
    require(bench, UNDER[under] | (Feature.MODULATION if what == "samples" else Feature.SEQUENCES))
    player = Player(bench)
    (at_once, first), (later_on, second) = renewals(player, what)
    begin_to_play(player, under)
    before = let_stores_go(bench)
    *_, ack = player.send_all([*at_once, replace(first, first=first.first + first.count - 1, count=1)])  # goes last
    player.judge(max(before.period, ack.commit_period - MEANWHILE), ack.commit_period + ENTRY_PERIODS)
    check_renewal(player, first, ack.commit_period, player.send(first).commit_period)
    playing = bench.status()
    player.send_all(later_on)
    check_same(playing, let_stores_go(bench), accepted=(playing.accepted + len(later_on)) % 2**32)
    check_renewal(player, second, playing.period, player.send(second).commit_period)


def check_renewal(player: Player, change: PlaySequence | AmplitudeModulation, since: int, began: int) -> None:
    """Fail unless the outputs are right from a period on, and PULSES answers what some of the entries play."""
    bench = player.bench
    longest = ENTRY_PERIODS if isinstance(change, PlaySequence) else change.hold
    player.judge(max(since, began - MEANWHILE), began + longest * change.count)
    if isinstance(change, PlaySequence) and Feature.READ_BACK in bench.info.features:
        for place in some(bench, range(change.first, change.first + change.count, max(change.count // 12, 1))):
            alone = player.send(PlaySequence(place, 1)).commit_period
            bench.wait_until(alone + 1)
            right = bench.read_back().pulses == player.score.at(alone)[0]
            expect(f"whether PULSES answers what was stored for entry {place}", right, True)
