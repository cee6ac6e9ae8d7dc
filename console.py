"""How commands speak: results on standard output, everything else on standard error, JSON on request."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from .storage import check_folder, replacing

__all__ = ["JsonOption", "console_for", "error_console", "write_json"]


def _check_target(target: str | None) -> str | None:
    if target not in (None, "-"):
        check_folder(Path(target))
    return target


JsonOption = Annotated[
    str | None,
    typer.Option(
        "--json",
        metavar="FILE",
        callback=_check_target,
        help="Also write the result as JSON to FILE; - is standard output.",
    ),
]


def error_console() -> Console:
    """The console for progress and messages."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def console_for(json_target: str | None) -> Console:
    """The console for people's results: standard output, unless JSON goes there."""
    return Console(stderr=json_target == "-", highlight=False)


def write_json(target: str | None, record: dict[str, Any]) -> None:
    """Write a record to a file, to standard output for ``-``, nowhere for None."""
    if target is None:
        return
    text = json.dumps(record, indent=2, allow_nan=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
        return
    with replacing(Path(target)) as part:
        part.write_text(text, encoding="utf-8")
