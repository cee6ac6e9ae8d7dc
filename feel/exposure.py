"""How loud the ultrasound is at ears, against published limits, and the drive that keeps a limit.

Levels are in dB re 20 µPa rms. An airborne array of hundreds of transducers exceeds most limits at a person beside it:
a commercial one was measured at 96 to 137 dB on a hemisphere of 0.5 m, and above 110 dB at most heads (Morzyński et
al., Archives of Acoustics, 2024).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import real
from ..solver import Medium, TransducerArray
from ..solver.acoustics.medium import as_medium
from ..solver.fields.quantities import air_density, sound_pressure_level
from ..solver.geometry import PointsLike, as_places
from .arriving import arriving, as_waves, behind, responses

__all__ = [
    "LIMITS",
    "NOTE",
    "SEATED",
    "Exposure",
    "ExposureLimit",
    "exposure_at",
    "exposure_limit",
    "scattered",
    "seated",
]

NOTE = (
    "ICNIRP (Health Physics 127(2):326, 2024): the limits of 1984 rest on limited evidence, which may not be "
    "scientifically substantiated; they may be too low or too high"
)


TRANSITION_DB = 1.0
"""A margin for drives that follow each other in every period: `stm` was at most 0.6 dB louder than its drives."""
LOWEST_DB, HIGHEST_DB = 0.0, 200.0


class ExposureLimit(NamedTuple):
    """A published limit at 40 kHz."""

    level_db: float
    """In the third-octave band around 40 kHz, dB re 20 µPa rms."""
    whom: str
    source: str


LIMITS = (
    ExposureLimit(100.0, "the public, 24 h a day", "INIRC-IRPA, Health Physics 46:969, 1984"),
    ExposureLimit(110.0, "at work, 8 h a day", "INIRC-IRPA, Health Physics 46:969, 1984"),
    ExposureLimit(110.0, "at work", "Health Canada, Safety Code 24, 1991"),
    ExposureLimit(115.0, "at work, ceiling", "ACGIH, threshold limit values"),
    ExposureLimit(145.0, "at work, ceiling, if the body touches no water or solid that carries the sound", "ACGIH"),
)
"""From the strictest on. INIRC-IRPA adds 3, 6 and 9 dB at work for 2 to 4 h, 1 to 2 h and less than 1 h a day. Most
others are copies (Howard, Hansen and Zander, J. Occup. Health Saf. Aust. NZ 21:253, 2005; Leighton, Proc. R. Soc. A
472:20150624, 2016). `NOTE` says how well they are founded."""

SEATED = ("left ear", "right ear", "nose")
"""The places of `seated`, in order."""
EAR_DISTANCE, EAR_HEIGHT, EAR_BREADTH, NOSE_AHEAD = 0.4, 0.47, 0.145, 0.12  # metres


def seated(array: TransducerArray) -> NDArray[np.float64]:
    """Ears and nose of a person who sits at the table on which an array lies, (3, 3) in metres.

    Notes
    -----
    The person sits at negative y and looks along y, as the hand does that `Hand.flat` makes. Ears are 0.47 m above the
    table: a table of 0.73 m, a seat of 0.445 m, and an ear 0.78 m (men) or 0.72 m (women) above it, a sitting height
    minus 0.13 m; 5 to 95 % of people lie between 0.37 and 0.56 m. That they are 0.4 m from the array's middle, as far
    as a hand over it reaches with a bent elbow, is an assumption. Heads are 0.145 m wide.
    """
    middle = array.positions.mean(axis=0)
    side = EAR_BREADTH / 2
    ears = [[-side, -EAR_DISTANCE, EAR_HEIGHT], [side, -EAR_DISTANCE, EAR_HEIGHT]]
    places = [*ears, [0, NOSE_AHEAD - EAR_DISTANCE, EAR_HEIGHT]]
    return np.asarray(places + middle)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Levels of ultrasound at places.

    Parameters
    ----------
    at : (j, 3) float
        The places, in metres.
    greatest_db : (j,) float
        The rms over one carrier period, in the loudest: no time weighting lowers it.
    mean_db : (j,) float
        The energy mean over the time of the waves.
    bounded : (j,) bool
        Whether transducers look away from the place, so that what they add is only a bound (`arriving.responses`).
    """

    at: NDArray[np.float64]
    greatest_db: NDArray[np.float64]
    mean_db: NDArray[np.float64]
    bounded: NDArray[np.bool_]

    def record(self) -> dict[str, object]:
        """Its levels at each place for JSON, and the limits that are exceeded."""
        return {
            "at_m": self.at.tolist(),
            "greatest_db": self.greatest_db.tolist(),
            "mean_db": self.mean_db.tolist(),
            "is_bound": self.bounded.tolist(),
            "exceeded": [limit._asdict() for limit in self.exceeded],
        }

    @property
    def exceeded(self) -> tuple[ExposureLimit, ...]:
        """The limits that the mean exceeds at one place at least."""
        return tuple(limit for limit in LIMITS if float(self.mean_db.max()) > limit.level_db)

    def gain(self, limit_db: float) -> float:
        """The factor on all drives, at most 1, with which the loudest period at the loudest place keeps a limit."""
        return min(1.0, 10 ** ((_limit(limit_db) - float(self.greatest_db.max())) / 20))

    def __str__(self) -> str:
        loudest = int(self.greatest_db.argmax())
        beyond = "; ".join(f"above {limit.level_db:g} dB ({limit.whom}; {limit.source})" for limit in self.exceeded)
        return (
            f"{self.greatest_db[loudest]:.1f} dB SPL at most, {self.mean_db.max():.1f} dB on average"
            f"{' (a bound: transducers look away)' if self.bounded[loudest] else ''}: {beyond or 'within all limits'}"
        )


def exposure_at(
    array: TransducerArray, waves: ArrayLike, at: PointsLike | None = None, medium: Medium | None = None
) -> Exposure:
    """Levels of ultrasound at places, direct from an array.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    waves : (t, n) complex
        The phasor that each emits at the beginning of each carrier period, such as `hil.emitted_waves`; taken to
        repeat.
    at : (j, 3) float, optional
        Places, in metres; `seated` by default.
    medium : Medium, optional
        The air; 20 °C by default.

    Raises
    ------
    ValueError
        If the waves have another shape, or as `transfer_matrix`.

    Notes
    -----
    The field is free: a head in it raises the pressure at the facing ear by up to 6 dB, and shades the other. Sound
    that a hand, the table and the room reflect is left out; `scattered` is its size.
    """
    medium, points = as_medium(medium), as_places(seated(array) if at is None else at)
    squares = np.abs(arriving(array, waves, points, medium)) ** 2
    greatest, mean = np.sqrt(squares.max(axis=1)), np.sqrt(squares.mean(axis=1, dtype=np.float64))
    return Exposure(
        points,
        sound_pressure_level(greatest),
        sound_pressure_level(mean),
        np.asarray(behind(array, points).any(axis=1)),
    )


def exposure_limit(
    array: TransducerArray, at: PointsLike | None, limit_db: float, medium: Medium | None = None
) -> Callable[[ArrayLike], float]:
    """A function of drives (k, n), which returns the factor, at most 1, with which each of them keeps a limit.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    at : (j, 3) float or None
        Places, in metres; `seated` if None.
    limit_db : float
        Limit in dB re 20 µPa rms.
    medium : Medium, optional
        The air; 20 °C by default.

    Raises
    ------
    ValueError
        If the limit is not finite, or as `transfer_matrix`; when it is called, if the drives have another shape.

    Notes
    -----
    The drives are taken for a cycle, whose first follows its last; each may also begin and end in silence. While one
    follows another, the sound of the nearest transducers is new at a place, and that of the others still old. If the
    change of a transducer q has the progress s(t − r_q/c), which grows from 0 to 1, the pressure is a weighted mean of
    the mixtures of the k nearest new waves with the old others, k = 0 … n: it is no louder than the loudest mixture.
    `TRANSITION_DB` are kept besides, for drives that follow each other faster than they settle.
    """
    limit_db = _limit(limit_db)
    medium, points = as_medium(medium), as_places(seated(array) if at is None else at)
    allowed = 10 ** ((limit_db - TRANSITION_DB - float(sound_pressure_level(1.0))) / 20)  # Pa
    relative = (responses(array, points, medium) / allowed).astype(np.complex64)
    order = np.linalg.norm(points[:, None] - array.positions, axis=2).argsort(axis=1)

    def gain(drives: ArrayLike) -> float:
        new = as_waves(array, drives, "drives")
        loudest = 1.0
        for response, nearest in zip(relative, order, strict=True):
            arriving = np.cumsum((new * response)[:, nearest], axis=1)
            leaving = arriving[:, -1:] - arriving
            mixtures = (arriving, leaving, arriving + np.roll(leaving, 1, axis=0))
            loudest = max(loudest, *(float(np.abs(each).max()) for each in mixtures))
        return 1 / loudest

    return gain


def _limit(limit_db: float) -> float:
    return real("exposure limit", limit_db, LOWEST_DB, HIGHEST_DB, "dB", hint=", such as 110")


def scattered(watts: float, distance: float, medium: Medium | None = None) -> float:
    """Level at a distance from a hand that throws all of a power back evenly into the half space before it, in dB.

    I = W/(2πr²). A hand reflects 99 % of what meets it, not evenly: where it reflects as a mirror it is louder.
    """
    medium = as_medium(medium)
    mean = watts / (2 * math.pi * distance**2)
    return float(sound_pressure_level(math.sqrt(2 * air_density(medium) * medium.speed_of_sound * mean)))
