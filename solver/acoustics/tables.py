"""From arrays and points to the compiled kernels: the tables that kernels read, and the pressure of a drive.

numba takes half a second to import, so this module is imported at its first use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import prod
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.polynomial.chebyshev import Chebyshev
from numpy.polynomial.polynomial import Polynomial
from numpy.typing import NDArray

from ..compiled import layout, propagation, updates
from ..compiled.simd import LANES
from ..compiled.threads import THREADS, share
from ..geometry import frozen
from .array import TransducerArray
from .diffraction import KERNELS, REFERENCE_DISTANCE
from .medium import Medium
from .models import residual
from .residual_table import ResidualTable

if TYPE_CHECKING:
    from jax import Device

__all__ = [
    "aligned",
    "arrivals_at",
    "can_reach",
    "compilation",
    "farthest_of",
    "pressure_at",
    "surely_reachable",
    "tables_of",
    "too_close",
]

MEDIA = 8  # in which the tables of an array are kept at the same time
POLYNOMIAL_ERROR = 2e-6
SHARED_PAIRS = 50_000_000  # of points and transducers from which on threads share a field, 30 ms for one of them
MAX_TURNS = 500  # wavelengths on the way, beyond which single precision makes more than 2e-4 of the phase
ROWS_PER_KA2 = 8  # of a table in sin²θ, per (k·radius)²: linear interpolation is then within 3e-5


class ArrayTables(NamedTuple):
    """An array in its medium as kernels read it, coordinates relative to ``origin``, pressure to ``strength``.

    ``wave`` is what the kernels need to know of the transducer's model: the coefficients of its directivity in sin²θ,
    or else a table of its residual, from which distance that holds, and the powers before it. ``bounds`` are the
    corners of a box outside which no transducer is too close, and the place and direction of one that can sound.
    """

    elements: NDArray[np.float32]
    wave: tuple[NDArray[np.float32]] | tuple[NDArray[np.float32], np.float32, int, np.float32]
    turns: np.float32
    nepers: np.float32 | None
    origin: NDArray[np.float64]
    bounds: NDArray[np.float64]
    strength: float


_kept: WeakKeyDictionary[TransducerArray, dict[Medium, ArrayTables]] = WeakKeyDictionary()
_bounds: WeakKeyDictionary[TransducerArray, NDArray[np.float64]] = WeakKeyDictionary()


def tables_of(array: TransducerArray, medium: Medium) -> ArrayTables:
    """Tables of an array, kept as long as the array is, in a few media."""
    kept = _kept.setdefault(array, {})
    if (found := kept.get(medium)) is None:
        if len(kept) >= MEDIA:
            kept.clear()
        found = kept[medium] = _make_tables(array, medium)
    return found


def _make_tables(array: TransducerArray, medium: Medium) -> ArrayTables:
    n, transducer = len(array), array.transducer
    low, high = array.positions.min(axis=0), array.positions.max(axis=0)
    origin = (low + high) / 2
    able = array.able
    elements = aligned(layout.ELEMENT_ROWS, -(-n // LANES) * LANES)
    elements[layout.X : layout.Z + 1, :n] = (array.positions - origin).T
    elements[layout.NX : layout.NZ + 1, :n] = array.normals.T
    elements[layout.GAIN, :n] = np.where(able, np.abs(array.response), 0)
    elements[layout.LEAD, :n] = np.angle(array.response * transducer.polarity) / (2 * np.pi)
    elements[layout.LIMIT, :n] = np.where(able, array.limits, 0)
    return ArrayTables(
        frozen(elements),
        _wave_of(array, medium),
        np.float32(1 / medium.wavelength),
        np.float32(medium.attenuation) if medium.attenuation else None,
        origin,
        _bounds_of(array),
        transducer.strength,
    )


def _bounds_of(array: TransducerArray) -> NDArray[np.float64]:
    """(4, 3): see `ArrayTables`."""
    low, high, nearest = array.positions.min(axis=0), array.positions.max(axis=0), array.transducer.nearest
    one = int(np.argmax(array.able))
    return np.stack([low - nearest, high + nearest, array.positions[one], array.normals[one]])


def can_reach(tables: ArrayTables, farthest: float) -> bool:
    """Whether the kernels are exact enough up to a distance in metres, and not nearly all is absorbed on the way."""
    absorbed = 0.0 if tables.nepers is None else float(tables.nepers) * farthest
    return absorbed <= propagation.MAX_NEPERS and float(tables.turns) * farthest <= MAX_TURNS


def farthest_of(tables: ArrayTables, points: NDArray[np.float64]) -> float:
    """A distance in metres that none of (k, 3) points exceeds from any transducer."""
    low, high = tables.bounds[:2]
    return float(np.linalg.norm(np.maximum(points.max() - low, high - points.min())))


def _wave_of(
    array: TransducerArray, medium: Medium
) -> tuple[NDArray[np.float32]] | tuple[NDArray[np.float32], np.float32, int, np.float32]:
    """The `ArrayTables.wave` of a transducer: a polynomial if one of the kernels' degree is good enough."""
    transducer = array.transducer
    if transducer.model in KERNELS:
        table = ResidualTable.of(transducer, medium, transducer.nearest)
        growth = REFERENCE_DISTANCE**-0.5 if table.kernel.growth else 0.0
        return _pairs(table.values), np.float32(table.nearest), table.kernel.cosine, np.float32(growth)

    def directivity(sine_squared: NDArray[np.float64]) -> NDArray[np.float64]:
        return residual(transducer, np.sqrt(np.clip(sine_squared, 0, 1)), 1.0, medium).real

    fitted = Chebyshev.interpolate(directivity, propagation.DIRECTIVITY_TERMS - 1, domain=[0, 1])
    between = np.linspace(0, 1, 200)
    if np.abs(fitted(between) - directivity(between)).max() <= POLYNOMIAL_ERROR:
        coefficients = np.zeros(propagation.DIRECTIVITY_TERMS, dtype=np.float32)
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
    """Zeros whose memory is aligned to a vector register."""
    size = prod(shape)
    room = np.zeros(size + LANES, dtype=np.float32)
    first = -room.ctypes.data % (4 * LANES) // 4
    return room[first : first + size].reshape(shape)


def pressure_at(
    tables: ArrayTables,
    array: TransducerArray,
    drive: NDArray[np.complex128],
    points: NDArray[np.float64],
    device: Device | None = None,
) -> NDArray[np.complex128]:
    """Pressure at (k, 3) points, in pascals, by a device of JAX or by the kernels; the points are not checked."""
    scaled = drive * array.response * array.transducer.polarity
    if device is not None:
        from ..accelerated.propagation import WaveTables, sum_pressure  # an extra

        return tables.strength * sum_pressure(device, WaveTables(*tables[:4]), scaled, points - tables.origin)
    emitted = aligned(2, tables.elements.shape[1])
    emitted[0, : len(array)], emitted[1, : len(array)] = scaled.real, scaled.imag
    pressure = np.empty(len(points), dtype=np.complex128)
    kernel: Callable[..., None] = (
        propagation.sum_pressure if len(tables.wave) == 1 else propagation.sum_pressure_by_table
    )
    threads = THREADS if len(points) * len(array) >= SHARED_PAIRS else 1
    block = propagation.POINTS
    each = -(-len(points) // (threads * block)) * block  # whole blocks: their bits stay the same

    def work(thread: int) -> None:
        part = slice(thread * each, (thread + 1) * each)
        kernel(
            tables.elements,
            *tables.wave,
            turns=tables.turns,
            nepers=tables.nepers,
            origin=tables.origin,
            drive=emitted,
            scale=tables.strength,
            points=points[part],
            pressure=pressure[part],
        )

    share(work, threads)
    return pressure


def arrivals_at(tables: ArrayTables, array: TransducerArray, points: NDArray[np.float64]) -> NDArray[np.complex64]:
    """Each transducer's wave (m, n) at unchecked points (m, 3) per unit drive in pascals, its path's phase left out.

    It is P₁·polarity·response·residual·e^{−αr}/r: `transfer_matrix` without e^{ikr}.
    """
    re, im = np.empty((2, len(points), tables.elements.shape[1]), dtype=np.float32)
    kernel: Callable[..., None] = propagation.transfer if len(tables.wave) == 1 else propagation.transfer_by_table
    wanted, reach = np.zeros(len(points), dtype=np.float32), aligned(tables.elements.shape[1])
    kernel(
        tables.elements,
        *tables.wave,
        turns=type(tables.turns)(0),
        nepers=tables.nepers,
        points=points,
        origin=tables.origin,
        wanted=wanted,
        re=re,
        im=im,
        reach=reach,
    )
    arrivals = np.empty((len(points), len(array)), dtype=np.complex64)
    arrivals.real, arrivals.imag = re[:, : len(array)], im[:, : len(array)]
    return np.multiply(arrivals, np.float32(tables.strength), out=arrivals)


def surely_reachable(array: TransducerArray, points: NDArray[np.float64], reach: float) -> bool:
    """Whether none of (m, 3) points, up to ``reach`` metres away, needs a closer look by `points.check_reachable`."""
    if (bounds := _bounds.get(array)) is None:
        bounds = _bounds[array] = _bounds_of(array)
    return propagation.suspect(points, bounds, reach) < 0


def too_close(array: TransducerArray, tables: ArrayTables, points: NDArray[np.float64]) -> Iterator[int]:
    """Indices of those (k, 3) points that may be nearer to a transducer than its model allows."""
    index = -1
    while True:
        index = propagation.first_too_close(
            tables.elements, len(array), tables.origin, tables.bounds, array.transducer.nearest, points, index + 1
        )
        if index < 0:
            return
        yield index


def compilation() -> dict[str, tuple[int, int]]:
    """How many variants of each kernel were loaded from numba's cache, and how many compiled, in this process."""
    found: dict[str, tuple[int, int]] = {}
    for name, value in (vars(propagation) | vars(updates)).items():
        stats: Any = getattr(value, "stats", None)
        if callable(value) and stats is not None:
            hits, misses = sum(stats.cache_hits.values()), sum(stats.cache_misses.values())
            if hits or misses:
                found[name] = (hits, misses)
    return found
