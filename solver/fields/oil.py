"""The surface of a dish of oil under radiation pressure.

The paper's Figures 1, 5 and 6 turn the array to the surface of a thin layer of oil, in which each focus pushes a
dimple. Here the surface is the static one, in which radiation pressure is balanced by weight and surface tension, for
small slopes: (ρg − σ∇²)·h = −P.

What this neglects: the bottom of a thin dish, steep slopes, flow and its time (a real dimple takes a good part of a
second), the oil's streaming, sound that stands between oil and array, and the caustics that light refracted by the
surface makes on the bottom. It shows the places of dimples and their depths relative to each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, length, real, shown
from ..acoustics.medium import Medium
from .grid import Grid
from .quantities import check_reflection, radiation_pressure

__all__ = ["Oil", "PlaneLike", "oil_surface"]

GRAVITY = 9.80665  # m/s²


class PlaneLike(Protocol):
    """A `PlaneField`, which draws itself by this module and cannot be imported here."""

    @property
    def grid(self) -> Grid:
        """A plane."""

    @property
    def pressure(self) -> NDArray[np.complex128]:
        """Peak pressure in Pa, of the grid's shape."""

    @property
    def medium(self) -> Medium:
        """The air."""


@dataclass(frozen=True)
class Oil:
    """A light mineral oil.

    Parameters
    ----------
    density : float
        ρ, in kg/m³.
    surface_tension : float
        σ, in N/m.
    reflection : float
        α of `radiation_pressure`; a liquid reflects all but a thousandth of sound in air.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    density: float = 850.0
    surface_tension: float = 0.030
    reflection: float = 2.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        density = real("oil density", self.density, 0, 1e6, "kg/m³", above=True)
        object.__setattr__(self, "density", density)
        object.__setattr__(self, "surface_tension", real("oil surface_tension", self.surface_tension, 0, 1e6, "N/m"))
        object.__setattr__(self, "reflection", check_reflection(self.reflection))

    @property
    def capillary_length(self) -> float:
        """√(σ/(ρg)), in metres: finer structure is smoothed away. 1.9 mm by default."""
        return math.sqrt(self.surface_tension / (self.density * GRAVITY))

    def surface(self, push: ArrayLike, step: float) -> NDArray[np.float64]:
        """Height of the surface under a pressure.

        Parameters
        ----------
        push : (rows, columns) float
            Pressure from above, in Pa.
        step : float
            Distance between samples, in metres.

        Returns
        -------
        (rows, columns) float
            Height in metres, negative at places that are pushed.

        Notes
        -----
        Solved by a cosine transform, so the surface meets the edges of the plane level. The dish is taken to be so
        large that the displaced oil does not raise the rest.
        """
        push, step = array_of("push", push, np.float64), length("step", step)
        if push.ndim != 2 or not np.abs(push).max(initial=0) < 1e30:
            raise ValueError(f"push must be (rows, columns) finite pressures in Pa, not {shown(push)}")
        y, x = (np.pi * np.arange(count) / (count * step) for count in push.shape)
        stiffness = self.density * GRAVITY + self.surface_tension * (x**2 + y[:, None] ** 2)
        return np.asarray(scipy.fft.idctn(-scipy.fft.dctn(push) / stiffness))


def oil_surface(field: PlaneLike, oil: Oil | None = None) -> NDArray[np.float64]:
    """Height of an oil surface in the plane of a field, (rows, columns) in metres, negative in dimples.

    Raises
    ------
    ValueError
        If the plane is not horizontal.
    """
    if abs(field.grid.normal[2]) < 1 - 1e-9:
        raise ValueError(
            f"oil lies level: the plane must be horizontal, but its normal is {field.grid.normal.tolist()}"
        )
    oil = oil or Oil()
    return oil.surface(radiation_pressure(field.pressure, field.medium, oil.reflection), field.grid.step)
