from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from phasewire import Transducer
from phasewire.solver import MODELS, TRANSDUCERS, Aperture

DISC = Aperture.disc(4.5e-3, 5e-4)


def test_the_default_strength_is_the_paper_s_20_pascals() -> None:
    """20 Pa rms at 30 cm and 10 V rms, scaled to the fundamental of a square wave between 0 and 15 V."""
    peak_at_10_v_rms = 20 * np.sqrt(2) * 0.3
    fundamental = 2 / np.pi * 15
    assert Transducer().strength == pytest.approx(peak_at_10_v_rms * fundamental / (10 * np.sqrt(2)), rel=1e-3)
    assert TRANSDUCERS["MA40S4S-10Vrms"].strength == pytest.approx(peak_at_10_v_rms, rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"radius": -1}, "radius -1 m must be positive"),
        ({"resonance": 0}, "resonance 0 Hz"),
        ({"time_constant": 2}, "time_constant 2 s must be positive and at most 1"),
        ({"polarity": 0}, "polarity 0 must be 1 or -1"),
        ({"model": "plane"}, f"unknown transducer model 'plane'; known are {', '.join(MODELS)}"),
        ({"aperture": DISC}, "model 'piston' has no aperture; rayleigh, rayleigh-1, as-printed have one"),
    ],
)
def test_impossible_transducers_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Transducer(**arguments)
