"""Many frames at once on a GPU: what it can do, and frames packed into batches and back.

JAX is an extra and numba slow to import, so this module is imported when a GPU is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..accelerated.devices import power_of_two
from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..acoustics.tables import surely_reachable, tables_of
from ..shapes.points import REACH, ControlPoints, check_reachable
from .engine import is_modelled
from .methods import METHODS
from .options import ALONE, BETTER, FLAT, GRADIENTS, HEADROOM, KEPT, LEAST_MU, TOLERANCE, Options
from .reference import cold_start

if TYPE_CHECKING:
    from jax import Device

    from ..accelerated.updates import Recipe

__all__ = ["BATCH_BYTES", "batch_size", "drive_batches", "hindrance", "padded_points", "recipe_of"]

BATCH_BYTES = 2**30
"""Memory of a device that a batch may fill, unless one frame alone needs more."""

MOST_FRAMES = 4096  # of a batch: more save no time


def hindrance(array: TransducerArray, medium: Medium, method: str, options: Options) -> str | None:
    """Why a GPU cannot solve by a method, or None."""
    uses = METHODS[method].kernels
    if uses is None or uses.polished:
        return f"the method {method} has no version for a GPU; tikhonov, wgs and multiplex have one"
    if options.phase_seconds is not None:
        return "phase_seconds is the time of one frame, and a batch has no such time"
    if options.mu < LEAST_MU:
        return f"mu {options.mu} is below {LEAST_MU:g} and needs double precision"
    if not is_modelled(tables_of(array, medium)):
        return "single precision is too coarse for so large an array or so much absorption"
    return None


def recipe_of(method: str, options: Options) -> Recipe:
    """What a batch is compiled for, of a method that has kernels."""
    from ..accelerated.updates import Recipe

    uses = METHODS[method].kernels
    assert uses is not None
    return Recipe(
        weighed=uses.weighed,
        power=options.phases == "power",
        phase_steps=options.phase_steps,
        steps=options.steps if uses.corrected else 0,
        output=options.policy,
        headroom=HEADROOM,
        tolerance=TOLERANCE,
        gradients=GRADIENTS,
        flat=FLAT,
        better=BETTER,
        kept=KEPT,
        alone=ALONE,
    )


def padded_points(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """The least of 8, 12, 16, 24, 32, 48, … that holds each number of points: XLA compiles for each that occurs."""
    whole = 2 ** np.ceil(np.log2(np.maximum(counts, 8))).astype(np.int64)
    return np.where(counts <= whole * 3 // 4, np.maximum(whole * 3 // 4, 8), whole)


def batch_size(points: int, transducers: int) -> int:
    """How many frames a batch has room for, a power of two: five transfer and six Gram matrices of each at a time."""
    frame = 8 * points * (5 * transducers + 6 * points)
    return min(MOST_FRAMES, 1 << max(1, BATCH_BYTES // frame).bit_length() - 1)


def drive_batches(
    device: Device,
    array: TransducerArray,
    medium: Medium,
    method: str,
    options: Options,
    frames: Sequence[ControlPoints],
    drives: NDArray[np.complex64],
) -> None:
    """Solve all frames, from scratch each, into drives (frames, n).

    `ValueError` if a point cannot be reached; the message names the frame.
    """
    import jax

    from ..accelerated.propagation import WaveTables
    from ..accelerated.updates import solve_batch

    known, recipe = tables_of(array, medium), recipe_of(method, options)
    tables = jax.device_put(WaveTables(*known[:4]), device)
    gamma, mu = np.float32(options.gamma), np.float32(options.mu)
    solving: list[tuple[NDArray[np.int64], jax.Array]] = []

    def fetch() -> None:
        members, solved = solving.pop(0)
        drives[members] = np.asarray(solved)[: len(members), : len(array)]

    for members, size in _batches(frames, len(array)):
        packed = jax.device_put(_packed(array, known.origin, frames, members, *size), device)
        cold = jax.device_put(cold_start(size[1]).astype(np.complex64), device)
        solving.append((members, solve_batch(tables, *packed, cold, gamma, mu, recipe)))
        if len(solving) > 1:
            fetch()  # the batch before, while the device solves this one
    while solving:
        fetch()


def _batches(frames: Sequence[ControlPoints], transducers: int) -> Iterator[tuple[NDArray[np.int64], tuple[int, int]]]:
    """Frames of about as many points, by index, and the batch's (frames, points)."""
    padded = padded_points(np.array([len(points) for points in frames]))
    for points in np.unique(padded).tolist():
        members = np.flatnonzero(padded == points)
        room = batch_size(points, transducers)
        for first in range(0, len(members), room):
            part = members[first : first + room]
            yield part, (min(room, power_of_two(len(part))), points)


def _packed(
    array: TransducerArray,
    origin: NDArray[np.float64],
    frames: Sequence[ControlPoints],
    members: NDArray[np.int64],
    room: int,
    points: int,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
    """Positions, amplitudes and numbers of points of a batch, as `solve_batch` takes them; spare frames repeat one."""
    chosen = [frames[index] for index in members.tolist()]
    counts = np.array([len(each) for each in chosen], np.int32)
    positions = np.concatenate([each.positions for each in chosen])
    amplitudes = np.concatenate([each.amplitudes for each in chosen])
    if not surely_reachable(array, positions, REACH):
        for index, each in zip(members.tolist(), chosen, strict=True):
            check_reachable(array, each, f"frame {index}: ")
    largest = np.maximum.reduceat(amplitudes, np.cumsum(counts) - counts)
    filled = np.arange(points) < counts[:, None]
    at, wanted = np.zeros((room, points, 3), np.float32), np.zeros((room, points), np.float32)
    at[: len(chosen)][filled] = positions - origin
    wanted[: len(chosen)][filled] = amplitudes / np.repeat(largest, counts)
    at[len(chosen) :], wanted[len(chosen) :] = at[0], wanted[0]
    return at, wanted, np.concatenate([counts, np.full(room - len(chosen), counts[0])])
