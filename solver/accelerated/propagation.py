"""The transfer matrix and the pressure of all transducers in JAX: what the compiled kernels do, in float32.

Each function does what a readable complex128 function of `acoustics.propagation` does, and is tested against it on
JAX's CPU device.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, Device
from numpy.typing import NDArray

from ..compiled import layout
from ..compiled.propagation import COSINE, SINE
from .devices import power_of_two

__all__ = ["PAIRS_AT_A_TIME", "WaveTables", "response", "sum_pressure", "unit_transfer"]

PAIRS_AT_A_TIME = 2**26
"""Of points and transducers: 512 MiB if XLA keeps each wave, as it does on a processor."""


class WaveTables(NamedTuple):
    """An array in its medium: the first fields of `acoustics.tables.ArrayTables`, which says what they are."""

    elements: Any
    wave: Any
    turns: Any
    nepers: Any


def unit_transfer(tables: WaveTables, at: Array) -> Array:
    """Residual·e^{(ik−α)r}/r of each transducer: the transfer matrix (..., n) of responses and strength 1.

    The points ``at`` (..., 3) are in metres, relative to the tables' origin. Behind a transducer's baffle it is 0.
    """
    elements = tables.elements
    dx, dy, dz = (at[..., axis, None] - elements[row] for axis, row in enumerate((layout.X, layout.Y, layout.Z)))
    r = jnp.sqrt(dx * dx + dy * dy + dz * dz + layout.TINY)
    inverse = 1 / r
    cosine = (dx * elements[layout.NX] + dy * elements[layout.NY] + dz * elements[layout.NZ]) * inverse
    amplitude = jnp.where(cosine > 0, inverse, 0)
    if tables.nepers is not None:
        amplitude *= jnp.exp(-tables.nepers * r)
    if len(tables.wave) == 1:
        amplitude *= _polynomial(tables.wave[0], 1 - cosine * cosine)
        return amplitude * _turned(tables.turns * r)
    table, nearest, cosines, growth = tables.wave
    amplitude *= jnp.where(cosines == 1, cosine, 1) * jnp.where(growth > 0, growth * jnp.sqrt(r), 1)
    return amplitude * _looked_up(table, 1 - cosine * cosine, nearest * inverse) * _turned(tables.turns * r)


def response(tables: WaveTables) -> Array:
    """The (n,) complex64 responses of the transducers, polarity included; 0 for dead ones."""
    return jnp.asarray(tables.elements[layout.GAIN] * _turned(tables.elements[layout.LEAD]))


def _polynomial(coefficients: Sequence[Any] | Array, x: Array) -> Array:
    """Σ_k c_k·x^k."""
    *lower, highest = coefficients
    return jnp.asarray(reduce(lambda total, c: total * x + c, reversed(lower), highest))


def _turned(turns: Array) -> Array:
    """e^{2πi·turns}: whole turns go before any rounding of the angle."""
    t = turns - jnp.round(turns)
    return jax.lax.complex(_polynomial(COSINE, t * t), t * _polynomial(SINE, t * t))


def _looked_up(table: Array, sine_squared: Array, inverse: Array) -> Array:
    """A table (rows, columns, 2) over sin²θ and nearest/r, interpolated linearly."""
    rows, columns = table.shape[:2]
    x, y = jnp.clip(sine_squared, 0, 1) * (rows - 1), jnp.minimum(inverse, 1) * (columns - 1)
    i, j = jnp.minimum(x.astype(int), rows - 2), jnp.minimum(y.astype(int), columns - 2)
    down, right = x - i, y - j
    upper = table[i, j] * (1 - right)[..., None] + table[i, j + 1] * right[..., None]
    lower = table[i + 1, j] * (1 - right)[..., None] + table[i + 1, j + 1] * right[..., None]
    found = upper + (lower - upper) * down[..., None]
    return jax.lax.complex(found[..., 0], found[..., 1])


@jax.jit
def _pressure(tables: WaveTables, emitted: Array, at: Array) -> Array:
    # A product and a sum can become one loop that keeps no wave; a matrix product would read all from memory.
    return jnp.sum(unit_transfer(tables, at) * emitted, axis=-1)


def sum_pressure(
    device: Device, tables: WaveTables, emitted: NDArray[np.complex128], at: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Pressure (k,) of all transducers relative to the tables' strength, in float32, a block of points at a time.

    ``emitted`` (n,) are drives times responses; the tables may have more transducers. The points ``at`` (k, 3) are in
    metres, relative to the tables' origin.
    """
    columns = tables.elements.shape[1]
    spread = np.zeros(columns, np.complex64)
    spread[: len(emitted)] = emitted
    tables, spread = jax.device_put((tables, spread), device)
    block = min(power_of_two(len(at)), max(1, PAIRS_AT_A_TIME // columns))
    parts = []
    for first in range(0, len(at), block):
        part = at[first : first + block].astype(np.float32)
        padded = np.pad(part, ((0, block - len(part)), (0, 0)), mode="edge")
        parts.append((len(part), _pressure(tables, spread, jax.device_put(padded, device))))
    return np.concatenate([np.asarray(part)[:count] for count, part in parts]).astype(np.complex128)
