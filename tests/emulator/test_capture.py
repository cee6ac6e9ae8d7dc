"""What the outputs play, against the continuous-time fundamental of a square wave worked out from its edges."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire import Emulator, Pulses, Wiring, open_device


def fundamental_of_edges(bits: np.ndarray) -> complex:
    """(2/T)·∫ s(t)·e^{iωt} dt of one period of a periodic 0/1 wave with one pulse, from its two edges."""
    change = np.diff(np.concatenate([bits[-1:], bits]).astype(int))
    if not change.any():
        return 0j
    (rise,), (fall,) = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    omega = 2 * np.pi / 50
    return complex(2 / 50 / (1j * omega) * (np.exp(1j * omega * fall) - np.exp(1j * omega * rise)))


def test_every_pulse_plays_the_fundamental_it_should() -> None:
    """All 100 × 26 pairs of phase and width, played on all channels of the chain in turn.

    Magnitude (2/π)·sin(πw/50); phase that of the centre, half a tick earlier where the pair has unequal parity.
    """
    pairs = [(phase, width) for phase in range(100) for width in range(26)]
    pairs += [(0, 0)] * (-len(pairs) % 320)
    checked = 0
    with Emulator() as emulator, open_device(emulator.url) as device:
        for first in range(0, len(pairs), 320):
            phase, width = np.array(pairs[first : first + 320]).T
            ack = device.show(Pulses(phase, width))
            emulator.run_until(ack.commit_period + 1)
            capture = emulator.capture()
            start = (capture.periods - 1) * 50
            waves = capture.wiring.unsort(capture.channels(start, start + 50))
            emitted = capture.drive(capture.periods - 1)
            for q in range(320):
                measured = fundamental_of_edges(waves[:, q])
                assert abs(measured) == pytest.approx(2 / np.pi * np.sin(np.pi * width[q] / 50), abs=1e-12)
                if width[q] > 0:
                    centre = phase[q] - (phase[q] - width[q]) % 2
                    expected = np.exp(2j * np.pi * centre / 100)
                    assert measured / abs(measured) == pytest.approx(expected, abs=1e-12)
                assert emitted[q] == pytest.approx(measured / (2 / np.pi), abs=1e-12)
                checked += 1
    assert checked == len(pairs) >= 2600


def test_one_transducer_at_a_time_appears_on_its_board_processor_and_bit(scrambled: Wiring) -> None:
    with Emulator(wiring=scrambled) as emulator, open_device(emulator.url) as device:
        for transducer in range(320):
            width = np.zeros(320, int)
            width[transducer] = 25
            ack = device.show(Pulses(np.full(320, 25), width))
            emulator.run_until(ack.commit_period + 1)
            capture = emulator.capture()
            bits = capture.bits((capture.periods - 1) * 50, capture.periods * 50)
            board, processor, bit = scrambled.pin(transducer)
            expected = np.zeros((50, 10), np.uint32)
            expected[:25, board * 2 + processor] = 1 << bit
            np.testing.assert_array_equal(bits, expected, err_msg=f"transducer {transducer}")


def test_nothing_sounds_before_the_boundary_and_everything_after(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        ack = device.show(Pulses(np.full(320, 25), np.full(320, 25)))
        emulator.run_until(ack.commit_period + 1)
    capture, boundary = emulator.capture(), ack.commit_period * 50
    assert not capture.bits(0, boundary).any()
    assert (capture.bits(boundary, boundary + 25) == 0xFFFFFFFF).all()
    assert not capture.bits(boundary + 25, boundary + 50).any()


def test_bits_have_the_promised_form(emulator: Emulator) -> None:
    emulator.run(2)
    bits = emulator.capture().bits(10, 60)
    assert bits.shape == (50, 10)
    assert bits.dtype == np.uint32


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
