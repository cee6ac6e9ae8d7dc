from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from phasewire.solver.fields.grid import Grid


def test_a_horizontal_plane_has_its_first_axis_in_its_columns() -> None:
    grid = Grid.along("xy", (0.1, 0.2, 0.3), [0.04, 0.02], 0.01)
    assert (grid.kind, grid.counts, grid.shape) == ("plane", (5, 3), (3, 5))
    np.testing.assert_allclose(grid.positions()[0, 0], [0.08, 0.19, 0.3])
    np.testing.assert_allclose(grid.positions()[0, 4], [0.12, 0.19, 0.3])
    np.testing.assert_allclose(grid.positions()[2, 0], [0.08, 0.21, 0.3])
    np.testing.assert_allclose(grid.normal, [0, 0, 1])


def test_a_box_has_its_third_axis_in_its_layers() -> None:
    grid = Grid.along("xyz", (0, 0, 0.1), [0.02, 0.04, 0.06], 0.01)
    assert (grid.kind, grid.shape) == ("box", (7, 5, 3))
    np.testing.assert_allclose(grid.positions()[6, 0, 2], [0.01, -0.02, 0.13])


def test_an_oblique_plane_follows_its_axes() -> None:
    up = np.array([0, 0.6, 0.8])
    grid = Grid((0, 0, 0.2), [[1.0, 0.0, 0.0], up.tolist()], (3, 5), 0.01)
    np.testing.assert_allclose(grid.positions()[4, 1], [0, 0.012, 0.216])
    np.testing.assert_allclose(grid.normal, [0, -0.8, 0.6])
    assert grid.coordinates(0)[0] == "x"
    name, along = grid.coordinates(1)
    assert name == "v"
    np.testing.assert_allclose(along, [-0.02, -0.01, 0, 0.01, 0.02])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"axes": [[1, 0, 0], [0, 1, 0.1]]}, "must be orthogonal and of length 1"),
        ({"axes": [[1, 0, 0], [1, 0, 0]]}, "must be orthogonal"),
        ({"axes": [[1, 0, 0]], "counts": (3,)}, "1 axes and 1 counts: a grid has 2 or 3 of each"),
        ({"counts": (3, 3, 3)}, "2 axes and 3 counts"),
        ({"counts": (0, 3)}, r"count of samples 0 must be a whole number from 1"),
        ({"counts": (2001, 2000)}, "2001 × 2000 makes more than 4000000 samples"),
        ({"step": 0}, "step 0 m must be positive"),
        ({"centre": (0, 0)}, r"centre of the grid \[0.0, 0.0\] must be three numbers"),
    ],
)
def test_impossible_grids_are_named(arguments: dict[str, Any], message: str) -> None:
    plain: dict[str, Any] = {"centre": (0, 0, 0.2), "axes": [[1, 0, 0], [0, 1, 0]], "counts": (3, 3), "step": 0.01}
    with pytest.raises(ValueError, match=message):
        Grid(**(plain | arguments))


@pytest.mark.parametrize(
    ("letters", "extent", "message"),
    [
        ("x", 0.1, "axes 'x' must be two or all of x, y and z"),
        ("xx", 0.1, "axes 'xx' must be"),
        ("xw", 0.1, "axes 'xw' must be"),
        ("xyz", [0.1, 0.1], "2 extents for the axes 'xyz'"),
        ("xyz", 0.001, "is too long for a box of 0.001 m"),
        ("xyz", 1.0, r"over 1 m makes more than 4000000 samples"),
        ("xz", [0.1, -1], r"extent -1\.0 m must be positive"),
    ],
)
def test_impossible_spans_are_named(letters: str, extent: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Grid.along(letters, (0, 0, 0.2), extent, 1e-3)


def test_a_box_has_no_normal() -> None:
    with pytest.raises(ValueError, match="a box has no normal"):
        _ = Grid.along("xyz", (0, 0, 0.2), 0.02, 0.01).normal
