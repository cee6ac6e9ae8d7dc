"""Four ways to render what should be felt, with the parameters that the literature recommends.

========== ===============================================================================================
am         all points at once; their strength rises and falls (amplitude modulation)
two-sided  the points in two halves that take turns, the paper's section 3.4
lm         all points at once; each moves to and fro across its line (lateral modulation)
stm        one focus, or few, draws the lines, round after round (spatio-temporal modulation)
========== ===============================================================================================

A way turns an `Outline` into a `Cycle` of drives.

Force follows the intensity. With the envelope ``square``, the paper's, it jumps, and each jump is heard. The envelope
``sine`` leads over along a cosine instead: `am` by the amplitude, `two-sided` by the phases alone.

`lm`, `stm` and `two-sided` with a sine are *steady*: every transducer stays at its limit, and its phase moves in steps
of a pulse of constant width. So the array's power stays the same, and so do the duties of its outputs, which are heard
otherwise. If `stm` jumps to another stroke, the phases are led over in `LEAD` seconds.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import real, whole
from ..methods.modulation import FREQUENCY
from ..methods.options import PHASE_LEVELS
from ..methods.solve import Solver
from ..methods.two_sided import TwoSidedSolver
from ..shapes.notation import READERS, UNITS, read_parameters, written
from .cycle import Cycle, timing
from .outline import Outline

__all__ = [
    "AUTO",
    "WAYS",
    "Amplitude",
    "Halves",
    "Lateral",
    "Solvers",
    "Spatiotemporal",
    "Way",
    "chosen",
    "described",
    "parse_way",
    "way_help",
]

Envelope = Literal["sine", "square"]

LOWEST, HIGHEST = 0.01, 1000.0
"""Of a frequency, in hertz."""
HIGHEST_SQUARE = 20_000.0
"""Of one at which fields are switched."""
SPEEDS = 0.01, 50.0
"""In m/s."""
POINT = 5e-3
"""An outline shorter than this, in metres, is felt as a point: a focus is 9 mm wide."""
LEAD = 2.5e-3
"""Seconds in which phases are led over at a jump: as from one half to the other at 200 Hz."""
UPRIGHT = 0.1
"""Sine of the angle between a line and the array's normal below which nothing is across to both."""
STEPS = PHASE_LEVELS // 2
PHASORS = np.exp(2j * np.pi * (np.arange(STEPS) + 0.5) / STEPS).astype(np.complex64)
"""Of the phases of a pulse of constant odd width, from 0 on."""
DRAWN = 0.02, 0.2
"""Lengths in metres of a line that one focus draws 35 to 350 times a second at 7 m/s, where skin feels best."""


class Solvers(NamedTuple):
    """The means of a way to find drives.

    Parameters
    ----------
    one : Solver
        Solver for all points at once, frame after frame.
    two : TwoSidedSolver
        Solver for their halves.
    most_frames : int
        Drives of a cycle, at most.
    """

    one: Solver
    two: TwoSidedSolver
    most_frames: int

    @property
    def carrier(self) -> float:
        """In hertz."""
        return self.one.medium.frequency


class Way(Protocol):
    """A way of rendering, with its parameters."""

    name: ClassVar[str]

    @property
    def phase_only(self) -> bool:
        """Whether drives are solved for as phases alone, each transducer at its limit."""

    def cycle(self, outline: Outline, solvers: Solvers) -> Cycle:
        """The drives of one cycle."""


@dataclass(frozen=True)
class _Modulated:
    """What ways have in common that change the amplitude of fields which stay where they are."""

    frequency: float = FREQUENCY
    envelope: Envelope = "sine"

    name: ClassVar[str]

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check(self, "frequency", LOWEST, HIGHEST_SQUARE if self.envelope == "square" else HIGHEST)
        if self.envelope not in get_args(Envelope):
            raise ValueError(f"{self.name} envelope {self.envelope!r} must be one of {', '.join(get_args(Envelope))}")

    @property
    def phase_only(self) -> bool:
        """Whether drives are solved for as phases alone, each transducer at its limit."""
        return self.envelope == "sine"


@dataclass(frozen=True)
class Amplitude(_Modulated):
    """Amplitude modulation.

    Parameters
    ----------
    frequency : float
        Frequency of the intensity, in hertz; skin feels 200 to 250 Hz best.
    envelope : {"sine", "square"}
        Envelope of the intensity.
    """

    name: ClassVar[str] = "am"

    def cycle(self, outline: Outline, solvers: Solvers) -> Cycle:
        """One drive, turned up and down."""
        drive = solvers.one.solve(outline.points, outline.ids).drive
        if self.envelope == "square":
            return _switched(drive, np.zeros_like(drive), self.frequency, solvers)
        return _swelling(drive, self.frequency, solvers)


@dataclass(frozen=True)
class Halves(_Modulated):
    """Two-sided modulation, the paper's section 3.4: the array never rests.

    Parameters
    ----------
    frequency : float
        Frequency at which the halves take turns, in hertz.
    envelope : {"sine", "square"}
        Envelope of the intensity; ``sine`` moves each transducer's phase from that of one half to that of the other.
    """

    name: ClassVar[str] = "two-sided"

    def cycle(self, outline: Outline, solvers: Solvers) -> Cycle:
        """Two drives that take turns; a single point has no other half, so that it is as with `Amplitude`."""
        first, second = solvers.two.solve(outline.points, outline.ids).drives
        if self.envelope == "square":
            return _switched(first, second, self.frequency, solvers)
        if not second.any():
            return _swelling(first, self.frequency, solvers)
        count, hold = timing(self.frequency, solvers.most_frames, solvers.carrier)
        share = (1 - np.cos(2 * np.pi * (np.arange(count, dtype=np.float32) + 0.5) / count))[:, None] / 2
        turn = np.angle(second * np.conj(first))
        limit = np.maximum(np.abs(first), np.abs(second))
        return Cycle(_at_steps(limit, np.angle(first) + share * turn), hold, carrier=solvers.carrier)


@dataclass(frozen=True)
class Lateral:
    """Lateral modulation: foci move to and fro across their lines, level with the array, and stay on all the time.

    From 10 to 200 Hz a moving focus was felt more strongly than one whose amplitude was modulated at the same
    frequency and greatest strength (Takahashi, Hasegawa and Shinoda, IEEE Trans. Haptics 13, 334, 2020). At 5 to 15 Hz,
    with steps below a millimetre, it was felt as steady pressure (Morisaki et al., IEEE Trans. Haptics 15, 441, 2022).
    With the default reach such steps need 32 frames in a cycle.

    Parameters
    ----------
    frequency : float
        Frequency in hertz. A line is passed twice a period, so that 100 Hz push it 200 times a second.
    reach : float
        How far a focus moves to either side, in metres; by default half of its width, so that it leaves its line.
    """

    frequency: float = 100.0
    reach: float = 5e-3

    name: ClassVar[str] = "lm"

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check(self, "frequency", LOWEST, HIGHEST)
        _check(self, "reach", 1e-4, 0.05)

    @property
    def phase_only(self) -> bool:
        """Whether drives are solved for as phases alone, each transducer at its limit."""
        return True

    def cycle(self, outline: Outline, solvers: Solvers) -> Cycle:
        """A drive for each place of the foci."""
        count, hold = timing(self.frequency, solvers.most_frames, solvers.carrier)
        swing = self.reach * np.sin(2 * np.pi * (np.arange(count) + 0.5) / count)
        reached, rows = np.unique(swing.round(9), return_inverse=True)  # to and fro
        up = solvers.one.array.normals.mean(axis=0)
        across = np.cross(up, outline.tangents)
        upright = np.linalg.norm(across, axis=1, keepdims=True) < UPRIGHT
        across = np.where(upright, outline.tangents, across)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        places = outline.points.positions + reached[:, None, None] * across
        drives = steady(solvers.one.follow(places, outline.points.amplitudes, outline.ids))
        return Cycle(drives[rows], hold, carrier=solvers.carrier)


@dataclass(frozen=True)
class Spatiotemporal:
    """Spatio-temporal modulation: foci draw the lines.

    Parameters
    ----------
    speed : float
        Speed in m/s. Lines are felt best at 5 to 8 m/s, near the speed of waves on skin, so that these add up (Frier
        et al., Using spatiotemporal modulation to draw tactile patterns in mid-air, EuroHaptics 2018).
    foci : int
        Number of foci that draw at a time, evenly spread: the fewer there are, the stronger is each.
    pause : float
        Seconds for which a focus rests at corners, so that they can be felt (Hajas et al., Mid-air haptic rendering of
        2D geometric shapes with a dynamic tactile pointer, IEEE Trans. Haptics 13, 806, 2020: 0.3 s, of a slow one).
    modulation : float
        Frequency in hertz of an amplitude modulation on top, without which a slow focus is hardly felt; 0 for none.
    """

    speed: float = 7.0
    foci: int = 1
    pause: float = 0.0
    modulation: float = 0.0

    name: ClassVar[str] = "stm"

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check(self, "speed", *SPEEDS)
        object.__setattr__(self, "foci", whole("stm foci", self.foci, 1, 16))
        _check(self, "pause", 0, 10)
        if self.modulation != 0:
            _check(self, "modulation", LOWEST, HIGHEST)

    @property
    def phase_only(self) -> bool:
        """Whether drives are solved for as phases alone, each transducer at its limit."""
        return True

    def cycle(self, outline: Outline, solvers: Solvers) -> Cycle:
        """A drive for each place of the foci; points alone have no line to draw, so they are moved as by `Lateral`."""
        if outline.length < POINT:
            return Lateral().cycle(outline, solvers)
        back = self.foci == 1  # several would meet on the way to and fro
        frequency = 1 / max(outline.round_trip(self.speed, self.pause, back=back), 1 / HIGHEST)
        count, hold = timing(frequency, solvers.most_frames, solvers.carrier)
        line = outline.walk(count, self.speed, self.pause, back=back)
        shifts = np.arange(self.foci) * count // self.foci
        places = line[(np.arange(count)[:, None] + shifts) % count]
        drives = solvers.one.follow(places, np.ones(self.foci))
        far = np.linalg.norm(np.roll(places, -1, axis=0) - places, axis=2).max(axis=1)
        jumps = np.flatnonzero(far > max(POINT, 3 * self.speed * hold / solvers.carrier))
        led = _led_over(drives, jumps, math.ceil(LEAD * solvers.carrier / hold))
        return Cycle(steady(led), hold, self.modulation, solvers.carrier)


WAYS: dict[str, type[Any]] = {way.name: way for way in (Amplitude, Halves, Lateral, Spatiotemporal)}
"""Ways by name: dataclasses that are a `Way`."""
AUTO = "auto"
UNITS |= {
    "frequency": ("Hz", "hertz", HIGHEST),
    "modulation": ("Hz", "hertz", HIGHEST),
    "speed": ("m/s", "metres per second", SPEEDS[1]),
    "pause": ("s", "seconds", 10.0),
    "foci": ("", "foci", 16.0),
}


def chosen(outline: Outline) -> Way:
    """The way that ``auto`` means.

    A point is moved to and fro. A single line whose length is in `DRAWN` is drawn by one focus. Everything else, such
    as the several arcs of a hand on an object, is two-sided.
    """
    if outline.length < POINT and len(outline.points) == 1:
        return Lateral()
    if len(outline.strokes) == 1 and DRAWN[0] <= outline.length <= DRAWN[1]:
        return Spatiotemporal()
    return Halves()


def parse_way(text: str) -> Way | None:
    """Read a way such as ``stm`` or ``am:frequency=100,envelope=square``; None for ``auto``.

    Raises
    ------
    ValueError
        If the way or a parameter is unknown, or a value is wrong; the message names it.
    """
    name, _, parameters = text.partition(":")
    if text == AUTO:
        return None
    if name == AUTO:
        raise ValueError(f"{AUTO} has no parameters; name a way to set some, such as stm:{parameters}")
    if name not in WAYS:
        raise ValueError(f"unknown way of rendering {name!r}; known are {AUTO}, {', '.join(WAYS)}")
    way: Way = WAYS[name](**read_parameters(name, parameters, WAYS[name]))
    return way


def described(way: Way) -> str:
    """The text that `parse_way` reads as this way."""
    own: dict[str, Any] = {field.name: getattr(way, field.name) for field in dataclasses.fields(way)}  # type: ignore[arg-type]  # each is a dataclass
    usual = type(way)()
    named = ",".join(f"{name}={value}" for name, value in own.items() if value != getattr(usual, name))
    return f"{way.name}:{named}" if named else way.name


def way_help() -> str:
    """One line for each way: its name and its parameters with their defaults."""
    return "\n".join(f"{name}:{written(way)}" for name, way in WAYS.items())


def steady(drives: NDArray[Any]) -> NDArray[np.complex64]:
    """Drives with phases in steps of a pulse of constant width, (k, n): every other one of `PHASE_LEVELS`.

    A pulse is centred at a half tick if its width is odd. With all phases the width would have to change by a tick from
    one to the next, and the duty with it: the outputs' sound below the carrier is 3 dB louder then.
    """
    return _at_steps(np.abs(drives), np.angle(drives))


def _led_over(drives: NDArray[np.complex64], jumps: NDArray[np.intp], frames: int) -> NDArray[np.complex64]:
    """Drives of a cycle, (k, n), with the phases after each of some frames led over to those of later ones.

    So many frames around each jump, fewer if the next jump is near, get the phases between both ends, along a cosine.
    """
    count, led = len(drives), drives.copy()
    for jump in jumps:
        gaps = (jumps - jump) % count
        nearest = min([count, *gaps[gaps > 0], *(count - gaps[gaps > 0])])
        around = min(frames, nearest - 1, count - 2) // 2
        if around < 1:
            continue
        first, last = drives[jump - around], drives[(jump + 1 + around) % count]
        share = (1 - np.cos(np.pi * np.arange(1, 2 * around + 1) / (2 * around + 1))) / 2
        turn = np.angle(last * np.conj(first))
        rows = (jump - around + np.arange(1, 2 * around + 1)) % count
        led[rows] = np.abs(first) * np.exp(1j * (np.angle(first) + share[:, None] * turn))
    return led


def _at_steps(magnitude: NDArray[Any], phase: NDArray[Any]) -> NDArray[np.complex64]:
    """Drives of magnitudes and phases, in radians, the phases in the steps of `steady`."""
    step = np.floor(phase * np.float32(STEPS / (2 * np.pi))).astype(np.int32) % STEPS
    return np.asarray(magnitude * PHASORS[step], np.complex64)


def _switched(first: NDArray[Any], second: NDArray[Any], frequency: float, solvers: Solvers) -> Cycle:
    """Two drives, each for one half of the modulation's period."""
    hold = max(round(solvers.carrier / (2 * frequency)), 1)
    return Cycle(np.stack([first, second]).astype(np.complex64), hold, carrier=solvers.carrier)


def _swelling(drive: NDArray[Any], frequency: float, solvers: Solvers) -> Cycle:
    """A drive whose intensity is a sine: its amplitude cos(πft) has a sign, and takes two periods of the modulation."""
    count, hold = timing(frequency / 2, solvers.most_frames, solvers.carrier)
    envelope = np.cos(2 * np.pi * (np.arange(count) + 0.5) / count)
    return Cycle((envelope[:, None] * drive).astype(np.complex64), hold, carrier=solvers.carrier)


def _check(way: Way | _Modulated, name: str, low: float, high: float) -> None:
    unit, *_ = UNITS.get(name, ("m",))
    object.__setattr__(way, name, real(f"{way.name} {name}", getattr(way, name), low, high, unit))


READERS["Envelope"] = (str, "sine or square")
