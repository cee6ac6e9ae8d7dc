"""``phasewire`` on a device of the kernel, by libusb, judged by what the device did."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from phasewire.hil.conformance.guest import Guest

from .conftest import EMULATE, Bench, pulses

pytestmark = pytest.mark.guest

ON = ("--device", "usb:")
OFFER = EMULATE[EMULATE.index("emulate") :]
WIDTHS = range(1, 21)


class Witnessed:
    """A device that writes down what it did, once it is gone."""

    def __init__(self, bench: Bench, record: Path) -> None:
        self._bench, self._record = bench, record
        bench.serve(program=(str(Path(__file__).with_name("witness.py")), str(record), *OFFER))
        bench.attach("--loop")

    def run(self, *command: str, seconds: float = 120) -> str:
        """Run a command that must succeed."""
        return self._bench.check("phasewire", *command, *ON, seconds=seconds)

    def did(self) -> tuple[list[str], list[tuple[float, float]]]:
        """The device's events, and each change of its outputs: its time and the loudest drive."""
        self._bench.stop()
        record: dict[str, Any] = json.loads(self._record.read_text())
        return record["events"], [(seconds, drive) for seconds, drive in record["played"]]


@pytest.fixture
def device(bench: Bench, tmp_path: Path) -> Witnessed:
    """A device whose watchdog waits 5 s for a slow guest."""
    device = Witnessed(bench, tmp_path / "did.json")
    device.run("watchdog", "5")
    return device


def drive(width: int) -> float:
    """The fundamental of a pulse, relative to that of the widest."""
    return round(math.sin(math.pi * width / 50), 3)


def test_a_frame_plays_for_its_time_and_then_the_outputs_are_off(device: Witnessed, guest: Guest) -> None:
    device.run("show", pulses(guest, "one.npz", [10]), "--seconds", "0.5")
    _, ((began, loud), (ended, silent)) = device.did()
    assert (loud, silent) == (drive(10), 0)
    assert ended - began >= 0.5


def test_each_frame_of_a_stream_plays_once_and_in_its_turn(device: Witnessed, guest: Guest) -> None:
    file = pulses(guest, "steps.npz", WIDTHS)
    told = json.loads(device.run("stream", file, "--rate", "50", "--modulation", "0", "--json", "-"))["stream"]
    assert (told["accepted"], told["refused"], told["damaged"]) == (20, 0, 0)
    _, played = device.did()
    assert [loud for _, loud in played] == [*map(drive, WIDTHS), 0]
    if not told["underruns"] and not told["late"]:
        assert {round((after - before) * 50, 3) for (before, _), (after, _) in pairwise(played[:-1])} == {1}


def test_a_reset_starts_the_firmware_again_and_the_doctor_finds_nothing(device: Witnessed) -> None:
    device.run("reset")
    told = json.loads(device.run("doctor", "--json", "-"))
    assert [each for each in told["findings"] if each["verdict"] == "fail"] == []
    events, _ = device.did()
    assert events.count("starts firmware 0.1.0 from bank FACTORY") == 2
