"""What a page may set: nothing that it sends does harm."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.view.settings import GROUPS, RANGES, Choices, Settings

ALL = Choices(frozenset(GROUPS), 320, ("wgs", "multiplex"), ("pressure", "phase"), ("cube", "sphere"))
NAMES = [name for names in GROUPS.values() for name in names]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


def test_every_setting_belongs_to_one_group_and_is_one() -> None:
    assert sorted(NAMES) == sorted(asdict(Settings()))


@given(st.dictionaries(st.sampled_from(NAMES) | st.text(max_size=8), JSON, max_size=3))
def test_any_value_is_taken_and_can_be_sent_or_is_refused(values: dict[str, Any]) -> None:
    try:
        changed = Settings().changed(values, ALL)
    except ValueError:
        return
    json.dumps(asdict(changed), allow_nan=False)
    hash(changed)


@given(st.data())
def test_numbers_are_taken_within_their_range_only(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from([name for name in RANGES if "." not in name and name not in ("at", "scale")]))
    least, most = RANGES[name]
    inside = data.draw(st.floats(least, most))
    assert getattr(Settings().changed({name: inside}, ALL), name) == inside
    outside = data.draw(st.floats(max_value=least, exclude_max=True) | st.floats(min_value=most, exclude_min=True))
    with pytest.raises(ValueError, match=name):
        Settings().changed({name: outside}, ALL)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"objects": [{"kind": "/etc/passwd"}]}, "cube, sphere"),
        ({"objects": [{"x": 0.1}]}, "kind"),
        ({"objects": [{"kind": "cube"}] * 9}, "at most 8"),
        ({"watched": list(range(9))}, "at most 8"),
        ({"silenced": [320]}, "0 to 319"),
        ({"silenced": [True]}, "0 to 319"),
        ({"pick": -1}, "0 to 319"),
        ({"hand": {"w": 1}}, "x, y, z, turn, curl"),
        ({"method": "magic"}, "wgs, multiplex"),
        ({"probe": [0, 0]}, "three coordinates"),
        ({"colour": 1}, "no setting"),
    ],
)
def test_what_is_wrong_is_said_with_what_would_be_right(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Settings().changed(values, ALL)
