"""Commands that ask a device one thing or tell it one, and what they say where it is not the one that was meant."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from phasewire import Emulator, Pulses, open_device
from phasewire.emulator import faults

from .runner import Run, runner


@pytest.fixture
def phasewire(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the command line in a new folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PHASEWIRE_DEVICE", raising=False)
    return runner(capsys)


def pulses(width: int) -> Pulses:
    return Pulses(np.zeros(320, int), np.full(320, width))


def test_what_did_not_begin_together_is_read_back_as_such(phasewire: Run, emulator: Emulator) -> None:
    """REQ-007: where a processor has missed a commit."""
    device = open_device(emulator.url)
    device.show(pulses(1))
    emulator.run(10)
    emulator.inject(faults.LostToken(message="slice", processor=3))
    device.show(pulses(2))
    emulator.run(10)
    device.close()
    outcome = phasewire("read-back", "--device", emulator.url, "--json", "-")
    record = json.loads(outcome.out)
    assert (record["since_period"], record["mixed"]) == (None, True)
    assert "did not begin together" in outcome.err
    assert str(2**64 - 1) not in outcome.out + outcome.err


# Which device was meant


NOTE = "is a fresh emulated device"


@pytest.mark.parametrize(
    "line",
    [
        "stop",
        "reset",
        "identify 1",
        "watchdog 0.5",
        "limit 100",
        "clear-faults",
        "play circle --unattended",
        "stop --device emulator:?link=2wire",
    ],
)
def test_who_speaks_to_a_fresh_emulated_device_is_told_so(phasewire: Run, line: str) -> None:
    outcome = phasewire(*line.split())
    assert outcome.code == 0
    assert NOTE in outcome.err
    assert "--device usb:" in outcome.err
    assert "PHASEWIRE_DEVICE" in outcome.err


@pytest.mark.parametrize("line", ["stop", "reset", "identify 1", "watchdog 0.5", "limit 100", "clear-faults"])
def test_who_names_a_device_is_not(phasewire: Run, emulator: Emulator, line: str) -> None:
    outcome = phasewire(*line.split(), "--device", emulator.url)
    assert (outcome.code, outcome.err) == (0, "")
    assert phasewire("info").err == ""  # which changes nothing


def test_who_leaves_a_device_playing_is_told_how_to_stop_that_one(phasewire: Run, emulator: Emulator) -> None:
    outcome = phasewire("play", "circle", "--unattended", "--device", emulator.url)
    stop = f"`phasewire stop --device {emulator.url}`"
    assert stop in outcome.err
    assert stop in outcome.out
    assert NOTE not in outcome.err
    assert emulator.running.state.name == "UNATTENDED"
    assert "It plays on" not in phasewire("play", "circle", "--unattended").out


# What is told to it


def test_a_watchdog_time_and_a_drive_limit_are_set(phasewire: Run, emulator: Emulator) -> None:
    assert "waits 2.5 s" in phasewire("watchdog", "2.5", "--device", emulator.url).out
    record = json.loads(phasewire("limit", "12", "--device", emulator.url, "--json", "-").out)
    assert record["format"] == "phasewire-limit-1"
    assert (record["status"]["watchdog_ms"], record["status"]["drive_limit"]) == (2500, 12)


def test_the_watchdog_can_be_set_while_it_plays_and_the_limit_stops_it(phasewire: Run, emulator: Emulator) -> None:
    phasewire("play", "circle", "--unattended", "--device", emulator.url)
    phasewire("watchdog", "1", "--device", emulator.url)
    assert emulator.running.state.name == "UNATTENDED"
    assert phasewire("limit", "1", "--device", emulator.url).code == 0
    assert emulator.running.state.name == "OFF"


def test_faults_are_cleared_and_what_is_left_is_told(phasewire: Run, emulator: Emulator) -> None:
    """REQ-011: that of SUPPLY when it is within its limits again, that of a dead board not."""
    emulator.inject(faults.WrongSupply(millivolts=9000, board=4, periods=400))
    emulator.run(1000)
    assert emulator.running.status().faults
    assert phasewire("clear-faults", "--device", emulator.url).out.endswith("has no faults.\n")
    emulator.inject(faults.DeadBoard(board=4))
    emulator.run(2000)
    assert f"PROCESSOR; `phasewire doctor --device {emulator.url}`" in " ".join(
        phasewire("clear-faults", "--device", emulator.url).out.split()
    )


@pytest.mark.parametrize("line", ["watchdog 0.009", "watchdog 61", "watchdog nan", "watchdog inf", "limit 321"])
def test_what_no_device_takes_is_wrong_use(phasewire: Run, line: str) -> None:
    assert phasewire(*line.split()).code == 2
