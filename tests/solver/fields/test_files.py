from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from phasewire import ControlPoints, Medium, Solution, Transducer, TransducerArray, pressure, solve
from phasewire.base.errors import InputFileError
from phasewire.solver import Aperture
from phasewire.solver.fields.field import PlaneField, VolumeField, sample_cut, sample_volume
from phasewire.solver.fields.files import load_field, load_solution, save_field, save_solution
from phasewire.solver.fields.grid import Grid


def change(path: Path, changes: dict[str, Any]) -> None:
    """Write entries of an archive anew, or leave out those that are None."""
    with np.load(path) as archive:
        arrays = dict(archive) | changes
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})


ONE_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def test_a_solution_survives_the_file(tmp_path: Path) -> None:
    array = TransducerArray.grid(3, 2, 0.02, Transducer(radius=5e-3, strength=2.0))
    array = array.calibrated([1, -1, 0.5j, 0, 1.2, 1], [1, 0.5, 1, 1, 0.25, 0])
    solution = solve(array, ControlPoints([[0, 0, 0.1], [0.01, 0, 0.1]], [1, 0.5]), medium=Medium(25))
    save_solution(tmp_path / "s.npz", solution)
    again = load_solution(tmp_path / "s.npz")
    np.testing.assert_array_equal(again.drive, solution.drive)
    np.testing.assert_array_equal(again.array.positions, array.positions)
    np.testing.assert_array_equal(again.array.normals, array.normals)
    np.testing.assert_array_equal(again.points.positions, solution.points.positions)
    np.testing.assert_array_equal(again.points.amplitudes, solution.points.amplitudes)
    assert (again.array.transducer, again.medium, again.method) == (array.transducer, Medium(25), "wgs")
    np.testing.assert_array_equal(again.array.response, array.response)
    np.testing.assert_array_equal(again.array.limits, array.limits)


@pytest.mark.parametrize(
    ("transducer", "medium"),
    [
        (Transducer(4e-3, 3.0, "a bench", 39_500.0, 0.4e-3, -1, "monopole"), Medium(-3, 39_000, True, 12.5, 9e4)),
        (
            Transducer(model="rayleigh", aperture=Aperture(np.array([[0.5, 1j, 0], [1, 0.25, 0.1]]), 2e-3)),
            Medium(humidity=0),
        ),
    ],
)
def test_everything_about_transducer_and_air_survives_the_file(
    tmp_path: Path, transducer: Transducer, medium: Medium
) -> None:
    solution = solve(TransducerArray.grid(2, 2, 0.02, transducer), ControlPoints([[0, 0, 0.1]]), medium=medium)
    save_solution(tmp_path / "s.npz", solution)
    again = load_solution(tmp_path / "s.npz")
    assert (again.array.transducer, again.medium) == (transducer, medium)
    assert type(again.array.transducer.polarity) is int
    assert type(again.medium.absorbing) is bool


def test_a_file_of_an_earlier_version_is_named_as_such(tmp_path: Path) -> None:
    np.savez(tmp_path / "old.npz", format=np.array("phasewire-solution-1"), drive=np.ones(3))
    with pytest.raises(InputFileError, match=r"old\.npz was made by an earlier version of phasewire; solve it again"):
        load_solution(tmp_path / "old.npz")


@pytest.fixture(scope="module")
def solved_bytes(tmp_path_factory: pytest.TempPathFactory, sphere_solution: Solution) -> bytes:
    path = tmp_path_factory.mktemp("solved") / "s.npz"
    save_solution(path, sphere_solution)
    return path.read_bytes()


@settings(ONE_FOLDER, max_examples=200)
@given(st.data())
def test_a_corrupted_solution_is_refused_or_harmless(
    solved_bytes: bytes, sphere_solution: Solution, tmp_path: Path, data: st.DataObject
) -> None:
    """Some bytes of the container carry no data, such as dates; an accepted file must have the same drive."""
    corrupted = bytearray(solved_bytes)
    corrupted[data.draw(st.integers(0, len(corrupted) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "s.npz"
    path.write_bytes(corrupted)
    try:
        solution = load_solution(path)
    except InputFileError:
        return
    np.testing.assert_array_equal(solution.drive, sphere_solution.drive)


def test_other_npz_files_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", a=np.ones(3))
    np.save(tmp_path / "array.npy", np.ones(3))
    with pytest.raises(InputFileError, match="not a solved file; `phasewire solve` makes one"):
        load_solution(tmp_path / "other.npz")
    with pytest.raises(InputFileError, match="not an NPZ file"):
        load_solution(tmp_path / "array.npy")
    with pytest.raises(FileNotFoundError):
        load_solution(tmp_path / "missing.npz")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drive": np.ones(319)}, "319 drives for 320 transducers"),
        ({"drive": np.full(320, 3.0)}, "the drive of transducer 0 is not within 1"),
        ({"drive": np.where(np.arange(320) == 7, np.nan, 0)}, "the drive of transducer 7 is not within 1"),
        ({"drive": np.array(["loud"] * 320)}, "not a usable solved file"),
        ({"drive": None}, "it has no entry 'drive'"),
        ({"transducer": np.ones(3)}, r"4 numbers are expected, not \(3,\) of float64"),
        ({"transducer": np.array([1e-3, 1e308, 4e4, 3e-4])}, "transducer strength 1e.308"),
        ({"transducer_polarity": np.array(2)}, "polarity 2 must be a whole number from -1 to 1"),
        ({"transducer_polarity": np.array([1, 1])}, "not a usable solved file"),
        ({"transducer_model": np.array("plane")}, "unknown transducer model 'plane'"),
        ({"transducer_source": None}, "it has no entry 'transducer_source'"),
        ({"aperture_image": np.ones((3, 3))}, "it has no entry 'aperture_pixel'"),
        ({"aperture_image": np.ones((3, 3)), "aperture_pixel": np.array([1e-3])}, "'piston' has no aperture"),
        ({"medium": np.array([20j, 4e4, 50, 1e5])}, "4 numbers are expected"),
        ({"medium": np.array([20, 4e4, 500, 1e5])}, "humidity 500"),
        ({"point_positions": np.full((17, 3), np.nan)}, "control point 0"),
        ({"array_positions": np.zeros((320, 3), complex)}, "transducer positions .* must be numbers: they are complex"),
    ],
)
def test_invalid_contents_are_refused(
    tmp_path: Path, solved_bytes: bytes, changes: dict[str, Any], message: str
) -> None:
    path = tmp_path / "s.npz"
    path.write_bytes(solved_bytes)
    change(path, changes)
    with pytest.raises(InputFileError, match=message):
        load_solution(path)


OBLIQUE = Grid((0, 0, 0.2), [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]], (3, 2), 0.01)


@pytest.fixture(scope="module")
def plane() -> PlaneField:
    return sample_cut(TransducerArray.grid(2, 2), np.ones(4), OBLIQUE, Medium(25))


@pytest.fixture(scope="module")
def box() -> VolumeField:
    return sample_volume(TransducerArray.grid(2, 2), np.ones(4), Grid.along("xyz", (0, 0, 0.2), 0.02, 0.01))


@pytest.mark.parametrize("kind", ["plane", "box"])
def test_a_field_survives_the_file(tmp_path: Path, kind: str, request: pytest.FixtureRequest) -> None:
    field: PlaneField | VolumeField = request.getfixturevalue(kind)
    save_field(tmp_path / "f.npz", field)
    again = load_field(tmp_path / "f.npz")
    assert (type(again), again.medium) == (type(field), field.medium)
    np.testing.assert_array_equal(again.pressure, field.pressure)
    np.testing.assert_array_equal(again.grid.positions(), field.grid.positions())


def test_fields_can_be_read_by_numpy(tmp_path: Path, plane: PlaneField) -> None:
    save_field(tmp_path / "f.npz", plane)
    with np.load(tmp_path / "f.npz") as archive:
        rows, columns = archive["pressure"].shape
        across, along = archive["axes"]
        corner = archive["centre"] - ((columns - 1) * across + (rows - 1) * along) / 2 * float(archive["step"])
        assert "Pa, peak" in str(archive["units"])
        at = pressure(TransducerArray.grid(2, 2), np.ones(4), [corner], Medium(*archive["medium"][:2]))[0]
        assert archive["pressure"][0, 0] == pytest.approx(at, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": np.array("phasewire-solution-1")}, "is not a field; `phasewire field` makes one"),
        ({"pressure": None}, "it has no entry 'pressure'"),
        ({"pressure": np.full((2, 3), np.nan)}, "a pressure in it is not finite"),
        ({"pressure": np.ones(3)}, "2 axes and 1 counts"),
        ({"pressure": np.array([["loud"]])}, "not a usable field"),
        ({"step": np.array(-1.0)}, "step -1.0 m must be positive"),
        ({"step": np.ones(2)}, r"1 numbers are expected, not \(2,\)"),
        ({"axes": np.ones((2, 3))}, "must be orthogonal"),
        ({"medium": np.ones(3)}, "4 numbers are expected"),
    ],
)
def test_invalid_fields_are_refused(tmp_path: Path, plane: PlaneField, changes: dict[str, Any], message: str) -> None:
    path = tmp_path / "f.npz"
    save_field(path, plane)
    change(path, changes)
    with pytest.raises(InputFileError, match=message):
        load_field(path)
