"""The solvers' algorithms, one readable complex128 function each.

The compiled kernels are tested against these, and ``precision="double"`` runs them. ``transfer`` is A of the paper's
(7), (m, n) complex; ``wanted`` the (m,) amplitudes, at least one of them positive; ``phases`` the (m,) unit-modulus
phases of the control points; drives are (n,) complex, of any scale until `limit_drive`.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from .options import ALONE, BETTER, FLAT, GRADIENTS, HEADROOM, KEPT, LEAST_GAIN, TOLERANCE, Output, Phases

__all__ = [
    "Regularised",
    "augmented",
    "cold_start",
    "conjugate_gradients",
    "correct",
    "limit_drive",
    "min_norm",
    "misfit",
    "multiplex",
    "phase_iteration",
    "polish",
    "unit",
]

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

RANK_TOLERANCE = 1e-9  # singular values below this part of the largest are taken for 0
TINY = np.finfo(float).tiny


def unit(values: Complex) -> Complex:
    """Each value divided by its magnitude; 0 stays 0."""
    magnitude = np.abs(values)
    return np.asarray(np.divide(values, magnitude, out=np.zeros_like(values), where=magnitude > 0))


def cold_start(m: int) -> Complex:
    """Phases to begin with: incommensurate ones, because equal ones stay symmetric on symmetric shapes."""
    return np.asarray(np.exp(2j * np.pi * 0.6180339887 * np.arange(m) ** 2))


def phase_iteration(gram: Complex, wanted: Real, start: Complex, steps: int, method: Phases = "unit") -> Complex:
    """Phases (m,) with which the control points strengthen each other, by the paper's section 3.2: the last iterate's.

    Parameters
    ----------
    gram : (m, m) complex
        A·W·Aᴴ; with W = 1 the paper's own.
    wanted, start : (m,)
        Amplitudes, and the values at which the iteration begins.
    steps : int
        Number of iterations.
    method : {"unit", "power"}
        ``"power"`` is the paper's power method; ``"unit"`` sets every point back to modulus 1 after each step.

    Notes
    -----
    R = A·W·Aᴴ·diag(wanted/diag(A·W·Aᴴ)), (9): column j is the field, at all points, of the drive that serves point j
    alone. Its dominant eigenvector settles on a part of the shape; kept at full magnitude, every point counts.
    """
    response = gram * (wanted / np.maximum(np.diag(gram).real, TINY))
    u = start
    for _ in range(steps):
        u = response @ u
        u = u / max(float(np.linalg.norm(u)), TINY) if method == "power" else unit(u)
    return u


def limit_drive(drive: Complex, limits: Real, output: Output) -> Complex:
    """Bring drives (n,) of any scale within their limits.

    ``"solved"`` scales all alike until one is at its limit. ``"phase"`` sets each to its limit and keeps its phase.
    ``"limited"`` scales all alike until their root mean square is `HEADROOM` times that of the limits, and cuts off
    what is above: nearly the accuracy of the first and the strength of the second.
    """
    magnitude = np.abs(drive)
    if output == "phase":
        return unit(drive) * limits
    if output == "solved":
        able = limits > 0
        return np.asarray(np.where(able, drive, 0) / max(float((magnitude[able] / limits[able]).max()), TINY))
    raised = drive * (HEADROOM * np.sqrt((limits**2).sum() / max(float((magnitude**2).sum()), TINY)))
    return np.asarray(raised * np.minimum(1, limits / np.maximum(np.abs(raised), TINY)))


def multiplex(transfer: Complex, wanted: Real) -> Complex:
    """Linear multiplexing, (12): the drives that focus on each point alone, summed: Σ_i wanted_i·e^{−ik·r_iq}.

    It makes no nulls: a point of amplitude 0 is left out.
    """
    return np.asarray(wanted @ unit(transfer.conj()))


def min_norm(transfer: Complex, wanted: Real, phases: Complex) -> Complex:
    """The smallest drive that makes the points exactly, or as nearly as least squares can, (6)–(8)."""
    return np.asarray(scipy.linalg.lstsq(transfer, wanted * phases, cond=RANK_TOLERANCE, lapack_driver="gelsy")[0])


def augmented(transfer: Complex, wanted: Real, phases: Complex, gamma: float) -> Complex:
    """The paper's (10) to the letter: [A; diag(σ^γ)]·x = [b; 0] by least squares, μ = 1 in pascals."""
    n = transfer.shape[1]
    sigma = np.sqrt(wanted @ np.abs(transfer) / len(wanted))
    matrix = np.vstack([transfer, np.diag(sigma**gamma)])
    target = np.concatenate([wanted * phases, np.zeros(n)])
    return np.asarray(scipy.linalg.lstsq(matrix, target, cond=RANK_TOLERANCE)[0])


class Regularised:
    """Weighted Tikhonov regularisation, (10)–(11), factored once for any right-hand side.

    Parameters
    ----------
    transfer, wanted
        As in this module.
    gamma : float
        0 prefers the smallest drives, 1 the most equal ones.
    mu : float
        Relative weight of the regularisation.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the system is singular: μ is too small for points as close as these.

    Notes
    -----
    Minimises ‖A·x − b‖² + μ·Σ σ_q^{2γ}|x_q|² with σ_q = √(Σ_i |A_iq|·wanted_i / m), as x = W·Aᴴ·(A·W·Aᴴ + μI)⁻¹·b with
    W = diag(σ^{−2γ}): an m × m Cholesky factorisation. The paper's μ = 1 depends on the unit of pressure, so it is
    scaled here by tr(A·W·Aᴴ)/m. A transducer that reaches no wanted point has no weight and stays silent.
    """

    gram: Complex
    """A·W·Aᴴ, (m, m)."""

    def __init__(self, transfer: Complex, wanted: Real, gamma: float, mu: float) -> None:
        sigma = np.sqrt(wanted @ np.abs(transfer) / len(wanted))
        weight = np.where(sigma > 0, np.where(sigma > 0, sigma, 1.0) ** (-2 * gamma), 0.0)
        self._back = weight[:, None] * transfer.conj().T
        self.gram = transfer @ self._back
        ridge = mu * np.trace(self.gram).real / len(wanted)
        self._factor = scipy.linalg.cho_factor(self.gram + ridge * np.eye(len(wanted)))

    def solve(self, b: Complex) -> Complex:
        """Drive (n,) for the complex pressures b (m,)."""
        return np.asarray(self._back @ scipy.linalg.cho_solve(self._factor, b))


def misfit(pressure: Complex, wanted: Real) -> tuple[float, float]:
    """The scale s that fits |p| to s·wanted best, and the root mean square of |p|/s − wanted; infinite for silence."""
    magnitude = np.abs(pressure)
    scale = float(wanted @ magnitude / (wanted @ wanted))
    if not scale > 0:
        return TINY, float("inf")
    return scale, float(np.sqrt(np.mean((magnitude / scale - wanted) ** 2)))


def correct(transfer: Complex, wanted: Real, drive: Complex, steps: int) -> Complex:
    """Gauss–Newton steps over the phases of drives (n,); the best iterate of those that keep the strength is kept.

    There are at most ``steps``; it ends if the `misfit` of one that keeps `KEPT` of the strength falls below
    `TOLERANCE`. If the drives turn by δ, |p_i| changes by −Σ_q Im(p_i*·A_iq·x_q/|p_i|)·δ_q. Of the many δ with which
    |p| becomes proportional to ``wanted``, `conjugate_gradients` finds a small one, which keeps the pressures strong.
    At a null p must not change at right angles either.
    """
    nulls = wanted == 0
    proportions = np.concatenate([wanted, np.zeros(nulls.sum())])
    best, chosen, least = np.inf, drive, 0.0
    for step in range(steps + 1):
        waves = transfer * drive
        pressure = waves.sum(axis=1)
        scale, error = misfit(pressure, wanted)
        if step == 0:
            least = KEPT * scale
        if error < BETTER * best and scale >= least:
            best, chosen = error, drive
        if best < TOLERANCE or step == steps:
            break
        aligned = waves * unit(pressure).conj()[:, None]
        slopes = np.concatenate([-aligned.imag, aligned.real[nulls]])
        missing = np.concatenate([scale * wanted - np.abs(pressure), np.zeros(nulls.sum())])
        half = conjugate_gradients(slopes, missing, proportions) / 2
        drive = drive * (1 + 1j * half) / (1 - 1j * half)
    return chosen


def conjugate_gradients(matrix: Real, target: Real, proportions: Real) -> Real:
    """A small x for which matrix·x ≈ target + c·proportions by least squares, any c; ``target`` has none of them.

    At most `GRADIENTS` iterations from 0 until the gradient is `FLAT`. They hardly use the directions that matrix·x
    hardly depends on, so that no other regularisation is needed.
    """
    direction = proportions / np.linalg.norm(proportions)
    solution = search = np.zeros(matrix.shape[1])
    residual, first, before = target, 0.0, 1.0
    for iteration in range(GRADIENTS):
        gradient = residual @ matrix
        square = float(gradient @ gradient)
        if iteration == 0:
            first = square
        elif square <= FLAT**2 * first:
            break
        search = gradient + square / before * search
        whole = matrix @ search
        image = whole - (direction @ whole) * direction
        if image @ image <= ALONE * (whole @ whole):
            break
        length = square / float(image @ image)
        solution, residual, before = solution + length * search, residual - length * image, square
    return np.asarray(solution)


def polish(transfer: Complex, wanted: Real, drive: Complex, levels: int, sweeps: int) -> Complex:
    """Coordinate descent over quantised phases, from drives (n,): each drive in turn tries the next phase either way.

    There are ``levels`` phases in a turn, of which the resulting ones are multiples, and ``sweeps`` passes over all
    transducers. No step increases the `misfit`.
    """
    magnitude, level = np.abs(drive), np.rint(np.angle(drive) * levels / (2 * np.pi)).astype(int)
    turn = np.exp(2j * np.pi * np.arange(levels) / levels)
    chosen = magnitude * turn[level % levels]
    pressure = transfer @ chosen
    best = misfit(pressure, wanted)[1] ** 2
    for _ in range(sweeps):
        for q in range(len(drive)):
            for step in (1, -1):
                moved = magnitude[q] * turn[(level[q] + step) % levels]
                trial = pressure + transfer[:, q] * (moved - chosen[q])
                if (error := misfit(trial, wanted)[1] ** 2) < best - LEAST_GAIN:
                    best, pressure, chosen[q] = error, trial, moved
                    level[q] += step
                    break
    return np.asarray(chosen)
