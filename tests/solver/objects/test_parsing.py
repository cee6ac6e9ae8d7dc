from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Mesh
from phasewire.base.errors import InputFileError
from phasewire.solver.objects.parsing import MovingObject, parse_object

from tests.solver.objects.test_mesh_files import binary_stl


def test_parameters() -> None:
    found = parse_object("pyramid:size=0.08,x=0.02,y=-0.01,z=0.2,rotation=30")
    expected = Mesh.pyramid(0.08, (0.02, -0.01, 0.2)).rotated(30)
    np.testing.assert_allclose(found.at(0).vertices, expected.vertices, atol=1e-15)


def test_it_moves_and_turns() -> None:
    found = parse_object("cube:x=0.01,vx=0.1,vz=-0.02,turn=90")
    assert not found.still
    np.testing.assert_allclose(found.at(0).vertices, Mesh.cube(centre=(0.01, 0, 0.17)).vertices, atol=1e-15)
    expected = Mesh.cube(centre=(0.06, 0, 0.16)).rotated(45).vertices
    np.testing.assert_allclose(found.at(0.5).vertices, expected, atol=1e-15)
    assert found.at(0.5).solid is found.mesh.solid  # a moved object needs no new tree


@given(seconds=st.floats(-1e6, 1e6))
def test_a_moving_object_stays_within_bounds(seconds: float) -> None:
    found = MovingObject(Mesh.cube(), (3, -2, 1), spin=10).at(seconds)
    assert np.abs(found.vertices).max() <= 1001


def test_a_file_is_put_at_the_given_place(tmp_path: Path) -> None:
    path = tmp_path / "odd:na=me.stl"
    path.write_bytes(binary_stl(Mesh.cube(4, (5, 5, 5))))
    said: list[str] = []
    found = parse_object(f"{path}:scale=0.02,z=0.2,rotation=45", said.append)
    expected = Mesh.cube(0.08, (0, 0, 0.2)).rotated(45)
    np.testing.assert_allclose(np.sort(found.mesh.vertices, axis=0), np.sort(expected.vertices, axis=0), atol=1e-6)
    assert said[0] == f"reading {path}"
    with pytest.raises(InputFileError, match=r"looks like centimetres or millimetres: pass scale=0\.01"):
        parse_object(str(path))


def test_a_volume_is_put_at_the_given_place(tmp_path: Path) -> None:
    distance = np.linalg.norm(np.stack(np.meshgrid(*[np.arange(30.0)] * 3, indexing="ij")) - 14.5, axis=0)
    np.save(tmp_path / "ball.npy", 10 - distance)
    found = parse_object(f"{tmp_path}/ball.npy:level=0,spacing=0.004,x=0.1,step=1").mesh
    np.testing.assert_allclose(np.linalg.norm(found.vertices - [0.1, 0, 0.17], axis=1), 0.04, atol=2e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "unknown object ''; known are cone, .* .stl, .obj, .ply, .off, .glb, .3mf files, and as volumes .npy"),
        ("ball", "unknown object 'ball'"),
        ("ball:size=1", "unknown object 'ball'"),
        ("cup.step", "unknown object 'cup.step'"),
        ("cube:radius=1", "cube has no parameter 'radius'; it has rotation, size, turn, vx"),
        ("cube:size=a", "cube size 'a' is not a number of metres"),
        ("cube:size", "cube size '' is not a number of metres"),
        ("cube:size=0", "size 0.0 m must be positive"),
        ("cube:x=nan", "placement x nan m must be from -10 to 10 m"),
        ("cube:vx=1e9", "placement vx .* m/s must be from -100 to 100 m/s"),
        ("cube:turn=1e9", "placement turn .* degrees/s must be from -36000 to 36000 degrees/s"),
        ("cube:turn=x", "cube turn 'x' is not a number of degrees per second"),
        ("cube:x=0,x=0", "cube x is given twice"),
        ("cup.stl:size=0.1", "cup.stl has no parameter 'size'; it has open, rotation, scale"),
        ("ct.nii", "ct.nii needs level=…, the value above which the object is"),
        ("ct.nii.gz:level=high", "ct.nii.gz level 'high' is not a number of the volume's values"),
        ("ct.npy:step=2.5", "ct.npy step '2.5' is not a whole number"),
        ("ct.npy:scale=1", "ct.npy has no parameter 'scale'; it has level, rotation, series, spacing, step"),
        ("cup.stl:scale=small", "cup.stl scale 'small' is not a number of metres for each unit"),
    ],
)
def test_invalid_objects_are_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_object(text)
