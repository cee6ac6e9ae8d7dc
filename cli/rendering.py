"""The option ``--render``, for commands that play."""

from __future__ import annotations

from typing import Annotated

import typer

from ..solver.rendering.ways import AUTO, WAYS, way_help
from .console import among

__all__ = ["RENDER_HELP", "SQUARE", "RenderOption"]

SQUARE = "two-sided:envelope=square"
"""The paper's way."""

RENDER_HELP = f"""
A way of rendering is auto, or a name with what differs from its defaults, such as am:frequency=100 .

\b
{way_help()}

auto moves a point to and fro (lm), draws a single line of 20 to 200 mm (stm), and renders all else two-sided. The
envelope sine is the quiet one.
"""

RenderOption = Annotated[
    str | None,
    typer.Option(
        "--render",
        metavar="WAY",
        help=f"The way of rendering: {AUTO}, {', '.join(WAYS)}, with parameters as above.",
        autocompletion=among((AUTO, *WAYS)),
    ),
]
