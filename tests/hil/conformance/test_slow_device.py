"""Verdicts on a sound device whose time is slower than the host's, as in an emulator of its processor: no failure."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import pytest
from phasewire.emulator.control import agenda, batches, dispatch, requests
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.running import RunOptions, run_conformance
from phasewire.hil.conformance.transports import usb
from phasewire.hil.conformance.transports.usb import RawUsbLine
from phasewire.hil.conformance.verdicts import Verdict

pytestmark = pytest.mark.slow  # each is a run of the suite

TIMES = 20
"""How many seconds pass for the host in one of the device, by turns twice as many."""


class HostTime:
    """The time of a host beside a device in this process."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self._seen = self._passed = 0.0
        self._times = cycle([TIMES] * 12 + [2 * TIMES] * 12)
        self._times_now = next(self._times)

    def monotonic(self) -> float:
        seen = self._device.monotonic()
        self._passed, self._seen = self._passed + self._times_now * (seen - self._seen), seen
        return self._passed

    def sleep(self, seconds: float) -> None:
        self.monotonic()
        self._times_now = next(self._times)
        self._device.sleep(seconds / self._times_now)


@pytest.mark.parametrize(
    ("cases", "passes"),
    [
        ("timing/nothing-that-a-host-asks-for-sets-the-clock", 0),  # the clocks are too different to be compared
        ("timing/changes-of-all-kinds-follow-each-other", 2),
        ("dfu/", 60),
        ("flash/an-image-that-has-gone-bad-does-not-boot", 1),
    ],
)
def test_a_device_in_slow_time_fails_no_case(monkeypatch: pytest.MonkeyPatch, cases: str, passes: int) -> None:
    """Its queue has eight places, and a case needs its later changes to wait for the first."""
    take, milliseconds = RawUsbLine._take, usb._milliseconds

    def slow(line: RawUsbLine, *seen: Any, **how: Any) -> None:
        take(line, *seen, **how)
        line.time = HostTime(line.time)

    monkeypatch.setattr(RawUsbLine, "_take", slow)
    monkeypatch.setattr(usb, "_milliseconds", lambda seconds: milliseconds(seconds / TIMES))
    monkeypatch.setattr(Bench, "is_far", True)
    begin = Bench.begin_case

    def begin_slowly(bench: Bench, name: str) -> None:
        begin(bench, name)
        bench.slowness = 16  # as after a case that needed so much

    monkeypatch.setattr(Bench, "begin_case", begin_slowly)
    for module in (agenda, batches, dispatch, requests):
        monkeypatch.setattr(module, "QUEUE_BLOCKS", 8)
    run = run_conformance(RunOptions("emulator:", only=(cases,), groups=(cases.partition("/")[0],), again=False))
    assert run.count(Verdict.PASS) >= passes, [result.reason for result in run.results]
    assert [(result.case, result.reason) for result in run.results if result.breaks] == []
