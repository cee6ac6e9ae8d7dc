"""From bits to pressure, against the closed form of a struck resonator and against the phasor model."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Medium, Pulses, Transducer, TransducerArray, Wiring, pressure
from phasewire.emulator.ports.amplifier import Amplifier
from phasewire.hil.loop.end_to_end import emission
from phasewire.hil.sound.air import Playback, component, rms
from phasewire.solver import intensity_component, transfer_matrix
from phasewire.solver.acoustics.models import directivity
from phasewire.solver.methods.modulation import Modulation

TICK = 0.5e-6
TAU = 0.3e-3
INSTANT = Amplifier(edge_s=0)
AT = np.array([[0.02, 0.01, 0.2], [0, 0, 0.1], [-0.05, 0.03, 0.31]])


@dataclass
class Recorded:
    """The outputs' capture: a table of 50 port words in each period."""

    wiring: Wiring
    tables: NDArray[np.uint32]
    open_transducers: frozenset[int] = field(default=frozenset())

    @property
    def end_tick(self) -> int:
        return 50 * len(self.tables)

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        assert 0 <= start <= stop <= self.end_tick
        return self.tables.reshape(-1, 10)[start:stop]

    def drives(self, first: int, last: int) -> NDArray[np.complex64]:
        assert 0 <= first <= last <= len(self.tables)
        played = np.array([emission(table, self.wiring) for table in self.tables[first:last]])
        played = played.reshape(-1, 320).astype(np.complex64)
        played[:, list(self.open_transducers)] = 0
        return played


def table_of(pulses: Pulses, wiring: Wiring) -> NDArray[np.uint32]:
    ticks = np.arange(50)[:, None]
    levels = wiring.sort(((ticks - pulses.start) % 50 < pulses.width).astype(np.uint32)).reshape(50, 10, 32)
    return np.asarray((levels << np.arange(32, dtype=np.uint32)).sum(axis=2, dtype=np.uint32))


def recorded(wiring: Wiring, *slots: tuple[Pulses, int]) -> Recorded:
    tables = [table_of(pulses, wiring) for pulses, _ in slots]
    return Recorded(wiring, np.repeat(tables, [periods for _, periods in slots], axis=0))


def struck(bits: NDArray[Any], at_seconds: float, frequency: float = 40e3, tau: float = TAU) -> float:
    """One transducer's emission at a time after period 0, from the steps of its drive: each rings as (2/τω_d)·sin."""
    turn = math.sqrt((2 * math.pi * frequency) ** 2 - 1 / tau**2)
    steps = np.diff(bits.astype(float), prepend=0) * np.pi / 2
    since = at_seconds - TICK * np.arange(len(bits))
    rung = 2 / (tau * turn) * np.exp(-since / tau) * np.sin(turn * since)
    return float(np.where(since > 0, steps * rung, 0).sum())


SILENCE = Pulses.silent(320)


def some_pulses(seed: int) -> Pulses:
    rng = np.random.default_rng(seed)
    return Pulses(rng.integers(0, 100, 320), rng.integers(0, 26, 320))


@pytest.fixture(scope="module")
def tune(scrambled: Wiring) -> Recorded:
    """Silence, then two fields of 8 periods each, then silence."""
    return recorded(scrambled, (SILENCE, 2), (some_pulses(1), 8), (some_pulses(2), 8), (SILENCE, 30))


def test_a_pressure_is_the_sum_of_every_step_of_every_wave(array: TransducerArray, tune: Recorded) -> None:
    c = Medium().speed_of_sound
    bits = tune.bits(0, tune.end_tick)
    found = Playback(tune, array, amplifier=INSTANT).signal(AT, 0, tune.end_tick)
    for point, tick in ((0, 1500), (1, 1301), (1, 2399), (2, 2377), (0, 1200)):
        expected = 0.0
        for q in range(320):
            away = AT[point] - array.positions[q]
            r = float(np.linalg.norm(away))
            gain = 5.73 / r * float(directivity(np.hypot(*away[:2]) / r, 4.5e-3, Medium()))
            _, _, bit = pin = tune.wiring.pin(q)
            wave = bits[:, pin.board * 2 + pin.processor] >> bit & 1
            expected += gain * struck(wave, tick * TICK - r / c)
        assert found[point, tick] == pytest.approx(expected, abs=1e-5 * float(np.abs(found).max()))
    assert not found[1, : int(0.1 / c / TICK)].any()  # sound needs its time


@pytest.mark.parametrize("amplifier", [INSTANT, Amplifier(12, 0.4e-6)])
def test_what_plays_for_long_is_the_phasor_model(
    array: TransducerArray, scrambled: Wiring, amplifier: Amplifier
) -> None:
    pulses = some_pulses(3)
    playback = Playback(recorded(scrambled, (pulses, 400)), array, amplifier=amplifier)
    expected = amplifier.gain * pressure(array, pulses.to_drive(), AT)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(playback.phasors(AT, 399, 400)[:, 0], expected, atol=2e-6 * scale)
    wave = playback.signal(AT, 399 * 50, 400 * 50)
    turns = np.exp(2j * np.pi * np.arange(50) / 50) / 25
    np.testing.assert_allclose(wave @ turns, expected, atol=2e-4 * scale)  # the 49th and 51st harmonics come with it
    np.testing.assert_allclose(rms(wave), np.abs(expected) / np.sqrt(2), atol=0.01 * scale)


def test_calibrated_transducers_are_as_they_are_calibrated(array: TransducerArray, scrambled: Wiring) -> None:
    rng = np.random.default_rng(8)
    response = rng.uniform(0.5, 1, 320) * np.exp(2j * np.pi * rng.uniform(size=320))
    response[:5], response[5:10] = 0, -1
    odd = TransducerArray(array.positions, array.normals, Transducer(polarity=-1, model="rayleigh"), response)
    pulses, absorbing = some_pulses(4), Medium(30, absorbing=True)
    playback = Playback(recorded(scrambled, (pulses, 400)), odd, absorbing, INSTANT)
    expected = pressure(odd, pulses.to_drive(), AT, absorbing)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(playback.phasors(AT, 399, 400)[:, 0], expected, atol=2e-6 * scale)
    wave = playback.signal(AT, 399 * 50, 400 * 50)
    np.testing.assert_allclose(wave @ np.exp(2j * np.pi * np.arange(50) / 50) / 25, expected, atol=2e-4 * scale)


def test_a_transducer_that_is_not_connected_is_silent(array: TransducerArray, tune: Recorded) -> None:
    loose = replace(tune, open_transducers=frozenset({3, 200}))
    dead = np.ones(320)
    dead[[3, 200]] = 0
    expected = Playback(tune, array.calibrated(dead)).signal(AT, 0, 1500)
    np.testing.assert_allclose(Playback(loose, array).signal(AT, 0, 1500), expected, atol=1e-3)
    np.testing.assert_allclose(
        Playback(loose, array).phasors(AT, 0, 40), Playback(tune, array.calibrated(dead)).phasors(AT, 0, 40), atol=1e-3
    )


def test_voltages_are_those_of_the_amplifier(scrambled: Wiring, tune: Recorded) -> None:
    amplifier = Amplifier(13, 0.3e-6)
    levels = (tune.bits(0, 2400)[:, :, None] >> np.arange(32, dtype=np.uint32) & 1).reshape(2400, 320)
    expected = scrambled.unsort(amplifier.voltage(levels)).T
    playback = Playback(tune, amplifier=amplifier)
    np.testing.assert_allclose(playback.voltages(0, 2400), expected, rtol=1e-6)
    np.testing.assert_allclose(playback.voltages(777, 901), expected[:, 777:901], rtol=1e-6)
    assert playback.voltages(5, 5).shape == (320, 0)


@pytest.mark.slow
def test_a_stretch_is_what_it_is_in_a_longer_one(array: TransducerArray, scrambled: Wiring) -> None:
    """Across blocks, and beyond what the resonators remember."""
    slots = [(some_pulses(seed), 60) for seed in range(20)]
    playback = Playback(recorded(scrambled, *slots), array)
    whole = playback.signal(AT[:2], 0, 60_000)
    scale = np.abs(whole).max()
    for start, stop in ((0, 10), (777, 1), (30_001, 6000), (55_000, 5000)):
        part = playback.signal(AT[:2], start, start + stop)
        np.testing.assert_allclose(part, whole[:, start : start + stop], atol=2e-6 * scale)
    phasors = playback.phasors(AT[:2], 0, 1200)
    np.testing.assert_allclose(playback.phasors(AT[:2], 1000, 1100), phasors[:, 1000:1100], atol=2e-6 * scale)
    assert playback.signal(AT, 5, 5).shape == (3, 0)
    assert playback.phasors(AT, 0, 0).shape == (3, 0)


def square_intensity(matrix: NDArray[np.complex128], fields: Any, delay: NDArray[np.float64], samples: int) -> Any:
    """|p|² over a cycle of 200 Hz of two fields in turn, each 2.5 ms, that τ rings up and down, in the steady state."""
    half = 2.5e-3
    time = (np.arange(samples) * 2 * half / samples - delay[..., None]) % (2 * half)
    fallen = np.exp(-(time % half) / TAU) / (1 + math.exp(-half / TAU))
    first = np.where(time < half, 1 - fallen, fallen)
    emitted = fields[0][:, None] * first + fields[1][:, None] * (1 - first)
    return np.abs((matrix[..., None] * emitted).sum(axis=1)) ** 2


@pytest.mark.parametrize("second", [SILENCE, some_pulses(6)], ids=["on and off", "two-sided"])
@pytest.mark.slow
def test_the_200_hz_of_two_fields_in_turn(array: TransducerArray, scrambled: Wiring, second: Pulses) -> None:
    first = some_pulses(5)
    capture = recorded(scrambled, *[(first, 100), (second, 100)] * 4)
    playback = Playback(capture, array, amplifier=INSTANT)
    matrix, away = transfer_matrix(array, AT), np.linalg.norm(AT[:, None] - array.positions, axis=2)
    fields = [first.to_drive(), second.to_drive()]
    closed = square_intensity(matrix, fields, away / Medium().speed_of_sound, 2000)
    expected = 2 * np.abs(closed @ np.exp(2j * np.pi * np.arange(2000) / 2000)) / 2000
    tolerance = 2e-3 * closed.max()
    found = playback.intensity_component(AT, 200, 200, 800)
    np.testing.assert_allclose(found, expected, atol=tolerance)
    np.testing.assert_allclose(playback.intensity_component(AT, 0, 400, 800), closed.mean(axis=1), atol=tolerance)
    wave = playback.signal(AT, 400 * 50, 800 * 50).astype(float)
    np.testing.assert_allclose(component(2 * wave**2, 200, 2e6), expected, atol=3 * tolerance)
    # At once, as the solver has it, it is 2/π of the difference; the resonance takes a little of that.
    at_once = intensity_component(array, Modulation.two_sided(fields[0], fields[1]), AT)
    difference = np.abs(np.abs(matrix @ fields[0]) ** 2 - np.abs(matrix @ fields[1]) ** 2)
    np.testing.assert_allclose(at_once, 2 / np.pi * difference)
    strongest = int(difference.argmax())
    assert 0.85 < found[strongest] / at_once[strongest] < 1


def test_many_different_fields_come_as_they_are(array: TransducerArray, scrambled: Wiring) -> None:
    """More of them than there are transducers, period by period, with the delays one by one."""
    rng = np.random.default_rng(10)
    tables = rng.integers(0, 2**32, (400, 50, 10), dtype=np.uint32)
    capture = Recorded(scrambled, tables)
    found = Playback(capture, array).phasors(AT, 0, 400)
    decay, state = math.exp(-25e-6 / TAU), np.zeros((401, 320), np.complex128)
    drives = Amplifier().gain * capture.drives(0, 400).astype(np.complex128)
    for period in range(400):
        state[period + 1] = decay * state[period] + (1 - decay) * drives[period]
    # Left out here: the damping lowers the resonance, which turns a falling envelope by 1/(4Q), 7 mrad, in τ.
    periods = np.linalg.norm(AT[:, None] - array.positions, axis=2) / Medium().wavelength
    for point in range(3):
        for period in (0, 10, 60, 222, 399):
            at = period - periods[point]
            whole = np.floor(at).astype(int)
            left = decay ** (at - whole)
            heard = np.clip(whole, 0, 399), np.arange(320)
            z = np.where(whole >= 0, left * state[heard] + (1 - left) * drives[heard], 0)
            expected = transfer_matrix(array, AT[point : point + 1])[0] @ z
            assert abs(found[point, period] - expected) < 3e-3 * np.abs(found).max()


def test_components_of_a_series() -> None:
    time = np.arange(1000) / 1000
    series = 3 + 0.5 * np.cos(2 * np.pi * 20 * time + 1) - 2 * np.sin(2 * np.pi * 50 * time)
    np.testing.assert_allclose([component(series, f, 1000) for f in (0, 20, 50, 30)], [3, 0.5, 2, 0], atol=1e-12)
    assert rms(series) == pytest.approx(math.sqrt(9 + 0.125 + 2))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda playback: playback.signal(AT, -1, 5), "ticks -1 to 5 are not within the captured 0 to 2400"),
        (lambda playback: playback.phasors(AT, 3, 49), "periods 3 to 49 are not within the captured 0 to 48"),
        (lambda playback: playback.signal([[5.15e-3, 5.15e-3, 1e-3]], 0, 5), "point 0 at .* mm from transducer"),
        (lambda playback: playback.signal([0, 0, 0], 0, 5), r"points must have the shape \(m, 3\)"),
        (lambda playback: playback.intensity_component(AT, 200, 0, 48), r"hold 0\.24 cycles of 200 Hz; a whole number"),
        (lambda playback: component([], 0, 1000), "0 samples at 1000 Hz hold 0 cycles"),
        (
            lambda playback: component(np.ones(10), 500, 1000),
            "frequency 500.0 Hz must be .* below half the rate of 1000",
        ),
        (lambda playback: replace(playback, array=TransducerArray.grid(2, 2)), "an array of 4 transducers"),
        (lambda playback: replace(playback, medium=Medium(frequency=25e3)), "a medium for 25000 Hz does not fit"),
    ],
)
def test_stretches_and_places_out_of_range_are_refused(tune: Recorded, call: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call(Playback(tune))
