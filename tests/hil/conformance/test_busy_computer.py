"""Verdicts on a sound device if the computer is too slow: passed or inconclusive, never failed."""

from __future__ import annotations

import os
import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.pacing import MOST_SLOWNESS
from phasewire.hil.conformance.running import RunOptions, open_bench, run_conformance
from phasewire.hil.conformance.tools.clocks import compare_clocks, unless_busy
from phasewire.hil.conformance.tools.steps import SILENT, enable
from phasewire.hil.conformance.tools.watchdog import check_not_yet
from phasewire.hil.conformance.transports.usb import RawUsbLine
from phasewire.protocol.blocks import Update
from phasewire.protocol.board import TICK_HZ


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """An emulated device that the suite takes for one with a time of its own."""
    monkeypatch.setattr(Bench, "is_far", True)
    with open_bench(RunOptions("emulator:")) as opened:
        yield opened


def test_a_block_that_the_host_sends_too_late_is_no_failure(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    enable(bench)
    send, held_up = bench.line.send_blocks, bench.line.time.sleep

    def send_late(blocks: bytes, seconds: float) -> int:
        held_up(0.2)
        return send(blocks, seconds)

    monkeypatch.setattr(bench.line, "send_blocks", send_late)
    with pytest.raises(Inconclusive, match="too slow"):
        bench.must(Update(SILENT, bench.period() + 2000))


def test_a_change_that_is_meant_to_be_late_is_no_matter_of_the_host(bench: Bench) -> None:
    enable(bench)
    assert bench.must(Update(SILENT, bench.period() - 1)).late


def test_time_that_a_case_outlasts_is_the_devices(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    sleep, before = bench.line.time.sleep, bench.clock().now
    monkeypatch.setattr(bench.line.time, "sleep", lambda seconds: sleep(seconds / 10))
    bench.outlast(0.02)
    assert bench.clock().now >= before + TICK_HZ // 50


def test_a_tick_that_has_passed_makes_a_case_inconclusive(bench: Bench) -> None:
    now = bench.clock().now
    check_not_yet(bench, now + TICK_HZ)
    with pytest.raises(Inconclusive, match="too slow"):
        check_not_yet(bench, now)


@pytest.mark.parametrize(("seconds", "verdict"), [(0.0, "pass"), (0.2, "pass"), (20.0, "inconclusive")])
@pytest.mark.slow
def test_a_case_has_more_time_on_a_slow_line(monkeypatch: pytest.MonkeyPatch, seconds: float, verdict: str) -> None:
    """It names periods further ahead until its blocks come in time, or cannot be judged."""
    send = RawUsbLine.send_blocks

    def send_late(line: RawUsbLine, blocks: bytes, patience: float) -> int:
        line.time.sleep(seconds)
        return send(line, blocks, patience)

    monkeypatch.setattr(Bench, "is_far", True)
    monkeypatch.setattr(RawUsbLine, "send_blocks", send_late)
    run = run_conformance(RunOptions("emulator:", only=("flow/a-place-is-free-again",), groups=("flow",)))
    assert [result.verdict for result in run.results] == [verdict], run.results


HELD_UP = (
    "chain/no-update-waits-for-stores",
    "doors/an-update-by-any-door",
    "modulation/a-modulation-over-silence",
    "modulation/the-end-of-a-modulation-leaves",
    "outputs/what-is-behind-a-disable",
    "successions/the-fifth-period-is-promised-while-a-sequence-plays[silence-plain",
)
"""Cases that have failed, or were never judged, in a guest without KVM."""


@pytest.mark.slow
def test_a_line_that_holds_up_one_transfer_or_another_fails_no_case(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes some milliseconds more, as through a virtual machine, and one in twenty a tenth of a second."""
    drawn = random.Random(1)

    def held_up(transfer: Callable[..., object]) -> Callable[..., object]:
        def later(line: RawUsbLine, *arguments: object) -> object:
            line.time.sleep(drawn.uniform(0.002, 0.008) if drawn.random() < 0.95 else drawn.uniform(0.05, 0.15))
            return transfer(line, *arguments)

        return later

    monkeypatch.setattr(Bench, "is_far", True)
    for name in ("read", "write", "request"):
        monkeypatch.setattr(RawUsbLine, name, held_up(getattr(RawUsbLine, name)))
    run = run_conformance(RunOptions("emulator:", only=HELD_UP))
    told = {result.case: f"{result.verdict} {result.reason}" for result in run.results}
    assert [case for case, what in told.items() if not re.match("pass|inconclusive in .* attempts", what)] == [], told


def test_only_a_far_device_is_given_more_time(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    while bench.slow_down():
        pass
    assert bench.slowness == MOST_SLOWNESS
    monkeypatch.setattr(Bench, "is_far", False)
    bench.slowness = 1
    assert not bench.slow_down()


@dataclass
class Device:
    """A clock that runs at one rate after another; each lasts for one attempt."""

    rates: list[float]
    seconds: float = 0.0
    ticks: float = 0.0
    is_far: bool = True
    notes: list[tuple[str, str]] = field(default_factory=list)

    @property
    def line(self) -> SimpleNamespace:
        return SimpleNamespace(time=SimpleNamespace(monotonic=lambda: self.seconds))

    def clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=int(self.ticks))

    def note(self, label: str, text: str) -> None:
        self.notes.append((label, text))

    def pass_a_second(self) -> None:
        self.seconds += 1
        self.ticks += TICK_HZ * self.rates.pop(0)


def judge(device: Any) -> None:
    compare_clocks(cast(Bench, device), device.pass_a_second, 0.01)


def test_a_clock_that_agrees_is_right() -> None:
    judge(Device([1.001]))


@pytest.mark.parametrize("rate", [0.97, 1.03, -5.0, 50.0])
def test_a_clock_that_is_always_wrong_fails(rate: float) -> None:
    with pytest.raises(AssertionError, match="ticks"):
        judge(Device([rate] * 4))


@pytest.mark.parametrize("rates", [[0.8, 1.0], [0.8, 0.95, 0.7, 0.9]])
def test_a_clock_that_is_held_up_cannot_be_judged(rates: list[float]) -> None:
    with pytest.raises(Inconclusive, match="busy"):
        judge(Device(rates))


def test_a_device_in_this_process_has_no_such_excuse() -> None:
    with pytest.raises(AssertionError, match="ticks"):
        judge(Device([0.8, 1.0], is_far=False))


@pytest.mark.parametrize(("load", "is_far", "excused"), [(9.0, True, True), (9.0, False, False), (0.0, True, False)])
def test_a_late_answer_is_judged_unless_the_computer_is_busy(
    monkeypatch: pytest.MonkeyPatch, load: float, is_far: bool, excused: bool
) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (load, load, load))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    device = cast(Bench, Device([], is_far=is_far))
    if excused:
        with pytest.raises(Inconclusive, match=r"load of 9\.0 on 2 cores"):
            unless_busy(device, "an answer came late")
    else:
        unless_busy(device, "an answer came late")
