"""What a description holds, and the words that all of them share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from construct import ConstructError

from ...base.errors import ReplyError
from ..plain import plain
from ..pulses import Pulses

__all__ = ["Description", "Violation", "few", "name_of", "plainly", "shortly", "sound"]


class Violation(NamedTuple):
    """Something that breaks the specification.

    Parameters
    ----------
    reason : str
        Name of the code that a device gives for it; empty if it has none.
    clause : str
        The clause that is broken.
    text : str
        What is wrong, for people.
    """

    reason: str
    clause: str
    text: str

    @property
    def said(self) -> str:
        """All of it in words."""
        code = " ".join(filter(None, (self.reason, self.clause)))
        return f"{code}: {self.text}" if code else self.text


@dataclass(frozen=True)
class Description:
    """What some bytes are.

    Parameters
    ----------
    kind : str
        The noun for it: ``block``, ``acknowledgement``, ``status``, ``request``, …
    summary : str
        What it says, in a line.
    fields : mapping
        What can be read of it: names to numbers, texts, and lists and mappings of these.
    findings : tuple of Violation
        What is wrong with it; empty if it is valid.
    pulses : Pulses or None
        The pulses that it carries.
    """

    kind: str
    summary: str
    fields: Mapping[str, Any] = field(default_factory=dict)
    findings: tuple[Violation, ...] = ()
    pulses: Pulses | None = None

    @property
    def valid(self) -> bool:
        """Whether nothing was found that breaks the specification."""
        return not self.findings

    @property
    def line(self) -> str:
        """All that people are told of it, in a line."""
        return "".join([f"{self.kind} {self.summary}", *(f" ✗ {finding.said}" for finding in self.findings)])


def _amount(pulses: Pulses) -> dict[str, Any]:
    """How many pulses are none of silence, the widest of them, and the power of all in fully driven transducers."""
    return {
        "sounding": int(np.count_nonzero(pulses.width)),
        "widest_ticks": int(pulses.width.max()),
        "total_drive": pulses.total_drive / 1000,
    }


plainly = partial(plain, pulses=_amount)
"""A value as JSON can hold it, with no more of pulses than they amount to."""


def sound(pulses: Pulses) -> str:
    """What pulses amount to, in words."""
    amount = _amount(pulses)
    if not amount["sounding"]:
        return "silence"
    return "{sounding} pulses of at most {widest_ticks} ticks, total drive {total_drive:.1f},".format_map(amount)


def name_of(codes: type[Enum], value: object) -> str:
    """Name of a code; the number itself if it has none."""
    return next((code.name for code in codes if code.value == value), f"{value}?")


def few(data: bytes, most: int = 16) -> str:
    """How many bytes there are, and the first of them."""
    size = "1 byte" if len(data) == 1 else f"{len(data)} bytes"
    return size + (f": {data[:most].hex(' ')}" if data else "") + (" …" if len(data) > most else "")


def shortly(error: ReplyError) -> str:
    """What is wrong with an answer, without its bytes."""
    cause = error.__cause__
    if isinstance(cause, ConstructError) and cause.path:
        return f"{cause.path.split(' -> ')[-1]}: {str(cause).splitlines()[-1]}"
    return str(error)
