"""Messages in bytes: a decoder of the test's own reads them, and no text from a page is taken for what it is not."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn
from phasewire.view.messages import encode, read_command

from .pages import Message

ARRAYS = hn.arrays(
    st.sampled_from([np.uint8, np.uint32]), hn.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=5)
)


@given(st.dictionaries(st.text("abc", min_size=1, max_size=3), ARRAYS, max_size=4), st.text())
def test_a_message_says_where_its_arrays_are(arrays: dict[str, Any], text: str) -> None:
    message = Message(encode("frame", {"text": text}, arrays))
    assert message["kind"] == "frame"
    assert message["text"] == text
    for name, values in arrays.items():
        np.testing.assert_array_equal(message.array(name), values)
        assert message.array(name).shape == values.shape


@given(st.text())
def test_any_text_is_a_command_or_refused(text: str) -> None:
    try:
        read_command(text)
    except ValueError:
        return
    assert isinstance(json.loads(text), dict)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"set": []}',
        '{"set": {}, "do": "stop"}',
        '{"do": "stop", "more": 1}',
        '{"do": "explode"}',
        '{"do": "fault"}',
        '{"do": "stop", "fault": {}}',
        "[" * 100_000,
    ],
)
def test_what_is_no_command_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="command must be"):
        read_command(text)
