from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra import numpy as hnp
from numba import njit
from numba.core.errors import NumbaError
from phasewire.solver.compiled.simd import (
    LANES,
    if_positive,
    inverse_root,
    load,
    magnitude,
    nearest,
    spread,
    store,
    total,
    totals,
)

MATRICES = hnp.arrays(np.float32, (2, 3 * LANES), elements=hnp.from_dtype(np.dtype("f4"), min_value=-99, max_value=99))


@njit
def combine(matrix: np.ndarray, out: np.ndarray, factor: np.float32) -> Any:
    sums = spread(np.float32(0))
    for i in range(0, matrix.shape[1], LANES):
        a, b = load(matrix, 0, i), load(matrix, 1, i)
        product = a * b + factor - b
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


@njit
def change(matrix: np.ndarray, out: np.ndarray, singly: np.ndarray) -> Any:
    a, b = load(matrix, 0, 0), load(matrix, 1, 0)
    store(out, 0, 0, nearest(a))
    store(out, 1, 0, magnitude(a))
    store(out, 2, 0, inverse_root(magnitude(a) + np.float32(1)))
    store(out, 3, 0, if_positive(b, a))
    for i in range(LANES):
        value, condition = matrix[0, i], matrix[1, i]
        singly[0, i], singly[1, i] = nearest(value), magnitude(value)
        singly[2, i], singly[3, i] = inverse_root(magnitude(value) + np.float32(1)), if_positive(condition, value)
    return totals((a, b)), totals((a, b, a, a, b, b, a, b))


@given(MATRICES)
def test_functions_are_alike_for_vectors_and_single_numbers(matrix: np.ndarray) -> None:
    out, singly = np.zeros((4, LANES), np.float32), np.zeros((4, LANES), np.float32)
    two, eight = change(matrix, out, singly)
    a, b = matrix[:, :LANES].astype(np.float64)
    expected = [np.rint(a), np.abs(a), 1 / np.sqrt(np.abs(a) + 1), np.where(b > 0, a, 0)]
    np.testing.assert_allclose(out, expected, rtol=1e-6)
    np.testing.assert_allclose(singly, expected, rtol=1e-6)
    sums = np.array([a.sum(), b.sum()])
    np.testing.assert_allclose(two, sums, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(eight, sums[[0, 1, 0, 0, 1, 1, 0, 1]], rtol=1e-5, atol=1e-3)


def test_other_matrices_are_refused_when_the_kernel_is_compiled() -> None:
    @njit
    def first(matrix: np.ndarray) -> Any:
        return total(load(matrix, 0, 0))

    for matrix in (np.zeros((2, 16)), np.zeros((16, 2), np.float32).T, np.zeros(16, np.float32)):
        with pytest.raises((NumbaError, TypeError), match="C-contiguous float32 matrices"):
            first(matrix)
