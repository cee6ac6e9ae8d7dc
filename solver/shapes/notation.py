"""The notation of the command line for things with parameters: ``name:parameter=value,…``.

Each such thing is a dataclass: its fields are the parameters, and their annotations say how they are read.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from ...base.arguments import FARTHEST, length, real, spelt
from ...base.errors import InputFileError

__all__ = ["READERS", "check", "read_parameters", "written"]

# unit of a parameter: how it is written, its name, and the largest value
LENGTH = ("m", "metres", FARTHEST)
_SPEED = ("m/s", "metres per second", 100.0)
UNITS = {
    "rotation": ("degrees", "degrees", 360.0),
    "turn": ("degrees/s", "degrees per second", 36000.0),
    "vx": _SPEED,
    "vy": _SPEED,
    "vz": _SPEED,
    "scale": ("m", "metres for each unit of the file", FARTHEST),
    "depth": ("", "full depth", 1.0),
    "phase": ("degrees", "degrees", 360_000.0),
    "level": ("", "the volume's values", float("inf")),
}


def check(thing: Any, positive: tuple[str, ...] = ()) -> None:
    """Convert the floats of a frozen dataclass; `ValueError` if one is larger than its unit allows, or not positive.

    What must be positive is a size of a shape, at most `WIDEST`.
    """
    for field in dataclasses.fields(thing):
        if field.type != "float":
            continue
        value = getattr(thing, field.name)
        unit, _, largest = UNITS.get(field.name, LENGTH)
        name = f"{type(thing).__name__.lower()} {field.name}"
        if field.name in positive:
            number = length(name, value)
        elif unit == "m":
            number = length(name, value, largest, least=-largest, above=False)
        else:
            number = real(name, value, -largest, largest, unit)
        object.__setattr__(thing, field.name, number)


def written(kind: type[Any]) -> str:
    """The parameters of a dataclass with their defaults."""
    return ",".join(f"{field.name}={_written(field.default)}" for field in dataclasses.fields(kind))


def _written(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return "/".join(":".join(f"{number:g}" for number in vertex) for vertex in value)
    return str(value)


def _read_bool(text: str) -> bool:
    return {"yes": True, "no": False}[text]


def _read_whole(text: str) -> int:
    spelt(text)
    return int(text)


READERS: dict[Any, tuple[Callable[[str], Any], str]] = {
    "float": (spelt, "a number of {unit}"),
    "float | None": (spelt, "a number of {unit}"),
    "int": (_read_whole, "a whole number"),
    "str | None": (str, "a text"),
    "bool": (_read_bool, "yes or no"),
}
"""How a parameter is read from text and what it must be, by its annotation."""


def _with_point(text: str, decimals: str) -> str:
    """The parameter of ``text`` whose ``decimals`` stand after a comma, with a point."""
    before, _, _ = text.partition(f",{decimals}")
    return f"{before.rpartition(',')[2]}.{decimals}"


def read_parameters(name: str, text: str, *kinds: type[Any]) -> dict[str, Any]:
    """Read ``parameter=value,…`` for dataclasses that have no parameter in common.

    `ValueError` if a parameter is unknown or a value is of the wrong kind; the message names both it and ``name``.
    `InputFileError` or `OSError` if a file that a value names cannot be read.
    """
    known = {field.name: field.type for kind in kinds for field in dataclasses.fields(kind)}
    values: dict[str, Any] = {}
    for item in filter(None, text.split(",")):
        key, equals, value = item.partition("=")
        if not equals and values and item.strip().isdigit():
            raise ValueError(f"{name}:{text} has a number with a comma; write a point, as in {_with_point(text, item)}")
        if key not in known:
            raise ValueError(f"{name} has no parameter {key!r}; it has {', '.join(sorted(known))}")
        if key in values:
            raise ValueError(f"{name} {key} is given twice")
        read, what = READERS[known[key]]
        try:
            values[key] = read(value)
        except InputFileError:
            raise
        except (ValueError, KeyError):
            _, unit, _ = UNITS.get(key, LENGTH)
            raise ValueError(f"{name} {key} {value!r} is not {what.format(unit=unit)}") from None
    return values
