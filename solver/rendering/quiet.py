"""Quiet drives: every change of phase and amplitude is spread over carrier periods.

A transducer's resonance turns a jump of phase into a dip of its amplitude, and the dips of an array are heard as a
click (Suzuki, Fujiwara, Makino and Shinoda, Reducing amplitude fluctuation by gradual phase shift in midair ultrasound
haptics, IEEE Trans. Haptics 13, 87, 2020). Two rules spread it:

- `Completion`: each change is completed in a given number of periods, whatever its size. AUTD3's silencer does so, in
  10 periods for the amplitude and 40 for the phase by default. With as many periods as a frame lasts, it interpolates
  between frames.
- `Rates`: no period changes more than so much, so that a large change takes longer.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import as_single, real, whole
from ..acoustics.array import MAX_TRANSDUCERS
from .cycle import MOST_PERIODS, Cycle

__all__ = ["Completion", "Quieting", "Rates", "literal", "quieted"]

Drives = NDArray[np.complex64]
SILENT = 1e-9
"""An amplitude below this is what rounding has left of silence."""
SETTLED, MOST_ROUNDS = 1e-5, 1000
"""Difference of drives between two rounds below which a cycle repeats itself, and rounds until it does."""


@dataclass(frozen=True)
class Completion:
    """Each change is completed in so many carrier periods, by equal steps, the phase the shorter way.

    Parameters
    ----------
    amplitude, phase : int
        Periods, at least 1. The defaults are those of AUTD3's silencer.

    Notes
    -----
    The firmware of AUTD3 counts in 256ths of a turn and of full drive; here nothing is rounded. If a target changes
    before the last change is complete, the step follows from the present value, as its manual says.
    """

    amplitude: int = 10
    phase: int = 40

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("amplitude", "phase"):
            periods = whole(f"completion {name}", getattr(self, name), 1, MOST_PERIODS)
            object.__setattr__(self, name, periods)

    @property
    def limits(self) -> tuple[int, int, float, float]:
        """As `follow` takes them: periods of amplitude and phase, and rates that do not matter."""
        return self.amplitude, self.phase, 0.0, 0.0


@dataclass(frozen=True)
class Rates:
    """Greatest changes in a carrier period.

    Parameters
    ----------
    amplitude : float
        Change of amplitude as a part of full drive, above 0.
    phase : float
        Change of phase in radians, above 0. The defaults take a full drive and half a turn as AUTD3's silencer does.
    """

    amplitude: float = 1 / 10
    phase: float = math.pi / 40

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, unit in (("amplitude", "of full drive"), ("phase", "rad")):
            value = real(f"rates {name}", getattr(self, name), 0, 1e6, unit, above=True)
            object.__setattr__(self, name, value)

    @property
    def limits(self) -> tuple[int, int, float, float]:
        """As `follow` takes them: no periods, and the rates."""
        return 0, 0, self.amplitude, self.phase


class Quieting:
    """Drives that follow wanted ones, carrier period after carrier period; they begin in silence.

    From silence a drive rises in the phase that is wanted, since nothing sounds that could jump; and it falls silent in
    the phase that it has.

    Parameters
    ----------
    transducers : int
        n.
    rule : Completion or Rates
        The rule for the changes that are allowed.
    """

    def __init__(self, transducers: int, rule: Completion | Rates) -> None:
        self._limits, transducers = rule.limits, whole("transducers", transducers, 1, MAX_TRANSDUCERS)
        self._targets = np.zeros(transducers, np.complex64)
        self._state, self._steps = np.zeros((2, transducers)), np.zeros((2, transducers))

    def follow(self, wanted: Drives) -> Drives:
        """The drives of the next t carrier periods, (t, n), instead of wanted ones, (t, n).

        Raises
        ------
        ValueError
            If the wanted drives have another shape, or one is beyond full drive.
        """
        from ..compiled.change_kernels import follow  # numba takes half a second to import

        wanted = np.ascontiguousarray(as_single(wanted))
        if wanted.ndim != 2 or wanted.shape[1] != len(self._targets):
            raise ValueError(f"wanted drives have the shape {wanted.shape}; they must be (t, {len(self._targets)})")
        drives = np.empty_like(wanted)
        follow(wanted, *self._limits, SILENT, self._targets, self._state, self._steps, drives)
        return drives


def quieted(cycle: Cycle, rule: Completion | Rates) -> Cycle:
    """A cycle as it is once it has been repeated often, every change spread by a rule; a frame for each period.

    The cycle's own `envelope` stays on top.

    Raises
    ------
    ValueError
        If the rule is so slow that the cycle does not settle.
    """
    quieting = Quieting(cycle.drives.shape[1], rule)
    wanted = np.repeat(cycle.drives, cycle.hold, axis=0)
    drives = quieting.follow(wanted)
    for _ in range(MOST_ROUNDS):
        before, drives = drives, quieting.follow(wanted)
        if np.abs(drives - before).max() < SETTLED:
            return Cycle(drives, 1, cycle.envelope, cycle.carrier)
    raise ValueError(f"{rule} is so slow that {cycle} has not settled after it was repeated {MOST_ROUNDS} times")


def literal(wanted: Drives, rule: Completion | Rates) -> NDArray[np.complex128]:
    """The result of `Quieting.follow` at first, transducer by transducer and period by period: readable, and slow."""
    drives = np.zeros(wanted.shape, np.complex128)
    for q, course in enumerate(wanted.T):
        amplitude, phase, aim, aim_phase = 0.0, 0.0, 0j, 0.0
        rise = turn = 0.0
        for t, now in enumerate(course.tolist()):
            if now != aim:
                aim, aim_phase = now, cmath.phase(now) if now else aim_phase
                phase = phase if amplitude > SILENT else aim_phase
                if isinstance(rule, Completion):
                    rise = abs(abs(aim) - amplitude) / rule.amplitude
                    turn = abs(_turned(phase, aim_phase)) / rule.phase
                else:
                    rise, turn = rule.amplitude, rule.phase
            amplitude += np.clip(abs(aim) - amplitude, -rise, rise)
            phase += np.clip(_turned(phase, aim_phase), -turn, turn)
            drives[t, q] = cmath.rect(amplitude, phase)
    return drives


def _turned(phase: float, towards: float) -> float:
    """The shorter way from a phase to another, in radians."""
    return (towards - phase + math.pi) % (2 * math.pi) - math.pi
