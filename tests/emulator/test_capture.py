"""The outputs against the continuous-time fundamental of a square wave, computed from its edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from phasewire import Emulator, Pulses, Wiring, open_device
from phasewire.emulator.ports.capture import Capture, Forced, Track
from phasewire.emulator.ports.clock import BoardClock
from phasewire.emulator.ports.history import History
from phasewire.protocol.blocks import pack_pulses


def fundamental_of_edges(bits: np.ndarray) -> complex:
    """(2/T)·∫ s(t)·e^{iωt} dt of one period of a periodic 0/1 wave with one pulse, from its two edges."""
    change = np.diff(np.concatenate([bits[-1:], bits]).astype(int))
    if not change.any():
        return 0j
    (rise,), (fall,) = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    omega = 2 * np.pi / 50
    return complex(2 / 50 / (1j * omega) * (np.exp(1j * omega * fall) - np.exp(1j * omega * rise)))


@pytest.mark.parametrize(("start", "stop"), [(-1, 5), (5, 4), (0, 101), (200, 300)])
def test_ticks_that_were_not_captured_are_refused(emulator: Emulator, start: int, stop: int) -> None:
    emulator.run(2)
    with pytest.raises(ValueError, match="not within the captured 0 to 100"):
        emulator.capture().bits(start, stop)


def test_a_capture_stays_as_it_was(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        emulator.run(2)
        capture = emulator.capture()
        before = capture.bits(0, 100)
        device.show(Pulses(np.full(320, 25), np.full(320, 25)))
        emulator.run(10)
    np.testing.assert_array_equal(capture.bits(0, 100), before)
    with pytest.raises(ValueError, match="not within"):
        capture.drive(capture.periods)


def capture_of(history: History, clock: BoardClock, periods: int, forced: tuple[Forced, ...] = ()) -> Capture:
    """The same on all ten ports."""
    return Capture(Wiring.strips(), periods * 50, (Track(history.segments(), clock, forced),) * 10)


def some_history(seed: int) -> History:
    """Pulses, then a sequence, then pulses again, under a modulation from period 4 on."""
    random = np.random.default_rng(seed)
    packed = [pack_pulses(Pulses(random.integers(0, 100, 32), random.integers(0, 26, 32))) for _ in range(6)]
    rows = np.stack([np.frombuffer(one, np.uint8) for one in packed])
    history = History()
    history.play(np.array([1, 2]), rows[:2])
    history.modulate(4, random.bytes(5), 2)
    history.run(6, packed[2:4], np.array([0, 1, 0]), np.array([1, 2, 1]), 3)
    history.play(np.array([15, 17]), rows[4:])
    return history


@given(st.integers(0, 2**32 - 1))
def test_drives_are_those_of_the_bits(seed: int) -> None:
    """Looked up pulse by pulse, and computed from all edges if a fault may hold outputs."""
    history = some_history(seed)
    plain = capture_of(history, BoardClock(), 24)
    held = capture_of(history, BoardClock(), 24, (Forced(0),))
    assert np.array_equal(plain.bits(0, 1200), held.bits(0, 1200))
    looked_up = plain.drives(0, 24, np.complex128)
    np.testing.assert_allclose(looked_up, held.drives(0, 24, np.complex128), atol=1e-14)
    np.testing.assert_allclose(looked_up, plain.drives(0, 24), atol=1e-6)
    waves = plain.wiring.unsort(plain.channels(0, 1200)).reshape(24, 50, 320)
    for period in (0, 1, 5, 7, 18):
        expected = [np.pi / 2 * fundamental_of_edges(waves[period, :, q]) for q in range(320)]
        np.testing.assert_allclose(looked_up[period], expected, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(0, 130), st.integers(-2_000_000, 2_000_000), st.integers(0, 600))
def test_a_board_with_a_clock_of_its_own_plays_its_own_ticks(seed: int, late: int, billionths: int, bend: int) -> None:
    """Tick by tick: first some ticks late, then at another rate."""
    history, clock = some_history(seed), BoardClock(late)
    exact = capture_of(history, BoardClock(), 40).bits(0, 2000)[:, 0]
    clock.set_rate(bend, billionths)
    bits = capture_of(history, clock, 24).bits(100, 1150)[:, 0].tolist()
    for tick, word in zip(range(100, 1150), bits, strict=True):
        own = tick - late if tick < bend else bend - late + (tick - bend) * (10**9 + billionths) // 10**9
        assert word == (exact[own] if own >= 0 else 0)


def test_an_output_is_held_from_its_tick_on_until_its_release() -> None:
    history = some_history(1)
    plain = capture_of(history, BoardClock(), 24).bits(0, 1200)[:, 3]
    forced = (Forced(333, high=0b101, low=0b010), Forced(700, low=2**32 - 1), Forced(900))
    bits = capture_of(history, BoardClock(), 24, forced).bits(0, 1200)[:, 3]
    assert np.array_equal(bits[:333], plain[:333])
    assert np.array_equal(bits[333:700], (plain[333:700] | 0b101) & ~np.uint32(0b010))
    assert not bits[700:900].any()
    assert np.array_equal(bits[900:], plain[900:])


def test_a_transducer_that_is_not_connected_emits_nothing() -> None:
    history = some_history(2)
    whole = capture_of(history, BoardClock(), 24)
    capture = replace(whole, open_since={7: 0, 300: 505})
    drives = capture.drives(0, 24)
    assert not drives[:, 7].any()
    assert not drives[10:, 300].any()  # tick 505 lies in period 10
    assert np.array_equal(drives[:10, 300], whole.drives(0, 24)[:10, 300])
    others = np.delete(np.arange(320), [7, 300])
    assert np.array_equal(drives[:, others], whole.drives(0, 24)[:, others])
    assert np.array_equal(capture.bits(0, 1200), whole.bits(0, 1200))


def test_the_spectrum_of_full_drive_is_that_of_a_square_wave(emulator: Emulator) -> None:
    """Its odd harmonics are as 1/n, its even ones absent: Fourier's series of a wave that is on half of the time."""
    with open_device(emulator.url) as device:
        ack = device.show(Pulses(np.full(320, 25), np.full(320, 25)))
        emulator.run_until(ack.commit_period + 40)
        capture = emulator.capture()
    (lines,) = capture.plot_spectrum(Figure().subplots(), output=3).collections
    assert isinstance(lines, LineCollection)
    tops = {round(float(path[1, 0])): float(path[1, 1]) for path in lines.get_segments()}
    assert tops[40] == pytest.approx(0, abs=0.01)
    assert tops[120] == pytest.approx(20 * np.log10(1 / 3), abs=0.1)  # a tick is not short beside its half wave
    assert max(level for kilohertz, level in tops.items() if kilohertz % 40) == -80
    with pytest.raises(ValueError, match="output 320 must be a whole number from 0 to 319"):
        capture.plot_spectrum(output=320)
    with pytest.raises(ValueError, match="output 320 must be a whole number from 0 to 319"):
        capture.plot(outputs=[0, 320])


def test_an_empty_capture_has_no_picture() -> None:
    capture = Emulator().capture()
    with pytest.raises(ValueError, match="from tick 0 to 0 make no picture; give some outputs, and let time pass"):
        capture.plot()
    assert capture._repr_png_() is None
