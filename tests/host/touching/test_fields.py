"""Fields of points that fade: each has the strength of its own level."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Pulses, TransducerArray, pressure
from phasewire.host.touching.fading import Fading
from phasewire.host.touching.fields import PoseSolver

POSITIONS = np.array([[-0.04, -0.03, 0.2], [0.04, -0.03, 0.2], [0.04, 0.03, 0.2], [-0.04, 0.03, 0.2]])


def felt(array: TransducerArray, levels: list[float], amplitudes: list[float]) -> NDArray[np.float64]:
    """The larger |p| of both fields at each point, in Pa."""
    frames = PoseSolver(array, "wgs", 200.0).solve(
        Fading(np.arange(4), POSITIONS, np.array(amplitudes, float), np.array(levels, float))
    )
    drives = [Pulses(*rows).to_drive() for rows in zip(frames.phase, frames.width, strict=True)]
    return np.asarray(np.abs([pressure(array, drive, POSITIONS) for drive in drives]).max(axis=0))


def test_a_point_that_fades_in_beside_others_is_weaker_by_its_level(array: TransducerArray) -> None:
    strength = felt(array, [0.25, 1, 1, 1], [1, 1, 1, 1])
    assert strength[0] / strength[1:].mean() == pytest.approx(0.25, abs=0.05)
    assert strength[1:] / strength[1:].mean() == pytest.approx([1, 1, 1], rel=0.1)


def test_levels_and_amplitudes_multiply(array: TransducerArray) -> None:
    strength = felt(array, [0.5, 1, 1, 1], [1, 0.5, 1, 1])
    assert strength / strength[2] == pytest.approx([0.5, 0.5, 1, 1], abs=0.08)


def test_points_that_all_fade_turn_down_the_whole_field(array: TransducerArray) -> None:
    ones = [1.0] * 4
    assert felt(array, [0.3] * 4, ones) / felt(array, ones, ones) == pytest.approx([0.3] * 4, rel=0.15)
