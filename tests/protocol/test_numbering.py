from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.protocol.numbering import follows, missing, successor

NUMBERS = st.integers(0, 2**32 - 1) | st.integers(2**32 - 5, 2**32 - 1) | st.integers(0, 5)


@pytest.mark.parametrize(
    ("number", "last", "expected"),
    [
        (1, 0, True),
        (0, 0, False),
        (0, 1, False),
        (0, 2**32 - 1, True),
        (5, 2**32 - 2, True),
        (2**32 - 1, 0, False),
        (2**31 - 1, 0, True),
        (2**31, 0, False),  # as far ahead as behind: RFC 1982 leaves it open, the specification refuses it
        (0, 2**31, False),
        (2**31 - 2, 2**32 - 1, True),
        (2**31 - 1, 2**32 - 1, False),
    ],
)
def test_by_hand(number: int, last: int, expected: bool) -> None:
    assert follows(number, last) is expected


@given(NUMBERS, NUMBERS)
def test_numbers_of_32_bits_as_arrays_hold_them(number: int, last: int) -> None:
    fixed = np.array([number, last], np.uint32)
    assert follows(*fixed) is follows(number, last)
    assert missing(*fixed) == missing(number, last)
    assert successor(fixed[0]) == successor(number)


@given(NUMBERS, st.integers(0, 2**31 - 2))
def test_what_is_left_out_is_counted_round_the_wrap(last: int, left_out: int) -> None:
    number = last
    for _ in range(min(left_out, 20) + 1):
        number = successor(number)
    if left_out <= 20:
        assert missing(number, last) == left_out
    far = (last + left_out + 1) % 2**32
    assert follows(far, last)
    assert missing(far, last) == left_out
    assert not follows(last, far)
