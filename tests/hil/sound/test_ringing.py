"""Waveforms that periods share, against resonators that are rung bit by bit by the readable one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire.emulator.ports.amplifier import FULL_DRIVE_V, Amplifier
from phasewire.hil.sound.ringing import Emission, ResonatorBank
from phasewire.solver.acoustics.resonator import OnePole, Resonator

TICK = 0.5e-6
AMPLIFIER = Amplifier(14, 0.2e-6)


@dataclass
class Played:
    """Port words, (ticks, 10)."""

    words: NDArray[np.uint32]

    @property
    def end_tick(self) -> int:
        return len(self.words)

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        assert 0 <= start <= stop <= len(self.words)
        return self.words[start:stop]


def tables(count: int, seed: int = 1) -> NDArray[np.uint32]:
    return np.random.default_rng(seed).integers(0, 2**32, (count, 50, 10), dtype=np.uint32)


def played(seed: int, *order: int) -> Played:
    """Tables in an order, 0 for silence."""
    known = np.concatenate([np.zeros((1, 50, 10), np.uint32), tables(max(order), seed)])
    return Played(known[list(order)].reshape(-1, 10))


def resonance() -> OnePole:
    return Resonator().sampled(TICK)


def expected(capture: Played, first: int, last: int) -> NDArray[np.complex128]:
    """States at the beginning of each tick of some periods, and at the end of the last, (ticks + 1, 320)."""
    begin = min(first * 50, 0)
    words = np.zeros((last * 50 - begin + 1, 10), np.uint32)
    until = min(len(capture.words), last * 50)
    words[1 - begin : 1 - begin + until] = capture.words[:until]
    levels = (words[:, :, None] >> np.arange(32, dtype=np.uint32) & 1).reshape(len(words), 320)
    drives = AMPLIFIER.voltage(levels[1:], levels[0]) / FULL_DRIVE_V
    return resonance().ring(drives)[first * 50 - begin :]


def states(emission: Emission) -> NDArray[np.complex128]:
    """The states according to the emission."""
    if emission.shares is None:
        return np.asarray(emission.states[0].T, dtype=np.complex128)
    periods = np.tensordot(emission.shares.astype(float), emission.states.astype(np.complex128), 1)
    whole = np.moveaxis(periods[:, :, :-1], 2, 1).reshape(-1, 320)
    np.testing.assert_allclose(periods[:-1, :, -1], periods[1:, :, 0], atol=2e-5)  # without a step between periods
    return np.asarray(np.concatenate([whole, periods[-1:, :, -1]]))


REPEATED = (0, 0, 0, 1, 1, 1, 2, 2, 1, 1, 1, 2, 2, 2, 0, 0, 1, 1, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0)
FRESH = tuple(range(1, 46))
STEADY, SILENT = (1,) * 16, (0,) * 16


@pytest.mark.parametrize("order", [REPEATED, FRESH, STEADY], ids=["repeated", "fresh", "steady"])
@pytest.mark.parametrize(("first", "last"), [(0, 9), (-3, 36), (5, 60)])
def test_the_states_are_those_of_every_bit(order: tuple[int, ...], first: int, last: int) -> None:
    capture = played(3, *order)
    bank = ResonatorBank(capture, AMPLIFIER, resonance(), min(first, 0))
    bank.skip_until(first)
    pieces = list(bank.emit_until(last))
    assert bank.period == last
    exact, at = expected(capture, first, last), first
    for piece in pieces:
        assert piece.first == at
        found = states(piece)
        begin = (at - first) * 50
        np.testing.assert_allclose(found, exact[begin : begin + len(found)], atol=1e-5 * np.abs(exact).max())
        at += (len(found) - 1) // 50
    assert at == last


def test_after_an_emission_the_states_are_exact() -> None:
    """Sharing waveforms does not accumulate errors over pieces: what is kept between them is in double precision."""
    capture = played(4, *(REPEATED * 2))
    bank = ResonatorBank(capture, AMPLIFIER, resonance(), 0)
    for period in (36, 72):
        list(bank.emit_until(period))
        np.testing.assert_allclose(bank._state, expected(capture, 0, period)[-1], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(
    "order", [REPEATED, FRESH, (1,) * 16, (0,) * 16], ids=["repeated", "fresh", "steady", "silent"]
)
def test_what_is_heard_is_the_weighted_sum_of_delayed_states(order: tuple[int, ...]) -> None:
    rng = np.random.default_rng(7)
    lag = rng.integers(0, 130, (66, 320))
    here, following = (rng.normal(size=(2, 66, 320, 2)) @ [1, 1j]).astype(np.complex64)
    emitted = []
    sound, fresh = np.full((66, 24, 50), 7, np.float32), 0
    bank = ResonatorBank(played(8, *order), AMPLIFIER, resonance(), 0)
    for until in (8, 16):
        for piece in bank.emit_until(until):
            fresh = piece.arrive(sound, piece.first - 1, fresh, lag, here, following)  # but for the first period
            emitted.append(states(piece))
    exact = np.concatenate([*(piece[:-1] for piece in emitted), emitted[-1][-1:]])
    assert fresh > 16
    for point in (0, 63, 64, 65):
        heard = np.zeros(1000)
        for q in range(320):
            wave = here[point, q] * exact[:-1, q] + following[point, q] * exact[1:, q]
            heard[lag[point, q] : lag[point, q] + 800] += wave.real
        found = sound[point, :fresh].ravel()
        np.testing.assert_allclose(found, heard[50:][: len(found)], atol=1e-5 * max(np.abs(heard).max(), 1))
    assert (sound[:, fresh:] == 7).all()
