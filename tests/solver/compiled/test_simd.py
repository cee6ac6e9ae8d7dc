from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra import numpy as hnp
from numba import njit
from numba.core.errors import NumbaError
from phasewire.solver.compiled.simd import LANES, load, spread, store, total

MATRICES = hnp.arrays(np.float32, (2, 3 * LANES), elements=hnp.from_dtype(np.dtype("f4"), min_value=-99, max_value=99))


@njit
def combine(matrix: np.ndarray, out: np.ndarray, factor: np.float32) -> Any:
    sums = spread(np.float32(0))
    for i in range(0, matrix.shape[1], LANES):
        a, b = load(matrix, 0, i), load(matrix, 1, i)
        product = a * b + spread(factor) - b
        store(out, 0, i, product)
        sums = sums + product
    return total(sums)


@given(MATRICES)
def test_vectors_compute_lane_by_lane(matrix: np.ndarray) -> None:
    out = np.zeros((1, matrix.shape[1]), dtype=np.float32)
    result = combine(matrix, out, np.float32(2.5))
    a, b = matrix.astype(np.float64)
    np.testing.assert_allclose(out[0], a * b + 2.5 - b, rtol=1e-5, atol=1e-3)
    assert result == pytest.approx(float((a * b + 2.5 - b).sum()), rel=1e-4, abs=0.1)


def test_other_matrices_are_refused_when_the_kernel_is_compiled() -> None:
    @njit
    def first(matrix: np.ndarray) -> Any:
        return total(load(matrix, 0, 0))

    for matrix in (np.zeros((2, 16)), np.zeros((16, 2), np.float32).T, np.zeros(16, np.float32)):
        with pytest.raises((NumbaError, TypeError), match="C-contiguous float32 matrices"):
            first(matrix)
