"""The message of a case if a value is not the expected one."""

from __future__ import annotations

import pytest
from phasewire.hil.conformance.cases import case, expect
from phasewire.protocol.codes import DfuState, Fault, Reason, State


@pytest.mark.parametrize(
    ("seen", "wanted", "said"),
    [
        (State.OFF, State.READY, "it is OFF, should be READY"),
        (2, State.OFF, f"it is {State(2).name}, should be OFF"),
        (State.OFF, 1, f"it is OFF, should be {State(1).name}"),
        (200, State.OFF, "it is 200, should be OFF"),
        (Fault.TEMPERATURE, Fault(0), "it is TEMPERATURE, should be none"),
        ([0, Reason.CHECKSUM], [Reason.ACCEPTED], "it is [ACCEPTED, CHECKSUM], should be [ACCEPTED]"),
        (DfuState.DFU_IDLE, None, "it is DFU_IDLE, should be None"),
        (b"", b"\x01", "it is nothing, should be 01"),
        (True, False, "it is True, should be False"),
        (3, 4, "it is 3, should be 4"),
    ],
)
def test_codes_are_shown_by_name(seen: object, wanted: object, said: str) -> None:
    with pytest.raises(AssertionError) as error:
        expect("it", seen, wanted)
    assert str(error.value) == said


def test_a_case_asks_for_a_revision_in_which_one_of_its_clauses_changed() -> None:
    def judged() -> None:
        """It is so."""

    case("CON-003", "BLK-003", since=2)(judged)
    with pytest.raises(ValueError, match="none of CON-003, BLK-003 changed in revision 3"):
        case("CON-003", "BLK-003", since=3)(judged)
