"""The options of the methods, checked once, and the constants of the methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from ...base.arguments import real, whole

__all__ = [
    "ALONE",
    "BETTER",
    "FLAT",
    "GRADIENTS",
    "HEADROOM",
    "KEPT",
    "LEAST_GAIN",
    "LEAST_MU",
    "NUDGE",
    "PHASE_LEVELS",
    "TOLERANCE",
    "Options",
    "Output",
    "Phases",
]

Output = Literal["solved", "phase", "limited"]
Phases = Literal["unit", "power"]

HEADROOM = 2.0
"""How far above the limits ``limited`` output raises the root mean square of the drives before it cuts them off."""

TOLERANCE = 1e-3
"""Misfit, to the largest amplitude, at which ``wgs`` takes no further step: `PHASE_LEVELS` leave three times it."""

GRADIENTS = 6
"""Most conjugate gradients in a step of ``wgs``."""

FLAT = 0.05
"""Part of the first gradient at which these end: the next step has other gradients."""

ALONE = 1e-10
"""Part of the square of what a gradient changes, below which it changes the common level alone, which is free."""

BETTER = 0.999
"""A misfit below this part of the best one so far is better. A smaller gain may be rounding, and changes nothing."""

KEPT = 0.5
"""Part of the strength with which ``wgs`` begins that it keeps: contradicting points are most even in near silence."""

NUDGE = 0.05
"""Part of the cold start in a warm one: without it, phases that are symmetric on a symmetric shape would stay so."""

LEAST_GAIN = 1e-9
"""Least decrease of the mean square misfit that a step of ``polish`` is taken for; less is rounding."""

LEAST_MU = 1e-4
"""Below this, a system is solved in double precision: single precision would lose more than a per mille."""

PHASE_LEVELS = 100
"""Phases that a pulse can have, in half ticks of a 40 kHz period."""

MAX_MU = 1e6  # beyond, the points hardly matter
MAX_STEPS = 100_000


@dataclass(frozen=True)
class Options:
    """Options of the methods; each method heeds some of them.

    Parameters
    ----------
    gamma : float
        0 prefers the smallest drives, 1 the most equal ones.
    mu : float
        Weight of the regularisation, relative to the mean of the system's eigenvalues.
    phases : {"unit", "power"}
        How the phases of the control points are found: by an iteration that keeps all at full magnitude, or by the
        paper's power method.
    phase_steps : int
        Most iterations for the phases.
    phase_seconds : float, optional
        Time after which no further iteration begins. With it, results depend on the speed of the machine.
    steps : int
        Most Gauss–Newton steps over the phases of the drives. Fewer are taken if the misfit of drives that keep half of
        the strength falls to a per mille.
    sweeps : int
        Passes of the coordinate descent over all transducers.
    levels : int
        Phases per turn that the coordinate descent may choose from.
    output : {"solved", "phase", "limited"}, optional
        How drives are brought within their limits: all scaled alike until the strongest is at its limit; each at its
        limit, with its phase kept; or raised well above and cut off, with nearly the accuracy of the first and the
        strength of the second. By default as the method recommends.

    Raises
    ------
    ValueError
        If an option is out of range; the message names it, its value and its range.
    """

    gamma: float = 1.0
    mu: float = 0.03
    phases: Phases = "unit"
    phase_steps: int = 20
    phase_seconds: float | None = None
    steps: int = 10
    sweeps: int = 2
    levels: int = PHASE_LEVELS
    output: Output | None = None

    def __post_init__(self) -> None:
        """Check the ranges."""
        object.__setattr__(self, "gamma", real("gamma", self.gamma, 0, 1))
        object.__setattr__(self, "mu", real("mu", self.mu, 0, MAX_MU, above=True))
        if self.phases not in get_args(Phases):
            raise ValueError(f"phases {self.phases!r} must be one of {', '.join(get_args(Phases))}")
        if self.output is not None and self.output not in get_args(Output):
            raise ValueError(f"output {self.output!r} must be one of {', '.join(get_args(Output))}")
        if self.phase_seconds is not None:
            object.__setattr__(self, "phase_seconds", real("phase_seconds", self.phase_seconds, 0, 1e6, "s"))
        for name, least in (("phase_steps", 0), ("steps", 0), ("sweeps", 0), ("levels", 2)):
            object.__setattr__(self, name, whole(name, getattr(self, name), least, MAX_STEPS))

    @property
    def policy(self) -> Output:
        """The output policy of options that `methods.options_of` made."""
        assert self.output is not None
        return self.output
