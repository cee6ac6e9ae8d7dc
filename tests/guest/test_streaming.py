"""Streams through the kernel: several transfers on their way at a time, by libusb's own means."""

from __future__ import annotations

import json
import signal

import pytest

from .conftest import Bench

pytestmark = [pytest.mark.guest, pytest.mark.guest_slow]

STREAM = """
import json, sys
import numpy as np
import phasewire
from phasewire.protocol import PulseFrames

def frames(count):
    return PulseFrames(np.full((count, 320), 11, np.uint8), np.full((count, 320), 3, np.uint8))

with phasewire.open_device("usb:") as device:
    assert device._session.line().posts
    device.set_watchdog(20)
    reports = [device.stream(frames(round(rate * seconds)), rate) for rate, seconds in {runs}]
    print(json.dumps([[report.sent, report.accepted, report.late, report.underruns] for report in reports]))
"""
UNPLUGGED = """
import itertools, phasewire
from phasewire.base.errors import DeviceLostError
with phasewire.open_device("usb:") as device:
    device.set_watchdog(20)
    print("begun", flush=True)
    silent = phasewire.Pulses([11] * 320, [3] * 320)
    try:
        device.stream(itertools.repeat(silent), 500)
    except DeviceLostError as error:
        print("lost:", error)
"""
RUNS = [(1000, 4.0), (10_000, 2.0), (40_000, 1.0)]


def test_frames_arrive_whole_at_every_rate(bench: Bench) -> None:
    bench.attach()
    told = json.loads(bench.python(STREAM.format(runs=RUNS), seconds=240))
    assert [(sent, accepted) for sent, accepted, *_ in told] == [(round(r * s),) * 2 for r, s in RUNS]
    assert bench.complaints() == []


def test_a_device_that_is_pulled_in_mid_stream_is_lost_and_said_to_be(bench: Bench) -> None:
    bench.attach()
    number = bench.guest.start("python", UNPLUGGED, seconds=120)
    bench.run("sleep", "20")
    bench.end_server(signal.SIGKILL)
    done = bench.guest.wait(number)
    assert "lost: " in done.out, done
