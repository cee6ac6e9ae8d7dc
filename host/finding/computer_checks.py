"""The doctor's checks of the computer and of the USB bus: whether a device could be reached at all."""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import usb.core
import usb.util

from ...base.errors import DeviceNotFoundError
from ...protocol.board import CORE_HZ
from ...protocol.codes import BLOCK_BYTES
from ...protocol.enumeration import ARRAY_INTERFACE, CONSOLE_DATA_INTERFACE, CONSOLE_INTERFACE, FULL_SPEED
from ...protocol.timing import FULL_SPEED_PACKET_CYCLES
from ..transports.libusb import open_backend
from ..transports.usb_find import INSTALL_RULE, Sighting
from .discovery import search
from .findings import Judgement, fail, ok, skipped, warn

__all__ = ["BUS_CHECKS", "COMPUTER_CHECKS", "Computer", "udev_rule"]

RULE_NAME = "60-phasewire.rules"
RULE_FOLDERS = ("etc/udev/rules.d", "run/udev/rules.d", "usr/local/lib/udev/rules.d", "usr/lib/udev/rules.d")
"""Where udev looks, the first in this order first."""
GROUP = "plugdev"
PACKAGES = ("phasewire", "numpy", "pyusb", "libusb-package", "pyserial")


@dataclass(frozen=True)
class Computer:
    """What the checks ask of the computer, besides its buses.

    Parameters
    ----------
    system : str
        As `sys.platform`.
    root : Path
        The folder where its files lie.
    superuser : bool
        Whether this program may do anything.
    groups : frozenset of str
        The groups to which its user belongs.
    """

    system: str
    root: Path
    superuser: bool
    groups: frozenset[str]

    @classmethod
    def this(cls) -> Computer:
        """The one that this program runs on."""
        if sys.platform == "win32":
            return cls(sys.platform, Path("/"), False, frozenset())
        import grp

        groups = frozenset(entry.gr_name for entry in grp.getgrall() if entry.gr_gid in os.getgroups())
        return cls(sys.platform, Path("/"), os.geteuid() == 0, groups)


def udev_rule() -> str:
    """The rule by which Linux lets the users of a computer use its devices."""
    return files(__package__).joinpath(RULE_NAME).read_text(encoding="utf-8")


def _python(_computer: Computer) -> Judgement:
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return ok(f"Python {platform.python_version()} on {platform.platform(terse=True)}; {packages}")


class _LibusbVersion(ctypes.Structure):
    """libusb's struct libusb_version."""

    _fields_ = (
        *((name, ctypes.c_uint16) for name in ("major", "minor", "micro", "nano")),
        *((name, ctypes.c_char_p) for name in ("rc", "describe")),
    )


def _libusb(_computer: Computer) -> Judgement:
    try:
        library = open_backend("usb:").lib
    except DeviceNotFoundError as error:
        return fail(str(error), "install it anew: pip install --force-reinstall libusb-package")
    library.libusb_get_version.restype = ctypes.POINTER(_LibusbVersion)
    number = library.libusb_get_version().contents
    return ok(f"libusb {number.major}.{number.minor}.{number.micro}")


def _usb_bus(_computer: Computer) -> Judgement:
    try:
        devices = list(usb.core.find(find_all=True, backend=open_backend("usb:")))
    except (DeviceNotFoundError, usb.core.USBError) as error:
        return skipped(str(error))
    if devices:
        return ok(f"{len(devices)} devices on USB, hubs included")
    return warn(
        "there is no USB bus here, not even a hub",
        "a container or a virtual machine must be given the device: for a container, --device /dev/bus/usb",
    )


def _transports(_computer: Computer) -> Judgement:
    found, failures = search()
    seen = f"{len(found)} devices found" + "".join(f"; {name}: {why}" for name, why in failures.items())
    return warn(seen, "what has failed cannot find devices") if failures else ok(seen)


_INSTALL = f"run `{INSTALL_RULE}`, then plug the device in again"


def _udev_rule(computer: Computer) -> Judgement:
    if computer.system != "linux":
        return skipped("only Linux needs one")
    installed = [computer.root / folder / RULE_NAME for folder in RULE_FOLDERS]
    path = next(filter(Path.exists, installed), None)
    if path is None:
        if computer.superuser:
            return ok("not installed; the superuser needs none")
        return warn("not installed: only the superuser may use a device", _INSTALL)
    if path.read_text(encoding="utf-8") != udev_rule():
        return warn(f"{path} is not this version's", _INSTALL)
    if computer.superuser or GROUP in computer.groups:
        return ok(f"{path} gives access")
    return ok(f"{path} gives access to who sits at this computer; others need the group {GROUP}")


COMPUTER_CHECKS: Mapping[str, Callable[[Computer], Judgement]] = {
    "python": _python,
    "libusb": _libusb,
    "usb bus": _usb_bus,
    "transports": _transports,
    "udev rule": _udev_rule,
}


def _access(seen: Sighting) -> Judgement:
    if seen.found.problem is None:
        return ok("it may be opened")
    reason, _, cure = seen.found.problem.partition(": ")
    return fail(reason, cure)


def _driver(seen: Sighting) -> Judgement:
    device = seen.device
    try:
        held = {number for number in range(device[0].bNumInterfaces) if device.is_kernel_driver_active(number)}
    except NotImplementedError:
        return skipped("this system does not tell")
    except usb.core.USBError as error:
        return skipped(f"cannot be asked: {error.strerror}")
    finally:
        usb.util.dispose_resources(device)
    if ARRAY_INTERFACE in held:
        return fail(
            "a driver of the system holds interface 0, which is phasewire's",
            "`lsusb -t` names it; keep it from this device, or unload it",
        )
    console = {CONSOLE_INTERFACE, CONSOLE_DATA_INTERFACE} & held
    return ok("interface 0 is free" + "; the system's serial driver has the console, as it should" * bool(console))


def _cable(seen: Sighting) -> Judgement:
    place = seen.found.location
    hub = place.rpartition(".")[0]
    through = f"through the hub at {hub}" if hub else "directly"
    if not seen.full_speed:
        return ok(f"high speed at {place}, {through}")
    blocks = CORE_HZ // FULL_SPEED_PACKET_CYCLES * FULL_SPEED.bulk_bytes // BLOCK_BYTES
    return warn(
        f"full speed at {place}, {through}: at most {blocks} blocks a second",
        f"use a shorter or another cable, {'no hub' if hub else 'another port'}, and a port of USB 2.0 or newer",
    )


def _console(seen: Sighting) -> Judgement:
    lines = (each for each in search().found if each.url.startswith("serial:"))
    ports = [each for each in lines if each.serial and each.serial == seen.found.serial]
    if not ports:
        return skipped("no serial port of it is to be seen; phasewire does not need one")
    if ports[0].problem:
        problem, _, _ = ports[0].problem.partition("; `phasewire doctor`")
        return warn(f"{ports[0].location}: {problem}", _INSTALL)
    return ok(f"a terminal finds it at {ports[0].location}, phasewire at {ports[0].url}")


BUS_CHECKS: Mapping[str, Callable[[Sighting], Judgement]] = {
    "access": _access,
    "driver": _driver,
    "cable": _cable,
    "console": _console,
}
