"""The states of a device and what takes it from one to another (SPEC.md, chapter STA)."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from .codes import State

__all__ = ["TRANSITIONS", "StateEvent", "after"]


class StateEvent(Enum):
    """What can happen to a device (clause STA-002)."""

    ENABLE = "the ENABLE request"
    DISABLE = "the DISABLE request, or an OUTPUT block that disables takes effect"
    PLAY = "an update or an attended sequence takes effect"
    PLAY_UNATTENDED = "a sequence takes effect that may go on without the host"
    END = "a sequence has played its last repeat, or an OUTPUT block that silences takes effect"
    WATCHDOG = "the watchdog's time is over without a sign of life"
    FAULT = "a silencing fault appears"
    CLEAR = "the CLEAR_FAULTS request, and no silencing fault persists"
    BUS_RESET = "USB bus reset, SET_CONFIGURATION, or SET_INTERFACE of interface 0"
    SUSPEND = "the bus that had configured the device is suspended, or its cable unplugged"
    RESUME = "the bus resumes"
    DETACH = "the DFU interface is asked to detach"
    RESTART = "power-up, the request RESET or REVERT, or a bus reset that ends DFU mode"


_ENABLED = {
    StateEvent.DISABLE: State.OFF,
    StateEvent.PLAY: State.PLAYING,
    StateEvent.PLAY_UNATTENDED: State.UNATTENDED,
    StateEvent.END: State.READY,
    StateEvent.FAULT: State.FAULT,
    StateEvent.BUS_RESET: State.OFF,
    StateEvent.DETACH: State.DFU,
}
_ATTENDED = _ENABLED | {StateEvent.WATCHDOG: State.OFF, StateEvent.SUSPEND: State.SUSPENDED}
_CHANGES: dict[State, dict[StateEvent, State]] = {
    State.OFF: {
        StateEvent.ENABLE: State.READY,
        StateEvent.FAULT: State.FAULT,
        StateEvent.SUSPEND: State.SUSPENDED,
        StateEvent.DETACH: State.DFU,
    },
    State.READY: _ATTENDED,
    State.PLAYING: _ATTENDED,
    State.UNATTENDED: _ENABLED,
    State.FAULT: {StateEvent.CLEAR: State.OFF, StateEvent.DETACH: State.DFU},
    State.SUSPENDED: {StateEvent.RESUME: State.OFF, StateEvent.BUS_RESET: State.OFF, StateEvent.FAULT: State.FAULT},
    State.DFU: {},
}

TRANSITIONS: Mapping[tuple[State, StateEvent], State] = MappingProxyType(
    {
        (state, event): State.OFF if event is StateEvent.RESTART else _CHANGES[state].get(event, state)
        for state in State
        for event in StateEvent
    }
)
"""The state that follows, for every state and every event; if nothing happens it is the same."""


def after(state: State, event: StateEvent) -> State:
    """The state in which an event leaves a device (clause STA-003)."""
    return TRANSITIONS[state, event]
