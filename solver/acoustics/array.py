"""The array: the places and directions of the transducers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import WIDEST, array_of, as_drives, instance_of, length, whole
from ...base.pictures import CYCLIC, MM, Drawable, axes_or_new, colour_bar
from ..geometry import Movable, Scalar, as_points, as_position, coincident, counted, extent, frozen
from .transducer import Transducer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["TransducerArray", "check_array"]

COLUMNS, ROWS, PITCH = 20, 16, 10.3e-3  # metres; the default grid
MAX_TRANSDUCERS = 1_000_000
MAX_GAIN = 100.0
LEAST = 1e-6  # gain, or limit, that is not 0
COINCIDENT = 1e-6  # metres: two transducers that are closer are one that was entered twice


@dataclass(frozen=True, eq=False)
class TransducerArray(Movable["TransducerArray"], Drawable):
    """Transducers in space; z is up, away from a flat array.

    Parameters
    ----------
    positions : (n, 3) float
        Centres of the pistons, in metres.
    normals : (n, 3) float, optional
        Unit vectors in the directions in which they look; to +z by default.
    transducer : Transducer, optional
        What each of them is; the MA40S4S by default.
    response : (n,) complex, optional
        What each of them really emits per unit drive, relative to ``transducer``, as calibrated: gain and phase; -1 is
        a flipped polarity, 0 a dead element, which is left out of every solution. All 1 by default.
    limits : (n,) float, optional
        Largest drive of each, from 0 to 1. All 1 by default.

    Raises
    ------
    ValueError
        If shapes differ, a number is not finite or out of range, a normal is not of unit length, or two transducers are
        at one place.
    """

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    transducer: Transducer
    response: NDArray[np.complex128]
    limits: NDArray[np.float64]

    def __init__(
        self,
        positions: ArrayLike,
        normals: ArrayLike | None = None,
        transducer: Transducer | None = None,
        response: ArrayLike | None = None,
        limits: ArrayLike | None = None,
    ) -> None:
        object.__setattr__(self, "positions", frozen(as_points(positions, "transducer position")))
        up = np.broadcast_to([0.0, 0.0, 1.0], self.positions.shape) if normals is None else normals
        object.__setattr__(self, "normals", frozen(as_points(up, "transducer normal")))
        object.__setattr__(self, "transducer", transducer or Transducer())
        if self.positions.shape != self.normals.shape:
            raise ValueError(f"{len(self.positions)} positions but {len(self.normals)} normals: one of each is needed")
        if (width := float(np.ptp(self.positions, axis=0).max())) > WIDEST:
            raise ValueError(
                f"the array is {width:.4g} m wide, more than {WIDEST:g} m; lengths are in metres: 10.3 mm is 0.0103"
            )
        if pair := coincident(self.positions, COINCIDENT):
            first, second = pair
            raise ValueError(
                f"transducers {first} and {second} are both at {self.positions[first].tolist()} m; each needs a place "
                "of its own"
            )
        lengths = np.linalg.norm(self.normals, axis=1)
        if (bad := np.flatnonzero(np.abs(lengths - 1) > 1e-6)).size:
            raise ValueError(f"the normal of transducer {bad[0]} has length {lengths[bad[0]]:.6g}; it must be 1")
        responses = self._for_each("response", response, np.complex128)
        gains = np.abs(responses)
        if (bad := np.flatnonzero(~((gains == 0) | ((gains >= LEAST) & (gains <= MAX_GAIN))))).size:
            raise ValueError(
                f"response {responses[bad[0]]} of transducer {bad[0]} must be 0 or have a gain from {LEAST:g} to "
                f"{MAX_GAIN:g}"
            )
        if not responses.any():
            raise ValueError("every transducer has response 0, that is dead; at least one must work")
        most = self._for_each("limit", limits, np.float64)
        if (bad := np.flatnonzero(~((most == 0) | ((most >= LEAST) & (most <= 1))))).size:
            raise ValueError(f"limit {most[bad[0]]} of transducer {bad[0]} must be 0 or lie between {LEAST:g} and 1")
        if not (most * np.abs(responses)).any():
            raise ValueError("every working transducer has limit 0; at least one must be allowed to sound")
        object.__setattr__(self, "response", frozen(responses))
        object.__setattr__(self, "limits", frozen(most))

    def __repr__(self) -> str:
        deaf = "" if self.able.all() else f", {int((~self.able).sum())} of them silent"
        return f"TransducerArray({counted(len(self), 'transducer')}{deaf}, {extent(self.positions)})"

    def _for_each(self, what: str, values: ArrayLike | None, dtype: type[Scalar]) -> NDArray[Scalar]:
        read = np.ones(len(self), dtype) if values is None else array_of(f"{what}s (n,)", values, dtype)
        if read.shape != (len(self),):
            raise ValueError(f"{what}s have the shape {read.shape}, but there are {len(self)} transducers")
        return read

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def able(self) -> NDArray[np.bool_]:
        """Which transducers can sound, (n,): neither dead nor limited to 0."""
        return np.asarray((self.response != 0) & (self.limits > 0))

    @classmethod
    def grid(
        cls, columns: int = COLUMNS, rows: int = ROWS, pitch: float = PITCH, transducer: Transducer | None = None
    ) -> TransducerArray:
        """A flat rectangular grid centred on the origin, looking up.

        Parameters
        ----------
        columns, rows : int
            Transducers along x and along y; transducer ``row * columns + column`` has the smallest x and y first.
        pitch : float
            Distance between neighbours, in metres.
        transducer : Transducer, optional
            What each of them is; the MA40S4S by default.
        """
        columns, rows = (whole(name, n, 1, MAX_TRANSDUCERS) for name, n in (("columns", columns), ("rows", rows)))
        if columns * rows > MAX_TRANSDUCERS:
            raise ValueError(f"{columns} × {rows} transducers are too many; at most {MAX_TRANSDUCERS} are possible")
        pitch = length("pitch", pitch)
        x = (np.arange(columns) - (columns - 1) / 2) * pitch
        y = (np.arange(rows) - (rows - 1) / 2) * pitch
        grid_x, grid_y = np.meshgrid(x, y)
        positions = np.stack([grid_x.ravel(), grid_y.ravel(), np.zeros(columns * rows)], axis=1)
        return cls(positions, transducer=transducer)

    def plot(self, ax: Axes | None = None, *, drive: ArrayLike | None = None, **style: Any) -> Axes:
        """Draw it as seen from above; transducers that look down are larger dots, behind the others.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Axes to draw onto; by default those of a new figure of pyplot.
        drive : (n,) complex, optional
            Drives: the colour of a dot is the phase, its area the magnitude. Without them, dots without filling are
            transducers that cannot sound.
        **style
            A ``title``, and options of matplotlib's ``scatter``, such as ``cmap``.

        Raises
        ------
        ValueError
            If the drives are not as many as the transducers.
        """
        if drive is None:
            title, sizes, colours = "The array", np.full(len(self), 40.0), np.where(self.able, "0.7", "none")
            look: dict[str, Any] = {"edgecolors": "0.4", "linewidths": 0.5}
        else:
            drives = self._for_each("drive", as_drives(drive), np.complex128)
            title, sizes, colours = "Drive of the array", 4 + 66 * np.abs(drives), np.degrees(np.angle(drives))
            look = {"cmap": CYCLIC, "vmin": -180, "vmax": 180, "edgecolors": "0.5", "linewidths": 0.5}
        down = self.normals[:, 2] < 0
        note = " (larger dots look down)" if down.any() else ""
        axes, look = axes_or_new(ax), look | style
        axes.set(title=look.pop("title", title), xlabel=f"x / mm{note}", ylabel="y / mm")
        axes.set_aspect("equal")
        for factor, of in ((2.5, down), (1, ~down)):
            if of.any():
                x, y = self.positions[of, :2].T * MM
                dots = axes.scatter(x, y, **dict[str, Any](s=factor * sizes[of], c=colours[of]) | look)
        if drive is not None:
            colour_bar(axes, dots, "phase / degrees", fraction=0.046, pad=0.03).set_ticks(range(-180, 181, 90))
        return axes

    def calibrated(self, response: ArrayLike, limits: ArrayLike | None = None) -> TransducerArray:
        """The same array with measured responses, and limits, (n,) each."""
        return TransducerArray(
            self.positions,
            self.normals,
            self.transducer,
            array_of("responses (n,)", response, np.complex128),
            self.limits if limits is None else limits,
        )

    @property
    def centre(self) -> NDArray[np.float64]:
        """(3,) mean of the positions, in metres."""
        return np.asarray(self.positions.mean(axis=0))

    def placed(self, rotation: ArrayLike, translation: ArrayLike) -> TransducerArray:
        """The same array turned by a (3, 3) rotation matrix about the origin, then moved by (3,) metres."""
        turn, shift = array_of("rotation", rotation, np.float64), as_position(translation, "translation")
        if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-9) or np.linalg.det(turn) < 0:
            raise ValueError(f"rotation {turn.tolist()} must be a (3, 3) rotation matrix")
        return TransducerArray(
            self.positions @ turn.T + shift, self.normals @ turn.T, self.transducer, self.response, self.limits
        )

    @classmethod
    def joined(cls, panels: Sequence[TransducerArray]) -> TransducerArray:
        """One array of several panels of the same transducer, in their order.

        Raises
        ------
        ValueError
            If there is no panel, or transducers differ.
        """
        if not panels or any(panel.transducer != panels[0].transducer for panel in panels):
            raise ValueError("panels are joined from at least one array, all of the same transducer")
        return cls(
            np.concatenate([panel.positions for panel in panels]),
            np.concatenate([panel.normals for panel in panels]),
            panels[0].transducer,
            np.concatenate([panel.response for panel in panels]),
            np.concatenate([panel.limits for panel in panels]),
        )


def check_array(array: object) -> None:
    """Raise `ValueError` if something is no array."""
    instance_of(array, TransducerArray, "array", "such as TransducerArray.grid()")
