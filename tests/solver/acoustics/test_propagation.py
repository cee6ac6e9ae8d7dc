from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Medium, Transducer, TransducerArray, pressure
from phasewire.solver import MODELS, Aperture, residual, slice_field
from phasewire.solver.acoustics.propagation import arrivals, transfer_matrix

AIR = Medium()
K = AIR.wavenumber
RADIUS = 4.5e-3
SINGLE = TransducerArray([[0, 0, 0]], [[0, 0, 1]])
STRENGTH = SINGLE.transducer.strength


POINTS = st.lists(
    st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(0.02, 0.6)), min_size=1, max_size=4
).map(np.array)


@given(POINTS)
def test_turning_array_and_points_together_changes_nothing(points: np.ndarray) -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    array = TransducerArray.grid(4, 3)
    turned = TransducerArray(array.positions @ turn.T, array.normals @ turn.T)
    np.testing.assert_allclose(transfer_matrix(turned, points @ turn.T), transfer_matrix(array, points), rtol=1e-7)


def test_a_bad_point_far_down_the_list_is_named_by_its_number(array: TransducerArray) -> None:
    points = np.full((5000, 3), 0.2)
    points[4321] = array.positions[7] + [0, 0, 1e-3]
    with pytest.raises(ValueError, match=r"point 4321 at .* is 1.00 mm from transducer 7"):
        pressure(array, np.ones(320), points)


def test_the_field_behind_the_baffle_is_zero() -> None:
    assert transfer_matrix(SINGLE, [[0, 0, -0.2], [0.1, 0, 0]]).tolist() == [[0], [0]]


@pytest.mark.parametrize("model", sorted(MODELS))
@given(POINTS)
def test_every_model_is_its_residual_on_a_spherical_wave(model: str, points: np.ndarray) -> None:
    """To 1e-4 for Rayleigh integrals, which are looked up in a table."""
    transducer = Transducer(model=model)
    distance = np.linalg.norm(points, axis=1)
    sine = np.hypot(points[:, 0], points[:, 1]) / distance
    expected = STRENGTH * residual(transducer, sine, distance, AIR) * np.exp(1j * K * distance) / distance
    found = transfer_matrix(TransducerArray([[0, 0, 0]], [[0, 0, 1]], transducer), points, AIR)[:, 0]
    tolerance = 1e-12 if model in ("monopole", "piston") else 1e-4 * np.maximum(1, np.sqrt(distance / 0.3))
    assert (np.abs(found - expected) <= tolerance * STRENGTH / distance).all()


def test_a_slice_of_an_image_equals_the_transfer_matrix() -> None:
    """The paper's way, slice by slice, and the table; on a ring of samples around the axis, at a few heights."""
    aperture = Aperture.disc(RADIUS)
    array = TransducerArray([[0, 0, 0]], [[0, 0, 1]], Transducer(strength=1, model="rayleigh", aperture=aperture))
    for z in (0.03, 0.1, 0.3):
        axis, field = slice_field(aperture, z, 0.1, AIR)
        row = len(axis) // 2
        at = np.stack([axis[::20], np.full_like(axis[::20], axis[row]), np.full_like(axis[::20], z)], axis=1)
        found = transfer_matrix(array, at, AIR)[:, 0]
        np.testing.assert_allclose(found, field[row, ::20], atol=2e-4 / z)


def test_absorption_takes_its_decibels_per_metre() -> None:
    points = [[0, 0, 0.1], [0, 0, 0.6]]
    loss = transfer_matrix(SINGLE, points, Medium(absorbing=True)) / transfer_matrix(SINGLE, points, AIR)
    np.testing.assert_allclose(20 * np.log10(loss[:, 0].real), [-0.1 * 1.318, -0.6 * 1.318], rtol=1e-3)
    np.testing.assert_allclose(loss.imag, 0, atol=1e-12)


@pytest.mark.parametrize(
    ("drive", "at", "message"),
    [
        (object(), [[0, 0, 0.2]], r"drives must be numbers"),
        (np.ones(319), [[0, 0, 0.2]], r"drive has the shape \(319,\), but the array has 320 transducers"),
        (np.ones(320), [[5.15e-3, 5.15e-3, 1e-3]], "point 0 at .* is 1.00 mm from transducer 170"),
    ],
)
def test_bad_input_is_named(array: TransducerArray, drive: np.ndarray, at: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pressure(array, drive, at)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("far", [0.2, 6.0], ids=["compiled", "too far for that"])
def test_arrivals_are_the_transfer_without_the_phase_of_the_way(model: str, far: float) -> None:
    medium = Medium(absorbing=True)
    array = TransducerArray.grid(4, 3, transducer=Transducer(model=model, polarity=-1)).calibrated(
        np.linspace(0.5, 1, 12) * np.exp(1j * np.arange(12))
    )
    at = np.array([[0.03, 0.01, far], [-0.2, 0.1, far / 2], [0.01, 0, 0.05], [0, 0, -0.3]])
    way = np.linalg.norm(at[:, None] - array.positions, axis=2)
    expected = transfer_matrix(array, at, medium) * np.exp(-1j * medium.wavenumber * way)
    found = arrivals(array, at, medium)
    np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())
    with pytest.raises(ValueError, match=r"point 1 at .* mm from transducer 0"):
        arrivals(array, [at[0], array.positions[0]], medium)
