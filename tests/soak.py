"""A long stream with random faults: the frames that the outputs showed are compared with the counts of both sides.

Each frame carries its number in the widths of every processor's outputs, so that the bits of the ports alone say which
processor showed which frame when. `python -m tests.soak --minutes 120` lets two hours of the device's time pass.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from phasewire import Device, Emulator, Pulses, open_device
from phasewire.base.errors import DeviceError
from phasewire.emulator.faults import (
    BusReset,
    BusSuspended,
    DoubledToken,
    FlippedBit,
    FlippedUsbBit,
    HotBoard,
    InjectedFault,
    LostToken,
    PowerCut,
    SilentHost,
    SlowProcessor,
    StalledEndpoint,
    Unplugged,
)
from phasewire.host.streaming.streaming import StreamReport
from phasewire.protocol.board import CORE_HZ
from phasewire.protocol.codes import State

RATE = 100
BITS = 20
NARROW, WIDE = 2, 4
EPISODE_SECONDS = 300.0
FAULT_SECONDS = 5.0
"""Between one fault and the next, in the mean."""
MOST_IN_FLIGHT = 34
"""Frames that the device may have accepted and not shown when something ends it: its queue, and two on the chain."""
HISTORY_PERIODS = 400_000
DEVICE_COUNTS = ("accepted", "refused", "late", "lost", "missed_commits")
HOST_COUNTS = ("sent", "accepted", "late", "damaged", "refused", "unanswered", "underruns", "reconnects")


@dataclass
class Tally:
    """Counts, added up over episodes."""

    seconds: float = 0.0
    host: Counter[str] = field(default_factory=Counter)
    """The counts of the streams' reports."""
    device: Counter[str] = field(default_factory=Counter)
    """The device's counts, over all its restarts."""
    sessions: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    """Errors that ended streams, or prevented them."""
    shown: int = 0
    """Frames that any processor showed."""
    missed: int = 0
    """Pairs of a frame that others showed and a processor that did not."""

    def add(self, other: Tally) -> None:
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def check(self) -> None:
        """The counts of both sides and the frames shown agree, except for what an interruption leaves open."""
        host, device = self.host, self.device
        doubt = host["unanswered"]
        opened = 2 * self.sessions + host["reconnects"]  # and again after a restart
        ends = sum(self.errors.values()) + host["reconnects"]
        assert host["sent"] == host["accepted"] + host["damaged"] + host["refused"] + doubt
        assert host["accepted"] <= device["accepted"] <= host["accepted"] + doubt + opened
        assert (
            host["damaged"] + host["refused"] <= device["refused"] <= host["damaged"] + host["refused"] + doubt + opened
        )
        assert host["late"] <= device["late"] <= host["late"] + doubt
        assert self.shown <= host["accepted"] + doubt
        assert host["accepted"] - self.shown <= MOST_IN_FLIGHT * ends, "accepted, not shown, and no reason why"
        assert self.missed <= device["missed_commits"] + 10 * ends


class Episode:
    """Some seconds of one device's time; faults of the chain, which are slow to emulate, occur only ``on_chain``."""

    def __init__(self, seed: int, seconds: float, *, on_chain: bool) -> None:
        self.random = random.Random(seed)
        self.seconds = seconds
        self.on_chain = on_chain
        self.tally = Tally(seconds)
        self.number = 0
        self.shown: list[list[int]] = [[] for _ in range(10)]
        """For each processor the numbers that it showed, in order."""
        self.seen_until = 0

    # Faults

    def fault(self) -> InjectedFault:
        some = self.random.randint
        choices: list[InjectedFault] = [
            PowerCut(periods=some(1_000, 40_000)),
            Unplugged(periods=some(1_000, 40_000)),
            BusReset(),
            BusSuspended(periods=some(400, 20_000)),
            StalledEndpoint(endpoint=0x01),
            StalledEndpoint(endpoint=0x81),
            SilentHost(periods=some(100, 20_000)),
            FlippedUsbBit(endpoint=0x01, byte=some(0, 511), bit=some(0, 7), times=some(1, 5)),
            FlippedUsbBit(endpoint=0x01, byte=some(0, 511), bit=some(0, 7), times=some(1, 5)),
            FlippedUsbBit(endpoint=0x81, byte=some(0, 31), bit=some(0, 7)),
            HotBoard(board=some(0, 4), celsius=90, periods=some(400, 4_000)),
        ]
        if self.on_chain:
            message, place = self.random.choice(["slice", "commit"]), some(0, 9)
            choices += [
                LostToken(message=message, processor=place, times=some(1, 3), token=some(3, 12)),
                DoubledToken(message=message, processor=place, times=some(1, 3), token=some(3, 12)),
                FlippedBit(message=message, processor=place, times=some(1, 3), token=some(3, 12), bit=some(0, 7)),
                SlowProcessor(processor=place, slowness=some(2, 30), periods=some(400, 4_000)),
            ]
        return self.random.choice(choices)

    def source(self, emulator: Emulator, device: Device) -> Iterator[Pulses]:
        """Frames to the end of the episode, with faults between them."""
        left = self.random.expovariate(1 / (RATE * FAULT_SECONDS))
        places = (
            emulator.capture().wiring.channels.astype(np.int64) % 32 % BITS
        )  # bit of the number, for each transducer
        while emulator.scheduler.now / CORE_HZ < self.seconds:
            left -= 1
            if left <= 0:
                left = self.random.expovariate(1 / (RATE * FAULT_SECONDS))
                if self.random.random() < 0.1:
                    self.tally.faults["slow source"] += 1
                    device.time.sleep(self.random.uniform(0.0, 0.08))
                else:
                    self.strike(emulator)
            self.number += 1
            if self.number % 200 == 0:
                self.look(emulator)
            yield Pulses(np.full(320, 20), np.where(self.number >> places & 1, WIDE, NARROW))

    def strike(self, emulator: Emulator) -> None:
        fault = self.fault()
        self.tally.faults[type(fault).__name__] += 1
        if isinstance(fault, PowerCut):
            self.settle(emulator)
        emulator.inject(fault)

    # Observation

    def settle(self, emulator: Emulator) -> None:
        """Look at the outputs and the device's counts before both are lost."""
        if emulator.controller is None:
            return
        self.look(emulator)
        status = emulator.running.status()
        self.tally.device.update({name: getattr(status, name) for name in DEVICE_COUNTS})
        self.seen_until = 0

    def look(self, emulator: Emulator) -> None:
        """Read the frames that every processor showed since the last look from the bits of the ports."""
        if emulator.controller is None:
            return
        capture = emulator.capture()
        until = capture.end_tick - 50
        begun = max(self.seen_until, capture.start_tick)
        latches = [[tick for tick in ticks if begun <= tick < until] for ticks in capture.latches]
        for tick in sorted(set().union(*latches)):
            words = capture.bits(tick, tick + 50)
            widths = (words[:, :, None] >> np.arange(32, dtype=np.uint32) & 1).sum(axis=0)
            for processor, width in enumerate(widths):
                if tick not in latches[processor] or not width.any():
                    continue
                wide = width == WIDE
                assert (wide | (width == NARROW)).all(), f"processor {processor} plays {width}"
                assert (wide[BITS:] == wide[: 32 - BITS]).all(), "half of one frame, half of another"
                self.shown[processor].append(int(wide[:BITS] @ (1 << np.arange(BITS))))
        self.seen_until = until

    # The episode

    def run(self) -> Tally:
        with Emulator(serial=f"SOAK-{self.random.getrandbits(60)}", history_periods=HISTORY_PERIODS) as emulator:
            while emulator.scheduler.now / CORE_HZ < self.seconds:
                self.session(emulator)
            self.settle(emulator)
        everyone = set().union(*self.shown)
        self.tally.shown = len(everyone)
        for processor, numbers in enumerate(self.shown):
            self.tally.missed += len(everyone) - len(numbers)
            for before, after in pairwise(numbers):
                assert after > before, f"processor {processor} shows frame {after} after {before}"
        self.tally.check()
        return self.tally

    def session(self, emulator: Emulator) -> None:
        """One stream, to its end or to an error."""
        reports: list[StreamReport] = []
        begun = self.number
        try:
            self.tally.sessions += 1
            with open_device(emulator.url) as device:
                if device.clear_faults().state is State.FAULT:
                    self.settle(emulator)
                    device.reset()
                reconnect = self.random.random() < 0.7
                device.stream(self.source(emulator, device), RATE, reconnect=reconnect, on_progress=reports.append)
        except DeviceError as error:
            self.tally.errors[type(error).__name__] += 1
            emulator.scheduler.run_until(emulator.scheduler.now + self.random.randint(10, 1200) * CORE_HZ // 1000)
        if reports:
            report = reports[-1]
            assert 0 <= self.number - begun - report.sent <= 1, "frames were taken, and neither sent nor counted"
            self.tally.host.update({name: getattr(report, name) for name in HOST_COUNTS})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--chain", type=float, default=0.2, help="part of the episodes in which the chain fails too")
    arguments = parser.parse_args()
    total, began = Tally(), time.monotonic()
    episodes = max(1, round(arguments.minutes * 60 / EPISODE_SECONDS))
    for number in range(episodes):
        seconds = arguments.minutes * 60 / episodes
        on_chain = (number + 1) * arguments.chain // 1 > number * arguments.chain // 1
        total.add(Episode(arguments.seed * 1000 + number, seconds, on_chain=on_chain).run())
        sys.stdout.write(f"{number + 1} of {episodes}, {time.monotonic() - began:.0f} s: {total}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
