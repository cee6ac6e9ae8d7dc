"""Fields of points that fade: each has the strength of its own level."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Calibration, ControlPoints, Pulses, TransducerArray, pressure
from phasewire.host.touching.fading import Fading
from phasewire.host.touching.fields import PoseSolver
from phasewire.protocol.quantise import PulseFrames, quantise
from phasewire.solver import transfer_matrix
from phasewire.solver.rendering.outline import Outline
from phasewire.solver.rendering.renderer import Renderer
from phasewire.solver.rendering.ways import Halves, parse_way

POSITIONS = np.array([[-0.04, -0.03, 0.2], [0.04, -0.03, 0.2], [0.04, 0.03, 0.2], [-0.04, 0.03, 0.2]])


def felt(array: TransducerArray, levels: list[float], amplitudes: list[float]) -> NDArray[np.float64]:
    """The larger |p| of both fields at each point, in Pa."""
    frames = (
        PoseSolver(array, Halves(envelope="square"), "wgs", 2)
        .solve(Fading(np.arange(4), POSITIONS, np.array(amplitudes, float), np.array(levels, float)))
        .frames
    )
    drives = [Pulses(*rows).to_drive() for rows in zip(frames.phase, frames.width, strict=True)]
    return np.asarray(np.abs([pressure(array, drive, POSITIONS) for drive in drives]).max(axis=0))


def test_levels_and_amplitudes_multiply(array: TransducerArray) -> None:
    strength = felt(array, [0.5, 1, 1, 1], [1, 0.5, 1, 1])
    assert strength / strength[2] == pytest.approx([0.5, 0.5, 1, 1], abs=0.08)


WAYS = ["two-sided:envelope=square", "two-sided", "am", "lm", "stm:modulation=100"]
SQUARE = (np.concatenate([POSITIONS, POSITIONS[:1]]),)


def fading(level: float = 1.0, shift: float = 0.0) -> Fading:
    return Fading(np.arange(4), POSITIONS + np.array([shift, 0, 0]), np.ones(4), np.full(4, level))


def emitted(frames: PulseFrames) -> NDArray[np.complex128]:
    return np.stack([frames.pulses(number).to_drive() for number in range(len(frames.phase))])


@pytest.mark.parametrize("way", WAYS)
def test_a_pose_is_the_renderers_cycle_and_points_keep_their_phases(array: TransducerArray, way: str) -> None:
    solver, renderer = PoseSolver(array, parse_way(way), "wgs", 24), Renderer(array, way, most_frames=24)
    for shift in (0.0, 0.001, 0.002):
        pose = fading(shift=shift)
        cycle = renderer.render(Outline(SQUARE, ControlPoints(pose.positions), pose.ids))
        found = solver.solve(pose, SQUARE)
        for rows, wanted in zip(found.frames, quantise(cycle.drives), strict=True):
            np.testing.assert_array_equal(rows, wanted)
        assert (found.hold, found.envelope, found.periods) == (cycle.hold, cycle.envelope, cycle.periods)


@pytest.mark.parametrize("way", WAYS)
def test_in_each_way_points_that_all_fade_turn_down_the_whole(array: TransducerArray, way: str) -> None:
    whole, weak = (
        emitted(PoseSolver(array, parse_way(way), "wgs", 24).solve(fading(level), SQUARE).frames)
        for level in (1.0, 0.4)
    )
    assert np.abs(weak - 0.4 * whole).max() < 0.07, "within the steps of pulses"


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("calibrated", [False, True])
def test_a_limit_is_kept_by_what_is_emitted(array: TransducerArray, way: str, calibrated: bool) -> None:
    at = transfer_matrix(array, np.array([[0.0, -0.3, 0.4]])).T
    responses = np.linspace(1, 2, 320)
    calibration = Calibration(responses, np.linspace(0, 90, 320), np.ones(320), np.zeros(320)) if calibrated else None
    most = np.inf

    def felt(drives: NDArray[Any]) -> float:
        return float(np.abs(drives @ at).max())

    def limit(drives: NDArray[Any]) -> float:
        return 1 / max(1.0, felt(drives) / most)

    response = 1.0 if calibration is None else calibration.response
    free, kept = (PoseSolver(array, parse_way(way), "wgs", 24, calibration, rule) for rule in (None, limit))
    for shift in np.linspace(-0.03, 0.03, 5):
        most = 0.3 * felt(emitted(free.solve(fading(shift=shift), SQUARE).frames) * response)
        assert 0.1 * most < felt(emitted(kept.solve(fading(shift=shift), SQUARE).frames) * response) <= most
    assert free.least_gain == 1
    assert 0 < kept.least_gain < 1
