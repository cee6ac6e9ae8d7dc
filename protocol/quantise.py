"""Many drives at once into the nearest exact pulses, for streaming: the fast twin of `Pulses.from_drive`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import array_of, check_drives, whole
from .board import HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS
from .pulses import Pulses

__all__ = ["PulseFrames", "check_pulses", "quantise"]

MOST_FRAMES = 2**63 - 1


class PulseFrames(NamedTuple):
    """k frames of pulses, as `Pulses` has them one by one. Whoever makes them answers for their values.

    Parameters
    ----------
    phase, width : (k, n) uint8
        Pulses in array order, in half ticks and ticks.
    """

    phase: NDArray[np.uint8]
    width: NDArray[np.uint8]

    def __repr__(self) -> str:
        return f"PulseFrames({len(self.phase)} × {self.phase.shape[-1]} outputs)"

    def pulses(self, number: int) -> Pulses:
        """One frame by its number, a view of it; `ValueError` if there is none."""
        number = whole("frame", number, 0, len(self.phase) - 1)
        return Pulses.trusted(self.phase[number], self.width[number])

    @classmethod
    def joined(cls, parts: Sequence[PulseFrames], channels: int) -> PulseFrames:
        """Some frames after each other, each of so many transducers; a single part as it is."""
        if len(parts) == 1:
            return parts[0]
        none = np.empty((0, channels), np.uint8)
        return cls(
            np.concatenate([none, *(part.phase for part in parts)]),
            np.concatenate([none, *(part.width for part in parts)]),
        )


def check_pulses(frames: PulseFrames, first: int = 0) -> None:
    """Raise `ValueError`, naming frame and transducer, if a phase or a width is too large.

    Parameters
    ----------
    frames : PulseFrames
        Frames from a caller that may have made a mistake.
    first : int
        Number of the first of them.
    """
    for name, values, limit in zip(frames._fields, frames, (HALF_TICKS_PER_PERIOD - 1, MAX_WIDTH_TICKS), strict=True):
        if values.max(initial=0) > limit:
            frame, transducer = np.argwhere(values > limit)[0]
            where = f"transducer {transducer} of frame {first + frame}"
            raise ValueError(f"{name} {values[frame, transducer]} of {where} is above {limit}")


def quantise(drives: ArrayLike, out: PulseFrames | None = None, *, first: int = 0) -> PulseFrames:
    """The exact pulses nearest to k frames of drives in the complex plane.

    Parameters
    ----------
    drives : (k, n) complex
        Magnitude at most 1, where 1 is the widest pulse; complex64 and complex128 are read where they are.
    out : PulseFrames, optional
        The arrays to write to, (k, n) and contiguous, and apart from the drives.
    first : int
        Number of the first frame, by which errors count.

    Returns
    -------
    PulseFrames
        If two pulses are equally near within rounding, either of them; ``out`` if it is given.

    Raises
    ------
    ValueError
        If a drive is not finite or its magnitude exceeds 1, which names frame and transducer, or shapes or types
        are not these; what ``out`` holds is then worth nothing.
    """
    from . import kernels  # numba takes longer to import than everything else together

    given = np.asarray(drives)
    kept = given.dtype in (np.complex64, np.complex128)
    read = np.ascontiguousarray(given) if kept else array_of("drives", drives, np.complex128)
    if given.ndim != 2:
        raise ValueError(f"drives must have the shape (k, n), not {given.shape}")
    first = whole("first", first, 0, MOST_FRAMES)
    if out is None:
        out = PulseFrames(np.empty(read.shape, np.uint8), np.empty(read.shape, np.uint8))
    else:
        _check_room(out, read)
    if kernels.quantise(read, *out):
        check_drives(read, first)
    return out


def _check_room(out: PulseFrames, drives: NDArray[np.complexfloating]) -> None:
    for name, room in zip(PulseFrames._fields, out, strict=True):
        if room.dtype != np.uint8 or room.shape != drives.shape or not room.flags.c_contiguous:
            raise ValueError(f"{name} of out must be contiguous {drives.shape} uint8, not {room.shape} {room.dtype}")
        if not room.flags.writeable:
            raise ValueError(f"{name} of out is read-only")
