"""Measures against closed forms and sums of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from phasewire import Circle, ControlPoints, Medium, Outline, TransducerArray, render
from phasewire.hil.loop.sensing import sense, skin_over
from phasewire.hil.sweep.design import Design
from phasewire.hil.sweep.measures import emitted, measure, quantised

SOURCE = "circle:radius=0.03"
FOCUS = np.array([0.013, -0.021, 0.17])
PAIR = np.array([[-0.03, 0.004, 0.18], [0.028, -0.007, 0.18]])


def single(**fields: object) -> Design:
    """All transducers at full drive, each with the phase that the focus needs."""
    return Design.read({"source": SOURCE, "method": "multiplex"} | fields)


def waves(array: TransducerArray, at: NDArray[np.float64], celsius: float) -> NDArray[np.complex128]:
    """Pressure at places (m, 3) by full drive of each piston that looks up, (m, n)."""
    k = 2 * math.pi * 40_000 / (331.3 * math.sqrt(1 + celsius / 273.15))
    way = at[:, None] - array.positions
    r = np.sqrt((way**2).sum(axis=2))
    x = k * 4.5e-3 * np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2) / r
    return np.asarray(5.73 * array.response * 2 * scipy.special.j1(x) / x * np.exp(1j * k * r) / r)


def test_strength_and_spread_of_two_foci_are_those_of_what_is_built() -> None:
    design = Design(
        source=SOURCE, tolerance_mm=0.4, gain_error_db=1.5, phase_error_deg=30, temperature_c=31, quantisation="pulses"
    )
    emission = emitted(design, ControlPoints(PAIR))
    first, second = np.abs(waves(emission.array, PAIR, 31) @ quantised(emission.drive, design))
    found = measure(design, ControlPoints(PAIR))
    assert abs(first - second) > 0.005 * first
    assert found.strength_pa == pytest.approx((first + second) / 2)
    assert found.least_pa == pytest.approx(min(first, second))
    assert found.spread == pytest.approx(abs(first - second) / (first + second))


def test_the_strongest_lobe_of_a_square_is_that_of_a_sinc() -> None:
    """Whose first side lobe is 13.26 dB below its maximum."""
    design = single(columns=40, rows=40, pitch_mm=4.2, model="monopole")
    found = measure(design, ControlPoints([[0, 0, 0.3]]))
    assert found.ghosts == 0
    assert found.lobe_db == pytest.approx(-13.26, abs=0.5)


def test_a_focus_half_a_grating_s_angle_off_the_axis_has_a_ghost_on_the_other_side() -> None:
    """A pitch d cannot tell sin θ from sin θ − λ/d: at λ/2d the two are mirror images."""
    wavelength, height = Medium().wavelength, 0.25
    pitch = 2 * wavelength
    aside = height * math.tan(math.asin(wavelength / (2 * pitch)))
    design = single(columns=8, rows=8, pitch_mm=pitch * 1e3, model="monopole")
    found = measure(design, ControlPoints([[aside, 0, height]]))
    assert found.lobe_db == pytest.approx(0, abs=1)
    assert found.ghosts >= 1
    assert measure(single(columns=8, rows=8, model="monopole"), ControlPoints([[aside, 0, height]])).ghosts == 0


def test_phase_errors_weaken_a_focus_by_half_the_square_of_their_deviation() -> None:
    points, whole = ControlPoints([FOCUS]), measure(single(), ControlPoints([FOCUS])).strength_pa
    parts = [measure(single(phase_error_deg=45, seed=seed), points).strength_pa / whole for seed in range(4)]
    sigma = math.radians(45)
    chance = (1 - math.exp(-(sigma**2))) / math.sqrt(2 * 320 * len(parts))
    assert np.mean(parts) == pytest.approx(math.exp(-(sigma**2) / 2), abs=5 * chance)
    assert len(set(parts)) == len(parts)


def test_gain_errors_have_their_deviation_in_decibels_and_nothing_else() -> None:
    response = emitted(single(gain_error_db=2, columns=60, rows=60), ControlPoints([FOCUS])).array.response
    assert np.abs(response) == pytest.approx(response)
    decibels = 20 * np.log10(np.abs(response))
    assert decibels.std() == pytest.approx(2, rel=5 / math.sqrt(2 * len(decibels)))
    assert decibels.mean() == pytest.approx(0, abs=5 * 2 / math.sqrt(len(decibels)))


def test_a_tolerance_moves_each_coordinate_by_its_deviation() -> None:
    design = single(tolerance_mm=0.3, columns=60, rows=60)
    moved = emitted(design, ControlPoints([FOCUS])).array.positions - design.array().positions
    assert moved.std(axis=0) == pytest.approx(0.3e-3, rel=5 / math.sqrt(2 * len(moved)))
    together = np.asarray(np.corrcoef(moved.T))
    assert together == pytest.approx(np.eye(3), abs=5 / math.sqrt(len(moved)))


def test_designs_with_one_seed_share_their_errors_and_one_error_leaves_the_others() -> None:
    points = ControlPoints([FOCUS])
    first = emitted(single(phase_error_deg=10, seed=7), points).array
    second = emitted(single(phase_error_deg=20, tolerance_mm=0.2, seed=7), points).array
    third = emitted(single(phase_error_deg=10, seed=8), points).array
    assert np.angle(second.response) == pytest.approx(2 * np.angle(first.response))
    assert not np.allclose(first.response, third.response, atol=0.01)


@pytest.mark.parametrize("levels", [2, 4, 16])
def test_phases_in_steps_weaken_a_focus_by_a_sinc(levels: int) -> None:
    """The mean of e^{iε} over |ε| ≤ π/levels."""
    points = ControlPoints([FOCUS])
    part = measure(single(quantisation=levels), points).strength_pa / measure(single(), points).strength_pa
    assert part == pytest.approx(np.sinc(1 / levels), abs=0.03)


def test_the_board_s_pulses_cost_next_to_nothing() -> None:
    points = ControlPoints([FOCUS])
    exact, pulses = (measure(single(quantisation=kind), points).strength_pa for kind in ("none", "pulses"))
    assert exact != pulses
    assert pulses == pytest.approx(exact * np.sinc(1 / 50), rel=2e-3)  # 25 ticks wide: 50 phases


@pytest.mark.slow
def test_the_audible_level_is_that_of_what_emulated_boards_emit() -> None:
    outline = Outline.of(Circle(radius=0.03))
    design = Design(source=SOURCE, quantisation="pulses")
    cycle = render(TransducerArray.grid(), outline, "am:frequency=200")
    heard = sense(cycle, skin_over(outline)).sound.levels_dba.max()
    found = measure(design, outline.points).audible_dba
    assert found == pytest.approx(heard, abs=2)
