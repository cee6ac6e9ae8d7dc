"""Hypothesis strategies that several tests share."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from phasewire.protocol import Pulses

CHANNELS = 320


def pulses(n: int = CHANNELS) -> st.SearchStrategy[Pulses]:
    """Any valid pulses, exact or not."""
    phases = hnp.arrays(np.uint8, n, elements=st.integers(0, 99))
    widths = hnp.arrays(np.uint8, n, elements=st.integers(0, 25))
    return st.builds(Pulses, phases, widths)


def drives(n: int) -> st.SearchStrategy[np.ndarray]:
    """Any drives within the unit disc."""
    magnitudes = hnp.arrays(np.float64, n, elements=st.floats(0, 1))
    angles = hnp.arrays(np.float64, n, elements=st.floats(-10, 10))
    return st.builds(lambda r, a: r * np.exp(1j * a), magnitudes, angles)
