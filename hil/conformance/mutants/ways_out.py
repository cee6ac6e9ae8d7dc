"""Broken safety after a way out: a rule that no longer holds once the outputs are enabled again (chapter SAF)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ....base.errors import BlockError
from ....emulator import machine
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.execution import Execution
from ....emulator.control.known_faults import KnownFaults
from ....emulator.control.requests import Requests
from ....emulator.control.state_machine import StateMachine
from ....emulator.control.stores import Stores
from ....emulator.interfaces.console import Console
from ....emulator.interfaces.usb_device import UsbDevice
from ....emulator.interfaces.usb_functions import ArrayFunction, UsbFunction
from ....protocol.blocks import PlaySequence
from ....protocol.board import CHANNELS, CYCLES_PER_MS
from ....protocol.codes import SILENCING_FAULTS, Reason, State
from ....protocol.replies import ENABLED
from ....protocol.states import StateEvent
from .patching import Patch, mutant
from .seams import one_by_one

WAYS = {
    "disable": "DISABLE",
    "output": "a disabling OUTPUT",
    "stop": "`stop` at the console",
    "watchdog": "a firing of the watchdog",
    "bus-reset": "a bus reset",
    "set-configuration": "SET_CONFIGURATION",
    "set-interface": "SET_INTERFACE of interface 0",
    "resume": "SUSPEND and RESUME",
    "clear-faults": "FAULT and CLEAR_FAULTS",
    "reset": "RESET",
    "power-up": "a loss of power",
    "dfu-mode": "DFU mode",
}
"""What the outputs go off by, in words."""
BY_EVENT = {
    StateEvent.DISABLE: "disable",
    StateEvent.WATCHDOG: "watchdog",
    StateEvent.RESUME: "resume",
    StateEvent.CLEAR: "clear-faults",
}
BY_CALL: dict[str, tuple[Any, str, Callable[[Any], Any]]] = {
    "output": (Execution, "_disable_as_planned", lambda execution: execution._machine),
    "stop": (Console, "_ask", lambda console: console._controller._machine),
    "set-configuration": (ArrayFunction, "configure", lambda function: function._controller._machine),
    "set-interface": (ArrayFunction, "set_interface", lambda function: function._controller._machine),
}
"""Functions of the emulator that lead to the same event as others, and where they find the state machine."""
RESTARTS = {
    "reset": (Requests, "_depart"),
    "power-up": (machine.Emulator, "power_up"),
    "dfu-mode": (UsbDevice, "_boot"),
}


def some(*names: str) -> dict[str, str]:
    """Some of the ways."""
    return {name: WAYS[name] for name in names}


def note_ways(patch: Patch) -> None:
    """Let each state machine know, as its ``way``, by what its outputs went off last."""
    restarting: list[str] = []

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, at: int, *rest: Any, **more: Any) -> None:
        was = self._device.state
        original(self, event, at, *rest, **more)
        if was is not State.OFF and self._device.state is State.OFF:
            vars(self)["way"] = vars(self).get("how") or BY_EVENT.get(event)

    def meanwhile(owner: Any, name: str, how: str, find: Callable[[Any], Any]) -> None:
        @patch.around(owner, name)
        def around(original: Any, self: Any, *given: Any, **named: Any) -> Any:
            state_machine = find(self)
            mine = "how" not in vars(state_machine) and (how != "stop" or given[0].name == "stop")
            if mine:
                vars(state_machine)["how"] = how
            try:
                return original(self, *given, **named)
            finally:
                if mine:
                    del vars(state_machine)["how"]

    for how, (owner, name, find) in BY_CALL.items():
        meanwhile(owner, name, how, find)

    @patch.around(UsbFunction, "bus_reset")
    def bus_reset(original: Any, self: Any) -> None:
        of_array = isinstance(self, ArrayFunction)
        found: dict[str, Any] = vars(vars(self)["_controller"]._machine) if of_array else {}
        found["how"] = "bus-reset"
        original(self)
        del found["how"]

    def before_restart(owner: Any, name: str, how: str) -> None:
        @patch.around(owner, name)
        def around(original: Any, self: Any, *given: Any) -> Any:
            restarting[:] = [how]
            return original(self, *given)

    for how, (owner, name) in RESTARTS.items():
        before_restart(owner, name, how)

    @patch.around(Controller, "__init__")
    def begin(original: Any, self: Any, *given: Any, **named: Any) -> None:
        original(self, *given, **named)
        vars(self._machine)["way"] = restarting[-1] if restarting else None


def came_by(state_machine: Any, way: str) -> bool:
    """Whether the outputs went off last by this way."""
    return bool(vars(state_machine).get("way") == way)


@mutant("SAF-003", "STA-003", each=WAYS)
def watchdog_rests_after(patch: Patch, way: str) -> None:
    """After {} the next ENABLE leaves the watchdog at rest: what plays goes on for ever without its host."""
    note_ways(patch)

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, at: int, *rest: Any, **more: Any) -> None:
        original(self, event, at, *rest, **more)
        if event is StateEvent.ENABLE and came_by(self, way):
            self.watchdog.rest()


@mutant(
    "SAF-006",
    "REQ-010",
    each=some("output", "watchdog", "bus-reset", "set-configuration", "set-interface", "resume", "clear-faults"),
)
def drive_limit_is_that_of_info_after(patch: Patch, way: str) -> None:
    """After {} the drive limit is that of INFO again: the way out runs the code of power-up."""
    note_ways(patch)

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, at: int, *rest: Any, **more: Any) -> None:
        original(self, event, at, *rest, **more)
        if event is StateEvent.ENABLE and came_by(self, way):
            self._device.drive_limit = CHANNELS


@mutant("SAF-003", each=some("disable", "watchdog", "set-configuration", "resume", "clear-faults", "reset"))
def refused_blocks_feed_the_watchdog_after(patch: Patch, way: str) -> None:
    """After {} refused blocks are signs of life: a flag that a host is there is never taken back."""
    note_ways(patch)

    @patch.around(Controller, "_refuse")
    def refuse(original: Any, self: Any, error: Any, what: str) -> None:
        original(self, error, what)
        if came_by(self._machine, way):
            self._machine.watchdog.feed()


@mutant("USB-020", "STA-003", each=some("watchdog", "bus-reset", "resume", "clear-faults"))
def suspend_is_ignored_after(patch: Patch, way: str) -> None:
    """After {} a suspended bus leaves the outputs as they are: its interrupt is not enabled again."""
    note_ways(patch)

    @patch.around(StateMachine, "suspend")
    def suspend(original: Any, self: Any) -> None:
        if not came_by(self, way):
            original(self)


@mutant("SAF-005", each=some("disable", "watchdog", "set-interface", "resume", "clear-faults"))
def permission_to_play_unattended_stays_after(patch: Patch, way: str) -> None:
    """After {} a sequence that needs its host plays with the permission of one before: the flag is not cleared."""
    note_ways(patch)

    @patch.around(Execution, "carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        if isinstance(body, PlaySequence) and came_by(self._machine, way):
            body = replace(body, unattended=True)
        return original(self, body, door)


@mutant("SAF-002", each=some("output", "stop", "bus-reset", "resume", "clear-faults"))
def changes_are_taken_without_enable_after(patch: Patch, way: str) -> None:
    """After {} changes are accepted before the next ENABLE: the state says OFF, but nothing checks it."""
    note_ways(patch)
    one_by_one(patch)
    last: list[Any] = []

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, *given: Any, **named: Any) -> None:
        original(self, *given, **named)
        last[:] = [self]

    @patch.around(Admission, "_judge_state")
    def judge(original: Any, self: Any, body: Any) -> None:
        try:
            original(self, body)
        except BlockError as error:
            if error.reason != Reason.DISABLED or not (last and came_by(last[0], way)):
                raise


@mutant("SAF-004", each=some("stop", "watchdog", "set-interface", "resume", "clear-faults"))
def outputs_play_on_at_disable_after(patch: Patch, way: str) -> None:
    """After {} and ENABLE the next DISABLE changes the state alone: the outputs play on."""
    note_ways(patch)

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, at: int, *rest: Any, **more: Any) -> None:
        deaf = event is StateEvent.DISABLE and came_by(self, way)
        if deaf:
            vars(self._dispatch)["send_silence"] = lambda _stops: None
        try:
            original(self, event, at, *rest, **more)
        finally:
            if deaf:
                del vars(self._dispatch)["send_silence"]


@mutant("SAF-007", each=some("disable", "resume", "clear-faults"))
def fault_does_not_silence_after(patch: Patch, way: str) -> None:
    """After {} a silencing fault is reported, but the outputs stay enabled: it is taken for an old one."""
    note_ways(patch)

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, at: int, *rest: Any, **more: Any) -> None:
        if event is not StateEvent.FAULT or not came_by(self, way):
            original(self, event, at, *rest, **more)


@mutant("SAF-005", "SAF-003", each=some("watchdog", "resume", "clear-faults"))
def watchdog_does_not_start_after_an_unattended_sequence_after(patch: Patch, way: str) -> None:
    """After {} and ENABLE the end of an unattended sequence does not start the watchdog, which waits for an ENABLE."""
    note_ways(patch)

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, at: int, *rest: Any, **more: Any) -> None:
        was = self._device.state
        original(self, event, at, *rest, **more)
        if was is State.UNATTENDED and self._device.state is not was and came_by(self, way):
            self.watchdog.rest()


@mutant("SAF-004", "STA-003", each={"bus-reset": "a bus reset", "fault": "a fault", "suspend": "suspend"})
def modulation_outlives(patch: Patch, event: str) -> None:
    """After {} and ENABLE what plays is modulated as before: the silence of that event stops no modulation."""

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, what: StateEvent, *rest: Any, **more: Any) -> None:
        if what is StateEvent[event.upper().replace("-", "_")]:
            silence = self._dispatch.send_silence
            vars(self._dispatch)["send_silence"] = lambda _stops: silence(())
        try:
            original(self, what, *rest, **more)
        finally:
            vars(self._dispatch).pop("send_silence", None)


@mutant("SAF-003", "STA-003", wraps=(StateMachine, "happen"))
def enable_goes_on_with_the_watchdogs_rest(
    original: Any, self: Any, event: StateEvent, *rest: Any, **more: Any
) -> None:
    """After DISABLE and ENABLE the watchdog has the time left that it had: its timer is stopped, and goes on."""
    was, now, due = self._device.state, self._dispatch.now, self.watchdog._due
    original(self, event, *rest, **more)
    full = self.watchdog.milliseconds * CYCLES_PER_MS
    if was in ENABLED and self._device.state is State.OFF:
        vars(self)["left"] = due - now
    elif event is StateEvent.ENABLE and 0 < (left := vars(self).pop("left", 0)) < full:
        self.watchdog.watch(now - (full - left))


# A bus that is suspended, two faults, and what was judged before


@mutant("STA-004", "USB-020", wraps=(StateMachine, "happen"))
def permission_outlives_an_update_over_an_unattended_sequence(
    original: Any, self: Any, event: StateEvent, *rest: Any, **more: Any
) -> None:
    """An update that ends an unattended sequence leaves its permission: a suspended bus is ignored until OFF."""
    was = self._device.state
    if event is StateEvent.SUSPEND and was is State.PLAYING and vars(self).get("permitted"):
        return
    original(self, event, *rest, **more)
    vars(self)["permitted"] = State.UNATTENDED in (was, self._device.state) or (
        vars(self).get("permitted", False) and self._device.state in ENABLED
    )


@mutant("STA-004", "USB-020", each={"clear": "CLEAR_FAULTS", "disable": "DISABLE"})
def suspended_bus_is_forgotten_at(patch: Patch, event: str) -> None:
    """After {} by a serial line while the bus is suspended the state is OFF, and ENABLE is accepted there."""

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, what: StateEvent, *rest: Any, **more: Any) -> None:
        if what is StateEvent[event.upper()]:
            self._device.bus_suspended = False
        original(self, what, *rest, **more)


@mutant("REQ-011", "SAF-007", wraps=(KnownFaults, "clear"))
def clearing_one_of_two_faults_leaves_the_state_fault(original: Any, self: Any) -> None:
    """CLEAR_FAULTS that clears one silencing fault leads to OFF though another one lasts."""
    before = self._device.faults
    original(self)
    if before & ~self._device.faults & SILENCING_FAULTS:
        self._machine.happen(StateEvent.CLEAR, self._dispatch.now)


@mutant("SAF-006", "REQ-010")
def a_sequence_that_played_is_not_judged_anew(patch: Patch) -> None:
    """A sequence that was accepted is not judged by a lower limit later: only stores take the verdict back."""

    @patch.around(Stores, "check_power")
    def check(original: Any, self: Any, body: Any, limit: int) -> None:
        good = vars(self).setdefault("good", set())
        if (body.first, body.count) not in good:
            original(self, body, limit)
            good.add((body.first, body.count))

    @patch.around(Stores, "keep")
    def keep(original: Any, self: Any, body: Any) -> None:
        original(self, body)
        vars(self)["good"] = set()


@mutant("BLK-023", url="emulator:?link=2wire")
def the_rate_is_forgotten_at_disable_alone(patch: Patch) -> None:
    """The last period that an update named is forgotten with DISABLE instead of ENABLE: the watchdog leaves it."""

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, *rest: Any, **more: Any) -> None:
        if event is StateEvent.DISABLE:
            self._device.last_named = None
        original(self, event, *rest, **more)

    @patch.around(Requests, "_enable")
    def enable(original: Any, self: Any, door: Any) -> None:
        named = self._device.last_named
        original(self, door)
        self._device.last_named = named
