from __future__ import annotations

from pathlib import Path

import pytest
from phasewire.base.errors import InputFileError
from phasewire.solver.shapes.point_files import read_points


@pytest.mark.parametrize(
    ("name", "text", "positions", "amplitudes"),
    [
        ("p.csv", "0,0,0.2\n0.01,0,0.2\n", [[0, 0, 0.2], [0.01, 0, 0.2]], [1, 1]),
        ("p.csv", "x,y,z,amplitude\n# a note\n\n0,0,0.2,0.5\n", [[0, 0, 0.2]], [0.5]),
        ("p.csv", "# a note\nx,y,z\n0,0,0.2\n", [[0, 0, 0.2]], [1]),
        ("p.csv", "Amplitude,Z,y (m),x_m\n0.5,0.2,0.1,0\n", [[0, 0.1, 0.2]], [0.5]),
        ("p.txt", "z y x\n0.2 0.1 0\n", [[0, 0.1, 0.2]], [1]),
        ("p.CSV", "\ufeff0, 0, 2e-1\r\n", [[0, 0, 0.2]], [1]),
        ("p.txt", "x y z\n0 0 0.2\n0.01\t0  0.2\n", [[0, 0, 0.2], [0.01, 0, 0.2]], [1, 1]),
        ("p.xyz", "# a note\n  0 0 2e-1 0.5 # and another\n", [[0, 0, 0.2]], [0.5]),
        ("p.json", '{"positions": [[0, 0, 0.2]]}', [[0, 0, 0.2]], [1]),
        ("p.json", '{"positions": [[0, 0, 0.2]], "amplitudes": [2]}', [[0, 0, 0.2]], [2]),
    ],
)
def test_points_are_read(
    tmp_path: Path, name: str, text: str, positions: list[list[float]], amplitudes: list[float]
) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    points = read_points(tmp_path / name)
    assert points.positions.tolist() == positions
    assert points.amplitudes.tolist() == amplitudes


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("p.csv", "", "there are no control points in it"),
        ("p.csv", "x,y,z\n0,0,zero\n", r"line 2: '0,0,zero' is not x,y,z"),
        ("p.csv", "0,0\n", "line 1: '0,0' is not x,y,z"),
        ("p.csv", "0,0,0.2m\n0,0,0.2\n", "line 1: '0,0,0.2m' is not x,y,z"),
        ("p.csv", "0 0 0.2\n", "line 1: '0 0 0.2' is not x,y,z"),
        ("p.csv", "x,y,z\nx,y,z\n", "line 2: 'x,y,z' is not"),
        ("p.csv", "x,y,z\n", "there are no control points in it"),
        ("p.csv", "0,0,0.2\n0,0,0.2,1\n", "line 2 has 4 numbers, but the lines before it have 3"),
        ("p.csv", "0,0,0.2\n0,0,nan\n", "control point 1 is .*nan"),
        ("p.csv", "0,02;0;0,2\n", "line 1: .*write commas between the numbers, not semicolons"),
        ("p.csv", "x_mm,y_mm,z_mm\n0,0,200\n", "the column 'x_mm' is in mm; coordinates must be in metres"),
        (
            "p.csv",
            "id,x,y,z\n0,0,0,0.2\n",
            "line 1: the columns are id, x, y, z; they must be x,y,z or x,y,z,amplitude",
        ),
        ("p.csv", "x,y,z\n0,0,0.2,1\n", "line 2 has 4 numbers, but the lines before it have 3"),
        ("p.csv", "0,0,0.2,-1\n", "amplitude -1.0 of control point 0"),
        ("p.json", "{", "Expecting property name"),
        ("p.json", "[[0, 0, 0.2]]", 'it must be an object with "positions"'),
        ("p.json", '{"positions": [[0, 0, "a"]]}', "must be numbers: they are text"),
        ("p.json", '{"positions": [[0, 0, 0.2]], "amplitude": [1]}', "unknown entry 'amplitude'"),
        ("p.json", '{"positions": [[0, 0, 0.2], [0]]}', "inhomogeneous"),
        ("p.txt", "# nothing\n", "there are no control points in it"),
        ("p.txt", "0,0,0.2\n", "line 1: '0,0,0.2' is not x y z or x y z amplitude in numbers"),
        ("p.txt", "0 0 0.2\n0 0 up\n", "line 2: '0 0 up' is not x y z"),
        ("p.xyz", "0 0 0.2\n\n0 0 0.2 1\n", "line 3 has 4 numbers, but the lines before it have 3"),
        ("p.xyz", "2\na comment\nC 0 0 0.2\n", "line 1: '2' is not x y z"),
        ("p.ply", "0 0 0.2", r"read from \.csv or \.json or \.txt or \.xyz files"),
    ],
)
def test_bad_point_files_are_named(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputFileError, match=message):
        read_points(tmp_path / name)
