from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from phasewire import TransducerArray


def test_the_default_grid_is_the_paper_s_array() -> None:
    array = TransducerArray.grid()
    assert len(array) == 320
    assert array.positions.shape == array.normals.shape == (320, 3)
    np.testing.assert_allclose(array.positions.mean(axis=0), 0, atol=1e-15)
    np.testing.assert_allclose(array.positions[1] - array.positions[0], [10.3e-3, 0, 0])
    np.testing.assert_allclose(array.positions[20] - array.positions[0], [0, 10.3e-3, 0], atol=1e-15)
    assert (array.normals == [0, 0, 1]).all()


def test_arrays_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        TransducerArray.grid().positions[0] = 0


def test_the_caller_s_array_is_copied() -> None:
    mine = np.zeros((1, 3))
    array = TransducerArray(mine, [[0, 0, 1]])
    mine[0] = 1
    assert array.positions.tolist() == [[0, 0, 0]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"columns": 10**9, "rows": 10**9}, "too many; at most 1000000"),
        ({"pitch": 1e6}, "coordinates are metres, at most 1000"),
        ({"columns": 0}, "columns 0 must be at least 1"),
        ({"rows": -1}, "rows -1"),
        ({"pitch": 0}, "pitch 0 m must be positive"),
        ({"pitch": np.nan}, "pitch nan"),
    ],
)
def test_impossible_grids_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TransducerArray.grid(**arguments)


@pytest.mark.parametrize(
    ("positions", "normals", "message"),
    [
        ([[0, 0, np.nan]], [[0, 0, 1]], "transducer position 0 is .*nan"),
        ([[0, 0, 0]], [[0, 0, 2]], "normal of transducer 0 has length 2"),
        ([[0, 0, 0]], [[0, 0, 1], [0, 0, 1]], "1 positions but 2 normals"),
        ([], [], "m of at least 1"),
        ([0, 0, 0], [0, 0, 1], r"shape \(m, 3\)"),
    ],
)
def test_impossible_arrays_are_refused(positions: list[float], normals: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TransducerArray(positions, normals)
