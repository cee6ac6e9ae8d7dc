"""From what should be felt to the drives of a cycle, one after the other."""

from __future__ import annotations

from typing import Any

from ...base.arguments import whole
from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..contact.touch import Touch
from ..methods.solve import Solver, Wanted
from ..methods.two_sided import TwoSidedSolver
from .cycle import MOST_FRAMES, MOST_PERIODS, Cycle
from .outline import Outline
from .ways import Solvers, Way, chosen, parse_way

__all__ = ["Renderer", "render"]


LEAST_FRAMES = 8
"""Of a cycle that is to follow a sine."""


class Renderer:
    """Renders one outline after the other for an array: points keep their phases, which is quieter.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    way : Way or str
        How; a text is read by `parse_way`, and ``auto`` chooses by the outline (`ways.chosen`).
    method : str
        A key of `METHODS`.
    medium : Medium, optional
        The air; 20 °C by default.
    most_frames : int
        Drives of a cycle, at most.
    **options
        Options of the method, see `Options`; by default the output is ``phase`` if the way uses full drive.

    Raises
    ------
    ValueError
        As `Solver` and `parse_way`, or if a cycle could not have `LEAST_FRAMES`.
    """

    def __init__(
        self,
        array: TransducerArray,
        way: Way | str = "auto",
        method: str = "wgs",
        *,
        medium: Medium | None = None,
        most_frames: int = MOST_FRAMES,
        **options: Any,
    ) -> None:
        self._way = parse_way(way) if isinstance(way, str) else way
        least = 2
        if self._way is None or self._way.phase_only:
            least, options = LEAST_FRAMES, {"output": "phase"} | options
        most_frames = whole("most_frames", most_frames, least, MOST_PERIODS)
        self._solvers = Solvers(
            Solver(array, method, medium=medium, **options),
            TwoSidedSolver(array, method, medium=medium, **options),
            most_frames,
        )

    def way_for(self, outline: Outline) -> Way:
        """The way in which an outline is rendered."""
        return chosen(outline) if self._way is None else self._way

    def render(self, what: Outline | Wanted | Touch) -> Cycle:
        """The cycle of an outline, or of that which `Outline.of` makes of a shape, points or a touch.

        Raises
        ------
        ValueError
            As `Solver.solve` and `Outline.of`.
        """
        outline = what if isinstance(what, Outline) else Outline.of(what)
        return self.way_for(outline).cycle(outline, self._solvers)

    def forget(self) -> None:
        """Begin the next outline from scratch, as the first."""
        self._solvers.one.forget()
        self._solvers.two.forget()


def render(
    array: TransducerArray,
    what: Outline | Wanted | Touch,
    way: Way | str = "auto",
    method: str = "wgs",
    *,
    medium: Medium | None = None,
    **options: Any,
) -> Cycle:
    """Render one outline: a `Renderer` for one."""
    return Renderer(array, way, method, medium=medium, **options).render(what)
