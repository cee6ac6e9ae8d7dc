"""The device's clock in a run: it never goes back, and no wait for it is without bound (clause TIM-002)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count

import pytest
from phasewire.emulator.control.dispatch import Dispatch
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.mutants.patching import Patch
from phasewire.hil.conformance.mutants.seams import one_by_one
from phasewire.hil.conformance.running import RunOptions, open_bench, run_conformance
from phasewire.hil.conformance.verdicts import Verdict
from phasewire.protocol.board import CARRIER_HZ, TICK_HZ
from phasewire.protocol.codes import REQUEST_TYPE_IN, AckFlag, Reason, Request, State
from phasewire.protocol.replies import Ack, ClockReading
from phasewire.protocol.requests import Setup

pytestmark = pytest.mark.slow  # each is a run of the suite

CLOCK = Setup(REQUEST_TYPE_IN, Request.CLOCK, 0, 0, ClockReading.BYTES)
ACK = Ack(Reason.ACCEPTED, 3, 0, 900, AckFlag(0), 5, State.READY)
TICK = vars(Dispatch)["now_tick"].fget


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench(RunOptions("emulator:")) as opened:
        yield opened


def set_clock(patch: pytest.MonkeyPatch, change: Callable[[int], int]) -> None:
    patch.setattr(Dispatch, "now_tick", property(lambda self: change(TICK(self))))


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize(
    "later",
    [lambda _: 2**32, lambda tick: 2**32 + tick // 1000, lambda tick: tick],
    ids=["stands-still", "hardly-moves", "goes-back"],
)
def test_a_wait_is_bounded_by_what_was_asked(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, later: Callable[[int], int], far: bool
) -> None:
    """It fails with what the clock said, also for a device that may be slow."""
    monkeypatch.setattr(Bench, "is_far", far)
    set_clock(monkeypatch, lambda _: 2**32)
    period = bench.period() + CARRIER_HZ
    set_clock(monkeypatch, later)
    began = bench.line.time.monotonic()
    with pytest.raises(AssertionError, match=r"the clock does not reach tick \d+: it named tick 4294967296 before"):
        bench.wait_until(period)
    assert bench.line.time.monotonic() - began < 3


def test_a_clock_that_goes_back_fails_the_case_in_which_it_is_seen_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cases before and after it pass, and its reason names both ticks and the clause."""
    asked = count()
    set_clock(monkeypatch, lambda tick: tick + TICK_HZ * (2 if next(asked) < 300 else 1))
    one_by_one(patch := Patch())  # blocks in batches have their ticks by another way
    try:
        run = run_conformance(RunOptions("emulator:", groups=("numbering",), again=False))
    finally:
        patch.undo()
    reasons = [result.reason for result in run.results if result.verdict is Verdict.FAIL]
    assert [reason.partition("):")[0] for reason in reasons] == ["the clock went back (TIM-002"], reasons
