"""Methods by name: what each does, the options that it heeds, its readable function and its kernels."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint
from typing import Any, NamedTuple

import numpy as np

from ...base.plugins import entries, load
from .options import Options, Output, Phases
from .reference import Complex, Real, Regularised, augmented, correct, limit_drive, min_norm, multiplex, polish

__all__ = ["GROUP", "METHODS", "Kernels", "Method", "Problem", "options_of"]

GROUP = "phasewire.methods"
"""The group of entry points by which other packages add methods."""


class Problem(NamedTuple):
    """What a method solves.

    Parameters
    ----------
    transfer : (m, n) complex
        Pressure at each point per unit drive of each transducer; 0 for dead ones.
    wanted : (m,) float
        Amplitudes of the points, at most 1.
    limits : (n,) float
        Largest magnitude of each drive.
    options : Options
        Options with an output policy.
    phases : callable
        Takes A·W·Aᴴ (m, m) and ``"unit"`` or ``"power"``, and returns the points' phases (m,), of unit modulus, that
        `reference.phase_iteration` finds. Its iteration begins with the last phases of the same points.
    """

    transfer: Complex
    wanted: Real
    limits: Real
    options: Options
    phases: Callable[[Complex, Phases], Complex]

    def limited(self, drive: Complex) -> Complex:
        """A drive (n,) of any scale within the limits, by the output policy."""
        return limit_drive(drive, self.limits, self.options.policy)


class Kernels(NamedTuple):
    """Which compiled kernels find the drives of a method.

    Parameters
    ----------
    weighed : bool
        Whether they solve the regularised system; if not, they sum single foci.
    corrected : bool
        Whether Gauss–Newton steps over the phases follow, at most `Options.steps`.
    polished : bool
        Whether a coordinate descent over phases ends it.
    """

    weighed: bool = True
    corrected: bool = False
    polished: bool = False


@dataclass(frozen=True)
class Method:
    """A way to find drives.

    Parameters
    ----------
    summary : str
        What it does.
    output : {"solved", "phase", "limited"}
        Its output policy unless told otherwise.
    options : tuple of str
        Fields of `Options` that it heeds, ``output`` aside.
    solve : callable
        The readable function, from a `Problem` to drives (n,) complex within the limits. It raises `ValueError` if
        there is no solution.
    kernels : Kernels, optional
        What does the same in float32.
    squared : bool
        Whether its system has a row for each transducer too, so that n·n numbers must fit the memory.

    Raises
    ------
    ValueError
        If an option is not a field of `Options`.
    """

    summary: str
    output: Output
    options: tuple[str, ...]
    solve: Callable[[Problem], Complex]
    kernels: Kernels | None = None
    squared: bool = False

    def __post_init__(self) -> None:
        """Check the names of the options."""
        known = [field.name for field in dataclasses.fields(Options)]
        if foreign := [name for name in self.options if name not in known]:
            raise ValueError(f"a method has no option {foreign[0]!r}; Options has {', '.join(known)}")

    def __repr__(self) -> str:
        return f"Method({self.summary})"


def _regularised(problem: Problem, steps: int) -> Complex:
    """Weighted Tikhonov regularisation, then Gauss–Newton steps over the phases."""
    options, transfer, wanted = problem.options, problem.transfer, problem.wanted
    try:
        system = Regularised(transfer, wanted, options.gamma, options.mu)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"mu {options.mu} is too small for points as close together as these") from error
    phases = problem.phases(system.gram, options.phases)
    return correct(transfer, wanted, problem.limited(system.solve(wanted * phases)), steps)


def _tikhonov(problem: Problem) -> Complex:
    return _regularised(problem, 0)


def _wgs(problem: Problem) -> Complex:
    return _regularised(problem, problem.options.steps)


def _polish(problem: Problem) -> Complex:
    options = problem.options
    return polish(problem.transfer, problem.wanted, _wgs(problem), options.levels, options.sweeps)


def _multiplex(problem: Problem) -> Complex:
    return problem.limited(multiplex(problem.transfer, problem.wanted))


def _min_norm(problem: Problem) -> Complex:
    phases = problem.phases(_gram(problem.transfer), problem.options.phases)
    return problem.limited(min_norm(problem.transfer, problem.wanted, phases))


def _paper(problem: Problem) -> Complex:
    phases = problem.phases(_gram(problem.transfer), "power")
    return problem.limited(augmented(problem.transfer, problem.wanted, phases, problem.options.gamma))


def _gram(transfer: Complex) -> Complex:
    return np.asarray(transfer @ transfer.conj().T)


_PHASES = ("phases", "phase_steps", "phase_seconds")
_TIKHONOV = (*_PHASES, "gamma", "mu")
_OWN = {
    "wgs": Method(
        "tikhonov, then Gauss–Newton steps over the phases; recommended",
        "limited",
        (*_TIKHONOV, "steps"),
        _wgs,
        Kernels(corrected=True),
    ),
    "polish": Method(
        "wgs, then a coordinate descent over phases in steps",
        "limited",
        (*_TIKHONOV, "steps", "sweeps", "levels"),
        _polish,
        Kernels(corrected=True, polished=True),
    ),
    "tikhonov": Method("weighted Tikhonov regularisation, (10)–(11)", "solved", _TIKHONOV, _tikhonov, Kernels()),
    "min_norm": Method("minimum norm or least squares, (6)–(8)", "solved", _PHASES, _min_norm),
    "multiplex": Method(
        "linear multiplexing, (12): phases of the summed single foci; makes no nulls",
        "phase",
        (),
        _multiplex,
        Kernels(weighed=False),
    ),
    "paper": Method(
        "the paper to the letter: power method, μ = 1, full power",
        "phase",
        ("phase_steps", "gamma"),
        _paper,
        squared=True,
    ),
}


class Methods(Mapping[str, Method]):
    """Methods by name: those of this package, then those of the entry-point group `GROUP`, loaded when first used."""

    def __init__(self) -> None:
        self._loaded = dict(_OWN)

    @cached_property
    def _others(self) -> dict[str, EntryPoint]:
        return {name: entry for name, entry in entries(GROUP).items() if name not in _OWN}

    def __getitem__(self, name: str) -> Method:
        if name not in self._loaded:
            entry = self._others[name]
            what = f"method {name!r} of the entry point {entry.value!r}"
            method = load(entry, what, ValueError)
            if not isinstance(method, Method):
                raise ValueError(f"{what} must be a Method, not {method!r}")
            self._loaded[name] = method
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in _OWN or name in self._others

    def __iter__(self) -> Iterator[str]:
        yield from (*_OWN, *self._others)

    def __len__(self) -> int:
        return len(_OWN) + len(self._others)


METHODS = Methods()
"""Methods by name."""


def options_of(method: str, values: Mapping[str, Any] | None = None) -> Options:
    """Options of a method, with its own output policy if none is named.

    `ValueError` if the method is unknown or cannot be loaded, does not heed an option, or a value is out of range.
    """
    if not isinstance(method, str) or method not in METHODS:
        raise ValueError(f"unknown method {method!r}; known are {', '.join(METHODS)}")
    heeded = ("output", *METHODS[method].options)
    values = dict(values or {})
    if foreign := sorted(set(values) - set(heeded)):
        raise ValueError(f"{method} has no option {foreign[0]!r}; it has {', '.join(heeded)}")
    options = Options(**values)
    return dataclasses.replace(options, output=options.output or METHODS[method].output)
