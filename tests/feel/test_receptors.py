"""The channels of touch against what is published of them."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.feel.receptors import TOUCH_CHANNELS, TouchChannel

P, NP_I, NP_III = TOUCH_CHANNELS

READ: dict[TouchChannel, dict[float, float]] = {
    P: {40: 10.0, 100: -6.0, 250: -20.0, 500: -12.0},
    NP_I: {3: 24.0, 30: 11.0, 100: 15.0},
    NP_III: {0.4: 27.0, 3: 24.0},
}
"""dB re 1 µm, which the module says may be wrong by 3."""


def decibels(metres: float) -> float:
    return float(20 * np.log10(metres / 1e-6))


def test_thresholds_are_those_of_the_table() -> None:
    for channel, known in READ.items():
        for frequency, level in known.items():
            assert decibels(float(channel.threshold(frequency))) == pytest.approx(level)


@pytest.mark.parametrize(
    ("frequency", "lowest"), [(1.0, NP_III), (10.0, NP_I), (30.0, NP_I), (63.0, P), (125.0, P), (250.0, P)]
)
def test_the_most_sensitive_channel_is_the_published_one(frequency: float, lowest: TouchChannel) -> None:
    """Bolanowski 1988; Morioka, Whitehouse and Griffin 2008: not Pacinian to 31.5 Hz, Pacinian from 63 Hz."""
    assert min(TOUCH_CHANNELS, key=lambda channel: float(channel.threshold(frequency))) is lowest


def test_the_lowest_threshold_agrees_with_another_laboratory_s() -> None:
    """ISO 13091-2's medians at fingertips, to the 5 dB by which our notes of them may be wrong; m/s² rms."""
    for frequency, acceleration in {4.0: 6e-3, 31.5: 0.1, 125.0: 0.18}.items():
        peak = np.sqrt(2) * acceleration / (2 * np.pi * frequency) ** 2
        lowest = min(float(channel.threshold(frequency)) for channel in TOUCH_CHANNELS)
        assert decibels(lowest) == pytest.approx(decibels(peak), abs=5)


def test_between_the_table_s_frequencies_it_is_a_line_and_outside_nothing_is_felt() -> None:
    assert decibels(float(P.threshold(np.sqrt(60 * 100)))) == pytest.approx((3 - 6) / 2)
    np.testing.assert_array_equal(P.threshold([9.9, 801.0, 0.0]), np.inf)


def test_only_the_pacinian_channel_sums_over_area() -> None:
    assert [channel.area for channel in TOUCH_CHANNELS] == [2.9e-4, 0, 0]
    assert repr(P) == "TouchChannel(P, FA II, 10 to 800 Hz)"
