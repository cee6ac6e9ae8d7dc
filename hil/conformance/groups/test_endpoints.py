"""Endpoints and sessions: halts, short and empty packets, the console's interfaces, and what each session resets."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from phasewire.base.errors import DeviceError, DeviceStalledError
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import check_silent
from phasewire.hil.conformance.tools.dfu import RawDfuLine
from phasewire.hil.conformance.tools.forge import forged
from phasewire.hil.conformance.tools.player import soon
from phasewire.hil.conformance.tools.steps import LONG_MS, enable, expect_all, known, store_entry
from phasewire.hil.conformance.tools.watchdog import TICKS_PER_MS, await_firing, check_not_yet, patience
from phasewire.hil.conformance.transports.usb import CONSOLE_IN, CONSOLE_OUT
from phasewire.hil.traffic.traffic import Traffic
from phasewire.host.transports.usb_find import DFU_MODE
from phasewire.protocol.blocks import AmplitudeModulation, NoOp, PlaySequence, Samples, Update, pack
from phasewire.protocol.board import CARRIER_HZ
from phasewire.protocol.codes import (
    BLOCK_BYTES,
    PAYLOAD_BYTES,
    RECORD_BYTES,
    SILENT_PERIODS,
    AckFlag,
    Feature,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.replies import Ack, Status, records
from phasewire.protocol.requests import Setup

BLOCKS_OUT, RECORDS_IN, NOTIFICATIONS_IN = 0x01, 0x81, 0x82
ENDPOINTS = (BLOCKS_OUT, RECORDS_IN, NOTIFICATIONS_IN, CONSOLE_OUT, CONSOLE_IN)
ARRAY, CONSOLE, CONSOLE_DATA, FIRMWARE = 0, 1, 2, 3
SOON = 5.0
"""Seconds within which a device that can answer has answered, however slow the host is."""
COMMAND_SECONDS = 0.05
"""Time for a command of the console; clause SER-013 allows 20 ms until its answer begins."""
LONG_READ = 10.0
QUIET = 0.03
"""Seconds in which an unwanted transfer would have come."""
LINE_CODING_AT_FIRST = bytes([0x00, 0xC2, 0x01, 0x00, 0, 0, 8])
"""115 200 baud, one stop bit, no parity, eight bits (clause USB-023)."""
MOST_TYPED = 80
SET_LINE_CODING, GET_LINE_CODING, SET_CONTROL_LINE_STATE = 0x20, 0x21, 0x22
PROMPT = b"> "


# Endpoints


def halt(bench: Bench, endpoint: int) -> None:
    """SET_FEATURE of ENDPOINT_HALT."""
    answer = bench.request(Setup(0x02, 3, 0, endpoint, 0))
    assert answer is not None, f"SET_FEATURE of ENDPOINT_HALT for endpoint {endpoint:02X} is answered with STALL"


def expect_halts(bench: Bench, *halted: int) -> None:
    """These endpoints are halted, and no others."""
    for endpoint in ENDPOINTS:
        answer = bench.request(Setup(0x82, 0, 0, endpoint, 2))
        expect(f"the status of endpoint {endpoint:02X}", answer, bytes([endpoint in halted, 0]))


def expect_stall(what: str, transfer: Callable[[], object]) -> None:
    """A transfer to or from an endpoint that is answered with STALL."""
    try:
        found = transfer()
    except DeviceStalledError:
        return
    raise AssertionError(f"{what} comes to {found!r}, should be answered with STALL")


def write(bench: Bench, data: bytes) -> None:
    """Send a transfer to 01 OUT, all of which must be taken."""
    bench.note("to 01 OUT", data, Traffic.BLOCK)
    expect("the count of bytes that were taken", bench.usb.write(BLOCKS_OUT, data, SOON), len(data))


def leave_records(bench: Bench, count: int) -> list[int]:
    """Send so many blocks and do not read their records; returns their numbers."""
    before = bench.status().accepted
    blocks = [bench.numbered(NoOp()) for _ in range(count)]
    write(bench, b"".join(map(pack, blocks)))
    end = bench.line.time.monotonic() + SOON
    while (seen := bench.status().accepted) != (before + count) % 2**32:
        assert bench.line.time.monotonic() < end, f"{seen - before} of {count} blocks were accepted in {SOON:g} s"
    return [block.sequence for block in blocks]


def let_watchdog_fire(bench: Bench) -> None:
    """Make an unsolicited status record wait."""
    enable(bench, 10)
    bench.outlast(0.02)


def read_records(bench: Bench, size: int = 32 * BLOCK_BYTES) -> list[Ack | Status]:
    """One transfer from 81 IN, which must end by itself."""
    began = bench.line.time.monotonic()
    data = bench.usb.read(RECORDS_IN, size, LONG_READ)
    assert data is not None, "no record comes on 81 IN"
    bench.note("from 81 IN", data, Traffic.RECORD)
    took = bench.line.time.monotonic() - began
    assert took < LONG_READ / 2, f"a transfer of {len(data)} bytes from 81 IN does not end: no short packet follows it"
    return records(data)


def read_numbers(bench: Bench, count: int) -> list[int]:
    """Read so many acknowledgements, in as many transfers as it takes: the first may begin before the others wait."""
    found: list[int] = []
    while len(found) < count:
        found += numbers(read_records(bench))
    return found


def numbers(found: list[Ack | Status]) -> list[int]:
    """The numbers of the blocks that records acknowledge."""
    return [record.sequence for record in found if isinstance(record, Ack)]


@case("USB-015", "BLK-008", line="usb")
def test_wrong_blocks_halt_no_endpoint(bench: Bench) -> None:
    """Blocks that are wrong in every way are refused and halt no endpoint, so that the next block is accepted."""
    good = pack(bench.numbered(NoOp()))
    (first,) = bench.send_raw(good)
    expect("the reason of a good block", first.reason, Reason.ACCEPTED)
    wrong = {
        Reason.LENGTH: good[:100],
        Reason.CHECKSUM: forged(good, checksum=0),
        Reason.MAGIC: forged(good, magic=0),
        Reason.VERSION: forged(good, version=255),
        Reason.KIND: forged(good, kind=200),
        Reason.FIELD: forged(good, reserved=1),
        Reason.PULSE: forged(good, kind=1, flags=0, payload=b"\xff\xff\xff"),
        Reason.DISABLED: forged(good, kind=1, flags=0),
        Reason.SEQUENCE: forged(good, flags=0),
    }
    for reason, block in wrong.items():
        (ack,) = bench.send_raw(block)
        expect("the reason", ack.reason, reason)
    expect_halts(bench)
    bench.must(NoOp())


@case("USB-015", "USB-014", line="usb")
@pytest.mark.parametrize("endpoint", ENDPOINTS, ids=lambda endpoint: f"{endpoint:02x}")
def test_a_host_halts_an_endpoint_and_ends_that(bench: Bench, endpoint: int) -> None:
    """SET_FEATURE halts the endpoint that it names, which answers STALL until CLEAR_FEATURE; GET_STATUS says so."""
    halt(bench, endpoint)
    try:
        expect_halts(bench, endpoint)
        if endpoint & 0x80:
            expect_stall(f"a read from {endpoint:02X}", lambda: bench.usb.read(endpoint, BLOCK_BYTES, SOON))
        else:
            expect_stall(f"a write to {endpoint:02X}", lambda: bench.usb.write(endpoint, bytes(BLOCK_BYTES), SOON))
        expect_halts(bench, endpoint)
    finally:
        bench.usb.clear_halt(endpoint)
    expect_halts(bench)
    bench.must(NoOp())


@case("USB-015", line="usb")
@pytest.mark.parametrize("endpoint", ENDPOINTS, ids=lambda endpoint: f"{endpoint:02x}")
def test_the_halt_of_one_endpoint_ends_alone(bench: Bench, endpoint: int) -> None:
    """CLEAR_FEATURE ends the halt of the endpoint that it names, and of no other."""
    for each in ENDPOINTS:
        halt(bench, each)
    try:
        bench.usb.clear_halt(endpoint)
        expect_halts(bench, *(each for each in ENDPOINTS if each != endpoint))
    finally:
        for each in ENDPOINTS:
            bench.usb.clear_halt(each)
    bench.must(NoOp())


@case("USB-015", line="usb")
def test_what_plays_goes_on_while_01_out_is_halted(bench: Bench) -> None:
    """A halt of 01 OUT only keeps blocks out: what plays, what is queued and the numbering go on."""
    enable(bench)
    first = bench.must(Update(bench.weak()))
    second = bench.must(Update(bench.weak(), soon(bench)))
    bench.wait_until(first.commit_period)
    halt(bench, BLOCKS_OUT)
    try:
        expect_stall("a write to 01", lambda: bench.usb.write(BLOCKS_OUT, bytes(BLOCK_BYTES), SOON))
        expect("the state while 01 OUT is halted", bench.status().state, State.PLAYING)
        bench.wait_until(second.commit_period + 1)
        status = bench.status()
        expect_all(status, ", with 01 OUT still halted", state=State.PLAYING, since_period=second.commit_period)
    finally:
        bench.usb.clear_halt(BLOCKS_OUT)
    expect_all(bench.status(), state=State.PLAYING, since_period=second.commit_period, refused=status.refused)
    expect("the reason for a number once more", bench.send(NoOp(), number=second.sequence).reason, Reason.SEQUENCE)
    expect("the flags of the next number", bench.must(NoOp(), number=(second.sequence + 1) % 2**32).flags, AckFlag(0))


@case("USB-015", line="usb")
def test_records_are_kept_while_81_in_is_halted(bench: Bench) -> None:
    """Records that wait when 81 IN is halted, and those that follow, are all there after the halt ends."""
    waiting = leave_records(bench, 3)
    halt(bench, RECORDS_IN)
    try:
        expect_stall("a read from 81", lambda: bench.usb.read(RECORDS_IN, BLOCK_BYTES, SOON))
        waiting += leave_records(bench, 2)
        expect_stall("a read from 81", lambda: bench.usb.read(RECORDS_IN, BLOCK_BYTES, SOON))
    finally:
        bench.usb.clear_halt(RECORDS_IN)
    expect("the numbers that are acknowledged", read_numbers(bench, len(waiting)), waiting)
    bench.must(NoOp())


@case("USB-015", line="usb")
@pytest.mark.parametrize("endpoint", [BLOCKS_OUT, RECORDS_IN], ids=["01", "81"])
@pytest.mark.parametrize("transfers", [1, 2], ids=["odd", "even"])
def test_clear_feature_begins_with_data0(bench: Bench, endpoint: int, transfers: int) -> None:
    """CLEAR_FEATURE of an endpoint that is not halted restarts at DATA0 too, so that no packet counts as a repeat."""
    for _ in range(transfers):
        bench.must(NoOp())
    waiting = leave_records(bench, 1)
    bench.usb.clear_halt(endpoint)
    waiting += leave_records(bench, 1)
    expect("the numbers that are acknowledged", read_numbers(bench, len(waiting)), waiting)
    for _ in range(3):
        bench.must(NoOp())


# Blocks from packets


@case("USB-017/1", "ACK-003", "ACK-002", line="usb")
@pytest.mark.parametrize(
    "size", [1, 4, 5, 7, 8, 31, 32, 63, 64, 65, 128, 448, PAYLOAD_BYTES, BLOCK_BYTES - 2, BLOCK_BYTES - 1]
)
def test_a_block_that_is_cut_short_is_refused(bench: Bench, size: int) -> None:
    """A block that ends before its 512th byte is refused with LENGTH, and the next packet begins the next block."""
    before = bench.status()
    whole = pack(bench.numbered(NoOp()))
    at_once = size % bench.usb.bulk_bytes != 0
    write(bench, whole[:size])
    if not at_once:
        write(bench, b"")  # else the next packet belongs to it
    (ack,) = read_records(bench)
    assert isinstance(ack, Ack), f"the answer is {ack}, should be an acknowledgement"
    expect_all(ack, reason=Reason.LENGTH, sequence=int.from_bytes(whole[4 : min(size, 8)], "little"), commit_period=0)
    (accepted,) = bench.send_raw(whole)
    expect("the reason of the whole block after it", accepted.reason, Reason.ACCEPTED)
    expect_all(
        bench.status(),
        refused=(before.refused + 1) % 2**32,
        accepted=(before.accepted + 1) % 2**32,
        last_refusal=Reason.LENGTH,
    )


@case("USB-017", "USB-017/1", line="usb")
def test_what_follows_the_last_byte_is_another_block(bench: Bench) -> None:
    """A transfer of a block and some more bytes is that block and a short one, because blocks end by size."""
    good = pack(bench.numbered(NoOp()))
    write(bench, good + b"more")
    found = read_records(bench)
    while len(found) < 2:
        found += read_records(bench)
    reasons = [record.reason for record in found if isinstance(record, Ack)]
    expect("the list of reasons", [reason.name for reason in reasons], ["ACCEPTED", "LENGTH"])
    bench.must(NoOp())


@case("USB-018", line="usb")
@pytest.mark.parametrize("count", [1, 2, 7])
def test_empty_packets_carry_nothing(bench: Bench, count: int) -> None:
    """Empty packets between blocks get no answer and are not counted: a host may end any transfer with one."""
    before = bench.status()
    for _ in range(count):
        write(bench, b"")
    expect("what comes after empty packets", bench.listen(QUIET), [])
    bench.must(NoOp())
    write(bench, b"")
    bench.must(NoOp())
    expect_all(bench.status(), refused=before.refused, accepted=(before.accepted + 2) % 2**32, lost=before.lost)


@case("USB-018", "ACK-001", line="usb")
@pytest.mark.parametrize("ended", [False, True], ids=["alone", "empty-packet-behind"])
def test_many_blocks_travel_in_one_transfer(bench: Bench, ended: bool) -> None:
    """A host may send any number of blocks in one transfer; each gets its answer, in order."""
    blocks = [bench.numbered(NoOp()) for _ in range(12)]
    write(bench, b"".join(map(pack, blocks)))
    if ended:
        write(bench, b"")
    expect("the numbers that are acknowledged", read_numbers(bench, 12), [block.sequence for block in blocks])
    expect("what comes after them", bench.listen(QUIET), [])


@case("USB-017", "USB-010", line="usb")
@pytest.mark.parametrize("end", ["empty-packet", "clear-feature", "set-interface", "set-configuration"])
def test_a_part_of_a_block_is_given_up(bench: Bench, end: str) -> None:
    """A block whose transfer was cancelled spoils no other: an empty packet ends it, the other ways drop it."""
    if bench.usb.bulk_bytes >= BLOCK_BYTES:
        raise Inconclusive("only at full speed can a part of a block arrive, and this bus runs at high speed")
    bench.must(NoOp())
    before = bench.status()
    write(bench, pack(bench.numbered(NoOp()))[: 3 * bench.usb.bulk_bytes])
    expect("what comes of a part", bench.listen(QUIET), [])
    match end:
        case "empty-packet":
            write(bench, b"")
            (ack,) = read_records(bench)
            assert isinstance(ack, Ack), f"the answer is {ack}, should be an acknowledgement"
            expect("the reason", ack.reason, Reason.LENGTH)
        case "clear-feature":
            bench.usb.clear_halt(BLOCKS_OUT)
        case "set-interface":
            bench.usb.set_interface(ARRAY)
        case _:
            bench.usb.set_configuration()
    refused = bench.status().refused
    expect("the count of refused blocks", refused, before.refused + (end == "empty-packet"))
    bench.must(NoOp())
    expect("the count of refused blocks afterwards", bench.status().refused, refused)


# Packets of records


@case("USB-019", "ACK-005", line="usb")
@pytest.mark.parametrize("count", [1, 2, 3, 8, 15, 16])
def test_the_last_packet_of_records_is_short(bench: Bench, count: int) -> None:
    """However many records wait, the last packet is not full; otherwise a host's transfer would never end."""
    waiting = leave_records(bench, count)
    expect("the numbers that are acknowledged", read_numbers(bench, len(waiting)), waiting)
    expect("what comes after them", bench.listen(QUIET), [])


@case("USB-019", "ACK-005", line="usb")
def test_packets_hold_whole_records(bench: Bench) -> None:
    """Each packet holds whole acknowledgements and status records, so that a host may read packet by packet."""
    size = bench.usb.bulk_bytes
    before = size // RECORD_BYTES - 1  # so that a status record does not fit into what is left of a packet
    waiting = leave_records(bench, before)
    let_watchdog_fire(bench)
    found: list[Ack | Status] = []
    end = bench.line.time.monotonic() + SOON
    while not any(isinstance(record, Status) for record in found):
        assert bench.line.time.monotonic() < end, "no status record comes once the watchdog has fired"
        packet = bench.usb.read(RECORDS_IN, size, SOON) or b""
        bench.note("a packet", packet, Traffic.RECORD)
        assert len(packet) % RECORD_BYTES == 0, f"a packet has {len(packet)} bytes, should hold whole records"
        found += records(packet)
    expect("the numbers that are acknowledged", numbers(found), waiting)
    assert isinstance(found[-1], Status), "the status record should follow the acknowledgements that wait"
    expect("the state that it says", found[-1].state, State.OFF)
    bench.listen(QUIET)


@case("ACK-005", should=True, line="usb")
def test_a_packet_holds_as_many_records_as_fit(bench: Bench) -> None:
    """A device puts as many waiting records into a packet as fit, because each packet takes time."""
    fit = bench.usb.bulk_bytes // RECORD_BYTES
    waiting = leave_records(bench, min(fit, 14) + 2)
    packets = [records(bench.usb.read(RECORDS_IN, bench.usb.bulk_bytes, SOON) or b"") for _ in range(2)]
    bench.listen(QUIET)
    ready = len(packets[0])  # before the others waited
    expect("the numbers in the second packet", numbers(packets[1]), waiting[ready : ready + fit])


# Sessions


def unconfigure(bench: Bench) -> None:
    """SET_CONFIGURATION to 0."""
    answer = bench.request(Setup(0x00, 9, 0, 0, 0))
    assert answer is not None, "SET_CONFIGURATION to 0 is answered with STALL"


def configure_twice(bench: Bench) -> None:
    """SET_CONFIGURATION to 0, and then to 1."""
    unconfigure(bench)
    bench.usb.set_configuration()


def reset_bus(bench: Bench) -> None:
    """A bus reset, and configuration after it."""
    bench.usb.reset()


Restart = Callable[[Bench], None]
"""A way to begin a new session (clause USB-026)."""
WAYS: dict[str, Restart] = {
    "set-configuration-1": lambda bench: bench.usb.set_configuration(),
    "set-configuration-0": configure_twice,
    "set-interface": lambda bench: bench.usb.set_interface(ARRAY),
}
each_way = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
CLAUSES = ("USB-003", "USB-016", "USB-026", "STA-003")


def play_and_queue(bench: Bench) -> tuple[Ack, Ack]:
    """Something plays, and something is queued for later; then a session begins."""
    enable(bench)
    first = bench.must(Update(bench.weak()))
    second = bench.must(Update(bench.weak(), first.now_period + 16_000 * bench.slowness))
    bench.wait_until(first.commit_period)
    expect("the state before", bench.status().state, State.PLAYING)
    return first, second


def check_plays_on(status: Status, first: Ack, second: Ack) -> None:
    """Fail if a status shows anything but the first of two changes; inconclusive if the second was due."""
    expect("the state", status.state, State.PLAYING)
    if status.period >= second.commit_period:
        raise TooSlow("the line was too slow: what was queued for later plays")
    expect("what plays since", status.since_period, first.commit_period)


def check_outputs_are_turned_off(bench: Bench, way: Restart) -> None:
    """Nothing plays or waits afterwards, changes are refused, and no count begins again."""
    _, queued = play_and_queue(bench)
    before = bench.status()
    way(bench)
    after = bench.status()
    expect_all(after, state=State.OFF, since_period=0, free=bench.info.queue_blocks)
    for name in ("accepted", "refused", "late", "lost", "missed_commits", "damaged_messages", "faults"):
        expect(f"the status' {name}", getattr(after, name), getattr(before, name))
    assert after.now > before.now, f"the time is {after.now}, should go on from {before.now}"
    expect("the reason for an update", bench.send(Update(bench.weak()), restart=True).reason, Reason.DISABLED)
    bench.wait_until(queued.commit_period + 2)
    expect("the state, after the period of what was queued", bench.status().state, State.OFF)
    bench.enable()
    bench.wait_periods(4)
    expect("the state, enabled again", bench.status().state, State.READY)


@case(*CLAUSES, line="usb")
@each_way
def test_a_new_session_turns_the_outputs_off(bench: Bench, way: Restart) -> None:
    """SET_CONFIGURATION and SET_INTERFACE turn the outputs off and empty the queue, because the host may be another."""
    check_outputs_are_turned_off(bench, way)


@case(*CLAUSES, allow=(Risk.RESET,), line="usb")
def test_a_bus_reset_turns_the_outputs_off(bench: Bench) -> None:
    """A bus reset turns the outputs off and empties the queue, because the host may be another."""
    check_outputs_are_turned_off(bench, reset_bus)


def check_outputs_are_silent(bench: Bench, way: Restart) -> None:
    """All outputs are low from six periods after it on."""
    play_and_queue(bench)
    way(bench)
    first = bench.period() + SILENT_PERIODS + 1
    bench.judge(first, first + 100, check_silent)


@case("USB-003", "USB-016", "STA-001", needs=(Need.CAPTURE,), line="usb")
@each_way
def test_a_new_session_silences_the_outputs(bench: Bench, way: Restart) -> None:
    """All outputs are low within six periods of a new session, whatever was queued."""
    check_outputs_are_silent(bench, way)


@case("USB-003", "STA-001", needs=(Need.CAPTURE,), line="usb")
def test_the_outputs_are_low_without_a_configuration(bench: Bench) -> None:
    """SET_CONFIGURATION to 0 is enough to turn the outputs off, and they stay low until another configuration."""
    play_and_queue(bench)
    unconfigure(bench)
    began = bench.line.time.monotonic()
    bench.wait(0.05)
    passed = bench.line.time.monotonic() - began
    bench.usb.set_configuration()
    last = bench.period()
    bench.judge(last - int(0.99 * passed * CARRIER_HZ) + SILENT_PERIODS + 1, last, check_silent)


@case("USB-003", "STA-001", needs=(Need.CAPTURE,), allow=(Risk.RESET,), line="usb")
def test_a_bus_reset_silences_the_outputs(bench: Bench) -> None:
    """All outputs are low after a bus reset, whatever was queued."""
    check_outputs_are_silent(bench, reset_bus)


def check_unattended_ends(bench: Bench, way: Restart) -> None:
    """An unattended sequence ends."""
    store_entry(bench, 40, pulses=bench.weak(0.5))
    enable(bench)
    ack = bench.must(PlaySequence(0, 1, unattended=True))
    bench.wait_until(ack.commit_period)
    expect("the state before", bench.status().state, State.UNATTENDED)
    way(bench)
    expect_all(bench.status(), state=State.OFF, flags=StatusFlag(0), since_period=0)


@case("USB-003", "USB-016", "SAF-005", features=Feature.UNATTENDED, line="usb")
@each_way
def test_a_new_session_ends_what_plays_unattended(bench: Bench, way: Restart) -> None:
    """An unattended sequence ends when a host begins a session, because that host does not know of it."""
    check_unattended_ends(bench, way)


@case("USB-003", "SAF-005", features=Feature.UNATTENDED, allow=(Risk.RESET,), line="usb")
def test_a_bus_reset_ends_what_plays_unattended(bench: Bench) -> None:
    """An unattended sequence ends with a bus reset, because a host arrives then."""
    check_unattended_ends(bench, reset_bus)


def check_records_are_dropped(bench: Bench, way: Restart) -> None:
    """Nothing that waited on 81 IN comes, nor a status record of the new session."""
    leave_records(bench, 5)
    let_watchdog_fire(bench)
    way(bench)
    expect("what comes unasked", bench.listen(QUIET), [])
    expect("the state", bench.must(NoOp()).state, State.OFF)


@case("USB-003", "USB-016", "USB-026", line="usb")
@each_way
def test_a_new_session_drops_the_records_that_wait(bench: Bench, way: Restart) -> None:
    """Records that were not fetched are dropped when a session begins; otherwise the host takes them for its own."""
    check_records_are_dropped(bench, way)


@case("USB-003", "USB-026", allow=(Risk.RESET,), line="usb")
def test_a_bus_reset_drops_the_records_that_wait(bench: Bench) -> None:
    """Records that were not fetched before a bus reset are dropped; otherwise the host takes them for its own."""
    check_records_are_dropped(bench, reset_bus)


def check_numbering_begins_anew(bench: Bench, way: Restart) -> None:
    """An old number is accepted, without a gap, and the next numbers are judged by it."""
    start = bench.must(NoOp()).sequence
    expect("the reason for an old number", bench.send(NoOp(), number=(start - 1000) % 2**32).reason, Reason.SEQUENCE)
    before = bench.status()
    way(bench)
    first = (start - 1000) % 2**32
    expect("its flags", bench.must(NoOp(), number=first).flags, AckFlag(0))
    expect("the count of lost blocks", bench.status().lost, before.lost)
    expect("the reason for its number again", bench.send(NoOp(), number=first).reason, Reason.SEQUENCE)
    expect("the flags after two missing numbers", bench.must(NoOp(), number=(first + 3) % 2**32).flags, AckFlag.GAP)
    expect("the count of lost blocks", bench.status().lost, (before.lost + 2) % 2**32)


@case("NUM-004", "USB-026", line="usb")
@each_way
def test_a_new_session_accepts_any_number(bench: Bench, way: Restart) -> None:
    """The first block of a session is accepted with any number, and the numbering begins with it."""
    check_numbering_begins_anew(bench, way)


@case("NUM-004", "USB-026", allow=(Risk.RESET,), line="usb")
def test_a_bus_reset_accepts_any_number(bench: Bench) -> None:
    """The first block after a bus reset is accepted with any number, and the numbering begins with it."""
    check_numbering_begins_anew(bench, reset_bus)


def check_what_stays(bench: Bench, way: Restart) -> None:
    """What is stored can be played, and the watchdog time and the drive limit are unchanged."""
    limit = bench.drive_limit - 1
    bench.order(Request.WATCHDOG, 12_345)
    bench.order(Request.LIMIT, limit)
    features = bench.info.features
    if Feature.SEQUENCES in features:
        store_entry(bench, 40, pulses=bench.weak(0.5))
    if Feature.MODULATION in features:
        bench.must(Samples(bytes([255, 128]), 4000))
    way(bench)
    expect_all(bench.status(), watchdog_ms=12_345, drive_limit=limit)
    bench.enable()
    for body in known(bench, PlaySequence(0, 1), AmplitudeModulation(4000, 2, 1)):
        bench.must(body)


@case("USB-026", "BLK-013", line="usb")
@each_way
def test_what_is_stored_stays_over_a_new_session(bench: Bench, way: Restart) -> None:
    """Slots, entries, samples, watchdog time and drive limit survive, for a host that opens the device again."""
    check_what_stays(bench, way)


@case("USB-026", "BLK-013", allow=(Risk.RESET,), line="usb")
def test_what_is_stored_stays_over_a_bus_reset(bench: Bench) -> None:
    """Slots, entries, samples, watchdog time and drive limit survive a bus reset, which is no restart."""
    check_what_stays(bench, reset_bus)


@case("USB-015", "USB-026", line="usb")
def test_clear_feature_of_01_out_begins_no_session(bench: Bench) -> None:
    """CLEAR_FEATURE of 01 OUT does not change the outputs, the queue, the records or the numbering."""
    first, second = play_and_queue(bench)
    waiting = leave_records(bench, 2)
    bench.usb.clear_halt(BLOCKS_OUT)
    status = bench.status()
    check_plays_on(status, first, second)
    expect("the numbers that are acknowledged", read_numbers(bench, len(waiting)), waiting)
    expect("the reason for an old number", bench.send(NoOp(), number=second.sequence).reason, Reason.SEQUENCE)
    bench.wait_until(second.commit_period + 1)
    expect("what plays since, after the next period", bench.status().since_period, second.commit_period)


@case("USB-016", line="usb")
def test_set_interface_ends_the_halts_of_its_endpoints(bench: Bench) -> None:
    """SET_INTERFACE ends the halts of the interface's own endpoints, and of no others."""
    for endpoint in ENDPOINTS:
        halt(bench, endpoint)
    try:
        bench.usb.set_interface(ARRAY)
        expect_halts(bench, NOTIFICATIONS_IN, CONSOLE_OUT, CONSOLE_IN)
        bench.usb.set_interface(CONSOLE)
        expect_halts(bench, CONSOLE_OUT, CONSOLE_IN)
        bench.usb.set_interface(CONSOLE_DATA)
        expect_halts(bench)
    finally:
        bench.usb.set_configuration()
    bench.must(NoOp())


@case("USB-016", "USB-015", line="usb")
def test_set_configuration_ends_all_halts(bench: Bench) -> None:
    """SET_CONFIGURATION ends the halt of every endpoint, because hosts begin with it."""
    for endpoint in ENDPOINTS:
        halt(bench, endpoint)
    bench.usb.set_configuration()
    expect_halts(bench)
    bench.must(NoOp())


@case("USB-016", "USB-025", line="usb")
@pytest.mark.parametrize("interface", [CONSOLE, CONSOLE_DATA, FIRMWARE])
def test_set_interface_of_others_leaves_the_array_alone(bench: Bench, interface: int) -> None:
    """SET_INTERFACE of any interface except 0 is no new session: what plays goes on, and so does the numbering."""
    first, second = play_and_queue(bench)
    waiting = leave_records(bench, 2)
    bench.usb.set_interface(interface)
    status = bench.status()
    check_plays_on(status, first, second)
    expect("the numbers that are acknowledged", read_numbers(bench, len(waiting)), waiting)
    expect("the reason for an old number", bench.send(NoOp(), number=second.sequence).reason, Reason.SEQUENCE)


@case("USB-003", "SER-016", features=Feature.CONSOLE, line="usb")
@each_way
def test_a_new_session_turns_off_what_another_door_enabled(bench: Bench, way: Restart) -> None:
    """Outputs that were enabled through the console are turned off too, because the device has one state."""
    bench.serial.wire.hang_up()
    bench.serial.enter_frames()
    bench.order(Request.WATCHDOG, LONG_MS)
    answer = bench.serial.request(Setup(0x41, Request.ENABLE, 0, 0, 0))
    assert answer is not None, "ENABLE by the console is answered with STALL"
    expect("the state before", bench.status().state, State.READY)
    way(bench)
    expect("the state", bench.status().state, State.OFF)


# The console's interfaces


def line_coding(bench: Bench, length: int = 7) -> bytes | None:
    """GET_LINE_CODING."""
    return bench.request(Setup(0xA1, GET_LINE_CODING, 0, CONSOLE, length))


def set_line_coding(bench: Bench, coding: bytes) -> bytes | None:
    """SET_LINE_CODING."""
    return bench.request(Setup(0x21, SET_LINE_CODING, 0, CONSOLE, len(coding)), coding)


def set_dtr(bench: Bench, value: int) -> None:
    """SET_CONTROL_LINE_STATE: bit 0 is DTR."""
    answer = bench.request(Setup(0x21, SET_CONTROL_LINE_STATE, value, CONSOLE, 0))
    assert answer is not None, f"SET_CONTROL_LINE_STATE to {value} is answered with STALL"


def type_in(bench: Bench, text: bytes) -> int:
    """Send text to the console; returns the number of bytes taken."""
    bench.note("to 03 OUT", text, Traffic.TEXT)
    return bench.usb.write(CONSOLE_OUT, text, SOON)


def text_until(bench: Bench, end: bytes, seconds: float = SOON) -> bytes:
    """The console's output up to some text, or until the time is over."""
    over, found = bench.line.time.monotonic() + seconds, b""
    while not found.endswith(end) and (left := over - bench.line.time.monotonic()) > 0:
        found += bench.usb.read(CONSOLE_IN, 64 * BLOCK_BYTES, left) or b""
    bench.note("from 83 IN", found, Traffic.TEXT)
    return found


def check_answers(bench: Bench) -> None:
    """Fail unless the console carries out commands, without echo from now on."""
    type_in(bench, b"echo 0\r")
    text_until(bench, PROMPT)
    type_in(bench, b"faults\r")
    expect("what the console says", text_until(bench, PROMPT), b"faults: none\r\nok\r\n> ")


@case("USB-023", "USB-026", line="usb")
def test_the_line_coding_is_as_at_first_after_configuration(bench: Bench) -> None:
    """A device that was just configured reports 115 200 baud, 8N1, whatever its last host set."""
    set_line_coding(bench, bytes([0x80, 0x25, 0, 0, 2, 1, 7]))
    bench.usb.set_configuration()
    expect("the line coding", line_coding(bench), LINE_CODING_AT_FIRST)


@case("USB-023", "SER-001", line="usb")
@pytest.mark.parametrize(
    "digits",
    ["00c20100000008", "2c010000020405", "001bb700010310", "01000000000106", "ffffffffffffff", "00000000000000"],
)
def test_every_line_coding_is_accepted_and_read_back(bench: Bench, digits: str) -> None:
    """The console accepts and returns every line coding and works as before, because it has no real serial line."""
    coding = bytes.fromhex(digits)
    assert set_line_coding(bench, coding) is not None, f"SET_LINE_CODING to {coding.hex(' ')} is answered with STALL"
    expect("the line coding", line_coding(bench), coding)
    expect("the first four bytes of it", line_coding(bench, 4), coding[:4])
    expect("the line coding, with room for more", line_coding(bench, 64), coding)
    if Feature.CONSOLE in bench.info.features:
        set_dtr(bench, 0)
        set_dtr(bench, 1)
        check_answers(bench)
    bench.usb.set_interface(ARRAY)
    expect("the line coding after SET_INTERFACE of interface 0", line_coding(bench), coding)


@case("USB-023", "USB-004", line="usb")
@pytest.mark.parametrize(
    ("setup", "data"),
    [
        (Setup(0x21, SET_LINE_CODING, 0, CONSOLE, 6), bytes(6)),
        (Setup(0x21, SET_LINE_CODING, 0, CONSOLE, 8), bytes(8)),
        (Setup(0x21, 0x00, 0, CONSOLE, 1), b"A"),
        (Setup(0xA1, 0x01, 0, CONSOLE, 8), b""),
        (Setup(0x21, 0x02, 1, CONSOLE, 2), bytes(2)),
        (Setup(0xA1, 0x03, 1, CONSOLE, 2), b""),
        (Setup(0x21, 0x23, 100, CONSOLE, 0), b""),
        (Setup(0xA1, 0x20, 0, CONSOLE, 7), b""),
        (Setup(0xA1, 0x22, 0, CONSOLE, 7), b""),
        (Setup(0x21, 0x21, 0, CONSOLE, 0), b""),
        (Setup(0xA1, GET_LINE_CODING, 0, ARRAY, 7), b""),
        (Setup(0xA1, GET_LINE_CODING, 0, CONSOLE_DATA, 7), b""),
        (Setup(0xA1, GET_LINE_CODING, 0, FIRMWARE, 7), b""),
        (Setup(0xC1, GET_LINE_CODING, 0, CONSOLE, 7), b""),
    ],
    ids=lambda value: value.encode().hex() if isinstance(value, Setup) else "",
)
def test_other_class_requests_to_the_console_stall(bench: Bench, setup: Setup, data: bytes) -> None:
    """Class requests that USB-023 does not name, or of another size, are answered with STALL and change nothing."""
    coding = bytes([0x80, 0x25, 0, 0, 2, 1, 7])
    set_line_coding(bench, coding)
    answer = bench.request(setup, data)
    assert answer is None, f"{setup} is answered with {answer!r}, should be with STALL"
    expect("the line coding", line_coding(bench), coding)


@case("USB-023", "CON-002", features=Feature.CONSOLE, line="usb", since=3)
def test_a_console_is_silent_before_dtr(bench: Bench) -> None:
    """Without DTR the console sends nothing, not even an answer: text would mix with another host's frames."""
    bench.usb.set_configuration()
    for value in (0, 2):
        set_dtr(bench, value)
        type_in(bench, b"version\r")
        expect("what the console says without DTR", text_until(bench, PROMPT, QUIET), b"")
    set_dtr(bench, 0)
    set_dtr(bench, 1)
    expect("what the console says once DTR is set", text_until(bench, PROMPT, QUIET), b"")
    type_in(bench, b"\r")
    assert text_until(bench, PROMPT).endswith(PROMPT), "the console shows no prompt once DTR is set"


DISTURBANCES: dict[str, Callable[[Bench], object]] = {
    "line-coding": lambda bench: set_line_coding(bench, bytes([0x80, 0x25, 0, 0, 2, 1, 7])),
    "rts-high": lambda bench: set_dtr(bench, 3),
    "rts-low": lambda bench: set_dtr(bench, 1),
    "dtr-again": lambda bench: set_dtr(bench, 1),
}
"""What programs do when they open a port; none of it ends a session."""


@pytest.mark.parametrize("what", DISTURBANCES)
@case("USB-023", "SER-010", features=Feature.CONSOLE, line="usb", since=3)
def test_nothing_but_dtr_low_ends_a_line_of_text(bench: Bench, what: str) -> None:
    """A line of text goes on over a new line coding, RTS high or low, and DTR that is set again."""
    set_dtr(bench, 0)
    set_dtr(bench, 3 if what == "rts-low" else 1)
    type_in(bench, b"ver")
    DISTURBANCES[what](bench)
    type_in(bench, b"sion\r")
    said = text_until(bench, PROMPT)
    set_dtr(bench, 0)
    assert said.endswith(b"ok\r\n" + PROMPT), f"the console answers {said!r}, should end with ok and the prompt"


@case("USB-019", "USB-023", features=Feature.CONSOLE, line="usb", since=3)
def test_text_that_fills_its_packets_ends_with_an_empty_one(bench: Bench) -> None:
    """Typed text that comes back as a whole packet has an empty one after it: otherwise a host waits for more."""
    set_dtr(bench, 0)
    set_dtr(bench, 1)
    size = bench.usb.bulk_bytes
    type_in(bench, b"x" * size)  # more than a line has: each further one comes back as a bell
    bench.wait(QUIET)
    came = bench.usb.read(CONSOLE_IN, size, SOON)
    after = bench.usb.read(CONSOLE_IN, size, SOON)
    set_dtr(bench, 0)
    if came is not None and len(came) < size:
        raise Inconclusive(f"the device sends {len(came)} of {size} bytes in its first packet")
    expect("what comes back", came, (b"x" * MOST_TYPED + b"\a" * size)[:size])
    assert after is not None, "no empty packet follows a full one on 83 IN"
    expect("the packet that follows", after, b"")


@case("USB-026", "SER-010", features=Feature.CONSOLE, line="usb")
def test_the_console_stays_as_it_is_over_set_interface(bench: Bench) -> None:
    """SET_INTERFACE of interface 0 leaves the console's line in frames, because it is another function."""
    bench.serial.wire.hang_up()
    bench.serial.enter_frames()
    bench.usb.set_interface(ARRAY)
    answer = bench.serial.request(Setup(0xC1, Request.INFO, 0, 0, 64))
    expect("INFO in a frame", None if answer is None else len(answer), 64)


@case("USB-026", "SER-010", features=Feature.CONSOLE, line="usb")
def test_the_console_is_a_console_again_after_configuration(bench: Bench) -> None:
    """SET_CONFIGURATION returns the line from frames to text, with DTR low, because its host may be another."""
    bench.serial.wire.hang_up()
    bench.serial.enter_frames()
    bench.usb.set_configuration()
    type_in(bench, b"\r")
    expect("what the console says without DTR", text_until(bench, PROMPT, QUIET), b"")
    set_dtr(bench, 1)
    check_answers(bench)


# One interface and another


@case("USB-025", "CON-004", "SAF-003", "ACK-006", features=Feature.CONSOLE, line="usb")
def test_a_console_that_is_not_read_holds_up_nothing(bench: Bench) -> None:
    """Commands, blocks, records, requests and the watchdog go on while nobody reads the console, whose text is full."""
    set_dtr(bench, 0)
    set_dtr(bench, 1)
    for command, state in ((b"watchdog 60000\renable\r", State.READY), (b"stop\r", State.OFF)):
        type_in(bench, command)
        bench.outlast(COMMAND_SECONDS)
        expect(f"the state after {command!r}, with no answer read", bench.status().state, state)
    try:
        for _ in range(20):
            if bench.usb.write(CONSOLE_OUT, b"help\r" * 40, 0.01) < 200:
                break
        for _ in range(5):
            bench.must(NoOp())
        enable(bench)
        ack = bench.must(Update(bench.weak()))
        expect("the flags of an update", ack.flags, AckFlag(0))
        bench.wait_until(ack.commit_period)
        expect("the state", bench.status().state, State.PLAYING)
        bench.listen()
        bench.unasked.clear()
        sign = bench.status().now
        bench.order(Request.WATCHDOG, ms := patience(bench))
        alive = bench.status().now
        check_not_yet(bench, sign + ms * TICKS_PER_MS, alive)
        await_firing(bench, alive, alive, ms)
        bench.enable()
    finally:
        set_dtr(bench, 0)  # drops the text, which would hold up the console for the next case
    expect("the state once DTR is low", bench.status().state, State.READY)


@case("USB-025", line="usb")
def test_halts_of_the_console_hold_up_nothing(bench: Bench) -> None:
    """Blocks and records go on while all endpoints of the console are halted."""
    for endpoint in (NOTIFICATIONS_IN, CONSOLE_OUT, CONSOLE_IN):
        halt(bench, endpoint)
    try:
        for _ in range(3):
            bench.must(NoOp())
        enable(bench)
        ack = bench.must(Update(bench.weak()))
        bench.wait_until(ack.commit_period)
        expect("the state", bench.status().state, State.PLAYING)
    finally:
        for endpoint in (NOTIFICATIONS_IN, CONSOLE_OUT, CONSOLE_IN):
            bench.usb.clear_halt(endpoint)


@case("USB-025", features=Feature.CONSOLE, line="usb")
def test_halts_of_the_array_leave_the_console_alone(bench: Bench) -> None:
    """The console answers while 01 OUT and 81 IN are halted, so that a person can see the cause."""
    set_dtr(bench, 0)
    set_dtr(bench, 1)
    for endpoint in (BLOCKS_OUT, RECORDS_IN):
        halt(bench, endpoint)
    try:
        check_answers(bench)
    finally:
        for endpoint in (BLOCKS_OUT, RECORDS_IN):
            bench.usb.clear_halt(endpoint)
    bench.must(NoOp())


# DFU at run time


@case("USB-024", "DFU-003", line="usb")
def test_the_dfu_interface_is_idle(bench: Bench) -> None:
    """At run time GETSTATUS answers OK and appIDLE and GETSTATE appIDLE, so that tools know that DETACH comes first."""
    expect("GETSTATUS", bench.request(Setup(0xA1, 3, 0, FIRMWARE, 6)), bytes(6))
    expect("GETSTATE", bench.request(Setup(0xA1, 5, 0, FIRMWARE, 1)), bytes(1))


@case("USB-024", "DFU-006", "USB-004", line="usb")
@pytest.mark.parametrize(
    "setup",
    [Setup(0xA1, 2, 0, FIRMWARE, 64), *(Setup(0x21, request, 0, FIRMWARE, 0) for request in (4, 6, 7, 3))],
    ids=["upload", "clrstatus", "abort", "request-7", "getstatus-out"],
)
def test_other_dfu_requests_stall_at_run_time(bench: Bench, setup: Setup) -> None:
    """At run time all other requests of DFU are answered with STALL, have no effect and lead to appIDLE."""
    enable(bench)
    answer = bench.request(setup)
    assert answer is None, f"{setup} is answered with {answer!r}, should be with STALL"
    expect("GETSTATUS", bench.request(Setup(0xA1, 3, 0, FIRMWARE, 6)), bytes(6))
    expect("the state", bench.status().state, State.READY)
    bench.must(NoOp())


@case("USB-024", "DFU-002", outputs=("SAF-004/1",), features=Feature.DFU, allow=(Risk.RESET,), line="usb")
def test_detach_silences_the_outputs_first(bench: Bench) -> None:
    """On DETACH the outputs are off before the device leaves the bus, because DFU mode cannot drive them."""
    play_and_queue(bench)
    dfu = RawDfuLine(bench)
    assert dfu.detach(), "DETACH is answered with STALL while the device plays"
    try:
        status = bench.status()
        expect("the state", status.state, State.DFU)
        first = status.period + SILENT_PERIODS + 1
        bench.wait(100 / CARRIER_HZ)  # nobody asks for its clock, for it may have left before this computer does
        bench.judge(first, first + 40, check_silent, over=True)
    except DeviceError as error:
        raise Inconclusive(f"the device had left before this computer could ask all: {error}") from error
    finally:
        bench.usb.wait_for(DFU_MODE, bench.return_seconds)
        dfu.leave()
