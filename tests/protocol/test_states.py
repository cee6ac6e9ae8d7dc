from __future__ import annotations

import re

import pytest
from phasewire.protocol import State
from phasewire.protocol.codes import SILENCING_FAULTS, Fault
from phasewire.protocol.states import TRANSITIONS, StateEvent, after

from tests.specification import SPEC, table

ENABLED = {State.READY, State.PLAYING, State.UNATTENDED}
CHANGES = {
    pair: state for pair, state in TRANSITIONS.items() if state is not pair[0] and pair[1] is not StateEvent.RESTART
}
"""RESTART leads from everywhere to OFF, which the specification says once."""


def test_every_state_and_event_leads_somewhere() -> None:
    assert set(TRANSITIONS) == {(state, event) for state in State for event in StateEvent}
    assert set(TRANSITIONS.values()) == set(State)


def test_the_specification_s_diagram_shows_these_transitions() -> None:
    diagram = SPEC.split("%% device states\n")[1].split("```")[0]
    drawn = {
        (State[before], StateEvent[event], State[following])
        for before, following, events in re.findall(r"^ *(\w+) --> (\w+) *: (.*)$", diagram, re.MULTILINE)
        if before in State.__members__
        for event in events.split(", ")
    }
    assert drawn == {(*pair, state) for pair, state in CHANGES.items()}


def test_the_specification_names_the_events() -> None:
    named = {row[0].strip("`"): row[1] for row in table("table: Event")}
    assert named == {event.name: event.value for event in StateEvent}


def test_codes_of_faults_are_the_specification_s() -> None:
    rows = {row[1].strip("`"): (int(row[0]), row[2]) for row in table("table: Fault")}
    assert {name: (1 << bit, silences == "yes") for name, (bit, silences) in rows.items()} == {
        fault.name: (fault.value, bool(fault & SILENCING_FAULTS)) for fault in Fault
    }


@pytest.mark.parametrize(
    "event", [StateEvent.DISABLE, StateEvent.BUS_RESET, StateEvent.RESTART, StateEvent.FAULT, StateEvent.DETACH]
)
def test_events_that_must_silence_do_so_from_every_state(event: StateEvent) -> None:
    """Safety by chapter SAF, not by the table."""
    assert all(after(state, event) not in ENABLED for state in State)


def test_only_a_request_enables() -> None:
    for (before, event), following in TRANSITIONS.items():
        if following in ENABLED and before not in ENABLED:
            assert (before, event) == (State.OFF, StateEvent.ENABLE)


def test_without_a_host_only_an_unattended_sequence_goes_on() -> None:
    for event in (StateEvent.WATCHDOG, StateEvent.SUSPEND):
        still = {state for state in ENABLED if after(state, event) in ENABLED}
        assert still == {State.UNATTENDED}
    assert after(after(State.UNATTENDED, StateEvent.END), StateEvent.WATCHDOG) is State.OFF


def test_a_fault_lasts_until_it_is_cleared() -> None:
    leaving = {event for event in StateEvent if after(State.FAULT, event) is not State.FAULT}
    assert leaving == {StateEvent.CLEAR, StateEvent.DETACH, StateEvent.RESTART}
