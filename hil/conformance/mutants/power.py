"""Broken behaviour of the bus and of restarts: suspend, reset and fresh starts (chapters STA, USB and REQ)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ....emulator.boards.processor import Processor
from ....emulator.control import state_machine
from ....emulator.control.state_machine import StateMachine
from ....emulator.interfaces.usb_functions import ArrayFunction
from ....emulator.machine import Emulator
from ....emulator.ports.capture import Forced
from ....protocol.replies import ENABLED
from ....protocol.states import StateEvent
from .patching import Patch, mutant

ALL_BITS = 2**32 - 1


# The bus


@mutant("USB-020", "STA-003")
def suspend_is_ignored(patch: Patch) -> None:
    """While the bus is suspended or the cable is out, the outputs go on: nothing handles the idle interrupt."""
    patch.replace(ArrayFunction, "suspend", lambda *_: None)


@mutant("USB-020", "STA-003")
def resume_enables_again(patch: Patch) -> None:
    """On resume the outputs are enabled again if they were before: the state is restored."""

    @patch.around(StateMachine, "suspend")
    def of_suspend(original: Any, self: Any) -> None:
        self._dispatch.settle()
        self.was_enabled = self._device.state in ENABLED
        original(self)

    @patch.around(StateMachine, "resume")
    def of_resume(original: Any, self: Any) -> None:
        original(self)
        if self.was_enabled:
            self.happen(StateEvent.ENABLE, self._dispatch.now)


@mutant("ACK-006", "USB-020")
def suspend_and_resume_are_not_told(patch: Patch) -> None:
    """After suspend and resume no status record waits for the host."""
    patch.replace(state_machine, "SPOKEN", (StateEvent.WATCHDOG, StateEvent.FAULT))


@mutant("USB-020", wraps=(ArrayFunction, "resume"))
def resume_drops_waiting_records(original: Any, self: Any) -> None:
    """Records that waited when the bus was suspended are lost on resume: the endpoints are set up anew."""
    self._records.clear()
    self._unasked = b""
    original(self)


@mutant("USB-003", "STA-003", "USB-016", wraps=(StateMachine, "new_session"))
def bus_reset_keeps_playing(_: Any, self: Any, _door: Any) -> None:
    """A bus reset, SET_CONFIGURATION and SET_INTERFACE restart the numbering, but playing goes on."""
    self._dispatch.settle()
    self._device.last_sequence = None


# Restarts


def _keep_over_reset(patch: Patch, save: Callable[[Any], Any], restore: Callable[[Any, Any], None]) -> None:
    """Let a part of the controller survive RESET: one function reads it, another gives it to the next controller."""

    @patch.around(Emulator, "restart")
    def of_restart(original: Any, self: Any) -> None:
        self.kept = None if self.controller is None else save(self.controller)
        original(self)

    @patch.around(Emulator, "_come_up")
    def of_come_up(original: Any, self: Any, *given: Any) -> None:
        original(self, *given)
        kept, self.kept = vars(self).get("kept"), None
        if kept is not None:
            restore(self.controller, kept)


@mutant("REQ-009", "REQ-013")
def reset_keeps_the_watchdog_time(patch: Patch) -> None:
    """The watchdog time survives RESET: its memory is not cleared."""
    _keep_over_reset(
        patch,
        lambda controller: controller._machine.watchdog.milliseconds,
        lambda controller, milliseconds: controller._machine.watchdog.set_time(milliseconds),
    )


@mutant("REQ-010", "REQ-013")
def reset_keeps_the_drive_limit(patch: Patch) -> None:
    """The drive limit survives RESET: its memory is not cleared."""
    _keep_over_reset(
        patch,
        lambda controller: controller._device.drive_limit,
        lambda controller, limit: setattr(controller._device, "drive_limit", limit),
    )


@mutant("REQ-013", "REQ-003")
def reset_keeps_the_counters(patch: Patch) -> None:
    """The counts of blocks survive RESET, as if they counted since manufacture."""
    names = ("accepted", "refused", "late", "lost")

    def restore(controller: Any, counts: tuple[int, ...]) -> None:
        for name, count in zip(names, counts, strict=True):
            setattr(controller._device, name, count)

    _keep_over_reset(patch, lambda controller: tuple(getattr(controller._device, name) for name in names), restore)


@mutant("NUM-004", "REQ-013", url="emulator:?door=serial")
def reset_keeps_the_number_of_the_last_block(patch: Patch) -> None:
    """After RESET the first number must follow the last one before, unless a bus begins a new session."""
    _keep_over_reset(
        patch,
        lambda controller: controller._device.last_sequence,
        lambda controller, number: setattr(controller._device, "last_sequence", number),
    )


@mutant("REQ-013", "TIM-002")
def time_goes_on_over_a_reset(patch: Patch) -> None:
    """Ticks and periods continue over RESET: the port clocks run on, and the controller with them."""

    @patch.around(Emulator, "restart")
    def of_restart(original: Any, self: Any) -> None:
        self.first_time = None if self.controller is None else self.controller.time
        original(self)

    @patch.around(Emulator, "_come_up")
    def of_come_up(original: Any, self: Any, booted: Any, identities: Any, time: Any) -> None:
        original(self, booted, identities, vars(self).get("first_time") or time)
        self.first_time = None


@mutant("SAF-001", wraps=(Processor, "start"))
def outputs_are_high_for_a_tick_at_power_up(original: Any, self: Any, time: Any) -> None:
    """All outputs are high for one tick when period 0 begins: the port is enabled before it has a value."""
    original(self, time)
    self.forced += [Forced(0, ALL_BITS), Forced(1)]


@mutant("REQ-014", "FWU-022", wraps=(Emulator, "revert"))
def revert_only_restarts(_: Any, self: Any) -> Any:
    """REVERT restarts the device as RESET does, but does not void the upgrades."""
    return self.restart()
