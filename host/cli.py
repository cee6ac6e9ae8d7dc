"""Commands that ask a device one thing or tell it one: ``show``, ``stop``, ``info`` and their like."""

from __future__ import annotations

import math
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from ..console import JsonOption, console_for, error_console, write_json
from ..errors import InputFileError
from ..protocol.plain import plain
from ..protocol.pulses import Pulses
from ..protocol.replies import Info
from ..protocol.versions import Version
from ..solver import Solution, TransducerArray
from ..solver.files import read_arrays, solution_in
from ..storage import check_outputs
from .device import open_device
from .options import CalibrationOption, DeviceOption, load_calibration
from .transport import DEFAULT_URL

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)


def load_frame(path: Path) -> tuple[Pulses | Solution, Solution | None]:
    """A solution, also as such, or pulses as they stand in an NPZ file as ``phase`` and ``width``."""
    arrays = read_arrays(path)
    if "format" in arrays:
        solution = solution_in(arrays, path)
        return solution, solution
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


@commands.command(epilog="Example: phasewire show sphere.npz --seconds 2")
def show(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="A solved file, or an .npz file with the arrays phase and width."),
    ],
    device: DeviceOption = DEFAULT_URL,
    seconds: Annotated[float, typer.Option(min=0, help="How long to play, in s.")] = 1.0,
    forever: Annotated[bool, typer.Option("--forever", help="Play until Ctrl-C.")] = False,
    calibration: CalibrationOption = None,
    json_target: JsonOption = None,
) -> None:
    """Play a solved file on a device, and leave its outputs off.

    While it plays, the device hears regular signs of life; should this program die, the device's watchdog turns the
    outputs off. Of an emulated device the time passes as fast as this computer allows.
    """
    check_outputs([json_target], inputs=[file])
    frame, solution = load_frame(file)
    with open_device(device, calibration=load_calibration(calibration)) as opened:
        for difference in differences(solution, opened.info) if solution else []:
            error_console().print(f"warning: {file} was solved for something else: {difference}", style="yellow")
        ack = opened.show(frame)
        message = f"{opened.name} plays {file} from carrier period {ack.commit_period}"
        error_console().print(message + (", until Ctrl-C" if forever else f", for {seconds:g} s"))
        with suppress(KeyboardInterrupt) if forever else nullcontext():
            opened.keep_playing(math.inf if forever else seconds)
        status = opened.status()
    console_for(json_target).print("Stopped; the outputs are off.")
    write_json(json_target, {"device": opened.name, "commit_period": ack.commit_period, "status": plain(status)})


@commands.command(epilog="Example: phasewire stop --device usb:")
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


@commands.command(epilog="Example: phasewire info --json -")
def info(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Say what a device is and what it is doing."""
    check_outputs([json_target])
    with open_device(device, observe=True) as opened:
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
        ("features", ", ".join(feature.name or "" for feature in what.features) or "none"),
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


@commands.command(name="read-back", epilog="Example: phasewire read-back --device serial:///dev/ttyACM0")
def read_back(
    device: DeviceOption = DEFAULT_URL,
    json_target: JsonOption = None,
) -> None:
    """Ask the processors what they play, and show it as the grid of transducers.

    Of each transducer it shows the phase, 0 to 99, and the width, 0 to 25; a dot is a silent one. While another program
    uses the device over USB, ask over its serial line.
    """
    check_outputs([json_target])
    with open_device(device, observe=True) as opened:
        found = opened.read_back()
    out = console_for(json_target)
    pulses, columns = found.pulses, opened.info.columns
    if found.since_period == 0:
        out.print(f"{opened.name} plays nothing (carrier period {found.read_period}).")
    else:
        since = f"since carrier period {found.since_period}"
        if found.mixed:
            since = "what its processors did not begin together: entries of a period or two, or a missed commit"
        out.print(f"{opened.name} plays {since}:")
        cells = [
            f"{phase:>2}/{width:<2}" if width else "  .  "
            for phase, width in zip(pulses.phase.tolist(), pulses.width.tolist(), strict=True)
        ]
        for at in range(0, len(cells), columns):
            out.print(" ".join(cells[at : at + columns]).rstrip())
    write_json(
        json_target,
        {
            "device": opened.name,
            "since_period": None if found.mixed else found.since_period,
            "mixed": found.mixed,
            "read_period": found.read_period,
            "phase": pulses.phase.tolist(),
            "width": pulses.width.tolist(),
        },
    )


@commands.command(epilog="Example: phasewire identify 2")
def identify(
    board: Annotated[int, typer.Argument(metavar="BOARD", min=0, help="Board, counted from 0.")] = 0,
    device: DeviceOption = DEFAULT_URL,
) -> None:
    """Let the light on a board blink for five seconds."""
    with open_device(device, observe=True) as opened:
        opened.identify(board)
        console_for(None).print(f"{opened.name}: the light on board {board} blinks for five seconds.")


@commands.command(epilog="Example: phasewire reset --device usb:")
def reset(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Restart a device as at power-up, and wait until it is back."""
    check_outputs([json_target])
    with open_device(device) as opened:
        opened.reset()
        status = opened.status()
    console_for(json_target).print(f"{opened.name} has restarted; its outputs are off and its stores are empty.")
    write_json(json_target, {"device": opened.name, "status": plain(status)})
