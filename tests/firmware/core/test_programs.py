"""The reference device and the emulator, two implementations of one specification, play the same random programs.

Each is judged by the referee, which was written from the specification alone. If a program leaves the devices no
choice, both also answer alike and play the same bits, tick by tick.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from phasewire.emulator.faults import DeadProcessor
from phasewire.protocol.board import CYCLES_PER_MS, TICKS_PER_PERIOD
from phasewire.protocol.codes import Kind

from tests import from_spec as spec
from tests.emulator.test_oracle import (
    BASES,
    CROWDS,
    FILLED,
    PROGRAMS,
    SCRAMBLED,
    Bench,
    Step,
    busy,
    play,
    pulses,
)
from tests.referee import PERIOD, TICK, Silencing

SLACK_PERIODS = 1
"""The reference works once a period, so that its own time line is up to a period longer (BUD-001)."""
IN_TIME = 40
"""Periods ahead in which every device has everything in place, with all the stores of a program before it."""
APART = 3
"""Periods between two changes."""
MOST_STEPS = 28
"""The changes of a program fit the queue."""
STORE_PERIODS = 12
"""Before a store, in which the one before goes to the processors."""
SILENCED = 6
"""Periods in which a device chooses the boundary of its silence (SAF-004)."""
FIXTURES = [HealthCheck.function_scoped_fixture]


def reference(machine: Callable[..., Any]) -> Bench:
    return Bench(device=machine(SCRAMBLED), slack_periods=SLACK_PERIODS)


@settings(max_examples=100, suppress_health_check=FIXTURES)
@given(base=BASES, crowd=CROWDS, steps=PROGRAMS)
def test_random_programs_play_as_the_specification_says(
    machine: Callable[..., Any], base: int, crowd: list[Step], steps: list[Step]
) -> None:
    play(reference(machine), base, [*FILLED, *crowd, *steps])


@pytest.mark.parametrize("seed", range(40))
def test_disable_silences_within_six_periods_whatever_is_on_the_chain(machine: Callable[..., Any], seed: int) -> None:
    bench = reference(machine)
    busy(bench, seed)
    bench.wait(seed * 1777)
    bench.enable()
    bench.send(Kind.UPDATE, pulses=pulses(5))
    bench.finish(3)


# Side by side


def in_time(steps: Sequence[Step]) -> list[Step]:
    """A program that leaves no choice: whole ticks, periods that every device can meet, room in queues and stores.

    Each change has a later period than the one before, for how late a late one is depends on a device's own times.
    """
    timed = []
    for number, step in enumerate([*FILLED, *steps[:MOST_STEPS]]):
        value = dict(step.value)
        if "ahead" in value:
            value["ahead"] = IN_TIME + APART * number
        stores = STORE_PERIODS * PERIOD if step.what in ("slot", "entries", "samples") else 0
        timed.append(Step(step.wait // TICK * TICK + stores, step.what, value))
    return timed


def said(bench: Bench) -> list[Any]:
    """What the device answered, without what it may choose: how soon a place is free, when a sign of life was told."""
    acks = [spec.read_ack(record) for record in bench.heard if isinstance(record, bytes) and record[:2] == b"PA"]
    return [{name: ack[name] for name in ack if name not in ("free", "checksum")} for ack in acks]


def both_play(machine: Callable[..., Any], base: int, steps: Sequence[Step]) -> None:
    """Play a program on both, and compare what they say and what their outputs do."""
    benches = Bench(), reference(machine)
    bits = [play(bench, base, steps) for bench in benches]
    assert said(benches[0]) == said(benches[1])
    length = min(map(len, bits)) // TICKS_PER_PERIOD
    words = [each[: length * TICKS_PER_PERIOD].reshape(length, -1) for each in bits]
    chosen = np.zeros(length, bool)
    for item in benches[0].referee.past:
        if isinstance(item, Silencing):
            silenced = item.cycle // PERIOD - base
            chosen[max(silenced, 0) : max(silenced + SILENCED, 0)] = True
    differs = (words[0] != words[1]).any(axis=1) & ~chosen
    assert not differs.any(), f"period {base + int(differs.argmax())} differs"


@settings(max_examples=20, suppress_health_check=FIXTURES)
@given(base=BASES, steps=PROGRAMS.map(in_time))
def test_both_devices_do_the_same(machine: Callable[..., Any], base: int, steps: list[Step]) -> None:
    both_play(machine, base, steps)


def test_while_a_device_comes_up_only_what_is_due_is_looked_at(machine: Callable[..., Any]) -> None:
    """A line that waits for it would otherwise look at each tick, 20 000 in these 10 ms."""
    device = machine(SCRAMBLED)
    device.inject(DeadProcessor(processor=4))
    device.power_down()
    device.power_up()
    time = device.scheduler
    time.run_until(time.now + 20 * CYCLES_PER_MS)
    assert not device.call("serves")
    end, looks = time.now + 10 * CYCLES_PER_MS, 0
    while time.now < end:
        time.run_until(time.next_time())
        looks += 1
    assert looks < 1000
