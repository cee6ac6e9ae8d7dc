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

from ..compiled.kernels import BELOW, LIMIT, TINY
from .propagation import WaveTables, response, unit_transfer

__all__ = ["Recipe", "solve_batch"]


class Recipe(NamedTuple):
    """How a batch is solved: what XLA compiles for.

    Parameters
    ----------
    weighed : bool
        Whether the regularised system is solved; if not, single foci are summed.
    power : bool
        Whether the phases are found by the paper's power method.
    phase_steps, steps : int
        Iterations for the phases, and Gerchberg–Saxton steps.
    output : {"solved", "phase", "limited"}
        The output policy.
    headroom, relaxation : float
        `methods.options.HEADROOM` and `RELAXATION`.
    """

    weighed: bool
    power: bool
    phase_steps: int
    steps: int
    output: str
    headroom: float
    relaxation: float


@partial(jax.jit, static_argnames="recipe")
def solve_batch(
    tables: WaveTables, at: Array, wanted: Array, counts: Array, cold: Array, gamma: Any, mu: Any, recipe: Recipe
) -> Array:
    """Drives of f frames, each from a cold start.

    Parameters
    ----------
    tables : WaveTables
        n transducers.
    at : (f, m, 3) float32
        Points, as for `propagation.unit_transfer`; those of frame i from ``counts[i]`` on are padding.
    wanted : (f, m) float32
        Amplitudes, the largest of a frame 1; 0 for padding.
    counts : (f,) int32
        Points of each frame.
    cold : (m,) complex64
        Phases to begin with.
    gamma, mu : float
        As in `methods.options.Options`.
    recipe : Recipe
        The rest of the method.

    Returns
    -------
    (f, n) complex64
        Drives within their limits.
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

        def drives(b: Array) -> Array:
            y = jnp.einsum("fji,fj->fi", inverse.conj(), jnp.einsum("fij,fj->fi", inverse, b))
            return _limited(jnp.einsum("fmn,fm->fn", back, y), limits, recipe)

        b = wanted * _unit(u)
        if recipe.steps == 0:
            return drives(b)
        return _corrected(drives, transfer, wanted, b, recipe)


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


def _corrected(drives: Any, transfer: Array, wanted: Array, b: Array, recipe: Recipe) -> Array:
    """`methods.reference.correct` of each frame: ``drives`` solves for the complex pressures b."""
    norm = jnp.sum(wanted**2, axis=1, keepdims=True)

    def step(number: int, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        b, best, chosen = state
        drive = drives(b)
        pressure = jnp.einsum("fmn,fn->fm", transfer, drive)
        magnitude = jnp.abs(pressure)
        scale = jnp.sum(wanted * magnitude, axis=1, keepdims=True) / norm
        fit = jnp.maximum(scale, TINY)
        error = jnp.sum((magnitude / fit - wanted) ** 2, axis=1, keepdims=True)
        better = (number == 0) | ((scale > TINY) & (error < best))
        b = b + recipe.relaxation * (wanted * _unit(pressure) - pressure / fit)
        return b, jnp.where(better, error, best), jnp.where(better, drive, chosen)

    begin = (b, jnp.full_like(norm, jnp.inf), jnp.zeros((len(b), transfer.shape[-1]), transfer.dtype))
    chosen: Array = jax.lax.fori_loop(0, recipe.steps + 1, step, begin)[2]
    return chosen
