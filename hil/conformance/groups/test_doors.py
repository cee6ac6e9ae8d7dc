"""Several doors to one device, and hosts that hang up while a block waits (chapters SER and ACK)."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from phasewire.emulator.faults import WrongSupply
from phasewire.hil.conformance.bench import RETURN_SECONDS, Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, TooSlow, case, expect
from phasewire.hil.conformance.lines.serial import RawSerialLine
from phasewire.hil.conformance.tools.exchange import (
    acks,
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
from phasewire.hil.conformance.tools.playing import play
from phasewire.hil.conformance.tools.steps import LONG_MS, enable, let_stores_go
from phasewire.hil.conformance.tools.watchdog import TICKS_PER_MS, await_firing, check_not_yet, patience
from phasewire.protocol.blocks import Body, Entries, Entry, Output, PlaySequence, Slot, Update, pack
from phasewire.protocol.board import CHANNELS, TICKS_PER_PERIOD
from phasewire.protocol.codes import Action, Fault, Feature, FrameKind, Reason, Request, State
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


@case("SER-010")
def test_the_end_of_a_connection_concerns_its_line_alone(bench: Bench, frames: RawSerialLine) -> None:
    """When a host closes its connection, what plays goes on, and the next connection begins with the console."""
    if not frames.wire.is_connection:
        raise Inconclusive("this line has no connection to close; one by socket: has")
    enable(bench)
    play(bench)
    before = bench.status()
    frames.wire.reopen(RETURN_SECONDS)
    frames.assume_console()
    frames.write(b"info\r")
    if not frames.answer():
        raise Inconclusive("the line still carries frames: perhaps a gateway to a UART does not pass the end on")
    frames.enter_frames()
    same_but(before, bench.status())


def check_judged(bench: Bench, line: RawSerialLine, before: Status) -> None:
    """Empty the queue: the block that waits must be accepted, and its answer must not be sent."""
    order(line, Request.DISABLE)
    line.rest()
    expect("the acknowledgements on the line", acks(line), [])
    after = bench.status()
    expect("the count of accepted blocks", after.accepted, before.accepted + 1)
    expect("the count of dropped frames", after.dropped_frames, before.dropped_frames)


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

DOORS = ("usb", "serial")


@case("SER-016", "ACK-006", "BLK-018", line="usb")
@pytest.mark.parametrize("door", DOORS)
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
@pytest.mark.parametrize("door", DOORS)
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


# One device with several doors


@case("STA-005", "CON-004/2", "SER-016", needs=(Need.FAULTS,), features=Feature.SEQUENCES | Feature.UNATTENDED)
@pytest.mark.parametrize("door", ["requests", "frames", "console"])
def test_every_door_stops_in_every_state(bench: Bench, frames: RawSerialLine, door: str) -> None:
    """DISABLE over this line or another, and `stop` at the console, work in each state, and end what is enabled."""
    stop: dict[str, Callable[[], None]] = {
        "requests": lambda: bench.order(Request.DISABLE),
        "frames": lambda: order(frames, Request.DISABLE),
        "console": lambda: typed_stop(frames),
    }
    for store in (Slot(0, Pulses.silent(CHANNELS)), Entries((Entry(0, 100),))):
        bench.must(store)
    let_stores_go(bench)
    plays: dict[State, Body | None] = {
        State.READY: None,
        State.PLAYING: Update(Pulses.silent(CHANNELS)),
        State.UNATTENDED: PlaySequence(0, 1, unattended=True),
    }
    for state, body in plays.items():
        enable(bench)
        if body is not None:
            bench.wait_until(bench.must(body).commit_period + 1)
        expect("the state before it", bench.status().state, state)
        stop[door]()
        expect(f"the state after it, in {state.name}", bench.status().state, State.OFF)
    stop[door]()
    expect("the state after it, in OFF", bench.status().state, State.OFF)
    bench.levers.cause(WrongSupply(millivolts=5000))
    bench.wait(0.1)
    stop[door]()
    status = bench.status()
    expect("state and faults after it, in FAULT", (status.state, status.faults), (State.FAULT, Fault.SUPPLY))


def typed_stop(line: RawSerialLine) -> None:
    """Type `stop`, which must be answered with ok, and return to frames."""
    line.enter_console()
    expect("the answer to stop", line.command("stop"), "ok\r\n")
    line.enter_frames()


@case("SAF-005", "SER-016", "SAF-003", line="usb", features=Feature.SEQUENCES | Feature.UNATTENDED)
@pytest.mark.parametrize("door", DOORS)
def test_an_update_by_any_door_wakes_the_watchdog(bench: Bench, frames: RawSerialLine, door: str) -> None:
    """An UPDATE that ends an unattended sequence starts the watchdog, whatever doors the two came through."""
    milliseconds = patience(bench)
    other = DOORS[DOORS.index(door) - 1]
    enable(bench)
    for store in (Slot(0, Pulses.silent(CHANNELS)), Entries((Entry(0, 100),))):
        bench.must(store)
    let_stores_go(bench)
    begun = accepted(bench, frames, other, PlaySequence(0, 1, unattended=True)).commit_period
    bench.wait_until(begun + 1)
    bench.order(Request.WATCHDOG, milliseconds)
    bench.wait(2 * milliseconds / 1000)
    expect("the state after twice the watchdog's time", bench.status().state, State.UNATTENDED)
    bench.listen(0.01)
    bench.unasked.clear()
    ends = accepted(bench, frames, door, Update(Pulses.silent(CHANNELS))).commit_period * TICKS_PER_PERIOD
    if door == "serial":
        told = bench.await_unasked(1)
        check_not_yet(bench, ends + milliseconds * TICKS_PER_MS, told.now)
        expect("the state told by USB", told.state, State.PLAYING)
    await_firing(bench, ends, ends, milliseconds)


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
