"""What a design is worth: strength, spread, ghosts, and what is heard of it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...feel.exposure import SEATED, seated
from ...feel.hearing import audible, square_pulses
from ...protocol.pulses import Pulses
from ...solver import ControlPoints, Medium, Modulation, Resonator, TransducerArray, focus_report, solve
from .design import PULSES, Design

__all__ = ["MEASURES", "MEASURE_UNITS", "BuiltArray", "Measures", "emitted", "measure"]

EARS = SEATED.index("nose")
"""The places of `seated` before the nose."""
LEAST_PERIODS = 2000
"""0.05 s: of the sound that is judged, at least; it is a whole number of periods of the modulation."""
PLACES, GAINS, PHASES = range(3)
"""Streams of random numbers for each seed: neither error changes if another one does."""


@dataclass(frozen=True)
class Measures:
    """What a design is worth.

    Parameters
    ----------
    strength_pa, least_pa : float
        |p| at the points that should be strong, peak in Pa: the mean and the least.
    spread : float
        Standard deviation of |p| over these points, each relative to its amplitude, over their mean.
    lobe_db : float or None
        The strongest local maximum beside the foci, in dB relative to their mean; None if there is none.
    ghosts : int
        How many of these maxima have more than half the pressure of the foci (`focus_report`).
    audible_dba : float or None
        Sound below 20 kHz at the louder ear of a `seated` person, in dB(A); None if nothing is heard. The drive
        is modulated by a sine.
    """

    strength_pa: float
    least_pa: float
    spread: float
    lobe_db: float | None
    ghosts: int
    audible_dba: float | None


MEASURES: dict[str, str] = {
    field.name: str(field.type).removesuffix(" | None") for field in dataclasses.fields(Measures)
}
"""The kind of each measure: ``float`` or ``int``."""
MEASURE_UNITS = {"strength_pa": "Pa", "least_pa": "Pa", "lobe_db": "dB", "audible_dba": "dB(A)"}
"""Units of measures; the others have none."""


@dataclass(frozen=True, eq=False)
class BuiltArray:
    """What is built, and what it emits."""

    array: TransducerArray
    """n transducers where they are, with their real gains and phases."""
    medium: Medium
    """The air as it is."""
    drive: NDArray[np.complex128]
    """(n,) complex; as it was solved for the array and the air without errors."""


def emitted(design: Design, points: ControlPoints) -> BuiltArray:
    """Solve for a design without its errors, and build it with them.

    Raises `ValueError` if the points cannot be solved for, or as the method.
    """
    intended = design.array()
    assumed = Medium(design.assumed_c)
    drive = solve(intended, points, design.method, medium=assumed, **design.options).drive
    moved = intended.positions + design.tolerance_mm * 1e-3 * _errors(design, PLACES, (len(intended), 3))
    gain = 10 ** (design.gain_error_db / 20 * _errors(design, GAINS, len(intended)))
    turn = np.deg2rad(design.phase_error_deg) * _errors(design, PHASES, len(intended))
    built = TransducerArray(moved, intended.normals, intended.transducer, gain * np.exp(1j * turn))
    return BuiltArray(built, Medium(design.temperature_c), drive)


def _errors(design: Design, stream: int, shape: int | tuple[int, int]) -> NDArray[np.float64]:
    """Errors of standard deviation 1."""
    return np.random.default_rng([design.seed, stream]).standard_normal(shape)


def quantised(drive: NDArray[np.complex128], design: Design) -> NDArray[np.complex128]:
    """A drive (n,) as the design's electronics emit it."""
    if design.quantisation == PULSES:
        return Pulses.from_drive(drive).to_drive()
    if (levels := design.phase_levels) is not None:
        return np.asarray(np.abs(drive) * np.exp(2j * np.pi / levels * np.rint(np.angle(drive) * levels / (2 * np.pi))))
    return drive


def measure(design: Design, points: ControlPoints) -> Measures:
    """Measure a design.

    Parameters
    ----------
    design : Design
        What to build.
    points : ControlPoints
        The control points of its source.

    Raises
    ------
    ValueError
        As `emitted`, or if a point is out of reach.

    Notes
    -----
    The same design gives the same bits on the same kind of processor if the libraries for linear algebra use as many
    threads: `run_sweep` lets them use one.
    """
    emission = emitted(design, points)
    report = focus_report(emission.array, quantised(emission.drive, design), points, emission.medium)
    return Measures(
        strength_pa=report.mean,
        least_pa=min(focus.pressure for focus in report.foci),
        spread=report.spread,
        lobe_db=None if report.strongest_lobe is None else report.strongest_lobe.level,
        ghosts=len(report.ghosts),
        audible_dba=_heard(design, emission),
    )


def _heard(design: Design, emission: BuiltArray) -> float | None:
    """The A-weighted level at the louder ear, if the drive is modulated by a sine."""
    from ..sound.emission_kernels import ring_up  # importing numba takes half a second

    frames, slots = Modulation.sine(emission.drive, design.modulation_hz).slots()
    rounded = np.stack([quantised(frame, design) for frame in frames])
    rows, periods = zip(*slots, strict=True)
    drives = np.repeat(rounded[list(rows)], periods, axis=0).astype(np.complex64)
    carrier = emission.medium.frequency
    resonance = Resonator.of(emission.array.transducer).enveloped(carrier, 1 / carrier)
    waves, state = np.empty_like(drives), np.zeros((2, drives.shape[1]))
    for _ in range(2):  # the first period of the modulation settles
        ring_up(drives, resonance.decay, (1 - resonance.decay) * resonance.gain, state, waves)
    times = (-(-LEAST_PERIODS // len(drives)), 1)
    sound = audible(
        emission.array,
        np.tile(waves, times),
        np.tile(square_pulses(drives), times),
        seated(emission.array)[:EARS],
        emission.medium,
    )
    loudest = float(sound.levels_dba.max())
    return loudest if np.isfinite(loudest) else None
