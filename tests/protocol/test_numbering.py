from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from phasewire.protocol.numbering import follows, missing, successor

NUMBERS = st.integers(0, 2**32 - 1) | st.integers(2**32 - 5, 2**32 - 1) | st.integers(0, 5)


@given(NUMBERS, NUMBERS)
def test_numbers_of_32_bits_as_arrays_hold_them(number: int, last: int) -> None:
    fixed = np.array([number, last], np.uint32)
    assert follows(*fixed) is follows(number, last)
    assert missing(*fixed) == missing(number, last)
    assert successor(fixed[0]) == successor(number)
