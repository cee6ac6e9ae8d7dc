"""Fields: complex pressure sampled over a plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .array import TransducerArray
from .geometry import frozen
from .medium import Medium
from .propagation import pressure

__all__ = ["PlaneField", "sample_plane"]

MAX_SAMPLES = 4_000_000
MAX_PAIRS = 2_000_000_000  # of samples and transducers: minutes of work


@dataclass(frozen=True, eq=False)
class PlaneField:
    """Pressure over a horizontal plane.

    Parameters
    ----------
    x : (columns,) float
    y : (rows,) float
        Coordinates of the samples, in metres.
    height : float
        Of the plane above the array, in metres.
    pressure : (rows, columns) complex
        Peak pressure in Pa.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    height: float
    pressure: NDArray[np.complex128]


def sample_plane(
    array: TransducerArray,
    drive: ArrayLike,
    height: float,
    extent: float = 0.2,
    step: float = 1e-3,
    medium: Medium | None = None,
) -> PlaneField:
    """Pressure over a horizontal square centred above the array.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    drive : (n,) complex
        Drives.
    height : float
        Of the plane, in metres.
    extent : float
        Side of the square, in metres, rounded down to an even number of steps so that one sample is in the middle.
    step : float
        Distance between samples, in metres.
    medium : Medium, optional
        The air; 20 °C by default.

    Raises
    ------
    ValueError
        Where a number is out of range, or there are too many samples.
    """
    for name, value in (("height", height), ("extent", extent), ("step", step)):
        if not 0 < value < math.inf:
            raise ValueError(f"{name} {value} m must be positive and finite")
    if extent / step < 2:
        raise ValueError(f"a step of {step} m is too long for a plane of {extent} m; at most half of it")
    if extent / step > math.sqrt(MAX_SAMPLES) - 2:
        raise ValueError(f"a step of {step} m over {extent} m makes more than {MAX_SAMPLES} samples")
    half = int(extent / step / 2 + 1e-9)
    count = 2 * half + 1
    if count**2 * len(array) > MAX_PAIRS:
        raise ValueError(f"{count**2} samples with {len(array)} transducers are too many; at most {MAX_PAIRS} pairs")
    axis = frozen(np.arange(-half, half + 1, dtype=np.float64) * step)
    x, y = np.meshgrid(axis, axis)
    at = np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], axis=1)
    values = pressure(array, drive, at, medium).reshape(x.shape)
    return PlaneField(axis, axis, height, frozen(values))
