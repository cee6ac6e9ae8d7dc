"""What became of the control points: how strong, sharp and well placed each focus is, and what else is there.

A focus' *neighbourhood* is the region in which the array, if it focused on that point alone, would keep at least half
the pressure (−6 dB), to second order: with weights |a_q|² and directions û_q from the transducers to the point, the
field at a small distance δ is Σ|a_q|²·e^{ik·û_q·δ}, so the neighbourhood is the ellipsoid k²·δᵀCδ ≤ 2·ln 2, where C is
the weighted covariance of the directions; it ends 10 cm from the point at the latest. A local maximum outside every
neighbourhood is a lobe.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.pictures import Drawable, axes_or_new
from ..acoustics.array import TransducerArray, check_array
from ..acoustics.medium import Medium, as_medium
from ..acoustics.propagation import pressure, transfer_matrix
from ..geometry import counted, place
from ..methods.solve import Wanted, control_points
from ..shapes.points import ControlPoints, check_reachable
from .field import MAX_PAIRS, PlaneField, VolumeField, sample_cut, sample_volume
from .grid import MAX_SAMPLES, Grid
from .quantities import relative_level

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["GHOST", "MISSING", "Focus", "FocusReport", "Lobe", "Null", "focus_report"]

MISSING = 0.5
"""A point is missing if |p| is at most this part of its share, the mean over the points by wanted amplitudes."""

GHOST = 0.5
"""A lobe is a ghost if |p| is above this part of the mean over the points that should be strong."""

FAINT = 1e-6
"""A point of at most this part of the largest amplitude is taken for a null."""

HALF = 0.5  # −6 dB
DEEPEST = -200.0  # dB; JSON has no −∞
SEARCH_MARGIN = 0.02  # metres around points and array
SAMPLES_PER_WAVELENGTH = 5
COARSEST = 4  # samples per wavelength
BETWEEN = 0.8  # of a lobe's height is what the sample nearest to it has at least
MAX_SEARCHED = 40_000_000  # samples: some ten seconds
LONGEST = 0.1  # metres: half of a neighbourhood, if few transducers make a wide one
PATCH, ZOOMS = 9, 4  # samples along a side, and how often it shrinks to a quarter: to 1/256 of a neighbourhood
LINE, REACH = 64, 4.0  # samples along a line from a peak, and its length in neighbourhoods

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Focus:
    """What became of a point that should be strong.

    Parameters
    ----------
    index : int
        Index of the control point.
    position : (3,) float
        Place of the control point, in metres.
    amplitude : float
        Wanted, relative to the other points.
    pressure : float
        |p| at the point, in Pa (peak).
    peak : float
        Largest |p| at the point's height within its neighbourhood, in Pa (peak).
    offset : (3,) float
        Vector from the point to that peak, in metres.
    width : (3,) float or None
        Through the peak along x, y and z: the distance in metres within which |p| is at least half the peak; None if
        it does not fall below that within four neighbourhoods, as between foci that touch.
    missing : bool
        Whether |p| at the point is at most `MISSING` of its share.
    """

    index: int
    position: Vector
    amplitude: float
    pressure: float
    peak: float
    offset: Vector
    width: tuple[float | None, float | None, float | None]
    missing: bool

    def __repr__(self) -> str:
        return f"Focus({self.index} at {place(self.position)}, {self.pressure:.0f} Pa)"


@dataclass(frozen=True)
class Null:
    """What became of a point of amplitude 0: |p| there in Pa (peak), and in dB relative to the foci's mean."""

    index: int
    position: Vector
    pressure: float
    level: float

    def __repr__(self) -> str:
        return f"Null({self.index} at {place(self.position)}, {self.pressure:.0f} Pa, {self.level:.1f} dB)"


@dataclass(frozen=True)
class Lobe:
    """A local maximum that was not wanted: its place, |p| in Pa (peak), and in dB relative to the foci's mean."""

    position: Vector
    pressure: float
    level: float

    def __repr__(self) -> str:
        return f"Lobe(at {place(self.position)}, {self.pressure:.0f} Pa, {self.level:.1f} dB)"


@dataclass(frozen=True)
class FocusReport(Drawable):
    """What became of all points.

    Parameters
    ----------
    foci : tuple of Focus
        The points that should be strong.
    nulls : tuple of Null
        The points of amplitude 0.
    mean : float
        Mean |p| at the points that should be strong, in Pa (peak).
    strongest_lobe : Lobe or None
        The strongest local maximum outside every focus' neighbourhood, within what was searched.
    ghosts : tuple of Lobe
        All such maxima above `GHOST` of the mean, the strongest first.
    searched : str
        The region in which lobes were looked for.
    """

    foci: tuple[Focus, ...]
    nulls: tuple[Null, ...]
    mean: float
    strongest_lobe: Lobe | None
    ghosts: tuple[Lobe, ...]
    searched: str

    def __repr__(self) -> str:
        found = f"{len(self.missing)} missing, {counted(len(self.ghosts), 'ghost')}"
        return f"FocusReport({self._count} of {self.mean:.0f} Pa, spread {self.spread:.1%}, {found})"

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw |p| at each point, relative to its wanted amplitude, and the mean.

        ``style`` is a ``title``, and options of matplotlib's ``bar``.
        """
        axes, title = axes_or_new(ax), style.pop("title", f"{self._count}, spread {self.spread:.1%}")
        for label, colour, foci in (
            ("present", "C0", [focus for focus in self.foci if not focus.missing]),
            ("missing", "C3", self.missing),
        ):
            if foci:
                relative = [focus.pressure / focus.amplitude for focus in foci]
                axes.bar([focus.index for focus in foci], relative, **dict[str, Any](color=colour, label=label) | style)
        axes.axhline(self.mean, color="0.3", linestyle="--", linewidth=1, label="mean |p|")
        axes.set(title=title, xlabel="control point", ylabel="|p| / amplitude / Pa")
        axes.locator_params(axis="x", integer=True)
        axes.legend(loc="lower right")
        return axes

    @property
    def _count(self) -> str:
        return "1 focus" if len(self.foci) == 1 else f"{len(self.foci)} foci"

    @property
    def missing(self) -> tuple[Focus, ...]:
        """The points that are missing."""
        return tuple(focus for focus in self.foci if focus.missing)

    @property
    def spread(self) -> float:
        """Standard deviation of |p| over the foci, each relative to its wanted amplitude, over their mean."""
        relative = np.array([focus.pressure / focus.amplitude for focus in self.foci])
        return float(relative.std() / relative.mean()) if relative.any() else 0.0

    def summary(self) -> str:
        """A few lines for people."""
        worst = max(math.hypot(*focus.offset) for focus in self.foci)
        lines = [
            f"{self._count}: {self.mean:.0f} Pa (peak) in the mean, spread {self.spread:.1%}, "
            f"at most {worst * 1e3:.1f} mm off their points"
        ]
        widths = [[focus.width[axis] for focus in self.foci] for axis in range(3)]
        known = [[width for width in along if width is not None] for along in widths]
        lines.append(
            "−6 dB widths, median: "
            + ", ".join(
                f"{axis} {np.median(along) * 1e3:.1f} mm" if along else f"{axis} unknown"
                for axis, along in zip("xyz", known, strict=True)
            )
        )
        lines.append(f"missing: {', '.join(str(focus.index) for focus in self.missing) or 'none'}")
        lobe = self.strongest_lobe
        where = "none" if lobe is None else f"{lobe.level:.1f} dB at {_millimetres(lobe.position)}"
        lines.append(f"strongest lobe beside them: {where}; ghosts: {len(self.ghosts)} (searched: {self.searched})")
        if self.nulls:
            levels = [null.level for null in self.nulls]
            lines.append(
                f"{counted(len(levels), 'null')}: {min(levels):.1f} to {max(levels):.1f} dB relative to the foci"
            )
        return "\n".join(lines)

    def record(self) -> dict[str, Any]:
        """Everything as numbers, for JSON; lengths in metres, pressures in Pa (peak), levels in dB."""
        return dataclasses.asdict(self) | {
            "missing": [focus.index for focus in self.missing],
            "spread": self.spread,
            "thresholds": {"missing": MISSING, "ghost": GHOST},
        }


def focus_report(
    array: TransducerArray, drive: ArrayLike, points: Wanted, medium: Medium | None = None, grid: Grid | None = None
) -> FocusReport:
    """See what a drive makes of control points.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    drive : (n,) complex
        Drives.
    points : ControlPoints, Shape or (m, 3) float
        What was wanted, as for `Solver.solve`.
    medium : Medium, optional
        The air; 20 °C by default.
    grid : Grid, optional
        The plane or box in which lobes are looked for, with a step of at most a quarter wavelength. By default it
        covers the array and the points with a margin of 2 cm: a horizontal plane if all points are at one height, to
        a quarter wavelength, and otherwise a box, looked through layer by layer.

    Raises
    ------
    ValueError
        As `pressure`, or if a point is out of reach, or the grid is too coarse or has too many samples.
    """
    check_array(array)
    medium, points = as_medium(medium), control_points(points)
    check_reachable(array, points)
    relative = points.amplitudes / points.amplitudes.max()
    wanted = np.flatnonzero(relative > FAINT)
    at, amplitudes = points.positions[wanted], relative[wanted]
    shapes = _neighbourhoods(array, at, medium)
    magnitudes = np.abs(pressure(array, drive, points.positions, medium))
    mean = float(magnitudes[wanted].mean())
    share = mean * amplitudes / amplitudes.mean()
    half = 1 / np.sqrt(np.einsum("mii->mi", shapes))
    spans = np.minimum(half[:, :2], _free(array, at)[:, None] / math.sqrt(2))
    offsets, peaks = _climb(array, drive, medium, at, spans[:, :, None] * np.eye(3)[:2], shapes)
    length = np.minimum(REACH * half, _free(array, at + offsets)[:, None])
    widths = _widths(array, drive, medium, at + offsets, peaks, length)
    foci = tuple(
        Focus(
            index=int(index),
            position=_vector(at[row]),
            amplitude=float(amplitudes[row]),
            pressure=float(magnitudes[index]),
            peak=float(peaks[row]),
            offset=_vector(offsets[row]),
            width=widths[row],
            missing=bool(magnitudes[index] <= MISSING * share[row]),
        )
        for row, index in enumerate(wanted)
    )
    nulls = tuple(
        Null(int(index), _vector(points.positions[index]), float(magnitudes[index]), _level(magnitudes[index], mean))
        for index in np.flatnonzero(relative <= FAINT)
    )
    grids = [grid] if grid else _surroundings(array, points, medium)
    lobes = [lobe for part in grids for lobe in _lobes(array, drive, medium, part, at, shapes, mean)]
    lobes.sort(key=lambda lobe: -lobe.pressure)
    strongest = lobes[0] if lobes else None
    ghosts = tuple(lobe for lobe in lobes if lobe.pressure > GHOST * mean)
    return FocusReport(foci, nulls, mean, strongest, ghosts, _described(grids))


def _neighbourhoods(array: TransducerArray, at: NDArray[np.float64], medium: Medium) -> NDArray[np.float64]:
    """Matrices S, (m, 3, 3) in 1/m², of the neighbourhoods δᵀSδ ≤ 1 of the points."""
    weights = np.abs(transfer_matrix(array, at, medium)) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    direction = at[:, None] - array.positions
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    direction -= np.einsum("mn,mnk->mk", weights, direction)[:, None]
    covariance = np.einsum("mn,mnk,mnl->mkl", weights, direction, direction)
    return np.asarray(medium.wavenumber**2 / (2 * math.log(1 / HALF)) * covariance + np.eye(3) / LONGEST**2)


def _free(array: TransducerArray, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far one may go from each point before it is too close to a transducer for the far field, (m,) in metres."""
    nearest = np.array([np.linalg.norm(array.positions - point, axis=1).min() for point in at])
    return np.maximum(nearest - 1.001 * array.transducer.nearest, 0.0)


def _climb(
    array: TransducerArray,
    drive: ArrayLike,
    medium: Medium,
    start: NDArray[np.float64],
    spans: NDArray[np.float64],
    shapes: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Offsets (m, 3) from the start to the largest |p| within ± the spans (m, d, 3) and the shapes, and |p| (m,)."""
    side = np.linspace(-1, 1, PATCH)
    patch = np.stack(np.meshgrid(*[side] * spans.shape[1]), axis=-1).reshape(-1, spans.shape[1])
    best = np.zeros_like(start)
    each = np.arange(len(start))
    for zoom in range(ZOOMS):
        offsets = best[:, None] + np.einsum("pd,mdk->mpk", patch / 4**zoom, spans)
        magnitudes = _magnitudes(array, drive, medium, start[:, None] + offsets)
        inside = np.einsum("mpk,mkl,mpl->mp", offsets, shapes, offsets) <= 1
        chosen = np.where(inside, magnitudes, -1.0).argmax(axis=1)
        best = offsets[each, chosen]
    return best, magnitudes[each, chosen]


def _widths(
    array: TransducerArray,
    drive: ArrayLike,
    medium: Medium,
    peaks: NDArray[np.float64],
    heights: NDArray[np.float64],
    length: NDArray[np.float64],
) -> list[tuple[float | None, float | None, float | None]]:
    """Widths at half the height through peaks (m, 3) along x, y and z, on lines of a length (m, 3), all in metres."""
    part = np.linspace(0, 1, LINE + 1)
    sides = []
    for sign in (-1, 1):
        along = sign * part[:, None, None] * (length[:, None, :, None] * np.eye(3))[:, None]  # (m, 1, samples, axis, 3)
        at = peaks[:, None, None, None] + along
        magnitudes = _magnitudes(array, drive, medium, at).reshape(len(peaks), LINE + 1, 3)
        below = magnitudes < HALF * heights[:, None, None]
        first = np.maximum(below.argmax(axis=1), 1)[:, None]
        before, after = (np.take_along_axis(magnitudes, first - back, axis=1)[:, 0] for back in (1, 0))
        crossing = first[:, 0] - 1 + (before - HALF * heights[:, None]) / np.where(before > after, before - after, 1.0)
        sides.append(np.where(below.any(axis=1), crossing / LINE * length, np.nan))
    total = sides[0] + sides[1]
    return [(_or_none(x), _or_none(y), _or_none(z)) for x, y, z in total.tolist()]


def _magnitudes(
    array: TransducerArray, drive: ArrayLike, medium: Medium, at: NDArray[np.float64]
) -> NDArray[np.float64]:
    """|p| at (..., 3) points, (...) in Pa."""
    return np.abs(pressure(array, drive, at.reshape(-1, 3), medium, precision="single")).reshape(at.shape[:-1])


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


def _surroundings(array: TransducerArray, points: ControlPoints, medium: Medium) -> list[Grid]:
    """The plane or box in which lobes are looked for, a box in slabs that overlap by two samples."""
    everything = np.concatenate([array.positions, points.positions])
    low, high = everything.min(axis=0) - SEARCH_MARGIN, everything.max(axis=0) + SEARCH_MARGIN
    step = medium.wavelength / SAMPLES_PER_WAVELENGTH
    lowest, highest = points.positions[:, 2].min(), points.positions[:, 2].max()
    if highest - lowest <= medium.wavelength / 4:
        low[2] = high[2] = (lowest + highest) / 2
        return [Grid.along("xy", (low + high) / 2, (high - low)[:2].tolist(), step)]
    low[2] = max(lowest - SEARCH_MARGIN, min(array.positions[:, 2].max() + 2 * array.transducer.nearest, lowest))
    high[2] = highest + SEARCH_MARGIN
    counts = (2 * np.floor((high - low) / step / 2) + 1).astype(int)
    if (samples := math.prod(counts.tolist())) > MAX_SEARCHED:
        raise ValueError(f"the points span {samples} samples; at most {MAX_SEARCHED} are searched: give a grid")
    wide, deep, layers = counts.tolist()
    at_once = max(3, min(MAX_SAMPLES, MAX_PAIRS // len(array)) // (wide * deep))
    middle, bottom = (low + high) / 2, (low + high)[2] / 2 - (layers - 1) / 2 * step
    slabs = []
    for first in range(0, max(1, layers - 2), at_once - 2):
        thick = min(at_once, layers - first)
        centre = (*middle[:2], bottom + (first + (thick - 1) / 2) * step)
        slabs.append(Grid(centre, np.eye(3), (wide, deep, thick), step))
    return slabs


def _lobes(
    array: TransducerArray,
    drive: ArrayLike,
    medium: Medium,
    grid: Grid,
    at: NDArray[np.float64],
    shapes: NDArray[np.float64],
    mean: float,
) -> list[Lobe]:
    """The strongest local maximum of the grid outside every neighbourhood, and all that may be ghosts, in order."""
    from scipy.ndimage import maximum_filter  # which takes 0.1 s to import

    coarsest = medium.wavelength / COARSEST
    if grid.step > coarsest * 1.001:
        raise ValueError(f"a step of {grid.step:g} m misses lobes; at most a quarter wavelength, {coarsest:.3g} m")
    sample = sample_volume if grid.kind == "box" else sample_cut
    field: PlaneField | VolumeField = sample(array, drive, grid, medium)
    magnitude = np.abs(field.pressure)
    inner = np.pad(np.ones([max(count - 2, 0) for count in grid.shape], dtype=bool), 1)
    summit = (magnitude == maximum_filter(magnitude, 3)) & inner & (magnitude > 0)
    places, heights = grid.positions()[summit], magnitude[summit]
    outside = np.ones(len(places), dtype=bool)
    for point, shape in zip(at, shapes, strict=True):
        outside &= np.einsum("pk,kl,pl->p", places - point, shape, places - point) > 1
    if not outside.any():
        return []
    places = places[outside & (heights >= BETWEEN * min(GHOST * mean, heights[outside].max()))]
    spans = np.broadcast_to(grid.step * grid.axes, (len(places), *grid.axes.shape))
    offsets, heights = _climb(array, drive, medium, places, spans, np.zeros((len(places), 3, 3)))
    order = np.argsort(-heights)
    return [
        Lobe(_vector(places[lobe] + offsets[lobe]), float(heights[lobe]), _level(heights[lobe], mean)) for lobe in order
    ]


def _level(value: float, reference: float) -> float:
    """Level in dB, at least `DEEPEST`; 0 relative to silence."""
    return max(DEEPEST, float(relative_level(value, reference))) if reference > 0 else 0.0


def _described(grids: list[Grid]) -> str:
    grid, last = grids[0], grids[-1]
    highest = last.centre[2] + (last.counts[-1] - 1) / 2 * last.step if len(grids) > 1 else 0.0
    extents = [(count - 1) * grid.step * 1e3 for count in grid.counts]
    if len(grids) > 1:
        extents[2] = (highest - grid.centre[2]) * 1e3 + extents[2] / 2
    size = " × ".join(f"{extent:.0f}" for extent in extents)
    centre = grid.centre.copy()
    if len(grids) > 1:
        centre[2] = highest - extents[2] / 2e3
    return f"a {grid.kind} of {size} mm around {_millimetres(_vector(centre))}, every {grid.step * 1e3:.2f} mm"


def _millimetres(position: Vector) -> str:
    return f"({', '.join(f'{coordinate * 1e3:.1f}' for coordinate in position)}) mm"


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
