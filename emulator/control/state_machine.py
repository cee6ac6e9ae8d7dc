"""The states of the device: what takes it from one to another (clause STA-003), and what follows from that.

It alone changes the state. It owns the watchdog, which runs in some states only, and the doors that are told of a
change. When the outputs turn off it drops what is queued and has silence sent by `Dispatch`. It judges no block and no
request, and it does not know why something happens.
"""

from __future__ import annotations

from collections.abc import Callable

from ...protocol.codes import State
from ...protocol.replies import ENABLED, Status
from ...protocol.states import StateEvent, after
from ..door import Door
from .device_state import DeviceState
from .dispatch import STOP_MODULATION, Dispatch
from .watchdog import Watchdog

__all__ = ["WATCHED", "StateMachine"]

STATE_BITS = 3
SPOKEN = (StateEvent.WATCHDOG, StateEvent.FAULT, StateEvent.SUSPEND, StateEvent.RESUME)
"""Events after which the device says its state unasked (clause ACK-006)."""
WATCHED = (State.READY, State.PLAYING)


class StateMachine:
    """Follows what happens to the device."""

    def __init__(
        self, device: DeviceState, dispatch: Dispatch, *, log: Callable[[str], None], status: Callable[[], Status]
    ) -> None:
        self._device = device
        self._dispatch = dispatch
        self._log = log
        self._status = status
        self._doors: list[Door] = []
        self.watchdog = Watchdog(dispatch.scheduler, dispatch.settle, self._watchdog_fires)

    def attach(self, door: Door) -> None:
        """From now on send unsolicited records to a door."""
        self._doors.append(door)

    def happen(self, event: StateEvent, at: int, door: Door | None = None, *, silent: bool = False) -> None:
        """Something happened at a core cycle, by what came through a door if any: follow clause STA-003.

        `silent` says that the outputs have just fallen silent, with nothing on the chain after that.
        """
        device, dispatch = self._device, self._dispatch
        was, device.state = device.state, after(device.state, event)
        if device.state is was:
            return
        self._log(f"{event.name}: {was.name} to {device.state.name}")
        self._trace(at)
        if event is StateEvent.ENABLE:
            device.watchdog_fired = False
        if was in ENABLED and device.state not in ENABLED:
            self._drop_all()
            if not silent:
                dispatch.send_silence((STOP_MODULATION,) if dispatch.agenda.tail.modulated else ())
            dispatch.announce_room()
        if device.state in WATCHED and was not in WATCHED:
            self.watchdog.watch(at)
        elif device.state not in WATCHED:
            self.watchdog.rest()
        if device.bus_suspended and after(device.state, StateEvent.SUSPEND) is not device.state:
            self.happen(StateEvent.SUSPEND, at)  # clause STA-004
        elif event in SPOKEN or door is not None:
            self.send_status(except_to=door)

    def _drop_all(self) -> None:
        """Drop what is queued, and forget what plays (clause SAF-004)."""
        self._dispatch.drop()
        self._device.play_nothing()
        self._log("outputs disabled")

    def _watchdog_fires(self) -> None:
        self._log(f"watchdog: no word from the host for {self.watchdog.milliseconds} ms")
        self._device.watchdog_fired = True
        self.happen(StateEvent.WATCHDOG, self._dispatch.now)

    def send_status(self, except_to: Door | None = None) -> None:
        """Send an unsolicited status record to all doors but the one that changed the state (clause ACK-006)."""
        status = self._status().encode()
        for door in self._doors:
            if door is not except_to:
                door.notify(status)

    def unfold(self) -> None:
        """Somebody may look on from now on: tell the tracer the state."""
        self._trace(self._dispatch.now)

    def _trace(self, at: int) -> None:
        self._dispatch.chain.tracer.value(at, "controller.state", STATE_BITS, self._device.state)

    # The bus

    def new_session(self, door: Door) -> None:
        """The bus was reset, or the host (re)configured the device (clauses USB-003 and NUM-004)."""
        self._dispatch.settle()
        self.happen(StateEvent.BUS_RESET, self._dispatch.now, door)
        self._device.last_sequence = None

    def suspend(self) -> None:
        """The bus that had configured the device is suspended."""
        self._dispatch.settle()
        self._device.bus_suspended = True
        self.happen(StateEvent.SUSPEND, self._dispatch.now)

    def resume(self) -> None:
        """The bus resumes, or is gone for good."""
        self._dispatch.settle()
        self._device.bus_suspended = False
        self.happen(StateEvent.RESUME, self._dispatch.now)

    def detach(self, door: Door) -> bool:
        """The device is asked through a door to detach; whether it does, in its state."""
        self._dispatch.settle()
        if after(self._device.state, StateEvent.DETACH) is self._device.state:
            return False
        self.happen(StateEvent.DETACH, self._dispatch.now, door)
        return True
