"""Options that several commands with a device share, and the messages for unsuitable ones."""

from __future__ import annotations

import shlex
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..host.transports.opening import RIG, URL_VARIABLE, is_fresh
from .completion import device_urls
from .console import error_console

if TYPE_CHECKING:  # the functions that use streaming load it: flash, conformance and others do without
    from ..host.streaming.calibration import Calibration
    from ..host.streaming.group import AnyDevice

__all__ = [
    "MOST_SECONDS",
    "CalibrationOption",
    "DeviceOption",
    "ForeverOption",
    "PoseOption",
    "SecondsOption",
    "command_for",
    "load_calibration",
    "note_where_fresh",
    "open_any",
    "rig_file",
]

MOST_SECONDS = 1e9
"""Thirty years: the longest duration that an option can state."""


DeviceOption = Annotated[
    str,
    typer.Option(
        "--device",
        metavar="URL",
        envvar=URL_VARIABLE,
        help="emulator: (a fresh emulated device; emulator:?door=serial by its UART), usb: (the only one plugged in), "
        "usb:SERIAL (or a part of it), usb:VVVV:PPPP (with these numbers), usbip:HOST:PORT (of a USB/IP server), "
        "serial:///dev/ttyACM0, socket://HOST:PORT or rfc2217://HOST:PORT; `phasewire devices` lists what is there. "
        "show, stream, play, stop and info also take rig:FILE, several devices as one (docs/how-to/rigs.md).",
        autocompletion=device_urls,
    ),
]

CalibrationOption = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="A .csv file of each transducer's real emission; drives are corrected for it.",
    ),
]

PoseOption = Annotated[
    Path | None,
    typer.Option(
        "--pose",
        metavar="FILE",
        help="A .toml file with the tracker's position (docs/how-to/hands.md).",
    ),
]

SecondsOption = Annotated[float, typer.Option(min=0, max=MOST_SECONDS, help="How long to play, in s.")]

ForeverOption = Annotated[bool, typer.Option("--forever", help="Play until Ctrl-C, whatever --seconds says.")]


def load_calibration(path: Path | None) -> Calibration | None:
    """The calibration in a file, None without one."""
    from ..host.streaming.calibration import Calibration

    return None if path is None else Calibration.load(path)


def rig_file(url: str) -> Path | None:
    """The rig file that a URL names, None for the URL of one device."""
    return Path(url.removeprefix(RIG)) if url.startswith(RIG) else None


def open_any(url: str, calibration: Path | None) -> AnyDevice:
    """Open the device that a URL names, or the devices of a rig; people are told of what is odd about these.

    Raises
    ------
    ValueError
        If a calibration is given for a rig.
    InputFileError, DeviceError
        As `read_rig`, `open_devices` and `open_device`.
    """
    from ..host.streaming.device import open_device
    from ..host.streaming.group import open_devices
    from ..host.streaming.rig import read_rig

    path = rig_file(url)
    if path is None:
        return open_device(url, calibration=load_calibration(calibration))
    if calibration is not None:
        raise ValueError(f"--calibration is for one device; in {path} each device names its own")
    with warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always")
        group = open_devices(read_rig(path))
    for each in odd:
        error_console().print(f"warning: {each.message}", style="yellow")
    return group


def command_for(command: str, url: str) -> str:
    """A command line for this device, to be typed."""
    return f"`phasewire {command} --device {shlex.quote(url)}`"


def note_where_fresh(url: str) -> None:
    """Warn that the command used a fresh emulated device instead of a real one, if it did."""
    if is_fresh(url):
        error_console().print(
            f"note: {url} is a fresh emulated device, which is gone when this command ends. For another give --device, "
            f"such as --device usb:, or set {URL_VARIABLE}; `phasewire devices` lists what is there.",
            style="yellow",
        )
