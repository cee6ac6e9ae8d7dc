"""The command that writes the golden vectors: ``vectors``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..base.extras import needing
from ..base.storage import check_outputs, write_file

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)


@commands.command(epilog="Example: phasewire vectors --output vectors.json")
def vectors(
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The file to write instead; - is standard output."),
    ] = None,
) -> None:
    """Write golden vectors of the protocol to standard output, as JSON: bytes, what they mean, and what is refused.

    They are for authors of firmware or of a host; this is protocol/vectors.json.
    """
    with needing("signing", "phasewire vectors"):
        from ..protocol.vectors import text  # makes keys and pulses while it is imported

    if output is None or str(output) == "-":
        typer.echo(text(), nl=False)
        return
    check_outputs([output])
    write_file(output, text())
