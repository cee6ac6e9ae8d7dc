"""Many updates at once in JAX, from points to drives, in float32.

Each function does for f frames what a readable complex128 function of `methods.reference` does for one, and is tested
against it on JAX's CPU device. Frames of fewer points than a batch has room for are padded with points that have no
transfer, which change nothing.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..compiled.algebra import BELOW
from ..compiled.layout import LIMIT, TINY
from .propagation import WaveTables, response, unit_transfer

__all__ = ["Recipe", "solve_batch"]


class Recipe(NamedTuple):
    """How a batch is solved: what XLA compiles for.

    ``weighed`` says whether the regularised system is solved, or else single foci are summed; ``power`` whether the
    paper's power method finds the phases. ``steps`` is the largest number of Gauss–Newton steps. The others are those
    of `methods.options`.
    """

    weighed: bool
    power: bool
    phase_steps: int
    steps: int
    output: str
    headroom: float
    tolerance: float
    gradients: int
    flat: float
    better: float
    kept: float
    alone: float


@partial(jax.jit, static_argnames="recipe")
def solve_batch(
    tables: WaveTables, at: Array, wanted: Array, counts: Array, cold: Array, gamma: Any, mu: Any, recipe: Recipe
) -> Array:
    """Drives (f, n) within their limits of f frames, each from a cold start, of n transducers.

    ``at`` (f, m, 3) are points as for `propagation.unit_transfer`, and ``wanted`` (f, m) their amplitudes, of which the
    largest of a frame is 1. Frame i has ``counts[i]`` points; the rest is padding, with amplitude 0. ``cold`` (m,) are
    the phases to begin with, ``gamma`` and ``mu`` those of `methods.options.Options`, and ``recipe`` is the rest of the
    method.
    """
    present = jnp.arange(at.shape[1]) < counts[:, None]
    transfer = jnp.where(present[..., None], unit_transfer(tables, at) * response(tables), 0)
    limits = tables.elements[LIMIT]
    if not recipe.weighed:
        foci = jnp.sum(wanted[..., None] * _unit(transfer.conj()), axis=1)
        return _limited(foci, limits, recipe)
    with jax.default_matmul_precision("highest"):  # a GPU would else round factors to 10 bits
        reach = jnp.sum(wanted[..., None] * jnp.abs(transfer), axis=1) / counts[:, None]
        weight = jnp.where(reach > 0, jnp.maximum(reach, TINY) ** -gamma, 0)
        back = weight[:, None, :] * transfer.conj()
        gram = jnp.einsum("fin,fjn->fij", transfer, back)
        u = _phases(gram, wanted, cold, recipe)
        diagonal = jnp.diagonal(gram, axis1=1, axis2=2).real
        mean = jnp.sum(diagonal, axis=1, keepdims=True) / counts[:, None]
        least = 4 * at.shape[1] * np.finfo(np.float32).eps  # rounding may make eigenvalues of G as negative as that
        ridge = jnp.where(present, jnp.maximum(mu, least) * mean, mean)
        system = gram + ridge[..., None] * jnp.eye(at.shape[1], dtype=jnp.float32)
        lower = jax.lax.linalg.cholesky(system, symmetrize_input=False)
        # The inverse of a triangle is as exact as substitution, and each step then is a product.
        inverse = jax.lax.linalg.triangular_solve(
            lower, jnp.broadcast_to(jnp.eye(at.shape[1], dtype=jnp.complex64), lower.shape), left_side=True, lower=True
        )

        y = jnp.einsum("fji,fj->fi", inverse.conj(), jnp.einsum("fij,fj->fi", inverse, wanted * _unit(u)))
        drive = _limited(jnp.einsum("fmn,fm->fn", back, y), limits, recipe)
        if recipe.steps == 0:
            return drive
        chosen = _corrected(transfer, wanted, counts, drive, recipe)
        return chosen * jnp.minimum(1, BELOW * limits / jnp.maximum(jnp.abs(chosen), TINY))  # turning rounds


def _unit(values: Array) -> Array:
    """Each value divided by its magnitude; 0 stays 0."""
    magnitude = jnp.abs(values)
    return values * jnp.where(magnitude > 0, 1 / jnp.maximum(magnitude, TINY), 0)


def _phases(gram: Array, wanted: Array, cold: Array, recipe: Recipe) -> Array:
    """`methods.reference.phase_iteration` of each frame."""
    diagonal = jnp.diagonal(gram, axis1=1, axis2=2).real
    relation = gram * (wanted / jnp.maximum(diagonal, TINY))[:, None, :]

    def improved(_: int, u: Array) -> Array:
        u = jnp.einsum("fij,fj->fi", relation, u)
        if recipe.power:
            return u / jnp.maximum(jnp.linalg.norm(u, axis=1, keepdims=True), TINY)
        return _unit(u)

    u: Array = jax.lax.fori_loop(0, recipe.phase_steps, improved, jnp.broadcast_to(cold, wanted.shape))
    return u


def _limited(drive: Array, limits: Array, recipe: Recipe) -> Array:
    """`methods.reference.limit_drive` of each frame."""
    magnitude = jnp.abs(drive)
    if recipe.output == "phase":
        return _unit(drive) * (BELOW * limits)
    if recipe.output == "solved":
        worst = jnp.max(magnitude / (limits + TINY), axis=1, keepdims=True)
        return drive * (BELOW / jnp.maximum(worst, TINY))
    power = jnp.sum(magnitude**2, axis=1, keepdims=True)
    raised = drive * (recipe.headroom * jnp.sqrt(jnp.sum(limits**2) / jnp.maximum(power, TINY)))
    return raised * jnp.minimum(1, BELOW * limits / jnp.maximum(jnp.abs(raised), TINY))


def _corrected(transfer: Array, wanted: Array, counts: Array, drive: Array, recipe: Recipe) -> Array:
    """`methods.reference.correct` of each frame, until all have converged."""
    norm = jnp.sum(wanted**2, axis=1, keepdims=True)

    def unfinished(state: tuple[Any, ...]) -> Array:
        number, _, best, *_ = state
        return jnp.logical_and(number <= recipe.steps, jnp.any(best >= recipe.tolerance))

    def step(state: tuple[Any, ...]) -> tuple[Any, ...]:
        number, drive, best, chosen, least = state
        pressure = jnp.einsum("fmn,fn->fm", transfer, drive)
        magnitude = jnp.abs(pressure)
        scale = jnp.maximum(jnp.sum(wanted * magnitude, axis=1, keepdims=True) / norm, TINY)
        missing = wanted - magnitude / scale
        error = jnp.sqrt(jnp.sum(missing**2, axis=1, keepdims=True) / counts[:, None])
        least = jnp.where(number == 0, recipe.kept * scale, least)
        better = (error < recipe.better * best) & (best >= recipe.tolerance) & (scale >= least)
        best, chosen = jnp.where(better, error, best), jnp.where(better, drive, chosen)
        half = _turns(transfer, wanted, drive, _unit(pressure).conj(), missing, recipe) * scale / 2
        turned = drive * jax.lax.complex(1 - half * half, 2 * half) / (1 + half * half)
        return number + 1, turned, best, chosen, least

    begin = (0, drive, jnp.full_like(norm, jnp.inf), drive, jnp.zeros_like(norm))
    chosen: Array = jax.lax.while_loop(unfinished, step, begin)[3]
    return chosen


def _squares(vectors: tuple[Array, ...]) -> tuple[Array, ...]:
    """The squared norm, (f, 1), of each of some (f, m)."""
    return tuple(jnp.sum(jnp.abs(each) ** 2, axis=1, keepdims=True) for each in vectors)


def _turns(transfer: Array, wanted: Array, drive: Array, against: Array, missing: Array, recipe: Recipe) -> Array:
    """`methods.reference.conjugate_gradients` for the turns (f, n) of drives that make the missing magnitudes.

    ``against`` is e^{−iφ} of the phases φ of the pressures. A point's two rows, those of |p| and, at a null, of p at
    right angles, are the imaginary and the real part of one number, so that all products are with the transfer matrix.
    """
    direction = wanted / jnp.linalg.norm(wanted, axis=1, keepdims=True)

    def images_of(turns: Array) -> tuple[Array, Array]:
        """What turns change: all, and without the common level."""
        waves = against * jnp.einsum("fmn,fn->fm", transfer, drive * turns)
        along = -waves.imag
        whole = jax.lax.complex(jnp.where(wanted == 0, waves.real, 0), along)
        along -= direction * jnp.sum(direction * along, axis=1, keepdims=True)
        return whole, jax.lax.complex(whole.real, along)

    def improved(number: int, state: tuple[Array, ...]) -> tuple[Array, ...]:
        solution, search, residual, first, before = state
        gradient = (drive * jnp.einsum("fmn,fm->fn", transfer, against * residual)).real
        square = jnp.sum(gradient**2, axis=1, keepdims=True)
        first = jnp.where(number == 0, square, first)
        goes_on = (before > 0) & ((number == 0) | (square > recipe.flat**2 * first))
        search = gradient + jnp.where(goes_on & (number > 0), square / before, 0) * search
        (whole2, image2), image = _squares(images := images_of(search)), images[1]
        goes_on &= image2 > recipe.alone * whole2
        length = square / jnp.maximum(image2, TINY)
        length = jnp.where(goes_on, length, 0)
        return solution + length * search, search, residual - length * image, first, jnp.where(goes_on, square, 0)

    zero, one = jnp.zeros(drive.shape, jnp.float32), jnp.ones((len(drive), 1), jnp.float32)
    begin = (zero, zero, jax.lax.complex(jnp.zeros_like(missing), missing), one, one)
    solution: Array = jax.lax.fori_loop(0, recipe.gradients, improved, begin)[0]
    return solution
