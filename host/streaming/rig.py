"""Rigs: several devices whose transducers make one array, in a program or in a TOML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InputFileError
from ...base.storage import FilePath
from ...solver import TransducerArray
from ...solver.acoustics.array import check_array
from ...solver.acoustics.array_files import DEVICE, read_devices
from ...solver.geometry import frozen
from ..transports.opening import is_fresh
from .calibration import Calibration

__all__ = ["MOST_DEVICES", "RigDevice", "check_rig", "read_rig"]

MOST_DEVICES = 64


@dataclass(frozen=True, eq=False)
class RigDevice:
    """A device of a rig.

    Parameters
    ----------
    url : str
        The URL by which it is opened, as by `open_device`.
    array : TransducerArray, optional
        Its transducers where they are: ``TransducerArray.grid().placed(rotation, position)``. By default 20 × 16 about
        the origin.
    name : str, optional
        The name in messages; its URL by default.
    calibration : Calibration, optional
        The real emission of each of these transducers.
    channels : (n,) int, optional
        The number of each transducer of ``array`` in the device's own order. By default the device has as many, in
        this order; those that are not named stay silent.

    Raises
    ------
    ValueError
        If the calibration or the channels do not fit the array.
    """

    url: str
    array: TransducerArray
    name: str
    calibration: Calibration | None
    channels: NDArray[np.intp] | None

    def __init__(
        self,
        url: str,
        array: TransducerArray | None = None,
        *,
        name: str = "",
        calibration: Calibration | None = None,
        channels: ArrayLike | None = None,
    ) -> None:
        object.__setattr__(self, "url", url)
        object.__setattr__(self, "array", TransducerArray.grid() if array is None else array)
        object.__setattr__(self, "name", name or url)
        object.__setattr__(self, "calibration", calibration)
        check_array(self.array)
        if calibration is not None and len(calibration) != len(self.array):
            raise ValueError(f"the calibration is for {len(calibration)} transducers, there are {len(self.array)}")
        object.__setattr__(self, "channels", None if channels is None else _channels(channels, len(self.array)))

    def __repr__(self) -> str:
        return f"RigDevice({self.url}, {self.array})"


def _channels(channels: ArrayLike, transducers: int) -> NDArray[np.intp]:
    try:
        numbers = np.array(channels)
    except ValueError:
        numbers = np.array(None)
    if numbers.dtype.kind not in "iu" or numbers.shape != (transducers,) or numbers.min() < 0:
        raise ValueError(f"channels must be {transducers} whole numbers from 0 on, one for each transducer")
    if len(np.unique(numbers)) < transducers:
        twice = np.flatnonzero(np.bincount(numbers) > 1)[0]
        raise ValueError(f"channel {twice} is named twice; each transducer needs one of its own")
    return frozen(numbers.astype(np.intp))


def check_rig(devices: Sequence[RigDevice]) -> None:
    """Raise `ValueError` if devices cannot be opened as one: none, too many, or the same one twice."""
    if not 1 <= len(devices) <= MOST_DEVICES:
        raise ValueError(f"a rig has 1 to {MOST_DEVICES} devices, not {len(devices)}")
    for kind in ("name", "url"):
        met: dict[str, int] = {}
        for number, device in enumerate(devices, start=1):
            value = getattr(device, kind)
            if value in met and not is_fresh(value):
                raise ValueError(f"devices {met[value]} and {number} have the same {kind} {value!r}; each has its own")
            met[value] = number


def read_rig(path: FilePath) -> tuple[RigDevice, ...]:
    """Read a rig from a TOML file; docs/how-to/rigs.md describes it.

    The same file is an array: `read_transducers` joins the transducers of all devices, in their order.

    Raises
    ------
    InputFileError
        If the file is not readable as such; the error names the device and the field.
    OSError
        If it cannot be opened.
    """
    path = Path(path)
    devices = []
    for number, (array, fields) in enumerate(read_devices(path), start=1):
        try:
            devices.append(_device(array, fields, f"{DEVICE} {number}", path.parent))
        except ValueError as error:
            raise InputFileError(f"{path}, {DEVICE} {number}: {error}") from error
    try:
        check_rig(devices)
        TransducerArray.joined([device.array for device in devices])
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error
    return tuple(devices)


def _device(array: TransducerArray, fields: Mapping[str, Any], name: str, folder: Path) -> RigDevice:
    for key in ("url", "name", "calibration"):
        value = fields.get(key, None if key == "url" else "text")
        if not isinstance(value, str) or not value:
            given = "missing" if value is None else repr(value)
            raise ValueError(f"{key} is {given}; it must be text, such as {_SUCH_AS[key]!r}")
    calibration = None
    if file := fields.get("calibration"):
        try:
            calibration = Calibration.load(folder / file)
        except OSError as error:
            raise ValueError(f"calibration {file!r} cannot be read: {error.strerror}") from error
    return RigDevice(
        fields["url"],
        array,
        name=fields.get("name", name),
        calibration=calibration,
        channels=fields.get("channels"),
    )


_SUCH_AS = {"url": "usb:SERIAL", "name": "left", "calibration": "left.csv"}
