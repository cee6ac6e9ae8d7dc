"""Fields by JAX against the complex128 sum, on a GPU if there is one: the program is the same on a processor."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire import Medium, Transducer, TransducerArray, pressure, sample_plane
from phasewire.solver.accelerated import propagation
from phasewire.solver.acoustics.propagation import transfer_matrix
from phasewire.solver.acoustics.tables import pressure_at, tables_of

pytestmark = pytest.mark.slow  # XLA compiles for seconds

SEEDS = st.integers(0, 2**32 - 1)
WIDE = Transducer(radius=0.02)  # of ka 15, whose lobes no short polynomial follows
MODELS = {model: Transducer(model=model, polarity=-1) for model in ("monopole", "rayleigh", "rayleigh-1", "as-printed")}


def device() -> Any:
    return jax.devices()[0]


def panels(rng: np.random.Generator, transducer: Transducer) -> TransducerArray:
    """Two panels, one of them turned and moved at random, far from the origin, with any response."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    panel = TransducerArray.grid(7, 5, 0.05 if transducer is WIDE else 0.0103, transducer)
    array = TransducerArray.joined([panel, panel.placed(axes * np.sign(np.linalg.det(axes)), [0.1, 0.2, 0.3])])
    return array.placed(np.eye(3), [5, -3, 9]).calibrated(rng.normal(size=70) + 1j * rng.normal(size=70))


def compare(transducer: Transducer, absorbing: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    array, medium = panels(rng, transducer), Medium(33, absorbing=absorbing)
    drive = rng.uniform(0, 1, 70) * np.exp(2j * np.pi * rng.uniform(size=70))
    at = np.add(rng.uniform([-0.4, -0.4, 0.5], [0.4, 0.4, 0.9], (300, 3)), [5, -3, 9])
    exact = pressure(array, drive, at, medium)
    found = pressure_at(tables_of(array, medium), array, drive, at, device())
    np.testing.assert_allclose(found, exact, atol=2e-4 * np.abs(exact).max())


@given(seed=SEEDS)
@settings(max_examples=10)
def test_a_field_is_the_double_one(seed: int) -> None:
    compare(Transducer(polarity=-1), True, seed)


@pytest.mark.parametrize("absorbing", [False, True])
@pytest.mark.parametrize("transducer", [*MODELS.values(), WIDE], ids=[*MODELS, "wide"])
@given(seed=SEEDS)
@settings(max_examples=10)
def test_every_model_has_the_double_field(transducer: Transducer, absorbing: bool, seed: int) -> None:
    compare(transducer, absorbing, seed)


@pytest.mark.parametrize("turns", [0.0, 0.25, 0.5, 0.75, 123.4375, -77.0625])
def test_whole_turns_leave_the_wave_as_it_is(turns: float) -> None:
    exact = np.exp(2j * np.pi * np.fmod(turns, 1))
    assert complex(propagation._turned(jax.numpy.float32(turns))) == pytest.approx(exact, abs=2e-6)


def test_a_large_field_is_summed_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    array = TransducerArray.grid(4, 4)
    drive, at = np.exp(1j * np.arange(16)), np.random.default_rng(0).uniform(0.05, 0.2, (1000, 3))
    whole = pressure_at(tables_of(array, Medium()), array, drive, at, device())
    monkeypatch.setattr(propagation, "PAIRS_AT_A_TIME", 256 * 16)
    parts = pressure_at(tables_of(array, Medium()), array, drive, at, device())
    np.testing.assert_allclose(parts, whole, atol=1e-6 * np.abs(whole).max())
    np.testing.assert_allclose(parts, transfer_matrix(array, at) @ drive, atol=1e-4 * np.abs(whole).max())


def test_a_block_of_a_field_keeps_each_wave_once_at_most(array: TransducerArray) -> None:
    """As XLA plans it for a processor, for which it does not fuse the sum."""
    tables = tables_of(array, Medium())
    points = propagation.PAIRS_AT_A_TIME // len(array)
    emitted = np.zeros(tables.elements.shape[1], np.complex64)
    lowered = propagation._pressure.lower(
        propagation.WaveTables(*tables[:4]), emitted, np.zeros((points, 3), np.float32)
    )
    analysis: Any = lowered.compile().memory_analysis()
    assert analysis.temp_size_in_bytes < 1.1 * 8 * propagation.PAIRS_AT_A_TIME


def test_a_plane_is_sampled_by_the_device(array: TransducerArray, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phasewire.solver.accelerated.devices.cuda_device", device)
    drive = np.exp(1j * np.arange(320))
    here, there = (sample_plane(array, drive, 0.2, 0.05, backend=backend) for backend in ("cpu", "cuda"))
    np.testing.assert_allclose(there.pressure, here.pressure, atol=1e-4 * here.strongest()[0])
    assert not np.array_equal(there.pressure, here.pressure)  # roundings differ: another program summed it
