"""Fields: complex pressure sampled over planes and volumes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import instance_of
from ...base.pictures import Drawable
from ..accelerated.devices import Backend, check_backend, device_for
from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium, as_medium
from ..acoustics.propagation import as_drive, pressure
from ..geometry import frozen
from ..methods.solve import Wanted
from .drawing import OIL, draw_oil, draw_plane
from .grid import Grid
from .lattice import OFF_GRID, Lattice, lattice_of, shifts_over, spectrum_size
from .quantities import check_pressure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Field", "PlaneField", "VolumeField", "sample_cut", "sample_plane", "sample_volume"]

MAX_PAIRS = 2_000_000_000  # of samples and transducers, for the direct sum
MAX_SPECTRUM = 16_000_000  # numbers of a plane's spectrum, for the FFT: some 400 MB with all that is made on the way
NAMED = (0.0, 0.0, 0.15), 0.2, 1e-3
"""Middle, sides and step in metres of a plane that is known by the name of its axes."""
PAIRS_PER_SAMPLE = 90
"""Pairs of the direct sum that take as long as a number of the spectrum, which is made for one drive: half a nanosecond
each against 25 to 60; measured by ``benchmarks/scaling.py``."""


@dataclass(frozen=True, eq=False)
class Field:
    """Pressure over a grid.

    Parameters
    ----------
    grid : Grid
        The places of the samples.
    pressure : (...) complex
        Peak pressure in Pa, of the grid's shape.
    medium : Medium
        The air.

    Raises
    ------
    ValueError
        If the pressure does not have the grid's shape, or the grid is of another kind than the field.
    """

    grid: Grid
    pressure: NDArray[np.complex128]
    medium: Medium

    def __post_init__(self) -> None:
        """Check the shape and the values."""
        instance_of(self.pressure, np.ndarray, "pressure", "complex, in Pa")
        check_pressure(self.pressure)
        if self.pressure.shape != self.grid.shape:
            raise ValueError(f"pressure has the shape {self.pressure.shape}, but the grid has {self.grid.shape}")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.grid}, up to {self.strongest()[0]:.0f} Pa)"

    @property
    def x(self) -> NDArray[np.float64]:
        """Coordinates of the samples along x, in metres; `ValueError` if no axis of the grid is along x."""
        return self._along("x")

    @property
    def y(self) -> NDArray[np.float64]:
        """Coordinates of the samples along y, as `x`."""
        return self._along("y")

    @property
    def z(self) -> NDArray[np.float64]:
        """Coordinates of the samples along z, as `x`."""
        return self._along("z")

    def _along(self, letter: str) -> NDArray[np.float64]:
        for axis in range(len(self.grid.axes)):
            name, values = self.grid.coordinates(axis)
            if name == letter:
                return values
        raise ValueError(f"no axis of this {self.grid.kind} is along {letter}; its axes are {self.grid.axes.tolist()}")

    def strongest(self) -> tuple[float, NDArray[np.float64]]:
        """The largest |p| in Pa (peak), and its place, (3,) in metres."""
        magnitude = np.abs(self.pressure)
        index = np.unravel_index(int(magnitude.argmax()), magnitude.shape)
        offsets = [self.grid.offsets(axis)[at] for axis, at in enumerate(index[::-1])]
        return float(magnitude[index]), self.grid.centre + offsets @ self.grid.axes


@dataclass(frozen=True, eq=False, repr=False)
class PlaneField(Field, Drawable):
    """Pressure over a plane, (rows, columns) complex: rows along the plane's second axis, columns along its first."""

    def plot(
        self,
        ax: Axes | None = None,
        *,
        points: Wanted | None = None,
        quantity: str = "pressure",
        largest: float | None = None,
        **style: Any,
    ) -> Axes:
        """Draw it; the colour bar has the quantity's unit and, if there is room, dB relative to its end.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Axes to draw onto; by default those of a new figure of pyplot.
        points : ControlPoints, Shape or (m, 3) float, optional
            Those in the plane are marked.
        quantity : str
            A key of `QUANTITIES`, or ``oil``: the surface of oil that the field pushes down, in a horizontal plane.
        largest : float, optional
            End of the colour bar, in the quantity's unit: the same for pictures to be compared. By default the largest
            sample.
        **style
            A ``title``, and options of matplotlib's ``imshow``, such as ``cmap``.

        Raises
        ------
        ValueError
            If the quantity is unknown.
        """
        if quantity == OIL:
            return draw_oil(ax, self, points, **style)
        return draw_plane(ax, self, points, quantity, largest, **style)

    def __post_init__(self) -> None:
        """Check the shape."""
        _check_kind(self.grid, "plane")
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class VolumeField(Field, Drawable):
    """Pressure over a box, (layers, rows, columns) complex: layers along its third axis, columns along its first."""

    def strongest_plane(self) -> PlaneField:
        """The layer with the largest |p|."""
        layer = int(np.abs(self.pressure).max(axis=(1, 2)).argmax())
        centre = self.grid.centre + self.grid.offsets(2)[layer] * self.grid.axes[2]
        grid = Grid(centre, self.grid.axes[:2], self.grid.counts[:2], self.grid.step)
        return PlaneField(grid, self.pressure[layer], self.medium)

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw its `strongest_plane`; parameters and errors are those of `PlaneField.plot`."""
        return self.strongest_plane().plot(ax, **options)

    def __post_init__(self) -> None:
        """Check the shape."""
        _check_kind(self.grid, "box")
        super().__post_init__()


def sample_plane(
    array: TransducerArray,
    drive: ArrayLike,
    height: float,
    extent: float = 0.2,
    step: float = 1e-3,
    medium: Medium | None = None,
    backend: Backend = "cpu",
) -> PlaneField:
    """Pressure over a horizontal square centred above the array.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    drive : (n,) complex
        Drives.
    height : float
        Height of the plane, in metres.
    extent : float
        Side of the square, in metres, rounded down to an even number of steps so that one sample is in the middle.
    step : float
        Distance between samples, in metres.
    medium : Medium, optional
        The air; 20 °C by default.
    backend : {"cpu", "cuda"}
        What computes, as for `pressure`, in single precision.

    Raises
    ------
    ValueError
        If a number is out of range, or there are too many samples.

    Notes
    -----
    A flat array on a square grid whose pitch is a multiple of the step has an FFT instead of the direct sum, if there
    are so many samples and transducers that it is faster; `sample_cut` and `sample_volume` use it, too.
    """
    return sample_cut(array, drive, Grid.horizontal(height, extent, step), medium, backend)


def sample_cut(
    array: TransducerArray, drive: ArrayLike, grid: Grid | str, medium: Medium | None = None, backend: Backend = "cpu"
) -> PlaneField:
    """Pressure over any plane, such as ``Grid.along("xz", (0, 0, 0.2), 0.2, 1e-3)``, a vertical one.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    drive : (n,) complex
        Drives.
    grid : Grid or str
        A plane; by the name of its axes, such as ``"xz"``, one of 0.2 m by 0.2 m around (0, 0, 0.15) in steps of 1 mm.
    medium : Medium, optional
        The air; 20 °C by default.
    backend : {"cpu", "cuda"}
        What computes, as for `pressure`, in single precision.

    Raises
    ------
    ValueError
        If the grid is no plane, a sample is too close to a transducer, or there are too many samples.
    """
    if isinstance(grid, str):
        grid = Grid.along(grid, *NAMED)
    _check_kind(grid, "plane")
    medium = as_medium(medium)
    return PlaneField(grid, _sample(array, drive, grid, medium, backend), medium)


def sample_volume(
    array: TransducerArray, drive: ArrayLike, grid: Grid, medium: Medium | None = None, backend: Backend = "cpu"
) -> VolumeField:
    """Pressure over a box, such as ``Grid.along("xyz", (0, 0, 0.2), 0.1, 2e-3)``; otherwise as `sample_cut`."""
    _check_kind(grid, "box")
    medium = as_medium(medium)
    return VolumeField(grid, _sample(array, drive, grid, medium, backend), medium)


def _check_kind(grid: Grid, kind: str) -> None:
    instance_of(grid, Grid, "grid", 'such as Grid.along("xz", (0, 0, 0.15), 0.2, 1e-3)')
    if grid.kind != kind:
        raise ValueError(f"the grid is a {grid.kind}, with {len(grid.axes)} axes; it must be a {kind}")


def _sample(
    array: TransducerArray, drive: ArrayLike, grid: Grid, medium: Medium, backend: Backend
) -> NDArray[np.complex128]:
    """Pressure at every sample, by FFT if that is possible and faster; within 2e-4 of the strongest either way.

    A GPU sums directly.
    """
    check_backend(backend, "single")
    drive, samples = as_drive(array, drive), math.prod(grid.counts)
    here = device_for(backend, None) is None
    if here and (shifts := _shifts(array, grid, samples)) is not None:
        lattice, heights, per_pitch = shifts
        emitted = drive.astype(np.complex64)
        layers = [shifts_over(lattice, grid, height, per_pitch, medium, "single")(emitted) for height in heights]
        return frozen(np.reshape(layers, grid.shape).astype(np.complex128))
    if samples * len(array) > MAX_PAIRS:
        more = (
            ", unless the array is flat and on a square grid, the plane is parallel to it, and the pitch is a multiple "
            "of the step"
        )
        raise ValueError(
            f"{samples} samples with {len(array)} transducers are too many; at most {MAX_PAIRS} pairs"
            + (more if here else "; backend 'cpu' may have an FFT for more")
        )
    values = pressure(array, drive, grid.positions().reshape(-1, 3), medium, "single", "cpu" if here else backend)
    return frozen(values.reshape(grid.shape))


def _shifts(array: TransducerArray, grid: Grid, samples: int) -> tuple[Lattice, list[float], int] | None:
    """The array's lattice, the heights of the layers, and samples per pitch; None if the direct sum is the way."""
    heights = grid.centre[2] + (grid.offsets(2) if grid.kind == "box" else np.zeros(1))
    upright = np.array_equal(grid.axes, np.eye(3)[: len(grid.axes)])
    if not upright or np.abs(heights - array.positions[0, 2]).min() < array.transducer.nearest:
        return None
    try:
        lattice = lattice_of(array)
    except ValueError:
        return None
    per_pitch = round(lattice.pitch / grid.step)
    if abs(lattice.pitch - per_pitch * grid.step) * max(lattice.counts) > OFF_GRID:
        return None
    size = math.prod(spectrum_size(lattice, grid.counts, per_pitch)) * per_pitch**2
    if size > MAX_SPECTRUM or size * len(heights) * PAIRS_PER_SAMPLE > samples * len(array):
        return None
    return lattice, heights.tolist(), per_pitch
