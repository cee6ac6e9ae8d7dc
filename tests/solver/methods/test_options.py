from __future__ import annotations

from typing import Any

import pytest
from phasewire.solver.methods.methods import options_of


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("magic", {}, "unknown method 'magic'; known are wgs, polish, tikhonov"),
        ("wgs", {"gamma": 1.5}, "gamma 1.5 must be from 0 to 1"),
        ("wgs", {"mu": 0.0}, "mu 0.0 must be positive and at most 1e.06"),
        ("wgs", {"mu": 1e308}, "mu 1e.308 must be"),
        ("wgs", {"phase_steps": -1}, "phase_steps -1 must be a whole number from 0"),
        ("wgs", {"phase_steps": 2.0}, "phase_steps 2.0 must be a whole number"),
        ("wgs", {"steps": 10**9}, "steps 1000000000 must be a whole number from 0 to 100000"),
        ("wgs", {"phase_seconds": -1}, "phase_seconds -1 s must be from 0"),
        ("wgs", {"phases": "best"}, "phases 'best' must be one of unit, power"),
        ("wgs", {"output": "loud"}, "output 'loud' must be one of solved, phase, limited"),
        ("polish", {"levels": 1}, "levels 1 must be a whole number from 2"),
        ("polish", {"sweeps": -1}, "sweeps -1 must be"),
        ("tikhonov", {"steps": 5}, "tikhonov has no option 'steps'; it has output, phases, phase_steps"),
        ("multiplex", {"gamma": 0.5}, "multiplex has no option 'gamma'; it has output$"),
        ("paper", {"mu": 0.5}, "paper has no option 'mu'"),
        ("wgs", {"magic": 1}, "wgs has no option 'magic'"),
    ],
)
def test_bad_options_are_named(method: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        options_of(method, options)
