"""Pulses: what one transducer does in one carrier period, and its exact relation to a complex drive.

A pulse of ``width`` ticks that begins at tick ``start`` has a continuous-time fundamental of magnitude
(2/π)·sin(π·width/50), centred at ``start + width/2`` ticks. With the time factor e^{-iωt} a later centre is a
larger phase. A drive of magnitude 1 is the widest pulse, 25 ticks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import array_of, check_drives, whole
from .board import HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS, TICKS_PER_PERIOD
from .codes import AMPLITUDES

__all__ = ["MODULATED_WIDTH", "POWER", "Pulses"]

MOST = 1_000_000
"""Transducers at most, of which pulses can be made."""

_SINES = np.sin(np.pi * np.arange(MAX_WIDTH_TICKS + 1) / TICKS_PER_PERIOD)

POWER = np.rint(1000 * _SINES**2).astype(np.int64)
"""Power of a pulse of each width, (26,) int, in thousandths of that of the widest (clause SAF-006)."""

MODULATED_WIDTH = np.rint(
    TICKS_PER_PERIOD / np.pi * np.arcsin(np.minimum(np.arange(AMPLITUDES)[:, None] / (AMPLITUDES - 1) * _SINES, 1.0))
).astype(np.uint8)
"""Width of a pulse under each modulation sample, (256, 26) uint8 over sample and width (clause PUL-006)."""


def _checked(name: str, values: ArrayLike, limit: int, unit: str) -> NDArray[np.uint8]:
    array = np.asarray(values)
    if array.ndim != 1:
        raise ValueError(f"{name} must have the shape (n,), not {array.shape}")
    if array.dtype.kind not in "iu":
        raise ValueError(f"{name} must be whole numbers of {unit}, not {array.dtype}")
    if array.size and (array.max() > limit or (array.dtype.kind == "i" and array.min() < 0)):
        first = np.flatnonzero((array < 0) | (array > limit))[0]
        raise ValueError(f"{name} {array[first]} of transducer {first} is outside 0 to {limit} {unit}")
    result = array.astype(np.uint8)
    result.setflags(write=False)
    return result


@dataclass(frozen=True, eq=False)
class Pulses:
    """One pulse per transducer, in array order.

    Parameters
    ----------
    phase : (n,) uint8
        Centre of the pulse within the carrier period, in half ticks, 0 to 99.
    width : (n,) uint8
        Length of the pulse in ticks, 0 (silent) to 25 (full drive).

    Raises
    ------
    ValueError
        If a value is out of range or the two differ in length.

    Notes
    -----
    The outputs change on whole ticks, so a pulse is centred exactly where it says only if ``phase`` and
    ``width`` are both even or both odd. Otherwise it begins half a tick early (SPEC.md, clause PUL-004).
    `from_drive` makes exact pulses only.
    """

    phase: NDArray[np.uint8]
    width: NDArray[np.uint8]

    def __init__(self, phase: ArrayLike, width: ArrayLike) -> None:
        object.__setattr__(self, "phase", _checked("phase", phase, HALF_TICKS_PER_PERIOD - 1, "half ticks"))
        object.__setattr__(self, "width", _checked("width", width, MAX_WIDTH_TICKS, "ticks"))
        if self.phase.shape != self.width.shape:
            raise ValueError(f"{self.phase.size} phases but {self.width.size} widths: one of each is needed")

    def __repr__(self) -> str:
        return f"Pulses({len(self.width)} outputs, widths {self.width.min()} to {self.width.max()} ticks)"

    def __len__(self) -> int:
        return int(self.phase.size)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Pulses):
            return NotImplemented
        return np.array_equal(self.phase, other.phase) and np.array_equal(self.width, other.width)

    @classmethod
    def trusted(cls, phase: NDArray[np.uint8], width: NDArray[np.uint8]) -> Pulses:
        """Pulses of (n,) uint8 that whoever made them answers for: neither checked nor copied."""
        pulses = object.__new__(cls)
        for name, values in (("phase", phase.view()), ("width", width.view())):
            values.flags.writeable = False
            object.__setattr__(pulses, name, values)
        return pulses

    @classmethod
    def silent(cls, n: int) -> Pulses:
        """``n`` transducers at rest."""
        n = whole("n", n, 0, MOST)
        return cls(np.zeros(n, np.uint8), np.zeros(n, np.uint8))

    @classmethod
    def from_drive(cls, drive: ArrayLike) -> Pulses:
        """The exact pulses nearest to a drive in the complex plane.

        Parameters
        ----------
        drive : (n,) complex
            Magnitude at most 1, where 1 is the widest pulse.

        Raises
        ------
        ValueError
            If the drive is not finite or its magnitude exceeds 1; the transducer is named.
        """
        drive = array_of("drive", drive, np.complex128)
        if drive.ndim != 1:
            raise ValueError(f"drive must have the shape (n,), not {drive.shape}")
        check_drives(drive)
        magnitude = np.abs(drive)

        # Exact pulses of one width lie two half ticks apart, and those of the next width between them. The
        # nearest is among the two widths on either side, each with its nearest phase.
        below = np.floor(TICKS_PER_PERIOD / np.pi * np.arcsin(np.minimum(magnitude, 1.0)))
        width = np.clip(below + np.arange(-1, 3)[:, None], 0, MAX_WIDTH_TICKS).astype(np.int64)
        half_ticks = np.angle(drive) * HALF_TICKS_PER_PERIOD / (2 * np.pi)
        parity = width % 2
        phase = (2 * np.rint((half_ticks - parity) / 2).astype(np.int64) + parity) % HALF_TICKS_PER_PERIOD
        best = np.argmin(np.abs(_phasor(phase, width) - drive), axis=0)[None]
        width = np.take_along_axis(width, best, axis=0)[0]
        phase = np.where(width > 0, np.take_along_axis(phase, best, axis=0)[0], 0)
        return cls(phase, width)

    @property
    def start(self) -> NDArray[np.int64]:
        """Tick at which each pulse begins, (n,), 0 to 49 (SPEC.md, clause PUL-004)."""
        return ((self.phase.astype(np.int64) - self.width) >> 1) % TICKS_PER_PERIOD

    @property
    def total_drive(self) -> int:
        """Power of all pulses together, in thousandths of that of a fully driven transducer (clause SAF-006)."""
        return int(POWER[self.width].sum())

    def modulated(self, sample: int) -> Pulses:
        """These pulses under a modulation sample, 0 (silent) to 255 (as they are): the same phases (clause PUL-006)."""
        return Pulses(self.phase, MODULATED_WIDTH[whole("sample", sample, 0, AMPLITUDES - 1), self.width])

    def to_drive(self) -> NDArray[np.complex128]:
        """The drive that these pulses emit, (n,) complex, from their continuous-time fundamental."""
        return _phasor(2 * self.start + self.width, self.width)


def _phasor(centre_half_ticks: NDArray[np.int64], width_ticks: NDArray[np.integer]) -> NDArray[np.complex128]:
    angle = 2 * np.pi * centre_half_ticks / HALF_TICKS_PER_PERIOD
    return np.asarray(np.sin(np.pi * width_ticks / TICKS_PER_PERIOD) * np.exp(1j * angle))
