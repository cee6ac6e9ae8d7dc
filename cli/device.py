"""Commands that make one request to a device: ``stop``, ``info``, ``reset`` and others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer
from rich.table import Table

from ..base.errors import DeviceError
from ..base.storage import check_outputs
from ..host.streaming.device import open_device
from ..host.streaming.lanes import naming
from ..host.streaming.rig import RigDevice, read_rig
from ..host.transports.opening import DEFAULT_URL
from ..protocol.codes import Request
from ..protocol.plain import flag_names, plain
from ..protocol.replies import Info, Status
from ..protocol.requests import VALUES
from ..protocol.versions import Version
from .console import JsonOption, console_for, error_console, write_json
from .options import DeviceOption, command_for, note_where_fresh, rig_file
from .rigs import show_rig

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

WATCHDOG_MS, DRIVE_LIMITS = VALUES[Request.WATCHDOG], VALUES[Request.LIMIT]


def _tell(json_target: str | None, command: str, name: str, said: str, status: Status) -> None:
    """The result of a command that makes one request."""
    console_for(json_target).print(f"{name}{said}")
    record = {"format": f"phasewire-{command}-1", "device": name, "status": plain(status)}
    write_json(json_target, record)


@commands.command(epilog="Example: phasewire stop --device usb:")
def stop(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Turn all outputs of a device off, or of all devices of a rig that can be reached."""
    check_outputs([json_target])
    rig = rig_file(device)
    if rig is not None:
        _stop_all(read_rig(rig), json_target)
        return
    note_where_fresh(device)
    with open_device(device) as opened:
        opened.stop()
        status = opened.status()
    _tell(json_target, "stop", opened.name, ": the outputs are off.", status)


def _stop_all(members: Sequence[RigDevice], json_target: str | None) -> None:
    """Turn the outputs of all devices of a rig off, even if some cannot be reached."""
    out, told, failure = console_for(json_target), list[dict[str, Any]](), None
    for url in dict.fromkeys(member.url for member in members):
        note_where_fresh(url)
    for member in members:
        try:
            with naming(member.name), open_device(member.url) as opened:
                opened.stop()
                told.append({"name": member.name, "device": opened.name, "status": plain(opened.status())})
            out.print(f"{member.name}: {opened.name}: the outputs are off.")
        except DeviceError as error:
            error_console().print(f"warning: {error}", style="yellow")
            told.append({"name": member.name, "problem": str(error)})
            failure = failure or error
    write_json(json_target, {"format": "phasewire-stop-rig-1", "devices": told})
    if failure is not None:
        raise failure


def _versions(what: Info) -> str:
    if what.oldest_version == what.newest_version:
        return f"version {what.newest_version}"
    return f"versions {what.oldest_version} to {what.newest_version}"


@commands.command(epilog="Example: phasewire info --json -")
def info(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Show a device's description and its state, or the devices of a rig as one array."""
    check_outputs([json_target])
    rig = rig_file(device)
    if rig is not None:
        show_rig(rig, json_target)
        return
    with open_device(device, observe=True) as opened:
        what, status = opened.info, opened.status()
    outputs = f"{'enabled' if status.enabled else 'off'} ({status.state.name})"
    if status.watchdog_fired:
        outputs += "; the watchdog has turned them off, because it heard nothing for its time"
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
        ("features", flag_names(what.features) or "none"),
        ("watchdog", f"{status.watchdog_ms} ms"),
        ("drive limit", f"{status.drive_limit} fully driven transducers"),
        ("temperature", f"{status.temperature_c} °C"),
        ("faults", flag_names(status.faults) or "none"),
        ("outputs", outputs),
        ("carrier period", str(status.period)),
        ("blocks", f"{status.accepted} accepted, {status.refused} refused, {status.late} late, {status.lost} lost"),
        ("missed commits", str(status.missed_commits)),
    ):
        table.add_row(label, value)
    console_for(json_target).print(table)
    write_json(
        json_target,
        {"format": "phasewire-info-1", "device": opened.name, "info": plain(what), "status": plain(status)},
    )


@commands.command(name="read-back", epilog="Example: phasewire read-back --device serial:///dev/ttyACM0")
def read_back(
    device: DeviceOption = DEFAULT_URL,
    json_target: JsonOption = None,
) -> None:
    """Read back what the processors play, and show it as the grid of transducers.

    It shows the phase, 0 to 99, and the width, 0 to 25, of each transducer; a dot is a silent one. While another
    program uses the device over USB, use its serial line.
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
            since = "updates that its processors did not begin together: entries of a period or two, or a missed commit"
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
            "format": "phasewire-read-back-1",
            "device": opened.name,
            "since_period": None if found.mixed else found.since_period,
            "mixed": found.mixed,
            "read_period": found.read_period,
            "phase": pulses.phase.tolist(),
            "width": pulses.width.tolist(),
        },
    )


@commands.command(epilog="Example: phasewire identify 2 --device usb:")
def identify(
    board: Annotated[int, typer.Argument(metavar="BOARD", min=0, help="Board, counted from 0.")] = 0,
    device: DeviceOption = DEFAULT_URL,
    json_target: JsonOption = None,
) -> None:
    """Let the light on a board blink for five seconds."""
    check_outputs([json_target])
    note_where_fresh(device)
    with open_device(device, observe=True) as opened:
        opened.identify(board)
        status = opened.status()
    _tell(json_target, "identify", opened.name, f": the light on board {board} blinks for five seconds.", status)


@commands.command(epilog="Example: phasewire reset --device usb:")
def reset(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Restart a device as at power-up, and wait until it is back."""
    check_outputs([json_target])
    note_where_fresh(device)
    with open_device(device) as opened:
        opened.reset()
        status = opened.status()
    _tell(json_target, "reset", opened.name, " has restarted; its outputs are off and its stores are empty.", status)


@commands.command(epilog="Example: phasewire watchdog 0.5 --device usb:")
def watchdog(
    seconds: Annotated[
        float,
        typer.Argument(
            metavar="SECONDS",
            min=WATCHDOG_MS[0] / 1000,
            max=WATCHDOG_MS[-1] / 1000,
            help="How long it waits, in s.",
        ),
    ],
    device: DeviceOption = DEFAULT_URL,
    json_target: JsonOption = None,
) -> None:
    """Set how long a device waits for a sign of life before it turns its outputs off, until it restarts."""
    check_outputs([json_target])
    note_where_fresh(device)
    with open_device(device, observe=True) as opened:
        opened.set_watchdog(seconds)
        status = opened.status()
    _tell(json_target, "watchdog", opened.name, f" waits {status.watchdog_ms / 1000:g} s for a sign of life.", status)


@commands.command(epilog="Example: phasewire limit 100 --device usb:")
def limit(
    transducers: Annotated[
        int,
        typer.Argument(
            metavar="TRANSDUCERS",
            min=DRIVE_LIMITS[0],
            max=DRIVE_LIMITS[-1],
            help="The greatest allowed drive, in fully driven transducers.",
        ),
    ],
    device: DeviceOption = DEFAULT_URL,
    json_target: JsonOption = None,
) -> None:
    """Turn a device's outputs off, and set its drive limit, until it restarts."""
    check_outputs([json_target])
    note_where_fresh(device)
    with open_device(device) as opened:
        opened.set_drive_limit(transducers)
        status = opened.status()
    _tell(json_target, "limit", opened.name, f" refuses more than {status.drive_limit} full transducers.", status)


@commands.command(name="clear-faults", epilog="Example: phasewire clear-faults --device usb:")
def clear_faults(device: DeviceOption = DEFAULT_URL, json_target: JsonOption = None) -> None:
    """Clear the faults of a device whose cause is gone, and list the others."""
    check_outputs([json_target])
    note_where_fresh(device)
    with open_device(device, observe=True) as opened:
        status = opened.clear_faults()
    left = flag_names(status.faults)
    said = f" still has {left}; {command_for('doctor', device)} says what to do." if left else " has no faults."
    _tell(json_target, "clear-faults", opened.name, said, status)
