"""What is wrong between a program and the pulses of a device, and what to do about it: one small check after the other.

A check that cannot be made is skipped and says why, so that the doctor works with half a device, or none. Whatever it
finds, the outputs are off when it ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import TypeVar
from urllib.parse import parse_qs

from ..errors import DeviceError, DeviceLostError, DeviceNotFoundError
from .computer_checks import BUS_CHECKS, COMPUTER_CHECKS, Computer
from .device import Device, open_device
from .device_checks import DEVICE_CHECKS, QUIET_CHECKS
from .discovery import search
from .findings import Finding, Judgement, Verdict, fail, skipped
from .transport import entries
from .usb_find import BACKENDS, RUN_TIME, Sighting, UsbBus

__all__ = ["CHECKS", "FOUND", "examine"]

Subject = TypeVar("Subject")

FOUND, OPENED = "device", "open"
CHECKS = (*COMPUTER_CHECKS, FOUND, *BUS_CHECKS, OPENED, *DEVICE_CHECKS)
"""The names of all, in their order."""


def examine(url: str | None = None, *, play: bool = False, computer: Computer | None = None) -> Iterator[Finding]:
    """Make every check, and tell each finding at once.

    Parameters
    ----------
    url : str, optional
        Of the device; by default the only one that can be found.
    play : bool
        Whether to play each transducer alone, softly: some seconds of sound.
    computer : Computer, optional
        This one by default.

    Yields
    ------
    Finding
        One for each of `CHECKS`, in their order. ``device`` fails where there is none, and only there.
    """
    yield from _made(COMPUTER_CHECKS, computer or Computer.this())
    try:
        chosen = _only_one() if url is None else url
        seen = _on_bus(chosen)
        line = [*_made(BUS_CHECKS, seen)] if seen else [*_left_out(BUS_CHECKS, "this line is not USB")]
        locked = seen is not None and seen.found.problem is not None
        device, failure = (None, "see access") if locked else _opened(chosen)
    except DeviceNotFoundError as error:
        yield Finding(FOUND, Verdict.FAIL, str(error), "plug it in, with power; emulator: always works")
        yield from _left_out(CHECKS[CHECKS.index(FOUND) + 1 :], "there is no device")
        return
    where = f" at {seen.found.location}, firmware {seen.found.firmware}" if seen else ""
    begun = [Finding(FOUND, Verdict.OK, f"{chosen}{where}"), *line]
    if device is None:
        yield from begun
        yield Finding(OPENED, Verdict.SKIPPED if locked else Verdict.FAIL, failure)
        yield from _left_out(DEVICE_CHECKS, "the device cannot be opened")
        return
    with suppress(DeviceError), device:  # what it has to say of a device that is gone has been said
        yield from begun
        yield Finding(OPENED, Verdict.OK, f"{device.name} answers")
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
    """The device as its USB bus shows it; None where the line is another."""
    scheme, _, rest = url.partition(":")
    door = parse_qs(rest.partition("?")[2]).get("door", ["usb"])[-1]
    if door != "usb" or scheme not in entries(BACKENDS):
        return None
    return UsbBus(url).sight((RUN_TIME,))


def _opened(url: str) -> tuple[Device | None, str]:
    """A device, or why it cannot be opened."""
    try:
        return open_device(url), ""
    except DeviceNotFoundError:
        raise
    except DeviceError as error:
        return None, _line(error)


def _line(error: DeviceError) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split())


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
            judgement = fail(_line(error), "")
        yield Finding(name, *judgement)


def _left_out(names: Iterable[str], why: str) -> Iterator[Finding]:
    return (Finding(name, *skipped(why)) for name in names)
