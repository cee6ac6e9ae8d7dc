"""The array: where the transducers are, where they look, and how loud one is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .geometry import as_points, frozen

__all__ = ["Transducer", "TransducerArray"]

COLUMNS, ROWS, PITCH = 20, 16, 10.3e-3  # metres; the default grid
MAX_TRANSDUCERS = 1_000_000


@dataclass(frozen=True)
class Transducer:
    """A piston in a rigid baffle, seen from its far field.

    Parameters
    ----------
    radius : float
        Effective radius of the piston, in metres.
    strength : float
        P₁, the pressure × distance on the axis at full drive, in Pa·m (peak).

    Notes
    -----
    The defaults are the muRata MA40S4S, 4.5 mm. The paper states 20 Pa (rms) at 30 cm; taken at the data sheet's 10 V
    rms that is 8.49 Pa·m peak, and scaled to the fundamental of the boards' 15 V unipolar square wave, 5.73 Pa·m.
    Published values for this transducer run from 2.5 to 8 Pa·m.
    """

    radius: float = 4.5e-3
    strength: float = 5.73

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, unit, limit in (("radius", "m", 1.0), ("strength", "Pa·m", 1e6)):
            value = getattr(self, name)
            if not 0 < value <= limit:
                raise ValueError(f"transducer {name} {value} {unit} must be positive and at most {limit:g}")


@dataclass(frozen=True, eq=False)
class TransducerArray:
    """Transducers in space; z is up, away from a flat array.

    Parameters
    ----------
    positions : (n, 3) float
        Centres of the pistons, in metres.
    normals : (n, 3) float
        Unit vectors in which they look.
    transducer : Transducer, optional
        What each of them is; the MA40S4S by default.

    Raises
    ------
    ValueError
        Where shapes differ, a number is not finite or a normal is not of unit length.
    """

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    transducer: Transducer

    def __init__(self, positions: ArrayLike, normals: ArrayLike, transducer: Transducer | None = None) -> None:
        object.__setattr__(self, "positions", frozen(as_points(positions, "transducer position")))
        object.__setattr__(self, "normals", frozen(as_points(normals, "transducer normal")))
        object.__setattr__(self, "transducer", transducer or Transducer())
        if self.positions.shape != self.normals.shape:
            raise ValueError(f"{len(self.positions)} positions but {len(self.normals)} normals: one of each is needed")
        lengths = np.linalg.norm(self.normals, axis=1)
        if (bad := np.flatnonzero(np.abs(lengths - 1) > 1e-6)).size:
            raise ValueError(f"the normal of transducer {bad[0]} has length {lengths[bad[0]]:.6g}; it must be 1")

    def __len__(self) -> int:
        return len(self.positions)

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
        for name, count in (("columns", columns), ("rows", rows)):
            if count < 1:
                raise ValueError(f"{name} {count} must be at least 1")
        if columns * rows > MAX_TRANSDUCERS:
            raise ValueError(f"{columns} × {rows} transducers are too many; at most {MAX_TRANSDUCERS} are possible")
        if not 0 < pitch < np.inf:
            raise ValueError(f"pitch {pitch} m must be positive and finite")
        x = (np.arange(columns) - (columns - 1) / 2) * pitch
        y = (np.arange(rows) - (rows - 1) / 2) * pitch
        grid_x, grid_y = np.meshgrid(x, y)
        positions = np.stack([grid_x.ravel(), grid_y.ravel(), np.zeros(columns * rows)], axis=1)
        return cls(positions, np.tile([0.0, 0.0, 1.0], (columns * rows, 1)), transducer)
