"""Transfers that libusb carries by itself, with the real libusb, on the devices that umockdev shows it."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from phasewire import Emulator
from phasewire.emulator.doors.umockdev import run_under_mock
from phasewire.protocol.codes import AckFlag
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed

pytestmark = pytest.mark.skipif(not shutil.which("umockdev-wrapper"), reason="not installed: umockdev-wrapper")

SCRIPT = """
import json, os, signal, sys, threading, time
import numpy as np
import phasewire
from phasewire.base.errors import DeviceRefusedError, DeviceTimeoutError
from phasewire.protocol import PulseFrames
from phasewire.protocol.codes import NOW

def frames(count, width=3):
    return PulseFrames(np.full((count, 320), 11, np.uint8), np.full((count, 320), width, np.uint8))

told = {}
with phasewire.open_device("usb:") as device:
    device.set_watchdog(10)
    told["posts"] = device._session.line().posts
    report = device.stream(frames(400), 400)
    told["streamed"] = report.accepted, report.unanswered
    device.stop()
    device.set_drive_limit(100)
    refused = frames(300)
    refused.width[120] = 25
    reports = []
    try:
        device.stream(refused, 500, on_progress=reports.append)
    except DeviceRefusedError as error:
        told["refused"] = error.reason.name
    last = reports[-1]
    told["counts"] = last.refused, last.sent - last.accepted - last.refused - last.unanswered
    told["off"] = device.status().state.name
    far = device.status().period + 400_000
    taken = 0
    try:
        for number in range(200):
            taken = number
            device.show(phasewire.Pulses([10] * 320, [2] * 320), far + number)
    except DeviceTimeoutError as error:
        told["full"] = str(error).partition(": ")[2]
    told["queue"] = taken - device.info.queue_blocks
    device.stop()
    ack = device.show(phasewire.Pulses([10] * 320, [2] * 320))
    told["after"] = int(ack.flags)

    def endless():
        while True:
            yield phasewire.Pulses([10] * 320, [2] * 320)

    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        device.stream(endless(), 500)
    except KeyboardInterrupt:
        told["interrupted"] = device.status().state.name
    told["goes on"] = int(device.show(phasewire.Pulses([10] * 320, [2] * 320)).flags)
with phasewire.open_device("usb:", observe=True) as device:
    told["left"] = device.status().state.name
print(json.dumps(told))
"""


@pytest.mark.parametrize("speed", [HIGH_SPEED, FULL_SPEED], ids=["high", "full"])
@pytest.mark.slow
def test_streams_refusals_a_full_queue_and_ctrl_c(speed: Speed, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with out.open("wb") as target:
        command = ["timeout", "--signal=KILL", "60", sys.executable, "-c", SCRIPT]
        code = run_under_mock(command, [Emulator(speed=speed)], stdout=target)
    assert code == 0
    told = json.loads(out.read_text())
    assert told.pop("goes on") in (AckFlag(0), AckFlag.GAP), "of a write that is interrupted nobody knows what was sent"
    assert told == {
        "posts": True,
        "streamed": [400, 0],
        "refused": "DRIVE",
        "counts": [1, 0],
        "off": "OFF",
        "full": "its queue is full; wait, or stop it",
        "queue": 0,
        "after": 0,
        "interrupted": "OFF",
        "left": "OFF",
    }
