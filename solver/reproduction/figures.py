"""The paper's figures, computed again: Figures 4, 6 and 7, and the range of its section 7.

Each function returns numbers and fields; `pictures` draws them, and ``phasewire reproduce`` says beside
them what the paper claims. The paper gives no sizes of its shapes and no grid of its array: both are ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.random import default_rng  # NumPy would load it when it is used, and lose a Ctrl-C that comes meanwhile
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..fields.convolution import PlanePropagator
from ..fields.field import PlaneField, sample_cut
from ..fields.focus import FocusReport, focus_report
from ..fields.grid import Grid
from ..methods.modulation import Modulation, intensity_component
from ..methods.solve import Solver, solve
from ..methods.two_sided import TwoSided, TwoSidedSolver, two_sided
from ..shapes.points import ControlPoints
from ..shapes.shapes import Asterisk, Circle, Concentric, Polygon, Rings, Star

__all__ = [
    "COUNTS",
    "HEIGHTS",
    "SHAPES_OF_FIGURE_6",
    "TECHNIQUES",
    "AtHeight",
    "Figure4",
    "Rendering",
    "Technique",
    "Timing",
    "reproduce_figure_4",
    "reproduce_figure_6",
    "reproduce_figure_7",
    "reproduce_range",
]

EXTENT = 0.14  # metres, of the planes that are drawn
HEIGHT = 0.20  # metres, of the shapes


@dataclass(frozen=True)
class Technique:
    """A way to find drives, as the paper letters them: a key of `METHODS` with options."""

    name: str
    method: str
    options: dict[str, Any]


TECHNIQUES = {
    "A": Technique("A  linear multiplexing", "multiplex", {"output": "phase"}),
    "B": Technique("B  without regularisation", "min_norm", {"output": "phase", "phases": "power"}),
    "C": Technique("C  with regularisation", "paper", {}),
    "ours": Technique("ours  wgs", "wgs", {}),
}
"""What Figure 6 compares, each transducer at full power as in section 3.5; and the recommended method beside it."""

SHAPES_OF_FIGURE_6 = {
    "1": ("two rings", Rings()),
    "2": ("five-pointed star", Star()),
    "3": ("concentric circles", Concentric()),
    "4": ("six-pointed asterisk", Asterisk()),
}


@dataclass(frozen=True, eq=False)
class Rendering:
    """One panel of Figure 6.

    Parameters
    ----------
    technique, shape : str
        Keys of `TECHNIQUES` and `SHAPES_OF_FIGURE_6`.
    points : ControlPoints
        What was wanted.
    field : PlaneField
        Field over the plane of the points.
    report : FocusReport
        What became of the points.
    """

    technique: str
    shape: str
    points: ControlPoints
    field: PlaneField
    report: FocusReport

    @property
    def pressures(self) -> NDArray[np.float64]:
        """|p| at the points, (m,) in Pa (peak)."""
        return np.array([focus.pressure for focus in self.report.foci])

    def record(self) -> dict[str, Any]:
        """The numbers that the paper's text is about."""
        found = self.pressures
        return {
            "technique": TECHNIQUES[self.technique].name,
            "shape": SHAPES_OF_FIGURE_6[self.shape][0],
            "points": len(self.points),
            "mean_pa": float(found.mean()),
            "min_over_mean": float(found.min() / found.mean()),
            "deviation_over_mean": float(found.std() / found.mean()),
            "missing": len(self.report.missing),
            "ghosts": len(self.report.ghosts),
        }


def reproduce_figure_6(array: TransducerArray | None = None, medium: Medium | None = None) -> list[Rendering]:
    """Four shapes by four techniques, row by row as in Figure 6."""
    array, medium = array or TransducerArray.grid(), medium or Medium()
    propagate = PlanePropagator(array, HEIGHT, EXTENT, 10, medium)
    panels = []
    for letter, technique in TECHNIQUES.items():
        for number, (_, shape) in SHAPES_OF_FIGURE_6.items():
            points = shape.sample()
            drive = solve(array, points, technique.method, medium=medium, **technique.options).drive
            report = focus_report(array, drive, points, medium)
            panels.append(Rendering(letter, number, points, propagate(drive), report))
    return panels


COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512)
"""Numbers of control points in Figure 7."""

TIMED: dict[str, tuple[str, dict[str, Any]]] = {
    "multiplex": ("multiplex", {}),
    "min_norm": ("min_norm", {}),
    "tikhonov": ("tikhonov", {}),
    "wgs": ("wgs", {}),
    "paper": ("paper", {}),
}
TWO_SIDED = " two-sided"
REPEATS, PATIENCE = 25, 0.5  # how often each is timed, and the seconds after which that is enough


@dataclass(frozen=True)
class Timing:
    """Median time of an update, in seconds, by technique and number of control points."""

    technique: str
    points: int
    seconds: float


def reproduce_figure_7(counts: Sequence[int] = COUNTS, array: TransducerArray | None = None) -> list[Timing]:
    """Time of an update on one thread against the number of control points, placed at random above the array."""
    array = array or TransducerArray.grid()
    rng = default_rng(7)
    clouds = [ControlPoints(rng.uniform([-0.08, -0.08, 0.15], [0.08, 0.08, 0.3], (count, 3))) for count in counts]
    solvers: dict[str, Callable[[ControlPoints], Any]] = {}
    for name, (method, options) in TIMED.items():
        solvers[name] = Solver(array, method, **options).solve
        if method in ("tikhonov", "wgs"):
            solvers[name + TWO_SIDED] = TwoSidedSolver(array, method, **options).solve
    with threadpool_limits(1):  # several threads of LAPACK would time the machine's other users
        return [
            Timing(name, len(points), _median_seconds(solver, points))
            for name, solver in solvers.items()
            for points in clouds
        ]


def _median_seconds(solver: Callable[[ControlPoints], Any], points: ControlPoints) -> float:
    solver(points)  # compiles, and makes room
    times: list[float] = []
    begun = perf_counter()
    while len(times) < REPEATS and (not times or perf_counter() - begun < PATIENCE):
        before = perf_counter()
        solver(points)
        times.append(perf_counter() - before)
    return float(np.median(times))


HEIGHTS = tuple(round(0.05 + 0.025 * step, 3) for step in range(23))
"""Heights above the array in metres, from 5 to 60 cm."""

RING = 0.03  # metres: radius of the ring that is looked at beside the single focus


@dataclass(frozen=True)
class AtHeight:
    """How well the array works at a height in metres.

    ``focus`` is |p| of a single focus above the middle, and ``ring`` the mean |p| of a ring of points of 6 cm, in Pa
    (peak). Within ``width`` and ``depth`` it is at least half of that, across and along the axis, in metres; None if
    that is farther than four neighbourhoods of `focus_report`. ``contrast`` is the strongest lobe beside the ring's
    points relative to their mean, in dB.
    """

    height: float
    focus: float
    width: float | None
    depth: float | None
    ring: float
    contrast: float


def reproduce_range(
    heights: Sequence[float] = HEIGHTS, array: TransducerArray | None = None, medium: Medium | None = None
) -> list[AtHeight]:
    """Strength and sharpness against the height above the array; the paper's section 7 says 15 to 50 cm is best."""
    array, medium = array or TransducerArray.grid(), medium or Medium()
    solver, found = Solver(array, medium=medium), []
    for height in heights:
        point, ring = ControlPoints([[0, 0, height]]), Circle(RING, height).sample()
        single = focus_report(array, solver.solve(point).drive, point, medium).foci[0]
        report = focus_report(array, solver.solve(ring).drive, ring, medium)
        lobe = report.strongest_lobe
        found.append(
            AtHeight(
                height,
                single.pressure,
                single.width[0],
                single.width[2],
                report.mean,
                -math.inf if lobe is None else lobe.level,
            )
        )
    return found


@dataclass(frozen=True, eq=False)
class Figure4:
    """Two-sided modulation of the points of a square of 10 cm.

    ``halves`` are the two fields, Figure 4 a and b. ``two_sided`` and ``one_sided`` are the modulation's component of
    the intensity |p|², Figure 4 c and d, as its root in Pa, which is a pressure.
    """

    points: ControlPoints
    result: TwoSided
    halves: tuple[PlaneField, PlaneField]
    two_sided: PlaneField
    one_sided: PlaneField


def reproduce_figure_4(
    method: str = "wgs", array: TransducerArray | None = None, medium: Medium | None = None, **options: Any
) -> Figure4:
    """The square of Figure 4, in two halves and at once."""
    array, medium = array or TransducerArray.grid(), medium or Medium()
    points = Polygon(height=HEIGHT).sample()
    result = two_sided(array, points, method, medium=medium, **options)
    grid = Grid.horizontal(HEIGHT, EXTENT, 1e-3)
    left, right = (sample_cut(array, row @ result.modulation.drives, grid, medium) for row in result.modulation.weights)
    return Figure4(
        points,
        result,
        (left, right),
        _component(grid, array, result.modulation, medium),
        _component(grid, array, result.one_sided, medium),
    )


def _component(grid: Grid, array: TransducerArray, modulation: Modulation, medium: Medium) -> PlaneField:
    at = grid.positions().reshape(-1, 3)
    component = intensity_component(array, modulation, at, medium=medium, precision="single")
    return PlaneField(grid, np.sqrt(component).astype(np.complex128).reshape(grid.shape), medium)
