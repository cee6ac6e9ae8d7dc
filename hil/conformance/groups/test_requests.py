"""Control requests: their answers, refusals and effects (chapter REQ)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from itertools import pairwise

import pytest
from phasewire.emulator.faults import FlippedBit, HotBoard, InjectedFault, WrongSupply
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, TooSlow, case, expect, not_allowed, unmet
from phasewire.hil.conformance.tools.clocks import compare_clocks
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    SILENT,
    Wrong,
    await_state,
    begin,
    check_same,
    enable,
    expect_all,
    far,
    forge,
    heavy,
    later,
    let_stores_go,
    packed,
    refuse,
    require,
    some,
    vectors,
)
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
from phasewire.protocol.board import CHANNELS, PROCESSORS, TICK_HZ, TICKS_PER_PERIOD, WATCHDOG_MS
from phasewire.protocol.codes import (
    ENTRIES_PER_BLOCK,
    PAYLOAD_BYTES,
    SERIAL_DATA_BYTES,
    SYNC_PERIODS,
    Action,
    Fault,
    Feature,
    Hardware,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.requests import Setup

ALWAYS = 1_000_000
"""Reports that are damaged: more than a case lasts."""

IN, OUT = 0xC1, 0x41
SIZES = {1: 64, 2: 64, 3: 2 * CHANNELS, 9: 24, 10: 16 + PAYLOAD_BYTES, 11: 16 * PROCESSORS}
"""Bytes of the answer to each request that has one (REQ-002 to REQ-008), by its number."""
ORDERS = (4, 5, 6, 7, 8, 12)
"""Requests without an answer, except RESET and REVERT."""
RESTARTS = (13, 14)
GOOD_VALUES = {6: 50, 7: 1, 12: 0}
"""A valid value for the requests that do not take 0: WATCHDOG, LIMIT, IDENTIFY."""
OTHERS = (1, 3, 256, 65_535)
"""Values and indices that are wrong for requests that take only 0."""
DATA = (b"\0", b"\1\2\3\4", bytes(64))
"""Values that no request takes."""
ENTRIES_FEATURES = Feature.SEQUENCES | Feature.MODULATION
COUNTERS = ("accepted", "refused", "late", "lost")
LOADS, MANY = 10, 260
"""Loads of a full block of entries for a processor (BUD-007), and more than a byte counts."""


def ask(bench: Bench, request: int, length: int, value: int = 0, index: int = 0) -> bytes | None:
    """Make a request with an answer of at most so many bytes; None for STALL."""
    return bench.request(Setup(IN, request, value, index, length))


def is_there(bench: Bench, request: int) -> bool:
    """Whether the device has the feature that a request needs."""
    return request != Request.PULSES or Feature.READ_BACK in bench.info.features


def refuse_requests(bench: Bench, setups: list[tuple[Setup, bytes]]) -> None:
    """Make requests that must be answered with STALL, and check that they have no effect."""
    before = bench.status()
    for setup, data in setups:
        answer = bench.request(setup, data)
        assert answer is None, f"request {setup.encode().hex(' ')} is answered, should be STALL"
    after = bench.status()
    check_same(before, after)
    expect_all(after, refused=before.refused, last_refusal=before.last_refusal)


# Arguments


@case("REQ-001")
@pytest.mark.parametrize("request_number", list(SIZES), ids=lambda number: Request(number).name.lower())
def test_an_answer_is_as_long_as_was_asked_for(bench: Bench, request_number: int) -> None:
    """Of an answer the device sends as many bytes as requested, from its beginning, and never more than there are."""
    if not is_there(bench, request_number):
        expect("PULSES without READ_BACK", ask(bench, request_number, SIZES[10]), None)
        return
    size = SIZES[request_number]
    most = SERIAL_DATA_BYTES if bench.line.kind == "serial" else 4096
    for length in sorted({0, 1, 2, 15, 16, size // 2, size - 1, size, min(size + 1, most), most}):
        answer = ask(bench, request_number, length)
        assert answer is not None, f"a length of {length} is answered with STALL"
        expect(f"bytes of an answer if {length} are requested", len(answer), min(length, size))
        if request_number in (Request.INFO, Request.WIRING):
            expect("the bytes", answer, bench.ask(Request(request_number))[:length])


@case("REQ-001", "USB-004", "VER-004")
def test_unknown_requests_are_answered_with_stall(bench: Bench) -> None:
    """Numbers that no request has, and requests in the wrong direction, are answered with STALL and have no effect."""
    numbers = some(bench, [0, *range(15, 256)], blocks=2)
    if bench.info.newest_version > 1:
        numbers = [0]  # later versions may have more (clause VER-004)
    unknown = [(Setup(IN, number, 0, 0, 64), b"") for number in numbers]
    unknown += [(Setup(OUT, number, 0, 0, 0), b"") for number in numbers]
    unknown += [(Setup(OUT, number, 0, 0, 0), b"") for number in SIZES]
    unknown += [(Setup(IN, number, GOOD_VALUES.get(number, 0), 0, 64), b"") for number in ORDERS]
    refuse_requests(bench, unknown)


@case("REQ-001", "USB-004")
def test_requests_of_another_type_are_answered_with_stall(bench: Bench) -> None:
    """Requests of the array's numbers to the device, an endpoint or another recipient are answered with STALL."""
    wrong = []
    for number in (1, 2, 4, 5, 7):
        wrong += [(Setup(request_type, number, 0, 0, 64), b"") for request_type in (0xC0, 0xC2, 0xC3)]
        wrong += [(Setup(request_type, number, 0, 0, 0), b"") for request_type in (0x40, 0x42, 0x43)]
    refuse_requests(bench, wrong)


@case("REQ-001", "USB-004")
def test_another_value_or_index_is_answered_with_stall(bench: Bench) -> None:
    """A request with a value or index other than the table's is answered with STALL, without effect."""
    wrong = []
    for number in (*SIZES, *ORDERS):
        kind, length = (IN, SIZES[number]) if number in SIZES else (OUT, 0)
        values = () if number in GOOD_VALUES else OTHERS
        wrong += [(Setup(kind, number, value, 0, length), b"") for value in values]
        value = GOOD_VALUES.get(number, 0)
        wrong += [(Setup(kind, number, value, index, length), b"") for index in OTHERS]
    refuse_requests(bench, some(bench, wrong, 20))


@case("REQ-001", "REQ-005", "REQ-009", "REQ-010")
def test_an_order_with_data_is_answered_with_stall(bench: Bench) -> None:
    """A request that takes no data is answered with STALL if it is sent with some, and has no effect."""
    wrong = [(Setup(OUT, number, GOOD_VALUES.get(number, 0), 0, len(data)), data) for number in ORDERS for data in DATA]
    refuse_requests(bench, wrong)
    begin(bench)
    refuse_requests(bench, [(Setup(OUT, number, 0, 0, 1), b"\0") for number in (4, 5, 8)])
    expect("the state", bench.status().state, State.READY)


def refuse_restart(bench: Bench, request: Request) -> None:
    """Check that a malformed request for a restart is answered with STALL and restarts nothing."""
    before = bench.clock().now
    wrong = [(Setup(IN, request, 0, 0, 64), b"")]
    wrong += [(Setup(OUT, request, value, 0, 0), b"") for value in OTHERS]
    wrong += [(Setup(OUT, request, 0, index, 0), b"") for index in OTHERS]
    wrong += [(Setup(OUT, request, 0, 0, len(data)), data) for data in DATA]
    refuse_requests(bench, wrong)
    now = bench.clock().now
    assert now > before, f"the clock goes from tick {before} to {now}, should go on"


@case("REQ-001", "REQ-013", "USB-004", allow=(Risk.RESET,))
def test_a_wrong_reset_is_answered_with_stall(bench: Bench) -> None:
    """RESET in the other direction, with another value or index, or with data, is answered with STALL."""
    refuse_restart(bench, Request.RESET)


@case("REQ-001", "REQ-014", "USB-004", allow=(Risk.RESET, Risk.FLASH))
def test_a_wrong_revert_is_answered_with_stall(bench: Bench) -> None:
    """REVERT, which changes the flash, is answered with STALL if anything in it is wrong, and has no effect."""
    refuse_restart(bench, Request.REVERT)


@case("REQ-001", "USB-014", line="usb")
def test_nothing_is_answered_while_not_configured(bench: Bench) -> None:
    """While the device is not configured every vendor request is answered with STALL, afterwards none is."""
    expect("the answer to SET_CONFIGURATION 0", bench.request(Setup(0x00, 9, 0, 0, 0)), b"")
    try:
        for number, size in SIZES.items():
            expect(f"request {number} while not configured", ask(bench, number, size), None)
        for number in ORDERS:
            setup = Setup(OUT, number, GOOD_VALUES.get(number, 0), 0, 0)
            expect(f"request {number} while not configured", bench.request(setup), None)
    finally:
        bench.usb.set_configuration()
    expect_all(bench.status(), state=State.OFF, watchdog_ms=bench.info.watchdog_ms)


@case("REQ-001", "REQ-009", "REQ-010", "REQ-012")
def test_the_refused_requests_of_the_vectors_are_refused(bench: Bench) -> None:
    """The vendor requests of vectors.json that every device refuses are answered with STALL."""
    setups = [Setup(**vector["fields"]) for vector in vectors("refused_requests")]
    vendor = [setup for setup in setups if setup.request_type in (IN, OUT) and may_be_asked(bench, setup)]
    refuse_requests(bench, [(setup, b"") for setup in vendor])


def may_be_asked(bench: Bench, setup: Setup) -> bool:
    """Whether a request asks for no more drive than the limit here."""
    return setup.request != Request.LIMIT or setup.value <= bench.drive_limit or Risk.DRIVE in bench.allowed


@case("REQ-001")
def test_the_requests_of_the_vectors_are_answered(bench: Bench) -> None:
    """The vendor requests of vectors.json are answered, with as many bytes as given there."""
    for vector in vectors("requests"):
        setup = Setup(**vector["fields"])
        vendor = setup.request_type in (IN, OUT) and setup.request not in RESTARTS
        if not vendor or not is_there(bench, setup.request) or (setup.request == 7 and _enabled(bench)):
            continue
        if setup.request == Request.LIMIT and setup.value > bench.drive_limit:
            continue
        answer = bench.request(setup)
        assert answer is not None, f"{vector['name']} is answered with STALL"
        said = 0 if vector["answer"] == "nothing" else int(vector["answer"].split()[0])
        expect(f"bytes that answer {vector['name']}", len(answer), said)


def _enabled(bench: Bench) -> bool:
    """Disable the outputs if they are enabled; returns whether they still are."""
    if bench.status().enabled:
        bench.disable()
    return bench.status().enabled


# INFO and WIRING


@case("REQ-002", "VER-001", "VER-003", "BLK-024", "ACK-001", "SAF-003", "SAF-006", "FWU-005")
def test_info_says_what_the_specification_demands(bench: Bench) -> None:
    """INFO's 64 bytes match the rest of the specification: clocks, grid, room, limits, and zeros in the last 16."""
    data = bench.ask(Request.INFO)
    oldest, newest, hardware, *firmware, boards = struct.unpack_from("<BBHBBBB", data)
    carrier, features, channels, columns, rows, pitch = struct.unpack_from("<IHHBBH", data, 16)
    a_board, ticks, width, wires, cycles, queue = data[28:34]
    a_update, records, slots, entries, samples, limit, watchdog = struct.unpack_from("<7H", data, 34)
    assert 1 <= oldest <= newest, f"it speaks versions {oldest} to {newest}"
    assert hardware in list(Hardware), f"hardware is {hardware}, should be one of {[code.value for code in Hardware]}"
    expect("boards", boards, 5)
    expect("processors_per_board", a_board, 2)
    expect("channels", channels, CHANNELS)
    expect("columns times rows", columns * rows, CHANNELS)
    expect("carrier_hz", carrier, 40_000)
    expect("ticks_per_period", ticks, TICKS_PER_PERIOD)
    expect("max_width_ticks", width, 25)
    assert pitch > 0, "pitch_um is 0"
    assert wires in (2, 5), f"link_wires is {wires}, should be 2 or 5"
    assert cycles >= 2, f"cycles_per_symbol is {cycles}, should be 2 or more"
    assert queue >= 4, f"queue_blocks is {queue}, should be 4 or more"
    assert a_update >= 1, "periods_per_update is 0"
    assert records >= 16, f"queue_records is {records}, should be 16 or more"
    assert 0 < limit <= CHANNELS, f"drive_limit is {limit}, should be 1 to {CHANNELS}"
    expect("watchdog_ms", watchdog, WATCHDOG_MS)
    expect("slots", slots, 256 if features & 1 else 0)
    expect("sequence_entries", entries, 1024 if features & 1 else 0)
    expect("modulation_samples", samples, 4096 if features & 2 else 0)
    if newest == 1:
        expect("the last 16 bytes", data[48:], bytes(16))
    expect("firmware", tuple(firmware), bench.info.firmware)
    assert data[8:16] not in (bytes(8), b"\xff" * 8), "unique_id is all zeros or all ones"


@case("REQ-002", "REQ-004", "VER-003")
def test_info_and_wiring_do_not_change(bench: Bench) -> None:
    """INFO and WIRING answer the same bytes whatever the device does, and after any request."""
    info, wiring = bench.ask(Request.INFO), bench.ask(Request.WIRING)
    bench.order(Request.LIMIT, 1)
    enable(bench, 60_000)
    bench.must(Update(SILENT))
    bench.wait_periods(8)
    expect("INFO while it plays", bench.ask(Request.INFO), info)
    expect("WIRING while it plays", bench.ask(Request.WIRING), wiring)
    bench.disable()
    bench.outlast(1.05)  # a counter of seconds would have changed
    expect("INFO a second later", bench.ask(Request.INFO), info)
    expect("WIRING a second later", bench.ask(Request.WIRING), wiring)


@case("REQ-004")
def test_each_channel_drives_one_transducer(bench: Bench) -> None:
    """WIRING names each of the 320 channels once, in two bytes each, because no two transducers share an output."""
    channels = struct.unpack("<320H", bench.ask(Request.WIRING))
    expect("the channels, sorted", sorted(channels), list(range(CHANNELS)))


# STATUS


@case("REQ-003", "VER-007")
def test_a_status_has_its_form(bench: Bench) -> None:
    """STATUS answers 64 bytes with magic, version, reserved bytes of 0, no unknown bits, and the right checksum."""
    begin(bench)
    for body in (NoOp(), Update(bench.weak()), Output(Action.SILENCE), Output(Action.DISABLE)):
        bench.wait_until(bench.must(body).commit_period)
        data = bench.ask(Request.STATUS)
        expect("magic", data[:2], b"PS")
        expect("version", data[2], 1)
        assert data[3] <= 6, f"state is {data[3]}, should be 0 to 6"
        expect("unknown faults", int.from_bytes(data[4:6], "little") & ~0x7F, 0)
        assert data[6] <= 16, f"last_refusal is {data[6]}, should be 0 to 16"
        expect("unknown flags", data[7] & ~0b111, 0)
        expect("the reserved bytes", data[58:60], bytes(2))
        expect("the checksum", int.from_bytes(data[60:], "little"), zlib.crc32(data[:60]))


@case("REQ-003", "BLK-008")
def test_each_counter_counts_its_own(bench: Bench) -> None:
    """Each of accepted, refused, late and lost counts exactly its own events."""
    begin(bench)
    named, past = far(bench), bench.period()
    refusals = [bench.status().last_refusal]

    def step(what: str, block: bytes, **moves: int) -> None:
        before = bench.status()
        (ack,) = bench.send_raw(block)
        after = bench.status()
        for name in COUNTERS:
            moved = (getattr(after, name) - getattr(before, name)) % 2**32
            expect(f"by how many {name} moves for {what}", moved, moves.get(name, 0))
        if ack.reason is not Reason.ACCEPTED:
            refusals.append(ack.reason)
        expect(f"last_refusal after {what}", after.last_refusal, refusals[-1])
        expect(f"last_refusal after {what}, read again", bench.status().last_refusal, refusals[-1])

    def gap(skipped: int) -> bytes:
        number = bench.must(NoOp()).sequence
        return pack(bench.numbered(NoOp(), number=(number + 1 + skipped) % 2**32))

    step("a NO_OP", forge(bench, NoOp()), accepted=1)
    step("a CLOCK", forge(bench, Clock()), accepted=1)
    step("a late update", forge(bench, Update(SILENT, past)), accepted=1, late=1)
    step("an update for now", forge(bench, Update(SILENT)), accepted=1)
    step("an update in time", forge(bench, Update(SILENT, named)), accepted=1)
    step("an output after it", forge(bench, Output(Action.SILENCE, named)), accepted=1, late=1)
    step("a wrong checksum", forge(bench, NoOp(), checksum=0), refused=1)
    step("a wrong kind", forge(bench, NoOp(), kind=10), refused=1)
    step("a NO_OP with a gap of 2", forge(bench, NoOp()), accepted=1, lost=2)
    step("a NO_OP with a gap of 7", gap(7), accepted=1, lost=7)
    number = bench.must(NoOp()).sequence
    step("a number that does not follow", pack(Block(NoOp(), number)), refused=1)
    step("RESTART at any number", pack(bench.numbered(NoOp(), number=5, restart=True)), accepted=1)
    step("a late update with a gap", pack(bench.numbered(Update(SILENT, past), number=9)), accepted=1, late=1, lost=3)


@case("REQ-003")
def test_requests_move_no_counter(bench: Bench) -> None:
    """No request, valid or not, changes a counter, and only its own request changes a setting."""
    begin(bench)
    bench.must(Update(SILENT))
    bench.wait_periods(8)
    before = bench.status()
    for number, size in SIZES.items():
        ask(bench, number, size)
    for number in (Request.ENABLE, Request.CLEAR_FAULTS, Request.IDENTIFY):
        bench.order(number)
    bench.try_order(Request.LIMIT, 1)
    bench.try_order(Request.WATCHDOG, 3)
    check_same(before, bench.status())


def accept(bench: Bench, *bodies: Body) -> int:
    """Send blocks that must be accepted, and wait for the last; returns their number."""
    for body in bodies:
        ack = bench.must(body)
    bench.wait_until(ack.commit_period)
    return len(bodies)


def let_sequence_end(bench: Bench) -> int:
    """Play a sequence to its last repeat; returns the number of blocks that this takes."""
    require(bench, Feature.SEQUENCES)
    count = accept(bench, Slot(0, SILENT), Entries((Entry(0, 3),)), PlaySequence(0, 1, repeats=2))
    bench.await_unasked(1)
    return count


def let_watchdog_fire(bench: Bench) -> None:
    """Let the watchdog fire."""
    bench.order(Request.WATCHDOG, 10)
    bench.await_unasked(1)
    expect("watchdog_ms after the watchdog has fired", bench.status().watchdog_ms, 10)
    bench.order(Request.WATCHDOG, KEPT_MS)


def suspend(bench: Bench) -> None:
    """Suspend the bus and resume it."""
    if not bench.can(Need.SUSPEND):
        raise Inconclusive(unmet(Need.SUSPEND))
    bench.usb.set_configuration()
    bench.levers.suspend()
    bench.levers.resume()


def reset_bus(bench: Bench) -> None:
    """Reset the bus."""
    if Risk.RESET not in bench.allowed:
        raise Inconclusive(not_allowed(Risk.RESET))
    bench.usb.reset()


def enable_again(bench: Bench) -> None:
    """DISABLE and ENABLE."""
    bench.order(Request.DISABLE)
    bench.enable()


KEPT_MS = 54_321
KEEPS: dict[str, Callable[[Bench], int | None]] = {
    "enable": enable_again,
    "disable": lambda bench: bench.order(Request.DISABLE),
    "clear-faults": lambda bench: bench.order(Request.CLEAR_FAULTS),
    "accepted-blocks": lambda bench: accept(bench, NoOp(), Clock(), Update(SILENT), Output(Action.SILENCE)),
    "output-disable": lambda bench: accept(bench, Output(Action.DISABLE)),
    "the-end-of-a-sequence": let_sequence_end,
    "the-watchdog": let_watchdog_fire,
    "suspend": suspend,
    "bus-reset": reset_bus,
    "set-configuration": lambda bench: bench.usb.set_configuration(),
    "set-interface": lambda bench: bench.usb.set_interface(0),
}
"""Events that leave counters, last refusal and settings unchanged, if they return no number of accepted blocks."""
KEPT = (
    *("last_refusal", "refused", "late", "lost", "missed_commits", "damaged_messages"),
    *("dropped_frames", "faults", "watchdog_ms", "drive_limit"),
)


@case("REQ-003", "REQ-009", "REQ-010", "USB-026", "STA-003")
@pytest.mark.parametrize("what", KEEPS)
def test_counts_and_the_last_refusal_are_kept(bench: Bench, what: str) -> None:
    """Counters, last refusal, watchdog time and limit in STATUS stay as they are through all changes of state."""
    bench.order(Request.LIMIT, 1)
    enable(bench, KEPT_MS)
    first = bench.must(NoOp()).sequence
    refuse(bench, [Wrong("an update beyond the horizon", forge(bench, Update(SILENT, 2**63)), Reason.HORIZON)])
    bench.must(NoOp(), number=(first + 5) % 2**32)
    bench.must(Update(SILENT, 1))
    before = bench.status()
    bench.unasked.clear()
    accepted = KEEPS[what](bench) or 0
    after = bench.status()
    for name in KEPT:
        expect(f"{name} in STATUS", getattr(after, name), getattr(before, name))
    expect("the count of accepted blocks", after.accepted, (before.accepted + accepted) % 2**32)


@case("REQ-003", "STA-001", features=ENTRIES_FEATURES)
def test_a_status_says_what_plays(bench: Bench) -> None:
    """State, flags and since_period follow updates, sequences and modulations from beginning to end."""
    begin(bench)
    for body in (Slot(0, SILENT), Entries((Entry(0, 30),)), Samples(b"\x80")):
        bench.must(body)
    let_stores_go(bench)
    playing, sequence, modulation = State.PLAYING, StatusFlag.SEQUENCE, StatusFlag.MODULATION
    none = StatusFlag(0)
    since = 0
    check_plays(bench, "at first", State.READY, none, since)
    since = play(bench, Update(SILENT))
    check_plays(bench, "an update", playing, none, since)
    since = play(bench, PlaySequence(0, 1))
    check_plays(bench, "a sequence", playing, sequence, since)
    play(bench, AmplitudeModulation(0, 1, 7))
    check_plays(bench, "a sequence, modulated", playing, sequence | modulation, since)
    since = play(bench, Update(SILENT))
    check_plays(bench, "an update, modulated", playing, modulation, since)
    play(bench, Output(Action.END_MODULATION))
    check_plays(bench, "an update, unmodulated again", playing, none, since)
    play(bench, Output(Action.SILENCE))
    check_plays(bench, "silence", State.READY, none, 0)
    play(bench, AmplitudeModulation(0, 1, 7))
    check_plays(bench, "a modulation of nothing", State.READY, modulation, 0)
    since = play(bench, PlaySequence(0, 1))
    check_plays(bench, "a sequence under it", playing, sequence | modulation, since)
    bench.disable()
    check_plays(bench, "DISABLE", State.OFF, none, 0)


def play(bench: Bench, body: Update | PlaySequence | AmplitudeModulation | Output) -> int:
    """Send a change for a coming period; check STATUS before it, then wait for it; returns its period."""
    period = later(bench) if isinstance(body, Update) and not body.period else 0
    before = bench.status()
    began = bench.must(Update(body.pulses, period) if isinstance(body, Update) else body).commit_period
    after = bench.status()
    if after.period < began:
        expect_all(after, " before the change", since_period=before.since_period, flags=before.flags)
    bench.wait_until(began)
    return began


def check_plays(bench: Bench, what: str, state: State, flags: StatusFlag, since: int) -> None:
    """Check what a status says about what plays."""
    expect_all(bench.status(), f" with {what}", state=state, flags=flags, since_period=since)


@case("REQ-003", "SAF-003")
def test_watchdog_fired_is_said_until_enable(bench: Bench) -> None:
    """WATCHDOG_FIRED is set after the watchdog has disabled the outputs, until ENABLE; not after DISABLE."""
    bench.enable()
    bench.disable()
    expect("flags after DISABLE", bench.status().flags, StatusFlag(0))
    enable(bench, 20)
    bench.outlast(0.06)
    for _ in range(2):
        expect("flags after the watchdog", bench.status().flags, StatusFlag.WATCHDOG_FIRED)
    bench.order(Request.DISABLE)
    expect("flags after DISABLE", bench.status().flags, StatusFlag.WATCHDOG_FIRED)
    enable(bench)
    expect("flags after ENABLE", bench.status().flags, StatusFlag(0))


# ENABLE


@case("REQ-005", "BLK-023", "STA-003")
def test_enable_while_enabled_changes_nothing(bench: Bench) -> None:
    """ENABLE while the outputs are enabled does not change what plays, what waits or the counts."""
    begin(bench)
    began = bench.must(Update(SILENT)).commit_period
    named = far(bench)
    bench.must(Update(SILENT, named))
    bench.wait_until(began)
    before = bench.status()
    bench.enable()
    bench.enable()
    check_same(before, bench.status())
    if bench.info.periods_per_update > 1:
        refuse(bench, [Wrong("an update a period later", forge(bench, Update(SILENT, named + 1)), Reason.RATE)])


@case("REQ-005", "SAF-003")
def test_enable_and_status_are_signs_of_life(bench: Bench) -> None:
    """ENABLE and STATUS keep the watchdog from firing; the other requests are no signs of life."""
    for request in (Request.ENABLE, Request.STATUS):
        enable(bench, ms := 200 * bench.slowness)
        times = [bench.clock().now]
        for _ in range(6):
            bench.wait(ms / 2500)
            if request is Request.ENABLE:
                bench.enable()
            else:
                bench.status()
            times.append(bench.clock().now)
        gap = max(other - one for one, other in pairwise(times)) / 2000
        if gap >= 0.97 * ms:
            raise TooSlow(f"the host was held up for {gap:.0f} ms, as long as the watchdog's time")
        expect(f"the state, with {request.name}", bench.status().state, State.READY)
    enable(bench, 100)
    due = bench.clock().now + 3 * TICK_HZ // 20
    while bench.clock().now < due:
        for number in (Request.INFO, Request.CLOCK, Request.PROCESSORS):
            ask(bench, number, 16)
        bench.wait(0.01)
    expect("the state, with INFO, CLOCK and PROCESSORS", bench.status().state, State.OFF)


# CLOCK


@case("REQ-006", "CHN-026", "TIM-002/1")
def test_the_clock_tells_ticks_and_sync_pulses(bench: Bench) -> None:
    """CLOCK answers the tick, and period and count of sync pulses: one each 4096 periods, and any before period 0."""
    last, earlier = 0, set()
    for _ in range(8):
        data = bench.ask(Request.CLOCK)
        now, period, pulses, reserved = struct.unpack("<QQII", data)
        assert now > last, f"now is {now} after {last}, should be later"
        current = now // TICKS_PER_PERIOD
        expect("sync_period", period, current - current % SYNC_PERIODS)
        counted = current // SYNC_PERIODS + 1
        assert pulses >= counted, f"sync_pulses is {pulses} in period {current}, should be {counted} at least"
        earlier.add(pulses - counted)
        expect("the reserved bytes", reserved, 0)
        last = now
        bench.wait_periods(bench.random.randrange(500, 2500))
    assert len(earlier) == 1, f"of {sorted(earlier)} pulses before period 0 CLOCK reports, should be one number"


@case("REQ-006", "TIM-001")
def test_the_clock_runs_as_fast_as_the_hosts(bench: Bench) -> None:
    """Between two readings of CLOCK half a second apart 2 million ticks a second pass, within one per cent."""
    bench.clock()
    compare_clocks(bench, lambda: bench.wait(0.5), 0.01)


@case("REQ-006", "REQ-003", "ACK-002")
def test_all_tell_the_same_time(bench: Bench) -> None:
    """CLOCK, STATUS and acknowledgements count the same ticks: in any order of questions they never go back."""
    bench.must(NoOp())
    times = []
    for _ in range(5):
        times += [bench.clock().now, bench.must(NoOp()).now, bench.status().now, bench.must(Clock()).now]
    for one, other in pairwise(times):
        assert one < other, f"the time goes from {one} to {other}, should go on"
    took = (times[-1] - times[0]) / 2_000_000
    assert took < 10, f"20 questions took {took:.1f} s by the device's clock"


# PULSES


@case("REQ-007", features=Feature.READ_BACK)
def test_nothing_is_read_where_nothing_plays(bench: Bench) -> None:
    """If nothing plays all bytes of PULSES except read_period are 0: while off, after ENABLE, SILENCE and DISABLE."""
    check_nothing_plays(bench, "while off")
    begin(bench)
    check_nothing_plays(bench, "after ENABLE")
    bench.wait_until(bench.must(Update(bench.weak())).commit_period)
    assert any(bench.ask(Request.PULSES)[16:]), "PULSES are all 0 while an update plays"
    bench.wait_until(bench.must(Output(Action.SILENCE)).commit_period)
    check_nothing_plays(bench, "after SILENCE")
    bench.wait_until(bench.must(Update(bench.weak())).commit_period)
    bench.disable()
    check_nothing_plays(bench, "after DISABLE")


def check_nothing_plays(bench: Bench, when: str) -> None:
    """Check that PULSES answers only its read_period, and otherwise 0."""
    before = bench.period()
    data = bench.ask(Request.PULSES)
    after = bench.period()
    since, read = struct.unpack_from("<QQ", data)
    expect(f"since_period {when}", since, 0)
    expect(f"pulses {when}", data[16:], bytes(PAYLOAD_BYTES))
    assert before <= read <= after, f"read_period is {read}, should be from {before} to {after}"


@case("REQ-007", features=Feature.READ_BACK)
def test_the_update_that_plays_is_read(bench: Bench) -> None:
    """PULSES answers the pulses of the update that plays, in array order, and the period from which they play."""
    begin(bench)
    for _ in range(bench.tries(4, 2, 6)):
        pulses = bench.weak()
        payload = packed(zip(pulses.phase.tolist(), pulses.width.tolist(), strict=True))
        began = bench.must(Update(pulses, bench.period() + 2000)).commit_period
        bench.wait_until(began)
        before = bench.period()
        data = bench.ask(Request.PULSES)
        after = bench.period()
        since, read = struct.unpack_from("<QQ", data)
        expect("since_period", since, began)
        assert before <= read <= after, f"read_period is {read}, should be from {before} to {after}"
        expect("pulses", data[16:], payload)


@case("REQ-007", features=Feature.READ_BACK)
def test_one_transducer_is_read_where_it_is(bench: Bench) -> None:
    """An update with one transducer in each row, each of another phase, is read back at the same places."""
    begin(bench)
    places = [0, 1, 19, 20, CHANNELS // 2 - 1, CHANNELS // 2, CHANNELS - 2, CHANNELS - 1]
    for place in some(bench, places, 3, 4):
        payload = packed([(0, 0)] * place + [(place % 100, 3)])
        (ack,) = bench.send_raw(forge(bench, Update(SILENT), payload))
        expect("the reason", ack.reason, Reason.ACCEPTED)
        bench.wait_until(ack.commit_period)
        expect(f"pulses with transducer {place}", bench.ask(Request.PULSES)[16:], payload)


@case("REQ-007", "BLK-015", features=Feature.READ_BACK | Feature.SEQUENCES)
def test_the_entry_that_plays_is_read(bench: Bench) -> None:
    """During a sequence PULSES answers the slot that plays, and the period since which this entry plays."""
    begin(bench)
    slots = [bench.weak(), bench.weak()]
    for number, pulses in enumerate(slots):
        bench.must(Slot(number, pulses))
    lasts = min(4000 * bench.slowness, 60_000) if bench.line.kind == "usb" else 12_000
    bench.must(Entries((Entry(0, lasts), Entry(1, lasts))))
    let_stores_go(bench)
    began = bench.must(PlaySequence(0, 2)).commit_period
    for turn in range(4):
        start = began + turn * lasts
        bench.wait_until(start + 100)
        reading = bench.read_back()
        if reading.read_period >= start + lasts:
            raise TooSlow("the line was too slow for the sequence")
        expect("since_period", reading.since_period, start)
        assert reading.pulses == slots[turn % 2], f"PULSES are not those of slot {turn % 2}"
        expect("since_period in STATUS", bench.status().since_period, began)


@case("REQ-007", "PUL-006", features=Feature.READ_BACK | Feature.MODULATION)
def test_pulses_are_read_before_modulation(bench: Bench) -> None:
    """PULSES answers what plays before any modulation, even under sample 0, and since when."""
    begin(bench)
    bench.must(Samples(bytes(3)))
    let_stores_go(bench)
    pulses = bench.weak()
    began = bench.must(Update(pulses)).commit_period
    bench.wait_until(bench.must(AmplitudeModulation(0, 3, 1)).commit_period)
    reading = bench.read_back()
    expect("since_period", reading.since_period, began)
    assert reading.pulses == pulses, "PULSES are not those of the update"


@case("REQ-007", "CHN-016", features=Feature.READ_BACK)
def test_pulses_of_two_updates_are_never_mixed(bench: Bench) -> None:
    """While updates alternate PULSES answers one of them with its period, or reports that the processors differ."""
    if bench.line.kind == "serial":
        raise Inconclusive("a serial line cannot carry updates while PULSES are read")
    begin(bench)
    pulses = [bench.weak(), bench.weak()]
    for _ in range(6):
        first = bench.period() + 60
        places = bench.info.queue_blocks - 2
        apart_by = bench.random.randrange(1, 5) * bench.info.periods_per_update
        bodies = [Update(pulses[number % 2], first + apart_by * number) for number in range(places)]
        acks = bench.send_all(bodies)
        periods = {ack.commit_period: bodies[number].pulses for number, ack in enumerate(acks)}
        bench.wait_until(first + bench.random.randrange(apart_by * places))
        reading = bench.read_back()
        if not reading.mixed and reading.since_period in periods:
            assert reading.pulses == periods[reading.since_period], "PULSES are a mixture"
        elif not reading.mixed:
            assert reading.since_period < min(periods), f"since_period is {reading.since_period}, when nothing began"
        bench.wait_until(max(periods))


# PROCESSORS


@case("REQ-008", "FWU-016")
def test_processors_say_how_they_are(bench: Bench) -> None:
    """PROCESSORS answers for each of ten: no faults, one bank and firmware for all, counts that add up to STATUS."""
    bench.outlast(0.03)
    data = bench.ask(Request.PROCESSORS)
    status = bench.status()
    reports = [struct.unpack_from("<HbBII3BB", data, 16 * number) for number in range(10)]
    expect("faults", [report[0] for report in reports], [0] * 10)
    banks = {report[2] for report in reports}
    assert len(banks) == 1, f"the firmware of the processors comes from banks {sorted(banks)}, should be one"
    assert banks <= {1, 2, 3}, f"bank is {banks}, should be 1, 2 or 3"
    expect("missed_commits in STATUS", status.missed_commits, sum(report[3] for report in reports) % 2**32)
    expect("damaged_messages in STATUS", status.damaged_messages, sum(report[4] for report in reports) % 2**32)
    expect("firmware", {report[5:8] for report in reports}, {bench.info.firmware})
    expect("the reserved bytes", {report[8] for report in reports}, {0})
    warmest = max(report[1] for report in reports)
    assert abs(warmest - status.temperature_c) <= 1, f"temperature_c in STATUS is {status.temperature_c}, not {warmest}"
    boards = [{reports[2 * board][1], reports[2 * board + 1][1]} for board in range(5)]
    for board, temperatures in enumerate(boards):
        spread = max(temperatures) - min(temperatures)
        assert spread <= 1, f"the processors of board {board} report {temperatures} °C, should report one temperature"


@case("REQ-008", "REQ-003", "CHN-017/1", needs=(Need.FAULTS,))
def test_the_warmest_board_is_in_the_status(bench: Bench) -> None:
    """A board's temperature is reported by its two processors and, if it is the warmest, by STATUS, below 0 too."""
    for board in range(5):
        bench.levers.cause(HotBoard(board=board, celsius=-7 - board))
    bench.levers.cause(HotBoard(board=3, celsius=-2))
    bench.outlast(0.03)
    seen = [report.temperature_c for report in bench.processors()]
    expect("temperatures", seen, [-7, -7, -8, -8, -9, -9, -2, -2, -11, -11])
    expect("temperature_c in STATUS", bench.status().temperature_c, -2)


@case("REQ-008", "CHN-017/2", needs=(Need.FAULTS,), allow=(Risk.RESET,), since=3)
def test_of_a_processor_that_never_answers_only_the_identity_is_known(bench: Bench) -> None:
    """A processor that was numbered, and whose reports are all damaged, is reported with bank and firmware alone."""
    place, well = 4, bench.ask(Request.PROCESSORS)
    bench.levers.cause(FlippedBit(message="report", processor=place, token=12, times=ALWAYS))
    bench.restart(lambda: bench.order(Request.RESET))
    bench.outlast(0.06)
    identity = bytes(3) + well[3:4] + bytes(8) + well[12:15] + bytes(1)
    expect("what is known of it", bench.ask(Request.PROCESSORS)[16 * place :][:16], identity)
    assert Fault.PROCESSOR in bench.status().faults, "the fault PROCESSOR is missing, although a processor is silent"


@case("REQ-008", "REQ-003", "CHN-004/2", "SAF-008", needs=(Need.FAULTS,), features=Feature.SEQUENCES)
def test_what_went_wrong_on_the_chain_is_added_up(bench: Bench) -> None:
    """Damaged slices count as missed commits and damaged loads as damaged messages, past 255; STATUS adds them up."""
    begin(bench)
    for processor, times in ((2, 1), (7, MANY)):
        bench.levers.cause(FlippedBit(message="slice", processor=processor, token=20, times=times))
        bench.wait_until(bench.send_all([Update(bench.weak(0.1))] * times)[-1].commit_period)
    for processor, times in ((0, LOADS), (9, MANY)):
        bench.levers.cause(FlippedBit(message="load", processor=processor, token=20, times=times))
        bench.send_all([Entries((Entry(0, 1),) * ENTRIES_PER_BLOCK)] * (times // LOADS))
        bench.wait(0.01)
    bench.outlast(0.03)
    reports, status = bench.processors(), bench.status()
    expect("missed_commits", [report.missed_commits for report in reports], [0, 0, 1, 0, 0, 0, 0, MANY, 0, 0])
    expect("damaged_messages", [report.damaged_messages for report in reports], [LOADS, *[0] * 8, MANY])
    expect("missed_commits in STATUS", status.missed_commits, MANY + 1)
    expect("damaged_messages in STATUS", status.damaged_messages, MANY + LOADS)
    expect("faults in STATUS", status.faults, Fault.CHAIN)


# WATCHDOG, LIMIT, CLEAR_FAULTS, IDENTIFY


@case("REQ-009", "REQ-001")
def test_the_watchdog_takes_10_to_60000_ms(bench: Bench) -> None:
    """WATCHDOG takes 10 to 60 000 ms, and STATUS shows it; anything else is answered with STALL, without effect."""
    for value in (10, 11, 60_000, 59_999, 255, 256, 1000):
        bench.order(Request.WATCHDOG, value)
        expect("watchdog_ms", bench.status().watchdog_ms, value)
    refuse_requests(bench, [(Setup(OUT, 6, value, 0, 0), b"") for value in (0, 1, 9, 60_001, 60_010, 65_535)])
    expect("watchdog_ms", bench.status().watchdog_ms, 1000)


@case("REQ-009", "SAF-003")
def test_the_watchdogs_time_holds_at_once(bench: Bench) -> None:
    """A shorter time holds at once, counted from the last sign of life: if that is too long ago, the watchdog fires."""
    enable(bench)
    bench.outlast(0.1)
    bench.order(Request.WATCHDOG, 50)
    expect("the state after 100 ms with 50 ms", bench.await_unasked(1).state, State.OFF)
    enable(bench, 300)
    bench.outlast(0.1)
    bench.order(Request.WATCHDOG, LONG_MS)
    bench.outlast(0.4)
    expect("the state after a longer time was set", bench.status().state, State.READY)


@case("REQ-009", "REQ-010", "USB-026")
def test_watchdog_and_limit_stay(bench: Bench) -> None:
    """Watchdog time and drive limit survive ENABLE, DISABLE, blocks, and a new session."""
    bench.order(Request.WATCHDOG, 4321)
    bench.order(Request.LIMIT, 1)
    bench.enable()
    bench.must(Update(SILENT))
    expect_all(bench.status(), watchdog_ms=4321, drive_limit=1)
    bench.disable()
    expect_all(bench.status(), watchdog_ms=4321, drive_limit=1)
    if bench.line.kind == "usb":
        bench.usb.set_configuration()
        expect_all(bench.status(), watchdog_ms=4321, drive_limit=1)
        bench.usb.set_interface(0)
        expect_all(bench.status(), watchdog_ms=4321, drive_limit=1)


@case("REQ-009", "REQ-010", "REQ-013", "SAF-006", allow=(Risk.RESET,))
def test_watchdog_and_limit_are_infos_after_a_restart(bench: Bench) -> None:
    """After RESET the watchdog's time and the drive limit are those of INFO again."""
    bench.order(Request.WATCHDOG, 4321)
    bench.order(Request.LIMIT, 1)
    bench.restart(lambda: bench.order(Request.RESET))
    expect_all(bench.status(), watchdog_ms=bench.info.watchdog_ms, drive_limit=bench.info.drive_limit)


@case("REQ-010", "SAF-006", "REQ-001")
def test_the_limit_can_be_lowered_and_raised(bench: Bench) -> None:
    """LIMIT takes 0 and more, and STATUS shows it, first lower values and then higher ones again."""
    most = bench.drive_limit
    for value in (most, 0, 1, most - 1):
        bench.order(Request.LIMIT, value)
        expect("drive_limit", bench.status().drive_limit, value)


@case("REQ-010", "SAF-006", "REQ-001", allow=(Risk.DRIVE,))
def test_the_limit_takes_no_more_than_infos(bench: Bench) -> None:
    """LIMIT takes values up to INFO's drive_limit; more is answered with STALL and changes nothing."""
    most = bench.info.drive_limit
    for value in (most - 1, most):
        bench.order(Request.LIMIT, value)
        expect("drive_limit", bench.status().drive_limit, value)
    refuse_requests(bench, [(Setup(OUT, 7, value, 0, 0), b"") for value in (most + 1, most + 256, 1000, 65_535)])


@case("REQ-010", "SAF-006")
def test_the_limit_holds_at_once(bench: Bench) -> None:
    """An update exactly at the limit is accepted; one a thousandth of a transducer above is refused with DRIVE."""
    bench.order(Request.LIMIT, 1)
    begin(bench)
    bench.must(Update(heavy(1)))
    payload = packed([(0, 25), (0, 1)])
    refuse(bench, [Wrong("4 thousandths too much", forge(bench, Update(SILENT), payload), Reason.DRIVE)])
    bench.disable()
    bench.order(Request.LIMIT, 0)
    bench.enable()
    bench.must(Update(SILENT))
    refuse(bench, [Wrong("one narrow pulse", forge(bench, Update(SILENT), packed([(0, 1)])), Reason.DRIVE)])


@case("REQ-010")
def test_the_limit_is_set_while_the_outputs_are_off(bench: Bench) -> None:
    """LIMIT is answered with STALL while the outputs are enabled, in READY and PLAYING, and changes nothing."""
    before = bench.status().drive_limit
    begin(bench)
    refuse_requests(bench, [(Setup(OUT, 7, value, 0, 0), b"") for value in (0, 1, before)])
    bench.wait_until(bench.must(Update(SILENT)).commit_period)
    refuse_requests(bench, [(Setup(OUT, 7, value, 0, 0), b"") for value in (0, 1, before)])
    bench.disable()
    bench.order(Request.LIMIT, 1)
    expect("drive_limit", bench.status().drive_limit, 1)


@case("REQ-011", "STA-005")
def test_clear_faults_without_a_fault_does_nothing(bench: Bench) -> None:
    """CLEAR_FAULTS is carried out in every state, and without a fault it changes nothing, whatever plays."""
    bench.order(Request.CLEAR_FAULTS)
    expect("the state", bench.status().state, State.OFF)
    begin(bench)
    bench.wait_until(bench.must(Update(SILENT)).commit_period)
    bench.must(Update(SILENT, far(bench)))
    bench.wait_periods(8)
    before = bench.status()
    bench.order(Request.CLEAR_FAULTS)
    check_same(before, bench.status())


CAUSES: dict[Fault, list[tuple[InjectedFault, bool]]] = {
    Fault.TEMPERATURE: [(HotBoard(board=4, celsius=celsius), celsius < 80) for celsius in (90, 80, 79)],
    Fault.SUPPLY: [(WrongSupply(board=4, millivolts=volts * 1000), volts == 12) for volts in (19, 11, 12)],
}
"""What happens on the last board alone, and whether the fault can be cleared then."""


@case("REQ-011", "SAF-007/1", "SAF-008", "STA-003", needs=(Need.FAULTS,))
@pytest.mark.parametrize("fault", CAUSES, ids=["temperature", "supply"])
def test_faults_are_cleared_when_their_cause_is_gone(bench: Bench, fault: Fault) -> None:
    """The last board alone keeps a fault and the state FAULT until its cause is gone; then CLEAR_FAULTS clears it."""
    for cause, cleared in CAUSES[fault]:
        bench.levers.cause(cause)
        await_state(bench, State.FAULT)
        bench.outlast(0.03)
        expect("faults before CLEAR_FAULTS", bench.status().faults, fault)
        bench.order(Request.CLEAR_FAULTS)
        expect_all(
            bench.status(),
            f" after {cause}",
            faults=Fault(0) if cleared else fault,
            state=State.OFF if cleared else State.FAULT,
        )
        expect("whether ENABLE is accepted", bench.try_order(Request.ENABLE), cleared)


SOON_PERIODS = 20_000
"""A fault that is seen before it ends, on any line."""


@case("REQ-011", "SAF-007", "STA-003", needs=(Need.FAULTS,))
@pytest.mark.parametrize("lasts", [Fault.TEMPERATURE, Fault.SUPPLY], ids=["temperature", "supply"])
def test_one_fault_that_lasts_keeps_the_state_fault(bench: Bench, lasts: Fault) -> None:
    """Of two silencing faults CLEAR_FAULTS clears the one that is over; the other one keeps the state FAULT."""
    bench.must(NoOp())
    periods = {fault: None if fault is lasts else SOON_PERIODS for fault in (Fault.TEMPERATURE, Fault.SUPPLY)}
    bench.levers.cause(HotBoard(board=1, celsius=90, periods=periods[Fault.TEMPERATURE]))
    bench.levers.cause(WrongSupply(board=2, millivolts=19_000, periods=periods[Fault.SUPPLY]))
    await_state(bench, State.FAULT)
    bench.outlast(0.03)
    expect("both faults", bench.status().faults, Fault.TEMPERATURE | Fault.SUPPLY)
    bench.wait_periods(SOON_PERIODS)
    bench.outlast(0.03)
    bench.order(Request.CLEAR_FAULTS)
    status = bench.status()
    expect("state and faults", (status.state, status.faults), (State.FAULT, lasts))
    assert not bench.try_order(Request.ENABLE), "ENABLE is not answered with STALL while a fault lasts"
    expect("the reason for an update", bench.send(Update(SILENT)).reason, Reason.FAULT)


@case("REQ-012", "REQ-001")
def test_identify_knows_five_boards(bench: Bench) -> None:
    """IDENTIFY works for each board, repeatedly, and is answered with STALL for others; nothing else changes."""
    begin(bench)
    bench.wait_until(bench.must(Update(SILENT)).commit_period)
    bench.wait_periods(8)
    before = bench.status()
    for board in (*range(bench.info.boards), 0):
        bench.order(Request.IDENTIFY, board)
    check_same(before, bench.status())
    boards = (bench.info.boards, bench.info.boards + 1, 255, 256, 65_535)
    refuse_requests(bench, [(Setup(OUT, 12, board, 0, 0), b"") for board in boards])
