from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest
from phasewire.protocol.codes import Fault, Feature, Reason
from phasewire.protocol.plain import plain
from phasewire.protocol.pulses import Pulses


@dataclass(frozen=True)
class Thing:
    reason: Reason
    parts: tuple[bytes, ...]


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (7, 7),
        ("text", "text"),
        (None, None),
        (b"\x01\xff", "01ff"),
        (Reason.IN_USE, "IN_USE"),
        (Fault.CHAIN | Fault.FLASH, ["CHAIN", "FLASH"]),
        (Fault(0), []),
        (Feature.DFU | Feature(0x8100), ["DFU", 0x8100]),  # bits of a later version
        (np.arange(3), [0, 1, 2]),
        ({"a": (b"\0", [Reason.RATE])}, {"a": ["00", ["RATE"]]}),
        (Thing(Reason.EMPTY, (b"", b"\x10")), {"reason": "EMPTY", "parts": ["", "10"]}),
        (Pulses([1, 1, 3], [2, 2, 2]), [[1, 2, 2], [3, 2, 1]]),
    ],
)
def test_values_as_json_can_hold_them(value: object, said: object) -> None:
    assert plain(value) == said
    assert json.loads(json.dumps(plain(value))) == said


def test_pulses_can_have_another_form_at_any_depth() -> None:
    assert plain({"all": [Pulses.silent(320)]}, pulses=len) == {"all": [320]}
