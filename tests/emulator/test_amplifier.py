"""The amplifier against its ramps, drawn finely, and against the fundamental of a pulse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.ports.amplifier import Amplifier

FINE = 1000  # moments per tick


@given(st.lists(st.booleans(), min_size=1, max_size=12), st.booleans(), st.integers(0, FINE), st.floats(12, 18))
def test_a_tick_s_voltage_is_the_mean_of_its_ramps(bits: list[bool], before: bool, edge: int, supply: float) -> None:
    voltage, waveform = supply * before, []
    for bit in bits:
        for moment in range(FINE):
            passed = (moment + 0.5) / edge if moment < edge else 1.0
            waveform.append(voltage + (supply * bit - voltage) * passed)
        voltage = supply * bit
    found = Amplifier(supply, edge * 0.5e-6 / FINE).voltage(bits, before)
    np.testing.assert_allclose(found, np.reshape(waveform, (-1, FINE)).mean(axis=1), atol=1e-9)


@pytest.mark.parametrize("width", [1, 7, 24, 25])
@pytest.mark.parametrize(("supply", "edge"), [(15.0, 0.0), (12.0, 0.0), (15.0, 50e-9), (18.0, 0.5e-6)])
def test_the_gain_is_that_of_any_pulse(width: int, supply: float, edge: float) -> None:
    """(2/T)·∫ v(t)·e^{iωt} dt of the voltage's steps, over the same of an ideal pulse from 0 to 15 V."""
    volts = Amplifier(supply, edge).voltage(np.arange(50) % 50 < width, before=0)
    rises = volts - np.roll(volts, 1)
    fundamental = -(np.exp(2j * np.pi * np.arange(50) / 50) @ rises) / (1j * np.pi)
    ideal = 15 * 2 / np.pi * np.sin(np.pi * width / 50) * np.exp(1j * np.pi * width / 50)
    assert Amplifier(supply, edge).gain == pytest.approx(fundamental / ideal, abs=1e-12)


def test_an_edge_delays_by_half_of_itself() -> None:
    """A ramp's fundamental is late by half the ramp and sinc(f·ramp) of it is left."""
    for edge in (20e-9, 50e-9, 100e-9):
        true = np.sinc(40e3 * edge) * np.exp(2j * np.pi * 40e3 * edge / 2)
        assert abs(Amplifier(edge_s=edge).gain - true) < 8e-4 * edge / 100e-9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"supply_v": 11.9}, r"supply_v 11\.9 V must lie between 12 and 18 V"),
        ({"supply_v": float("nan")}, "supply_v nan V"),
        ({"edge_s": -1e-9}, "edge_s -1e-09 s must lie between 0 and a tick, 5e-07 s"),
        ({"edge_s": 0.6e-6}, "edge_s 6e-07 s"),
    ],
)
def test_an_impossible_amplifier_is_refused(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Amplifier(**arguments)
