"""The command line: the commands of every room under one name, and what becomes of errors."""

from __future__ import annotations

import io
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from .console import error_console
from .emulator.cli import commands as emulator_commands
from .errors import DeviceError, DeviceNotFoundError, PhasewireError
from .hil.cli import commands as hil_commands
from .host.commands.cli import commands as host_commands
from .host.commands.discovery_cli import commands as discovery_commands
from .host.commands.firmware_cli import commands as firmware_commands
from .host.commands.flash_cli import commands as flash_commands
from .host.commands.playing_cli import commands as playing_commands
from .host.lines.tracing import print_traffic
from .settings import commands as settings_commands
from .settings import defaults_from_file, each_command
from .solver.cli import commands as solver_commands

__all__ = ["app", "command_line", "main", "unwinding"]

FAILED, WRONG_USE, NO_DEVICE, DEVICE_FAILED = 1, 2, 3, 4
SIGNALLED = 128  # and the signal's number, as shells have it: 130 is Ctrl-C
TRACED = ("demo",)
"""Commands that talk to a device without being told which."""


class CommandLine(TyperGroup):
    """The commands of every room, which end quietly where nobody reads on."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Read the command line, and print what it asks for by ``--help`` and its like."""
        with _heard():
            return super().make_context(*arguments, **options)

    def invoke(self, context: Any) -> Any:
        """Run the command."""
        with _heard():
            return super().invoke(context)


app = typer.Typer(
    name="phasewire",
    cls=CommandLine,
    epilog="Begin with: phasewire demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for commands in (
    hil_commands,
    solver_commands,
    host_commands,
    playing_commands,
    discovery_commands,
    flash_commands,
    emulator_commands,
    settings_commands,
):
    app.add_typer(commands)
app.add_typer(firmware_commands, name="firmware")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"phasewire {version('phasewire')}")
        raise typer.Exit


def _trace(context: typer.Context, times: int) -> int:
    if times and not context.resilient_parsing:
        context.find_root().call_on_close(print_traffic(each=times > 1))
    return times


@app.callback()
def common(
    context: typer.Context,
    _verbose: Annotated[
        int,
        typer.Option(
            "--verbose",
            "-v",
            count=True,
            callback=_trace,
            expose_value=False,
            show_default=False,
            help="Say on standard error what is sent to a device and what it answers; -vv says each block and record.",
        ),
    ] = 0,
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Mid-air haptics on an ultrasonic phased array: from a shape to the skin.

    Exit codes: 0 all is well, 1 what was checked failed, 2 wrong use or unusable input, 3 no such device, 4 the device
    refused or failed, 130 Ctrl-C.
    """
    context.default_map = defaults_from_file(context)


def command_line() -> TyperGroup:
    """All commands as click knows them; those that talk to a device take ``--verbose`` too, as the whole does."""
    root = typer.main.get_command(app)
    assert isinstance(root, TyperGroup)
    verbose = next(option for option in root.params if "--verbose" in option.opts)
    for context in each_command(typer.Context(root)):
        command = context.command
        if command.name in TRACED or any("--device" in option.opts for option in command.params):
            command.params.append(verbose)
    return root


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


@contextmanager
def _heard() -> Iterator[None]:
    """End the program quietly where whoever read its output, such as ``head``, has left."""
    try:
        yield
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):  # what they still hold must not fail again at the very end
            os.dup2(nowhere, stream.fileno())
        sys.exit(SIGNALLED + signal.SIGPIPE)


@contextmanager
def unwinding(*, last: bool) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and a closed terminal unwind the program, so that it leaves a device silent.

    Only the first of them does: those that follow find it turning outputs off, which they must not interrupt and which
    ends in bounded time. What was ignored when the program began, as under nohup, stays so.

    Parameters
    ----------
    last : bool
        Whether the program ends behind this, so that nothing is left that a signal could interrupt.
    """
    heard = False

    def unwind(number: int, _frame: FrameType | None) -> None:
        nonlocal heard
        if heard:
            return
        heard = True
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(SIGNALLED + number)

    before = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # not every system has them all
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            before[number] = signal.signal(number, unwind)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if last else handler)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a sign shows a question mark
    with _heard(), unwinding(last=arguments is None):
        try:
            command_line()(args=arguments, prog_name="phasewire")
        except MemoryError:
            error_console().print("phasewire: not enough memory; ask for fewer points or transducers", style="red")
            sys.exit(WRONG_USE)
        except (PhasewireError, ValueError, OSError) as error:
            error_console().print(f"phasewire: {message(error)}", style="red")
            sys.exit(exit_code(error))


if __name__ == "__main__":
    main()
