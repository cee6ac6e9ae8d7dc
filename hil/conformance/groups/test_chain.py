"""The chain: damaged messages never play, are counted and reported, and lead to silence if they must (chapter CHN).

These cases judge what is visible from outside of the controller's messages and of the processors' faults.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from phasewire.emulator import faults
from phasewire.emulator.faults import InjectedFault
from phasewire.emulator.faults.messages import DamagedMessage
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, case, expect
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import (
    SILENCE,
    Words,
    check_play,
    check_silent,
    expected_words,
    modulated,
)
from phasewire.hil.conformance.tools.player import check_in_time, soon
from phasewire.hil.conformance.tools.playing import (
    ROUND_SECONDS,
    Played,
    check_falls_one_by_one,
    check_falls_silent,
    play,
    silent_from,
    told,
)
from phasewire.hil.conformance.tools.steps import SILENT, enable, expect_all, features_of, require, store_entry
from phasewire.hil.conformance.tools.watchdog import PERIODS_PER_MS, TICKS_PER_MS
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
from phasewire.protocol.board import CHANNELS_PER_PROCESSOR, PROCESSORS, PROCESSORS_PER_BOARD, TICK_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import SILENT_PERIODS, SYNC_PERIODS, Action, Fault, Feature, Reason, Request, State
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import ProcessorReport, ReadBack, Status

FAULTY = (Need.FAULTS, Need.SPARE)
FAULTY_AND_SEEN = (*FAULTY, Need.CAPTURE)
ASKED_TICKS = 21 * TICKS_PER_MS // 2
"""Time within which a processor's report is known: a question every 10 ms, 0.5 ms to the answer (clause CHN-016)."""
DEAF_MS = 50
LISTENED_SECONDS, CLOCK_SECONDS = 5, 0.02
"""How long a device listens for a pulse (clause CHN-026), and more than clocks of host and device differ by then."""
NO_FAULTS = Fault(0)


def begin(bench: Bench) -> Played:
    """Play an update, with a watchdog time longer than any case."""
    bench.must(NoOp())
    enable(bench)
    field = play(bench)
    told(bench)
    return field


def mixed(words: Words, other: Words, *processors: int) -> Words:
    """The outputs of one field, with those of another on some processors."""
    result = words.copy()
    result[:, list(processors)] = other[:, list(processors)]
    return result


def mixed_pulses(bench: Bench, pulses: Pulses, other: Pulses, *processors: int) -> Pulses:
    """The pulses of one field, with those of another on some processors."""
    there = np.isin(bench.wiring.channels // CHANNELS_PER_PROCESSOR, processors)
    return Pulses(np.where(there, other.phase, pulses.phase), np.where(there, other.width, pulses.width))


def expect_counts(bench: Bench, missed: Mapping[int, int], damaged: Mapping[int, int]) -> None:
    """Fail unless exactly these processors counted so many missed commits and damaged messages."""
    reports = bench.processors()
    for what, counts, wanted in (
        ("missed commits", [report.missed_commits for report in reports], missed),
        ("damaged messages", [report.damaged_messages for report in reports], damaged),
    ):
        expect(f"the {what} of the processors", counts, [wanted.get(place, 0) for place in range(PROCESSORS)])
    expect_all(
        bench.status(), " in the status", missed_commits=sum(missed.values()), damaged_messages=sum(damaged.values())
    )


def expect_faults(bench: Bench, fault: Fault, *processors: int, besides: Fault = NO_FAULTS) -> None:
    """Fail unless the status has exactly these faults, and only these processors report them; `besides` may be, too."""
    expect("the faults in the status", bench.status().faults & ~besides, fault)
    wanted = [fault if place in processors else NO_FAULTS for place in range(PROCESSORS)]
    reported = [report.faults for report in bench.processors()]
    seen = [faults & ~besides if place in processors else faults for place, faults in enumerate(reported)]
    expect("the faults of the processors", seen, wanted)


def expect_told(bench: Bench, state: State, fault: Fault, besides: Fault = NO_FAULTS) -> Status:
    """Fail unless the device has sent one unsolicited record, with this fault, maybe some besides, and the state."""
    said = told(bench)
    expect("the unsolicited records", [(status.state, status.faults & ~besides) for status in said], [(state, fault)])
    return said[0]


def last_told(bench: Bench, state: State) -> Status:
    """The last unsolicited record; fails unless it names this state."""
    said = told(bench)
    assert said, f"no unsolicited record comes, should name the state {state.name}"
    expect("the state in the last record", said[-1].state, state)
    return said[-1]


def expect_cleared(bench: Bench, state: State) -> None:
    """Clear the faults; fails unless they vanish, a record says so, and the device reaches a state."""
    bench.order(Request.CLEAR_FAULTS)
    expect_told(bench, state, NO_FAULTS)
    expect_faults(bench, NO_FAULTS)
    expect("the state", bench.status().state, state)


def expect_damage(bench: Bench, place: int) -> None:
    """Fail unless a processor's fault CHAIN is told within a round of questions, while the device plays on."""
    bench.wait(ROUND_SECONDS)
    expect_told(bench, State.PLAYING, Fault.CHAIN)
    expect_faults(bench, Fault.CHAIN, place)


def lead(bench: Bench, periods: int) -> int:
    """The periods that this line needs for what a fast line prepares in so many."""
    return periods if bench.line.kind == "usb" else periods + 40_000


def processor_of(bench: Bench, first: int = 0, last: int = PROCESSORS - 1) -> int:
    """Some processor."""
    return bench.random.randint(first, last)


# Damaged messages


@dataclass(frozen=True)
class Damage:
    """A defect of a message, and what the processor counts."""

    kind: type[DamagedMessage]
    message: str
    token: int
    missed: int
    damaged: int

    def of(self, processor: int) -> InjectedFault:
        """The fault, at a processor."""
        return self.kind(message=self.message, processor=processor, token=self.token)


OF_UPDATES = {
    "slice-that-lost-a-byte": Damage(faults.LostToken, "slice", 3, missed=1, damaged=1),
    "slice-that-lost-its-last-byte": Damage(faults.LostToken, "slice", 50, missed=1, damaged=1),
    "slice-with-a-byte-twice": Damage(faults.DoubledToken, "slice", 27, missed=1, damaged=1),
    "slice-with-a-wrong-bit": Damage(faults.FlippedBit, "slice", 30, missed=1, damaged=0),
    "commit-that-lost-a-byte": Damage(faults.LostToken, "commit", 3, missed=0, damaged=1),
    "commit-with-a-byte-twice": Damage(faults.DoubledToken, "commit", 14, missed=0, damaged=1),
    "commit-with-a-wrong-period": Damage(faults.FlippedBit, "commit", 3, missed=1, damaged=0),
    "commit-with-a-wrong-checksum": Damage(faults.FlippedBit, "commit", 14, missed=1, damaged=0),
}


@pytest.mark.parametrize("what", OF_UPDATES)
@case(
    *("CHN-004/1", "CHN-004/2", "CHN-010", "CHN-011", "CHN-016", "CHN-017/1"),
    *("REQ-003", "REQ-008", "REQ-011", "SAF-008", "ACK-006"),
    needs=FAULTY_AND_SEEN,
)
def test_a_processor_that_misses_an_update_plays_on(bench: Bench, what: str) -> None:
    """If a message of an update is damaged, that processor alone plays on, which is counted and reported."""
    before, place, damage = begin(bench), processor_of(bench), OF_UPDATES[what]
    bench.levers.cause(damage.of(place))
    missed = play(bench)
    expect_damage(bench, place)
    after = play(bench)
    bench.wait(ROUND_SECONDS)
    expect_faults(bench, Fault.CHAIN, place)
    expect_cleared(bench, State.PLAYING)
    expect_counts(bench, {place: damage.missed}, {place: damage.damaged})
    steps = [
        (before.period, before.words),
        (missed.period, mixed(missed.words, before.words, place)),
        (after.period, after.words),
    ]
    bench.judge(before.period, bench.period(), lambda seen: check_play(seen, steps))


@pytest.mark.parametrize("what", ["slice-with-a-wrong-bit", "commit-that-lost-a-byte"])
@case("REQ-007", "CHN-016", "CHN-004/2", needs=FAULTY, features=Feature.READ_BACK)
def test_reading_back_tells_that_a_processor_missed_an_update(bench: Bench, what: str) -> None:
    """If a processor plays on, PULSES answers what each processor plays, and reports that they differ."""
    before, place = begin(bench), processor_of(bench)
    bench.levers.cause(OF_UPDATES[what].of(place))
    missed = play(bench)
    read = bench.read_back()
    expect("what plays since", read.since_period, ReadBack.MIXED)
    expect("the pulses", read.pulses, mixed_pulses(bench, missed.pulses, before.pulses, place))
    after = play(bench)
    read = bench.read_back()
    expect("what plays since, after the next update", read.since_period, after.period)
    expect("the pulses after the next update", read.pulses, after.pulses)


@case("CHN-011", "CHN-004/2", "CHN-010", needs=FAULTY_AND_SEEN)
def test_no_flipped_bit_of_an_update_ever_plays(bench: Bench) -> None:
    """Any wrong bit in a slice or a commit makes a missed commit: one checksum guards pulses and period."""
    first = begin(bench)
    steps, playing = [(first.period, first.words)], first.words
    missed = dict.fromkeys(range(PROCESSORS), 0)
    for number in range(bench.tries(24, 6, 4)):
        place, bit = processor_of(bench), bench.random.randrange(8)
        message, last = (("slice", 50), ("commit", 14))[number % 2]
        token = bench.random.randint(3, last)
        bench.levers.cause(faults.FlippedBit(message=message, processor=place, token=token, bit=bit))
        field = play(bench)
        missed[place] += 1
        playing = mixed(field.words, playing, place)
        steps.append((field.period, playing))
    bench.wait(ROUND_SECONDS)
    expect_counts(bench, missed, {})
    bench.judge(first.period, bench.period(), lambda seen: check_play(seen, steps))


@case("CHN-004/1", "CHN-004/2", "CHN-011", needs=FAULTY_AND_SEEN)
def test_a_commit_takes_its_slice_out_of_the_mailbox(bench: Bench) -> None:
    """A slice with a wrong commit is dropped: if it is sent again, damaged, the next commit finds no slice."""
    before, place, pulses = begin(bench), processor_of(bench), bench.weak()
    bench.levers.cause(OF_UPDATES["commit-with-a-wrong-checksum"].of(place))
    first = play(bench, pulses)
    bench.levers.cause(OF_UPDATES["slice-that-lost-a-byte"].of(place))
    again = play(bench, pulses)
    bench.wait(ROUND_SECONDS)
    expect_counts(bench, {place: 2}, {place: 1})
    steps = [(before.period, before.words), (first.period, mixed(first.words, before.words, place))]
    bench.judge(before.period, again.period + 20, lambda seen: check_play(seen, steps))


@case("CHN-002", "CHN-010", "CHN-004/2", needs=FAULTY_AND_SEEN)
def test_a_slice_without_its_end_takes_the_next_message_along(bench: Bench) -> None:
    """If END of a slice is lost, the next slice goes to the same place: both processors play on."""
    before, place = begin(bench), processor_of(bench, last=PROCESSORS - 2)
    bench.levers.cause(faults.LostToken(message="slice", processor=place, token=51))
    missed = play(bench)
    bench.wait(ROUND_SECONDS)
    after = play(bench)
    expect("the faults", bench.status().faults, Fault.CHAIN)
    expect_counts(bench, {place: 1, place + 1: 1}, {place: 1})
    both = mixed(missed.words, before.words, place, place + 1)
    steps = [(before.period, before.words), (missed.period, both), (after.period, after.words)]
    bench.judge(before.period, bench.period(), lambda seen: check_play(seen, steps))


DAMAGES = {"lost": faults.LostToken, "doubled": faults.DoubledToken, "flipped": faults.FlippedBit}


def store_twice(bench: Bench, memory: str, between: Callable[[], object]) -> tuple[Words, Words, Body]:
    """Store two contents in one place; returns the outputs of the first and the second, and a block that plays them."""
    old, new = bench.weak(), bench.weak()
    words = [expected_words(pulses, bench.wiring) for pulses in (old, new)]
    start: Body = PlaySequence(0, 1)
    match memory:
        case "slot":
            stores: list[Body] = [Entries((Entry(0, 9),)), Slot(0, old), Slot(0, new)]
        case "entries":
            stores = [Slot(0, old), Slot(1, new), Entries((Entry(0, 9),)), Entries((Entry(1, 9),))]
        case _:
            field = play(bench, new)
            words = [field.words, expected_words(modulated(new, 100), bench.wiring)]
            stores, start = [Samples(bytes([255])), Samples(bytes([100]))], AmplitudeModulation(0, 1, 9)
    for body in stores[:-1]:
        bench.must(body)
    bench.wait(0.002)
    between()
    bench.must(stores[-1])
    return words[0], words[1], start


MEMORIES = {"slot": Feature.SEQUENCES, "entries": Feature.SEQUENCES, "samples": Feature.MODULATION}


@pytest.mark.parametrize("how", DAMAGES)
@pytest.mark.parametrize("memory", MEMORIES)
@case("CHN-010", "CHN-012", "REQ-008", "ACK-006", needs=FAULTY_AND_SEEN)
def test_a_damaged_load_stores_nothing(bench: Bench, memory: str, how: str) -> None:
    """If a store is damaged on its way to a processor, that one keeps its contents and counts a damaged message."""
    require(bench, MEMORIES[memory])
    begin(bench)
    place = processor_of(bench)
    token = bench.random.randint(3, 57)
    fault = DAMAGES[how](message="load", processor=place, token=token)
    old, new, start_it = store_twice(bench, memory, lambda: bench.levers.cause(fault))
    expect_damage(bench, place)
    expect_counts(bench, {}, {place: 1})
    began = bench.must(start_it).commit_period
    words = mixed(new, old, place)
    bench.judge(began, began + 50, lambda seen: check_play(seen, [(began, words)]))


@pytest.mark.parametrize("how", DAMAGES)
@pytest.mark.parametrize("memory", ["entries", "samples"])
@case("CHN-010", "CHN-014", "ACK-006", needs=FAULTY_AND_SEEN)
def test_a_damaged_program_starts_nothing(bench: Bench, memory: str, how: str) -> None:
    """If the start of a sequence or a modulation is damaged on its way to a processor, that one plays on."""
    require(bench, MEMORIES[memory])
    before, place = begin(bench), processor_of(bench)
    start_it: Body = PlaySequence(0, 1) if memory == "entries" else AmplitudeModulation(0, 1, 7)
    if memory == "entries":
        pulses = store_entry(bench, 7)
        words = expected_words(pulses, bench.wiring)
    else:
        bench.must(Samples(bytes([90])))
        words = expected_words(modulated(before.pulses, 90), bench.wiring)
    bench.levers.cause(DAMAGES[how](message="program", processor=place, token=bench.random.randint(3, 22)))
    began = bench.must(start_it).commit_period
    expect_damage(bench, place)
    expect_counts(bench, {}, {place: 1})
    steps = [(before.period, before.words), (began, mixed(words, before.words, place))]
    bench.judge(before.period, began + 50, lambda seen: check_play(seen, steps))


# Questions and answers


@pytest.mark.parametrize("message", ["collect", "report"])
@case("CHN-010", "CHN-017/2", "SAF-008", "ACK-006", needs=FAULTY_AND_SEEN)
def test_one_damaged_question_or_answer_is_told_and_no_more(bench: Bench, message: str) -> None:
    """A single damaged question or answer raises CHAIN; the processor is not lost, and all outputs play on."""
    field, place = begin(bench), processor_of(bench)
    bench.levers.cause(faults.FlippedBit(message=message, processor=place, token=5, bit=2))
    bench.wait(4 * ROUND_SECONDS)
    expect_told(bench, State.PLAYING, Fault.CHAIN)
    expect("the faults", bench.status().faults, Fault.CHAIN)
    expect_counts(bench, {}, {place: 1} if message == "collect" else {})
    expect_cleared(bench, State.PLAYING)
    bench.judge(field.period, bench.period(), lambda seen: check_play(seen, [(field.period, field.words)]))


@pytest.mark.parametrize("message", ["collect", "report"])
@case("CHN-017/2", "SAF-007/1", "SAF-004/1", "STA-003", "REQ-011", needs=FAULTY_AND_SEEN)
def test_a_processor_without_two_answers_is_lost(bench: Bench, message: str) -> None:
    """Two questions in a row without a valid answer raise PROCESSOR: all outputs fall silent until it is cleared."""
    field, place = begin(bench), processor_of(bench)
    at = soon(bench)
    bench.levers.cause(faults.LostToken(message=message, processor=place, token=6, times=2, period=at))
    bench.wait_until(at + 40 * PERIODS_PER_MS)
    said = last_told(bench, State.FAULT)
    expect("the faults in the last record", said.faults, Fault.CHAIN | Fault.PROCESSOR)
    expect_lost_in_time(said, at)
    lost = said.now
    expect_cleared(bench, State.OFF)
    end = bench.period()
    bench.judge(field.period, end, lambda seen: check_falls_silent(seen, field.words, at * TICKS_PER_PERIOD, lost))


# Late messages


LATE: dict[str, Callable[[int, int], InjectedFault]] = {
    "slow-link": lambda place, lasts: faults.SlowLink(link=place, cycles_per_symbol=60, periods=lasts),
    "slow-processor": lambda place, lasts: faults.SlowProcessor(processor=place, slowness=8, periods=lasts),
}


def missed_by(bench: Bench, before: list[int]) -> list[int]:
    """The processors that missed exactly one commit since these counts."""
    bench.wait(ROUND_SECONDS)
    more = [report.missed_commits - count for report, count in zip(bench.processors(), before, strict=True)]
    assert set(more) <= {0, 1}, f"the processors missed {more} commits, should be 1 at most"
    before[:] = [count + one for count, one in zip(before, more, strict=True)]
    return [place for place, one in enumerate(more) if one]


@pytest.mark.parametrize("what", LATE)
@case("CHN-004/2", "CHN-014/3", "CHN-020", "SAF-008", "REQ-008", "REQ-011", needs=FAULTY_AND_SEEN)
def test_a_processor_that_cannot_be_ready_in_time_plays_on(bench: Bench, what: str) -> None:
    """If an update or a sequence cannot be ready in time, exactly the processors that count a missed commit play on."""
    require(bench, Feature.SEQUENCES)
    field = begin(bench)
    in_sequence = bench.weak()
    bench.must(Slot(0, in_sequence))
    bench.must(Entries((Entry(0, 11),)))
    bench.wait(0.002)
    place, missed, playing = processor_of(bench, first=5, last=8), [0] * PROCESSORS, field.words
    steps = [(field.period, playing)]
    lasts = lead(bench, 4000)
    bench.levers.cause(LATE[what](place, lasts))
    for body, words in changes(bench, in_sequence):
        began = bench.must(body).commit_period
        late = missed_by(bench, missed)
        missing = late == [place] if what == "slow-processor" else late
        assert missing, f"{body.KIND.name} is missed by {late}, should be by processor {place}"
        playing = mixed(words, playing, *late)
        steps.append((began, playing))
    wanted = Fault.CHAIN | (Fault.OVERRUN if what == "slow-processor" else NO_FAULTS)
    expect_all(
        bench.status(),
        " in the status",
        faults=wanted,
        state=State.PLAYING,
        missed_commits=sum(missed),
        damaged_messages=0,
    )
    bench.wait_periods(lasts)
    told(bench)
    bench.order(Request.CLEAR_FAULTS)
    expect_told(bench, State.PLAYING, NO_FAULTS)
    last = play(bench)
    bench.wait(ROUND_SECONDS)
    expect_faults(bench, NO_FAULTS)
    steps.append((last.period, last.words))
    bench.judge(field.period, bench.period(), lambda seen: check_play(seen, steps))


def changes(bench: Bench, in_sequence: Pulses) -> list[tuple[Body, Words]]:
    """An update, a sequence and another update, and their outputs."""
    first, last = bench.weak(), bench.weak()
    return [
        (Update(first), expected_words(first, bench.wiring)),
        (PlaySequence(0, 1), expected_words(in_sequence, bench.wiring)),
        (Update(last), expected_words(last, bench.wiring)),
    ]


@case("SAF-008", "SAF-007/1", "REQ-011", "ACK-006", needs=FAULTY)
def test_an_overrun_is_told_and_silences_nothing(bench: Bench) -> None:
    """OVERRUN is reported, stays until it is cleared even if the processor recovers, and silences nothing."""
    begin(bench)
    place = processor_of(bench)
    lasts = lead(bench, 1000)
    bench.levers.cause(faults.SlowProcessor(processor=place, slowness=8, periods=lasts))
    play(bench)
    bench.wait(ROUND_SECONDS)
    expect_told(bench, State.PLAYING, Fault.CHAIN | Fault.OVERRUN)
    bench.wait_periods(lasts)
    expect_faults(bench, Fault.CHAIN | Fault.OVERRUN, place)
    expect_cleared(bench, State.PLAYING)
    bench.wait(2 * ROUND_SECONDS)
    expect_faults(bench, NO_FAULTS)


def expect_lost_in_time(said: Status, at: int) -> None:
    """Fail unless a processor is lost in time that answers no question from a period on, when the third is due."""
    latest = at * TICKS_PER_PERIOD + 31 * TICKS_PER_MS
    assert said.now <= latest, f"the processor is lost at tick {said.now}, should be by {latest}"


# A broken chain


BREAKS: dict[str, tuple[Callable[[int], InjectedFault], int]] = {
    "slice": (lambda place: faults.LostToken(message="slice", processor=place, token=0), 0),
    "commit": (lambda place: faults.LostToken(message="commit", processor=place, token=0), 31 * TICKS_PER_MS),
    "slow-link": (lambda place: faults.SlowLink(link=place, cycles_per_symbol=2047, token_delay=2047, periods=8000), 0),
}
"""What breaks the chain, and the delay until a message is stuck: a commit for an absent processor fits the buffers of
the last links, so the stuck message may be a question to the last processors, some of which fit too (clause
CHN-017)."""


@pytest.mark.parametrize("how", BREAKS)
@case("CHN-021/1", "CHN-021/2", "CHN-018", "SAF-007/1", "REQ-011", needs=FAULTY_AND_SEEN, allow=(Risk.RESET,))
def test_a_broken_chain_is_told_and_ends_in_silence(bench: Bench, how: str) -> None:
    """A message that cannot leave within 1 ms breaks the chain: FAULT, silence within 50 ms, until a restart."""
    field = begin(bench)
    cause, later = BREAKS[how]
    bench.levers.cause(cause(processor_of(bench, first=1)))
    begins = bench.must(Update(bench.weak())).commit_period
    broken_by = begins * TICKS_PER_PERIOD + later + TICKS_PER_MS
    bench.wait_until(broken_by // TICKS_PER_PERIOD + 1)
    said = last_told(bench, State.FAULT)
    expect("the faults in the last record", said.faults, Fault.CHAIN | Fault.PROCESSOR)
    assert said.now <= broken_by, f"the chain is broken at tick {said.now}, should be by {broken_by}"
    expect_refused_everywhere(bench)
    bench.wait(DEAF_MS / 1000)
    bench.order(Request.CLEAR_FAULTS)
    expect_all(bench.status(), " after CLEAR_FAULTS", faults=Fault.CHAIN | Fault.PROCESSOR, state=State.FAULT)
    deaf = said.now // TICKS_PER_PERIOD + (DEAF_MS + 1) * PERIODS_PER_MS
    end = bench.period()
    bench.judge(field.period, begins, lambda seen: check_play(seen, [(field.period, field.words)]))
    bench.judge(begins, end, lambda seen: check_silent(seen, deaf))
    bench.wait(0.2)
    bench.restart(lambda: bench.order(Request.RESET))
    expect_faults(bench, NO_FAULTS)
    plays_everywhere(bench)


def expect_refused_everywhere(bench: Bench) -> None:
    """Fail unless a device with a silencing fault refuses every change and store with FAULT, and ENABLE with STALL.

    A block whose feature is missing is refused with UNSUPPORTED, which comes earlier in the order (clause ACK-003).
    """
    before = bench.status()
    bodies: list[Body] = [Update(SILENT), *(Output(action) for action in Action)]
    bodies += [Slot(9, SILENT), Entries((Entry(9, 1),), 9), PlaySequence(9, 1), PlaySequence(0, 1, unattended=True)]
    bodies += [Samples(b"\x09", 9), AmplitudeModulation(9, 1, 1)]
    for body in bodies:
        ack, lacks = bench.send(body), features_of(body) & ~bench.info.features
        reason = Reason.UNSUPPORTED if lacks else Reason.FAULT
        expect(f"the reason for {body.KIND.name}", ack.reason, reason)
        expect("the state in the acknowledgement", ack.state, State.FAULT)
    for harmless in (Clock(), NoOp()):
        expect(f"the reason for {harmless.KIND.name}", bench.send(harmless).reason, Reason.ACCEPTED)
    assert not bench.try_order(Request.ENABLE), "ENABLE is carried out in FAULT"
    expect_all(
        bench.status(),
        refused=before.refused + len(bodies),
        last_refusal=reason,
        free=bench.info.queue_blocks,
        since_period=0,
    )


def plays_everywhere(bench: Bench) -> None:
    """Enable the outputs; fails unless an update plays on all processors without a miss or a fault."""
    before = bench.status()
    enable(bench)
    field = play(bench)
    bench.wait(ROUND_SECONDS)
    expect_all(bench.status(), faults=NO_FAULTS, missed_commits=before.missed_commits)
    bench.judge(field.period, bench.period(), lambda seen: check_play(seen, [(field.period, field.words)]))


# A lost silence


@pytest.mark.parametrize("message", ["slice", "commit"])
@case("CHN-030", "SAF-004/1", "CHN-016", "CHN-017/1", needs=FAULTY_AND_SEEN)
def test_a_silence_that_a_processor_misses_is_sent_again(bench: Bench, message: str) -> None:
    """If the silence of DISABLE is lost for one processor, that one falls silent at most 10 ms later."""
    field, place = begin(bench), processor_of(bench)
    bench.levers.cause(faults.LostToken(message=message, processor=place))
    before, after = disable(bench)
    bench.wait(0.1)
    expect("the faults", bench.status().faults, Fault.CHAIN)
    latest = [after + SILENT_PERIODS] * PROCESSORS
    latest[place] += ASKED_TICKS // TICKS_PER_PERIOD + SILENT_PERIODS
    check_disabled(bench, field, before, latest)
    told(bench)
    expect_cleared(bench, State.OFF)
    plays_everywhere(bench)


@case("CHN-030", "CHN-018", "SAF-004/1", "CHN-017/2", needs=FAULTY_AND_SEEN)
def test_a_processor_that_cannot_be_silenced_is_left_alone_until_it_is(bench: Bench) -> None:
    """If the silence is lost twice, that processor is not asked until it falls silent by itself."""
    field, place = begin(bench), processor_of(bench)
    bench.levers.cause(faults.LostToken(message="slice", processor=place, times=2))
    before, after = disable(bench)
    bench.wait(0.15)
    expect_all(bench.status(), faults=Fault.CHAIN, state=State.OFF)
    expect_counts(bench, {place: 2}, {place: 2})
    latest = [after + SILENT_PERIODS] * PROCESSORS
    latest[place] += ASKED_TICKS // TICKS_PER_PERIOD + (DEAF_MS + 1) * PERIODS_PER_MS
    check_disabled(bench, field, before, latest)
    told(bench)
    expect_cleared(bench, State.OFF)
    plays_everywhere(bench)
    bench.wait(0.05)
    expect_faults(bench, NO_FAULTS)


def disable(bench: Bench) -> tuple[int, int]:
    """DISABLE; returns the first and last period in which the request may have arrived."""
    before = bench.period()
    bench.order(Request.DISABLE)
    return before, bench.period()


def check_disabled(bench: Bench, field: Played, before: int, latest: list[int]) -> None:
    """Judge that each processor is silent from a period on."""
    end = bench.period()
    earliest = [before + 1] * PROCESSORS
    bench.judge(field.period, end, lambda seen: check_falls_one_by_one(seen, field.words, earliest, latest))


# Silencing faults


OF_BOARDS: dict[str, tuple[Fault, Callable[..., InjectedFault]]] = {
    "too-hot": (Fault.TEMPERATURE, partial(faults.HotBoard, celsius=86)),
    "supply-too-low": (Fault.SUPPLY, partial(faults.WrongSupply, millivolts=11_999)),
    "supply-too-high": (Fault.SUPPLY, partial(faults.WrongSupply, millivolts=18_001)),
}
"""Silencing faults of a board, by their causes."""


@pytest.mark.parametrize("what", OF_BOARDS)
@case("SAF-007/1", "SAF-007/2", "SAF-008", "SAF-004/1", "REQ-008", "REQ-011", "CHN-017/1", needs=FAULTY_AND_SEEN)
def test_a_fault_of_a_board_silences_it_at_once_and_then_all(bench: Bench, what: str) -> None:
    """A faulty board is silent at the next boundary, and all boards when the controller learns of it."""
    field, board = begin(bench), bench.random.randrange(bench.info.boards)
    places = places_of(board)
    at, lasts = soon(bench), 4000 if bench.line.kind == "usb" else 60_000
    fault, cause = OF_BOARDS[what]
    bench.levers.cause(cause(board=board, period=at, periods=lasts))
    bench.wait_until(at + 450)
    said = expect_told(bench, State.FAULT, fault)
    learned = expect_learned(said, at)
    expect_faults(bench, fault, *places)
    expect_refused_everywhere(bench)
    bench.order(Request.CLEAR_FAULTS)
    expect("what the device sends though nothing was cleared", told(bench), [])
    expect("the faults while the cause lasts", bench.status().faults, fault)
    if bench.period() >= at + lasts:
        raise Inconclusive("this line is too slow: the fault was over before its case")
    bench.wait_until(at + lasts)
    bench.wait(ROUND_SECONDS)
    expect("the state after the cause", bench.status().state, State.FAULT)
    expect_faults(bench, fault, *places)
    bench.judge(field.period, bench.period(), lambda seen: check_board_first(seen, field.words, places, at, learned))
    expect_cleared(bench, State.OFF)
    plays_everywhere(bench)


def places_of(board: int) -> list[int]:
    """The processors of a board."""
    return [board * PROCESSORS_PER_BOARD + number for number in range(PROCESSORS_PER_BOARD)]


def expect_learned(said: Status, at: int) -> int:
    """Fail unless the controller learned in time of an event at a period; returns the period in which it did."""
    latest = at * TICKS_PER_PERIOD + ASKED_TICKS
    assert said.now <= latest, f"the fault is told at tick {said.now}, should be by {latest}"
    return said.now // TICKS_PER_PERIOD


def check_board_first(seen: Seen, words: Words, places: list[int], at: int, learned: int) -> None:
    """Fail unless a board is silent at the boundary after what happened to it, and the others once that was learned."""
    earliest, latest = [learned + 1] * PROCESSORS, [learned + SILENT_PERIODS] * PROCESSORS
    for place in places:
        earliest[place], latest[place] = at, at + 1
    check_falls_one_by_one(seen, words, earliest, latest)


@case("SAF-007/2", "SAF-007/1", "CHN-017/1", needs=FAULTY_AND_SEEN)
def test_a_board_that_is_not_well_stays_silent_whatever_it_is_sent(bench: Bench) -> None:
    """Updates that reach a hot board before the controller knows of its fault do not play there."""
    field, board = begin(bench), bench.random.randrange(bench.info.boards)
    later = [bench.weak() for _ in range(min(queue_length(bench), 12))]
    at = soon(bench, len(later))
    bench.levers.cause(faults.HotBoard(board=board, celsius=100, period=at))
    for number, pulses in enumerate(later):
        ack = bench.must(Update(pulses, at + 30 * number + 7))
        check_in_time(ack, at + 30 * number + 7)
    bench.wait_until(at + 450)
    learned = expect_learned(expect_told(bench, State.FAULT, Fault.TEMPERATURE), at)
    words = [(at + 30 * number + 7, expected_words(pulses, bench.wiring)) for number, pulses in enumerate(later)]

    def check(seen: Seen) -> None:
        silent = max(silent_from(seen), learned + 1)
        assert silent <= learned + SILENT_PERIODS, (
            f"the outputs are silent from period {silent} on, should be by {learned + SILENT_PERIODS}"
        )
        lame = list[tuple[int, Words]]()
        for period, wanted in words:
            played = mixed(wanted, SILENCE, *places_of(board))
            begins = not lame or ((seen.period(period) ^ lame[-1][1]) & seen.observed).any()
            if period <= learned or (period < silent and begins):  # what is on the chain then may begin or not
                lame.append((period, played))
        check_play(seen, [(field.period, field.words)], at)
        check_play(seen, [*lame, (silent, SILENCE)])

    bench.judge(field.period, at + 450, check)


@case("SAF-007/2", "CHN-017/1", "REQ-003", "REQ-008", needs=FAULTY)
def test_a_temperature_is_known_within_a_round_of_questions(bench: Bench) -> None:
    """The temperature of a board is reported within 10 ms, for both its processors; up to 85 °C it is no fault."""
    begin(bench)
    for board, celsius in enumerate((85, 60, -40, 84, 30)[: bench.info.boards]):
        at, lasts = soon(bench), lead(bench, 4000)
        bench.levers.cause(faults.HotBoard(board=board, celsius=celsius, period=at, periods=lasts))
        bench.wait_until(at + 1 + -(-ASKED_TICKS // TICKS_PER_PERIOD))
        reports = [report.temperature_c for report in bench.processors()]
        expect(f"the temperatures of board {board}", [reports[place] for place in places_of(board)], [celsius] * 2)
        status = bench.status()
        expect("the temperature in the status", status.temperature_c, max(reports))
        expect("the faults", status.faults, NO_FAULTS)
        expect("the state", status.state, State.PLAYING)
        bench.wait_until(at + lasts)


@pytest.mark.parametrize("millivolts", [12_000, 18_000])
@case("SAF-008", "SAF-007/2", needs=FAULTY_AND_SEEN)
def test_a_supply_at_its_limits_is_no_fault(bench: Bench, millivolts: int) -> None:
    """At 12 and at 18 V the outputs go on."""
    field = begin(bench)
    bench.levers.cause(faults.WrongSupply(millivolts=millivolts))
    bench.wait(2 * ROUND_SECONDS)
    expect("the unsolicited records", told(bench), [])
    expect_faults(bench, NO_FAULTS)
    bench.judge(field.period, bench.period(), lambda seen: check_play(seen, [(field.period, field.words)]))


@pytest.mark.parametrize(("celsius", "clears"), [(80, False), (79, True)], ids=["80", "79"])
@case("REQ-011", "SAF-008", needs=FAULTY)
def test_too_hot_is_cleared_below_80_degrees(bench: Bench, celsius: int, clears: bool) -> None:
    """TEMPERATURE can be cleared once the board has cooled below 80 °C, but not at 80 °C."""
    bench.must(NoOp())
    board, at = bench.random.randrange(bench.info.boards), soon(bench)
    bench.levers.cause(faults.HotBoard(board=board, celsius=90, period=at, periods=400))
    bench.levers.cause(faults.HotBoard(board=board, celsius=celsius, period=at + 400))
    bench.wait_until(at + 400)
    bench.wait(ROUND_SECONDS)
    expect_faults(bench, Fault.TEMPERATURE, *places_of(board))
    expect("the temperature", bench.status().temperature_c, celsius)
    told(bench)
    bench.order(Request.CLEAR_FAULTS)
    state, fault = (State.OFF, NO_FAULTS) if clears else (State.FAULT, Fault.TEMPERATURE)
    expect("the unsolicited records", [status.faults for status in told(bench)], [fault] * clears)
    expect_faults(bench, fault, *places_of(board))
    expect("the state", bench.status().state, state)


@case("REQ-011", "SAF-008", "REQ-008", needs=FAULTY)
def test_only_faults_whose_cause_is_gone_are_cleared(bench: Bench) -> None:
    """CLEAR_FAULTS clears CHAIN and a SUPPLY that is right again, but leaves a board that is too hot in FAULT."""
    begin(bench)
    place, hot = processor_of(bench, last=3), 2 + bench.random.randrange(bench.info.boards - 2)
    bench.levers.cause(faults.FlippedBit(message="slice", processor=place))
    play(bench)
    bench.wait(ROUND_SECONDS)
    bench.levers.cause(faults.WrongSupply(millivolts=10_000, board=hot, periods=600))
    bench.levers.cause(faults.HotBoard(board=hot, celsius=100))
    bench.wait(0.015 + ROUND_SECONDS)
    told(bench)
    every = Fault.CHAIN | Fault.SUPPLY | Fault.TEMPERATURE
    expect("the faults in the status", bench.status().faults, every)
    told_by = [Fault.CHAIN if at == place else NO_FAULTS for at in range(PROCESSORS)]
    for at in places_of(hot):
        told_by[at] = Fault.SUPPLY | Fault.TEMPERATURE
    expect("the faults of the processors", [report.faults for report in bench.processors()], told_by)
    bench.order(Request.CLEAR_FAULTS)
    expect_told(bench, State.FAULT, Fault.TEMPERATURE)
    expect_faults(bench, Fault.TEMPERATURE, *places_of(hot))


# The common clock


def next_pulse(bench: Bench) -> int:
    """The period of a sync pulse, with enough time to prepare something before it."""
    return -(-soon(bench) // SYNC_PERIODS) * SYNC_PERIODS


@pytest.mark.parametrize("pulses_after", [3.0, None], ids=["pulses", "no-pulses"])
@case("CHN-026", "TIM-002/2", "SAF-008", needs=(Need.SYNC,), allow=(Risk.RESET,))
def test_a_listener_begins_with_the_first_pulse(bench: Bench, pulses_after: float | None) -> None:
    """A device that listens on a sync line begins with the first pulse, or after 5 s by itself, with the fault SYNC."""
    began = bench.line.time.monotonic()
    bench.levers.share_sync(pulses_after)
    try:
        bench.restart(lambda: bench.order(Request.RESET))
        runs = bench.clock().now / TICK_HZ
        most = bench.line.time.monotonic() - began - (LISTENED_SECONDS if pulses_after is None else pulses_after)
        assert runs <= most + CLOCK_SECONDS, f"period 0 began {runs:.3f} s ago, should be {most:.3f} s ago at most"
        status, faults = bench.status(), Fault.SYNC if pulses_after is None else NO_FAULTS
        expect_all(status, faults=faults, state=State.FAULT if faults else State.OFF)
    finally:
        bench.levers.drive_sync()
        bench.restart(lambda: bench.order(Request.RESET))


@pytest.mark.parametrize("where", ["one-board", "all-boards"])
@case("CHN-027", "CHN-026", "SAF-007/2", "SAF-008", "REQ-011", needs=FAULTY_AND_SEEN, allow=(Risk.RESET,))
def test_a_pulse_that_is_missing_is_a_lost_clock(bench: Bench, where: str) -> None:
    """If a due sync pulse is missing, the board is silent at the next boundary, and only RESET clears SYNC."""
    field = begin(bench)
    board = bench.random.randrange(bench.info.boards) if where == "one-board" else None
    places = list(range(PROCESSORS)) if board is None else places_of(board)
    pulse = next_pulse(bench)
    bench.levers.cause(faults.LostSync(board=board, period=pulse - 200, periods=400))
    bench.wait_until(pulse + 450)
    learned = expect_learned(last_told(bench, State.FAULT), pulse)
    assert learned >= pulse, f"the fault is told in period {learned}, should not be before {pulse}, when a pulse is due"
    expect_faults(bench, Fault.SYNC, *places)
    bench.order(Request.CLEAR_FAULTS)
    expect_faults(bench, Fault.SYNC, *places)
    assert not bench.try_order(Request.ENABLE), "ENABLE is carried out in FAULT"
    end = bench.period()
    bench.judge(field.period, end, lambda seen: check_board_first(seen, field.words, places, pulse, learned))
    bench.restart(lambda: bench.order(Request.RESET))
    expect_faults(bench, NO_FAULTS)
    plays_everywhere(bench)


@pytest.mark.parametrize("ppm", [15, -15, 200, -200])
@case("CHN-027", "SAF-007/1", "SAF-007/2", needs=FAULTY_AND_SEEN)
def test_a_board_whose_clock_is_off_is_silenced(bench: Bench, ppm: int) -> None:
    """A board that is more than a tick early or late at a sync pulse has lost the common clock."""
    field, board = begin(bench), bench.random.randrange(bench.info.boards)
    begins = next_pulse(bench) + 1
    bench.levers.cause(faults.ClockError(board=board, ppm=ppm, period=begins))
    pulse = begins - 1 + SYNC_PERIODS
    bench.wait_until(pulse + 450)
    # By the board's own count the silence may come too late: a missed commit, which is the fault CHAIN (CHN-004). It is
    # told after SYNC, in a record that takes the place of one that was not read.
    said = expect_told(bench, State.FAULT, Fault.SYNC, besides=Fault.CHAIN)
    learned = expect_learned(said, pulse)
    earliest = pulse if Fault.CHAIN in said.faults else learned
    expect_faults(bench, Fault.SYNC, *places_of(board), besides=Fault.CHAIN)

    def check(seen: Seen) -> None:
        own, rest = seen.observed.copy(), seen.observed.copy()
        own[[place for place in range(PROCESSORS) if place not in places_of(board)]] = 0
        rest[places_of(board)] = 0
        check_silent(replace(seen, observed=own), pulse + 2)
        first, last = earliest * TICKS_PER_PERIOD + 1, learned * TICKS_PER_PERIOD
        check_falls_silent(replace(seen, observed=rest), field.words, first, last)

    bench.judge(field.period, pulse + 450, check)


@pytest.mark.parametrize("ppm", [4, -4])
@case("CHN-027", needs=FAULTY)
def test_a_board_that_is_less_than_a_tick_off_goes_on(bench: Bench, ppm: int) -> None:
    """A board that drifted for a while but is less than a tick off has not lost the common clock."""
    begin(bench)
    board, begins = bench.random.randrange(bench.info.boards), next_pulse(bench) + 1
    bench.levers.cause(faults.ClockError(board=board, ppm=ppm, period=begins, periods=SYNC_PERIODS))
    bench.wait_until(begins + 3 * SYNC_PERIODS + 450)
    expect("the unsolicited records", told(bench), [])
    expect_faults(bench, NO_FAULTS)


@pytest.mark.parametrize("ppm", [4, -4])
@case("CHN-027", needs=FAULTY)
def test_a_slow_drift_of_a_clock_adds_up(bench: Bench, ppm: int) -> None:
    """A board whose clock is off by less than a tick from pulse to pulse loses the common clock after some of them."""
    begin(bench)
    board, pulse = bench.random.randrange(bench.info.boards), next_pulse(bench)
    bench.levers.cause(faults.ClockError(board=board, ppm=ppm, period=pulse + 1))
    bench.wait_until(pulse + 3 * SYNC_PERIODS + 450)
    said = expect_told(bench, State.FAULT, Fault.SYNC, besides=Fault.CHAIN)
    learned = expect_learned(said, pulse + 3 * SYNC_PERIODS)
    assert learned >= pulse + 2 * SYNC_PERIODS, f"the fault is told in period {learned}, the drift is 0.8 ticks then"
    expect_faults(bench, Fault.SYNC, *places_of(board), besides=Fault.CHAIN)


# Missing processors


@pytest.mark.parametrize("place", [0, 4, 9])
@case("CHN-017/2", "CHN-018", "SAF-007/1", "REQ-011", needs=FAULTY_AND_SEEN)
def test_a_processor_that_does_not_answer_any_more_silences_all(bench: Bench, place: int) -> None:
    """A processor that dies is lost within 30 ms; the reachable ones are silenced, and the rest silence themselves."""
    field = begin(bench)
    at = soon(bench)
    bench.levers.cause(faults.DeadProcessor(processor=place, period=at))
    bench.wait_until(at + 32 * PERIODS_PER_MS)
    lost = last_told(bench, State.FAULT)
    assert Fault.PROCESSOR in lost.faults, f"the faults in the record are {lost.faults!r}, PROCESSOR is missing"
    expect_lost_in_time(lost, at)
    bench.wait((DEAF_MS + 2) / 1000)
    bench.order(Request.CLEAR_FAULTS)
    status = bench.status()
    assert Fault.PROCESSOR in status.faults, f"the faults after CLEAR_FAULTS are {status.faults!r}"
    expect("the state after CLEAR_FAULTS", status.state, State.FAULT)
    assert not bench.try_order(Request.ENABLE), "ENABLE is carried out in FAULT"
    deaf = (DEAF_MS + 1) * PERIODS_PER_MS
    dark = [at + 31 * PERIODS_PER_MS + deaf] * place + [at + 1] + [at + deaf] * (PROCESSORS - 1 - place)
    bench.judge(at + 1, bench.period(), lambda seen: check_each_silent(seen, dark))
    bench.judge(field.period, at, lambda seen: check_play(seen, [(field.period, field.words)]))


def check_each_silent(seen: Seen, latest: list[int]) -> None:
    """Fail unless each processor is silent from a period on."""
    for place, period in enumerate(latest):
        loud = (seen.words[max(period - seen.first_period, 0) * TICKS_PER_PERIOD :, place] & seen.observed[place]).any()
        assert not loud, f"processor {place} plays after period {period}, should be silent from then on"


@pytest.mark.parametrize("place", [0, 1, 5, 9])
@case("CHN-023", "CHN-024", "TIM-002/2", "REQ-008", "SAF-007/1", needs=FAULTY_AND_SEEN, allow=(Risk.RESET,))
def test_a_device_without_all_its_processors_says_which_are_there(bench: Bench, place: int) -> None:
    """After RESET with a dead processor those before it work, the fault is PROCESSOR, and nothing plays."""
    bench.levers.cause(faults.DeadProcessor(processor=place))
    well = bench.processors()[0]
    bench.restart(lambda: bench.order(Request.RESET))
    status = bench.status()
    expect("the state", status.state, State.FAULT)
    assert Fault.PROCESSOR in status.faults, f"the faults are {status.faults!r}, PROCESSOR should be among them"
    expect_there(bench, place, well)
    expect_refused_everywhere(bench)
    bench.order(Request.CLEAR_FAULTS)
    expect("the state after CLEAR_FAULTS", bench.status().state, State.FAULT)
    bench.wait(0.1)
    expect_there(bench, place, well)
    bench.judge(0, bench.period(), check_silent)


def expect_there(bench: Bench, count: int, well: ProcessorReport) -> None:
    """Fail unless so many processors are there, and the others are only reported as missing."""
    reports = bench.processors()
    expect(
        "what the present processors report",
        [(report.bank, report.firmware, report.missed_commits) for report in reports[:count]],
        [(well.bank, well.firmware, 0)] * count,
    )
    answer = bench.ask(Request.PROCESSORS)
    absent = bytes([Fault.PROCESSOR.value]) + bytes(15)
    expect("what is reported of the missing ones", answer[16 * count :], absent * (PROCESSORS - count))


@pytest.mark.parametrize("message", ["number", "identity"])
@case("CHN-023", "CHN-024", "CHN-010", "TIM-002/2", "CHN-021/2", needs=FAULTY_AND_SEEN, allow=(Risk.RESET,))
def test_a_chain_that_is_not_numbered_comes_up_with_the_next_reset(bench: Bench, message: str) -> None:
    """If a number or an identity is damaged the chain ends there, until the next RESET numbers it again."""
    place, well = processor_of(bench), bench.processors()[0]
    bench.levers.cause(faults.FlippedBit(message=message, processor=place, token=5, bit=1))
    bench.restart(lambda: bench.order(Request.RESET))
    expect_all(bench.status(), state=State.FAULT, faults=Fault.PROCESSOR)
    expect_there(bench, place, well)
    assert not bench.try_order(Request.ENABLE), "ENABLE is carried out in FAULT"
    bench.restart(lambda: bench.order(Request.RESET))
    expect_faults(bench, NO_FAULTS)
    expect_there(bench, PROCESSORS, well)
    plays_everywhere(bench)


# A chain without errors


def check_nothing_missed(bench: Bench, before: Status) -> None:
    """Fail if a commit was missed, a message damaged, a change late, or a fault raised."""
    bench.wait(ROUND_SECONDS)
    expect_all(
        bench.status(),
        missed_commits=before.missed_commits,
        damaged_messages=before.damaged_messages,
        late=before.late,
        faults=NO_FAULTS,
    )


def queue_length(bench: Bench) -> int:
    """How many changes a case queues at once: as many as the device takes and the line sends in time."""
    return min(bench.info.queue_blocks, 32 if bench.line.kind == "usb" else 10)


@case("CHN-020", "BUD-004", outputs=("CHN-005", "CHN-007", "TIM-003"))
def test_updates_at_the_rate_that_holds_play_on_all_processors(bench: Bench) -> None:
    """Updates as close as INFO allows each change all outputs in the same tick, and no processor misses one."""
    enable(bench)
    before, first = bench.status(), soon(bench, queue_length(bench))
    steps = []
    for number in range(queue_length(bench)):
        pulses = bench.weak()
        ack = bench.must(Update(pulses, first + number * bench.info.periods_per_update))
        check_in_time(ack, first + number * bench.info.periods_per_update)
        steps.append((ack.commit_period, expected_words(pulses, bench.wiring)))
    end = steps[-1][0] + 20
    bench.wait_until(end)
    check_nothing_missed(bench, before)
    bench.judge(first, end, lambda seen: check_play(seen, steps))


@case("CHN-019", "CHN-020", "CHN-017/1", outputs=("CHN-019", "CHN-012/2"), features=Feature.SEQUENCES)
def test_no_update_waits_for_stores_or_questions(bench: Bench) -> None:
    """Updates take effect on time while stores go onto the chain and PULSES reads back from every processor."""
    enable(bench)
    before, first = bench.status(), soon(bench, queue_length(bench))
    count, spacing = queue_length(bench), 3 * bench.info.periods_per_update
    steps = []
    for number in range(count):
        pulses = bench.weak()
        steps.append((first + number * spacing, expected_words(pulses, bench.wiring)))
        check_in_time(bench.must(Update(pulses, steps[-1][0])), steps[-1][0])
    slots = [bench.weak() for _ in range(6)]
    if bench.line.kind == "usb":
        bench.wait_until(first - 60)
    bench.send_all([Slot(10 + number, pulses) for number, pulses in enumerate(slots)])
    bench.send_all([Entries(tuple(Entry(10 + number % 6, 3) for number in range(120)), 100)])
    if Feature.READ_BACK in bench.info.features:
        for _ in range(3):
            bench.read_back()
    played = steps[-1][0] + 20
    bench.wait_until(played)
    check_nothing_missed(bench, before)
    began = bench.must(PlaySequence(100, 12)).commit_period
    steps += [(began + 3 * number, expected_words(slots[number % 6], bench.wiring)) for number in range(12)]
    bench.judge(first, began + 36, lambda seen: check_play(seen, steps))


@pytest.mark.parametrize("gap", [1, 2, 5])
@case("CHN-014/2", outputs=("CHN-014/2", "CHN-014"), features=Feature.SEQUENCES)
def test_sequences_close_to_each_other_begin_each_at_its_own_period(bench: Bench, gap: int) -> None:
    """Sequences in close succession each begin in the period of their acknowledgement, and none is missed."""
    enable(bench)
    slots = [bench.weak() for _ in range(4)]
    for number, pulses in enumerate(slots):
        bench.must(Slot(number, pulses))
    bench.must(Entries(tuple(Entry(number, 2) for number in range(4))))
    before, first = bench.status(), soon(bench, 4)
    periods = [bench.must(PlaySequence(number, 1, first + gap * number)).commit_period for number in range(4)]
    expect("whether they follow each other", periods, sorted(set(periods)))
    bench.wait_until(periods[-1] + 20)
    bench.wait(ROUND_SECONDS)
    expect_all(bench.status(), missed_commits=before.missed_commits, faults=NO_FAULTS)
    steps = [(period, expected_words(pulses, bench.wiring)) for period, pulses in zip(periods, slots, strict=True)]
    bench.judge(first, periods[-1] + 20, lambda seen: check_play(seen, steps))


@case("CHN-015", "CHN-012/2", "TIM-003", "TIM-004", needs=(Need.CAPTURE,), features=Feature.SEQUENCES)
def test_steps_follow_from_the_period_alone(bench: Bench) -> None:
    """Long after its start, under other traffic, a sequence plays its right entry on all processors."""
    enable(bench)
    lengths = [bench.random.randint(1, 9) for _ in range(7)]
    words = []
    for number in range(len(lengths)):
        pulses = bench.weak()
        bench.must(Slot(20 + number, pulses))
        words.append(expected_words(pulses, bench.wiring))
    bench.must(Entries(tuple(Entry(20 + number, length) for number, length in enumerate(lengths)), 30))
    before = bench.status()
    began = bench.must(PlaySequence(30, len(lengths))).commit_period
    for number in range(6):
        bench.must(Slot(number, SILENT))
        bench.wait_periods(bench.random.uniform(1, 900))
    check_nothing_missed(bench, before)
    loop = sum(lengths)
    first = began + -(-(bench.period() - began) // loop) * loop
    starts = np.cumsum([0, *lengths[:-1]])
    steps = [
        (first + turn * loop + int(start), field)
        for turn in range(40)
        for start, field in zip(starts, words, strict=True)
    ]
    bench.judge(first, first + 40 * loop, lambda seen: check_play(seen, steps))
