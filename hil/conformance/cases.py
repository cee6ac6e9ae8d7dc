"""The declaration of a case: its clauses, needs and risks; and the exceptions that give verdicts other than pass.

A case is a pytest function in `groups` with the decorator `case`. The first paragraph of its docstring says what it
does and why. It fails by an `AssertionError`.
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
from .clauses import resolve, revisions

__all__ = [
    "NOT_USB",
    "Case",
    "Inconclusive",
    "Need",
    "NotApplicable",
    "Risk",
    "Row",
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
NOT_USB = "not on this line: it is about USB, and the device is on a serial line"
"""Why a case about USB cannot be judged here."""


class Need(StrEnum):
    """What a bench must be able to observe, or to do to the device's surroundings."""

    CAPTURE = "a capture of the outputs"
    POWER = "power that can be cut"
    SUSPEND = "a bus that can be suspended"
    PLUG = "a cable that can be pulled"
    BUS = "a USB host besides the line of the blocks"
    FAULTS = "faults that can be caused"
    SYNC = "a sync line that another device can drive"
    SPARE = "a second device, which may be broken for good"
    FREE_TIME = "a second device whose time costs nothing, so that hours may pass"


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
    remedies = {
        Need.CAPTURE: "pass --capture sigrok:FILE",
        Need.POWER: "pass --levers command:power=…",
        Need.PLUG: "pass --levers command:cable=…",
        Need.SPARE: "only a device emulated by this command has that",
        Need.FREE_TIME: "only a device that this command emulates by models has that",
    }
    return f"needs {need}: {remedies.get(need, 'pass --levers with one that can do it')}"


class Inconclusive(Exception):
    """The case cannot be judged here; the text says why."""


class TooSlow(Inconclusive):
    """The computer or the line is too slow for the case; with more time it may be judged (`Bench.slow_down`)."""


class NotApplicable(Exception):
    """The device lacks the subject of the case; the text says why."""


@dataclass(frozen=True)
class Case:
    """The declaration of a case."""

    clauses: tuple[str, ...]
    """The clauses that it shows."""
    sentence: str
    """What it does and why."""
    outputs: tuple[str, ...] = ()
    """What only the outputs show of it. The case runs without observed outputs too; the outputs have a verdict of their
    own."""
    needs: tuple[Need, ...] = ()
    risks: tuple[Risk, ...] = ()
    line: LineKind | None = None
    """The kind of line that it is about, None for any. A device on USB has a serial line too, its console."""
    features: Feature = NO_FEATURES
    """If one of these is missing in INFO the case is not applicable."""
    should: bool = False
    """Whether it shows a SHOULD: a failure is a warning."""
    since: int = 1
    """The first revision (clause VER-009) that asks of a device what the case judges."""

    @property
    def at_the_outputs(self) -> Case:
        """The part that only the outputs show, as a case of its own."""
        return replace(self, clauses=self.outputs, outputs=(), needs=(*self.needs, Need.CAPTURE))


@dataclass(frozen=True, kw_only=True)
class Row:
    """What a row of a table of cases needs besides what its cases declare: a parameter of theirs derives from this."""

    clauses: tuple[str, ...] = ()
    needs: tuple[Need, ...] = ()
    risks: tuple[Risk, ...] = ()
    line: LineKind | None = None
    features: Feature = NO_FEATURES
    """See `Case`."""

    def added_to(self, about: Case) -> Case:
        """The declaration of the case with this row."""
        return replace(
            about,
            clauses=about.clauses + self.clauses,
            needs=tuple(dict.fromkeys(about.needs + self.needs)),
            risks=tuple(dict.fromkeys(about.risks + self.risks)),
            line=about.line or self.line,
            features=about.features | self.features,
        )


def case(
    *clauses: str,
    outputs: Collection[str] = (),
    needs: Collection[Need] = (),
    allow: Collection[Risk] = (),
    line: LineKind | None = None,
    features: Feature = NO_FEATURES,
    should: bool = False,
    since: int = 1,
) -> Callable[[Function], Function]:
    """Make a function a case.

    Parameters
    ----------
    *clauses : str
        The clauses that it shows, such as ``BLK-003`` or ``BLK-005/1``.
    outputs, needs, allow, line, features, should, since
        See `Case`; ``allow`` are its risks.

    Raises
    ------
    ValueError
        If no clause is named, one of them is unknown, none of them changed in the revision ``since``, or there is no
        sentence.
    """

    def mark(function: Function) -> Function:
        if not clauses:
            raise ValueError(f"{function.__name__} names no clause")
        for clause in (*clauses, *outputs):
            resolve(clause)
        if since > 1 and not any(since in revisions().get(clause.partition("/")[0], ()) for clause in clauses):
            raise ValueError(f"{function.__name__}: none of {', '.join(clauses)} changed in revision {since} (VER-009)")
        sentence = re.sub(r"\s+", " ", inspect.getdoc(function) or "").strip()
        if not sentence:
            raise ValueError(f"{function.__name__} has no sentence that says what it does and why")
        about = Case(clauses, sentence, tuple(outputs), tuple(needs), tuple(allow), line, features, should, since)
        setattr(function, ATTRIBUTE, about)
        return function

    return mark


def case_of(function: Callable[..., object]) -> Case | None:
    """A function's declaration as a case, None if it is none."""
    about: Case | None = getattr(function, ATTRIBUTE, None)
    return about


def expect(what: str, seen: object, wanted: object) -> None:
    """Fail unless the observed value is the wanted one.

    Raises `AssertionError` with the thing, its value, and the right value.
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
