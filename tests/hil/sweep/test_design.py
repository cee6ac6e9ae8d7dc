from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.hil.sweep.design import FIELDS, RANGES, Design
from phasewire.solver.methods.options import Options

SOURCE = "circle:radius=0.03"


def test_every_option_of_a_method_can_be_set_but_the_time_limit() -> None:
    assert {field.name for field in dataclasses.fields(Options)} - set(FIELDS) == {"phase_seconds"}
    assert Design(source=SOURCE, method="polish", steps=3, gamma=1).options == {"steps": 3, "gamma": 1.0}


@given(name=st.sampled_from(sorted(RANGES)), data=st.data())
def test_numbers_and_their_texts_are_the_same_design(name: str, data: st.DataObject) -> None:
    least, most = RANGES[name]
    kind = st.integers(int(least), int(most)) if FIELDS[name] == "int" else st.floats(least, most)
    value = data.draw(kind)
    design = Design.read({"source": SOURCE, name: value})
    assert getattr(design, name) == value
    assert Design.read({"source": SOURCE, name: repr(value)}) == design


@given(name=st.sampled_from(sorted(RANGES)), data=st.data())
def test_what_is_out_of_range_is_named_with_the_range(name: str, data: st.DataObject) -> None:
    least, most = RANGES[name]
    if FIELDS[name] == "int":
        value: object = data.draw(st.integers(max_value=int(least) - 1) | st.integers(min_value=int(most) + 1))
    else:
        outside = st.floats(max_value=least, exclude_max=True) | st.floats(min_value=most, exclude_min=True)
        value = data.draw(outside | st.just(float("nan")))
    with pytest.raises(ValueError, match=f"^{name} is .*; it must be "):
        Design.read({"source": SOURCE, name: value})


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"columns": 2.5}, "columns is 2.5; it must be a whole number"),
        ({"columns": True}, "columns is True; it must be a whole number"),
        ({"seed": float("inf")}, "seed is inf; it must be a whole number"),
        ({"pitch_mm": "wide"}, "pitch_mm is 'wide'; it must be a finite number"),
        ({"pitch_mm": 10**400}, "pitch_mm is 1000000000.*; it must be a finite number"),
        ({"model": 3}, "model is 3; it must be text"),
        ({"model": "horn"}, "model is 'horn'; it must be one of monopole, piston"),
        ({"quantisation": 1}, "quantisation is '1'; it must be none, pulses or a whole number of phases from 2"),
        ({"quantisation": "-4"}, "quantisation is '-4'"),
        ({"method": "guess"}, "unknown method 'guess'; known are wgs"),
        ({"method": "multiplex", "gamma": 0.5}, "multiplex has no option 'gamma'"),
        ({"gamma": 2}, "gamma 2.0 must be from 0 to 1"),
        ({"phase_seconds": 1}, "there is no field 'phase_seconds'; the fields are source, columns"),
    ],
)
def test_a_bad_value_is_named_with_what_would_be_right(values: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Design.read({"source": SOURCE} | values)


def test_all_bad_values_of_a_row_are_named_at_once() -> None:
    bad: dict[str, Any] = {"colums": 3, "rows": "x", "pitch_mm": -1, "quantisation": 0, "gamma": 7}
    with pytest.raises(ValueError, match="source") as raised:
        Design.read(bad)
    for name in ("'colums'", "source is missing", "rows is 'x'", "pitch_mm is -1.0 mm", "quantisation is '0'", "gamma"):
        assert name in str(raised.value)
