"""Several doors to one device, and hosts that hang up while a block waits (chapters SER and ACK)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from phasewire.emulator.faults import WrongSupply
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import Words
from phasewire.hil.conformance.tools.doors import TEST, DoorRow, Host, at_the_door
from phasewire.hil.conformance.tools.exchange import (
    acks,
    ask,
    await_ack,
    damage,
    fill,
    no_op,
    order,
    put_to_wait,
    same_but,
    send,
    statuses,
)
from phasewire.hil.conformance.tools.frames import frame
from phasewire.hil.conformance.tools.player import soon
from phasewire.hil.conformance.tools.playing import check_falls_silent, judge_silence_since, reach
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    SILENT,
    enable,
    expect_all,
    forge,
    heavy,
    let_stores_go,
    set_limit,
    suspended,
)
from phasewire.hil.conformance.tools.watchdog import TICKS_PER_MS, await_firing, check_fired, check_not_yet, patience
from phasewire.hil.conformance.transports.serial import RawSerialLine
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.board import CHANNELS, TICKS_PER_PERIOD
from phasewire.protocol.codes import PROMISED_PERIODS, Action, Fault, Feature, FrameKind, Reason, Request, State
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import Ack, Status

QUEUED_SECONDS = 15.0
"""For how long the queue stays full without DISABLE: longer than any host needs meanwhile."""
NO_ROOM_MS = 600
TOLD_PERIODS = 40
"""A device knows of a change within this time after it took effect."""


# Hosts that hang up


@case("SER-010", "SER-011/1")
def test_a_block_that_waits_outlives_its_host(bench: Bench, frames: RawSerialLine) -> None:
    """A block that waits when its host hangs up is judged when there is room, and the next host gets no answer."""
    fill(bench, frames, QUEUED_SECONDS)
    put_to_wait(bench, frames, no_op(bench))
    before = bench.status()
    frames.hang_up()
    frames.enter_frames()
    same_but(before, bench.status())
    check_judged(bench, frames, before)


@case("SER-010", "SER-011/3")
def test_a_hang_up_leaves_one_place_for_a_block_to_wait(bench: Bench, frames: RawSerialLine) -> None:
    """After a hang-up the block that waits keeps its place; a later block gets the place once the first is judged."""
    fill(bench, frames, QUEUED_SECONDS)
    put_to_wait(bench, frames, no_op(bench))
    frames.hang_up()
    frames.enter_frames()
    damage(bench, frames, frame(FrameKind.BLOCK, no_op(bench)))
    check_judged(bench, frames, bench.status())
    fill(bench, frames, QUEUED_SECONDS)
    block = no_op(bench)
    put_to_wait(bench, frames, block)
    order(frames, Request.DISABLE)
    expect("the reason of a block that waits after it", await_ack(frames, block).reason, Reason.ACCEPTED)


@case("SER-010", "SER-011/1", "USB-026", line="usb")
def test_a_block_that_waits_outlives_its_session(bench: Bench, frames: RawSerialLine) -> None:
    """SET_CONFIGURATION empties the queue and hangs up: a block that waits is judged and its answer dropped."""
    fill(bench, frames, QUEUED_SECONDS)
    put_to_wait(bench, frames, no_op(bench))
    before = bench.status()
    bench.usb.set_configuration()
    frames.assume_console()
    frames.enter_frames()
    check_judged(bench, frames, before)


@case("SER-010", "NUM-002")
@pytest.mark.parametrize("how", ["hang-up", "connection"])
def test_a_hang_up_concerns_its_line_alone(bench: Bench, frames: RawSerialLine, how: str) -> None:
    """When a host hangs up that has enabled the outputs and plays, all goes on, the numbering too.

    A hang-up is a break or DTR low, or the end of a connection.
    """
    if how == "connection" and not frames.wire.is_connection:
        raise Inconclusive("this line has no connection to close; one by socket: has")
    order(frames, Request.WATCHDOG, LONG_MS)
    order(frames, Request.ENABLE)
    bench.wait_until(send(frames, pack(bench.numbered(Update(SILENT)))).commit_period + 1)
    block = no_op(bench)
    send(frames, block)
    before = bench.status()
    if how == "hang-up":
        frames.hang_up()
    else:
        frames.wire.reopen(bench.return_seconds)
        frames.assume_console()
        frames.write(b"info\r")
        if not frames.answer():
            raise Inconclusive("the line still carries frames: perhaps a gateway to a UART does not pass the end on")
    frames.enter_frames()
    same_but(before, bench.status())
    expect("the reason of the same block", send(frames, block).reason, Reason.SEQUENCE)


@case("SER-010", "SAF-003")
def test_the_watchdog_silences_what_a_host_that_hung_up_has_left(bench: Bench, frames: RawSerialLine) -> None:
    """A hang-up neither stops the watchdog nor feeds it: it fires one watchdog time after the last sign of life."""
    ms = max(patience(bench), patience(bench, frames))
    order(frames, Request.WATCHDOG, LONG_MS)
    order(frames, Request.ENABLE)
    last = send(frames, pack(bench.numbered(Update(SILENT)))).now
    order(frames, Request.WATCHDOG, ms)
    bench.wait(ms / 3000)
    frames.hang_up()
    frames.enter_frames()
    check_not_yet(bench, last + ms * TICKS_PER_MS)
    until_fired(bench, last, last, ms)


# Two serial lines


@pytest.fixture
def both_lines(bench: Bench) -> Iterator[tuple[RawSerialLine, RawSerialLine]]:
    """The console's endpoints and the UART, both in frames; inconclusive if this run lacks one."""
    with bench.door("cdc") as cdc, bench.door("uart") as uart:
        assert isinstance(cdc, RawSerialLine)
        assert isinstance(uart, RawSerialLine)
        yield cdc, uart


@case("SER-011/1", "SER-016", features=Feature.CONSOLE, since=3)
def test_each_line_has_a_place_for_a_block_that_waits(
    bench: Bench, both_lines: tuple[RawSerialLine, RawSerialLine]
) -> None:
    """While a block waits on one line, one waits on the other too; both are judged when there is room."""
    fill(bench, both_lines[0], QUEUED_SECONDS)
    blocks = [no_op(bench) for _ in both_lines]
    for line, block in zip(both_lines, blocks, strict=True):
        line.rest()
        line.forget()
        put_to_wait(bench, line, block)
    bench.order(Request.DISABLE)
    for line, block in zip(both_lines, blocks, strict=True):
        await_ack(line, block)


@case("SER-006", "REQ-003", "SER-016", features=Feature.CONSOLE)
def test_dropped_frames_are_counted_over_all_lines(
    bench: Bench, both_lines: tuple[RawSerialLine, RawSerialLine]
) -> None:
    """A frame that is dropped on one line is in the count that each line tells."""
    for line in both_lines:
        damage(bench, line, frame(FrameKind.BLOCK, b""))
        told = [Status.decode(ask(other, Request.STATUS)).dropped_frames for other in both_lines]
        expect("the counts of dropped frames", told, [bench.status().dropped_frames] * 2)


@case("SER-010", "SER-016", features=Feature.CONSOLE)
def test_a_hang_up_leaves_the_other_line_in_frames(
    bench: Bench, both_lines: tuple[RawSerialLine, RawSerialLine]
) -> None:
    """When the host of one line hangs up, the other line goes on with frames."""
    for line, other in (both_lines, both_lines[::-1]):
        line.hang_up()
        send(other, no_op(bench))
        line.enter_frames()


@pytest.mark.parametrize(
    ("name", "begin_session"),
    [
        ("uart", lambda bench: bench.usb.set_configuration()),
        ("uart", lambda bench: bench.usb.set_interface(0)),
        ("cdc", lambda bench: bench.usb.set_interface(0)),
    ],
    ids=["uart-configuration", "uart-interface", "cdc-interface"],
)
@case("SER-011/1", "USB-026", "SER-016", line="usb", features=Feature.CONSOLE)
def test_a_session_of_usb_leaves_a_line_in_frames(
    bench: Bench, name: str, begin_session: Callable[[Bench], object]
) -> None:
    """A new session that does not concern a line empties the queue: a block that waits there is judged and answered."""
    with bench.door(name) as line:
        assert isinstance(line, RawSerialLine)
        fill(bench, line, QUEUED_SECONDS)
        block = no_op(bench)
        put_to_wait(bench, line, block)
        begin_session(bench)
        expect("the reason of the block", await_ack(line, block).reason, Reason.ACCEPTED)


def check_judged(bench: Bench, line: RawSerialLine, before: Status) -> None:
    """Empty the queue: the block that waits must be accepted, and its answer must not be sent."""
    order(line, Request.DISABLE)
    line.rest()
    expect("the acknowledgements on the line", acks(line), [])
    expect_all(bench.status(), accepted=before.accepted + 1, dropped_frames=before.dropped_frames)


@case("SER-011", "SAF-003")
def test_blocks_that_find_no_room_keep_nothing_alive(bench: Bench, frames: RawSerialLine) -> None:
    """Blocks that arrive while the queue is full do not feed the watchdog, whether they wait or are dropped."""
    fill(bench, frames, QUEUED_SECONDS)
    first = bench.clock().now
    bench.status()  # the last sign of life
    last = bench.clock().now
    bench.order(Request.WATCHDOG, ms := NO_ROOM_MS * bench.slowness)
    due, came = last + ms * TICKS_PER_MS, 0
    while bench.clock().now < due and came < 100:
        frames.write(b"\0" + frame(FrameKind.BLOCK, no_op(bench)))
        came += 1
        bench.wait(0.05)
    if came < 3:
        raise TooSlow(f"this line is too slow: {came} blocks went to the device before the watchdog was due")
    await_firing(bench, first, last, ms)


# What one door does is told at the other

BOTH = ("usb", "serial")


@case("SER-016", "ACK-006", "BLK-018", line="usb")
@pytest.mark.parametrize("door", BOTH)
@pytest.mark.parametrize("when", ["now", "later"])
def test_what_blocks_of_one_door_do_is_told_at_the_other(
    bench: Bench, frames: RawSerialLine, door: str, when: str
) -> None:
    """An UPDATE, SILENCE or DISABLE from one door is told at the other when it takes effect."""
    bodies: list[tuple[Callable[[int], Body], State]] = [
        (lambda period: Update(Pulses.silent(CHANNELS), period), State.PLAYING),
        (lambda period: Output(Action.SILENCE, period), State.READY),
        (lambda period: Update(Pulses.silent(CHANNELS), period), State.PLAYING),
        (lambda period: Output(Action.DISABLE, period), State.OFF),
    ]
    begin(bench, frames, door)
    for body, state in bodies:
        ack = accepted(bench, frames, door, body(soon(bench) if when == "later" else 0))
        check_told(bench, frames, door, state, ack.commit_period)


@case("SER-016", "ACK-006", "BLK-018", line="usb", features=Feature.SEQUENCES | Feature.UNATTENDED)
@pytest.mark.parametrize("door", BOTH)
def test_what_sequences_of_one_door_do_is_told_at_the_other(bench: Bench, frames: RawSerialLine, door: str) -> None:
    """The start of a sequence, attended or not, and its end by DISABLE are told at the other door."""
    begin(bench, frames, door)
    for store in (Slot(0, Pulses.silent(CHANNELS)), Entries((Entry(0, 100),))):
        accepted(bench, frames, door, store)
    let_stores_go(bench)
    bodies: list[tuple[Body, State]] = [
        (PlaySequence(0, 1), State.PLAYING),
        (PlaySequence(0, 1, unattended=True), State.UNATTENDED),
        (Output(Action.DISABLE), State.OFF),
    ]
    for body, state in bodies:
        check_told(bench, frames, door, state, accepted(bench, frames, door, body).commit_period)


@case("SER-016", "ACK-006", "CON-004/1", line="usb")
def test_what_is_typed_is_told_by_usb(bench: Bench, console: RawSerialLine) -> None:
    """The effects of `enable`, `test` and `stop` at the console are told by USB, so that a program learns of them."""
    bench.order(Request.WATCHDOG, LONG_MS)
    for command, state in (("enable", State.READY), ("test 17", State.PLAYING), ("stop", State.OFF)):
        expect(f"the answer to {command}", console.command(command), "ok\r\n")
        expect(f"the state told by USB after {command}", bench.await_unasked(console.patience()).state, state)


# Safety at every door

DOORS = (
    DoorRow(name="usb", clauses=("USB-002",)),
    DoorRow(name="cdc", clauses=("USB-002",), features=Feature.CONSOLE),
    DoorRow(name="cdc", typed=True, clauses=("USB-002",), features=Feature.CONSOLE),
    DoorRow(name="uart", clauses=("SER-001",)),
    DoorRow(name="uart", typed=True, clauses=("SER-001",), features=Feature.CONSOLE),
)
"""The doors of a device. A clause that the profile takes away takes its door with it."""
PERMISSION = Feature.SEQUENCES | Feature.UNATTENDED
every_door = pytest.mark.parametrize("door", DOORS, ids=str)


@pytest.fixture
def host(bench: Bench, door: DoorRow) -> Iterator[Host]:
    """A host at the door of the case, after an accepted block by the bench's own."""
    with at_the_door(bench, door) as host:
        bench.must(NoOp())
        bench.order(Request.WATCHDOG, LONG_MS)
        yield host


def changes(host: Host) -> list[Body]:
    """Changes that this door can ask for."""
    return host.able(TEST, PlaySequence(0, 1), AmplitudeModulation(0, 1, 1), Output(Action.SILENCE))


def until_fired(bench: Bench, first_sign: int, last_sign: int, ms: int) -> None:
    """Wait for the watchdog, which must fire in time; what other doors do may be told before."""
    while not (told := bench.await_unasked(ms / 1000 + 1)).watchdog_fired:
        pass
    check_fired(told, first_sign, last_sign, ms)


@every_door
@case("SAF-002", "SER-016")
def test_changes_by_this_door_need_enable(bench: Bench, host: Host) -> None:
    """By this door changes are refused with DISABLED before ENABLE and after DISABLE, and taken in between."""
    for _ in range(2):
        for body in changes(host):
            expect(f"the reason for {body.KIND.name}", host.send(body), Reason.DISABLED)
        expect("the state", bench.status().state, State.OFF)
        assert host.order(Request.ENABLE), "ENABLE is refused"
        expect("the reason for an update after ENABLE", host.send(TEST), Reason.ACCEPTED)
        assert host.order(Request.DISABLE), "DISABLE is refused"


SIGNS: dict[str, Callable[[Host], object]] = {
    "ENABLE": lambda host: host.order(Request.ENABLE),
    "an update": lambda host: host.send(TEST),
    "STATUS": lambda host: host.order(Request.STATUS),
}


@every_door
@case("SAF-003", "SER-016", "REQ-005")
def test_the_watchdog_hears_this_door(bench: Bench, host: Host) -> None:
    """By this door ENABLE starts the watchdog, and an accepted block and STATUS restart it."""
    ms = host.patience
    bench.order(Request.WATCHDOG, ms)
    for what, give in SIGNS.items():
        bench.note("sign of life", what)
        if what != "ENABLE":
            bench.enable()
            last = bench.clock().now
            bench.wait(ms / 3000)
        before = bench.clock().now
        give(host)
        after = bench.clock().now
        if what != "ENABLE":
            check_not_yet(bench, last + ms * TICKS_PER_MS, after)
        until_fired(bench, before, after, ms)


@every_door
@case("SAF-003", "SER-016", "REQ-010")
def test_what_is_refused_by_this_door_is_no_sign_of_life(bench: Bench, host: Host) -> None:
    """By this door refused blocks, CLOCK and a refused LIMIT do not restart the watchdog."""
    ms = host.patience
    bench.order(Request.LIMIT, 0)
    bench.enable()
    last = bench.must(NoOp()).now
    bench.order(Request.WATCHDOG, ms)
    bench.wait(ms / 6000)
    expect("the reason for an update above the limit", host.send(TEST), Reason.DRIVE)
    if not host.typed:
        damaged = forge(bench, NoOp(), checksum=1)
        expect("the reason of a wrong checksum", host.send_block(damaged).reason, Reason.CHECKSUM)
    assert not host.order(Request.LIMIT, 1), "LIMIT is carried out while the outputs are enabled"
    assert host.order(Request.CLOCK), "CLOCK is refused"
    check_not_yet(bench, last + ms * TICKS_PER_MS)
    await_firing(bench, last, last, ms)


@every_door
@case("SAF-004", "STA-005", "SER-016", "CON-004/2", outputs=("SAF-004/1",))
def test_this_door_silences(bench: Bench, host: Host) -> None:
    """By this door DISABLE, or `stop`, works in OFF and in every enabled state, and all outputs fall silent."""
    states = [State.OFF, State.READY, State.UNATTENDED, State.PLAYING]
    for state in states if not PERMISSION & ~bench.info.features else [*states[:2], State.PLAYING]:
        field = reach(bench, state)
        before = bench.clock().now
        assert host.order(Request.DISABLE), f"DISABLE is refused in {state.name}"
        after = bench.clock().now
        expect(f"the state after DISABLE in {state.name}", bench.status().state, State.OFF)
        if field is not None:
            words, end = field.words, after // TICKS_PER_PERIOD + 100

            def check(seen: Seen, words: Words = words, before: int = before, after: int = after) -> None:
                check_falls_silent(seen, words, before, after)

            bench.judge(field.period, end, check)


@every_door
@case("SAF-005", "SER-016", "SAF-003", features=PERMISSION)
def test_what_plays_unattended_by_this_door_ends_with_an_update_by_another(bench: Bench, host: Host) -> None:
    """The watchdog rests for what is unattended, and starts when it ends, whatever doors the two came through."""
    ms = host.patience
    for store in (Slot(0, SILENT), Entries((Entry(0, 100),))):
        bench.must(store)
    let_stores_go(bench)
    sequence = PlaySequence(0, 1, unattended=True)

    def by_host(body: Body) -> None:
        expect(f"the reason for {body.KIND.name}", host.send(body), Reason.ACCEPTED)

    ways: list[tuple[Callable[[Body], object], Callable[[Body], object]]] = [(bench.must, by_host)]
    if not host.typed:
        ways.append((by_host, bench.must))
    for begin, end in ways:
        enable(bench)
        begin(sequence)
        bench.order(Request.WATCHDOG, ms)
        bench.wait(2 * ms / 1000)
        expect("the state after twice the watchdog's time", bench.status().state, State.UNATTENDED)
        before = bench.clock().now
        end(TEST)
        after = bench.clock().now + PROMISED_PERIODS * TICKS_PER_PERIOD
        until_fired(bench, before, after, ms)


@every_door
@case("SAF-006", "SER-016", "REQ-010", "CON-008")
def test_the_drive_limit_holds_by_this_door(bench: Bench, host: Host) -> None:
    """By this door an UPDATE, a SLOT, a SEQUENCE and `test` above the drive limit are refused with DRIVE."""
    set_limit(bench, 2)
    if Feature.SEQUENCES in bench.info.features:
        bench.must(Slot(0, heavy(2)))
        bench.must(Entries((Entry(0, 100),)))
        let_stores_go(bench)
    set_limit(bench, 1)
    bench.enable()
    for body in host.able(Update(heavy(2)), Slot(1, heavy(2)), PlaySequence(0, 1)):
        expect(f"the reason for {body.KIND.name} of 2 transducers", host.send(body), Reason.DRIVE)
    expect("the reason for less than the limit", host.send(TEST), Reason.ACCEPTED)
    assert not host.order(Request.LIMIT, 2), "LIMIT is carried out while the outputs are enabled"
    assert host.order(Request.DISABLE), "DISABLE is refused"
    assert host.order(Request.LIMIT, 0), "LIMIT is refused while the outputs are off"
    expect("the drive limit in STATUS", bench.status().drive_limit, 0)
    bench.enable()
    expect("the reason for a pulse under a limit of 0", host.send(TEST), Reason.DRIVE)


@every_door
@case("SAF-007/1", "STA-005", "SER-016", needs=(Need.FAULTS,))
def test_a_fault_binds_this_door(bench: Bench, host: Host) -> None:
    """In FAULT changes and stores by this door are refused with FAULT, and ENABLE too; DISABLE is carried out."""
    bench.enable()
    bench.levers.cause(WrongSupply(millivolts=5000))
    bench.wait(0.1)
    for body in [*changes(host), *host.able(Slot(0, SILENT))]:
        expect(f"the reason for {body.KIND.name}", host.send(body), Reason.FAULT)
    assert not host.order(Request.ENABLE), "ENABLE is carried out in FAULT"
    for request in (Request.DISABLE, Request.CLEAR_FAULTS):
        assert host.order(request), f"{request.name} is refused in FAULT"
    status = bench.status()
    expect("state and faults", (status.state, status.faults), (State.FAULT, Fault.SUPPLY))


@every_door
@case("USB-020", "STA-003", "SER-016", outputs=("USB-020",), needs=(Need.SUSPEND,), allow=(Risk.RESET,), line="usb")
def test_suspend_silences_what_this_door_has_enabled(bench: Bench, host: Host, door: DoorRow) -> None:
    """A suspended bus turns the outputs off, whichever door has enabled them and plays, until ENABLE."""
    assert host.order(Request.ENABLE), "ENABLE is refused"
    expect("the reason for an update", host.send(TEST), Reason.ACCEPTED)
    expect("the state before", bench.status().state, State.PLAYING)
    with suspended(bench):
        began = bench.line.time.monotonic()
        bench.wait(0.03)
        if door.name == "uart":  # the others go over the bus
            assert not host.order(Request.ENABLE), "ENABLE by the UART is carried out while the bus is suspended"
            expect("the reason for an update while the bus is suspended", host.send(TEST), Reason.DISABLED)
    expect("the state after resume", bench.status().state, State.OFF)
    expect("the reason for an update after resume", host.send(TEST), Reason.DISABLED)
    judge_silence_since(bench, began)


# Steps


def begin(bench: Bench, line: RawSerialLine, door: str) -> None:
    """Enable the outputs by a door, with a long watchdog time; the other door must be told."""
    bench.order(Request.WATCHDOG, LONG_MS)
    if door == "usb":
        bench.enable()
    else:
        order(line, Request.ENABLE)
    check_told(bench, line, door, State.READY)


def accepted(bench: Bench, line: RawSerialLine, door: str, body: Body) -> Ack:
    """Send a block by a door; returns its acknowledgement, which must accept it."""
    if door == "usb":
        return bench.must(body)
    ack = send(line, pack(bench.numbered(body)))
    expect("the reason of a block by the serial line", ack.reason, Reason.ACCEPTED)
    return ack


def check_told(bench: Bench, line: RawSerialLine, door: str, state: State, period: int | None = None) -> None:
    """Fail unless the other door is told once that the device reached a state, in a period if it is known."""
    if door == "usb":
        line.listen(line.patience(), lambda: bool(statuses(line)))
        told = statuses(line)
        line.forget()
    else:
        told = [bench.await_unasked(line.patience())]
    expect("the states told at the other door", [status.state.name for status in told], [state.name])
    if period is not None:
        at = told[0].period
        assert period <= at < period + TOLD_PERIODS, f"{state.name} is told of period {at}, should be of {period}"
