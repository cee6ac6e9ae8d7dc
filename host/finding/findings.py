"""What a check of the doctor comes to."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import NamedTuple

__all__ = [
    "CLEAR_FAULTS",
    "FLASH",
    "RESET",
    "CheckVerdict",
    "Finding",
    "Judgement",
    "fail",
    "listed",
    "ok",
    "skipped",
    "warn",
]

MOST_LISTED = 4
CLEAR_FAULTS, RESET, FLASH = (
    f"phasewire {command} --device URL" for command in ("clear-faults", "reset", "flash IMAGE")
)
"""Commands that an advice may name, of whatever device is examined."""


class CheckVerdict(StrEnum):
    """What a check comes to."""

    OK = "ok"
    WARN = "warn"
    """It works, but not as it should."""
    FAIL = "fail"
    SKIPPED = "skipped"
    """It could not be made, or has no meaning here."""


class Judgement(NamedTuple):
    """What a check comes to, what it saw, and what to do about it, if there is anything."""

    verdict: CheckVerdict
    seen: str
    advice: str = ""


class Finding(NamedTuple):
    """A judgement under the name of its check, one of `CHECKS`."""

    name: str
    verdict: CheckVerdict
    seen: str
    advice: str = ""


def ok(seen: str) -> Judgement:
    """All is well."""
    return Judgement(CheckVerdict.OK, seen)


def warn(seen: str, advice: str) -> Judgement:
    """It works, but not as it should."""
    return Judgement(CheckVerdict.WARN, seen, advice)


def fail(seen: str, advice: str) -> Judgement:
    """It does not work."""
    return Judgement(CheckVerdict.FAIL, seen, advice)


def skipped(why: str) -> Judgement:
    """Nothing can be said."""
    return Judgement(CheckVerdict.SKIPPED, why)


def listed(words: Iterable[str], separator: str = ", ") -> str:
    """The first few of many."""
    every = list(words)
    more = len(every) - MOST_LISTED
    return separator.join(every[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
