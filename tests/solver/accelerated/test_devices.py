"""Without a GPU the processor computes, and a warning says why and what would help."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np
import pytest
from phasewire import Circle, Medium, TransducerArray, pressure, sample_plane
from phasewire.base.extras import install_command
from phasewire.solver import Grid, sample_cut, sample_volume, solve_frames
from phasewire.solver.accelerated.devices import check_backend, cuda_device, device_for, power_of_two

pytestmark = pytest.mark.slow  # XLA compiles for seconds

SMALL = TransducerArray.grid(4, 3)
DRIVE = np.exp(1j * np.arange(12))
POINTS = [Circle(0.01), Circle(0.02)]
CALLS: dict[str, Any] = {
    "frames": lambda **of: solve_frames(SMALL, POINTS, **of),
    "pressure": lambda **of: pressure(SMALL, DRIVE, [[0, 0, 0.2]], precision="single", **of),
    "plane": lambda **of: sample_plane(SMALL, DRIVE, 0.2, 0.02, **of).pressure,
    "cut": lambda **of: sample_cut(SMALL, DRIVE, Grid.along("xz", (0, 0, 0.2), 0.02, 1e-3), **of).pressure,
    "volume": lambda **of: sample_volume(SMALL, DRIVE, Grid.along("xyz", (0, 0, 0.2), 0.02, 5e-3), **of).pressure,
}


@pytest.mark.parametrize("name", CALLS)
def test_without_jax_the_processor_computes_and_a_warning_says_what_to_install(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    expected = CALLS[name]()
    with pytest.warns(UserWarning, match="backend 'cuda' is replaced by 'cpu': a GPU needs the package jax") as said:
        found = CALLS[name](backend="cuda")
    assert install_command("gpu") in str(said[0].message)
    assert len(said) == 1
    assert found.tobytes() == expected.tobytes()


def test_without_a_device_the_warning_says_how_to_look_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def devices(platform: str) -> Any:
        raise RuntimeError(f"Unknown backend {platform}.")

    monkeypatch.setattr("jax.devices", devices)
    with pytest.warns(UserWarning, match=r"JAX [\d.]+ finds no CUDA device \(Unknown backend cuda.\); `nvidia-smi`"):
        assert device_for("cuda", None) is None


def test_a_device_is_the_first_and_does_not_take_all_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless the user has chosen otherwise."""
    monkeypatch.setattr("jax.devices", lambda platform: [f"{platform}:0", f"{platform}:1"])
    monkeypatch.delenv("XLA_PYTHON_CLIENT_PREALLOCATE", raising=False)
    assert device_for("cuda", None) == cuda_device() == "cuda:0"
    assert os.environ["XLA_PYTHON_CLIENT_PREALLOCATE"] == "false"
    monkeypatch.setenv("XLA_PYTHON_CLIENT_PREALLOCATE", "true")
    cuda_device()
    assert os.environ["XLA_PYTHON_CLIENT_PREALLOCATE"] == "true"
    assert device_for("cpu", None) is None


@pytest.mark.parametrize(
    ("method", "options", "why"),
    [
        ("polish", {}, "the method polish has no version for a GPU; tikhonov, wgs and multiplex have one"),
        ("min_norm", {}, "the method min_norm has no version for a GPU"),
        ("paper", {}, "the method paper has no version for a GPU"),
        ("wgs", {"phase_seconds": 1e5}, "phase_seconds is the time of one frame"),
        ("wgs", {"mu": 1e-5}, "mu 1e-05 is below 0.0001 and needs double precision"),
        ("wgs", {"medium": Medium(frequency=400_000, absorbing=True)}, "single precision is too coarse"),
    ],
)
def test_what_a_gpu_cannot_solve_the_processor_does(method: str, options: dict[str, Any], why: str) -> None:
    with pytest.warns(UserWarning, match=why):
        found = solve_frames(SMALL, POINTS, method, backend="cuda", **options)
    assert found.tobytes() == solve_frames(SMALL, POINTS, method, **options).tobytes()


def test_a_field_too_far_for_single_precision_is_computed_in_double() -> None:
    far = [[0.0, 0.0, 9.0]]
    with pytest.warns(UserWarning, match="single precision is too coarse for points so far away"):
        found = pressure(SMALL, DRIVE, far, precision="single", backend="cuda")
    assert found.tolist() == pressure(SMALL, DRIVE, far).tolist()


@pytest.mark.parametrize("name", CALLS)
def test_an_unknown_backend_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="backend 'gpu' must be one of cpu, cuda"):
        CALLS[name](backend="gpu")


def test_double_precision_on_a_gpu_is_refused() -> None:
    message = "backend 'cuda' computes in single precision; precision 'double' needs backend 'cpu'"
    with pytest.raises(ValueError, match=message):
        solve_frames(SMALL, POINTS, precision="double", backend="cuda")
    with pytest.raises(ValueError, match=message):
        pressure(SMALL, DRIVE, [[0, 0, 0.2]], backend="cuda")
    check_backend("cpu", "double")


@pytest.mark.parametrize(("count", "power"), [(1, 1), (2, 2), (3, 4), (4, 4), (5, 8), (1024, 1024), (1025, 2048)])
def test_sizes_are_powers_of_two(count: int, power: int) -> None:
    assert power_of_two(count) == power
