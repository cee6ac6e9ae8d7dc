"""The four ways as a device emits them: every drive of a cycle, and the sidebands of what transducers emit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Circle, ControlPoints, Cycle, Emulator, TransducerArray, open_device, render
from phasewire.hil import Playback
from phasewire.hil.sound.emission import emitted_waves
from phasewire.host.streaming.cycles import play_cycle
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.quantise import quantise
from phasewire.solver.acoustics.resonator import Resonator

ARRAY = TransducerArray.grid()
POINT = ControlPoints([[0, 0, 0.2]])
SETTLED = 200
"""Carrier periods after which a resonance of 0.3 ms has forgotten what was before."""


def played(cycle: Cycle, periods: int) -> tuple[Emulator, int]:
    """An emulator that has repeated a cycle for so many periods, and the first of them."""
    emulator = Emulator()
    with emulator, open_device(emulator.url) as device:
        device.set_watchdog(1.0)
        ack = play_cycle(device, cycle).ack
        emulator.run_until(ack.commit_period + periods)
    return emulator, ack.commit_period


@pytest.mark.parametrize("way", ["am", "two-sided", "two-sided:envelope=square", "lm", "stm:speed=20"])
def test_a_device_emits_a_cycle_drive_by_drive(way: str) -> None:
    cycle = render(ARRAY, Circle(radius=0.02), way)
    emulator, first = played(cycle, 2 * cycle.periods)
    pulses = quantise(cycle.drives)
    wanted = np.repeat([Pulses(*rows).to_drive() for rows in zip(*pulses, strict=True)], cycle.hold, axis=0)
    emitted = emulator.capture().drives(first, first + 2 * cycle.periods)
    assert np.abs(emitted - np.concatenate([wanted, wanted])).max() < 1e-5


def test_an_envelope_of_the_device_lies_on_top() -> None:
    cycle = render(ARRAY, Circle(radius=0.02), "stm:speed=0.5,modulation=200")
    emulator, first = played(cycle, 400)
    strength = np.abs(emulator.capture().drives(first, first + 400)).max(axis=1)
    assert np.abs(np.fft.rfft(strength))[1:].argmax() + 1 == 2  # 200 Hz in 10 ms


def test_a_cycle_without_an_envelope_ends_a_modulation() -> None:
    cycle = render(ARRAY, Circle(radius=0.02), "stm:speed=5")
    with Emulator() as emulator, open_device(emulator.url) as device:
        play_cycle(device, render(ARRAY, Circle(radius=0.02), "stm:speed=5,modulation=200"))
        first = play_cycle(device, cycle).ack.commit_period
        emulator.run_until(first + 400)
        strength = np.abs(emulator.capture().drives(first, first + 400)).max(axis=1)
    assert strength.min() > 0.99


def lines(cycle: Cycle, step_hz: float) -> NDArray[np.float64]:
    """Amplitudes of the sidebands of the wave of all transducers together at the focus, from the bits, by step."""
    whole = round(40_000 / step_hz)
    emulator, first = played(cycle, SETTLED + whole)
    emitted = emitted_waves(emulator.capture(), ARRAY, first + SETTLED, first + SETTLED + whole)
    aim = np.conj(render(ARRAY, POINT, "am:envelope=square").drives[0])
    return np.abs(np.fft.fft(emitted.waves @ aim)) / whole


def followed(frequency: float) -> float:
    """How much of a sideband the transducers' resonance lets pass."""
    resonator = Resonator.of(ARRAY.transducer)
    return abs(resonator.response(40_000 + frequency)) / abs(resonator.response(40_000))


def test_square_amplitude_modulation_has_a_carrier_and_odd_sidebands() -> None:
    found = lines(render(ARRAY, POINT, "am:envelope=square"), 200.0)
    assert found[2] < 0.01 * found[0]
    for n in (1, 3, 5, 7):
        assert found[n] / found[0] == pytest.approx(2 / (np.pi * n) * followed(200 * n), rel=0.02)


def test_quiet_amplitude_modulation_has_two_sidebands_and_no_carrier() -> None:
    found = lines(render(ARRAY, POINT, "am"), 100.0)
    assert found[1] == pytest.approx(found[-1], rel=0.02)
    assert found[0] < 0.01 * found[1]
    assert found[2:10].max() < 0.05 * found[1]  # what is left is the quantisation of amplitudes to 26 widths


@pytest.mark.parametrize(("way", "strongest"), [("lm:frequency=50", 100.0), ("am:frequency=100", 100.0)])
def test_a_place_is_pushed_at_the_frequency_that_theory_says(way: str, strongest: float) -> None:
    """A focus that moves to and fro passes its middle twice a period; an amplitude comes once."""
    cycle = render(ARRAY, POINT, way)
    emulator, first = played(cycle, SETTLED + 2 * cycle.periods)
    playback, begin = Playback(emulator.capture(), ARRAY), first + SETTLED
    parts = {
        hertz: float(playback.intensity_component(POINT, hertz, begin, begin + 1600)[0])
        for hertz in (50.0, 100.0, 150.0, 200.0)
    }
    assert max(parts, key=lambda hertz: parts[hertz]) == strongest
    assert parts[50.0] < 0.05 * parts[100.0]
    assert parts[150.0] < 0.05 * parts[100.0]
