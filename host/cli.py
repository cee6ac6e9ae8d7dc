"""Commands that talk to a device: ``show``, ``stop`` and ``info``."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from ..console import JsonOption, console_for, error_console, write_json
from ..errors import DeviceRefusedError, InputFileError
from ..protocol.codes import Reason
from ..protocol.plain import plain
from ..protocol.pulses import Pulses
from ..protocol.replies import Info
from ..protocol.versions import Version
from ..solver import Solution, TransducerArray
from ..solver.files import read_arrays, solution_in
from ..storage import check_outputs
from .device import open_device
from .transport import DEFAULT_URL, URL_VARIABLE

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

DeviceOption = Annotated[
    str,
    typer.Option(
        "--device",
        metavar="URL",
        envvar=URL_VARIABLE,
        help="emulator: (a fresh emulated device), usb: (the only one plugged in) or usb:SERIAL.",
    ),
]


def load_pulses(path: Path) -> tuple[Pulses, Solution | None]:
    """Pulses from a solved file, with its solution, or as they stand in an NPZ file as ``phase`` and ``width``."""
    arrays = read_arrays(path)
    if "format" in arrays:
        solution = solution_in(arrays, path)
        return Pulses.from_drive(solution.drive), solution
    if {"phase", "width"} <= set(arrays):
        try:
            return Pulses(arrays["phase"], arrays["width"]), None
        except ValueError as error:
            raise InputFileError(f"{path}: {error}") from error
    raise InputFileError(f"{path} holds neither a solution nor pulses (phase and width); `phasewire solve` makes one")


def differences(solution: Solution, what: Info) -> list[str]:
    """In which ways a device differs from what a solution was solved for, so that the field will be another."""
    found = []
    own = TransducerArray.grid(what.columns, what.rows, what.pitch).positions
    if own.shape == solution.array.positions.shape and not np.allclose(solution.array.positions, own, atol=1e-6):
        found.append(f"the device has {what.columns} × {what.rows} transducers, {what.pitch * 1e3:g} mm apart")
    if solution.medium.frequency != what.carrier_hz:
        found.append(f"the device's carrier has {what.carrier_hz} Hz, not {solution.medium.frequency:g} Hz")
    return found


@commands.command()
def show(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="A solved file, or an .npz file with the arrays phase and width."),
    ],
    device: DeviceOption = DEFAULT_URL,
    seconds: Annotated[float, typer.Option(min=0, help="How long to play, in s.")] = 1.0,
    forever: Annotated[bool, typer.Option("--forever", help="Play until Ctrl-C.")] = False,
    json_target: JsonOption = None,
) -> None:
    """Play a solved file on a device, and leave its outputs off.

    While it plays, the device hears regular signs of life; should this program die, the device's watchdog turns the
    outputs off. The time of an emulated device passes only with each transfer, so it plays for less of its own time.
    """
    check_outputs([json_target], inputs=[file])
    pulses, solution = load_pulses(file)
    with open_device(device) as opened:
        for difference in differences(solution, opened.info) if solution else []:
            error_console().print(f"warning: {file} was solved for something else: {difference}", style="yellow")
        ack = opened.show(pulses)
        message = f"{opened.name} plays {file} from carrier period {ack.commit_period}"
        error_console().print(message + (", until Ctrl-C" if forever else f", for {seconds:g} s"))
        end = math.inf if forever else time.monotonic() + seconds
        with suppress(KeyboardInterrupt):
            while (left := end - time.monotonic()) > 0:
                time.sleep(min(opened.info.watchdog / 3, left))
                if not opened.status().enabled:
                    raise DeviceRefusedError(
                        f"{opened.name} has turned its outputs off: it heard nothing for {opened.info.watchdog:g} s. "
                        "Was this program held up?",
                        Reason.DISABLED,
                    )
        status = opened.status()
    console_for(json_target).print("Stopped; the outputs are off.")
    write_json(json_target, {"device": opened.name, "commit_period": ack.commit_period, "status": plain(status)})


@commands.command()
def stop(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Turn all outputs of a device off."""
    check_outputs([json_target])
    with open_device(device) as opened:
        opened.stop()
        status = opened.status()
    console_for(json_target).print(f"{opened.name}: the outputs are off.")
    write_json(json_target, {"device": opened.name, "status": plain(status)})


def _versions(what: Info) -> str:
    if what.oldest_version == what.newest_version:
        return f"version {what.newest_version}"
    return f"versions {what.oldest_version} to {what.newest_version}"


@commands.command()
def info(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Say what a device is and what it is doing."""
    check_outputs([json_target])
    with open_device(device) as opened:
        what, status = opened.info, opened.status()
    table = Table(title=opened.name, show_header=False, title_justify="left")
    for label, value in (
        ("protocol", _versions(what)),
        ("firmware", str(Version(*what.firmware))),
        ("array", f"{what.columns} × {what.rows} transducers, {what.pitch * 1e3:g} mm apart"),
        (
            "chain",
            f"{what.boards} boards of {what.processors_per_board} processors, {what.link_wires}-wire links",
        ),
        ("output", f"{what.ticks_per_period} ticks per period of {what.carrier_hz / 1e3:g} kHz"),
        ("rate", f"{what.max_updates_per_second:g} updates/s at most, {what.queue_blocks} queued"),
        ("watchdog", f"{status.watchdog_ms} ms"),
        ("drive limit", f"{status.drive_limit} fully driven transducers"),
        ("temperature", f"{status.temperature_c} °C"),
        ("faults", ", ".join(fault.name or "" for fault in status.faults) or "none"),
        ("outputs", f"{'enabled' if status.enabled else 'off'} ({status.state.name})"),
        ("carrier period", str(status.period)),
        ("blocks", f"{status.accepted} accepted, {status.refused} refused, {status.late} late, {status.lost} lost"),
        ("missed commits", str(status.missed_commits)),
    ):
        table.add_row(label, value)
    console_for(json_target).print(table)
    write_json(json_target, {"device": opened.name, "info": plain(what), "status": plain(status)})
