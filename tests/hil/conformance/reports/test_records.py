"""The JSON record of a run."""

from __future__ import annotations

import json
from typing import Any

from phasewire.hil.conformance.reports.records import record

from tests.hil.conformance.hand_made_runs import DECISIVE, EVERY, HOSTILE, MATRIX


def written() -> dict[str, Any]:
    """As a program reads it."""
    whole: dict[str, Any] = json.loads(json.dumps(record(EVERY, MATRIX), allow_nan=False))
    return whole


def test_every_field_of_a_result_is_written_and_texts_stay_unchanged() -> None:
    bad = written()["results"][1]
    assert {key: value for key, value in bad.items() if key != "evidence"} == {
        "case": "blocks/bad[a b]",
        "group": "blocks",
        "clauses": ["BLK-003", "ACK-003/1"],
        "sentence": "A bad block is refused, for damage must not play.",
        "verdict": "fail",
        "standing": "fail",
        "breaks": True,
        "reason": "the state is OFF, should be READY",
        "tally": "failed 2 of 2",
        "changed": [],
        "again": "fail",
        "fresh": True,
        "run again": "--only 'blocks/bad[a b]'",
        "tried": None,
        "known": None,
        "seconds": 0.5,
    }
    assert bad["evidence"][0] == {"label": "step 1", "text": "01 00", "meaning": "", "after": False}
    assert [each["text"] for each in bad["evidence"][-3:]] == [HOSTILE, DECISIVE.text, "state OFF"]
    assert [each["meaning"] for each in bad["evidence"][-2:]] == [DECISIVE.meaning, ""]
    assert [each["after"] for each in bad["evidence"][-2:]] == [False, True]
    assert [(one["standing"], one["breaks"]) for one in written()["results"][2:4]] == [
        ("known failure", False),
        ("unexpected pass", True),
    ]
