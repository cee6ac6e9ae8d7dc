"""Solvers: from control points to drives.

Each solver is a function ``(A, amplitudes, **options) -> drive`` in `METHODS`, where A is the transfer matrix. These
are the readable complex128 versions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from .array import TransducerArray
from .geometry import frozen
from .medium import Medium
from .points import MAX_POINTS, ControlPoints, check_reachable
from .propagation import transfer_matrix

__all__ = ["METHODS", "Solution", "solve"]

MAX_PAIRS = 20_000_000  # of points and transducers: about 2 GB of intermediate arrays
MAX_MU = 1e6  # beyond, the points hardly matter


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver found.

    Parameters
    ----------
    drive : (n,) complex
        Drives in array order, scaled so that the strongest transducer is at full drive (magnitude 1).
    array, points, medium, method
        What it was solved for, and how.
    """

    drive: NDArray[np.complex128]
    array: TransducerArray
    points: ControlPoints
    medium: Medium
    method: str


def solve(
    array: TransducerArray,
    points: ControlPoints,
    method: str = "tikhonov",
    *,
    medium: Medium | None = None,
    **options: float,
) -> Solution:
    """Find the drive that makes the field strong at the control points.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    points : ControlPoints
        m points, in front of the array and within reach.
    method : str
        A key of `METHODS`.
    medium : Medium, optional
        The air; 20 °C by default.
    **options
        Of the method.

    Raises
    ------
    ValueError
        Where the method is unknown, an option is out of range, a point cannot be reached or there are too many; it is
        named.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; known are {', '.join(sorted(METHODS))}")
    if len(points) > MAX_POINTS or len(array) * len(points) > MAX_PAIRS:
        raise ValueError(
            f"{len(points)} control points with {len(array)} transducers are too many; at most {MAX_POINTS} points are "
            f"possible, and at most {MAX_PAIRS} pairs"
        )
    check_reachable(array, points)
    medium = medium or Medium()
    transfer = transfer_matrix(array, points.positions, medium)
    drive = METHODS[method](transfer, points.amplitudes / points.amplitudes.max(), **options)
    return Solution(frozen(drive), array, points, medium, method)


def control_point_phases(
    transfer: NDArray[np.complex128], amplitudes: NDArray[np.float64], steps: int = 20
) -> NDArray[np.complex128]:
    """Phases with which the control points help each other, the paper's section 3.2.

    Parameters
    ----------
    transfer : (m, n) complex
        The transfer matrix A.
    amplitudes : (m,) float
        Wanted amplitudes.
    steps : int
        Iterations.

    Returns
    -------
    (m,) complex
        Unit-magnitude phases.

    Notes
    -----
    R = A·Aᴴ·diag(amplitude/‖a‖²) as in (9): column j is the field, at all points, of the drive that serves point j
    alone. The iteration u ← phase(R·u) keeps every point at full magnitude, where the eigenvector itself would settle
    on a part of the shape. It begins at incommensurate phases, because equal ones stay symmetric on symmetric shapes.
    """
    response = transfer @ transfer.conj().T * (amplitudes / np.einsum("mn,mn->m", transfer, transfer.conj()).real)
    u = np.exp(2j * np.pi * 0.6180339887 * np.arange(len(amplitudes)) ** 2)
    for _ in range(steps):
        u = np.exp(1j * np.angle(response @ u))
    return np.asarray(u)


def tikhonov(
    transfer: NDArray[np.complex128],
    amplitudes: NDArray[np.float64],
    *,
    gamma: float = 1.0,
    mu: float = 0.03,
    phase_steps: int = 20,
) -> NDArray[np.complex128]:
    """Weighted Tikhonov regularisation, the paper's (10) and (11), with the phases of its (9).

    Parameters
    ----------
    transfer : (m, n) complex
        The transfer matrix A.
    amplitudes : (m,) float
        Wanted amplitudes.
    gamma : float
        0 prefers the smallest drives, 1 the most equal ones.
    mu : float
        Weight of the regularisation, relative to the mean of the system's eigenvalues.
    phase_steps : int
        Iterations for the phases of the control points.

    Returns
    -------
    (n,) complex
        Drives, the largest of magnitude 1.

    Notes
    -----
    Minimises ‖A·x − b‖² + μ·Σ σ_q^{2γ}|x_q|² with σ_q = √(Σ_i |A_iq|·b_i / m), as x = W·Aᴴ·(A·W·Aᴴ + μI)⁻¹·b with
    W = diag(σ^{−2γ}): an m × m Cholesky factorisation. The paper's μ = 1 depends on the unit of pressure, so it is
    scaled here by tr(A·W·Aᴴ)/m. A transducer that reaches no point is left silent.
    """
    if not 0 <= gamma <= 1:
        raise ValueError(f"gamma {gamma} must lie between 0 and 1")
    if not 0 < mu <= MAX_MU:
        raise ValueError(f"mu {mu} must be positive and at most {MAX_MU:g}")
    if not (isinstance(phase_steps, int) and phase_steps >= 0):
        raise ValueError(f"phase_steps {phase_steps} must be a whole number, at least 0")
    wanted = amplitudes * control_point_phases(transfer, amplitudes, phase_steps)
    sigma = np.sqrt(amplitudes @ np.abs(transfer) / len(amplitudes))
    reaches = sigma > 0
    weight = np.where(reaches, np.where(reaches, sigma, 1.0) ** (-2 * gamma), 0.0)
    back = weight[:, None] * transfer.conj().T
    system = transfer @ back
    system += mu * np.trace(system).real / len(amplitudes) * np.eye(len(amplitudes))
    try:
        drive = back @ cho_solve(cho_factor(system), wanted)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"mu {mu} is too small for points as close together as these") from error
    return np.asarray(drive / np.abs(drive).max())


METHODS: dict[str, Callable[..., NDArray[np.complex128]]] = {"tikhonov": tikhonov}
"""Solvers by name."""
