"""Ways out: after each transition to OFF, and another ENABLE, all rules of safety hold again (chapter SAF)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial, reduce

import pytest
from phasewire.base.errors import DeviceError
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Case, Need, Risk, Row, case, expect
from phasewire.hil.conformance.sight.waveforms import check_play, check_silent, expected_words, modulated
from phasewire.hil.conformance.tools.dfu import RawDfuLine
from phasewire.hil.conformance.tools.exchange import at_the_console
from phasewire.hil.conformance.tools.playing import (
    HOT_PERIODS,
    ROUND_SECONDS,
    check_falls_silent,
    heat,
    judge_silence_since,
    play,
    reach,
    told,
)
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    SILENT,
    enable,
    expect_all,
    forge,
    heavy,
    known,
    let_stores_go,
    set_limit,
    store_entry,
    suspended,
)
from phasewire.hil.conformance.tools.watchdog import (
    PERIODS_PER_MS,
    TICKS_PER_MS,
    await_firing,
    check_not_yet,
    let_watchdog_fire,
    patience,
)
from phasewire.host.transports.usb_find import DFU_MODE
from phasewire.protocol.blocks import AmplitudeModulation, NoOp, Output, PlaySequence, Samples, Slot, Update, pack
from phasewire.protocol.board import TICKS_PER_PERIOD
from phasewire.protocol.codes import (
    BLOCK_BYTES,
    REQUEST_TYPE_IN,
    SILENT_PERIODS,
    Action,
    Fault,
    Feature,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.enumeration import ENDPOINT_OUT
from phasewire.protocol.replies import Status
from phasewire.protocol.requests import Setup
from phasewire.protocol.states import TRANSITIONS, StateEvent

OFF, READY, PLAYING, UNATTENDED = State.OFF, State.READY, State.PLAYING, State.UNATTENDED
FAULT, SUSPENDED, DFU = State.FAULT, State.SUSPENDED, State.DFU
PERMISSION = Feature.SEQUENCES | Feature.UNATTENDED
REACHED = (OFF, READY, PLAYING, UNATTENDED)
"""The states to which blocks and requests lead; each other one is on a way out."""
HELD = 2
"""The drive limit that is set before a way out, in transducers."""
SAMPLE = 128


# Ways to let an event happen


def stop(bench: Bench) -> None:
    """Type `stop` at the console."""
    with at_the_console(bench) as line:
        expect("the answer to stop", line.command("stop"), "ok\r\n")


def fail(bench: Bench) -> None:
    """Overheat a board: FAULT follows and is told, and stays when the board is cool again."""
    heat(bench, HOT_PERIODS)
    said = told(bench)
    expect("the states of the unsolicited records", [status.state for status in said], [FAULT])
    expect("the faults in the records", said[0].faults, Fault.TEMPERATURE)
    cool(bench)


def cool(bench: Bench) -> None:
    """Wait for the end of the fault, which stays to be cleared."""
    bench.wait_periods(HOT_PERIODS)
    bench.wait(ROUND_SECONDS)
    status = bench.status()
    expect("state and faults", (status.state, status.faults), (FAULT, Fault.TEMPERATURE))
    expect_all(status, since_period=0, free=bench.info.queue_blocks)
    assert not bench.try_order(Request.ENABLE), "ENABLE is not answered with STALL in FAULT"


def fail_suspended(bench: Bench) -> None:
    """Overheat a board while the bus is suspended; resume does not leave FAULT."""
    heat(bench, HOT_PERIODS)
    bench.levers.resume()
    cool(bench)


def reset_suspended(bench: Bench) -> None:
    """Reset the bus that is suspended."""
    bench.usb.reset()
    bench.levers.resume()


def cut_suspended(bench: Bench) -> None:
    """Cut the power while the bus is suspended."""
    bench.power_cycle()
    bench.levers.resume()


def detach(bench: Bench) -> None:
    """Ask for DFU mode, which has no vendor interface (clause STA-005)."""
    assert RawDfuLine(bench).detach(), "DETACH is answered with STALL"
    with suppress(DeviceError):  # it may leave after 10 ms
        status = bench.status()
        expect("state and what plays since", (status.state, status.since_period), (DFU, 0))
    bench.usb.wait_for(DFU_MODE, bench.return_seconds)
    answer = bench.request(Setup(REQUEST_TYPE_IN, Request.STATUS, 0, 0, Status.BYTES))
    expect("the answer to STATUS in DFU mode", answer, None)


@dataclass(frozen=True, kw_only=True)
class How(Row):
    """A way to let an event happen, and the states that the device then reports unasked; None for any."""

    name: str
    act: Callable[[Bench], object]
    tells: Sequence[State] | None = None


over_usb = partial(How, line="usb")
on_the_bus = partial(How, line="usb", risks=(Risk.RESET,))
RESET = How(name="reset", act=lambda bench: bench.restart(lambda: bench.order(Request.RESET)), risks=(Risk.RESET,))

HOWS: dict[StateEvent, tuple[How, ...]] = {
    StateEvent.DISABLE: (
        How(name="disable", act=lambda bench: bench.order(Request.DISABLE), tells=()),
        How(
            name="output",
            act=lambda bench: bench.wait_until(bench.must(Output(Action.DISABLE)).commit_period + 1),
            tells=(),
        ),
        How(name="stop", act=stop, features=Feature.CONSOLE),
    ),
    StateEvent.WATCHDOG: (How(name="watchdog", act=let_watchdog_fire, tells=(OFF,)),),
    StateEvent.BUS_RESET: (
        on_the_bus(name="bus-reset", act=lambda bench: bench.usb.reset(), tells=()),
        over_usb(name="set-configuration", act=lambda bench: bench.usb.set_configuration(), tells=()),
        over_usb(name="set-interface", act=lambda bench: bench.usb.set_interface(0), tells=()),
    ),
    StateEvent.SUSPEND: (on_the_bus(name="suspend", act=lambda bench: bench.levers.suspend(), needs=(Need.SUSPEND,)),),
    StateEvent.RESUME: (How(name="resume", act=lambda bench: bench.levers.resume(), tells=(OFF,)),),
    StateEvent.FAULT: (How(name="fault", act=fail, needs=(Need.FAULTS,)),),
    StateEvent.CLEAR: (How(name="clear", act=lambda bench: bench.order(Request.CLEAR_FAULTS)),),
    StateEvent.DETACH: (on_the_bus(name="detach", act=detach, features=Feature.DFU),),
    StateEvent.RESTART: (RESET, How(name="power", act=Bench.power_cycle, needs=(Need.POWER,), risks=(Risk.RESET,))),
}
"""How to let each event happen."""
HOWS_IN: dict[tuple[State, StateEvent], tuple[How, ...]] = {
    (SUSPENDED, StateEvent.FAULT): (How(name="fault", act=fail_suspended, needs=(Need.FAULTS,)),),
    (SUSPENDED, StateEvent.BUS_RESET): (How(name="bus-reset", act=reset_suspended, tells=()),),
    (SUSPENDED, StateEvent.RESTART): (How(name="power", act=cut_suspended, needs=(Need.POWER,)),),
    (FAULT, StateEvent.RESTART): (RESET,),
    (DFU, StateEvent.RESTART): (on_the_bus(name="leave", act=lambda bench: RawDfuLine(bench).leave()),),
}
"""The same in states in which it goes otherwise."""


@dataclass(frozen=True, kw_only=True)
class WayOut(Row):
    """A way from a state, to which blocks and requests lead, to OFF; it needs what its steps need."""

    state: State
    steps: tuple[How, ...]
    restarts: bool

    def __str__(self) -> str:
        return "-".join([self.state.name.lower(), *(step.name for step in self.steps)])

    @classmethod
    def through(cls, state: State, steps: tuple[How, ...], *, restarts: bool) -> WayOut:
        """The way of some steps."""
        merged = reduce(lambda about, row: row.added_to(about), steps, Case((), ""))
        needed = {name: getattr(merged, name) for name in ("needs", "risks", "line")}
        features = merged.features | (PERMISSION if state is UNATTENDED else Feature(0))
        return cls(state=state, steps=steps, restarts=restarts, features=features, **needed)


def beginnings(state: State) -> list[tuple[State, tuple[How, ...]]]:
    """The steps to a state, from a state to which blocks and requests lead."""
    if state in REACHED:
        return [(state, ())]
    return [
        (first, (*steps, how))
        for (before, event), follows in TRANSITIONS.items()
        if follows is state and before is not state
        for first, steps in beginnings(before)[:1]
        for how in hows(before, event)
    ]


def hows(state: State, event: StateEvent) -> tuple[How, ...]:
    """How to let an event happen in a state."""
    return HOWS_IN.get((state, event)) or HOWS[event]


WAYS = [
    WayOut.through(first, (*steps, how), restarts=event is StateEvent.RESTART)
    for (state, event), follows in TRANSITIONS.items()
    if follows is OFF and (state is not OFF or event is StateEvent.RESTART)
    for first, steps in beginnings(state)
    for how in hows(state, event)
]
"""Each transition of STA-003 that leads to OFF, in each way; a new one without a way fails here."""
WHILE_PLAYING = [way for way in WAYS if way.state is PLAYING]


# Steps


def share(bench: Bench) -> float:
    """The share of the greatest drive that is allowed under the limit that is set."""
    return HELD / bench.drive_limit


def leave(bench: Bench, way: WayOut, also: Callable[[Bench], object] = lambda _: None) -> Status:
    """Lower the limit, reach a state, begin something more, take the way out; returns the status, that of OFF."""
    set_limit(bench, HELD)
    reach(bench, way.state, share(bench))
    also(bench)
    flags = bench.status().flags & StatusFlag.WATCHDOG_FIRED  # which stays until ENABLE
    for step in way.steps:
        bench.note("step", step.name)
        step.act(bench)
    said, tells = [status.state for status in told(bench)], way.steps[-1].tells
    expect("the states of the unsolicited records", said, said if tells is None else list(tells))
    status = bench.status()
    if way.restarts:
        flags = StatusFlag(0)
    if way.steps[-1].name == "watchdog":
        flags = StatusFlag.WATCHDOG_FIRED
    expect("state and flags", (status.state, status.flags), (OFF, flags))
    expect_all(status, faults=Fault(0), since_period=0, free=bench.info.queue_blocks)
    info = bench.info
    limits = (info.watchdog_ms, info.drive_limit) if way.restarts else (LONG_MS, HELD)
    expect("the watchdog time and the drive limit", (status.watchdog_ms, status.drive_limit), limits)
    return status


def come_back(bench: Bench, way: WayOut, also: Callable[[Bench], object] = lambda _: None) -> None:
    """Take the way out, and enable the outputs again; see `leave`."""
    leave(bench, way, also)
    enable(bench)


def modulate(bench: Bench) -> int:
    """Modulate what plays; returns the period from which on."""
    began = bench.must(AmplitudeModulation(0, 1, 1)).commit_period
    bench.wait_until(began + 1)
    return began


def check_limit(bench: Bench, limit: int) -> None:
    """Fail unless the drive limit holds, and cannot be set while the outputs are enabled."""
    assert not bench.try_order(Request.LIMIT, limit), "LIMIT is carried out while the outputs are enabled"
    reason = Reason.DRIVE if limit == HELD else Reason.ACCEPTED
    for body in known(bench, Update(heavy(HELD + 1)), Slot(0, heavy(HELD + 1))):
        expect(f"the reason for {body.KIND.name} of {HELD + 1} transducers", bench.send(body).reason, reason)
    expect(f"the reason for an update of {HELD}", bench.send(Update(heavy(HELD))).reason, Reason.ACCEPTED)


def store(bench: Bench) -> None:
    """Store a sequence that plays for ever."""
    store_entry(bench, 1000, pulses=SILENT)
    let_stores_go(bench)


# Cases


@pytest.mark.parametrize("way", WAYS, ids=str)
@case("SAF-002", "SAF-003", "SAF-006", "REQ-010", "STA-003", "ACK-006")
def test_the_watchdog_and_the_limit_hold_after(bench: Bench, way: WayOut) -> None:
    """After this way out changes need ENABLE, the drive limit holds, and the watchdog fires in time after silence.

    A refused block is no sign of life.
    """
    limit = leave(bench, way).drive_limit
    for body in known(bench, Update(SILENT), PlaySequence(0, 1), Output(Action.SILENCE)):
        expect(f"the reason for {body.KIND.name} before ENABLE", bench.send(body).reason, Reason.DISABLED)
    assert not bench.try_order(Request.LIMIT, bench.info.drive_limit + 1), "LIMIT takes more than INFO says"
    enable(bench)
    status = bench.status()
    expect("state and flags after ENABLE", (status.state, status.flags), (READY, StatusFlag(0)))
    check_limit(bench, limit)
    ms = patience(bench)
    last = bench.must(Update(SILENT)).now
    bench.order(Request.WATCHDOG, ms)
    bench.wait(ms / 3000)
    (refused,) = bench.send_raw(forge(bench, NoOp(), checksum=1))
    check_not_yet(bench, last + ms * TICKS_PER_MS)
    expect("the reason of a block with a wrong checksum", refused.reason, Reason.CHECKSUM)
    await_firing(bench, last, last, ms)


@pytest.mark.parametrize("way", WHILE_PLAYING, ids=str)
@case("SAF-003", "BLK-009", "STA-003", line="usb")
def test_a_block_that_is_answered_with_nak_is_no_sign_of_life_after(bench: Bench, way: WayOut) -> None:
    """After this way out a host whose blocks wait for room in the queue counts as silent, unless it asks for STATUS."""
    ms = patience(bench)
    come_back(bench, way)
    far = bench.period() + LONG_MS * PERIODS_PER_MS
    for number in range(bench.info.queue_blocks):
        last = bench.must(Update(SILENT, far + number * bench.info.periods_per_update))
    expect("the free places", last.free, 0)
    bench.order(Request.WATCHDOG, ms)
    taken = bench.usb.write(ENDPOINT_OUT, pack(bench.numbered(NoOp())), ms / 2000)
    check_not_yet(bench, last.now + ms * TICKS_PER_MS)
    assert taken < BLOCK_BYTES, "the device took a block although its queue has no room"
    await_firing(bench, last.now, last.now, ms)
    bench.usb.clear_halt(ENDPOINT_OUT)  # at full speed a part of the block may have been taken


@pytest.mark.parametrize("way", WHILE_PLAYING, ids=str)
@case("SAF-005", "SAF-003", "STA-003", features=PERMISSION)
def test_the_watchdog_rests_while_something_plays_unattended_after(bench: Bench, way: WayOut) -> None:
    """After this way out the watchdog rests for an unattended sequence, starts with its end, and for no other."""
    ms = patience(bench)
    come_back(bench, way)
    store(bench)
    bench.must(PlaySequence(0, 1, unattended=True))
    bench.order(Request.WATCHDOG, ms)
    expect("the unsolicited records", bench.listen(2 * ms / 1000), [])
    expect("the state", bench.status().state, UNATTENDED)
    ends = bench.must(Update(SILENT)).commit_period * TICKS_PER_PERIOD
    await_firing(bench, ends, ends, ms)
    come_back(bench, way)
    store(bench)
    last = bench.must(PlaySequence(0, 1)).now
    bench.order(Request.WATCHDOG, ms)
    await_firing(bench, last, last, ms)


@pytest.mark.parametrize("way", WHILE_PLAYING, ids=str)
@case("SAF-004", "STA-003", outputs=("SAF-004/1",))
def test_disable_silences_after(bench: Bench, way: WayOut) -> None:
    """After this way out, and once something plays again, all outputs fall silent within six periods of DISABLE."""
    come_back(bench, way)
    field = play(bench, bench.weak(share(bench)))
    before = bench.clock().now
    bench.order(Request.DISABLE)
    after = bench.clock().now
    expect("the state", bench.status().state, OFF)
    end = after // TICKS_PER_PERIOD + 100
    bench.judge(field.period, end, lambda seen: check_falls_silent(seen, field.words, before, after))


@pytest.mark.parametrize("way", WHILE_PLAYING, ids=str)
@case("SAF-004", "STA-003", outputs=("SAF-004", "BLK-017"), features=Feature.MODULATION)
def test_no_modulation_is_left_after(bench: Bench, way: WayOut) -> None:
    """After this way out of a modulated update the next one plays unmodulated; but for a restart samples are kept."""
    bench.must(Samples(bytes([SAMPLE])))
    come_back(bench, way, modulate)
    field = play(bench, bench.weak(share(bench)))
    if way.restarts:
        bench.must(Samples(bytes([SAMPLE])))
    began = modulate(bench)
    dimmed = expected_words(modulated(field.pulses, SAMPLE), bench.wiring)
    bench.judge(field.period, began + 20, lambda seen: check_play(seen, [(field.period, field.words), (began, dimmed)]))


@pytest.mark.parametrize("way", WHILE_PLAYING, ids=str)
@case(
    *("USB-020", "STA-003", "SAF-002"),
    outputs=("USB-020", "SAF-004/1"),
    needs=(Need.SUSPEND,),
    allow=(Risk.RESET,),
    line="usb",
)
def test_suspend_silences_after(bench: Bench, way: WayOut) -> None:
    """After this way out, and once something plays again, a suspended bus turns the outputs off until ENABLE."""
    come_back(bench, way)
    play(bench, bench.weak(share(bench)))
    with suspended(bench):
        began = bench.line.time.monotonic()
        bench.wait(0.03)
    expect("the state after resume", bench.status().state, OFF)
    expect("the reason for an update", bench.send(Update(SILENT)).reason, Reason.DISABLED)
    judge_silence_since(bench, began)


@pytest.mark.parametrize("way", WHILE_PLAYING, ids=str)
@case("SAF-007/1", "STA-003", "STA-005", outputs=("SAF-007/1",), needs=(Need.FAULTS,))
def test_a_fault_silences_after(bench: Bench, way: WayOut) -> None:
    """After this way out, and once something plays again, a silencing fault leads to FAULT and silences the outputs."""
    come_back(bench, way)
    play(bench, bench.weak(share(bench)))
    heat(bench, HOT_PERIODS)
    since = bench.period() + SILENT_PERIODS
    status = bench.status()
    expect("state and faults", (status.state, status.faults), (FAULT, Fault.TEMPERATURE))
    expect("the reason for an update", bench.send(Update(SILENT)).reason, Reason.FAULT)
    assert not bench.try_order(Request.ENABLE), "ENABLE is not answered with STALL in FAULT"
    bench.judge(since, since + 100, check_silent)
