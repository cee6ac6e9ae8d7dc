from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from phasewire.protocol import Pulses

from tests.oracles import quantisation_bound
from tests.strategies import drives, pulses


def fundamental(start: float, stop: float) -> complex:
    """(2/T)·∫ e^{iωt} dt from start to stop, in ticks: the phasor of a pulse under the time factor e^{-iωt}."""
    omega = 2 * np.pi / 50
    return complex(2 / 50 * (np.exp(1j * omega * stop) - np.exp(1j * omega * start)) / (1j * omega))


def every_exact_phasor() -> np.ndarray:
    """The phasors of pulses of w whole ticks that begin on a whole tick, in units of the widest one's magnitude 2/π."""
    return np.array([fundamental(s, s + w) / (2 / np.pi) for w in range(26) for s in range(50)])


@given(drives(8))
def test_from_drive_picks_the_nearest_of_all_pulses(drive: np.ndarray) -> None:
    best = np.abs(every_exact_phasor()[:, None] - drive).min(axis=0)
    chosen = np.abs(Pulses.from_drive(drive).to_drive() - drive)
    np.testing.assert_allclose(chosen, best, atol=1e-12)


def test_the_closed_bound_is_tight() -> None:
    """Some drive must nearly reach it."""
    drive = np.linspace(0, 1, 200)[:, None] * np.exp(1j * np.linspace(0, 0.26, 100))
    distance = np.abs(every_exact_phasor()[:, None] - drive.ravel()).min(axis=0)
    ratio = distance / quantisation_bound(np.abs(drive.ravel()))
    assert 0.95 < ratio.max() <= 1


@given(drives(8))
def test_from_drive_makes_exact_pulses_only(drive: np.ndarray) -> None:
    made = Pulses.from_drive(drive)
    sounding = made.width > 0
    assert ((made.phase % 2) == (made.width % 2))[sounding].all()


@given(pulses(16))
def test_to_drive_is_the_fundamental_of_the_pulse(made: Pulses) -> None:
    expected = [
        fundamental(s, s + int(w)) / (2 / np.pi) for s, w in zip(made.start.tolist(), made.width.tolist(), strict=True)
    ]
    np.testing.assert_allclose(made.to_drive(), expected, atol=1e-12)


def test_silence_has_one_form() -> None:
    assert Pulses.from_drive([0, 0.001j, -0.02]) == Pulses.silent(3)


def test_an_error_names_a_wrong_shape() -> None:
    with pytest.raises(ValueError, match=r"shape \(n,\), not \(1, 1\)"):
        Pulses.from_drive([[1.0]])
    with pytest.raises(ValueError, match=r"drive must be numbers"):
        Pulses.from_drive(object())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("phase", "width", "message"),
    [
        ([100], [0], "phase 100 of transducer 0 is outside 0 to 99 half ticks"),
        ([0, 0], [0, 26], "width 26 of transducer 1 is outside 0 to 25 ticks"),
        ([0], [-1], "width -1 of transducer 0"),
        ([0, 1], [1], "2 phases but 1 widths"),
        ([0.5], [1], "phase must be whole numbers of half ticks"),
    ],
)
def test_an_error_names_bad_pulses(phase: list[int], width: list[int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Pulses(phase, width)


def test_equality_compares_values() -> None:
    assert Pulses.silent(3) == Pulses([0, 0, 0], [0, 0, 0])
    assert Pulses.silent(3) != Pulses([0, 0, 1], [0, 0, 0])
    assert Pulses.silent(3) != "silence"


@pytest.mark.parametrize("sample", [-1, 256])
def test_samples_have_eight_bits(sample: int) -> None:
    with pytest.raises(ValueError, match=f"sample {sample} must be a whole number from 0 to 255"):
        Pulses.silent(2).modulated(sample)
