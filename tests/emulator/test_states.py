"""The states of a whole device, its transitions, and what goes with them (SPEC.md, chapters STA and SAF)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest
from phasewire import Emulator
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.door import Handshake, Stall
from phasewire.protocol.blocks import (
    Body,
    Clock,
    Entries,
    Entry,
    Modulation,
    NoOp,
    Output,
    Samples,
    Sequence,
    Slot,
    Update,
)
from phasewire.protocol.codes import Action, Fault, Outcome, Reason, Request, State, StatusFlag
from phasewire.protocol.replies import Ack, Status
from phasewire.protocol.states import TRANSITIONS, Event
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import FULL, HALF, PERIOD, PERIODS_PER_MS, Device, Terminal

MS = 400_000
FOR_EVER = Sequence(0, 1)
UNATTENDED = Sequence(0, 1, unattended=True)
TEN_PERIODS = Sequence(1, 1, repeats=2, unattended=True)
SUSPENDED_STATES = {State.SUSPENDED, State.UNATTENDED, State.FAULT}


def stocked(*, unfolded: bool = True, link: Link = FIVE_WIRE, configured: bool = True) -> Device:
    """A device that has something to play: slot 0 for 100 periods, and for five."""
    device = Device(Emulator(unfolded=unfolded, link=link), configured=True)
    device.send(Slot(0, FULL))
    device.send(Entries((Entry(0, 100), Entry(0, 5))))
    device.send(Samples(bytes([255, 128])))
    device.run(40)
    if not configured:
        device.usb.unplug()
        device.usb.plug()
    return device


def play(device: Device) -> None:
    device.send(Update(FULL))
    device.run(5)


def play_unattended(device: Device) -> None:
    device.send(UNATTENDED)
    device.run(5)


def reach(state: State, *, unfolded: bool = True) -> Device:
    """A device in a state, reached through its doors."""
    device = stocked(unfolded=unfolded)
    if state in (State.READY, State.PLAYING, State.UNATTENDED):
        device.order(Request.ENABLE)
    match state:
        case State.PLAYING:
            play(device)
        case State.UNATTENDED:
            play_unattended(device)
        case State.FAULT:
            device.set_temperature(86)
        case State.SUSPENDED:
            device.usb.suspend()
        case State.DFU:
            device.detach()
    assert device.state is state
    device.records()
    return device


@pytest.mark.parametrize("state", State)
def test_every_state_is_reached_and_told(state: State) -> None:
    """Clause STA-001; in DFU mode there is nobody to tell it."""
    device = reach(state)
    assert device.status().state is state


# Every state and every event (clause STA-003)


def by_door(device: Device, request: Request) -> None:
    """Ask by USB or, where the bus is suspended, by the serial line; STALL is an answer too."""
    if not device.usb.suspended:
        with suppress(Stall):
            device.order(request)
        return
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    terminal.order(request)


def send_by_door(device: Device, body: Update | Sequence | Output) -> None:
    if not device.usb.suspended:
        device.send(body)
    else:
        terminal = Terminal(device.emulator.line)
        terminal.enter_frames()
        terminal.send(device.pack(body))
    device.run(8)


def fall_silent(device: Device) -> None:
    """No sign of life for longer than the watchdog's time."""
    device.run_ms(101)


def clear(device: Device) -> None:
    device.set_temperature(25)
    by_door(device, Request.CLEAR_FAULTS)


def suspend(device: Device) -> None:
    device.usb.suspend()


def suspend_and_resume(device: Device) -> None:
    device.usb.suspend()
    device.usb.resume()


def detach(device: Device) -> None:
    if not device.usb.suspended:
        with suppress(Stall):
            device.detach()
    else:
        Terminal(device.emulator.line).type("dfu")


def cut_power(device: Device) -> None:
    device.emulator.power_down()
    device.run_ms(5)
    device.emulator.power_up()
    device.emulator.run_until_started()


def ask_to_reset(device: Device) -> None:
    by_door(device, Request.RESET)
    device.run_until_started()


def ask_to_revert(device: Device) -> None:
    by_door(device, Request.REVERT)
    device.run_until_started()


def reset_dfu_mode(device: Device) -> None:
    device.run_ms(50)
    device.configure()
    device.usb.reset()
    device.emulator.run_until_started()


CAUSES: dict[Event, tuple[Callable[[Device], None], ...]] = {
    Event.ENABLE: (lambda device: by_door(device, Request.ENABLE),),
    Event.DISABLE: (
        lambda device: by_door(device, Request.DISABLE),
        lambda device: send_by_door(device, Output(Action.DISABLE)),
    ),
    Event.PLAY: (
        lambda device: send_by_door(device, Update(HALF)),
        lambda device: send_by_door(device, FOR_EVER),
    ),
    Event.PLAY_UNATTENDED: (lambda device: send_by_door(device, UNATTENDED),),
    Event.END: (lambda device: send_by_door(device, Output(Action.SILENCE)),),
    Event.WATCHDOG: (fall_silent,),
    Event.FAULT: (lambda device: device.set_temperature(90),),
    Event.CLEAR: (clear,),
    Event.BUS_RESET: (lambda device: device.usb.reset(), Device.configure, Device.set_interface),
    Event.SUSPEND: (suspend,),
    Event.RESUME: (lambda device: device.usb.resume(), suspend_and_resume),
    Event.DETACH: (detach,),
    Event.RESTART: (cut_power, ask_to_reset, ask_to_revert, reset_dfu_mode),
}


def rows() -> Iterator[tuple[State, Event, int]]:
    """What can be brought about; a suspended bus carries no requests, and resumes only once."""
    for state in State:
        for event, causes in CAUSES.items():
            for number, cause in enumerate(causes):
                by_bus = event is Event.BUS_RESET and number > 0
                if by_bus and state is State.SUSPENDED:
                    continue
                if cause is suspend_and_resume and state not in SUSPENDED_STATES - {State.SUSPENDED}:
                    continue
                if cause is reset_dfu_mode and state is not State.DFU:
                    continue
                if cause in (ask_to_reset, ask_to_revert) and state is State.DFU:
                    continue
                yield state, event, number


@pytest.mark.parametrize(
    ("state", "event", "number"), [pytest.param(*row, id=f"{row[0].name}-{row[1].name}-{row[2]}") for row in rows()]
)
def test_every_state_and_event(state: State, event: Event, number: int) -> None:
    device = reach(state)
    CAUSES[event][number](device)
    assert device.state is TRANSITIONS[state, event]


# What goes with a transition (the last column of clause STA-003)


LEAVING: dict[str, Callable[[Device], None]] = {
    "DISABLE": lambda device: device.order(Request.DISABLE),
    "WATCHDOG": fall_silent,
    "BUS_RESET": lambda device: device.usb.reset(),
    "SET_CONFIGURATION": Device.configure,
    "SET_INTERFACE": Device.set_interface,
    "SUSPEND": suspend,
    "FAULT": lambda device: device.set_temperature(90),
    "DETACH": Device.detach,
}
EVENTS_OF = {"SET_CONFIGURATION": Event.BUS_RESET, "SET_INTERFACE": Event.BUS_RESET}


def leaving() -> Iterator[tuple[State, str]]:
    for state in (State.READY, State.PLAYING, State.UNATTENDED):
        for name in LEAVING:
            if TRANSITIONS[state, EVENTS_OF.get(name) or Event[name]] is not state:
                yield state, name


@pytest.mark.parametrize(("state", "name"), [pytest.param(*row, id=f"{row[0].name}-{row[1]}") for row in leaving()])
def test_whatever_ends_it_silences_and_drops_what_is_queued(state: State, name: str) -> None:
    device = reach(state)
    device.send(Modulation(0, 2, hold=3))
    device.run(6)
    later = device.period + 4200  # after the watchdog's time
    device.send(Update(HALF, later))
    LEAVING[name](device)
    at, status = device.period, device.status()
    assert (status.free, status.since_period) == (QUEUE_BLOCKS, 0)
    assert not status.flags & (StatusFlag.SEQUENCE | StatusFlag.MODULATION)
    device.run_until((later + 50) * PERIOD)
    assert max(device.high_periods(), default=0) < at + 6
    assert (state is State.READY) == (not device.high_periods())


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE], ids=lambda link: link.name)
@pytest.mark.parametrize("phase", range(0, PERIOD, 1234))
@pytest.mark.parametrize("what", ["update", "sequence", "modulated", "waiting"])
def test_silence_comes_within_six_periods(link: Link, phase: int, what: str) -> None:
    """Clause SAF-004, whenever the request comes and whatever is on its way."""
    device = stocked(unfolded=False, link=link)
    device.order(Request.ENABLE)
    soon = device.period + 10
    if what == "modulated":
        device.send(Modulation(0, 2, hold=1, period=soon - 3))
    if what == "sequence":
        device.send(FOR_EVER)
    else:
        device.send(Update(FULL, soon))
    if what == "waiting":
        device.send_in_time(*(Update(HALF) for _ in range(4)))
    device.run_until((soon + 1) * PERIOD + phase)
    device.order(Request.DISABLE)
    at = device.period
    device.run(400)
    assert at in device.high_periods()
    assert max(device.high_periods()) < at + 6
    assert device.status().missed_commits == 0


@pytest.mark.parametrize("unfolded", [False, True])
@pytest.mark.parametrize(("after", "begins"), [(-1, False), (0, True), (1, True)])
def test_what_goes_onto_the_chain_in_the_cycle_of_the_request_has_begun(
    unfolded: bool, after: int, begins: bool
) -> None:
    """Clauses SAF-004 and CHN-029: 5440 cycles of links, 400 of hops and 4400 to rasterise, ready one period before."""
    device = Device(Emulator(unfolded=unfolded), enabled=True)
    device.send(Update(FULL, 30))
    device.run_until(29 * PERIOD - 10_240 + after)
    device.order(Request.DISABLE)
    device.run_ms(25)
    assert bool(device.high_periods()) == begins
    assert (device.status().missed_commits, device.status().faults) == (0, Fault(0))


@pytest.mark.parametrize("unfolded", [False, True])
def test_what_is_begun_in_the_cycle_in_which_it_is_overtaken_is_begun_whole(unfolded: bool) -> None:
    """It is sorted in 6000 cycles, and goes onto the chain when the bus reset comes that was planned before it."""
    device = Device(Emulator(unfolded=unfolded), enabled=True)
    device.emulator.scheduler.at(device.emulator.running.time.boundary(30), device.usb.reset)
    device.run_until(30 * PERIOD - 6000)
    device.usb.bulk_out(0x01, device.pack(Update(FULL)))
    device.run_ms(25)
    assert device.high_periods() == {32}
    assert (device.state, device.status().faults) == (State.OFF, Fault(0))


@pytest.mark.parametrize("state", [State.OFF, State.FAULT, State.SUSPENDED, State.DFU])
def test_a_state_in_which_the_outputs_are_off_lets_nothing_in(state: State) -> None:
    """Clauses SAF-002 and SAF-007, block by block, by a door that is open in all of them."""
    device = reach(state)
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    off = Reason.FAULT if state is State.FAULT else Reason.DISABLED
    stores = Reason.FAULT if state is State.FAULT else Reason.ACCEPTED
    answers: list[tuple[Body, Reason]] = [
        (Update(HALF), off),
        (FOR_EVER, off),
        (Modulation(0, 1, hold=1), off),
        (Output(Action.SILENCE), off),
        (Slot(9, HALF), stores),
        (Entries((Entry(9, 1),), first=9), stores),
        (Samples(b"\x80", first=9), stores),
        (Clock(), Reason.ACCEPTED),
        (NoOp(), Reason.ACCEPTED),
    ]
    for body, reason in answers:
        (ack,) = terminal.send(device.pack(body))
        assert isinstance(ack, Ack)
        assert (ack.reason, ack.state) == (reason, state), body


@pytest.mark.parametrize("state", State)
def test_what_is_always_carried_out_and_what_only_where_it_leads_somewhere(state: State) -> None:
    """Clause STA-005."""
    device = reach(state)
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    enables = state in (State.OFF, State.READY, State.PLAYING, State.UNATTENDED)
    detaches = enables or state is State.FAULT
    assert terminal.order(Request.ENABLE) is (Outcome.DONE if enables else Outcome.STALL)
    assert terminal.order(Request.DISABLE) is Outcome.DONE
    assert terminal.order(Request.CLEAR_FAULTS) is Outcome.DONE
    terminal.leave_frames()
    device = reach(state)
    answer = Terminal(device.emulator.line).type("dfu")
    assert answer.startswith("dfu\r\nok" if detaches else "dfu\r\nerror 6")
    assert device.state is (State.DFU if detaches else state)


def test_in_dfu_mode_a_serial_line_is_silent() -> None:
    device = reach(State.DFU)
    device.run_ms(50)
    assert device.emulator.line is None


# The watchdog (clause SAF-003)


def fires_at(device: Device) -> int:
    """Core cycle at which the watchdog fires; nobody gives a sign of life."""
    while not device.status().watchdog_fired:
        upcoming = device.emulator.scheduler.next_time()
        assert upcoming is not None
        device.emulator.scheduler.run_until(upcoming)
    return device.cycle


def in_time(fired: int, since: int, ms: int = 100) -> bool:
    return since + ms * MS <= fired <= since + ms * MS + PERIOD


@pytest.mark.parametrize("unfolded", [False, True])
def test_the_watchdog_starts_with_enable(unfolded: bool) -> None:
    device = stocked(unfolded=unfolded)
    device.run_ms(3.3)
    device.order(Request.ENABLE)
    assert in_time(fires_at(device), 40 * PERIOD + round(3.3 * MS))
    assert device.state is State.OFF


def test_the_watchdog_does_not_start_anew_where_it_did_not_rest() -> None:
    """An update that begins, and an attended sequence that ends, are no signs of life."""
    device = stocked()
    device.order(Request.ENABLE)
    fed = device.cycle
    device.send(Sequence(1, 1, repeats=2))
    device.run_ms(50)
    assert device.state is State.READY
    assert in_time(fires_at(device), fed)


def test_the_watchdog_starts_where_a_sequence_that_rested_it_ends() -> None:
    device = stocked()
    device.order(Request.ENABLE)
    ack = device.send(Sequence(0, 1, repeats=50, unattended=True))
    ends = (ack.commit_period + 50 * 100) * PERIOD
    device.run_until(ends - 1)
    assert device.state is State.UNATTENDED
    assert in_time(fires_at(device), ends)


def test_the_watchdog_starts_where_an_update_follows_what_went_on_alone() -> None:
    device = stocked()
    device.order(Request.ENABLE)
    device.send(UNATTENDED)
    device.run_ms(150)
    ack = device.send(Update(HALF, device.period + 6000))
    assert in_time(fires_at(device), ack.commit_period * PERIOD)


def test_output_blocks_end_what_rested_the_watchdog() -> None:
    device = stocked()
    device.order(Request.ENABLE)
    device.send(UNATTENDED)
    device.run_ms(150)
    ack = device.send(Output(Action.SILENCE, device.period + 6000))
    assert in_time(fires_at(device), ack.commit_period * PERIOD)


SIGNS: dict[str, tuple[bool, Callable[[Device, Terminal], object]]] = {
    "an update": (True, lambda device, _: device.send(Update(HALF))),
    "a change for later": (True, lambda device, _: device.send(Update(HALF, device.period + 10**6))),
    "a slot": (True, lambda device, _: device.send(Slot(3, HALF))),
    "a clock block": (True, lambda device, _: device.send(Clock())),
    "nothing": (True, lambda device, _: device.send(NoOp())),
    "STATUS": (True, lambda device, _: device.ask_status()),
    "ENABLE": (True, lambda device, _: device.order(Request.ENABLE)),
    "STATUS by the line": (True, lambda _, terminal: terminal.type("status")),
    "faults by the line": (True, lambda _, terminal: terminal.type("faults")),
    "a test by the line": (True, lambda _, terminal: terminal.type("test 5")),
    "a refused block": (False, lambda device, _: device.send(Sequence(500, 1))),
    "a refused test": (False, lambda _, terminal: terminal.type("test 320")),
    "a block that came twice": (False, lambda device, _: device.send(NoOp(), device.number - 1)),
    "INFO": (False, lambda device, _: device.info()),
    "CLOCK": (False, lambda device, _: device.ask(Request.CLOCK, 24)),
    "PULSES": (False, lambda device, _: device.read_back()),
    "PROCESSORS": (False, lambda device, _: device.ask(Request.PROCESSORS, 160)),
    "WATCHDOG": (False, lambda device, _: device.order(Request.WATCHDOG, 100)),
    "IDENTIFY": (False, lambda device, _: device.order(Request.IDENTIFY, 1)),
    "CLEAR_FAULTS": (False, lambda device, _: device.order(Request.CLEAR_FAULTS)),
    "an empty line": (False, lambda _, terminal: terminal.type("")),
}


@pytest.mark.parametrize("name", SIGNS)
def test_what_is_a_sign_of_life(name: str) -> None:
    feeds, sign = SIGNS[name]
    device = stocked(unfolded=False)
    device.order(Request.ENABLE)
    since = device.cycle
    device.run_ms(60)
    fed = device.cycle
    sign(device, Terminal(device.emulator.line))
    assert in_time(fires_at(device), fed if feeds else since)


def test_a_block_that_the_queue_has_no_room_for_is_no_sign_of_life() -> None:
    """Neither one that was answered with NAK nor one that waits on a line."""
    device = stocked()
    device.order(Request.ENABLE)
    for number in range(QUEUE_BLOCKS):
        device.send(Update(HALF, 10**6 + number))
    since = device.cycle
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    for ms in (30, 60, 90):
        device.run_until(since + ms * MS)
        assert device.usb.bulk_out(0x01, device.pack(NoOp())) is Handshake.NAK
        assert terminal.send(device.pack(NoOp())) == []
    assert in_time(fires_at(device), since)


@pytest.mark.parametrize(("first_ms", "then_ms"), [(100, 500), (500, 100), (60_000, 10)])
def test_a_watchdog_time_holds_at_once_from_the_last_sign_of_life(first_ms: int, then_ms: int) -> None:
    """Clause REQ-009: shorter than what has passed already, it fires at once."""
    device = stocked(unfolded=False)
    device.order(Request.WATCHDOG, first_ms)
    device.order(Request.ENABLE)
    since = device.cycle
    device.run_ms(50)
    changed = device.cycle
    device.order(Request.WATCHDOG, then_ms)
    fired = fires_at(device)
    assert in_time(fired, since, then_ms) if then_ms > 50 else changed <= fired <= changed + PERIOD


def test_a_watchdog_that_has_fired_is_told_until_the_outputs_are_enabled() -> None:
    device = stocked(unfolded=False)
    device.order(Request.ENABLE)
    fall_silent(device)
    assert device.ask_status().flags == StatusFlag.WATCHDOG_FIRED
    device.order(Request.ENABLE)
    assert device.ask_status().flags == StatusFlag(0)
    device.order(Request.DISABLE)
    fall_silent(device)
    assert device.ask_status().flags == StatusFlag(0)


# What goes on without the host (clause SAF-005)


def test_what_may_go_on_without_the_host_does() -> None:
    """Watchdog, suspend, and a cable that is pulled and put back; not the reset that follows."""
    device = stocked(unfolded=False)
    device.order(Request.ENABLE)
    device.send(UNATTENDED)
    device.run_ms(500)
    device.usb.suspend()
    device.run_ms(500)
    assert device.state is State.UNATTENDED
    device.usb.resume()
    device.usb.unplug()
    device.run_ms(500)
    device.usb.plug()
    device.run_ms(100)
    assert device.state is State.UNATTENDED
    assert device.period - 1 in device.high_periods()
    device.usb.reset()
    assert device.status().state is State.OFF
    device.run(6)
    assert device.period - 1 not in device.high_periods()


def test_a_sequence_may_go_on_without_the_host_only_where_it_says_so() -> None:
    device = stocked(unfolded=False)
    device.order(Request.ENABLE)
    device.send(FOR_EVER)
    device.run(8)
    assert device.state is State.PLAYING
    fall_silent(device)
    assert device.status().state is State.OFF


@pytest.mark.parametrize("body", [Update(HALF), FOR_EVER], ids=["update", "sequence"])
def test_what_follows_what_went_on_alone_needs_its_host(body: Update | Sequence) -> None:
    device = reach(State.UNATTENDED, unfolded=False)
    device.send(body)
    device.run(8)
    assert device.state is State.PLAYING
    device.send(UNATTENDED)
    device.run(8)
    assert device.status().state is State.UNATTENDED


# The bus (clauses STA-004, STA-006 and USB-020)


def among_frames(device: Device) -> Terminal:
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    return terminal


def leave_by_its_end(device: Device) -> None:
    device.run(1100)


LEFT: dict[str, tuple[State, Sequence, Callable[[Device], object]]] = {
    "by its end": (State.SUSPENDED, Sequence(0, 1, repeats=10, unattended=True), leave_by_its_end),
    "for an update": (State.SUSPENDED, UNATTENDED, lambda d: among_frames(d).send(d.pack(Update(HALF)))),
    "for silence": (State.SUSPENDED, UNATTENDED, lambda d: among_frames(d).send(d.pack(Output(Action.SILENCE)))),
    "by a request": (State.SUSPENDED, UNATTENDED, lambda d: among_frames(d).order(Request.DISABLE)),
    "by a block": (State.SUSPENDED, UNATTENDED, lambda d: among_frames(d).send(d.pack(Output(Action.DISABLE)))),
    "by a fault": (State.FAULT, UNATTENDED, lambda d: d.set_temperature(90)),
    "by a reset": (State.OFF, UNATTENDED, lambda d: d.usb.reset()),
}


@pytest.mark.parametrize("name", LEFT)
def test_a_state_that_ignored_suspend_is_left_while_the_bus_is_suspended(name: str) -> None:
    """Clause STA-004."""
    expected, body, leave = LEFT[name]
    device = stocked()
    device.order(Request.ENABLE)
    device.send(body)
    device.run(8)
    device.usb.suspend()
    device.run(50)
    assert device.state is State.UNATTENDED
    leave(device)
    left = device.period
    device.run(8)
    assert device.state is expected
    device.run(20)
    assert max(device.high_periods()) < left + 12
    assert not device.status().watchdog_fired


def test_a_fault_that_is_cleared_leads_to_a_bus_that_is_suspended() -> None:
    device = reach(State.FAULT)
    device.usb.suspend()
    assert device.state is State.FAULT
    clear(device)
    assert device.status().state is State.SUSPENDED
    device.usb.resume()
    assert device.status().state is State.OFF


def test_a_bus_that_resumed_while_it_was_ignored_suspends_no_more() -> None:
    device = reach(State.UNATTENDED)
    device.usb.suspend()
    device.usb.resume()
    device.order(Request.DISABLE)
    assert device.state is State.OFF


def test_resume_finds_the_device_as_it_was_but_disabled() -> None:
    """Clause USB-020."""
    device = reach(State.PLAYING)
    assert device.usb.bulk_out(0x01, device.pack(NoOp())) is Handshake.ACK
    device.usb.suspend()
    device.run_ms(20)
    device.usb.resume()
    assert (device.state, device.usb.configuration) == (State.OFF, 1)
    waiting = device.records()
    assert [type(record) for record in waiting] == [Ack, Status]
    device.order(Request.ENABLE)
    assert device.send(Update(HALF)).reason is Reason.ACCEPTED  # numbers go on


@pytest.mark.parametrize("happen", [suspend, lambda device: device.usb.unplug()], ids=["suspend", "unplug"])
def test_a_device_that_no_bus_has_configured_is_not_suspended(happen: Callable[[Device], None]) -> None:
    """Clause STA-006: it plays for a host at its serial line."""
    device = Device(configured=False)
    terminal = among_frames(device)
    assert terminal.order(Request.ENABLE) is Outcome.DONE
    terminal.send(device.pack(Update(FULL)))
    device.run(8)
    happen(device)
    assert device.state is State.PLAYING
    device.usb.resume()
    assert device.state is State.PLAYING


def test_the_voltage_takes_the_configuration_with_it() -> None:
    """Clause STA-006: SUSPEND and RESUME follow each other, and another bus is none that has configured it."""
    device = reach(State.PLAYING)
    terminal = among_frames(device)
    device.usb.unplug()
    assert (device.state, device.usb.configuration) == (State.OFF, 0)
    assert terminal.order(Request.ENABLE) is Outcome.DONE
    device.usb.plug()
    device.usb.suspend()
    assert device.state is State.READY


def test_a_cable_that_is_pulled_while_the_bus_is_suspended_leaves_it_off() -> None:
    device = reach(State.SUSPENDED)
    device.usb.unplug()
    assert device.state is State.OFF
    assert among_frames(device).order(Request.ENABLE) is Outcome.DONE


# Records that nobody asked for (clause ACK-006)


class Doors:
    """A host at USB, one at the UART among frames, and what each of them was told unasked."""

    def __init__(self, state: State) -> None:
        self.device = reach(state)
        self.terminal = among_frames(self.device)

    def told(self) -> tuple[list[State], list[State]]:
        return [told.state for told in self.device.told()], [told.state for told in self.terminal.told()]


TOLD_TO_BOTH: dict[str, tuple[State, State, Callable[[Device], object]]] = {
    "WATCHDOG": (State.PLAYING, State.OFF, fall_silent),
    "FAULT": (State.PLAYING, State.FAULT, lambda device: device.set_temperature(90)),
    "RESUME": (State.SUSPENDED, State.OFF, lambda device: device.usb.resume()),
    "SUSPEND": (State.PLAYING, State.SUSPENDED, suspend),
}


@pytest.mark.parametrize("name", TOLD_TO_BOTH)
def test_what_just_happens_is_told_to_every_door(name: str) -> None:
    begins, ends, happen = TOLD_TO_BOTH[name]
    doors = Doors(begins)
    happen(doors.device)
    assert doors.told() == ([ends], [ends])


def test_the_end_of_a_sequence_is_told_to_every_door() -> None:
    doors = Doors(State.READY)
    doors.device.send(TEN_PERIODS)
    doors.device.run(8)
    assert doors.told() == ([], [State.UNATTENDED])
    doors.device.run(10)
    assert doors.told() == ([State.READY], [State.READY])


def line_request(request: Request) -> Callable[[Doors], object]:
    return lambda doors: doors.terminal.order(request)


def usb_request(request: Request) -> Callable[[Doors], object]:
    return lambda doors: doors.device.order(request)


def line_block(body: Update | Sequence | Output) -> Callable[[Doors], object]:
    def send(doors: Doors) -> None:
        (ack,) = doors.terminal.send(doors.device.pack(body))
        assert isinstance(ack, Ack)
        assert ack.reason is Reason.ACCEPTED
        doors.device.run(8)

    return send


def usb_block(body: Update | Sequence | Output) -> Callable[[Doors], object]:
    def send(doors: Doors) -> None:
        assert doors.device.send(body).reason is Reason.ACCEPTED
        doors.device.run(8)

    return send


def type_dfu(doors: Doors) -> None:
    doors.terminal.leave_frames()
    doors.terminal.type("dfu")


TOLD_TO_THE_OTHER: dict[str, tuple[State, State, bool, Callable[[Doors], object]]] = {
    "ENABLE by USB": (State.OFF, State.READY, True, usb_request(Request.ENABLE)),
    "ENABLE by line": (State.OFF, State.READY, False, line_request(Request.ENABLE)),
    "DISABLE by USB": (State.PLAYING, State.OFF, True, usb_request(Request.DISABLE)),
    "DISABLE by line": (State.PLAYING, State.OFF, False, line_request(Request.DISABLE)),
    "update by USB": (State.READY, State.PLAYING, True, usb_block(Update(HALF))),
    "update by line": (State.READY, State.PLAYING, False, line_block(Update(HALF))),
    "sequence by USB": (State.READY, State.UNATTENDED, True, usb_block(UNATTENDED)),
    "sequence by line": (State.READY, State.UNATTENDED, False, line_block(UNATTENDED)),
    "silence by USB": (State.PLAYING, State.READY, True, usb_block(Output(Action.SILENCE))),
    "silence by line": (State.PLAYING, State.READY, False, line_block(Output(Action.SILENCE))),
    "disabling by USB": (State.PLAYING, State.OFF, True, usb_block(Output(Action.DISABLE))),
    "disabling by line": (State.PLAYING, State.OFF, False, line_block(Output(Action.DISABLE))),
    "SET_INTERFACE": (State.PLAYING, State.OFF, True, lambda doors: doors.device.set_interface()),
    "SET_CONFIGURATION": (State.PLAYING, State.OFF, True, lambda doors: doors.device.configure()),
    "bus reset": (State.PLAYING, State.OFF, True, lambda doors: doors.device.usb.reset()),
    "DETACH by USB": (State.PLAYING, State.DFU, True, lambda doors: doors.device.detach()),
}


@pytest.mark.parametrize("name", TOLD_TO_THE_OTHER)
def test_what_came_through_one_door_is_told_to_the_other(name: str) -> None:
    begins, ends, by_usb, happen = TOLD_TO_THE_OTHER[name]
    doors = Doors(begins)
    happen(doors)
    assert doors.told() == (([], [ends]) if by_usb else ([ends], []))


def test_a_detach_by_the_console_is_told_on_usb_before_the_device_leaves() -> None:
    doors = Doors(State.READY)
    type_dfu(doors)
    assert doors.told() == ([State.DFU], [])


def test_a_test_by_the_console_is_told_on_usb() -> None:
    device = reach(State.READY)
    Terminal(device.emulator.line).type("test 3")
    device.run(8)
    assert [told.state for told in device.told()] == [State.PLAYING]


def test_a_stream_of_updates_is_told_to_the_line_once() -> None:
    doors = Doors(State.READY)
    doors.device = stocked(unfolded=False)
    doors.device.order(Request.ENABLE)
    doors.terminal = among_frames(doors.device)
    doors.device.send(Update(HALF))
    blocks = b"".join(doors.device.pack(Update(HALF)) for _ in range(6))
    now = doors.device.emulator.scheduler.now
    taken, _ = doors.device.usb.stream_out(0x01, memoryview(blocks), now, now + MS)
    assert taken
    doors.device.run(20)
    assert doors.told() == ([], [State.PLAYING])


def test_what_changes_no_state_is_told_to_nobody() -> None:
    doors = Doors(State.PLAYING)
    doors.device.order(Request.ENABLE)
    doors.device.order(Request.CLEAR_FAULTS)
    doors.device.send(Update(HALF))
    doors.terminal.send(doors.device.pack(FOR_EVER))
    doors.device.run(8)
    assert doors.told() == ([], [])


def test_faults_that_change_are_told_to_every_door_also_where_the_state_stays() -> None:
    doors = Doors(State.PLAYING)
    doors.device.emulator.processors[2].receive(b"rubbish")
    doors.device.run_ms(12)
    for told in (doors.device.told(), doors.terminal.told()):
        assert [(record.state, record.faults) for record in told] == [(State.PLAYING, Fault.CHAIN)]
    doors.device.order(Request.CLEAR_FAULTS)
    for told in (doors.device.told(), doors.terminal.told()):
        assert [(record.state, record.faults) for record in told] == [(State.PLAYING, Fault(0))]


def test_a_newer_record_takes_the_place_of_an_older_one_behind_what_waits() -> None:
    doors = Doors(State.PLAYING)
    device = doors.device
    fall_silent(device)
    assert device.usb.bulk_out(0x01, device.pack(NoOp())) is Handshake.ACK
    device.usb.suspend()
    device.usb.resume()
    first, second = device.records()
    assert isinstance(first, Ack)
    assert isinstance(second, Status)
    assert (second.state, second.watchdog_fired) == (State.OFF, True)
    assert doors.told()[1] == [State.OFF]


def test_a_console_is_told_nothing_unasked() -> None:
    device = reach(State.PLAYING)
    terminal = Terminal(device.emulator.line)
    fall_silent(device)
    assert terminal.shown() == ""


@pytest.mark.parametrize(
    "begin_anew", [lambda d: d.usb.reset(), Device.configure, Device.set_interface], ids=["bus", "device", "interface"]
)
def test_a_new_session_drops_the_records_that_wait(begin_anew: Callable[[Device], None]) -> None:
    device = reach(State.PLAYING)
    fall_silent(device)
    for _ in range(3):
        device.usb.bulk_out(0x01, device.pack(NoOp()))
    begin_anew(device)
    if not device.usb.configuration:
        device.configure()
    assert device.records() == []


# Faults (clauses SAF-007, SAF-008 and REQ-011)


def test_a_processor_that_is_too_hot_silences_itself_and_the_controller_the_others() -> None:
    device = reach(State.PLAYING)
    device.run_until((device.period + 2) * PERIOD + 3000)
    hot = device.period
    device.emulator.processors[3].set_temperature(86)
    assert device.state is State.PLAYING  # nobody has asked it yet
    while device.state is State.PLAYING:
        device.run(1)
    learned = device.period
    assert learned <= hot + 10 * PERIODS_PER_MS + 1
    device.run(10)
    capture = device.emulator.capture()
    high = capture.bits(0, capture.periods * 50).reshape(-1, 50, 10).any(axis=1)
    assert high[hot, 3]
    assert not high[hot + 1 :, 3].any()
    assert high[hot + 1 : learned - 1].any(axis=1).all()
    assert not high[learned + 6 :].any()
    assert (device.status().faults, device.status().temperature_c) == (Fault.TEMPERATURE, 86)


def test_faults_persist_until_their_cause_is_gone_and_they_are_cleared() -> None:
    """A board is cool again below 80 °C."""
    device = reach(State.FAULT)
    for celsius, state in ((86, State.FAULT), (80, State.FAULT), (79, State.OFF)):
        device.set_temperature(celsius)
        device.order(Request.CLEAR_FAULTS)
        assert device.state is state
        with suppress(Stall):
            device.order(Request.ENABLE)
        assert device.state is (State.FAULT if state is State.FAULT else State.READY)
    assert device.status().faults == Fault(0)


@pytest.mark.parametrize("millivolts", [11_999, 18_001])
def test_a_supply_outside_its_limits_silences(millivolts: int) -> None:
    device = reach(State.PLAYING)
    processor = device.emulator.processors[9]
    for fine in (12_000, 18_000):
        processor.set_supply(fine)
        device.run_ms(12)
    assert device.state is State.PLAYING
    processor.set_supply(millivolts)
    device.run_ms(12)
    assert (device.state, device.status().faults) == (State.FAULT, Fault.SUPPLY)
    device.order(Request.CLEAR_FAULTS)
    assert device.status().faults == Fault.SUPPLY
    processor.set_supply(15_000)
    device.run_ms(12)
    assert device.status().faults == Fault.SUPPLY
    device.order(Request.CLEAR_FAULTS)
    assert (device.state, device.status().faults) == (State.OFF, Fault(0))


def test_a_clock_that_was_lost_is_cleared_by_a_reset_only() -> None:
    device = reach(State.PLAYING)
    for processor in device.emulator.processors:
        processor.sync_connected = False
    device.order(Request.WATCHDOG, 60_000)
    device.run_ms(130)
    assert (device.state, device.status().faults) == (State.FAULT, Fault.SYNC)
    for processor in device.emulator.processors:
        processor.sync_connected = True
    device.run_ms(130)
    device.order(Request.CLEAR_FAULTS)
    assert (device.state, device.status().faults) == (State.FAULT, Fault.SYNC)
    device.order(Request.RESET)
    device.run_until_started()
    assert (device.state, device.status().faults) == (State.OFF, Fault(0))


def test_a_fault_that_silences_nothing_leaves_what_plays() -> None:
    device = reach(State.PLAYING)
    device.emulator.processors[2].receive(b"rubbish")
    device.run_ms(12)
    assert (device.state, device.status().faults) == (State.PLAYING, Fault.CHAIN)
    assert device.status().damaged_messages == 1
    assert device.send(Update(HALF)).reason is Reason.ACCEPTED
    device.order(Request.CLEAR_FAULTS)
    assert (device.status().faults, device.status().damaged_messages) == (Fault(0), 1)


# From power-up on (clause SAF-001)


def test_nothing_is_high_before_the_first_update_in_any_life_of_the_device() -> None:
    device = reach(State.PLAYING)
    began = min(device.high_periods())
    assert began > 40
    device.order(Request.RESET)
    device.run_until_started()
    device.run(400)
    assert device.high_periods() == set()
    (before,) = device.emulator.past
    assert before.bits(0, began * 50).any() is np.False_
