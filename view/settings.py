"""What a page may set, and the check of each value that comes from it.

Settings are in *groups*. Those of the group ``view`` can always be set. What is played, the hand and the objects can be
set only if the session plays them (`Studio`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

__all__ = ["FOLLOWED", "GROUPS", "RANGES", "Choices", "HandSetting", "ObjectSetting", "Settings"]

MOST_WATCHED = 8
MOST_OBJECTS = 8
FOLLOWED = ("palm", "points")
"""What the horizontal plane can follow: the middle of a palm, or the points that are touched."""
REACH = 1.0
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
    "objects.size": (0.005, 2),
    "objects.rotation": (-180, 180),
}
"""Least and most of every number: lengths in metres, frequencies in hertz, angles in degrees, ``at`` in carrier
periods, ``scale`` in the unit of the quantity, the others without a unit."""


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
    number: int | None = None
    """Which object of the command it is: it keeps that one's motion. None for one that a page has added."""


@dataclass(frozen=True)
class Choices:
    """What can be chosen in a session: which `GROUPS`, how many transducers there are, and the values of others."""

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
    """Value of the last colour; None for a scale that follows the field."""
    xy: bool = True
    xz: bool = False
    yz: bool = False
    xy_at: float = 0.17
    xz_at: float = 0.0
    yz_at: float = 0.0
    follow: str | None = None
    """Of `FOLLOWED`, that at whose height the horizontal plane is; None for a plane at ``xy_at``."""
    probe: tuple[float, float, float] | None = None
    pick: int | None = None
    watched: tuple[int, ...] = ()
    at: int | None = None
    """The carrier period that is shown; None for now."""
    running: bool = True
    """Whether a recording plays."""
    method: str = "wgs"
    compare: str | None = None
    frequency: float = 200.0
    amplitude: float = 1.0
    spacing: float = 0.015
    corners: bool = True
    silenced: tuple[int, ...] = ()
    hand: HandSetting | None = None
    objects: tuple[ObjectSetting, ...] = ()

    def changed(self, values: Mapping[str, Any], choices: Choices) -> Settings:
        """These settings with others from a page.

        `ValueError` if the session has no such setting, or a value is not possible; the message names it.
        """
        checked: dict[str, Any] = {}
        for name, value in values.items():
            group = next((group for group, rules in GROUPS.items() if name in rules), None)
            if group is None:
                raise ValueError(f"there is no setting {name!r}; there are {', '.join(vars(self))}")
            if group not in choices.groups:
                raise ValueError(f"{name} cannot be set here: this page only watches")
            checked[name] = GROUPS[group][name](name, value, choices)
        return replace(self, **checked)


Rule = Callable[[str, Any, Choices], Any]


def _number(name: str, value: Any, _choices: Choices) -> float:
    least, most = RANGES[name]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} {value!r} must be a number")
    if not least <= value <= most:  # nor is NaN
        raise ValueError(f"{name} {str(value)[:20]} must be from {least:g} to {most:g}")
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


def _below(most: Callable[[Choices], int], what: str) -> Rule:
    def check(name: str, value: Any, choices: Choices) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < most(choices):
            raise ValueError(f"{name} {str(value)[:20]} must be {what}, 0 to {most(choices) - 1}")
        return value

    return check


_transducer = _below(lambda choices: choices.transducers, "a transducer")


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
        raise ValueError(f"{name} {str(value)[:80]} must be three coordinates in metres, at most {2 * REACH:g} each")
    return float(value[0]), float(value[1]), float(value[2])


def _fields(
    name: str, value: Any, choices: Choices, known: tuple[str, ...], rules: Mapping[str, Rule]
) -> dict[str, Any]:
    """The checked fields of a record; those without a rule of their own are numbers."""
    if not isinstance(value, dict) or not set(value) <= set(known):
        raise ValueError(f"{name} {str(value)[:80]} must have some of {', '.join(known)}, and nothing else")
    checked: dict[str, Any] = {}
    for key, given in value.items():
        rule: Rule = rules.get(key, _number)
        checked[key] = rule(f"{name}.{key}", given, choices)
    return checked


def _hand(name: str, value: Any, choices: Choices) -> HandSetting:
    known = tuple(field.name for field in fields(HandSetting))
    return HandSetting(**_fields(name, value, choices, known, {}))


def _objects(name: str, value: Any, choices: Choices) -> tuple[ObjectSetting, ...]:
    if not isinstance(value, list) or len(value) > MOST_OBJECTS:
        raise ValueError(f"{name} must be a list of at most {MOST_OBJECTS} objects")
    if any(not isinstance(each, dict) or "kind" not in each for each in value):
        raise ValueError(f"each of {name} must have a kind")
    known = tuple(field.name for field in fields(ObjectSetting))
    rules = {
        "kind": _among(lambda choices: choices.object_kinds),
        "number": _optional(_below(lambda _: MOST_OBJECTS, "the number of an object")),
    }
    return tuple(ObjectSetting(**_fields(name, each, choices, known, rules)) for each in value)


GROUPS: Mapping[str, Mapping[str, Rule]] = {
    "view": {
        "quantity": _among(lambda choices: choices.quantities),
        "scale": _optional(_number),
        "xy": _flag,
        "xz": _flag,
        "yz": _flag,
        "xy_at": _number,
        "xz_at": _number,
        "yz_at": _number,
        "follow": _optional(_among(lambda _: FOLLOWED)),
        "probe": _optional(_place),
        "pick": _optional(_transducer),
        "watched": _transducers(MOST_WATCHED),
        "at": _optional(_period),
        "running": _flag,
    },
    "play": {
        "method": _among(lambda choices: choices.methods),
        "compare": _optional(_among(lambda choices: choices.methods)),
        "frequency": _number,
        "amplitude": _number,
        "spacing": _number,
        "corners": _flag,
        "silenced": _transducers(None),
    },
    "hand": {"hand": _hand},
    "objects": {"objects": _objects},
}
"""The settings of each group, with their rules."""
