"""A cycle judged from the bits: whom it is judged for, over which time, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from phasewire import Circle, Cycle, Outline, TransducerArray, render
from phasewire.feel.unfolding import SkinPatch
from phasewire.hil.loop.sensing import sense, skin_over

ARRAY = TransducerArray.grid()
SHAPE = Circle(radius=0.02)
SMALL = SkinPatch((0, 0, 0.2), 0.06, 0.06, 4e-3)


def test_ears_hear_and_the_whole_head_is_exposed() -> None:
    sensed = sense(render(ARRAY, SHAPE, "am"), SMALL)
    assert sensed.sound.levels_dba.shape == (2,)
    assert sensed.exposure.at.shape == (3, 3)
    one = sense(render(ARRAY, SHAPE, "am"), SMALL, np.array([[0.0, -0.5, 0.4]]))
    assert one.sound.levels_dba.shape == one.exposure.mean_db.shape == (1,)
    assert json.loads(json.dumps(one.record()))["power"]["acoustic_w"] == pytest.approx(one.power.acoustic)


def test_an_envelope_is_judged_over_whole_swings() -> None:
    """A constant field under it is felt at its frequency alone; a swing that was cut would be felt as a jump."""
    drive = render(ARRAY, [[0, 0, 0.2]], "am:envelope=square").drives[:1]
    felt = sense(Cycle(drive, 333, envelope=200.0), SMALL).felt
    sizes = np.abs(felt.spectra).max(axis=1)
    strong = felt.frequencies[sizes > 0.02 * sizes.max()]
    assert len(strong) >= 2
    assert np.abs((strong + 100) % 200 - 100).max() < 1


@pytest.mark.parametrize(("frames", "hold", "envelope"), [(3, 30_000, 0.0), (1, 10, 0.1)])
def test_a_cycle_that_takes_too_long_is_refused(frames: int, hold: int, envelope: float) -> None:
    with pytest.raises(ValueError, match=r"too long to be judged; at most 2 s"):
        sense(Cycle(np.ones((frames, 320), np.complex64), hold, envelope), SMALL)


def test_the_hand_lies_over_the_shape() -> None:
    positions = skin_over(Outline.of(SHAPE)).positions
    assert np.median(positions[:, 2]) == pytest.approx(0.2, abs=1e-3)
    assert np.linalg.norm(positions[:, :2], axis=1).min() < 3e-3
