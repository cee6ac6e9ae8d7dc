"""States: transitions, events without a transition, and what the device reports (chapter STA)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, Risk, case, expect
from phasewire.hil.conformance.sight.waveforms import check_silent
from phasewire.hil.conformance.tools.doors import Host
from phasewire.hil.conformance.tools.exchange import order, statuses
from phasewire.hil.conformance.tools.player import check_in_time, soon
from phasewire.hil.conformance.tools.playing import HOT_PERIODS, expect_state, heat, play, reach, told
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    MOST_ENTRY_PERIODS,
    SILENT,
    enable,
    expect_all,
    let_stores_go,
    require,
    store_entry,
    suspended,
)
from phasewire.hil.conformance.tools.watchdog import (
    PERIODS_PER_MS,
    await_firing,
    check_not_yet,
    let_watchdog_fire,
    patience,
)
from phasewire.hil.conformance.transports.serial import RawSerialLine
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
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
from phasewire.protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import BLOCK_BYTES, Action, Fault, Feature, Reason, Request, State
from phasewire.protocol.replies import Status

OFF, READY, PLAYING, UNATTENDED = State.OFF, State.READY, State.PLAYING, State.UNATTENDED
FAULT, SUSPENDED, DFU = State.FAULT, State.SUSPENDED, State.DFU

LEADS_TO: dict[str, dict[State, State]] = {
    "ENABLE": {OFF: READY, READY: READY, PLAYING: PLAYING, UNATTENDED: UNATTENDED, FAULT: FAULT},
    "DISABLE": {OFF: OFF, READY: OFF, PLAYING: OFF, UNATTENDED: OFF, FAULT: FAULT},
    "PLAY": {OFF: OFF, READY: PLAYING, PLAYING: PLAYING, UNATTENDED: PLAYING, FAULT: FAULT},
    "PLAY_UNATTENDED": {OFF: OFF, READY: UNATTENDED, PLAYING: UNATTENDED, UNATTENDED: UNATTENDED, FAULT: FAULT},
    "END": {OFF: OFF, READY: READY, PLAYING: READY, UNATTENDED: READY, FAULT: FAULT},
    "WATCHDOG": {OFF: OFF, READY: OFF, PLAYING: OFF, UNATTENDED: UNATTENDED, FAULT: FAULT},
    "FAULT": {OFF: FAULT, READY: FAULT, PLAYING: FAULT, UNATTENDED: FAULT, FAULT: FAULT, SUSPENDED: FAULT},
    "CLEAR": {OFF: OFF, READY: READY, PLAYING: PLAYING, UNATTENDED: UNATTENDED, FAULT: OFF},
    "BUS_RESET": {OFF: OFF, READY: OFF, PLAYING: OFF, UNATTENDED: OFF, FAULT: FAULT, SUSPENDED: OFF},
    "SUSPEND": {OFF: SUSPENDED, READY: SUSPENDED, PLAYING: SUSPENDED, UNATTENDED: UNATTENDED, FAULT: FAULT},
    "RESUME": {SUSPENDED: OFF, UNATTENDED: UNATTENDED, FAULT: FAULT},
    "DETACH": {OFF: DFU, READY: DFU, PLAYING: DFU, UNATTENDED: DFU, FAULT: DFU},
    "RESTART": {OFF: OFF, READY: OFF, PLAYING: OFF, UNATTENDED: OFF, FAULT: OFF, DFU: OFF},
}
"""The state to which an event leads from another (clause STA-003); the same state if there is no transition."""

REACHED = (OFF, READY, PLAYING, UNATTENDED)
ENABLED = (READY, PLAYING, UNATTENDED)


def name(value: State | str) -> str:
    """A state or an event in an identifier of a case."""
    return (value.name if isinstance(value, State) else value).lower().replace("_", "-").replace(" ", "-")


def carry_out(bench: Bench, body: Body, state: State) -> None:
    """Send a change and wait until it has taken effect; while the outputs are not enabled it must be refused."""
    ack = bench.send(body)
    if state in ENABLED:
        expect("the reason", ack.reason, Reason.ACCEPTED)
        bench.wait_until(ack.commit_period + 1)
    else:
        expect("the reason", ack.reason, Reason.FAULT if state is FAULT else Reason.DISABLED)


def sequence(bench: Bench, state: State, *, repeats: int = 0, unattended: bool = False) -> None:
    """Play a sequence of 20 periods."""
    require(bench, Feature.SEQUENCES | (Feature.UNATTENDED if unattended else Feature(0)))
    if state not in (UNATTENDED, FAULT):  # the slot is in use there, or no store is accepted
        store_entry(bench, 20, pulses=SILENT)
    elif state is UNATTENDED:
        bench.must(Slot(1, SILENT))
        bench.must(Entries((Entry(1, 20),)))
    carry_out(bench, PlaySequence(0, 1, repeats=repeats, unattended=unattended), state)


def last_repeat(bench: Bench, state: State) -> None:
    """Play a sequence to its end."""
    sequence(bench, state, repeats=2, unattended=state is UNATTENDED)
    bench.wait_periods(60)


def ask_to_enable(bench: Bench, state: State) -> None:
    """ENABLE, which is answered with STALL if it leads nowhere (clause STA-005)."""
    expect("whether ENABLE is carried out", bench.try_order(Request.ENABLE), state is not FAULT)


WAYS: dict[str, tuple[str, Callable[[Bench, State], None]]] = {
    "ENABLE": ("ENABLE", ask_to_enable),
    "DISABLE": ("DISABLE", lambda bench, _: bench.order(Request.DISABLE)),
    "OUTPUT that disables": ("DISABLE", lambda bench, state: carry_out(bench, Output(Action.DISABLE), state)),
    "UPDATE": ("PLAY", lambda bench, state: carry_out(bench, Update(SILENT), state)),
    "SEQUENCE": ("PLAY", sequence),
    "unattended SEQUENCE": ("PLAY_UNATTENDED", lambda bench, state: sequence(bench, state, unattended=True)),
    "OUTPUT that silences": ("END", lambda bench, state: carry_out(bench, Output(Action.SILENCE), state)),
    "last repeat": ("END", last_repeat),
    "WATCHDOG": ("WATCHDOG", lambda bench, _: let_watchdog_fire(bench)),
    "CLEAR_FAULTS": ("CLEAR", lambda bench, _: bench.order(Request.CLEAR_FAULTS)),
}
"""Host actions that provoke an event, by event."""
TELLING = ("WATCHDOG", "last repeat")
"""Events that the device reports unasked even at the door through which the host speaks (clause ACK-006)."""
NO_CHANGE = ("ENABLE", "WATCHDOG", "CLEAR_FAULTS")
"""Events that have no effect at all if they lead nowhere."""


STEPS = [(state, way) for state in REACHED for way in WAYS if way != "last repeat" or state in (PLAYING, UNATTENDED)]


@pytest.mark.parametrize(("state", "way"), STEPS, ids=name)
@case("STA-001", "STA-002", "STA-003", "STA-005", "ACK-006", "REQ-005")
def test_what_the_host_does_leads_to(bench: Bench, state: State, way: str) -> None:
    """From this state this leads to the state of the table, by status and acknowledgements, and is reported or not."""
    event, provoke = WAYS[way]
    reach(bench, state)
    before = bench.status()
    provoke(bench, state)
    follows = LEADS_TO[event][state]
    said = told(bench)
    expect_state(bench, follows)
    wanted = [follows] if way in TELLING and (follows is not state or way == "last repeat") else []
    expect("the states of the unsolicited records", [status.state for status in said], wanted)
    if follows is state and way in NO_CHANGE:
        expect_all(bench.status(), since_period=before.since_period, flags=before.flags, free=before.free)


FOLLOWERS: dict[str, tuple[Callable[[int], Body], State, list[State]]] = {
    "update": (lambda period: Update(SILENT, period), PLAYING, []),
    "sequence": (lambda period: PlaySequence(0, 1, period), PLAYING, []),
    "silence": (lambda period: Output(Action.SILENCE, period), READY, []),
    "disable": (lambda period: Output(Action.DISABLE, period), OFF, []),
    "modulation": (lambda period: AmplitudeModulation(0, 1, 1, period), READY, [READY]),
    "end-of-modulation": (lambda period: Output(Action.END_MODULATION, period), READY, [READY]),
}
"""Changes for the period in which a sequence ends: the state then, and the states in unsolicited records."""


def follow_sequence(bench: Bench, body: Callable[[int], Body], periods: int, *, unattended: bool) -> tuple[int, int]:
    """Queue a sequence of one repeat, and a change for the period of its end; returns its begin and end."""
    require(bench, Feature.SEQUENCES | (Feature.UNATTENDED if unattended else Feature(0)))
    enable(bench)
    store_entry(bench, periods, pulses=SILENT)
    if Feature.MODULATION in bench.info.features:
        bench.must(Samples(bytes([255])))
    let_stores_go(bench)
    begins = soon(bench, 2)
    ends = begins + periods
    for change, period in ((PlaySequence(0, 1, begins, repeats=1, unattended=unattended), begins), (body(ends), ends)):
        check_in_time(bench.must(change), period)
    return begins, ends


@pytest.mark.parametrize("unattended", [False, True], ids=["attended", "unattended"])
@pytest.mark.parametrize("what", FOLLOWERS)
@case("STA-002", "STA-003", "ACK-006/1", features=Feature.SEQUENCES | Feature.MODULATION, since=2)
def test_a_change_in_the_period_in_which_a_sequence_ends_is_the_only_event(
    bench: Bench, what: str, unattended: bool
) -> None:
    """A change that replaces a sequence just when it ends leaves no END, and none is reported."""
    body, state, tells = FOLLOWERS[what]
    _, ends = follow_sequence(bench, body, 4000, unattended=unattended)
    bench.wait_until(ends + 1)
    expect("the states of the unsolicited records", states_in(told(bench)), tells)
    expect_state(bench, state)


@case("STA-002", "SAF-003", "SAF-005", features=Feature.SEQUENCES | Feature.UNATTENDED, since=2)
def test_the_watchdog_starts_in_the_period_in_which_an_update_follows_an_unattended_sequence(bench: Bench) -> None:
    """The watchdog counts from the period in which an UPDATE replaces an unattended sequence at its end."""
    ms = patience(bench)
    longest = min(4 * ms * PERIODS_PER_MS, MOST_ENTRY_PERIODS)
    begins, ends = follow_sequence(bench, FOLLOWERS["update"][0], longest, unattended=True)
    bench.wait_until(begins + 1)
    bench.order(Request.WATCHDOG, ms)
    check_not_yet(bench, ends * TICKS_PER_PERIOD)
    bench.wait_until(ends)
    await_firing(bench, ends * TICKS_PER_PERIOD, ends * TICKS_PER_PERIOD, ms)


# A bus that is suspended


FROM_UNATTENDED: dict[State, Body | None] = {
    OFF: Output(Action.DISABLE),
    READY: Output(Action.SILENCE),
    PLAYING: Update(SILENT),
    UNATTENDED: None,
}
"""What leads from UNATTENDED to a state."""


@pytest.mark.parametrize("state", REACHED, ids=name)
@pytest.mark.parametrize("permitted", [False, True], ids=["at-first", "after-unattended"])
@case("STA-002", "STA-003", "STA-004", "ACK-006", "SAF-005", line="usb", needs=(Need.SUSPEND,), allow=(Risk.RESET,))
def test_a_suspended_bus_disables_what_needs_its_host(bench: Bench, state: State, permitted: bool) -> None:
    """While the bus is suspended only unattended sequences play; then ENABLE is needed again.

    What played unattended before leaves no permission.
    """
    if permitted:
        require(bench, Feature.SEQUENCES | Feature.UNATTENDED)
        reach(bench, UNATTENDED)
        if (body := FROM_UNATTENDED[state]) is not None:
            bench.wait_until(bench.must(body).commit_period + 1)
        told(bench)
        expect_state(bench, state)
    else:
        reach(bench, state)
    fired = bench.status().watchdog_fired  # in an earlier case
    with suspended(bench):
        bench.wait(0.02)
    said = [status.state for status in told(bench)]
    if state is UNATTENDED:
        expect_state(bench, UNATTENDED)
        expect("the states of the unsolicited records", said, [])
    else:
        expect_state(bench, LEADS_TO["RESUME"][LEADS_TO["SUSPEND"][state]])
        expect("the states of the unsolicited records, of which the newest waits", said, [OFF])
        expect("whether the watchdog has fired", bench.status().watchdog_fired, fired)


def check_suspended(host: Host) -> None:
    """Fail unless the device is suspended, which a serial line tells and ENABLE does not change."""
    expect("the state on a suspended bus", host.status().state, SUSPENDED)
    assert not host.order(Request.ENABLE), "ENABLE is not answered with STALL on a suspended bus"
    assert host.order(Request.DISABLE), "DISABLE is answered with STALL on a suspended bus"
    expect("the state after DISABLE", host.status().state, SUSPENDED)


@pytest.mark.parametrize("state", [OFF, READY, PLAYING], ids=name)
@case(
    *("STA-004", "STA-005", "USB-020", "SER-016"),
    line="usb",
    needs=(Need.SUSPEND,),
    allow=(Risk.RESET,),
    features=Feature.SEQUENCES | Feature.UNATTENDED,
)
def test_what_a_serial_line_ends_on_a_suspended_bus_leaves_it_suspended(bench: Bench, state: State) -> None:
    """If a host at the UART ends what plays unattended while the bus is suspended, SUSPEND follows at once."""
    with bench.door("uart") as line:
        host = Host(bench, line, typed=False)
        reach(bench, UNATTENDED)
        with suspended(bench):
            expect("the state before", host.status().state, UNATTENDED)
            if state is OFF:
                assert host.order(Request.DISABLE), "DISABLE is answered with STALL"
            elif (body := FROM_UNATTENDED[state]) is not None:
                expect("the reason", host.send(body), Reason.ACCEPTED)
                bench.wait(0.01)
            check_suspended(host)
        expect_state(bench, OFF)


@case("STA-004", "REQ-011", "USB-020", "SER-016", line="usb", needs=(Need.SUSPEND, Need.FAULTS), allow=(Risk.RESET,))
def test_a_fault_that_is_cleared_on_a_suspended_bus_leaves_the_device_suspended(bench: Bench) -> None:
    """If a host at the UART clears a fault while the bus is suspended, SUSPEND follows at once."""
    with bench.door("uart") as line:
        host = Host(bench, line, typed=False)
        heat(bench, HOT_PERIODS)
        with suspended(bench):
            bench.wait(HOT_PERIODS / CARRIER_HZ + 0.1)
            expect("the state before", host.status().state, FAULT)
            assert host.order(Request.CLEAR_FAULTS), "CLEAR_FAULTS is answered with STALL"
            check_suspended(host)
        expect_state(bench, OFF)


@case(
    *("STA-004", "SAF-005", "STA-003"),
    line="usb",
    needs=(Need.SUSPEND, Need.CAPTURE),
    allow=(Risk.RESET,),
    features=Feature.SEQUENCES | Feature.UNATTENDED,
)
def test_what_ends_unattended_on_a_suspended_bus_leaves_the_device_suspended(bench: Bench) -> None:
    """When an unattended sequence ends while the bus is suspended, the outputs are disabled at once."""
    enable(bench)
    store_entry(bench, 600)
    began = bench.must(PlaySequence(0, 1, repeats=2, unattended=True)).commit_period
    with suspended(bench):
        bench.wait(1600 / CARRIER_HZ)
    expect_state(bench, OFF)
    ended = began + 2 * 600
    bench.judge(ended, ended + 100, check_silent)


# Faults


FAULTY = (Need.FAULTS, Need.SPARE)


@pytest.mark.parametrize("way", [way for way in WAYS if way != "last repeat"], ids=name)
@case("STA-003", "STA-005", "SAF-007/1", "REQ-011", "ACK-006", needs=FAULTY)
def test_nothing_leaves_fault_while_its_cause_lasts(bench: Bench, way: str) -> None:
    """In FAULT changes are refused, ENABLE is answered with STALL, and the state stays after any request."""
    bench.must(NoOp())
    heat(bench)
    expect_state(bench, FAULT)
    told(bench)
    WAYS[way][1](bench, FAULT)
    expect_state(bench, FAULT)
    expect("the faults", bench.status().faults, Fault.TEMPERATURE)
    expect("the unsolicited records", told(bench), [])


@pytest.mark.parametrize("how", ["SET_CONFIGURATION", "SET_INTERFACE"], ids=name)
@case("STA-003", "SAF-007/1", "USB-003", needs=FAULTY, line="usb")
def test_configuring_the_device_does_not_leave_fault(bench: Bench, how: str) -> None:
    """A host that configures the device while a silencing fault lasts finds it in FAULT."""
    heat(bench)
    if how == "SET_CONFIGURATION":
        bench.usb.set_configuration()
    else:
        bench.usb.set_interface(0)
    expect_state(bench, LEADS_TO["BUS_RESET"][FAULT])
    expect("the faults", bench.status().faults, Fault.TEMPERATURE)


@pytest.mark.parametrize("state", [OFF, UNATTENDED], ids=name)
@case("STA-003", "STA-004", "SAF-007/1", "ACK-006", needs=(*FAULTY, Need.SUSPEND), line="usb", allow=(Risk.RESET,))
def test_a_fault_while_the_bus_is_suspended_leads_to_fault(bench: Bench, state: State) -> None:
    """A silencing fault while the bus is suspended leads to FAULT, and resume does not leave it."""
    reach(bench, state)
    with suspended(bench):
        heat(bench)
    expect("the newest state in the unsolicited records", [status.state for status in told(bench)][-1:], [FAULT])
    expect_state(bench, LEADS_TO["RESUME"][FAULT])


@case("STA-003", "REQ-013", "REQ-011", needs=FAULTY, allow=(Risk.RESET,))
def test_a_restart_leaves_fault_where_its_cause_is_gone(bench: Bench) -> None:
    """After RESET the device is in OFF if the fault is over, and in FAULT if it lasts."""
    heat(bench, 2 * HOT_PERIODS)
    bench.restart(lambda: bench.order(Request.RESET))
    expect_all(bench.status(), " while the board is hot", state=FAULT, faults=Fault.TEMPERATURE)
    bench.wait_periods(2 * HOT_PERIODS)
    bench.restart(lambda: bench.order(Request.RESET))
    expect_all(bench.status(), state=LEADS_TO["RESTART"][FAULT], faults=Fault(0))


# Two doors


@contextmanager
def console_in_frames(bench: Bench) -> Iterator[RawSerialLine]:
    """The console of a device on USB as a second door, with frames."""
    line = bench.serial
    line.enter_frames()
    try:
        yield line
    finally:
        line.enter_console()


def states_in(statuses: list[Status]) -> list[State]:
    """Their states."""
    return [status.state for status in statuses]


def heard(line: RawSerialLine) -> list[Status]:
    """The status records that came through the second door."""
    line.rest()
    found = statuses(line)
    line.forget()
    return found


@case("ACK-006/1", "SER-016", line="usb", features=Feature.CONSOLE)
def test_a_change_of_state_through_another_door_is_told(bench: Bench) -> None:
    """A change of state by one host is told to the host at the other door, but not to itself."""
    bench.must(NoOp())
    bench.order(Request.WATCHDOG, LONG_MS)
    with console_in_frames(bench) as line:
        told(bench)
        for request, state in ((Request.ENABLE, READY), (Request.DISABLE, OFF)):
            order(line, request)
            expect(f"what USB is told of {request.name} in frames", states_in(told(bench)), [state])
            expect("what is told in frames", states_in(heard(line)), [])
        bench.enable()
        expect("what is told in frames of ENABLE over USB", states_in(heard(line)), [READY])
        field = play(bench)
        bench.wait_until(field.period + 1)
        expect("what is told in frames of an UPDATE over USB", states_in(heard(line)), [PLAYING])
        bench.order(Request.DISABLE)
        expect("what is told in frames of DISABLE over USB", states_in(heard(line)), [OFF])
        expect("what USB is told of what came over USB", states_in(told(bench)), [])


@case("ACK-006", "SER-016", "SAF-003", line="usb", features=Feature.CONSOLE)
def test_the_watchdog_is_told_at_every_door(bench: Bench) -> None:
    """The watchdog's firing, which no host caused, is told at both doors, with one record each."""
    bench.must(NoOp())
    bench.order(Request.WATCHDOG, LONG_MS)
    with console_in_frames(bench) as line:
        bench.enable()
        heard(line)
        let_watchdog_fire(bench)
        for where, said in (("over USB", told(bench)), ("in frames", heard(line))):
            expect(f"the states in the records {where}", states_in(said), [OFF])
            assert said[0].watchdog_fired, f"the flags in the record {where} are {said[0].flags!r}"


@case("ACK-006", "ACK-001", line="usb", features=Feature.SEQUENCES)
def test_what_is_told_unasked_comes_behind_the_acknowledgements_that_wait(bench: Bench) -> None:
    """An unsolicited status record does not overtake acknowledgements, and a newer one replaces it."""
    enable(bench)
    store_entry(bench, 2000, pulses=SILENT)
    told(bench)
    bodies = (PlaySequence(0, 1, repeats=1), NoOp(), NoOp())
    blocks = [pack(bench.numbered(body)) for body in bodies]
    bench.note_blocks(blocks)
    expect("the bytes that the device took", bench.line.send_blocks(b"".join(blocks), 1), BLOCK_BYTES * len(blocks))
    bench.order(Request.WATCHDOG, 100)
    bench.outlast(0.15)
    came = bench.listen()
    kinds = [type(record).__name__ for record in came]
    expect("the kinds of records, after the end of a sequence and the watchdog", kinds, ["Ack"] * 3 + ["Status"])
    expect("the state in the last record", came[-1].state, OFF)
