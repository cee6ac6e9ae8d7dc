"""Images of the field on movable planes, and the pressure at one place.

A horizontal plane over a flat, regular array is a convolution (`PlanePropagator`); any other is a direct sum in single
precision.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..solver import QUANTITIES, Grid, Medium, PlanePropagator, intensity, pressure, sample_cut
from ..solver.fields.quantities import sound_pressure_level
from .settings import Settings
from .snapshot import Emitter, Snapshot

__all__ = ["IMAGE_QUANTITIES", "PLANES", "Painted", "Painter", "Probed"]

PLANES = ("xy", "xz", "yz")
EXTENT = 0.21
"""Side of a plane in metres: 101 samples and more."""
STEP, PER_PITCH = 2e-3, 5
ABOVE = 0.15
"""Metres from the array to the middle of an upright plane, `UPRIGHT` high: the far-field model needs distance."""
UPRIGHT = 0.2
MOST_PLANES = 16
"""That are kept ready; one takes some milliseconds to prepare."""
RECENT_FRAMES = 60
LEVELS = 255
TURN = 2 * np.pi
MANTISSAS = (1, 1.5, 2, 3, 5, 7, 10)

Complex = NDArray[Any]


class ImageQuantity(NamedTuple):
    """What an image shows of the fields that alternate: (k, …) complex pressure in Pa to (…) float."""

    label: str
    unit: str
    of: Callable[[Complex, Medium], NDArray[np.floating]]
    cyclic: bool = False
    fields: int = 1
    """How many fields it needs."""


def _over_fields(name: str, reduce: Callable[..., NDArray[np.floating]]) -> ImageQuantity:
    """A quantity of the solver, reduced over the fields that alternate."""
    quantity = QUANTITIES[name]
    return ImageQuantity(quantity.name, quantity.unit, lambda p, air: reduce(quantity.of(p, air), axis=0))


def _change(p: Complex, air: Medium) -> NDArray[np.floating]:
    """Amplitude of the strongest harmonic of an intensity in equal steps; of two steps 2/π of their difference."""
    steps = len(p)
    harmonics = np.fft.rfft(intensity(p, air), axis=0)[1:]
    smooth = np.sinc(np.arange(1, len(harmonics) + 1) / steps) * 2 / steps
    return np.asarray(np.max(np.abs(harmonics) * smooth.reshape(-1, *[1] * (p.ndim - 1)), axis=0))


IMAGE_QUANTITIES = {
    "pressure": _over_fields("pressure", np.max),
    "intensity": _over_fields("intensity", np.mean),
    "radiation": _over_fields("radiation", np.mean),
    "felt": ImageQuantity("Change of intensity at its strongest frequency", "W/m² (amplitude)", _change, fields=2),
    "phase": ImageQuantity("Phase", "°", lambda p, _: np.angle(p[0]) % TURN, cyclic=True),
}
"""What an image can show. Pressure is that of the strongest field, intensities are means over all that alternate."""


@dataclass(frozen=True, eq=False)
class Painted:
    """An image of a plane, one of `PLANES`.

    ``corner`` is the place of sample (0, 0) in metres, and ``u`` and ``v`` are the way to the last one of its row and
    of its column. ``levels`` (rows, columns) are uint8.
    """

    name: str
    corner: NDArray[np.float64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    levels: NDArray[np.uint8]


class Probed(NamedTuple):
    """The pressure at a place, in each of the fields that alternate."""

    at: tuple[float, float, float]
    pascals: list[float]
    decibels: list[float]
    degrees: list[float]


class Painter:
    """Paints snapshots of one array, in its air."""

    def __init__(self, emitter: Emitter) -> None:
        self._array, self._air = emitter.emitting, emitter.medium
        self._centre = emitter.array.positions.mean(axis=0)
        self._fields: OrderedDict[tuple[str, float], tuple[Grid, Callable[[Complex], Complex]]] = OrderedDict()
        self._recent: deque[float] = deque(maxlen=RECENT_FRAMES)
        self._shown = ""

    def paint(
        self, snapshot: Snapshot, settings: Settings, beside: tuple[Complex, ...] = ()
    ) -> tuple[list[Painted], dict[str, Any]]:
        """Images of the planes that are on, and their common scale, for the page.

        ``beside`` are other drives, (k, n) each; their horizontal planes are added as the last images. `ValueError` if
        a plane is too close to a transducer.
        """
        quantity = IMAGE_QUANTITIES[settings.quantity]
        wanted = [(name, snapshot.drives) for name in PLANES if getattr(settings, name)]
        wanted += [("xy", drives) for drives in beside]
        images = [
            (name, *self._values(name, getattr(settings, f"{name}_at"), drives, quantity)) for name, drives in wanted
        ]
        largest = (
            TURN if quantity.cyclic else settings.scale or self._automatic(settings.quantity, [v for *_, v in images])
        )
        painted = [
            Painted(name, *_frame(grid), _levels(values, largest, quantity.cyclic)) for name, grid, values in images
        ]
        return painted, {
            "label": quantity.label,
            "unit": quantity.unit,
            "largest": 360.0 if quantity.cyclic else largest,
            "cyclic": quantity.cyclic,
        }

    def probe(self, snapshot: Snapshot, place: tuple[float, float, float]) -> Probed:
        """The pressure at a place; `ValueError` if it is too close to a transducer."""
        at = np.array([place])
        values = np.array([pressure(self._array, drive, at, self._air)[0] for drive in snapshot.drives])
        levels = np.maximum(sound_pressure_level(values), -999.0)  # of silence it is -inf, which JSON lacks
        return Probed(place, np.abs(values).tolist(), levels.tolist(), (np.rad2deg(np.angle(values)) % 360).tolist())

    def at_points(self, drives: Complex, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """|p| at control points in Pa, (m,), of the stronger of the fields that alternate."""
        fields = [np.abs(pressure(self._array, drive, points, self._air)) for drive in drives]
        return np.asarray(np.max(fields, axis=0))

    def _values(
        self, name: str, at: float, drives: Complex, quantity: ImageQuantity
    ) -> tuple[Grid, NDArray[np.floating]]:
        grid, field = self._field(name, at)
        if quantity.cyclic:
            drives = drives[:1]
        fields = np.stack([field(drive) for drive in drives])
        if len(fields) < quantity.fields:
            return grid, np.zeros(grid.shape)
        return grid, quantity.of(fields, self._air)

    def _field(self, name: str, at: float) -> tuple[Grid, Callable[[Complex], Complex]]:
        """A plane, and the function from a drive to its field; prepared once."""
        key = name, round(at, 4)
        if key not in self._fields:
            self._fields[key] = self._prepared(name, at)
            if len(self._fields) > MOST_PLANES:
                self._fields.popitem(last=False)
        self._fields.move_to_end(key)
        return self._fields[key]

    def _prepared(self, name: str, at: float) -> tuple[Grid, Callable[[Complex], Complex]]:
        array, air = self._array, self._air
        if name == "xy":
            try:
                propagator = PlanePropagator(array, at, EXTENT, PER_PITCH, air)
            except ValueError:  # an array that is not flat or not regular; a plane that is too close fails again below
                grid = Grid.along("xy", (self._centre[0], self._centre[1], at), EXTENT, STEP)
            else:
                return propagator.grid, lambda drive: propagator(drive).pressure
        else:
            x, y = (self._centre[0], at) if name == "xz" else (at, self._centre[1])
            grid = Grid.along(name, (x, y, self._centre[2] + ABOVE), (EXTENT, UPRIGHT), STEP)
        return grid, lambda drive: sample_cut(array, drive, grid, air).pressure

    def _automatic(self, quantity: str, images: list[NDArray[np.floating]]) -> float:
        """The end of the scale: a round number that no recent frame exceeds."""
        if quantity != self._shown:
            self._shown = quantity
            self._recent.clear()
        self._recent.append(max((float(values.max()) for values in images), default=0.0))
        return _round_up(max(self._recent))


def _round_up(value: float) -> float:
    """The next round number."""
    if value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(mantissa for mantissa in MANTISSAS if mantissa * power >= value * (1 - 1e-9)) * power)


def _levels(values: NDArray[np.floating], largest: float, cyclic: bool) -> NDArray[np.uint8]:
    if cyclic:
        return np.asarray(values * ((LEVELS + 1) / TURN), np.int64).astype(np.uint8)  # a full turn is 0 again
    return np.asarray(np.minimum(values * (LEVELS / largest), LEVELS), np.uint8)


def _frame(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Place of sample (0, 0), and the ways along a row and along a column to the last one."""
    offsets = [grid.offsets(axis) for axis in range(2)]
    u, v = ((offset[-1] - offset[0]) * axis for offset, axis in zip(offsets, grid.axes, strict=True))
    return grid.centre + offsets[0][0] * grid.axes[0] + offsets[1][0] * grid.axes[1], u, v
