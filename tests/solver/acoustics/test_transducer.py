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


def test_every_preset_has_a_source_of_its_strength() -> None:
    assert TRANSDUCERS["MA40S4S"] == Transducer()
    assert len({transducer.source for transducer in TRANSDUCERS.values()}) == len(TRANSDUCERS)
    assert all(2.5 <= transducer.strength <= 8.5 for transducer in TRANSDUCERS.values())


def test_transducers_with_equal_apertures_are_equal() -> None:
    one, same = (Transducer(model="rayleigh", aperture=Aperture.disc(4.5e-3, 5e-4)) for _ in range(2))
    other = Transducer(model="rayleigh", aperture=Aperture.disc(4e-3, 5e-4))
    assert one == same != other
    assert len({one, same, other, Transducer(model="rayleigh")}) == 3


def test_a_rayleigh_integral_keeps_two_radii_away() -> None:
    assert Transducer().nearest == Transducer(model="monopole").nearest == 4.5e-3
    assert Transducer(model="rayleigh").nearest == 9e-3
    assert Transducer(model="rayleigh", aperture=DISC).nearest == 2 * DISC.reach > 9e-3


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
