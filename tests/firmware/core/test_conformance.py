"""The conformance suite judges the reference device: the library in virtual time, and the program as it runs.

Nothing may fail, and what cannot be judged has one of the reasons given here.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.firmware.core.building import END_SECONDS, REFERENCE, running
from tests.hil.conformance.test_suite import ALL_BUT_LONG, NAMES

ALLOWED = [word for risk in ("reset", "flash", "drive") for word in ("--allow", risk)]
SUITE_SECONDS = 1200
BY_THE_CLOCK = {
    "usbip": ("endpoints", "modulation", "outputs", "safety", "sorting"),
    "serial": ("outputs", "pulses", "sequences", "serial", "timing"),
}
"""Groups that show the program's doors, its time and its outputs; the whole suite takes half an hour in real time."""

ON_ANY_LINE = (
    "needs a second device",
    "needs a sync line that another device can drive",
    "the device has been on for too short a time",
    "only at full speed can",
    "this applies to",
    "this line has no connection to close",
    "the reference device trusts no keys",
    "periods ",
)
"""How reasons begin. The last is of a restart, which ends what is kept of the outputs."""
SERIAL = (
    "not on this line",
    "this line is slower",
    "the line is so slow",
    "the line is too slow",
    "a serial line cannot",
)


def suite(*arguments: str, report: Path, **environment: str) -> subprocess.Popen[str]:
    """A run of the suite in a process of its own."""
    command = [sys.executable, "-m", "phasewire", "conformance", *arguments, *ALLOWED, "--json", str(report)]
    env = {**os.environ, "PYTHONPATH": str(REFERENCE / "python"), "PYTHONUNBUFFERED": "1", **environment}
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def only(groups: Sequence[str]) -> list[str]:
    """The options that choose groups of cases."""
    return [word for group in groups for word in ("--only", f"{group}/")]


def check(report: Path, said: str) -> set[str]:
    """Nothing has failed; the reasons for which cases could not be judged."""
    found = json.loads(report.read_text())
    broken = [case["case"] for case in found["results"] if case["verdict"] in ("fail", "warn")]
    assert not broken, f"{broken}\n{said[-3000:]}"
    assert found["passed"], said[-3000:]
    return {case["reason"] for case in found["results"] if case["verdict"] == "inconclusive"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("url", "door", "speed", "groups", "may_be_open"),
    [
        ("reference:", "reference-uart:", "high", NAMES, ON_ANY_LINE),
        ("reference:", "reference-uart:", "full", ALL_BUT_LONG, ON_ANY_LINE),
        ("reference-uart:", "reference:", "high", ALL_BUT_LONG, ON_ANY_LINE + SERIAL),
    ],
)
def test_the_library_passes(
    machine: Callable[..., Any],
    tmp_path: Path,
    url: str,
    door: str,
    speed: str,
    groups: Sequence[str],
    may_be_open: tuple[str, ...],
) -> None:
    del machine  # it has built the library
    plugged = ["--device", url, "--door", door, "--capture", "reference:", "--levers", "reference:"]
    run = suite(*plugged, *only(groups), report=tmp_path / "report.json", PHASEWIRE_REFERENCE_SPEED=speed)
    said, _ = run.communicate(timeout=SUITE_SECONDS)
    assert not {reason for reason in check(tmp_path / "report.json", said) if not reason.startswith(may_be_open)}


@pytest.mark.slow
@pytest.mark.parametrize("door", BY_THE_CLOCK)
def test_the_port_for_posix_breaks_nothing_with_a_recording_of_its_outputs(tmp_path: Path, door: str) -> None:
    """By the wall clock, over TCP, with all 320 outputs recorded; the recording ends when all cases have played.

    What a busy computer is too slow to judge stays open.
    """
    outputs = tmp_path / "run.sr"
    options = ["--usbip", "0"] if door == "usbip" else ["--serial", "tcp:0"]
    with running(*options, "--outputs", str(outputs)) as (device, doors):
        url = f"usbip:127.0.0.1:{doors['usbip']}" if door == "usbip" else doors["serial"][0]
        judge = ["--device", url, "--capture", f"sigrok:{outputs}", *only(BY_THE_CLOCK[door])]
        said = []
        with suite(*judge, report=tmp_path / "report.json") as run:
            assert run.stdout is not None
            for line in run.stdout:
                said.append(line)
                if "end the recording" in line:
                    device.send_signal(signal.SIGTERM)
            run.wait(END_SECONDS)
    check(tmp_path / "report.json", "".join(said))
