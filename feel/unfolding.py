"""The places of skin that are asked: a regular grid over a hand that is laid out flat, or over a plane patch.

Waves travel along skin, not through the air between bent fingers. So a hand is unfolded: its palm and its straightened
fingers lie in one plane, with the lengths and breadths that they have, and spread as in the mean open hand. A place of
the grid within one of the sixteen quadrilaterals belongs to the place of the real hand from which it came.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import length
from ..solver.contact.anatomy import posed
from ..solver.contact.hand import Hand
from ..solver.contact.silhouette import silhouette
from ..solver.geometry import as_position, counted, frozen

__all__ = ["SkinPatch", "SkinPlaces", "Unfolded"]

SPACING = 2.7e-3
"""Metres between places: some 2000 on a mean hand. The radiation pressure of a focus has no finer structure than λ/2 at
40 kHz, 4.3 mm, so it is sampled more than once per half of that."""
MOST_PLACES = 200_000


class SkinPlaces(Protocol):
    """Places of skin on a regular grid."""

    @property
    def positions(self) -> NDArray[np.float64]:
        """(k, 3) in metres."""

    @property
    def normals(self) -> NDArray[np.float64]:
        """(k, 3) unit vectors out of the skin."""

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(y, x) the cells of the grid that are skin, k of them, in the order of the places, row by row."""

    @property
    def spacing(self) -> float:
        """Of the grid, in metres."""

    @property
    def outline(self) -> list[NDArray[np.float64]]:
        """Closed lines (n, 2) around the skin, as it is drawn: x and y from the grid's corner, in metres."""


@dataclass(frozen=True, eq=False)
class SkinPatch:
    """A level rectangle of skin that faces down, as the middle of a palm over the array.

    Parameters
    ----------
    centre : (3,) float
        Middle in metres.
    width, length : float
        Extent along x and along y, in metres.
    spacing : float
        Spacing of the places, in metres; the outermost ones lie on the border, or within less than that of it.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    centre: tuple[float, float, float] = (0.0, 0.0, 0.2)
    width: float = 0.08
    length: float = 0.08
    spacing: float = 2e-3

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_position(self.centre, "centre of skin")
        for name in ("width", "length", "spacing"):
            object.__setattr__(self, name, length(f"{name} of skin", getattr(self, name)))
        _check_count(self.width * self.length, self.spacing)

    def __repr__(self) -> str:
        rows, columns = self.mask.shape
        return f"SkinPatch({rows} × {columns} places, {self.spacing * 1e3:g} mm apart)"

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """(y, x) all True."""
        return frozen(np.ones([int(side / self.spacing + 1e-9) + 1 for side in (self.length, self.width)], dtype=bool))

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """(k, 3) in metres, row by row, x first."""
        y, x = ((np.arange(count) - (count - 1) / 2) * self.spacing for count in self.mask.shape)
        grid_x, grid_y = np.meshgrid(x, y)
        return frozen(np.stack([grid_x.ravel(), grid_y.ravel(), 0 * grid_x.ravel()], axis=1) + self.centre)

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """(k, 3) all down."""
        return frozen(np.tile([0.0, 0.0, -1.0], (self.mask.size, 1)))

    @cached_property
    def outline(self) -> list[NDArray[np.float64]]:
        """The rectangle of all cells."""
        rows, columns = self.mask.shape
        return [frozen(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]]) * self.spacing)]


@dataclass(frozen=True, eq=False)
class Unfolded:
    """The palmar skin of a hand, laid out flat.

    Parameters
    ----------
    hand : Hand
        The hand, placed.
    quads : (k,) int
        The quadrilateral of `Hand.quads` in which each place lies.
    shares : (k, 2) float
        The places in it: parts of the way from its base left corner to its base right one, and to its tip left one.
    mask : (y, x) bool
        The cells of the grid that are skin, seen on the back of the hand, the fingertips at the end of y; k are True.
    spacing : float
        Step of the grid, in metres.
    """

    hand: Hand
    quads: NDArray[np.int64]
    shares: NDArray[np.float64]
    mask: NDArray[np.bool_]
    spacing: float

    @classmethod
    def of(cls, hand: Hand, spacing: float = SPACING) -> Self:
        """Unfold a hand, with so many metres between places.

        Raises
        ------
        ValueError
            If the spacing is not positive, or so small that there were more than `MOST_PLACES` places.
        """
        spacing = length("spacing of skin", spacing)
        flat = _laid_out(hand)
        least = flat.min(axis=(0, 1))
        span = flat.max(axis=(0, 1)) - least
        _check_count(float(span.prod()), spacing)
        columns, rows = np.ceil(span / spacing).astype(int)
        x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        cells = np.stack([x.ravel(), y.ravel()], axis=1) * spacing + least
        owner = np.full(len(cells), -1)
        for quad in range(len(flat))[::-1]:  # where two overlap, as thumb and palm do, the first one has the place
            owner[_inside(flat[quad], cells)] = quad
        found = owner >= 0
        quads = owner[found]
        corner, sides = flat[quads, 0], flat[quads][:, (1, 3)] - flat[quads, :1]
        shares = np.linalg.solve(sides.transpose(0, 2, 1), (cells[found] - corner)[..., None])[..., 0]
        return cls(hand, frozen(quads), frozen(shares), frozen(found.reshape(rows, columns)), spacing)

    def __repr__(self) -> str:
        return (
            f"Unfolded({counted(len(self.quads), 'place')} of a {self.hand.side} hand, {self.spacing * 1e3:g} mm apart)"
        )

    def at(self, hand: Hand) -> Self:
        """The same places of skin, of the same hand in another pose."""
        return dataclasses.replace(self, hand=hand)

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """(k, 3) on the real hand, in metres."""
        corners = self.hand.quads[self.quads]
        sides = corners[:, (1, 3)] - corners[:, :1]
        return frozen(corners[:, 0] + np.einsum("ks,ksi->ki", self.shares, sides))

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """(k, 3) unit vectors out of the palmar side of the real hand."""
        quads = self.hand.quads
        out = np.cross(quads[:, 3] - quads[:, 0], quads[:, 1] - quads[:, 0])
        return frozen((out / np.linalg.norm(out, axis=1, keepdims=True))[self.quads])

    @cached_property
    def outline(self) -> list[NDArray[np.float64]]:
        """The hand as it is drawn, `silhouette`; the quadrilaterals that feel lie in it but for their corners."""
        flat = _laid_out(self.hand)
        fingers = flat[1:].reshape(5, 3, 4, 2)
        bases, tips = fingers[:, :, :2].mean(axis=2), fingers[:, -1:, 2:].mean(axis=2)
        lines = silhouette(np.concatenate([bases, tips], axis=1), self.hand.widths, flat[0])
        return [frozen(line - flat.min(axis=(0, 1))) for line in lines]


def _check_count(area: float, spacing: float) -> None:
    if not area / spacing**2 <= MOST_PLACES:
        raise ValueError(
            f"spacing {spacing} m makes {area / spacing**2:.3g} places of skin; at most {MOST_PLACES} are possible"
        )


def _laid_out(hand: Hand) -> NDArray[np.float64]:
    """The quadrilaterals laid out, (16, 4, 2) in metres: x across as seen on the back of the hand, y to the fingers."""
    palm, wrist = hand.quads[0], hand.landmarks[0]
    across = palm[1] - palm[0]
    back = np.cross(across, palm[3] - palm[0])
    plane = np.stack([across, np.cross(back, across)])
    plane /= np.linalg.norm(plane, axis=1, keepdims=True)
    flat = np.empty((len(hand.quads), 4, 2))
    flat[0] = (palm - wrist) @ plane.T
    straight = posed(hand.side)
    for finger in range(5):
        first = 1 + 4 * finger
        direction = (straight[first + 3] - straight[first])[:2]
        direction /= np.linalg.norm(direction)
        bones = np.linalg.norm(np.diff(hand.landmarks[first : first + 4], axis=0), axis=1)
        joints = plane @ (hand.landmarks[first] - wrist) + np.cumsum([0, *bones])[:, None] * direction
        half = hand.widths[finger] / 2 * np.array([direction[1], -direction[0]])
        left, right = joints - half, joints + half
        flat[1 + 3 * finger : 4 + 3 * finger] = np.stack([left[:-1], right[:-1], right[1:], left[1:]], axis=1)
    return flat


def _inside(quad: NDArray[np.float64], cells: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of (m, 2) places lie in a convex quadrilateral, (4, 2), whose corners run counterclockwise."""
    sides = np.roll(quad, -1, axis=0) - quad
    offset = cells[:, None] - quad
    return np.asarray((sides[:, 0] * offset[..., 1] - sides[:, 1] * offset[..., 0] >= 0).all(axis=1))
