"""Images of planes against the sum over all transducers, in their values and in their place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import ControlPoints, Modulation, TransducerArray, intensity, pressure, solve
from phasewire.solver import intensity_component
from phasewire.solver.fields.quantities import sound_pressure_level
from phasewire.view.painting import IMAGE_QUANTITIES, PLANES, Painted, Painter
from phasewire.view.settings import Settings
from phasewire.view.snapshot import Emitter, Snapshot

pytestmark = pytest.mark.slow  # each sums up a whole field literally

Drive = NDArray[np.complex128]
ARRAY = TransducerArray.grid()
FOCUS = (0.03, -0.05, 0.18)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return solve(ARRAY, ControlPoints([FOCUS])).drive


@pytest.fixture(scope="module")
def other() -> Drive:
    return solve(ARRAY, ControlPoints([(-0.04, 0.02, 0.15)])).drive


@pytest.fixture(scope="module")
def both(drive: Drive, other: Drive) -> Snapshot:
    return Snapshot(np.stack([drive, other]))


def places(image: Painted) -> NDArray[np.float64]:
    """Where the samples of an image are, as a page takes it, (rows, columns, 3)."""
    rows, columns = image.levels.shape
    along = np.linspace(0, 1, columns)[:, None] * image.u
    return np.asarray(image.corner + np.linspace(0, 1, rows)[:, None, None] * image.v + along)


def paint(snapshot: Snapshot, array: TransducerArray = ARRAY, **values: Any) -> tuple[list[Painted], dict[str, Any]]:
    return Painter(Emitter(array)).paint(snapshot, Settings(**values))


@pytest.mark.parametrize("name", PLANES)
@pytest.mark.parametrize(
    "array",
    [pytest.param(ARRAY, id="flat"), pytest.param(ARRAY.rotated(7, (1, 0, 0)), id="tilted")],
)
@settings(max_examples=5)
@given(at=st.floats(0.1, 0.2), seed=st.integers(0, 2**32 - 1))
def test_every_sample_is_the_sum_over_the_transducers(name: str, array: TransducerArray, at: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    drive = generator.uniform(0, 1, 320) * np.exp(2j * np.pi * generator.uniform(0, 1, 320))
    chosen = {plane: plane == name for plane in PLANES} | {f"{name}_at": at}
    [image], scale = paint(Snapshot(drive[None]), array, **chosen)
    direct = np.abs(pressure(array, drive, places(image).reshape(-1, 3))).reshape(image.levels.shape)
    assert min(image.levels.shape) >= 100
    np.testing.assert_allclose(image.levels * (scale["largest"] / 255), direct, atol=1.01 * scale["largest"] / 255)


def test_phases_go_round_once(drive: Drive) -> None:
    [image], scale = paint(Snapshot(drive[None]), quantity="phase", xy_at=FOCUS[2])
    direct = np.angle(pressure(ARRAY, drive, places(image).reshape(-1, 3))).reshape(image.levels.shape)
    difference = (image.levels * (2 * np.pi / 256) - direct + np.pi) % (2 * np.pi) - np.pi
    strong = np.abs(pressure(ARRAY, drive, places(image).reshape(-1, 3))).reshape(image.levels.shape) > 20
    assert np.abs(difference[strong]).max() < 2 * np.pi / 128
    assert (scale["largest"], scale["unit"], scale["cyclic"]) == (360.0, "°", True)


def test_what_is_felt_is_the_component_at_the_frequency_of_the_turns(
    drive: Drive, other: Drive, both: Snapshot
) -> None:
    """Against the solver's own sum over the samples of the modulation, which is of |p|² and so lacks 1/(2ρc)."""
    [image], scale = paint(both, quantity="felt", xy_at=0.17)
    at = places(image).reshape(-1, 3)
    modulation = Modulation.two_sided(drive, other, 200.0)
    component = intensity_component(ARRAY, modulation, at)
    per_pascal2 = float(intensity(1.0))
    wanted = (component * per_pascal2).reshape(image.levels.shape)
    np.testing.assert_allclose(image.levels * (scale["largest"] / 255), wanted, atol=1.05 * scale["largest"] / 255)


def test_of_many_fields_the_strongest_frequency_is_felt(drive: Drive, other: Drive) -> None:
    """Against the solver's own sum, as above, for an intensity with two periods in a cycle."""
    steps = np.abs(np.cos(2 * np.pi * (np.arange(12) + 0.5) / 12))
    drives = steps[:, None] * drive + 0.2 * other
    drives /= np.abs(drives).max()
    [image], scale = paint(Snapshot(drives), quantity="felt", xy_at=0.17)
    modulation = Modulation(drives, np.eye(12), 100.0)
    at = places(image).reshape(-1, 3)
    component = np.max(
        [intensity_component(ARRAY, modulation, at, harmonic, precision="single") for harmonic in range(1, 7)], axis=0
    )
    wanted = (component * float(intensity(1.0))).reshape(image.levels.shape)
    np.testing.assert_allclose(image.levels * (scale["largest"] / 255), wanted, atol=1.05 * scale["largest"] / 255)


def test_one_field_alone_changes_nothing_that_is_felt(drive: Drive) -> None:
    [image], _ = paint(Snapshot(drive[None]), quantity="felt")
    assert not image.levels.any()


@pytest.mark.parametrize(("quantity", "reduce"), [("pressure", np.max), ("intensity", np.mean)])
def test_of_two_fields_the_stronger_pressure_and_the_mean_intensity_are_shown(
    quantity: str, reduce: Any, both: Snapshot
) -> None:
    of: Any = {"pressure": np.abs, "intensity": intensity}[quantity]
    [image], scale = paint(both, quantity=quantity, xy_at=0.17)
    at = places(image).reshape(-1, 3)
    wanted = reduce([of(pressure(ARRAY, drive, at)) for drive in both.drives], axis=0).reshape(image.levels.shape)
    np.testing.assert_allclose(image.levels * (scale["largest"] / 255), wanted, atol=1.05 * scale["largest"] / 255)


def test_every_quantity_can_be_painted_in_silence() -> None:
    for quantity in IMAGE_QUANTITIES:
        images, scale = paint(Snapshot(np.zeros((2, 320))), quantity=quantity, xz=True, yz=True)
        assert [image.name for image in images] == list(PLANES)
        assert not any(image.levels.any() for image in images)
        assert scale["largest"] > 0


def test_a_place_tells_pascals_decibels_and_phase_of_each_field(both: Snapshot) -> None:
    probed = Painter(Emitter(ARRAY)).probe(both, FOCUS)
    values = [pressure(ARRAY, drive, [FOCUS])[0] for drive in both.drives]
    np.testing.assert_allclose(probed.pascals, np.abs(values), rtol=1e-4)
    np.testing.assert_allclose(probed.decibels, sound_pressure_level(np.array(values)), atol=1e-3)
    np.testing.assert_allclose(np.exp(1j * np.deg2rad(probed.degrees)), np.exp(1j * np.angle(values)), atol=1e-3)
