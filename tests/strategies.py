"""Hypothesis strategies and the makings of blocks that several tests share."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from phasewire import ControlPoints, TransducerArray
from phasewire.protocol import NOW, Block, Pulses, Update, pack

CHANNELS = 320


def update(pulses: Pulses, sequence: int, period: int = NOW) -> bytes:
    """The block of an update."""
    return pack(Block(Update(pulses, period), sequence))


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


@st.composite
def arrays_and_points(draw: st.DrawFn) -> tuple[TransducerArray, ControlPoints]:
    """A grid of any size, some of it dead or flipped, and points spread, crowded, repeated or in a line of 3 mm steps.

    Amplitudes are mixed, some of them 0. Many of these problems have no good solution; all must have some.
    """
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    array = TransducerArray.grid(draw(st.integers(1, 20)), draw(st.integers(1, 16)))
    response = rng.choice([1, -1, 0.8j, 0], len(array), p=[0.7, 0.1, 0.1, 0.1])
    response[0] = 1
    m = draw(st.integers(1, 70))
    scattered = rng.uniform([-0.08, -0.08, 0.08], [0.08, 0.08, 0.4], (m, 3))
    middle = np.array([0, 0, 0.2])
    positions = {
        "spread": scattered,
        "crowded": middle + (scattered - middle) / 8,
        "repeated": np.repeat(scattered, 2, axis=0)[:m],
        "line": middle + np.outer(np.arange(m) - m / 2, [0.003, 0, 0]),
    }[draw(st.sampled_from(["spread", "crowded", "repeated", "line"]))]
    amplitudes = rng.uniform(0, 1, m) * (rng.random(m) > 0.2)
    amplitudes[0] = 1
    return array.calibrated(response), ControlPoints(positions, amplitudes)
