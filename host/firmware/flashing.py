"""New firmware for a device: one image, whole or not at all (SPEC.md, chapters FWU and DFU).

`flash` begins with whatever state the device is in, refuses what can be refused before a byte of the old firmware is
lost, and ends when all eleven processors say that they run the new one. The device never loses what it runs: the image
goes to another bank, and its record is written last. So what to do about a line that fails is always the same: begin
again. Nothing could be resumed, because a device that comes back was reset, which boots it (clause DFU-015), and blocks
begin at 0 (clause DFU-009). An image that is already there is not sent again.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, TypeVar

import usb.util

from ...base.errors import (
    DeviceError,
    DeviceLostError,
    DeviceStalledError,
    DeviceTimeoutError,
    ImageError,
    InputFileError,
)
from ...protocol.codes import PROTOCOL_VERSION, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Bank, Feature, ImageReason, Request
from ...protocol.enumeration import ARRAY_INTERFACE
from ...protocol.firmware import Trust
from ...protocol.replies import ANSWER_BYTES, Info, ProcessorReport, decode_reports
from ...protocol.requests import Setup
from ...protocol.versions import Version
from ..transports.transport import understood
from ..transports.usb_find import ANY_MODE, DFU_MODE, RUN_TIME, DeviceMode, Sighting, UsbFinder, control, opened
from .dfu import DfuLine, detach
from .images import Firmware

__all__ = ["FlashReport", "FlashStage", "Flashable", "RevertReport", "find_flashable", "flash", "revert"]

Answer = TypeVar("Answer")

ATTEMPTS = 3
PAUSE_SECONDS = 0.5
"""Before it is tried again."""
BACK_SECONDS = 10.0
"""How long a device may be away: clause REQ-014 allows as much, and some systems take seconds to enumerate one."""
LEAVE_SECONDS = 1.0
"""How long a device may stay on the bus that was told to restart."""
LOOK_SECONDS = 0.01
MARK_SECONDS = 0.02
"""In which firmware that has come up has written so into its flash: that is a page, 3 ms at most (clause DFU-008)."""

STILL_WHOLE = "It boots its old firmware, or the new one if that was whole; flash it again then"


class _NotStartedError(DeviceError):
    """Something else runs than was sent: the flash is bad, or power failed in the first moments of a new image."""


WORTH_ANOTHER = (DeviceLostError, DeviceTimeoutError, DeviceStalledError, _NotStartedError)
ANY = 0xFFFF


class FlashStage(Enum):
    """What `flash` is doing."""

    DETACH = "going to DFU mode"
    COMPARE = "comparing with what it holds"
    WRITE = "writing"
    CHECK = "reading back"
    BOOT = "starting the new firmware"


OnProgress = Callable[[FlashStage, int, int], None]
"""Told a stage, and how many of how many bytes are done in it; 0 of 0 if none are counted."""


@dataclass(frozen=True)
class FlashReport:
    """What became of a device.

    Parameters
    ----------
    device : str
        Its name.
    before : Version
        The version of the firmware that ran.
    firmware : Version
        The version of the firmware that all eleven processors run now.
    bank : Bank
        The bank where it lies.
    trust : Trust
        Who stands behind it.
    written : bool
        False if the device held this image already.
    attempts : int
        How often it was begun.
    """

    device: str
    before: Version
    firmware: Version
    bank: Bank
    trust: Trust
    written: bool
    attempts: int


class RevertReport(NamedTuple):
    """A device that is back at its factory image, and the versions of its firmware."""

    device: str
    before: Version
    firmware: Version


class Flashable(NamedTuple):
    """A device whose firmware could be replaced."""

    url: str
    product: str
    serial: str | None
    mode: DeviceMode
    firmware: Version
    """That runs; in DFU mode, that ran."""
    bank: Bank | None
    """Where that lies; None if the device does not say."""
    problem: str | None
    """What speaks against it, None if nothing is known to."""


def flash(
    url: str,
    firmware: Firmware,
    *,
    allow_downgrade: bool = False,
    allow_other_protocol: bool = False,
    on_progress: OnProgress = lambda *_: None,
) -> FlashReport:
    """Replace the firmware of a device on a USB bus.

    The device is silent from the beginning, and has its outputs off in the end. A line that fails is given two more
    attempts. Whatever goes wrong, also Ctrl-C, the device boots what it ran before, or the new image if that was whole.

    Parameters
    ----------
    url : str
        The URL of the device: a scheme with a USB bus, such as ``usb:`` or ``usb:SERIAL``. It may be in DFU mode
        already.
    firmware : Firmware
        What `images.read_firmware` has read.
    allow_downgrade, allow_other_protocol : bool
        Whether the image may be older than what runs, or speak a protocol that this host does not (clause FWU-013).
    on_progress : callable
        Told how far it is.

    Raises
    ------
    ImageError, InputFileError
        If the image is refused; the device has not been touched.
    DeviceNotFoundError
        If there is no such device.
    DeviceRefusedError
        If the device refuses the image, or its flash fails; it runs what it ran.
    DeviceError
        If line or device fail.
    """
    bus = UsbFinder(url)
    seen = bus.find()
    before = _check(firmware, seen, allow_downgrade, allow_other_protocol)
    attempt = 1
    while True:
        try:
            back, written = _replace(bus, seen, firmware.image.encode(), on_progress)
            bank = _confirm(bus, back, firmware.image.version)
            return FlashReport(back.name, before, firmware.image.version, bank, firmware.trust, written, attempt)
        except WORTH_ANOTHER as error:
            if attempt == ATTEMPTS:
                raise type(error)(f"{error} (tried {ATTEMPTS} times). {STILL_WHOLE}") from error
        attempt += 1
        seen.time.sleep(PAUSE_SECONDS)
        try:
            seen = bus.find_again(seen, ANY_MODE, BACK_SECONDS)
        except DeviceLostError as error:
            raise DeviceLostError(f"{error}. {STILL_WHOLE}") from error


def _check(firmware: Firmware, seen: Sighting, allow_downgrade: bool, allow_other_protocol: bool) -> Version:
    """Refuse what this device must not be sent, before it is touched; the version that it runs."""
    image, suffix = firmware.image, firmware.suffix
    if suffix.vendor not in (seen.vendor, ANY) or suffix.product not in (seen.product_id, ANY):
        raise ImageError(
            f"the file is for {suffix.vendor:04x}:{suffix.product:04x}, not for {seen.name}, which is "
            f"{seen.vendor:04x}:{seen.product_id:04x} (clause {ImageReason.SUFFIX.clause})",
            ImageReason.SUFFIX,
        )
    before = seen.firmware
    if seen.mode == RUN_TIME:
        # In DFU mode it does not tell its hardware, and compares that before it erases anything (clause DFU-010).
        info = _info(seen)
        before = Version(*info.firmware)
        if info.hardware != image.hardware:
            raise ImageError(
                f"{ImageReason.HARDWARE.text} (clause {ImageReason.HARDWARE.clause}): for {image.hardware.value}, "
                f"{image.hardware.name}, and {seen.name} is {info.hardware}",
                ImageReason.HARDWARE,
            )
        if Feature.DFU not in info.features:
            raise DeviceError(f"{seen.name} cannot be given new firmware over USB: it lacks the feature DFU")
    if image.version < before and not allow_downgrade:
        raise InputFileError(
            f"the image has version {image.version}, older than the {before} of {seen.name}; allow the downgrade "
            "(--allow-downgrade) if that is what you want"
        )
    if image.protocol != PROTOCOL_VERSION and not allow_other_protocol:
        raise InputFileError(
            f"the image speaks version {image.protocol} of the protocol, this program version {PROTOCOL_VERSION}, so "
            "that it could not use the device any more; update it, or allow that (--allow-other-protocol)"
        )
    return before


def _replace(bus: UsbFinder, seen: Sighting, stored: bytes, on_progress: OnProgress) -> tuple[Sighting, bool]:
    """Have a device boot an image; the device, started anew, and whether the image had to be written."""
    total = len(stored)
    try:
        if seen.mode == RUN_TIME:
            on_progress(FlashStage.DETACH, 0, 0)
            detach(seen)
            seen = bus.find_again(seen, (DFU_MODE,), BACK_SECONDS)
        with DfuLine(seen) as line:
            line.make_idle()
            on_progress(FlashStage.COMPARE, 0, total)
            written = not line.holds(stored, lambda done: on_progress(FlashStage.COMPARE, done, total))
            if written:
                line.download(stored, lambda done: on_progress(FlashStage.WRITE, done, total))
                if not line.holds(stored, lambda done: on_progress(FlashStage.CHECK, done, total)):
                    raise DeviceError(f"{seen.name} would not boot what it was sent; its flash fails, and needs repair")
            on_progress(FlashStage.BOOT, 0, 0)
            line.boot()
    except DeviceError:
        _boot(bus, seen, 0)
        raise
    except BaseException:  # it may be on its way to DFU mode
        _boot(bus, seen, BACK_SECONDS)
        raise
    return bus.find_again(seen, (RUN_TIME,), BACK_SECONDS), written


def _boot(bus: UsbFinder, seen: Sighting, seconds: float) -> None:
    """Have a device that is in DFU mode, or comes there in time, boot what is whole."""
    with suppress(DeviceError), DfuLine(bus.find_again(seen, (DFU_MODE,), seconds)) as line:
        line.boot()


def _confirm(bus: UsbFinder, seen: Sighting, version: Version) -> Bank:
    """See that all eleven processors run a version; the bank that it lies in.

    Being asked, the firmware learns that it came up, and stays (clause FWU-020). One that did not come up everywhere
    has not come up at all: it is restarted, and the loader goes back to what ran before.
    """
    info = _info(seen)
    seen.time.sleep(MARK_SECONDS)
    reports = _reports(seen)
    if info.firmware != version:
        raise _NotStartedError(
            f"{seen.name} runs firmware {Version(*info.firmware)} rather than {version}; `phasewire info` says which "
            "faults it has"
        )
    others = [place for place, report in enumerate(reports) if report.firmware != version]
    if not others and (bank := reports[0].bank) is not None:
        return bank
    _restart(seen, Request.RESET)
    again = bus.find_again(seen, (RUN_TIME,), BACK_SECONDS)
    now = Version(*_info(again).firmware)
    raise DeviceError(
        f"{seen.name} did not get firmware {version} on processor(s) {', '.join(map(str, others))}; it was restarted "
        f"and runs {now}. `phasewire info` says which faults it has"
    )


def revert(url: str) -> RevertReport:
    """Have a device forget all upgrades and go back to its factory image (clause REQ-014).

    Parameters
    ----------
    url : str
        As in `flash`.

    Raises
    ------
    DeviceNotFoundError
        If there is no such device.
    DeviceError
        If it cannot do that, or line or device fail.
    """
    bus = UsbFinder(url)
    seen = bus.find()
    if seen.mode == DFU_MODE:
        with DfuLine(seen) as line:
            line.boot()
        seen = bus.find_again(seen, (RUN_TIME,), BACK_SECONDS)
    info = _info(seen)
    if Feature.REVERT not in info.features:
        raise DeviceError(
            f"{seen.name} cannot go back by itself: firmware {Version(*info.firmware)} lacks the feature REVERT. Send "
            "it the image that you want: phasewire flash IMAGE --allow-downgrade"
        )
    _restart(seen, Request.REVERT)
    back = bus.find_again(seen, (RUN_TIME,), BACK_SECONDS)
    now = Version(*_info(back).firmware)
    banks = {report.bank for report in _reports(back)} - {None}
    if banks != {Bank.FACTORY}:
        raise DeviceError(
            f"{seen.name} could not go back to its factory image and runs {now} still; `phasewire info` says which "
            "faults it has"
        )
    return RevertReport(seen.name, Version(*info.firmware), now)


def find_flashable(url: str) -> list[Flashable]:
    """The devices on the bus of a URL, in either mode; none of them is disturbed in what it does."""
    bus = UsbFinder(url)
    return [_flashable(seen) for seen in bus.look()]


def _flashable(seen: Sighting) -> Flashable:
    bank, problem = None, None
    if seen.serial is None:
        problem = seen.found.problem
    elif seen.mode == RUN_TIME:
        try:
            bank = _reports(seen)[0].bank
        except DeviceError as error:
            problem = str(error)
    return Flashable(seen.found.url, seen.product, seen.serial, seen.mode, seen.firmware, bank, problem)


# A device in run-time mode


def _info(seen: Sighting) -> Info:
    return _ask(seen, Info.decode, Request.INFO)


def _reports(seen: Sighting) -> list[ProcessorReport]:
    return _ask(seen, decode_reports, Request.PROCESSORS)


def _ask(seen: Sighting, decode: Callable[[bytes], Answer], request: Request) -> Answer:
    """Make a control request, which disturbs nobody who uses the device, and read its answer."""
    setup = Setup(REQUEST_TYPE_IN, request, 0, ARRAY_INTERFACE, ANSWER_BYTES[request])
    with opened(seen, f"asking {seen.name} for {request.name}") as device, understood(seen.name):
        return decode(control(device, setup))


def _restart(seen: Sighting, request: Request) -> None:
    """Order a request that ends in a restart, and wait until the device has left the bus.

    It may leave while it is spoken to. What a bus makes of that differs.
    """
    with (
        suppress(DeviceLostError, DeviceTimeoutError),
        opened(seen, f"ordering {seen.name} to {request.name}") as device,
    ):
        usb.util.claim_interface(device, ARRAY_INTERFACE)  # whoever plays holds it, and is not to be cut off
        control(device, Setup(REQUEST_TYPE_OUT, request, 0, ARRAY_INTERFACE, 0))
    end = seen.time.monotonic() + LEAVE_SECONDS
    with suppress(DeviceLostError, DeviceTimeoutError, DeviceStalledError):
        while seen.time.monotonic() < end:
            _info(seen)
            seen.time.sleep(LOOK_SECONDS)
