"""What a case says of itself: its clauses, what it needs, what it risks; and how it comes to another verdict than pass.

A case is a function of pytest in `groups` with the decorator `case`. Its docstring's first paragraph says what it does
and why. It fails by an `AssertionError`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum, Flag, IntEnum, IntFlag, StrEnum
from typing import Literal, TypeVar

from ...protocol.codes import Feature
from .clauses import resolve

__all__ = [
    "NOT_USB",
    "Case",
    "Inconclusive",
    "Need",
    "NotApplicable",
    "Risk",
    "TooSlow",
    "case",
    "case_of",
    "expect",
    "not_allowed",
    "unmet",
]

Function = TypeVar("Function", bound=Callable[..., object])

ATTRIBUTE = "phasewire_case"
NO_FEATURES = Feature(0)
NOT_USB = "not this line: it concerns USB, and the device is at the end of a serial line"
"""Why a case about USB cannot be judged here."""


class Need(StrEnum):
    """What a bench must be able to see, or to do to the device besides speaking to it."""

    CAPTURE = "a capture of the outputs"
    POWER = "power that can be cut"
    SUSPEND = "a bus that can be suspended"
    PLUG = "a cable that can be pulled"
    FAULTS = "faults that can be caused"
    SPARE = "a second device, which may be broken for good"


class Risk(StrEnum):
    """What must be allowed first."""

    FLASH = "flash"
    """Firmware is written."""
    RESET = "reset"
    """The device is restarted, the bus reset, power cut."""
    DRIVE = "drive"
    """Many transducers are driven hard."""


LineKind = Literal["usb", "serial"]


def not_allowed(risk: Risk) -> str:
    """Why a case cannot be judged without a risk, and what to do."""
    return f"not allowed: pass --allow {risk}"


def unmet(need: Need) -> str:
    """Why a case cannot be judged by a bench that lacks something, and what to do."""
    remedy = "pass --capture sigrok:FILE" if need is Need.CAPTURE else "only a device emulated by this command has that"
    return f"needs {need}: {remedy}"


class Inconclusive(Exception):
    """The case cannot be judged here; the text says why."""


class TooSlow(Inconclusive):
    """The computer or the line is too slow for the case; with more time it may be judged (`Bench.slow_down`)."""


class NotApplicable(Exception):
    """The device does not have what the case is about; the text says why."""


@dataclass(frozen=True)
class Case:
    """What a case says of itself.

    Parameters
    ----------
    clauses : tuple of str
        What it shows.
    sentence : str
        What it does and why.
    outputs : tuple of str
        What only the outputs show of it. It runs without sight of them too, and comes to a verdict of its own on them.
    needs : tuple of Need
    risks : tuple of Risk
    line : {"usb", "serial"} or None
        The kind of line that it concerns, None for any. A device on USB has a serial line too, its console.
    features : Feature
        Without one of these in INFO it is not applicable.
    should : bool
        Whether it shows a SHOULD: what fails is a warning.
    """

    clauses: tuple[str, ...]
    sentence: str
    outputs: tuple[str, ...] = ()
    needs: tuple[Need, ...] = ()
    risks: tuple[Risk, ...] = ()
    line: LineKind | None = None
    features: Feature = NO_FEATURES
    should: bool = False

    @property
    def at_the_outputs(self) -> Case:
        """The part that only the outputs show, as a case of its own."""
        return replace(self, clauses=self.outputs, outputs=(), needs=(*self.needs, Need.CAPTURE))


def case(
    *clauses: str,
    outputs: Collection[str] = (),
    needs: Collection[Need] = (),
    allow: Collection[Risk] = (),
    line: LineKind | None = None,
    features: Feature = NO_FEATURES,
    should: bool = False,
) -> Callable[[Function], Function]:
    """Make a function a case.

    Parameters
    ----------
    *clauses : str
        What it shows, such as ``BLK-003`` or ``BLK-005/1``.
    outputs, needs, allow, line, features, should
        See `Case`; ``allow`` are its risks.

    Raises
    ------
    ValueError
        Where no clause is named, one of them is unknown, or there is no sentence.
    """

    def mark(function: Function) -> Function:
        if not clauses:
            raise ValueError(f"{function.__name__} names no clause")
        for clause in (*clauses, *outputs):
            resolve(clause)
        sentence = re.sub(r"\s+", " ", inspect.getdoc(function) or "").strip()
        if not sentence:
            raise ValueError(f"{function.__name__} has no sentence that says what it does and why")
        about = Case(clauses, sentence, tuple(outputs), tuple(needs), tuple(allow), line, features, should)
        setattr(function, ATTRIBUTE, about)
        return function

    return mark


def case_of(function: Callable[..., object]) -> Case | None:
    """What a function says of itself as a case, None where it is none."""
    about: Case | None = getattr(function, ATTRIBUTE, None)
    return about


def expect(what: str, seen: object, wanted: object) -> None:
    """Fail unless what was seen is what is wanted.

    Raises
    ------
    AssertionError
        Naming the thing, its value, and what would be right.
    """
    assert seen == wanted, f"{what} is {_shown(seen, wanted)}, should be {_shown(wanted, seen)}"


def _shown(value: object, beside: object) -> str:
    """A value in words; a number beside a code is shown by the code's name, if it has one."""
    match value:
        case bytes() | bytearray():
            return value.hex(" ") or "nothing"
        case list() | tuple():
            other = beside[0] if isinstance(beside, list | tuple) and beside else None
            return f"[{', '.join(_shown(part, other) for part in value)}]"
        case bool():
            return repr(value)
        case int() if isinstance(beside, IntEnum | IntFlag) and not isinstance(value, Enum):
            with suppress(ValueError):
                return _shown(type(beside)(value), value)
        case Flag():
            return value.name or "none"
        case Enum():
            return value.name
    return repr(value)
