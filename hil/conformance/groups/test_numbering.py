"""The numbers of blocks: which follow, which are missing, and when the numbering restarts (chapter NUM)."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Risk, case, expect
from phasewire.hil.conformance.tools.steps import (
    SILENT,
    Wrong,
    begin,
    check_same,
    expect_all,
    far,
    let_stores_go,
    refuse,
    some,
    vectors,
)
from phasewire.protocol.blocks import Block, Body, Clock, NoOp, Samples, Slot, Update, pack
from phasewire.protocol.codes import AckFlag, Feature, Reason, Request
from phasewire.protocol.replies import Ack

NUMBERS = 2**32
HALF = 2**31
FIRST = NUMBERS - 3


def send(bench: Bench, number: int, body: Body | None = None, *, restart: bool = False) -> Ack:
    """Send a block with a number; returns its acknowledgement."""
    (ack,) = bench.send_raw(pack(Block(body or NoOp(), number % NUMBERS, restart)))
    return ack


def must(bench: Bench, number: int, body: Body | None = None, *, restart: bool = False, missing: int = 0) -> Ack:
    """Send a block with a number that must be accepted, after so many missing numbers."""
    before = bench.status().lost
    ack = send(bench, number, body, restart=restart)
    expect(f"the reason for number {number % NUMBERS}", ack.reason, Reason.ACCEPTED)
    expect(f"whether number {number % NUMBERS} says GAP", AckFlag.GAP in ack.flags, missing > 0)
    expect("the count of lost blocks", bench.status().lost, (before + missing) % NUMBERS)
    return ack


def refused(number: int, body: Body | None = None) -> Wrong:
    """A block whose number does not follow."""
    return Wrong(
        f"number {number % NUMBERS}", pack(Block(body or NoOp(), number % NUMBERS, restart=False)), Reason.SEQUENCE
    )


@case("NUM-002", "NUM-003", "ACK-004")
def test_numbers_follow_as_the_vectors_say(bench: Bench) -> None:
    """The pairs of numbers of vectors.json follow each other, or not, and count as missing, as stated there."""
    for vector in some(bench, vectors("block_numbers")):
        must(bench, vector["last"], restart=True)
        if vector["follows"]:
            must(bench, vector["number"], missing=vector["missing"])
        else:
            refuse(bench, [refused(vector["number"])])


@case("NUM-001", "NUM-003")
def test_numbers_wrap_without_a_gap(bench: Bench) -> None:
    """0 follows the largest number: a count across it is accepted without a gap, in one transfer too."""
    must(bench, FIRST, restart=True)
    before = bench.status()
    acks = bench.send_raw(*(pack(Block(NoOp(), (FIRST + step) % NUMBERS)) for step in range(1, 7)))
    for ack in acks:
        expect_all(ack, f" for number {ack.sequence}", reason=Reason.ACCEPTED, flags=AckFlag(0))
    check_same(before, bench.status(), accepted=(before.accepted + 6) % NUMBERS)


@case("NUM-002", "NUM-003")
def test_the_next_half_of_all_numbers_follows(bench: Bench) -> None:
    """From any count, numbers up to 2³¹ − 1 ahead of it are accepted, and all others refused."""
    for _ in range(bench.tries(10, 2, 8)):
        last = bench.random.randrange(NUMBERS)
        ahead = bench.random.randrange(2, HALF)
        must(bench, last, restart=True)
        refuse(bench, [refused(last), refused(last - 1), refused(last + HALF), refused(last + HALF + ahead)])
        must(bench, last + ahead, missing=ahead - 1)
        refuse(bench, [refused(last), refused(last + 1)] if ahead > 2 else [refused(last)])
        must(bench, last + ahead + HALF - 1, missing=HALF - 2)


@case("NUM-002", "BLK-008")
def test_a_block_that_comes_twice_is_carried_out_once(bench: Bench) -> None:
    """An update that is sent again with its number is refused with SEQUENCE, and is queued only once."""
    begin(bench)
    block = pack(bench.numbered(Update(bench.weak(), far(bench))))
    (ack,) = bench.send_raw(block)
    expect_all(ack, reason=Reason.ACCEPTED, free=bench.info.queue_blocks - 1)
    refuse(bench, [Wrong("the same block", block, Reason.SEQUENCE)] * 3)


@case("NUM-002", "BLK-008", features=Feature.SEQUENCES | Feature.MODULATION)
@pytest.mark.parametrize(
    "body", [Slot(3, SILENT), Samples(b"\x80", 3), Clock(), NoOp()], ids=["slot", "samples", "clock", "no-op"]
)
def test_blocks_of_all_kinds_are_counted(bench: Bench, body: Body) -> None:
    """Stores, CLOCK and NO_OP share the numbering of changes: old numbers are refused, gaps are reported."""
    must(bench, 100, restart=True)
    must(bench, 101, body)
    let_stores_go(bench)
    refuse(bench, [refused(101, body), refused(100, body), refused(101)])
    must(bench, 105, body, missing=3)
    must(bench, 107, missing=1)


@case("NUM-003", "NUM-002")
def test_a_refused_block_leaves_its_number_free(bench: Bench) -> None:
    """A refused number counts as missing, unless it comes again, valid, before a later one."""
    must(bench, 10, restart=True)
    for number, reason in ((11, Reason.DISABLED), (500, Reason.DISABLED)):
        refuse(bench, [Wrong("an update while off", pack(Block(Update(SILENT), number)), reason)])
    must(bench, 11)
    refuse(bench, [Wrong("an update while off", pack(Block(Update(SILENT), 12)), Reason.DISABLED)])
    must(bench, 13, missing=1)
    refuse(bench, [refused(12)])
    must(bench, 14)


@case("NUM-002", "NUM-003")
def test_a_number_that_does_not_follow_does_not_count(bench: Bench) -> None:
    """After numbers refused with SEQUENCE the count goes on from the last accepted one."""
    must(bench, 1000, restart=True)
    refuse(bench, [refused(1000), refused(999), refused(1000 + HALF), refused(1001 + HALF)])
    must(bench, 1001)
    must(bench, 1003, missing=1)


@case("NUM-003", "ACK-004")
def test_each_gap_in_a_transfer_is_told(bench: Bench) -> None:
    """Of updates in one transfer, with gaps, each after a gap has GAP, and all missing numbers are counted."""
    begin(bench)
    number = bench.must(Update(SILENT)).sequence
    before = bench.status()
    steps = [1, 1, 2, 1, 4, 1, 1, 1, 100, 1] * bench.tries(3, 1, 10)
    numbers = [number := (number + step) % NUMBERS for step in steps]
    acks = bench.send_raw(*(pack(Block(Update(SILENT), number)) for number in numbers))
    for ack, step in zip(acks, steps, strict=True):
        expect(f"the reason for number {ack.sequence}", ack.reason, Reason.ACCEPTED)
        expect(f"whether {step} more than the last says GAP", AckFlag.GAP in ack.flags, step > 1)
    lost = sum(steps) - len(steps)
    expect("the count of lost blocks", bench.status().lost, (before.lost + lost) % NUMBERS)


@case("NUM-002", "ACK-001")
def test_a_repeat_within_a_transfer_is_refused(bench: Bench) -> None:
    """Of updates in one transfer those that repeat a number are refused with SEQUENCE and the others accepted."""
    begin(bench)
    first = bench.must(Update(SILENT)).sequence
    steps = [1, 2, 2, 3, 1, 4, 5, 5, 6]
    acks = bench.send_raw(*(pack(Block(Update(SILENT), (first + step) % NUMBERS)) for step in steps))
    last = 0
    for ack, step in zip(acks, steps, strict=True):
        expect(f"the reason for step {step}", ack.reason, Reason.ACCEPTED if step > last else Reason.SEQUENCE)
        expect(f"flags for step {step}", ack.flags & AckFlag.GAP, AckFlag(0))
        last = max(last, step)


@case("NUM-004")
def test_a_block_with_restart_may_have_any_number(bench: Bench) -> None:
    """A block with RESTART is accepted with any number, without a gap, and the numbering begins with it."""
    must(bench, 5, restart=True)
    for number in (5, 4, 0, 5 + HALF, 6, 1_000_000, NUMBERS - 1):
        must(bench, number, restart=True)
    must(bench, 0)
    must(bench, 2_000_000_000, restart=True)
    refuse(bench, [refused(1_999_999_999), refused(0)])
    must(bench, 2_000_000_002, missing=1)


@case("NUM-004", "BLK-008")
def test_a_refused_block_with_restart_begins_nothing(bench: Bench) -> None:
    """A block with RESTART that is refused for another reason leaves the count as it is."""
    must(bench, 50, restart=True)
    wrong = Wrong("an update while off", pack(Block(Update(SILENT), 7, restart=True)), Reason.DISABLED)
    refuse(bench, [wrong, refused(8)])
    must(bench, 51)


@case("NUM-004", "USB-026", line="usb")
@pytest.mark.parametrize("how", ["set-configuration", "set-interface"])
def test_any_number_is_accepted_after_the_host_came_anew(bench: Bench, how: str) -> None:
    """After SET_CONFIGURATION and SET_INTERFACE any number is accepted without RESTART, and the count begins there."""
    begin_anew = {
        "set-configuration": bench.usb.set_configuration,
        "set-interface": lambda: bench.usb.set_interface(0),
    }[how]
    check_begins_anew(bench, begin_anew)


@case("NUM-004", "USB-026", line="usb", allow=(Risk.RESET,))
def test_any_number_is_accepted_after_a_bus_reset(bench: Bench) -> None:
    """After a bus reset any number is accepted without RESTART, and the count begins there."""
    check_begins_anew(bench, bench.usb.reset)


@case("NUM-004", "REQ-013", allow=(Risk.RESET,))
def test_any_number_is_accepted_after_a_restart(bench: Bench) -> None:
    """After power-up, as after the request RESET, any number is accepted without RESTART, and counts from there."""
    check_begins_anew(bench, lambda: bench.restart(lambda: bench.order(Request.RESET)))


def check_begins_anew(bench: Bench, begin_anew: Callable[[], None]) -> None:
    """Check that a number that would not follow is accepted after some event."""
    for last, number in ((1000, 1000), (1000, 7), (7, 7 + HALF)):
        must(bench, last, restart=True)
        refuse(bench, [refused(number)])
        begin_anew()
        must(bench, number)
        refuse(bench, [refused(number), refused(number - 1)])
        must(bench, number + 2, missing=1)


@case("NUM-003", "REQ-003")
def test_the_count_of_lost_blocks_wraps(bench: Bench) -> None:
    """The count of lost blocks has 32 bits and wraps to 0 after 2³² − 1, as all counters do."""
    for turn in range(3):
        must(bench, turn, restart=True)
        must(bench, turn + HALF - 1, missing=HALF - 2)
