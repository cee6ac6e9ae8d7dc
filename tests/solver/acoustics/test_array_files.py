"""Files of arrays against arrays that are made in Python, and the errors for wrong ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from phasewire.base.errors import InputFileError
from phasewire.solver.acoustics.array import TransducerArray
from phasewire.solver.acoustics.array_files import read_transducers

EXAMPLES = Path(__file__).parents[3] / "examples" / "arrays"
GRID = "[[panel]]\ncolumns = 3\nrows = 2\npitch_mm = 10\n"


def same(one: TransducerArray, other: TransducerArray) -> None:
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-12)
    np.testing.assert_allclose(one.normals, other.normals, atol=1e-12)


def test_facing_panels_look_at_each_other() -> None:
    array = read_transducers(EXAMPLES / "facing_panels.toml")
    below, above = TransducerArray.grid(16, 16), array.positions[256:]
    np.testing.assert_allclose(array.positions[:256], below.positions, atol=1e-12)
    np.testing.assert_allclose(above, below.positions * [1, -1, 1] + [0, 0, 0.2], atol=1e-12)
    np.testing.assert_allclose(array.normals[:, 2], np.repeat([1, -1], 256), atol=1e-12)


def test_each_of_a_bowl_looks_at_its_centre() -> None:
    array = read_transducers(str(EXAMPLES / "bowl.csv"))
    np.testing.assert_allclose(array.positions + 0.15 * array.normals, np.tile([0, 0, 0.15], (61, 1)), atol=1e-4)


def test_a_panel_of_a_file_is_turned_and_then_moved(tmp_path: Path) -> None:
    (tmp_path / "two.csv").write_text("0.01,0,0\n0,0.02,0\n")
    (tmp_path / "rig.toml").write_text(
        '[transducer]\nradius = 0.008\n[[panel]]\nfile = "two.csv"\nrotation_degrees = [0, 0, 90]\n'
        "translation_m = [0, 0, 0.1]\n"
    )
    array = read_transducers(tmp_path / "rig.toml")
    np.testing.assert_allclose(array.positions, [[0, 0.01, 0.1], [-0.02, 0, 0.1]], atol=1e-12)
    assert array.transducer.radius == 0.008


def test_columns_are_found_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("nx,ny,nz,x,y,z\n0,0,1,0.01,0,0\n1,0,0,0,0.02,0\n")
    array = read_transducers(tmp_path / "a.csv")
    np.testing.assert_array_equal(array.positions, [[0.01, 0, 0], [0, 0.02, 0]])
    np.testing.assert_array_equal(array.normals, [[0, 0, 1], [1, 0, 0]])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "there are no transducers in it"),
        ("a.csv", "0,0,0,0,0,0\n", "the normal of transducer 0 is .*it must have a direction"),
        ("a.csv", "0,0,0,1\n", "line 1: '0,0,0,1' is not x,y,z or x,y,z,nx,ny,nz"),
        ("a.csv", "x [mm],y [mm],z [mm]\n0,0,0\n", "is in mm; coordinates must be in metres"),
        ("a.json", "{}", r"is read from a \.csv or \.toml file"),
        ("a.toml", "", r"it has no panels; each begins with \[\[panel\]\]"),
        ("a.toml", "pitch = 1", "there is no field 'pitch'; the fields are panel, device, transducer"),
        (
            "a.toml",
            "[[panel]]\ncolumns = 3\nrows = 2\n",
            "panel 1: it has no pitch; give pitch_mm, such as 10.3, or pitch_m",
        ),
        ("a.toml", "[[panel]]\nrows = 2\npitch_m = 0.01\n", "panel 1: columns is None; it must be a whole number"),
        ("a.toml", GRID + "pitch_m = 0.01\n", "pitch_m and pitch_mm exclude each other"),
        ("a.toml", GRID + GRID + "turn = 3\n", "panel 2: there is no field 'turn'"),
        ("a.toml", GRID + "rotation_degrees = 3\n", "it must be three finite numbers"),
        ("a.toml", GRID.replace("_mm", "_m"), "panel 1: pitch 10.0 m must be .* lengths are in metres: 10 mm is 0.01"),
        ("a.toml", GRID + GRID, r"a.toml: transducers 0 and 6 are both at \[-0.01, -0.005, 0.0\] m"),
        ("a.csv", "x,y,z\n0,0,0\n10.3,0,0\n", "transducer position 1 is \\[10.3, 0.0, 0.0\\]; coordinates are metres"),
        ("a.csv", "x,y,nx,ny,nz,w\n", "line 1: the columns are x, y, nx, ny, nz, w; they must be x,y,z or x,y,z,nx,ny"),
        ("a.toml", '[[panel]]\nfile = "no.csv"\n', "a.toml, panel 1: file 'no.csv' cannot be read: No such file"),
        ("a.toml", '[[panel]]\nfile = "a.toml"\n', r"it must be the name of a \.csv file"),
        ("a.toml", '[transducer]\nname = "X"\n' + GRID, "unknown transducer 'X'; known are MA40S4S"),
        ("a.toml", "[transducer]\nname = [1]\n" + GRID, r"unknown transducer \[1\]; known are MA40S4S"),
        ("a.toml", '[transducer]\nradius = "X"\n' + GRID, "transducer radius is 'X'; it must be a number"),
        ("a.toml", "[transducer]\nradius = -1\n" + GRID, "transducer radius -1 m must be positive"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputFileError, match=message):
        read_transducers(tmp_path / name)


@pytest.mark.parametrize(("name", "text"), [("a.csv", "0,0,0\n"), ("a.toml", GRID)])
def test_text_in_utf_16_is_named(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-16")
    with pytest.raises(InputFileError, match="is text in UTF-16; save it as UTF-8"):
        read_transducers(tmp_path / name)
