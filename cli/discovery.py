"""Commands that find devices and problems with them: ``devices`` and ``doctor``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ..base.errors import DeviceNotFoundError
from ..base.storage import check_outputs
from ..host.finding.computer_checks import udev_rule
from ..host.finding.discovery import search
from ..host.finding.doctor import CHECKS, FOUND, examine
from ..host.finding.findings import CheckVerdict
from ..host.transports.opening import URL_VARIABLE, refuse_rig
from .completion import device_urls
from .console import JsonOption, console_for, error_console, print_list, write_json
from .rigs import show_rig
from .telling import as_record, count, failed, tell

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

CHECK_FAILED, NO_DEVICE = 1, 3


@commands.command(epilog="Example: phasewire devices --json -")
def devices(
    rig: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Show the devices of this rig file as one array (docs/how-to/rigs.md)."),
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """List the devices that can be found, on USB and on serial lines.

    Exit code 3 if there are none, or one of the rig is missing. The URL emulator: always works, and is not listed.
    """
    check_outputs([json_target], inputs=[] if rig is None else [rig])
    if rig is not None:
        show_rig(rig, json_target)
        return
    found, failures = search()
    for scheme, why in failures.items():
        error_console().print(f"warning: {scheme}: {why}", style="yellow")
    if found:
        table = Table("url", "product", "serial number", "mode", "firmware", "location", "problem")
        for each in found:
            table.add_row(
                each.url,
                each.product,
                each.serial or "",
                each.mode,
                each.firmware,
                each.location,
                each.problem or "",
            )
        print_list(console_for(json_target), table, "url", "serial number")
    record = {"format": "phasewire-devices-1", "devices": [asdict(each) for each in found], "failures": dict(failures)}
    write_json(json_target, record)
    if not found:
        raise DeviceNotFoundError("no device found; `phasewire doctor` looks for the reason; emulator: always works")


@commands.command(epilog="Example: phasewire doctor --device usb:")
def doctor(
    device: Annotated[
        str | None,
        typer.Option(
            "--device",
            metavar="URL",
            envvar=URL_VARIABLE,
            help="The device to examine; by default the only one that can be found.",
            show_default=False,
            autocompletion=device_urls,
        ),
    ] = None,
    play: Annotated[
        bool, typer.Option("--play", help="Also play each transducer alone, softly, for some seconds in all.")
    ] = False,
    udev: Annotated[
        bool,
        typer.Option(
            "--udev-rule", help="Only print the udev rule that lets the users of a Linux computer use its devices."
        ),
    ] = False,
    json_target: JsonOption = None,
) -> None:
    """Check this computer and a device for problems, and suggest remedies.

    It stops what the device plays, tries silent patterns, and leaves the outputs off. Exit code 1 if a check failed, 3
    if there is no device.
    """
    check_outputs([json_target])
    if udev:
        typer.echo(udev_rule(), nl=False)
        return
    refuse_rig(device or "")
    findings = []
    for finding in examine(device, play=play):
        findings.append(finding)
        tell(finding, CHECKS, json_target)
    console_for(json_target).print(count(findings))
    write_json(json_target, {"format": "phasewire-doctor-1"} | as_record(findings))
    if any(finding.name == FOUND and finding.verdict is CheckVerdict.FAIL for finding in findings):
        raise typer.Exit(NO_DEVICE)
    if failed(findings):
        raise typer.Exit(CHECK_FAILED)
