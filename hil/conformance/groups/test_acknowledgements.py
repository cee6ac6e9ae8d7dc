"""Records: one acknowledgement for each block, its contents, and unsolicited status records (chapter ACK)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import pytest
from phasewire.emulator.faults import HotBoard
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, case, expect
from phasewire.hil.conformance.dialogue import TOLD_PERIODS
from phasewire.hil.conformance.tools.clocks import unless_busy
from phasewire.hil.conformance.tools.exchange import order
from phasewire.hil.conformance.tools.forge import forged
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    SILENT,
    begin,
    cut,
    enable,
    expect_all,
    far,
    forge,
    later,
    let_stores_go,
    raw_records,
    store_entry,
)
from phasewire.hil.conformance.tools.watchdog import PERIODS_PER_MS, patience
from phasewire.hil.traffic.traffic import Traffic
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Block,
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
    pack,
)
from phasewire.protocol.codes import Action, Fault, Feature, Reason, Request, State, StatusFlag
from phasewire.protocol.replies import Status

ENDPOINT_OUT, ENDPOINT_IN = 0x01, 0x81
ACK = struct.Struct("<2sBBIQQBBBBI")
LATE, GAP = 1, 2
LEAST_TICKS_OF_A_BLOCK = 17
"""512 bytes take 8.5 µs on a bus of 480 Mbit/s: no line delivers two blocks closer together."""
RECORD_BYTES = 32
PATIENCE_SECONDS = 10.0
"""Time for blocks to be accepted, with a margin for a busy computer."""


class AckFields(NamedTuple):
    """The fields of an acknowledgement as clause ACK-002 lays them out, not yet judged."""

    magic: bytes
    version: int
    reason: int
    sequence: int
    commit_period: int
    now: int
    flags: int
    free: int
    state: int
    reserved: int
    checksum: int


def answers(bench: Bench, *blocks: bytes) -> list[AckFields]:
    """Send blocks and return their acknowledgements; fails unless form, number and checksum are right."""
    records = [record for record in raw_records(bench, blocks) if record[:2] != b"PS"]
    expect("the number of acknowledgements", len(records), len(blocks))
    found = []
    for block, record in zip(blocks, records, strict=True):
        expect("bytes of an acknowledgement", len(record), RECORD_BYTES)
        answer = AckFields(*ACK.unpack(record))
        expect("magic", answer.magic, b"PA")
        expect("version", answer.version, 1)
        expect("sequence", answer.sequence, int.from_bytes(block[4:8], "little"))
        expect("the reserved byte", answer.reserved, 0)
        expect("unknown flags", answer.flags & ~(LATE | GAP), 0)
        expect("checksum", answer.checksum, zlib.crc32(record[:28]))
        found.append(answer)
    return found


def blocks_of(bench: Bench, bodies: Sequence[Body]) -> list[bytes]:
    """Blocks with the next numbers."""
    return [pack(bench.numbered(body)) for body in bodies]


# One for each block


@case("ACK-001", "ACK-002", "ACK-004", "BLK-001")
def test_each_block_is_answered_in_order(bench: Bench) -> None:
    """Valid and invalid blocks, mixed in one transfer, are answered one by one and in order, and nothing else comes."""
    begin(bench)
    many = bench.tries(100, 6)
    bodies: tuple[Body, ...] = (NoOp(), Clock())
    blocks, reasons = [], []
    for number in range(many):
        wrong = bench.random.choice(["", "", "checksum", "magic", "kind", "number"])
        block = pack(bench.numbered(bench.random.choice(bodies)))
        fields = {"checksum": {"checksum": 1}, "magic": {"magic": 0}, "kind": {"kind": 99}}.get(wrong, {})
        if wrong == "number":
            block = pack(Block(NoOp(), bench.random.randrange(2**32), restart=True))
            bench.numbered(NoOp(), number=int.from_bytes(block[4:8], "little"))
        blocks.append(forged(block, None, **fields))
        reasons.append({"checksum": 2, "magic": 3, "kind": 5}.get(wrong, 0))
        bench.note("wrong", f"{number}: {wrong or 'nothing'}")
    found = answers(bench, *blocks)
    expect("the reasons", [answer.reason for answer in found], reasons)
    expect("what else comes", bench.listen(), [])


@case("ACK-001", "BLK-001", line="usb")
def test_more_blocks_than_records_that_fit_are_all_answered(bench: Bench) -> None:
    """More blocks than the device can hold records for, sent while records are read, are all answered in order."""
    bench.must(NoOp())
    before = bench.status()
    acks = bench.send_all([NoOp()] * (bench.info.queue_records + 40))
    for ack in acks:
        expect("the reason", ack.reason, Reason.ACCEPTED)
    expect_all(bench.status(), accepted=(before.accepted + len(acks)) % 2**32, lost=before.lost)


# Contents


@case("ACK-002", "ACK-003")
def test_the_fields_of_an_acknowledgement(bench: Bench) -> None:
    """Each byte is right: reason, number, commit_period of changes only, free, state, zero reserved bits, checksum."""
    begin(bench)
    places = bench.info.queue_blocks
    named = far(bench)
    cases: list[tuple[bytes, int, int | None, int]] = [
        (forge(bench, NoOp()), 0, 0, places),
        (forge(bench, Clock()), 0, None, places),
        (forge(bench, Update(SILENT, named)), 0, named, places - 1),
        (forge(bench, Output(Action.SILENCE, named + 99)), 0, named + 99, places - 2),
        (forge(bench, Update(SILENT, named + 200), reserved=1), 6, 0, places - 2),
        (forge(bench, Update(SILENT, named + 200), checksum=0), 2, 0, places - 2),
        (forge(bench, Clock(), kind=99), 5, 0, places - 2),
    ]
    for block, reason, commit_period, free in cases:
        before = bench.clock().now
        (answer,) = answers(bench, block)
        after = bench.clock().now
        expect("reason", answer.reason, reason)
        if commit_period is not None:
            expect("commit_period", answer.commit_period, commit_period)
        expect("free", answer.free, free)
        expect("state", answer.state, State.READY)
        expect("LATE", answer.flags & LATE, 0)
        assert before <= answer.now <= after, f"now is {answer.now}, should be from {before} to {after}"


@case("ACK-002", features=Feature.SEQUENCES | Feature.MODULATION)
@pytest.mark.parametrize(
    "body",
    [Slot(0, SILENT), Entries((Entry(0, 1),)), Samples(b"\1"), NoOp()],
    ids=["slot", "entries", "samples", "no-op"],
)
def test_what_is_no_change_has_no_commit_period(bench: Bench, body: Body) -> None:
    """The acknowledgement of a store or a NO_OP has 0 as commit_period, because it takes effect in no period."""
    begin(bench)
    for answer in answers(bench, *blocks_of(bench, [body, body])):
        expect_all(answer, reason=Reason.ACCEPTED, commit_period=0, flags=0)


@case("ACK-002", "TIM-002/1")
def test_now_is_when_the_block_had_arrived(bench: Bench) -> None:
    """`now` lies between two readings of the clock, and blocks of one transfer are as far apart as a line allows.

    It is no later than a reading that was asked for before the acknowledgement came.
    """
    bench.must(NoOp())
    bench.line.send_blocks(pack(bench.numbered(NoOp())), PATIENCE_SECONDS)
    behind = bench.clock().now
    came = bench.line.receive_records(PATIENCE_SECONDS)
    bench.note("records", came, Traffic.RECORD)
    now = AckFields(*ACK.unpack(came)).now
    assert now <= behind, f"now is {now}, should be {behind} or earlier, as the clock was asked for after the block"
    before = bench.clock().now
    found = answers(bench, *blocks_of(bench, [NoOp()] * bench.tries(40, 4)))
    after = bench.clock().now
    times = [before, *(answer.now for answer in found)]
    for one, other in pairwise(times[1:]):
        assert other - one >= LEAST_TICKS_OF_A_BLOCK, (
            f"two blocks had arrived at ticks {one} and {other}, should be {LEAST_TICKS_OF_A_BLOCK} apart at least"
        )
    assert before <= times[1], f"now is {times[1]}, should be {before} or later"
    assert times[-1] <= after, f"now is {times[-1]}, should be {after} or earlier"


@case("ACK-002", "STA-001", "BLK-024", since=2)
def test_the_state_is_that_in_which_the_block_was_judged(bench: Bench) -> None:
    """An acknowledgement holds the state before its block takes effect, not the state to which the block leads."""
    bench.must(NoOp())
    expect("state while off", answers(bench, forge(bench, NoOp()))[0].state, State.OFF)
    begin(bench)
    named = later(bench)
    (update,) = answers(bench, forge(bench, Update(SILENT, named)))
    expect("state before an update begins", update.state, State.READY)
    bench.wait_until(update.commit_period)
    (silence,) = answers(bench, forge(bench, Output(Action.SILENCE)))
    expect("state while an update plays", silence.state, State.PLAYING)
    bench.wait_until(silence.commit_period)
    expect("state after SILENCE", answers(bench, forge(bench, NoOp()))[0].state, State.READY)
    (disable,) = answers(bench, forge(bench, Output(Action.DISABLE)))
    expect("state before DISABLE", disable.state, State.READY)
    bench.wait_until(disable.commit_period)
    expect("state after DISABLE", answers(bench, forge(bench, NoOp()))[0].state, State.OFF)


@case("ACK-002", "STA-001", "SAF-005", features=Feature.SEQUENCES | Feature.UNATTENDED)
def test_the_state_says_what_plays_unattended(bench: Bench) -> None:
    """While an unattended sequence plays, acknowledgements and STATUS report UNATTENDED."""
    begin(bench)
    store_entry(bench, 100, pulses=SILENT)
    let_stores_go(bench)
    for unattended, state in ((True, State.UNATTENDED), (False, State.PLAYING)):
        bench.wait_until(bench.must(PlaySequence(0, 1, unattended=unattended)).commit_period)
        expect("state", answers(bench, forge(bench, NoOp()))[0].state, state)
        expect("state in STATUS", bench.status().state, state)


@case("ACK-004", "BLK-005/1", "BLK-007")
def test_late_is_said_of_changes_that_come_too_late(bench: Bench) -> None:
    """LATE marks a change for a period that is over or taken, never one that is in time or as soon as possible."""
    begin(bench)
    past = bench.period()
    (answer,) = answers(bench, forge(bench, Update(SILENT, past)))
    expect("flags of a period that is over", answer.flags, LATE)
    assert answer.commit_period > past, f"commit_period is {answer.commit_period}, should be after {past}"
    named = far(bench)
    silence = Action.SILENCE
    bodies: list[Body] = [Update(SILENT), Update(SILENT, named), Output(silence, named), Output(silence, named - 5)]
    found = answers(bench, *blocks_of(bench, bodies))
    expect("flags", [answer.flags for answer in found], [0, 0, LATE, LATE])
    expect("commit_period in time", found[1].commit_period, named)
    taken = [answer.commit_period for answer in found]
    assert named < taken[2] < taken[3], f"late changes take effect at {taken[2:]}, should be one after the other"
    expect("the reasons", [answer.reason for answer in found], [Reason.ACCEPTED] * 4)


@case("ACK-004", "BLK-005/1", features=Feature.MODULATION | Feature.SEQUENCES)
def test_changes_of_all_kinds_can_be_late(bench: Bench) -> None:
    """Each kind of change is LATE for a period that is over, and STATUS counts each such change once."""
    begin(bench)
    for body in (Slot(0, SILENT), Entries((Entry(0, 9),)), Samples(b"\xff")):
        bench.must(body)
    let_stores_go(bench)
    past = bench.period()
    before = bench.status().late
    silence = Output(Action.SILENCE, past)
    bodies: list[Body] = [Update(SILENT, past), PlaySequence(0, 1, past), AmplitudeModulation(0, 1, 1, past), silence]
    found = answers(bench, *blocks_of(bench, bodies))
    expect("flags", [answer.flags for answer in found], [LATE] * 4)
    expect("the count of late changes", bench.status().late, (before + 4) % 2**32)


# How records travel


def packets(bench: Bench, records: int) -> list[bytes]:
    """Packets from 81 IN until so many bytes of acknowledgements have come, and those that follow at once."""
    found: list[bytes] = []
    size = bench.usb.bulk_bytes
    while (packet := bench.usb.read(ENDPOINT_IN, size, 0.1 if sum(map(len, found)) < records else 0.005)) is not None:
        found.append(packet)
    bench.note("packets", ", ".join(str(len(packet)) for packet in found))
    return found


def leave_unread(bench: Bench, bodies: Sequence[Body]) -> None:
    """Send blocks and read nothing."""
    blocks = blocks_of(bench, bodies)
    bench.note_blocks(blocks)
    data = b"".join(blocks)
    expect("bytes taken", bench.usb.write(ENDPOINT_OUT, data, PATIENCE_SECONDS), len(data))
    bench.outlast(0.01)


def leave_unread_until_the_watchdog_fires(bench: Bench, bodies: Sequence[Body]) -> None:
    """Send blocks to enabled outputs and read nothing; the watchdog fires after all have been accepted."""
    enable(bench)
    leave_unread(bench, bodies)
    bench.order(Request.WATCHDOG, 100)
    bench.outlast(0.2)


@case("ACK-005", "USB-019", line="usb")
@pytest.mark.parametrize("many", [1, 5, 15, 16, 17, 33])
def test_a_packet_holds_whole_records(bench: Bench, many: int) -> None:
    """Records that wait come in packets of whole records, the status last, and the last packet is not full."""
    if many > bench.info.queue_records:
        raise Inconclusive(f"no more than {bench.info.queue_records} records can wait in this device")
    leave_unread_until_the_watchdog_fires(bench, [NoOp()] * many)
    found = packets(bench, 32 * many + 64)
    for packet in found:
        records = cut(packet)
        whole = all(len(record) == (64 if record[:2] == b"PS" else 32) for record in records)
        assert whole, f"a packet of {len(packet)} bytes ends within a record"
    records = cut(b"".join(found))
    expect("acknowledgements", sum(record[:2] == b"PA" for record in records), many)
    expect("status records", sum(record[:2] == b"PS" for record in records), 1)
    expect("the last record", records[-1][:2], b"PS")
    size = bench.usb.bulk_bytes
    assert len(found[-1]) < size, f"the last packet has {size} bytes: a full packet does not end a transfer"


@case("ACK-005", line="usb", should=True)
def test_a_packet_holds_as_many_records_as_fit(bench: Bench) -> None:
    """Each packet holds as many waiting acknowledgements as fit, except the first, which may be ready before."""
    many = min(64, bench.info.queue_records)
    bench.must(NoOp())
    leave_unread(bench, [NoOp()] * many)
    sizes = [len(packet) for packet in packets(bench, RECORD_BYTES * many)]
    full = bench.usb.bulk_bytes // RECORD_BYTES * RECORD_BYTES
    left = RECORD_BYTES * many - sizes[0]
    if left < full:
        raise Inconclusive(f"the {many} records that can wait in this device fill no packet after the first")
    expect("bytes in packets after the first", sizes[1 : 1 + left // full], [full] * (left // full))


@case("ACK-005")
def test_a_record_is_not_held_back(bench: Bench) -> None:
    """A single acknowledgement comes at once: a host may wait for it before it sends the next block."""
    bench.must(NoOp())
    delays = []
    allowed = 10 if bench.line.kind == "usb" else 40
    for _ in range(10):
        ack = bench.must(NoOp())
        delays.append((bench.clock().now - ack.now) / 2000)
        if delays[-1] < allowed:
            break
    else:
        unless_busy(bench, f"acknowledgements come {min(delays):.1f} ms after their blocks")
    assert min(delays) < allowed, f"acknowledgements come {min(delays):.1f} ms after their blocks, should be {allowed}"


# Unsolicited status records


@case("ACK-006/1", "SAF-003", "REQ-003")
def test_the_watchdog_is_told(bench: Bench) -> None:
    """When the watchdog disables the outputs a status record with the state and the flag comes unasked."""
    enable(bench, 20)
    expect_all(bench.await_unasked(1), state=State.OFF, flags=StatusFlag.WATCHDOG_FIRED, watchdog_ms=20)
    expect("what else comes", bench.listen(), [])


@case("ACK-006/2", "SAF-003", since=2)
def test_the_watchdog_is_told_within_20_ms(bench: Bench) -> None:
    """20 ms after the watchdog has fired its record is there, before or among the answers to three blocks sent then."""
    ms = patience(bench)
    enable(bench, ms)
    fired = bench.period() + ms * PERIODS_PER_MS + 1
    bench.wait_until(fired + TOLD_PERIODS + 1)
    for _ in range(3):  # a device may answer before it sends the record, but not for ever
        bench.must(NoOp())
    expect("the states of the unsolicited records by then", [status.state for status in bench.unasked], [State.OFF])


@case("ACK-006/1", "BLK-015", features=Feature.SEQUENCES)
def test_the_end_of_a_sequence_is_told(bench: Bench) -> None:
    """Soon after the last repeat of a sequence a status record with READY comes unasked."""
    begin(bench)
    bench.must(Slot(0, SILENT))
    bench.must(Entries((Entry(0, 150), Entry(0, 50))))
    let_stores_go(bench)
    ends = bench.must(PlaySequence(0, 2, repeats=3)).commit_period + 600
    status = bench.await_unasked(2)
    expect_all(status, state=State.READY, since_period=0, flags=StatusFlag(0))
    period = status.period
    assert ends <= period < ends + 40, f"it was sent in period {period}, should be in {ends} or soon after"


@case("ACK-006", "SAF-008", "REQ-011", needs=(Need.FAULTS,))
def test_faults_are_told(bench: Bench) -> None:
    """When a fault appears, and when it is cleared, a status record with the faults and the state comes unasked."""
    begin(bench)
    bench.must(Update(SILENT))
    bench.levers.cause(HotBoard(board=1, celsius=90))
    expect_all(bench.await_unasked(1), state=State.FAULT, faults=Fault.TEMPERATURE)
    bench.levers.cause(HotBoard(board=1, celsius=40))
    bench.outlast(0.03)
    bench.order(Request.CLEAR_FAULTS)
    expect_all(bench.await_unasked(1), state=State.OFF, faults=Fault(0))


@case("ACK-006", "STA-003", "USB-020", needs=(Need.SUSPEND,), allow=(Risk.RESET,), line="usb")
def test_suspend_and_resume_are_told(bench: Bench) -> None:
    """After suspend and resume a status record that says OFF waits, so that the host knows."""
    begin(bench)
    bench.levers.suspend()
    bench.levers.resume()
    expect("the state", bench.await_unasked(1).state, State.OFF)
    expect("what else comes", bench.listen(), [])


@case("ACK-006", line="usb", features=Feature.SEQUENCES)
def test_only_the_newest_status_waits(bench: Bench) -> None:
    """Of unsolicited status records that were not read only the newest waits, after the acknowledgements."""
    store_entry(bench, 50, pulses=SILENT)
    let_stores_go(bench)
    for _ in range(3):  # each leaves a record: OFF, by the watchdog
        enable(bench, 10)
        bench.outlast(0.03)
    enable(bench)
    leave_unread(bench, [NoOp(), PlaySequence(0, 1, repeats=2)])
    bench.outlast(0.03)
    found = bench.listen(0.05)
    expect("the records", [type(record).__name__ for record in found], ["Ack", "Ack", "Status"])
    status = found[-1]
    assert isinstance(status, Status)
    expect_all(status, state=State.READY, flags=StatusFlag(0))


@case("ACK-006", "ACK-001", line="usb")
def test_a_status_has_a_place_of_its_own(bench: Bench) -> None:
    """If as many acknowledgements wait as the device can hold, a status record is kept in addition."""
    leave_unread_until_the_watchdog_fires(bench, [NoOp()] * bench.info.queue_records)
    found = bench.listen(0.05)
    kinds = [type(record).__name__ for record in found]
    expect("acknowledgements", kinds.count("Ack"), bench.info.queue_records)
    expect("what follows them", kinds[bench.info.queue_records :], ["Status"])


@case("ACK-006", "SER-016", "REQ-005", line="usb", features=Feature.CONSOLE)
def test_what_came_through_another_door_is_told(bench: Bench) -> None:
    """A change of state from a serial line is told on USB, and the other way round, once each."""
    other = bench.serial
    other.enter_frames()
    bench.order(Request.WATCHDOG, LONG_MS)
    try:
        for request, state in ((Request.ENABLE, State.READY), (Request.DISABLE, State.OFF)):
            order(other, request)
            expect(f"the state after {request.name} on the serial line", bench.await_unasked(1).state, state)
        expect("what else comes", bench.listen(), [])
        for request, state in ((Request.ENABLE, State.READY), (Request.DISABLE, State.OFF)):
            bench.order(request)
            record = other.receive_records(1)
            expect(f"bytes on the serial line after {request.name} on USB", len(record), 64)
            expect("the state", Status.decode(record).state, state)
    finally:
        other.enter_console()
