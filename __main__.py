"""The command line: the commands of every room under one name, and what becomes of errors."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated

import typer

from .console import error_console
from .emulator.cli import commands as emulator_commands
from .errors import DeviceError, DeviceNotFoundError, PhasewireError
from .hil.cli import commands as hil_commands
from .host.cli import commands as host_commands
from .solver.cli import commands as solver_commands

__all__ = ["app", "main"]

FAILED, WRONG_USE, NO_DEVICE, DEVICE_FAILED = 1, 2, 3, 4

app = typer.Typer(
    name="phasewire",
    epilog="Begin with: phasewire demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for commands in (hil_commands, solver_commands, host_commands, emulator_commands):
    app.add_typer(commands)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"phasewire {version('phasewire')}")
        raise typer.Exit


@app.callback()
def common(
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Mid-air haptics on an ultrasonic phased array: from a shape to the skin.

    Exit codes: 0 all is well, 1 what was checked failed, 2 wrong use or unusable input, 3 no such device, 4 the device
    refused or failed, 130 Ctrl-C.
    """


def exit_code(error: Exception) -> int:
    """The exit code that stands for an error."""
    if isinstance(error, DeviceNotFoundError):
        return NO_DEVICE
    if isinstance(error, DeviceError):
        return DEVICE_FAILED
    if isinstance(error, (ValueError, OSError)):
        return WRONG_USE
    return FAILED


def message(error: Exception) -> str:
    """What an error says to people."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a sign shows a question mark
    try:
        app(args=arguments, prog_name="phasewire")
    except MemoryError:
        error_console().print("phasewire: not enough memory; ask for fewer points or transducers", style="red")
        sys.exit(WRONG_USE)
    except (PhasewireError, ValueError, OSError) as error:
        error_console().print(f"phasewire: {message(error)}", style="red")
        sys.exit(exit_code(error))


if __name__ == "__main__":
    main()
