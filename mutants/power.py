"""Broken behaviour of the bus and of restarts: suspend, reset, and what begins anew (chapters STA, USB and REQ)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..emulator.boards.processor import Processor
from ..emulator.control import controller
from ..emulator.interfaces.usb_functions import ArrayFunction
from ..emulator.machine import Emulator
from ..emulator.ports.capture import Forced
from ..protocol.replies import ENABLED
from ..protocol.states import Event
from .patching import Patch, mutant

Controller = controller.Controller
ALL_BITS = 2**32 - 1


# The bus


@mutant("USB-020", "STA-003")
def suspend_is_ignored(patch: Patch) -> None:
    """While the bus is suspended, or its cable out, the outputs go on: nobody handles the interrupt of the idle bus."""
    patch.replace(ArrayFunction, "suspend", lambda *_: None)


@mutant("USB-020", "STA-003")
def resume_enables_again(patch: Patch) -> None:
    """On resume the outputs are enabled again where they were before: the state is restored."""

    @patch.around(Controller, "suspend")
    def of_suspend(original: Any, self: Any) -> None:
        self.was_enabled = self.state in ENABLED
        original(self)

    @patch.around(Controller, "resume")
    def of_resume(original: Any, self: Any) -> None:
        original(self)
        if self.was_enabled:
            self._happen(Event.ENABLE, self._now)


@mutant("ACK-006", "USB-020")
def suspend_and_resume_are_not_told(patch: Patch) -> None:
    """No status record of suspend and resume waits for the host when it is back."""
    patch.replace(controller, "SPOKEN", (Event.WATCHDOG, Event.FAULT))


@mutant("USB-020", wraps=(ArrayFunction, "resume"))
def resume_drops_waiting_records(original: Any, self: Any) -> None:
    """Records that waited when the bus was suspended are gone when it resumes: the endpoints are set up anew."""
    self._records.clear()
    self._unasked = b""
    original(self)


@mutant("USB-003", "STA-003", "USB-016", wraps=(Controller, "new_session"))
def bus_reset_keeps_playing(_: Any, self: Any, _door: Any) -> None:
    """A bus reset, SET_CONFIGURATION and SET_INTERFACE begin a new numbering, and what plays goes on."""
    self.settle()
    self._last_sequence = None


# Restarts


def _keep_over_reset(patch: Patch, save: Callable[[Any], Any], restore: Callable[[Any, Any], None]) -> None:
    """Let something of the controller, which a function gives, outlive RESET; another gives it to the next one."""

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
    """The watchdog time is the same after RESET: it lies in memory that is not cleared."""
    _keep_over_reset(
        patch,
        lambda device: device._watchdog.milliseconds,
        lambda device, milliseconds: device._watchdog.set_time(milliseconds),
    )


@mutant("REQ-010", "REQ-013")
def reset_keeps_the_drive_limit(patch: Patch) -> None:
    """The drive limit is the same after RESET: it lies in memory that is not cleared."""
    _keep_over_reset(
        patch, lambda device: device._drive_limit, lambda device, limit: setattr(device, "_drive_limit", limit)
    )


@mutant("REQ-013", "REQ-003")
def reset_keeps_the_counters(patch: Patch) -> None:
    """The counts of blocks go on over RESET, as if they counted from when the device was made."""
    names = ("_accepted", "_refused", "_late", "_lost")

    def restore(device: Any, counts: tuple[int, ...]) -> None:
        for name, count in zip(names, counts, strict=True):
            setattr(device, name, count)

    _keep_over_reset(patch, lambda device: tuple(getattr(device, name) for name in names), restore)


@mutant("NUM-004", "REQ-013", url="emulator:?door=serial")
def reset_keeps_the_number_of_the_last_block(patch: Patch) -> None:
    """After RESET the first number has to follow the last one before, if no bus begins a new session."""
    _keep_over_reset(
        patch,
        lambda device: device._last_sequence,
        lambda device, number: setattr(device, "_last_sequence", number),
    )


@mutant("REQ-013", "TIM-002")
def time_goes_on_over_a_reset(patch: Patch) -> None:
    """Ticks and periods go on over RESET: the port clocks are not stopped, and the controller counts on."""

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
    """All outputs are high for one tick when period 0 begins: the port is switched on before it is given a value."""
    original(self, time)
    self.forced += [Forced(0, ALL_BITS), Forced(1)]


@mutant("REQ-014", "FWU-022", wraps=(Emulator, "revert"))
def revert_only_restarts(_: Any, self: Any) -> Any:
    """REVERT restarts the device as RESET does, and leaves the upgrades as they are."""
    return self.restart()
