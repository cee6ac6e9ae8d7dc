"""The waves of all transducers, against the bits themselves, the sum at a point, and the resonance's steady state."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Emulator, Pulses, Transducer, TransducerArray, Wiring, open_device
from phasewire.emulator import Capture, faults
from phasewire.emulator.ports.amplifier import Amplifier
from phasewire.feel.arriving import arriving
from phasewire.hil.sound.air import Playback
from phasewire.hil.sound.emission import emitted_waves
from phasewire.solver import Medium, transfer_matrix
from phasewire.solver.acoustics.resonator import Resonator

SLOTS = 8
POINT = [[0.02, 0.01, 0.2]]


def some_pulses(seed: int) -> Pulses:
    rng = np.random.default_rng(seed)
    return Pulses(rng.integers(0, 100, 320), rng.integers(0, 26, 320))


def played(emulator: Emulator, periods: int, hold: int) -> tuple[int, Capture]:
    """Let different fields play, each for so many periods; the first period of the first, and the capture."""
    with open_device(emulator.url) as device:
        for slot in range(SLOTS):
            device.store(slot, some_pulses(slot))
        ack = device.play([(slot, hold) for slot in range(SLOTS)])
        emulator.run_until(ack.commit_period + periods)
        return ack.commit_period, emulator.capture()


@pytest.fixture(scope="module")
def tune(scrambled: Wiring) -> tuple[int, Capture]:
    with Emulator(scrambled) as emulator:
        return played(emulator, 700, 3)


def measured(capture: Capture, first: int, last: int) -> NDArray[np.complex128]:
    """Duty and moment of each output, one tick after the other."""
    ticks = capture.channels(first * 50, last * 50).reshape(last - first, 50, 320)[:, :, capture.wiring.channels]
    middles = (np.arange(50) + 0.5) / 50 - 0.5
    return np.asarray(np.einsum("ptq,t->pq", ticks, 1 + 1j * middles) / 50)


def test_a_pressure_is_the_sum_of_the_waves_a_delay_ago(array: TransducerArray, tune: tuple[int, Capture]) -> None:
    begin, capture = tune
    medium, first, last = Medium(), begin + 100, begin + 300
    emitted = emitted_waves(capture, array, begin, last)
    delay = np.linalg.norm(array.positions - POINT, axis=1) / medium.wavelength
    whole = np.ceil(delay).astype(int)
    ahead = Resonator().enveloped(40e3, 25e-6).between(whole - delay)
    at, column = np.arange(first, last)[:, None] - begin - whole, np.arange(320)
    # A wave that left earlier has turned further by the path's phase, which the transfer matrix holds.
    waves = (1 - ahead) * emitted.waves[at, column] + ahead * emitted.waves[at + 1, column]
    heard = waves @ transfer_matrix(array, POINT, medium)[0]
    expected = Playback(capture, array, medium).phasors(POINT, first, last)[0]
    assert np.abs(heard - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.ptp(np.abs(expected)) > 50  # Pa: it does change
    arrived = arriving(array, emitted.waves, POINT, medium)[0, 100:]
    assert np.abs(arrived - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("resonance", [40_000.0, 39_200.0])
def test_a_constant_drive_rings_up_to_the_steady_state(emulator: Emulator, resonance: float) -> None:
    array = TransducerArray.grid(transducer=Transducer(resonance=resonance))
    pulses, amplifier = some_pulses(3), Amplifier(supply_v=12, edge_s=0.3e-6)
    with open_device(emulator.url) as device:
        period = device.show(pulses).commit_period
        emulator.run_until(period + 600)
    emitted = emitted_waves(emulator.capture(), array, period, period + 600, amplifier)
    steady = pulses.to_drive() * amplifier.gain * Resonator(resonance).response(40e3)
    np.testing.assert_allclose(emitted.waves[-1], steady, atol=1e-6)
    assert not emitted.waves[0].any()
    np.testing.assert_allclose(emitted.duty, np.tile(pulses.width / 50, (600, 1)), atol=1e-7)


def test_pins_that_are_held_and_clocks_that_are_wrong_have_the_duty_and_moment_of_their_bits(
    array: TransducerArray, scrambled: Wiring
) -> None:
    with Emulator(scrambled, clock_offset_ticks={2: 13}) as emulator:
        emulator.inject(
            faults.StuckHigh(processor=5, bit=7, period=150),
            faults.StuckLow(processor=1, bit=0, period=150),
            faults.OpenTransducer(transducer=3, period=150),
        )
        begin, capture = played(emulator, 400, 7)
    emitted = emitted_waves(capture, array, begin, begin + 400)
    expected = measured(capture, begin, begin + 400)
    expected[max(150 - begin, 0) :, 3] = 0
    np.testing.assert_allclose(emitted.pulses, expected, atol=1e-7)
    stuck = int(np.flatnonzero(scrambled.channels == 5 * 32 + 7)[0])
    assert (emitted.duty[150 - begin :, stuck] == 1).all()
    for silent in (stuck, 3):  # neither direct voltage nor an open transducer makes a wave
        assert np.abs(emitted.waves[-1, silent]) < 1e-6


def test_what_does_not_fit_is_refused(array: TransducerArray, tune: tuple[int, Capture]) -> None:
    _, capture = tune
    with pytest.raises(ValueError, match="4 transducers does not fit boards with 320"):
        emitted_waves(capture, TransducerArray.grid(2, 2), 0, 1)
    with pytest.raises(ValueError, match=f"periods 0 to {capture.periods + 1} are not within the captured 0 to"):
        emitted_waves(capture, array, 0, capture.periods + 1)
