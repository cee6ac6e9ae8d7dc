"""Which device computes: a processor by the compiled kernels, or a GPU by JAX.

JAX takes half a second to import and is an extra, so this module imports it when a GPU is asked for.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Literal, get_args
from warnings import warn

from ...base.errors import MissingExtraError
from ...base.extras import install_command, needing

if TYPE_CHECKING:
    from jax import Device

__all__ = ["Backend", "check_backend", "cuda_device", "device_for", "power_of_two"]

Backend = Literal["cpu", "cuda"]


def check_backend(backend: Backend, precision: str) -> None:
    """Raise `ValueError` if a backend is unknown, or does not have the precision."""
    if backend not in get_args(Backend):
        raise ValueError(f"backend {backend!r} must be one of {', '.join(get_args(Backend))}")
    if backend == "cuda" and precision != "single":
        raise ValueError(f"backend 'cuda' computes in single precision; precision {precision!r} needs backend 'cpu'")


def device_for(backend: Backend, hindrance: str | None) -> Device | None:
    """The device of a backend; None is the processor, with a warning if a GPU was asked for but is hindered."""
    if backend == "cpu":
        return None
    if hindrance is None:
        try:
            return cuda_device()
        except (MissingExtraError, LookupError) as error:
            hindrance = str(error)
    warn(f"backend 'cuda' is replaced by 'cpu': {hindrance}", stacklevel=3)
    return None


def cuda_device() -> Device:
    """The first CUDA device.

    `MissingExtraError` if JAX is not installed; `LookupError` if it finds no device.
    """
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")  # or JAX takes most of the GPU's memory at once
    with needing("gpu", "a GPU"):
        import jax
    try:
        return jax.devices("cuda")[0]
    except RuntimeError as error:
        raise LookupError(
            f"JAX {jax.__version__} finds no CUDA device ({error}); `nvidia-smi` shows whether the driver has one, and "
            f"{install_command('gpu')} adds JAX for it"
        ) from error


def power_of_two(count: int) -> int:
    """The least one that is not below ``count``: sizes of work, because XLA compiles anew for each size."""
    return 1 << (count - 1).bit_length()
