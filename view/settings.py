"""What a page may set, and the checks of each value that comes from it.

A session has *groups* of settings: every one has those of the view; what is played, the hand and the objects can be set
only if the session plays them (`Studio`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, cast

__all__ = ["GROUPS", "RANGES", "Choices", "HandSetting", "ObjectSetting", "Settings"]

MOST_WATCHED = 8
MOST_OBJECTS = 8
REACH = 0.5
"""Metres from the axis of the array, to which hands, objects and planes can be moved."""
RANGES: dict[str, tuple[float, float]] = {
    "scale": (1e-9, 1e9),
    "xy_at": (0.03, REACH),
    "xz_at": (-REACH, REACH),
    "yz_at": (-REACH, REACH),
    "at": (0, 2**62),
    "frequency": (20, 1000),
    "amplitude": (0, 1),
    "spacing": (0.003, 0.05),
    "hand.x": (-REACH, REACH),
    "hand.y": (-REACH, REACH),
    "hand.z": (0, REACH),
    "hand.turn": (-180, 180),
    "hand.curl": (0, 1),
    "objects.x": (-REACH, REACH),
    "objects.y": (-REACH, REACH),
    "objects.z": (0, REACH),
    "objects.size": (0.01, 0.5),
    "objects.rotation": (-180, 180),
}
"""Of every number: least and most, in metres, hertz and degrees; of the rest relative."""


@dataclass(frozen=True)
class HandSetting:
    """The hand that a page moves: the middle of its palm in metres, its turn in degrees, how far the fingers bend."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.17
    turn: float = 0.0
    curl: float = 0.0


@dataclass(frozen=True)
class ObjectSetting:
    """An object: its kind, its centre and its longest side in metres, its rotation in degrees."""

    kind: str
    x: float = 0.0
    y: float = 0.0
    z: float = 0.17
    size: float = 0.1
    rotation: float = 0.0


@dataclass(frozen=True)
class Choices:
    """What can be chosen in a session.

    Parameters
    ----------
    groups : frozenset of str
        Those of `GROUPS` that can be set.
    transducers : int
    methods, quantities, object_kinds : tuple of str
    """

    groups: frozenset[str]
    transducers: int
    methods: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    object_kinds: tuple[str, ...] = ()


@dataclass(frozen=True)
class Settings:
    """Everything that a page can set; see `RANGES` for units."""

    quantity: str = "pressure"
    scale: float | None = None
    """Value of the last colour; automatic if None."""
    xy: bool = True
    xz: bool = False
    yz: bool = False
    xy_at: float = 0.17
    xz_at: float = 0.0
    yz_at: float = 0.0
    probe: tuple[float, float, float] | None = None
    pick: int | None = None
    watched: tuple[int, ...] = ()
    at: int | None = None
    """A carrier period of the past, which is shown; None for what happens now."""
    running: bool = True
    """Whether a recording goes on."""
    method: str = "wgs"
    compare: str | None = None
    frequency: float = 200.0
    amplitude: float = 1.0
    spacing: float = 0.015
    corners: bool = True
    silenced: tuple[int, ...] = ()
    hand: HandSetting | None = None
    objects: tuple[ObjectSetting, ...] = field(default=())

    def changed(self, values: Mapping[str, Any], choices: Choices) -> Settings:
        """These settings with others from a page.

        Raises
        ------
        ValueError
            If there is no such setting in the session, or a value is none of its possible ones; the message names it.
        """
        checked: dict[str, Any] = {}
        for name, value in values.items():
            group = _GROUP.get(name)
            if group is None:
                raise ValueError(f"there is no setting {name!r}; there are {', '.join(_GROUP)}")
            if group not in choices.groups:
                raise ValueError(f"{name} cannot be set here: this page only watches")
            checked[name] = _RULES[name](name, value, choices)
        return replace(self, **checked)


GROUPS: Mapping[str, tuple[str, ...]] = {
    "view": (
        "quantity",
        "scale",
        "xy",
        "xz",
        "yz",
        "xy_at",
        "xz_at",
        "yz_at",
        "probe",
        "pick",
        "watched",
        "at",
        "running",
    ),
    "play": ("method", "compare", "frequency", "amplitude", "spacing", "corners", "silenced"),
    "hand": ("hand",),
    "objects": ("objects",),
}
"""The settings of each group."""

_GROUP = {name: group for group, names in GROUPS.items() for name in names}

Rule = Callable[[str, Any, Choices], Any]


def _number(name: str, value: Any, _choices: Choices) -> float:
    least, most = RANGES[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} {value!r} must be a number")
    if not least <= value <= most:
        raise ValueError(f"{name} {value:g} must be from {least:g} to {most:g}")
    return float(value)


def _period(name: str, value: Any, choices: Choices) -> int:
    return int(_number(name, value, choices))


def _flag(name: str, value: Any, _choices: Choices) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{name} {value!r} must be true or false")
    return value


def _among(which: Callable[[Choices], tuple[str, ...]]) -> Rule:
    def check(name: str, value: Any, choices: Choices) -> str:
        known = which(choices)
        if not isinstance(value, str) or value not in known:
            raise ValueError(f"{name} {value!r} must be one of {', '.join(known)}")
        return value

    return check


def _optional(rule: Rule) -> Rule:
    def check(name: str, value: Any, choices: Choices) -> Any:
        return None if value is None else rule(name, value, choices)

    return check


def _transducer(name: str, value: Any, choices: Choices) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < choices.transducers:
        raise ValueError(f"{name} {value!r} must be a transducer, 0 to {choices.transducers - 1}")
    return value


def _transducers(most: int | None) -> Rule:
    def check(name: str, value: Any, choices: Choices) -> tuple[int, ...]:
        limit = choices.transducers if most is None else most
        if not isinstance(value, list) or len(value) > limit:
            raise ValueError(f"{name} must be a list of at most {limit} transducers")
        return tuple(dict.fromkeys(_transducer(name, each, choices) for each in value))

    return check


def _place(name: str, value: Any, _choices: Choices) -> tuple[float, float, float]:
    numbers = isinstance(value, list) and len(value) == 3 and all(type(each) in (int, float) for each in value)
    if not numbers or not all(abs(each) <= 2 * REACH for each in value):
        raise ValueError(f"{name} {value!r} must be three coordinates in metres, at most {2 * REACH:g} each")
    return float(value[0]), float(value[1]), float(value[2])


def _record(name: str, value: Any, choices: Choices, kind: type, rules: Mapping[str, Rule]) -> Any:
    names = [each.name for each in fields(kind)]
    if not isinstance(value, dict) or not set(value) <= set(names):
        raise ValueError(f"{name} {value!r} must have some of {', '.join(names)}, and nothing else")
    checked: dict[str, Any] = {}
    for key, given in value.items():
        rule: Rule = rules.get(key, _number)
        checked[key] = rule(f"{name}.{key}", given, choices)
    return cast("Any", kind)(**checked)


def _hand(name: str, value: Any, choices: Choices) -> HandSetting:
    made: HandSetting = _record(name, value, choices, HandSetting, {})
    return made


def _objects(name: str, value: Any, choices: Choices) -> tuple[ObjectSetting, ...]:
    if not isinstance(value, list) or len(value) > MOST_OBJECTS:
        raise ValueError(f"{name} must be a list of at most {MOST_OBJECTS} objects")
    if any(not isinstance(each, dict) or "kind" not in each for each in value):
        raise ValueError(f"each of {name} must have a kind")
    kind = _among(lambda known: known.object_kinds)
    return tuple(_record(name, each, choices, ObjectSetting, {"kind": kind}) for each in value)


_RULES: Mapping[str, Rule] = {
    "quantity": _among(lambda choices: choices.quantities),
    "scale": _optional(_number),
    "xy": _flag,
    "xz": _flag,
    "yz": _flag,
    "xy_at": _number,
    "xz_at": _number,
    "yz_at": _number,
    "probe": _optional(_place),
    "pick": _optional(_transducer),
    "watched": _transducers(MOST_WATCHED),
    "at": _optional(_period),
    "running": _flag,
    "method": _among(lambda choices: choices.methods),
    "compare": _optional(_among(lambda choices: choices.methods)),
    "frequency": _number,
    "amplitude": _number,
    "spacing": _number,
    "corners": _flag,
    "silenced": _transducers(None),
    "hand": _hand,
    "objects": _objects,
}
