"""What is wrong between a program and the pulses of a device, and what to do about it: one small check after the other.

A check that cannot be made is skipped and says why, so that the doctor works with half a device, or none. Whatever it
finds, the outputs are off when it ends, and the device's settings as they were.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from typing import TypeVar
from urllib.parse import parse_qs

from ...base.errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceRefusedError,
    DeviceTimeoutError,
    DeviceVersionError,
)
from ...base.plugins import entries
from ..streaming.device import Device, open_device
from ..transports.opening import MEANT
from ..transports.usb_find import BACKENDS, RUN_TIME, Sighting, UsbFinder
from .computer_checks import BUS_CHECKS, COMPUTER_CHECKS, Computer
from .device_checks import DEVICE_CHECKS, QUIET_CHECKS, as_found
from .discovery import search
from .findings import FLASH, RESET, CheckVerdict, Finding, Judgement, fail, ok, skipped

__all__ = ["CHECKS", "FOUND", "examine"]

Subject = TypeVar("Subject")

FOUND, OPENED = "device", "open"
CHECKS = (*COMPUTER_CHECKS, FOUND, *BUS_CHECKS, OPENED, *DEVICE_CHECKS)
"""The names of all, in their order."""

CURES: Mapping[type[DeviceError], str] = {
    DeviceLostError: "plug it in again; if it goes away again, look at its cable and its power",
    DeviceTimeoutError: "switch it off and on; on a serial line, look at its cable and its baud rate",
    DeviceAccessError: "close what else uses it; on Linux a serial port belongs to a group, mostly dialout: `sudo "
    "usermod -aG dialout $USER`, and log in again",
    DeviceRefusedError: f"`{RESET}`, or switch it off and on",
    DeviceVersionError: f"update the older of the two: phasewire as it was installed, or the firmware by `{FLASH}`",
    DeviceError: f"`{RESET}`, or switch it off and on; if it stays, write its firmware anew: `{FLASH}`",
}
"""What to do if a check cannot be finished, by the first kind of error that fits."""


def examine(url: str | None = None, *, play: bool = False, computer: Computer | None = None) -> Iterator[Finding]:
    """Make every check, and tell each finding at once.

    Parameters
    ----------
    url : str, optional
        The URL of the device; by default the only one that can be found.
    play : bool
        Whether to play each transducer alone, softly: some seconds of sound.
    computer : Computer, optional
        This one by default.

    Yields
    ------
    Finding
        One for each of `CHECKS`, in their order. ``device`` fails if there is none, and only there.
    """
    yield from _made(COMPUTER_CHECKS, computer or Computer.this())
    try:
        chosen = _only_one() if url is None else url
    except DeviceNotFoundError as error:
        yield from _nothing_there(error)
        return
    with closing(_examined(chosen, play)) as findings:
        for finding in findings:
            yield finding._replace(advice=finding.advice.replace("--device URL", f"--device {shlex.quote(chosen)}"))


def _nothing_there(error: DeviceNotFoundError) -> Iterator[Finding]:
    said, meant, url = str(error).partition(MEANT)
    advice = f"{meant.lstrip('; ')}{url}" if meant else "plug it in, with power; emulator: always works"
    yield Finding(FOUND, CheckVerdict.FAIL, said, advice)
    yield from _left_out(CHECKS[CHECKS.index(FOUND) + 1 :], "there is no device")


def _examined(chosen: str, play: bool) -> Generator[Finding]:
    """The findings about a device and its line."""
    try:
        seen = _on_bus(chosen)
        line = [*_made(BUS_CHECKS, seen)] if seen else [*_left_out(BUS_CHECKS, "this line is not USB")]
        locked = seen is not None and seen.found.problem is not None
        device, opening = (None, skipped("see access")) if locked else _opened(chosen)
    except DeviceNotFoundError as error:
        yield from _nothing_there(error)
        return
    where = f" at {seen.found.location}, firmware {seen.found.firmware}" if seen else ""
    begun = [Finding(FOUND, CheckVerdict.OK, f"{chosen}{where}"), *line]
    if device is None:
        yield from begun
        yield Finding(OPENED, *opening)
        yield from _left_out(DEVICE_CHECKS, "the device cannot be opened")
        return
    with suppress(DeviceError), device, as_found(device):  # what it has to say of a device that is gone has been said
        yield from begun
        yield Finding(OPENED, *opening)
        yield from _made(DEVICE_CHECKS if play else QUIET_CHECKS, device)


def _only_one() -> str:
    """URL of the only device that can be found; one that has a serial line besides USB is one."""
    found = sorted(search().found, key=lambda each: not each.url.startswith("serial:"))
    urls = [each.url for each in {each.serial or each.url: each for each in found}.values()]
    if len(urls) == 1:
        return urls[0]
    if urls:
        raise DeviceNotFoundError(f"there are {len(urls)} devices; name one with --device: {' or '.join(urls)}")
    raise DeviceNotFoundError("no device can be found")


def _on_bus(url: str) -> Sighting | None:
    """The device as its USB bus shows it; None if the line is another."""
    scheme, _, rest = url.partition(":")
    door = parse_qs(rest.partition("?")[2]).get("door", ["usb"])[-1]
    if door != "usb" or scheme not in entries(BACKENDS):
        return None
    return UsbFinder(url).sight((RUN_TIME,))


def _opened(url: str) -> tuple[Device | None, Judgement]:
    """A device, and that it answers; or why it cannot be opened."""
    try:
        device = open_device(url)
        return device, ok(f"{device.name} answers")
    except DeviceNotFoundError:
        raise
    except DeviceError as error:
        return None, _failed(error)


def _failed(error: DeviceError) -> Judgement:
    """What an error says, in one line and without sending people here, and what to do about it."""
    said, _, _ = " ".join(str(error).split()).partition("; `phasewire doctor`")
    return fail(said, next(cure for kind, cure in CURES.items() if isinstance(error, kind)))


def _made(checks: Mapping[str, Callable[[Subject], Judgement]], subject: Subject) -> Iterator[Finding]:
    """The findings of checks; once the device is gone the rest are left out."""
    gone = False
    for name, check in checks.items():
        if gone:
            yield from _left_out([name], "the device is gone")
            continue
        try:
            judgement = check(subject)
        except DeviceError as error:
            gone = isinstance(error, DeviceLostError)
            judgement = _failed(error)
        yield Finding(name, *judgement)


def _left_out(names: Iterable[str], why: str) -> Iterator[Finding]:
    return (Finding(name, *skipped(why)) for name in names)
