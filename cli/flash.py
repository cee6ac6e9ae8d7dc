"""The command that gives a device new firmware: ``flash``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from ..base.errors import DeviceNotFoundError
from ..base.storage import check_outputs
from ..host.firmware.images import read_firmware
from ..host.firmware.keys import read_public_keys
from ..host.transports.opening import DEFAULT_URL
from ..protocol.plain import plain
from .console import JsonOption, console_for, error_console, given, print_list, write_json
from .options import DeviceOption, note_where_fresh

if TYPE_CHECKING:
    from ..host.firmware.flashing import FlashStage, OnProgress

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

FOR_IMAGES = ("keys", "allow_downgrade", "allow_other_protocol")
"""Parameters that need an image."""


@commands.command(epilog="Example: phasewire flash firmware.dfu --device usb:")
def flash(
    context: typer.Context,
    image: Annotated[
        Path | None,
        typer.Argument(
            metavar="IMAGE",
            help="A firmware file (.dfu), as `phasewire firmware build` makes it.",
            exists=True,
            dir_okay=False,
            readable=True,
            show_default=False,
        ),
    ] = None,
    device: DeviceOption = DEFAULT_URL,
    keys: Annotated[
        list[Path] | None,
        typer.Option(
            "--key",
            metavar="PUBLIC.pem",
            help="Send only what was signed with this Ed25519 key; may be given several times.",
            exists=True,
            dir_okay=False,
            readable=True,
        ),
    ] = None,
    allow_downgrade: Annotated[
        bool, typer.Option("--allow-downgrade", help="Send an image that is older than what runs.")
    ] = False,
    allow_other_protocol: Annotated[
        bool,
        typer.Option("--allow-other-protocol", help="Send an image whose protocol this program does not know."),
    ] = False,
    list_devices: Annotated[bool, typer.Option("--list", help="List devices, with mode, firmware and bank.")] = False,
    revert: Annotated[bool, typer.Option("--revert", help="Have the device return to its factory image.")] = False,
    json_target: JsonOption = None,
) -> None:
    """Give a device new firmware, completely or not at all, and check that it runs.

    It uses USB and DFU. The device is silent from the beginning, and its outputs are off in the end. After any error,
    and after Ctrl-C, it boots its old firmware, or the new image if that was complete; then run the command again.
    """
    if (image is not None) + list_devices + revert != 1:
        raise ValueError("which action? Give one of IMAGE, --list and --revert")
    if image is None and any(given(context, option) for option in FOR_IMAGES):
        raise ValueError("--key, --allow-downgrade and --allow-other-protocol have no effect without IMAGE")
    check_outputs([json_target], inputs=[image] if image else [])
    note_where_fresh(device)
    if list_devices:
        _list(device, json_target)
    elif revert:
        _revert(device, json_target)
    else:
        assert image is not None
        _flash(image, device, keys or [], allow_downgrade, allow_other_protocol, json_target)


def _flash(
    path: Path,
    device: str,
    key_files: list[Path],
    allow_downgrade: bool,
    allow_other_protocol: bool,
    json_target: str | None,
) -> None:
    from ..host.firmware.flashing import flash

    firmware = read_firmware(path, read_public_keys(key_files))
    console = error_console()
    console.print(f"{path}: firmware {firmware.image.version}, {firmware.trust.value}")
    try:
        with _progress(console) as on_progress:
            report = flash(
                device,
                firmware,
                allow_downgrade=allow_downgrade,
                allow_other_protocol=allow_other_protocol,
                on_progress=on_progress,
            )
    except KeyboardInterrupt:
        console.print(
            "Stopped. The device boots its old firmware, or the new one if that was whole; to go on, give the same "
            "command again.",
            style="yellow",
        )
        raise
    done = f"was given firmware {report.firmware}" if report.written else f"held firmware {report.firmware} already"
    console_for(json_target).print(
        f"{report.device} {done}, which runs on all eleven processors, from bank {report.bank.name}; before it ran "
        f"{report.before}."
    )
    versions = {"before": str(report.before), "firmware": str(report.firmware)}
    write_json(json_target, {"format": "phasewire-flash-1"} | plain(report) | versions)


@contextmanager
def _progress(console: Console) -> Iterator[OnProgress]:
    """Show the progress: as a bar on a terminal, elsewhere as a line for each stage."""
    if not console.is_terminal:
        last: list[FlashStage] = []

        def say(stage: FlashStage, _done: int, _total: int) -> None:
            if last[-1:] != [stage]:
                last.append(stage)
                console.print(stage.value)

        yield say
        return
    from rich.progress import BarColumn, DownloadColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(bar_width=24), DownloadColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        tasks: dict[FlashStage, TaskID] = {}

        def move(stage: FlashStage, done: int, total: int) -> None:
            if stage not in tasks:
                for earlier in tasks.values():
                    bar.remove_task(earlier)
                tasks.clear()
                tasks[stage] = bar.add_task(stage.value, total=total or None)
            bar.update(tasks[stage], completed=done)

        yield move


def _list(device: str, json_target: str | None) -> None:
    from ..host.firmware.flashing import find_flashable

    found = find_flashable(device)
    table = Table("url", "product", "mode", "firmware", "bank", "problem", box=None, pad_edge=False)
    for each in found:
        bank = each.bank.name if each.bank else "–"
        table.add_row(each.url, each.product, each.mode, str(each.firmware), bank, each.problem or "")
    if found:
        print_list(console_for(json_target), table, "url")
    devices = [plain(each._asdict()) | {"firmware": str(each.firmware)} for each in found]
    write_json(json_target, {"format": "phasewire-flash-list-1", "devices": devices})
    if not found:
        raise DeviceNotFoundError(f"no device on the bus of {device!r}; is it switched on and plugged in?")


def _revert(device: str, json_target: str | None) -> None:
    from ..host.firmware.flashing import revert

    report = revert(device)
    console_for(json_target).print(
        f"{report.device} is back at its factory image, firmware {report.firmware}; before it ran {report.before}."
    )
    told = {key: str(value) for key, value in report._asdict().items()}
    write_json(json_target, {"format": "phasewire-flash-revert-1"} | told)
