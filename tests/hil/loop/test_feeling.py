"""What is felt of bits, against the pressure that the same bits make by another way."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire import Emulator, TransducerArray, open_device, solve
from phasewire.emulator import Capture
from phasewire.feel.perception import radiation_pressures
from phasewire.feel.skin import Skin
from phasewire.feel.unfolding import SkinPatch
from phasewire.hil.loop.feeling import felt_from
from phasewire.hil.sound.air import Playback
from phasewire.hil.sound.emission import emitted_waves
from phasewire.solver import Medium

FOCUS = (0.0, 0.0, 0.2)
PATCH = SkinPatch(FOCUS, width=0.03, length=0.03, spacing=3e-3)
HALF = 100


@pytest.fixture(scope="module")
def alternating(array: TransducerArray) -> tuple[int, Capture]:
    """A focus that jumps by 3 cm, 400 times a second; the first period of the third cycle, and the capture."""
    with Emulator() as emulator, open_device(emulator.url) as device:
        for slot, x in enumerate((0.0, 0.03)):
            device.store(slot, solve(array, [[x, 0.0, 0.2]]))
        ack = device.play([(0, HALF), (1, HALF)], repeats=5)
        first = ack.commit_period + 4 * HALF
        emulator.run_until(first + 4 * HALF)
        return first, emulator.capture()


def test_bits_are_felt_at_the_frequency_that_they_alternate_by(
    array: TransducerArray, alternating: tuple[int, Capture]
) -> None:
    """How much of the pressure alternates is as `Playback` has it, which knows that outer waves come a little later."""
    first, capture = alternating
    span = first, first + 4 * HALF
    felt = felt_from(capture, PATCH, *span)
    here = felt.strongest
    assert np.linalg.norm(PATCH.positions[here] - FOCUS) < 4e-3
    at_200 = np.isclose(felt.frequencies, 200)
    assert np.abs(felt.spectra[at_200, here]) > 2 * np.abs(felt.spectra[~at_200, here]).max()
    pushed = radiation_pressures(array, emitted_waves(capture, array, *span).waves, PATCH)[:, here]
    found = np.abs(np.fft.rfft(pushed))[[0, 2]] / len(pushed) * [1, 2]
    expected = [Playback(capture, array).intensity_component([PATCH.positions[here]], f, *span)[0] for f in (0, 200)]
    assert found[1] / found[0] == pytest.approx(expected[1] / expected[0], rel=0.02)


def test_only_the_periods_that_are_named_are_felt(alternating: tuple[int, Capture]) -> None:
    """In the rest of a half cycle the resonance has nearly settled, and little changes."""
    first, capture = alternating
    changing, steady = (felt_from(capture, PATCH, first + begin, first + begin + 60) for begin in (0, 40))
    assert 0 < steady.intensity.max() < 0.15 * changing.intensity.max()


def test_array_air_and_skin_may_be_others(array: TransducerArray, alternating: tuple[int, Capture]) -> None:
    first, capture = alternating
    span = first, first + 2 * HALF
    hard = felt_from(capture, PATCH, *span)
    soft = felt_from(capture, PATCH, *span, array, Medium(temperature=20), Skin.forearm())
    assert soft.intensity.max() > 2 * hard.intensity.max()
    far = felt_from(capture, PATCH, *span, array.moved((0.3, 0, 0)))
    assert far.intensity.max() < 0.2 * hard.intensity.max()
