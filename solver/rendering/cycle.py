"""Cycles: the drives that a rendering repeats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import HIGHEST, as_single, real, whole
from ..geometry import frozen
from ..methods.modulation import CARRIER

__all__ = ["MOST_FRAMES", "Cycle", "timing"]

MOST_PERIODS = 10_000_000
"""For which drives are held, or written out: some minutes."""

MOST_FRAMES = 256
"""Of a cycle: as many as a device of this project keeps (clause BLK-022)."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """Drives that follow each other, again and again.

    Parameters
    ----------
    drives : (k, n) complex64
        Drives in their order, each in array order; 1 is full drive.
    hold : int
        Carrier periods for which each is emitted.
    envelope : float
        Frequency in hertz of an amplitude modulation on top, by a cosine down to silence; 0 for none.
    carrier : float
        Frequency of the carrier, in hertz.
    """

    drives: NDArray[np.complex64]
    hold: int
    envelope: float = 0.0
    carrier: float = CARRIER

    def __post_init__(self) -> None:
        """Check the shape and the ranges."""
        object.__setattr__(self, "drives", as_single(self.drives))
        if self.drives.ndim != 2 or not self.drives.size:
            raise ValueError(f"drives of a cycle have the shape {self.drives.shape}; they must be (k, n), k at least 1")
        object.__setattr__(self, "hold", whole("hold", self.hold, 1, MOST_PERIODS))
        carrier = real("carrier", self.carrier, 0, HIGHEST, "Hz", above=True)
        object.__setattr__(self, "carrier", carrier)
        object.__setattr__(self, "envelope", real("envelope", self.envelope, 0, carrier, "Hz"))

    def __repr__(self) -> str:
        return f"Cycle({len(self)} frames of {self.drives.shape[1]} drives, {self.frequency:g} Hz)"

    def __len__(self) -> int:
        return len(self.drives)

    @property
    def periods(self) -> int:
        """Carrier periods that it lasts."""
        return len(self) * self.hold

    @property
    def frequency(self) -> float:
        """How often it is repeated in a second."""
        return self.carrier / self.periods

    def slots(self) -> tuple[NDArray[np.complex64], tuple[tuple[int, int], ...]]:
        """The cycle as a sequence for a device, without its `envelope`.

        Returns
        -------
        frames : (j, n) complex64
            The drives that differ, in the order in which they first appear.
        steps : tuple of (int, int)
            Row of ``frames``, and for how many carrier periods it is emitted. Neighbours are different rows.
        """
        rows: dict[bytes, int] = {}
        steps: list[tuple[int, int]] = []
        for drive in self.drives + np.complex64(0):  # -0 is 0
            row = rows.setdefault(drive.tobytes(), len(rows))
            if steps and steps[-1][0] == row:
                steps[-1] = (row, steps[-1][1] + self.hold)
            else:
                steps.append((row, self.hold))
        return frozen(np.frombuffer(b"".join(rows), np.complex64).reshape(len(rows), -1)), tuple(steps)

    def expanded(self, periods: int) -> NDArray[np.complex64]:
        """The drive of each of so many carrier periods, (periods, n), with the `envelope`."""
        periods = whole("periods", periods, 0, MOST_PERIODS)
        drives: NDArray[np.complex64] = self.drives[np.arange(periods) // self.hold % len(self)]
        if not self.envelope:
            return drives
        turns = self.envelope / self.carrier * (np.arange(periods) + 0.5)
        return np.asarray(drives * ((1 + np.cos(2 * np.pi * turns)) / 2).astype(np.float32)[:, None])


def timing(frequency: float, most: int = MOST_FRAMES, carrier: float = CARRIER) -> tuple[int, int]:
    """How many frames a cycle of a frequency has, at most so many, and for how many carrier periods each is held."""
    periods = max(round(carrier / frequency), 1)
    hold = -(-periods // most)
    return max(round(periods / hold), 1), hold
