"""Commands that make one request to a device, and their notes about a device that is fresh or not named."""

from __future__ import annotations

import json

import numpy as np
import pytest
from phasewire import Emulator, Pulses, open_device
from phasewire.emulator import faults

from .runner import Run


def pulses(width: int) -> Pulses:
    return Pulses(np.zeros(320, int), np.full(320, width))


def test_read_back_reports_mixed_pulses(phasewire: Run, emulator: Emulator) -> None:
    """REQ-007: after a processor has missed a commit."""
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


# Notes about the device


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
def test_a_fresh_emulated_device_is_announced(phasewire: Run, line: str) -> None:
    outcome = phasewire(*line.split())
    assert outcome.code == 0
    assert NOTE in outcome.err
    assert "--device usb:" in outcome.err
    assert "PHASEWIRE_DEVICE" in outcome.err


@pytest.mark.parametrize("line", ["stop", "reset", "identify 1", "watchdog 0.5", "limit 100", "clear-faults"])
def test_a_named_device_is_not_announced(phasewire: Run, emulator: Emulator, line: str) -> None:
    outcome = phasewire(*line.split(), "--device", emulator.url)
    assert (outcome.code, outcome.err) == (0, "")
    assert phasewire("info").err == ""  # it only reads


def test_a_playing_device_is_left_with_the_command_that_stops_it(phasewire: Run, emulator: Emulator) -> None:
    outcome = phasewire("play", "circle", "--unattended", "--device", emulator.url)
    stop = f"`phasewire stop --device {emulator.url}`"
    assert stop in outcome.err
    assert stop in outcome.out
    assert NOTE not in outcome.err
    assert emulator.running.state.name == "UNATTENDED"
    assert "It plays on" not in phasewire("play", "circle", "--unattended").out


# Requests


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


def test_faults_are_cleared_and_the_remaining_ones_are_named(phasewire: Run, emulator: Emulator) -> None:
    """REQ-011: SUPPLY once it is within its limits again, but not the fault of a dead board."""
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
def test_values_out_of_range_are_wrong_use(phasewire: Run, line: str) -> None:
    assert phasewire(*line.split()).code == 2
