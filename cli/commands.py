"""The command line: all commands under one name, and the messages of errors.

A command's module is loaded when the command is needed: `HOMES` lists the modules, and the purpose of each command.
"""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Annotated, Any, NamedTuple, cast

import typer
from typer.core import TyperCommand, TyperGroup

from ..base.errors import (
    ClusterError,
    ClusterNotFoundError,
    DeviceError,
    DeviceNotFoundError,
    DeviceUrlError,
    MissingExtraError,
    PhasewireError,
    TrackerError,
    TrackerNotFoundError,
)
from ..base.signals import SIGNALLED, loading

__all__ = ["FAILED", "WRONG_USE", "app", "command_line", "complain", "message", "run"]

FAILED, WRONG_USE, NO_DEVICE, DEVICE_FAILED = 1, 2, 3, 4
TRACED = ("demo",)
"""Commands that need a device but take no option for it."""


class Home(NamedTuple):
    """The module of a command.

    Parameters
    ----------
    module : str
        A module of this room; its name ``commands`` is a group that has the command, or is the command.
    help : str
        The first sentence of the command's own help.
    """

    module: str
    help: str


PANELS = {
    "Begin": {
        "demo": Home("demo", "Show the whole path: a sphere on a palm, five emulated boards, pressure."),
        "doctor": Home("discovery", "Check this computer and a device for problems, and suggest remedies."),
        "devices": Home("discovery", "List the devices that can be found, on USB and on serial lines."),
        "config": Home("settings", "Show the values of options that the command line does not set, and their sources."),
    },
    "Points and fields": {
        "solve": Home("solving", "Find the drives that make a shape, and write them to a file."),
        "field": Home(
            "solving",
            "Compute the field of a solved file or a shape over a plane or a box, as a picture or as numbers.",
        ),
        "focus": Home(
            "solving",
            "Report the result at control points, of a solved file or a shape: strength, sharpness, missing ones and "
            "ghosts.",
        ),
        "reproduce": Home("reproduce", "Compute a figure of the paper again."),
        "feel": Home(
            "feel", "Say how a shape is felt and heard, as emulated boards emit it: skin, ears, exposure, power."
        ),
        "sweep": Home("sweep", "Measure many designs of an array: strength, spread, ghosts and audible level of each."),
        "study": Home("study", "Simulate the paper's user study: hands explore objects, and a classifier answers."),
    },
    "Play": {
        "show": Home("playing", "Play one frame on a device, and leave its outputs off."),
        "stream": Home("playing", "Play frames one after the other at a rate, and leave the outputs off."),
        "play": Home("playing", "Play a shape modulated, which the device does from its memory."),
        "record": Home(
            "playing",
            "Write the frames of a stream to a file, from which `phasewire stream` plays them later, bit for bit.",
        ),
        "touch": Home(
            "touch",
            "Let hands touch objects: what they feel is played on a device, live, and its outputs are off at the end.",
        ),
        "view": Home(
            "view", "Show hands, objects, array and field live in 3D, on a page in the browser, and change them there."
        ),
        "tracker": Home("tracker", "List the sources of hands and which can be used, or watch one and check it."),
    },
    "A device": {
        "info": Home("device", "Show a device's description and its state, or the devices of a rig as one array."),
        "stop": Home("device", "Turn all outputs of a device off, or of all devices of a rig that can be reached."),
        "reset": Home("device", "Restart a device as at power-up, and wait until it is back."),
        "identify": Home("device", "Let the light on a board blink for five seconds."),
        "read-back": Home("device", "Read back what the processors play, and show it as the grid of transducers."),
        "watchdog": Home(
            "device",
            "Set how long a device waits for a sign of life before it turns its outputs off, until it restarts.",
        ),
        "limit": Home("device", "Turn a device's outputs off, and set its drive limit, until it restarts."),
        "clear-faults": Home("device", "Clear the faults of a device whose cause is gone, and list the others."),
    },
    "Firmware": {
        "flash": Home("flash", "Give a device new firmware, completely or not at all, and check that it runs."),
        "firmware": Home("firmware", "Build, inspect, sign and verify firmware images."),
        "xs1": Home(
            "xs1", "Assemble, disassemble, run and trace programs of an XS1 core, the chip of the chain's processors."
        ),
    },
    "Test and emulate": {
        "conformance": Home(
            "conformance",
            "Judge a device by the specification: what it does, what it answers and, if they can be seen, its outputs.",
        ),
        "emulate": Home("emulate", "Serve emulated devices to other programs, until Ctrl-C."),
        "attach": Home(
            "attach", "Attach a device of a USB/IP server, such as `phasewire emulate`, to this Linux computer."
        ),
        "decode": Home("decode", "Explain recorded traffic, and name the clauses of the specification that it breaks."),
        "vectors": Home(
            "vectors",
            "Write golden vectors of the protocol to standard output, as JSON: bytes, what they mean, "
            "and what is refused.",
        ),
        "budget": Home(
            "budget",
            "Show how long an update takes from the host to the outputs, the highest rate, and the bottleneck.",
        ),
    },
}
"""Each command and each group of commands, as ``--help`` lists them."""

HOMES = {name: home for panel in PANELS.values() for name, home in panel.items()}
"""The same by name alone."""


class Commands(Mapping[str, TyperCommand | TyperGroup]):
    """The commands for click, each loaded when it is needed.

    Parameters
    ----------
    verbose : click.Parameter
        The option ``--verbose``, which commands that use a device also take.
    """

    def __init__(self, verbose: Any) -> None:
        self._verbose = verbose
        self._loaded: dict[str, TyperCommand | TyperGroup] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(HOMES)

    def __len__(self) -> int:
        return len(HOMES)

    def __getitem__(self, name: str) -> TyperCommand | TyperGroup:
        if name not in self._loaded:
            with loading():
                import logging  # not for --help, which begins sooner without

                # it tells of its work, in pipes too
                logging.getLogger("phasewire.base.compiling").setLevel(logging.INFO)
                module = import_module(f".{HOMES[name].module}", __package__)
            group = typer.main.get_group(module.commands)
            command = self._loaded[name] = cast("TyperCommand | TyperGroup", group.commands.get(name, group))
            command.name = name
            if name in TRACED or any("--device" in option.opts for option in command.params):
                command.params.append(self._verbose)
        return self._loaded[name]


class CommandLine(TyperGroup):
    """All commands. They end quietly if the program that reads their output ends."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Read the command line, and print the output of ``--help`` and similar options."""
        with _heard():
            return super().make_context(*arguments, **options)

    def invoke(self, context: Any) -> Any:
        """Run the command."""
        with _heard():
            return super().invoke(context)

    def format_commands(self, context: Any, formatter: Any) -> None:  # noqa: ARG002  typer decides the arguments
        """List the commands in their panels, each with its whole sentence, and load none."""
        width = max(map(len, HOMES))
        for panel, homes in PANELS.items():
            with formatter.section(panel):
                formatter.write_dl([(name.ljust(width), home.help) for name, home in homes.items()])


app = typer.Typer(
    name="phasewire",
    cls=CommandLine,
    epilog="Begin with: phasewire demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"phasewire {version('phasewire')}")
        raise typer.Exit


def _trace(context: typer.Context, times: int) -> int:
    if times and not context.resilient_parsing:
        from ..host.transports.tracing import print_traffic

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
            help="Print on standard error what is sent to a device and what it answers; -vv shows blocks and records.",
        ),
    ] = 0,
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Mid-air haptics on an ultrasonic phased array: from a shape to the skin.

    Exit codes: 0 success, 1 a check failed, 2 wrong use or unusable input, 3 no such device, tracker or cluster, 4 the
    device, tracker or cluster refused or failed, 130 Ctrl-C.
    """
    with loading():
        from .settings import defaults_from_file

    context.default_map = defaults_from_file(context)


@cache
def command_line() -> TyperGroup:
    """All commands for click; those that use a device take ``--verbose`` too, as the whole does."""
    root = typer.main.get_command(app)
    assert isinstance(root, TyperGroup)
    verbose = next(option for option in root.params if "--verbose" in option.opts)
    root.commands = cast("Any", Commands(verbose))
    return root


def exit_code(error: Exception) -> int:
    """The exit code of an error."""
    if isinstance(error, DeviceUrlError):
        return WRONG_USE
    if isinstance(error, (DeviceNotFoundError, TrackerNotFoundError, ClusterNotFoundError)):
        return NO_DEVICE
    if isinstance(error, (DeviceError, TrackerError, ClusterError)):
        return DEVICE_FAILED
    if isinstance(error, (ValueError, OSError, MissingExtraError)):
        return WRONG_USE
    return FAILED


def message(error: Exception) -> str:
    """The message of an error."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return f"standard output: {error.strerror}"  # because `storage.replacing` names each file that is written
    return str(error)


@contextmanager
def _heard() -> Iterator[None]:
    """End the program quietly if the program that reads its output, such as ``head``, has ended."""
    try:
        yield
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):  # their remaining output must not fail again at the very end
            os.dup2(nowhere, stream.fileno())
        sys.exit(SIGNALLED + signal.SIGPIPE)


def run(arguments: Sequence[str]) -> None:
    """Run the command line and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a character shows a question mark
    with _heard():
        try:
            command_line()(args=arguments, prog_name="phasewire")
        except MemoryError:
            complain("not enough memory; ask for fewer points or transducers")
            sys.exit(WRONG_USE)
        except RuntimeError as error:
            if "can't start new thread" not in str(error):  # as the interpreter says it
                raise
            complain("the system starts no more threads for this user; end other programs, or raise `ulimit -u`")
            sys.exit(WRONG_USE)
        except (PhasewireError, ValueError, OSError) as error:
            complain(message(error))
            sys.exit(exit_code(error))


def complain(what: str) -> None:
    """Print on standard error why the program fails."""
    from .console import error_console

    error_console().print(f"phasewire: {what}", style="red")
