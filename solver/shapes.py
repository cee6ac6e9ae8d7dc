"""Shapes: what should be felt, and its cut into control points. Lengths in metres.

On the command line a shape is written ``name:parameter=value,…``; `parse_shape` reads that notation.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .geometry import FARTHEST
from .points import MAX_POINTS, ControlPoints

__all__ = ["SHAPES", "SPACING", "Circle", "Shape", "Sphere", "parse_shape", "shape_help"]

SPACING = 0.015
"""Arc length between control points in metres, the paper's section 5."""


class Shape(Protocol):
    """Anything that can be sampled into control points."""

    def sample(self, spacing: float = SPACING) -> ControlPoints:
        """Control points every ``spacing`` metres of arc."""


def _check(shape: Any, positive: tuple[str, ...]) -> None:
    for field in dataclasses.fields(shape):
        value = getattr(shape, field.name)
        if not abs(value) <= FARTHEST or (field.name in positive and value <= 0):
            rule = "positive and at most" if field.name in positive else "at most"
            name = f"{type(shape).__name__.lower()} {field.name}"
            raise ValueError(f"{name} {value} m must be {rule} {FARTHEST:g} m")


@dataclass(frozen=True)
class Circle:
    """A horizontal circle.

    Parameters
    ----------
    radius : float
        Of the circle.
    height : float
        Of its plane above the array.
    x, y : float
        Of its centre.
    """

    radius: float = 0.04
    height: float = 0.20
    x: float = 0.0
    y: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check(self, positive=("radius", "height"))

    def sample(self, spacing: float = SPACING) -> ControlPoints:
        """Equally spaced points, as near to every ``spacing`` metres of arc as a closed curve allows."""
        if not 0 < spacing < math.inf:
            raise ValueError(f"spacing {spacing} m must be positive and finite")
        steps = 2 * math.pi * self.radius / spacing
        if steps > MAX_POINTS:
            raise ValueError(f"spacing {spacing} m makes {steps:.3g} control points; at most {MAX_POINTS} are possible")
        count = max(1, round(steps))
        angle = 2 * np.pi * np.arange(count) / count
        x, y = self.x + self.radius * np.cos(angle), self.y + self.radius * np.sin(angle)
        return ControlPoints(np.stack([x, y, np.full(count, self.height)], axis=1))


@dataclass(frozen=True)
class Sphere:
    """A sphere, felt where a flat palm cuts it.

    Parameters
    ----------
    radius : float
        Of the sphere.
    height : float
        Of its centre above the array.
    palm : float
        Height of the palm above the array.
    x, y : float
        Of its centre.

    Raises
    ------
    ValueError
        Where the palm does not cut the sphere.
    """

    radius: float = 0.05
    height: float = 0.17
    palm: float = 0.20
    x: float = 0.0
    y: float = 0.0

    def __post_init__(self) -> None:
        """Check that there is something to feel."""
        _check(self, positive=("radius", "height", "palm"))
        if self._cut_radius_squared <= 0:
            low, high = self.height - self.radius, self.height + self.radius
            raise ValueError(f"a palm at {self.palm:g} m misses the sphere, which spans {low:g} to {high:g} m")

    def cut(self) -> Circle:
        """The circle that the palm feels."""
        return Circle(math.sqrt(self._cut_radius_squared), self.palm, self.x, self.y)

    @property
    def _cut_radius_squared(self) -> float:
        return self.radius**2 - (self.palm - self.height) ** 2

    def sample(self, spacing: float = SPACING) -> ControlPoints:
        """Control points along the cut, every ``spacing`` metres of arc."""
        return self.cut().sample(spacing)


SHAPES: dict[str, type[Any]] = {"circle": Circle, "sphere": Sphere}
"""Shapes by name: dataclasses of lengths in metres that are a `Shape`."""


def shape_help() -> str:
    """One line per shape: its name and its parameters with their defaults."""
    return "\n".join(
        f"{name}:" + ",".join(f"{field.name}={field.default}" for field in dataclasses.fields(shape))
        for name, shape in SHAPES.items()
    )


def parse_shape(text: str) -> Shape:
    """Read a shape such as ``sphere`` or ``sphere:radius=0.05,palm=0.2``.

    Raises
    ------
    ValueError
        That names the unknown shape or parameter, or the value that is no number.
    """
    name, _, parameters = text.partition(":")
    if name not in SHAPES:
        raise ValueError(f"unknown shape {name!r}; known are {', '.join(sorted(SHAPES))}")
    known = {field.name for field in dataclasses.fields(SHAPES[name])}
    values: dict[str, float] = {}
    for item in filter(None, parameters.split(",")):
        key, _, value = item.partition("=")
        if key not in known:
            raise ValueError(f"{name} has no parameter {key!r}; it has {', '.join(sorted(known))}")
        if key in values:
            raise ValueError(f"{name} {key} is given twice")
        try:
            values[key] = float(value)
        except ValueError:
            raise ValueError(f"{name} {key} {value!r} is not a number of metres") from None
    shape: Shape = SHAPES[name](**values)
    return shape
