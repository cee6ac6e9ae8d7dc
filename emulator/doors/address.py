"""The contents of an ``emulator:`` URL: a device plugged in to this process, or a fresh one, and its door."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar
from urllib.parse import parse_qsl

from ...base.errors import DeviceUrlError, ImageError, InputFileError
from ...base.storage import read_file
from ...protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed
from ...protocol.firmware import Image, parse
from ...protocol.framing import BAUD
from ...protocol.timing import FIVE_WIRE, LINKS, Link
from ..firmware.flash import Flash
from ..machine import Emulator, FirmwareChoice
from ..scenario import read_scenario
from .uart import MOST_BAUD

__all__ = ["SPEEDS", "EmulatorUrl"]

SPEEDS = {"high": HIGH_SPEED, "full": FULL_SPEED}
USB, SERIAL = "usb", "serial"
DOORS = {door: door for door in (USB, SERIAL)}

FIRMWARE: dict[str, FirmwareChoice] = {"model": "model", "xs1": "xs1"}
IMAGE_SUFFIX = ".dfu"
MOST_IMAGE_BYTES = 1024 * 1024
"""More than the largest image has (clause FWU-008)."""

OF_THE_DEVICE = {
    "link": "5wire or 2wire",
    "speed": "high or full",
    "firmware": f"model, xs1 or FILE{IMAGE_SUFFIX}",
    "faults": "FILE",
}
OF_THE_DOOR = {"door": "usb or serial", "baud": "RATE (of door=serial)"}

Choice = TypeVar("Choice")


@dataclass(frozen=True)
class EmulatorUrl:
    """A parsed ``emulator:`` URL.

    Parameters
    ----------
    serial : str
        Serial number of a device that is plugged in; empty for a fresh one.
    link, speed : Link, Speed
        Set-up of a fresh one.
    firmware : "model", "xs1" or Path
        Whether the processors of a fresh one are models, or execute the firmware of this package or that of a file.
    faults : Path or None
        Fault scenario for a fresh one.
    baud : int
        The rate of its UART, in bits per second.
    """

    serial: str
    link: Link
    speed: Speed
    firmware: FirmwareChoice | Path
    faults: Path | None
    baud: int

    @classmethod
    def parse(cls, url: str) -> Self:
        """Parse a URL.

        ``emulator:`` is a fresh emulator for the caller, with options ``?link=5wire`` or ``2wire``, ``speed=high``
        or ``full``, ``firmware=model``, ``xs1`` or ``FILE.dfu``, an image, and ``faults=FILE``, a scenario;
        ``emulator:SERIAL`` is one that this process has plugged in. Both have ``door=usb`` or ``serial``, and the
        latter ``baud=RATE``. Options are joined by ``&``.

        Raises
        ------
        DeviceUrlError
            If an option is unknown, or does not go with the others.
        """
        serial, _, query = url.partition(":")[2].partition("?")
        options = dict(parse_qsl(query, keep_blank_values=True))
        known = OF_THE_DOOR if serial else OF_THE_DEVICE | OF_THE_DOOR
        for option in options:
            if option in OF_THE_DEVICE and serial:
                raise DeviceUrlError(f"{url!r}: {option} goes with a fresh emulator, not with one that is plugged in")
            if option not in known:
                raise DeviceUrlError(
                    f"{url!r}: the emulator has no option {option!r}; it has "
                    + ", ".join(f"{name}={values}" for name, values in known.items())
                )
        door = _choice(url, "door", DOORS, options.get("door", USB))
        if "baud" in options and door != SERIAL:
            raise DeviceUrlError(f"{url!r}: baud goes with door=serial")
        return cls(
            serial,
            _choice(url, "link", LINKS, options.get("link", FIVE_WIRE.name)),
            _choice(url, "speed", SPEEDS, options.get("speed", "high")),
            _firmware(url, options.get("firmware", "model")),
            Path(options["faults"]) if "faults" in options else None,
            _baud(url, options.get("baud", str(BAUD))),
        )

    def image(self) -> Image | FirmwareChoice:
        """The firmware of a fresh one as `Emulator` takes it, read if it is a file.

        Raises
        ------
        ImageError, InputFileError
            If the file cannot be read, or is no image.
        """
        if not isinstance(self.firmware, Path):
            return self.firmware
        try:
            return parse(read_file(self.firmware, MOST_IMAGE_BYTES))
        except OSError as error:
            raise InputFileError(f"{self.firmware} cannot be read: {error.strerror}") from error
        except ImageError as error:
            raise ImageError(f"{self.firmware}: {error}", error.reason) from error

    def make(self, flash: Flash | None = None, *, history_periods: int | None = None) -> Emulator:
        """Make the fresh emulator, with a flash or as it leaves the factory; the history is as `Emulator` keeps it.

        A flash must contain the image that the URL names, if it names one.

        Raises
        ------
        ImageError, InputFileError
            If the image or the scenario cannot be read, or contains something impossible.
        """
        executed: FirmwareChoice = "model" if self.firmware == "model" else "xs1"
        emulator = Emulator(
            link=self.link,
            speed=self.speed,
            flash=flash,
            history_periods=history_periods,
            firmware=self.image() if flash is None else executed,
        )
        if self.faults is None:
            return emulator
        try:
            faults = read_scenario(self.faults)
        except OSError as error:
            raise InputFileError(f"{self.faults} cannot be read: {error.strerror}") from error
        try:
            emulator.inject(*faults)
        except ValueError as error:
            raise InputFileError(f"{self.faults}: {error}") from error
        return emulator


def _firmware(url: str, name: str) -> FirmwareChoice | Path:
    if name.endswith(IMAGE_SUFFIX):
        return Path(name)
    if name not in FIRMWARE:
        raise DeviceUrlError(f"{url!r}: unknown firmware {name!r}; known are {OF_THE_DEVICE['firmware']}")
    return FIRMWARE[name]


def _choice(url: str, option: str, known: Mapping[str, Choice], name: str) -> Choice:
    if name not in known:
        raise DeviceUrlError(f"{url!r}: unknown {option} {name!r}; known are {', '.join(known)}")
    return known[name]


def _baud(url: str, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= MOST_BAUD):
        raise DeviceUrlError(f"{url!r}: baud {text!r}; a serial line has 1 to {MOST_BAUD}")
    return int(text)
