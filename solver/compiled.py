"""From arrays and points to the compiled kernels and back: the tables that kernels read, and the float32 engine.

numba takes half a second to import, so this module is imported where it is used and not before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import Chebyshev
from numpy.polynomial.polynomial import Polynomial
from numpy.typing import NDArray

from . import kernels
from .array import TransducerArray
from .diffraction import KERNELS, REFERENCE_DISTANCE
from .geometry import frozen
from .medium import Medium
from .models import residual
from .options import HEADROOM, LEAST_GAIN, NUDGE, RELAXATION, Options
from .points import REACH, ControlPoints, check_reachable
from .propagation import transfer_matrix
from .reference import cold_start
from .simd import LANES
from .table import ResidualTable

__all__ = ["CompiledEngine", "can_reach", "compilation", "inside_box", "pressure_at", "tables_of"]

OUTPUTS = {"solved": kernels.SOLVED, "phase": kernels.PHASE, "limited": kernels.LIMITED}
POLYNOMIAL_ERROR = 2e-6
ROWS_PER_KA2 = 8  # of a table in sin²θ, per (k·radius)²: linear interpolation is then within 3e-5


class Tables(NamedTuple):
    """An array in its medium as kernels read it, coordinates relative to ``origin``, pressure to ``strength``.

    ``wave`` is what the kernels need to know of the transducer's model: the coefficients of its directivity in sin²θ,
    or else a table of its residual, from which distance that holds, and the powers before it.
    """

    elements: NDArray[np.float32]
    wave: tuple[NDArray[np.float32]] | tuple[NDArray[np.float32], np.float32, int, np.float32]
    turns: np.float32
    nepers: np.float32 | None
    origin: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    strength: float


@lru_cache(maxsize=32)
def tables_of(array: TransducerArray, medium: Medium) -> Tables:
    """Tables of an array, which is not to be changed after."""
    n, transducer = len(array), array.transducer
    low, high = array.positions.min(axis=0), array.positions.max(axis=0)
    origin = (low + high) / 2
    able = (array.response != 0) & (array.limits > 0)
    elements = aligned(kernels.ELEMENT_ROWS, -(-n // LANES) * LANES)
    elements[kernels.X : kernels.Z + 1, :n] = (array.positions - origin).T
    elements[kernels.NX : kernels.NZ + 1, :n] = array.normals.T
    elements[kernels.GAIN, :n] = np.where(able, np.abs(array.response), 0)
    elements[kernels.LEAD, :n] = np.angle(array.response * transducer.polarity) / (2 * np.pi)
    elements[kernels.LIMIT, :n] = np.where(able, array.limits, 0)
    return Tables(
        frozen(elements),
        _wave_of(array, medium),
        np.float32(1 / medium.wavelength),
        np.float32(medium.attenuation) if medium.attenuation else None,
        origin,
        low - transducer.nearest,
        high + transducer.nearest,
        transducer.strength,
    )


def can_reach(tables: Tables, points: NDArray[np.float64]) -> bool:
    """Whether the kernels can compute the waves at (k, 3) points, which they cannot where nearly all is absorbed."""
    if tables.nepers is None:
        return True
    farthest = np.maximum(points.max(axis=0) - tables.low, tables.high - points.min(axis=0))
    return float(tables.nepers) * float(np.linalg.norm(farthest)) <= kernels.MAX_NEPERS


def _wave_of(
    array: TransducerArray, medium: Medium
) -> tuple[NDArray[np.float32]] | tuple[NDArray[np.float32], np.float32, int, np.float32]:
    """The `Tables.wave` of a transducer: a polynomial where one of the kernels' degree is good enough."""
    transducer = array.transducer
    if transducer.model in KERNELS:
        table = ResidualTable.of(transducer, medium, transducer.nearest)
        growth = REFERENCE_DISTANCE**-0.5 if table.kernel.growth else 0.0
        return _pairs(table.values), np.float32(table.nearest), table.kernel.cosine, np.float32(growth)

    def directivity(sine_squared: NDArray[np.float64]) -> NDArray[np.float64]:
        return residual(transducer, np.sqrt(np.clip(sine_squared, 0, 1)), 1.0, medium).real

    fitted = Chebyshev.interpolate(directivity, kernels.DIRECTIVITY_TERMS - 1, domain=[0, 1])
    between = np.linspace(0, 1, 200)
    if np.abs(fitted(between) - directivity(between)).max() <= POLYNOMIAL_ERROR:
        coefficients = np.zeros(kernels.DIRECTIVITY_TERMS, dtype=np.float32)
        powers = fitted.convert(kind=Polynomial).coef
        coefficients[: len(powers)] = powers
        return (frozen(coefficients),)
    rows = max(64, round((medium.wavenumber * transducer.radius) ** 2 * ROWS_PER_KA2))
    column = directivity(np.linspace(0, 1, rows)).astype(np.complex128)
    return _pairs(np.stack([column, column], axis=1)), np.float32(1), 0, np.float32(0)


def _pairs(values: NDArray[np.complex128]) -> NDArray[np.float32]:
    """(…) complex as (…, 2) real."""
    return frozen(np.stack([values.real, values.imag], axis=-1).astype(np.float32))


def aligned(*shape: int) -> NDArray[np.float32]:
    """Zeros that begin where a register's worth of memory does."""
    size = int(np.prod(shape))
    room = np.zeros(size + LANES, dtype=np.float32)
    first = -room.ctypes.data % (4 * LANES) // 4
    return room[first : first + size].reshape(shape)


class CompiledEngine:
    """One update at a time in float32, with its buffers and the phases of the last one.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    medium : Medium
        The air.
    method : str
        A compiled one of `METHODS`.
    options : Options
        With an output policy.
    """

    def __init__(self, array: TransducerArray, medium: Medium, method: str, options: Options) -> None:
        self._array, self._medium, self._method, self._options = array, medium, method, options
        self._tables = tables_of(array, medium)
        self._modelled = can_reach(self._tables, np.stack([self._tables.low - REACH, self._tables.high + REACH]))
        self._columns = self._tables.elements.shape[1]
        self._capacity = 0
        self._points = 0
        self._warm = False
        self._gamma, self._mu = np.float32(options.gamma), np.float32(options.mu)
        self._output = OUTPUTS[str(options.output)]
        self._power = options.phases == "power"
        self._steps = options.steps if method in ("wgs", "polish") else 0

    def forget(self) -> None:
        """Begin the next update's phases anew."""
        self._warm = False

    def drive(self, points: ControlPoints) -> NDArray[np.complex64]:
        """Drives (n,) for control points.

        Raises
        ------
        ValueError
            Where a point cannot be reached, or the system is singular.
        """
        m = len(points)
        self._make_room(m)
        self._model(points)
        drive = np.empty(len(self._array), dtype=np.complex64)
        elements, work = self._tables.elements, self._work
        if self._method == "multiplex":
            kernels.sum_foci(elements, m, self._output, HEADROOM32, work, drive)
            return drive
        self._begin(m)
        fit = kernels.finish(
            elements, m, self._u, self._mu, self._output, HEADROOM32, RELAXATION32, self._steps, work, drive
        )
        if fit < 0:
            raise ValueError(self._too_close)
        if self._method == "polish":
            kernels.polish(m, self._columns, self._options.levels, self._options.sweeps, LEAST_GAIN, work, drive)
        return drive

    @property
    def takes_frames(self) -> bool:
        """Whether `drive_frames` can be used."""
        regularised = self._method in ("tikhonov", "wgs") and self._options.phase_seconds is None
        return regularised and self._modelled and len(self._tables.wave) == 1

    def drive_frames(self, frames: Sequence[ControlPoints], first: int, stride: int, drives: NDArray[Any]) -> None:
        """Solve every ``stride``-th frame from ``first`` on, from scratch each, into drives (frames, n).

        Raises
        ------
        ValueError
            As `drive`.
        """
        tables, options = self._tables, self._options
        begins = np.cumsum([0, *(len(points) for points in frames)])
        largest = max(len(points) for points in frames)
        self._make_room(largest)
        suspect, singular = kernels.update_frames(
            tables.elements,
            tables.wave[0],
            tables.turns,
            tables.nepers,
            tables.origin,
            tables.low,
            tables.high,
            REACH,
            np.concatenate([points.positions for points in frames]),
            np.concatenate([points.amplitudes for points in frames]),
            begins,
            first,
            stride,
            self._gamma,
            options.phase_steps,
            self._power,
            self._cold,
            self._mu,
            self._output,
            HEADROOM32,
            RELAXATION32,
            self._steps,
            self._work,
            aligned(self._cold.size),
            drives,
        )
        self.forget()
        if suspect >= 0:
            for points in frames[suspect::stride]:
                check_reachable(self._array, points)
        if singular >= 0:
            raise ValueError(self._too_close)

    @property
    def _too_close(self) -> str:
        return f"mu {self._options.mu} is too small for points as close together as these"

    def _make_room(self, m: int) -> None:
        if m > self._capacity:
            self._work = aligned(kernels.work_size(m, self._columns))
            self._capacity = m
        if m != self._points:
            start = cold_start(m)
            self._cold, self._u = (aligned(2, -(-m // LANES) * LANES) for _ in range(2))
            self._cold[0, :m], self._cold[1, :m] = start.real, start.imag
            self._points, self._warm = m, False
        if self._warm:
            kernels.nudge(self._u, self._cold, NUDGE32)
        else:
            self._u[:] = self._cold
            self._warm = True

    def _model(self, points: ControlPoints) -> None:
        tables = self._tables
        if self._modelled:
            kernel: Callable[..., int] = kernels.model if len(tables.wave) == 1 else kernels.model_by_table
            suspect = kernel(
                tables.elements,
                *tables.wave,
                tables.turns,
                tables.nepers,
                tables.origin,
                tables.low,
                tables.high,
                REACH,
                points.positions,
                points.amplitudes,
                self._work,
            )
            if suspect >= 0:
                check_reachable(self._array, points)
        else:
            check_reachable(self._array, points)
            self._enter(points)

    def _enter(self, points: ControlPoints) -> None:
        """Do what `kernels.model` does, with the transfer matrix from `transfer_matrix`."""
        m, n = len(points), len(self._array)
        parts = kernels.carve(self._work, m, self._columns)
        re, im, reach = parts[0], parts[1], parts[7][0, 0]
        matrix = transfer_matrix(self._array, points.positions, self._medium) / self._tables.strength
        matrix *= self._array.limits > 0
        re[:m, :n], im[:m, :n] = matrix.real, matrix.imag
        re[:m, n:] = im[:m, n:] = 0
        kernels.set_wanted(points.amplitudes, m, self._columns, self._work)
        reach[:n] = (points.amplitudes / points.amplitudes.max()) @ np.abs(matrix)
        reach[n:] = 0

    def _begin(self, m: int) -> None:
        options = self._options
        if options.phase_seconds is None:
            kernels.begin(m, self._columns, self._gamma, options.phase_steps, self._power, self._u, self._work)
            return
        end = perf_counter() + options.phase_seconds
        kernels.begin(m, self._columns, self._gamma, 0, self._power, self._u, self._work)
        for _ in range(options.phase_steps):
            if perf_counter() >= end:
                return
            kernels.more_phases(m, self._columns, 1, self._power, self._u, self._work)


HEADROOM32, RELAXATION32, NUDGE32 = np.float32(HEADROOM), np.float32(RELAXATION), np.float32(NUDGE)


def pressure_at(
    tables: Tables, array: TransducerArray, drive: NDArray[np.complex128], points: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Pressure at (k, 3) points, in pascals; the points are not checked."""
    emitted = aligned(2, tables.elements.shape[1])
    scaled = drive * array.response * array.transducer.polarity
    emitted[0, : len(array)], emitted[1, : len(array)] = scaled.real, scaled.imag
    pressure = np.empty(len(points), dtype=np.complex128)
    kernel: Callable[..., None] = kernels.sum_pressure if len(tables.wave) == 1 else kernels.sum_pressure_by_table
    kernel(
        tables.elements,
        *tables.wave,
        tables.turns,
        tables.nepers,
        tables.origin,
        emitted,
        tables.strength,
        points,
        pressure,
    )
    return pressure


def inside_box(tables: Tables, points: NDArray[np.float64]) -> Iterator[int]:
    """Indices of those (k, 3) points that may be too close to a transducer."""
    index = kernels.first_inside(points, tables.low, tables.high, 0)
    while index >= 0:
        yield index
        index = kernels.first_inside(points, tables.low, tables.high, index + 1)


def compilation() -> dict[str, tuple[int, int]]:
    """How many variants of each kernel were loaded from numba's cache, and how many compiled, in this process."""
    found: dict[str, tuple[int, int]] = {}
    for name, value in vars(kernels).items():
        stats: Any = getattr(value, "stats", None)
        if isinstance(value, Callable) and stats is not None:  # type: ignore[arg-type]
            hits, misses = sum(stats.cache_hits.values()), sum(stats.cache_misses.values())
            if hits or misses:
                found[name] = (hits, misses)
    return found
