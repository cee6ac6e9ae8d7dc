"""Conformant devices that differ from the emulator cause neither failures nor warnings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
from phasewire.base.errors import BlockError
from phasewire.emulator.control import agenda, batches, dispatch, requests, watchdog
from phasewire.emulator.control.admission import Admission
from phasewire.emulator.control.device_state import DeviceState
from phasewire.emulator.control.dispatch import Dispatch
from phasewire.emulator.control.requests import Requests
from phasewire.emulator.door import Stall
from phasewire.emulator.interfaces import usb_device, usb_functions
from phasewire.hil.conformance import running
from phasewire.hil.conformance.mutants.patching import Patch
from phasewire.hil.conformance.running import RunOptions, run_conformance
from phasewire.hil.conformance.tools.steps import features_of
from phasewire.hil.conformance.verdicts import Result, Verdict
from phasewire.protocol.blocks import Body
from phasewire.protocol.codes import Feature, Reason, Request
from phasewire.protocol.firmware import Image
from phasewire.protocol.requests import VALUES, Setup
from phasewire.protocol.versions import Version

from tests.hil.conformance.test_suite import ALL_BUT_LONG

Device = Callable[[Patch], None]


def inform(patch: Patch, **fields: object) -> None:
    """Let INFO say something else."""
    patch.wrap(Requests, "info", lambda info: lambda self: replace(info(self), **fields))


def set_room(patch: Patch, changes: int, stores: int, records: int) -> None:
    """Let as many changes, stores and records wait."""
    for module in (agenda, batches, dispatch, requests):
        patch.replace(module, "QUEUE_BLOCKS", changes)
    for module in (requests, usb_functions):
        patch.replace(module, "QUEUE_RECORDS", records)
    patch.replace(dispatch, "STORES", stores)


def of_the_least_sizes(patch: Patch) -> None:
    """The least that BLK-024 and ACK-001 allow, and one store at a time."""
    set_room(patch, changes=4, stores=1, records=16)


def large(patch: Patch) -> None:
    """More than the emulator in everything that may be more."""
    set_room(patch, changes=200, stores=100, records=1000)


def set_rate(patch: Patch, periods: int) -> None:
    """Accept an update every so many periods."""

    def slow(init: Callable[..., None]) -> Callable[..., None]:
        def made(self: Any, *arguments: Any, **named: Any) -> None:
            init(self, *arguments, **named)
            self.periods_per_update = periods

        return made

    patch.wrap(Dispatch, "__init__", slow)


def slow_and_small(patch: Patch) -> None:
    """Its firmware needs longer than the links, and says so (clause BUD-001); and the least sizes."""
    set_rate(patch, 3)
    of_the_least_sizes(patch)


def weaker(patch: Patch) -> None:
    """A drive limit of 100 transducers (clause SAF-006)."""
    inform(patch, drive_limit=100)
    patch.replace(requests, "VALUES", {**VALUES, Request.LIMIT: range(101)})

    def limited(init: Callable[..., None]) -> Callable[..., None]:
        def made(self: Any, *arguments: Any, **named: Any) -> None:
            init(self, *arguments, **named)
            self.drive_limit = 100

        return made

    patch.wrap(DeviceState, "__init__", limited)


def without_features(patch: Patch) -> None:
    """It lacks what a device may lack but console and DFU, and says so (clause VER-005)."""
    features = Feature.CONSOLE | Feature.DFU
    patch.replace(requests, "FEATURES", features)
    inform(patch, slots=0, sequence_entries=0, modulation_samples=0)

    def judging(judge: Callable[[Admission, Body], None]) -> Callable[[Admission, Body], None]:
        def judged(self: Admission, body: Body) -> None:
            if features_of(body) & ~features:
                raise BlockError(f"{body.KIND.name} is not there", Reason.UNSUPPORTED)
            judge(self, body)

        return judged

    def answering(request: Callable[..., bytes]) -> Callable[..., bytes]:
        def answered(self: Requests, setup: Setup, *more: Any) -> bytes:
            if setup.request in (Request.PULSES, Request.REVERT):
                raise Stall(f"request {setup.request} is not there")
            return request(self, setup, *more)

        return answered

    patch.wrap(Admission, "_judge_state", judging)
    patch.wrap(Requests, "request", answering)


def of_another_make(patch: Patch) -> None:
    """Its product string has characters of two and four bytes, and its firmware is not 1.0.0."""
    patch.replace(usb_device, "PRODUCT", "Acme <b>ülträ</b> 𝄞")
    patch.replace(running, "Image", lambda _, segments: Image(Version(3, 7, 9), segments))


def slower_watchdog(patch: Patch) -> None:
    """Half a second instead of a tenth: the one that SAF-003 does not allow."""
    for module in (watchdog, requests):
        patch.replace(module, "WATCHDOG_MS", 500)


BY_SIZE = (
    *("acknowledgements", "blocks", "endpoints", "flow", "modulation", "numbering", "outputs", "requests"),
    *("robustness", "safety", "sequences", "serial", "states", "stores", "timing"),
    *("combinations", "doors", "successions", "ways-out"),
)
BY_RATE = (
    *("acknowledgements", "blocks", "flow", "modulation", "outputs", "requests", "sequences", "timing"),
    *("combinations", "successions", "ways-out"),
)
BY_DRIVE = (
    *("blocks", "endpoints", "limits", "power", "pulses", "requests", "safety", "sequences", "stores"),
    *("doors", "timing", "ways-out"),
)
BY_MAKE = ("console", "dfu", "endpoints", "enumeration", "flash", "power", "requests", "serial", "versions")
"""Groups to which a device's difference matters."""
DEVICES: list[tuple[Device, str, tuple[str, ...]]] = [
    (of_the_least_sizes, "emulator:", BY_SIZE),
    (large, "emulator:", BY_SIZE),
    (slow_and_small, "emulator:?link=2wire", BY_RATE),
    (weaker, "emulator:", BY_DRIVE),
    (without_features, "emulator:", ALL_BUT_LONG),
    (of_another_make, "emulator:", BY_MAKE),
]
"""Devices, by which URL, and what to ask of them."""
NAMES = [device.__name__.replace("_", "-") for device, *_ in DEVICES]


@contextmanager
def being(device: Device) -> Iterator[None]:
    """Let emulators be such devices."""
    patch = Patch()
    try:
        device(patch)
        yield
    finally:
        patch.undo()


def results(device: Device, url: str, groups: tuple[str, ...]) -> list[Result]:
    """The results of groups on such a device."""
    with being(device):
        run = run_conformance(RunOptions(url, groups=groups))
    assert not run.trouble
    assert {one.case.partition("/")[0] for one in run.results} >= {*groups}
    return list(run.results)


def broken(found: list[Result]) -> list[str]:
    """The cases that fail, or warn, and why."""
    return [f"{one.case} {one.verdict}: {one.reason}" for one in found if one.verdict in (Verdict.FAIL, Verdict.WARN)]


@pytest.mark.slow
def test_what_a_device_without_features_refuses_is_judged() -> None:
    found = results(without_features, "emulator:", ("versions",))
    without = {one.case: one.verdict for one in found if "without" in one.case}
    assert len(without) == 6
    there = "versions/detach-is-answered-with-stall-without-dfu"  # the one feature of them that it has
    assert without == {case: Verdict.NOT_APPLICABLE if case == there else Verdict.PASS for case in without}


@pytest.mark.slow
@pytest.mark.parametrize(("device", "url", "groups"), DEVICES, ids=NAMES)
def test_a_conformant_device_breaks_nothing(device: Device, url: str, groups: tuple[str, ...]) -> None:
    assert broken(results(device, url, groups)) == []


@pytest.mark.slow
def test_another_default_of_the_watchdog_breaks_only_its_own_cases() -> None:
    found = results(slower_watchdog, "emulator:", ("acknowledgements", "blocks", "requests", "safety", "states"))
    assert [one.case for one in found if one.verdict in (Verdict.FAIL, Verdict.WARN)] == [
        "requests/info-says-what-the-specification-demands",
        "safety/the-watchdog-has-its-default-time",
    ]
