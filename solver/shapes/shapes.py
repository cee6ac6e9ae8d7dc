"""Shapes: what should be felt, and its cut into control points. Lengths in metres, rotations in degrees.

A shape is drawn as curves, and one sampler cuts all curves (`curves.sample_curves`). On the command line a shape is
written ``name:parameter=value,…``; `parse_shape` reads that notation.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import flag, spelt, whole
from ...base.errors import InputFileError
from ...base.pictures import Drawable
from ..geometry import Scalable, as_points, counted
from .curves import SPACING, Curve, chain, even_spacing, ring, sample_curves, without_coincidences
from .notation import READERS, check, read_parameters, written
from .point_files import POINT_FILES, read_points
from .points import MAX_POINTS, ControlPoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "SHAPES",
    "Asterisk",
    "Circle",
    "Concentric",
    "Drawing",
    "Drawn",
    "Polygon",
    "Polyline",
    "Rings",
    "Shape",
    "Sphere",
    "Star",
    "known_shapes",
    "parse_shape",
    "shape_help",
]

Vertices: TypeAlias = tuple[tuple[float, ...], ...]


@runtime_checkable
class Shape(Protocol):
    """Anything that can be sampled into control points."""

    def sample(self, spacing: float | None = None) -> ControlPoints:
        """Control points every ``spacing`` metres of arc, or as the shape prefers."""


@dataclass(frozen=True, eq=False)
class Strokes:
    """Curves that are cut together.

    Parameters
    ----------
    curves : tuple of Curve
        One curve or more.
    count : int or None
        How many points they share if no spacing is asked for. None means one every `SPACING`.
    """

    curves: tuple[Curve, ...]
    count: int | None

    def sample(self, spacing: float | None = None) -> ControlPoints:
        """Their control points; parameters and errors are those of `Drawn.sample`."""
        if spacing is None:
            spacing = SPACING if self.count is None else even_spacing(self.curves, self.count)
        return sample_curves(self.curves, spacing)

    def placed(self, matrix: NDArray[np.float64], offset: NDArray[np.float64]) -> Strokes:
        """The same curves elsewhere."""
        return Strokes(tuple(curve.placed(matrix, offset) for curve in self.curves), self.count)


class Drawn(Scalable["Drawing"], Drawable):
    """A shape that is drawn as curves.

    A copy in another place is a `Drawing`, and so is a sum with other shapes or control points.

    Attributes
    ----------
    count : int or None
        How many control points it has if no spacing is asked for, as in the paper's Figure 6. None means one
        every `SPACING`.
    """

    count: ClassVar[int | None] = None

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw its control points, as `ControlPoints.plot` does."""
        return self.sample().plot(ax, **style)

    @abstractmethod
    def curves(self) -> tuple[Curve, ...]:
        """The curves, in the order of their points."""

    def sample(self, spacing: float | None = None) -> ControlPoints:
        """Control points, equally spaced along each curve.

        Parameters
        ----------
        spacing : float, optional
            Arc length between neighbours in metres, met as nearly as whole numbers allow. By default the shape has its
            own `count` of points, or one every `SPACING`.

        Raises
        ------
        ValueError
            If the spacing is not positive, or so small that there are too many points.
        """
        return Strokes(self.curves(), self.count).sample(spacing)

    @cached_property
    def centre(self) -> NDArray[np.float64]:
        """(3,) mean of the control points that it has if no spacing is asked for, in metres."""
        return self.sample().centre

    @property
    def parts(self) -> tuple[Strokes | ControlPoints, ...]:
        """What it is sampled from, one after the other."""
        return (Strokes(self.curves(), self.count),)

    def placed(self, matrix: NDArray[np.float64], offset: NDArray[np.float64]) -> Drawing:
        """The shape whose points x are at ``matrix @ x + offset``; `moved`, `rotated` and `scaled` use it."""
        return Drawing(tuple(part.placed(matrix, offset) for part in self.parts))

    def __add__(self, other: Drawn | ControlPoints) -> Drawing:
        """A shape of both: this one's points come first."""
        return Drawing(self.parts + _parts(other)) if isinstance(other, (Drawn, ControlPoints)) else NotImplemented

    def __radd__(self, other: ControlPoints | int) -> Drawn:
        """A shape of both; ``sum`` begins with 0."""
        if isinstance(other, ControlPoints):
            return Drawing(_parts(other) + self.parts)
        return self if isinstance(other, int) and other == 0 else NotImplemented


def _parts(shape: Drawn | ControlPoints) -> tuple[Strokes | ControlPoints, ...]:
    return shape.parts if isinstance(shape, Drawn) else (shape,)


class Drawing(Drawn):
    """A shape of parts: moved, rotated or scaled shapes, and sums of shapes and control points.

    Examples
    --------
    >>> eyes = Circle(0.01).moved((-0.02, 0.02, 0)) + Circle(0.01).moved((0.02, 0.02, 0))
    >>> face = eyes + ControlPoints([[0, 0, 0.2]], amplitudes=0.5) + Circle(0.05)
    >>> len(face.sample(0.01)), face.rotated(90)
    (44, Drawing(30 points))
    """

    def __init__(self, parts: tuple[Strokes | ControlPoints, ...]) -> None:
        self._parts = parts

    def __repr__(self) -> str:
        return f"Drawing({counted(len(self.sample()), 'point')})"

    @property
    def parts(self) -> tuple[Strokes | ControlPoints, ...]:
        """The strokes and points."""
        return self._parts

    def curves(self) -> tuple[Curve, ...]:
        """The curves of all parts; control points have none."""
        return tuple(curve for part in self._parts if isinstance(part, Strokes) for curve in part.curves)

    def sample(self, spacing: float | None = None) -> ControlPoints:
        """The control points of the parts, one after the other; points that coincide are one.

        Parameters and errors are those of `Drawn.sample`.
        """
        sampled = [part.sample(spacing) for part in self._parts]
        positions = np.concatenate([part.positions for part in sampled])
        amplitudes = np.concatenate([part.amplitudes for part in sampled])
        return without_coincidences(ControlPoints.trusted(positions, amplitudes))


def _spokes(
    x: float, y: float, height: float, radii: list[float], rotation: float, first: float = 90.0
) -> NDArray[np.float64]:
    """(k, 3) points at the given distances from a centre, in k equally spaced directions, counterclockwise.

    ``first`` is the direction of the first one before the rotation, in degrees from the x axis.
    """
    angle = math.radians(first + rotation) + 2 * np.pi * np.arange(len(radii)) / len(radii)
    distance = np.array(radii)
    return np.stack([x + distance * np.cos(angle), y + distance * np.sin(angle), np.full(len(radii), height)], axis=1)


@dataclass(frozen=True)
class Circle(Drawn):
    """A horizontal circle.

    Parameters
    ----------
    radius : float
        Radius of the circle.
    height, x, y : float
        Height of its plane above the array, and place of its centre.
    """

    radius: float = 0.04
    height: float = 0.20
    x: float = 0.0
    y: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, positive=("radius", "height"))

    def curves(self) -> tuple[Curve, ...]:
        """The circle."""
        return (ring(self.x, self.y, self.height, self.radius),)


@dataclass(frozen=True)
class Sphere(Drawn):
    """A sphere, felt where a flat palm cuts it.

    Parameters
    ----------
    radius : float
        Radius of the sphere.
    height : float
        Height of its centre above the array.
    palm : float
        Height of the palm above the array.
    x, y : float
        Place of its centre.

    Raises
    ------
    ValueError
        If the palm does not cut the sphere.
    """

    radius: float = 0.05
    height: float = 0.17
    palm: float = 0.20
    x: float = 0.0
    y: float = 0.0

    def __post_init__(self) -> None:
        """Check that there is something to feel."""
        check(self, positive=("radius", "height", "palm"))
        if self._cut_radius_squared <= 0:
            low, high = self.height - self.radius, self.height + self.radius
            raise ValueError(f"a palm at {self.palm:g} m misses the sphere, which spans {low:g} to {high:g} m")

    def cut(self) -> Circle:
        """The circle that the palm feels."""
        return Circle(math.sqrt(self._cut_radius_squared), self.palm, self.x, self.y)

    @property
    def _cut_radius_squared(self) -> float:
        return self.radius**2 - (self.palm - self.height) ** 2

    def curves(self) -> tuple[Curve, ...]:
        """The circle that the palm feels."""
        return self.cut().curves()


@dataclass(frozen=True)
class Polygon(Drawn):
    """A horizontal regular polygon; by default the square of the paper's Figure 4, 10 cm wide.

    Parameters
    ----------
    sides : int
        Number of sides, at least 3.
    radius : float
        Distance from the centre to a corner.
    rotation : float
        Counterclockwise, in degrees; without it, one side faces -y.
    height, x, y : float
        Height of its plane above the array, and place of its centre.
    """

    sides: int = 4
    radius: float = 0.07071
    rotation: float = 0.0
    height: float = 0.20
    x: float = 0.0
    y: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        object.__setattr__(self, "sides", whole("polygon sides", self.sides, 3, MAX_POINTS))
        check(self, positive=("radius", "height"))

    def curves(self) -> tuple[Curve, ...]:
        """The outline, from the right end of the side that faces -y."""
        corners = [self.radius] * self.sides
        first = 180 / self.sides - 90
        vertices = _spokes(self.x, self.y, self.height, corners, self.rotation, first)
        return (chain(vertices, closed=True, sides=self.sides),)


@dataclass(frozen=True)
class Polyline(Drawn):
    """Straight pieces from vertex to vertex, anywhere in space.

    Parameters
    ----------
    vertices : (v, 3) float
        The corners, kept as a tuple of tuples. On the command line ``x:y:z/x:y:z/…``, or the name of a file of points.
    closed : bool
        Whether a last piece leads back to the first vertex.
    """

    vertices: Vertices = ((-0.04, 0.0, 0.2), (0.0, 0.04, 0.2), (0.04, 0.0, 0.2))
    closed: bool = False

    def __post_init__(self) -> None:
        """Check that there is a line."""
        rows = as_points(self.vertices, "polyline corner").tolist()
        object.__setattr__(self, "vertices", tuple(tuple(row) for row in rows))
        object.__setattr__(self, "closed", flag("polyline closed", self.closed))
        self.curves()

    def __repr__(self) -> str:
        return f"Polyline({len(self.vertices)} corners, {'closed' if self.closed else 'open'})"

    def curves(self) -> tuple[Curve, ...]:
        """The line, from the first vertex. It has no sides: its corners need not be among the points."""
        return (chain(self.vertices, closed=self.closed),)


@dataclass(frozen=True)
class Rings(Drawn):
    """Two intersecting rings, the paper's Figure 6.1: 16 + 16 points.

    Parameters
    ----------
    radius : float
        Radius of each ring.
    distance : float
        Distance of their centres, which lie on both sides along x; less than two radii.
    height, x, y : float
        Height of their plane above the array, and place of the middle.

    Notes
    -----
    Each begins at its outermost point. With the default ratio the rings cross in the middle between samples; the paper
    gives no sizes.
    """

    radius: float = 0.032
    distance: float = 0.036
    height: float = 0.20
    x: float = 0.0
    y: float = 0.0

    count: ClassVar[int | None] = 32

    def __post_init__(self) -> None:
        """Check that they intersect."""
        check(self, positive=("radius", "distance", "height"))
        if self.distance >= 2 * self.radius:
            raise ValueError(
                f"rings of radius {self.radius:g} m do not intersect at a distance of {self.distance:g} m; it must be "
                f"less than {2 * self.radius:g} m"
            )

    def curves(self) -> tuple[Curve, ...]:
        """The right ring and the left one."""
        right, left = self.x + self.distance / 2, self.x - self.distance / 2
        return (
            ring(right, self.y, self.height, self.radius),
            ring(left, self.y, self.height, self.radius, start=math.pi),
        )


@dataclass(frozen=True)
class Star(Drawn):
    """A five-pointed star, the paper's Figure 6.2: 30 points, three on each of its ten sides.

    Parameters
    ----------
    radius : float
        Distance from the centre to a tip.
    rotation : float
        Counterclockwise, in degrees; without it, a tip faces +y.
    height, x, y : float
        Height of its plane above the array, and place of its centre.

    Notes
    -----
    The outline of the pentagram: its inner corners lie at cos 72°/cos 36° = 0.382 of the radius.
    """

    radius: float = 0.05
    rotation: float = 0.0
    height: float = 0.20
    x: float = 0.0
    y: float = 0.0

    count: ClassVar[int | None] = 30

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, positive=("radius", "height"))

    def curves(self) -> tuple[Curve, ...]:
        """The outline, from the first tip."""
        inner = self.radius * math.cos(math.radians(72)) / math.cos(math.radians(36))
        vertices = _spokes(self.x, self.y, self.height, [self.radius, inner] * 5, self.rotation)
        return (chain(vertices, closed=True, sides=10),)


@dataclass(frozen=True)
class Concentric(Drawn):
    """Two concentric circles, the paper's Figure 6.3: 24 + 8 points.

    Parameters
    ----------
    outer, inner : float
        Radii. At the default ratio of three, 24 and 8 points are equally spaced.
    height, x, y : float
        Height of their plane above the array, and place of the centre.
    """

    outer: float = 0.045
    inner: float = 0.015
    height: float = 0.20
    x: float = 0.0
    y: float = 0.0

    count: ClassVar[int | None] = 32

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, positive=("outer", "inner", "height"))
        if self.inner >= self.outer:
            raise ValueError(f"concentric inner {self.inner} m must be less than outer {self.outer} m")

    def curves(self) -> tuple[Curve, ...]:
        """The outer circle and the inner one."""
        return tuple(ring(self.x, self.y, self.height, radius) for radius in (self.outer, self.inner))


@dataclass(frozen=True)
class Asterisk(Drawn):
    """An asterisk with six arms, the paper's Figure 6.4: 21 points.

    Parameters
    ----------
    radius : float
        Distance from the centre to the tips.
    rotation : float
        Counterclockwise, in degrees; without it, an arm faces +y.
    height, x, y : float
        Height of its plane above the array, and place of the centre.

    Notes
    -----
    The paper does not show how 21 points make six arms. Three strokes of seven would meet in one threefold point, and
    six arms with a common centre have 6k + 1. Here all points lie on three straight strokes of length 2·radius, cut
    into seven equal steps each: of the six points around the centre, which would crowd at a seventh of the radius,
    every other one is left out. So the arms have four and three points in turn, the tips are equal, and no two points
    are closer than 0.247 radii.
    """

    radius: float = 0.05
    rotation: float = 0.0
    height: float = 0.20
    x: float = 0.0
    y: float = 0.0

    count: ClassVar[int | None] = 21

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, positive=("radius", "height"))

    def curves(self) -> tuple[Curve, ...]:
        """The six arms, each from its tip inwards."""
        tips = _spokes(self.x, self.y, self.height, [self.radius] * 6, self.rotation)
        ends = _spokes(self.x, self.y, self.height, [self.radius / 7, self.radius * 3 / 7] * 3, self.rotation)
        return tuple(chain([tip, end]) for tip, end in zip(tips, ends, strict=True))


SHAPES: dict[str, type[Any]] = {
    "circle": Circle,
    "sphere": Sphere,
    "polygon": Polygon,
    "polyline": Polyline,
    "rings": Rings,
    "star": Star,
    "concentric": Concentric,
    "asterisk": Asterisk,
}
"""Shapes by name: dataclasses that are a `Shape`. A float is a length in metres unless `UNITS` says otherwise."""


def shape_help() -> str:
    """One line per shape: its name and its parameters with their defaults."""
    return "\n".join(f"{name}:{written(shape)}" for name, shape in SHAPES.items())


def read_vertices(text: str) -> Vertices:
    """Places from text, ``x:y:z/x:y:z/…`` in metres, or from the file of points that it names.

    `ValueError` if it is neither; `InputFileError` or `OSError` if the file cannot be read, or its points have
    amplitudes.
    """
    if Path(text).suffix.lower() not in POINT_FILES:
        return tuple(tuple(spelt(number) for number in vertex.split(":")) for vertex in text.split("/"))
    points = read_points(text)
    if (points.amplitudes != 1).any():
        raise InputFileError(f"{text}: the vertices of a line have no amplitudes")
    return tuple(tuple(row) for row in points.positions.tolist())


READERS["Vertices"] = (
    read_vertices,
    f"x:y:z/x:y:z/... in metres or the name of a file of points ({', '.join(POINT_FILES)})",
)


def known_shapes(name: str) -> str:
    """The shapes for the error about a name that is none, those with a similar name first."""
    near = get_close_matches(name.lower(), SHAPES, 3)
    return f"did you mean {' or '.join(near)}? " * bool(near) + f"known are {', '.join(sorted(SHAPES))}"


def parse_shape(text: str) -> Drawn:
    """Read a shape such as ``sphere`` or ``polygon:sides=5,radius=0.05``.

    Raises
    ------
    ValueError
        If the shape or a parameter is unknown, or a value is of the wrong kind; the message names it.
    InputFileError, OSError
        If a file that it names cannot be read.
    """
    name, _, parameters = text.partition(":")
    if name not in SHAPES:
        raise ValueError(f"unknown shape {name!r}; {known_shapes(name)}")
    shape: Drawn = SHAPES[name](**read_parameters(name, parameters, SHAPES[name]))
    return shape
