"""The states of a device and what takes it from one to another (SPEC.md, chapter STA)."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from .codes import State

__all__ = ["TRANSITIONS", "Event", "after"]


class Event(Enum):
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
    Event.DISABLE: State.OFF,
    Event.PLAY: State.PLAYING,
    Event.PLAY_UNATTENDED: State.UNATTENDED,
    Event.END: State.READY,
    Event.FAULT: State.FAULT,
    Event.BUS_RESET: State.OFF,
    Event.DETACH: State.DFU,
}
_ATTENDED = _ENABLED | {Event.WATCHDOG: State.OFF, Event.SUSPEND: State.SUSPENDED}
_CHANGES: dict[State, dict[Event, State]] = {
    State.OFF: {
        Event.ENABLE: State.READY,
        Event.FAULT: State.FAULT,
        Event.SUSPEND: State.SUSPENDED,
        Event.DETACH: State.DFU,
    },
    State.READY: _ATTENDED,
    State.PLAYING: _ATTENDED,
    State.UNATTENDED: _ENABLED,
    State.FAULT: {Event.CLEAR: State.OFF, Event.DETACH: State.DFU},
    State.SUSPENDED: {Event.RESUME: State.OFF, Event.BUS_RESET: State.OFF, Event.FAULT: State.FAULT},
    State.DFU: {},
}

TRANSITIONS: Mapping[tuple[State, Event], State] = MappingProxyType(
    {
        (state, event): State.OFF if event is Event.RESTART else _CHANGES[state].get(event, state)
        for state in State
        for event in Event
    }
)
"""The state that follows, for every state and every event; if nothing happens it is the same."""


def after(state: State, event: Event) -> State:
    """The state in which an event leaves a device (clause STA-003)."""
    return TRANSITIONS[state, event]
