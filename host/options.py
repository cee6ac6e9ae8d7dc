"""Options that commands which talk to a device have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .calibration import Calibration
from .completion import device_urls
from .transport import URL_VARIABLE

__all__ = ["CalibrationOption", "DeviceOption", "load_calibration"]

DeviceOption = Annotated[
    str,
    typer.Option(
        "--device",
        metavar="URL",
        envvar=URL_VARIABLE,
        help="emulator: (a fresh emulated device), usb: (the only one plugged in), usb:SERIAL, serial:///dev/ttyACM0, "
        "socket://HOST:PORT or rfc2217://HOST:PORT; `phasewire devices` lists what is there.",
        autocompletion=device_urls,
    ),
]

CalibrationOption = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="A .csv file of what each transducer really does; drives are corrected for it.",
    ),
]


def load_calibration(path: Path | None) -> Calibration | None:
    """The calibration in a file, None without one."""
    return None if path is None else Calibration.load(path)
