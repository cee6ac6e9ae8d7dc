"""Makes the functions of a core's kernel. Importing this module imports numba, so only modules of kernels import it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

from ...base.compiling import kernel as _kernel

__all__ = ["kernel", "part"]

Function = TypeVar("Function", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
"""The kernel counts no references to its arrays, which Python holds: that would take half of its time."""


def kernel(function: Function) -> Function:
    """The core's kernel, which is compiled at its first call."""
    return _kernel(function, **OPTIONS)


def part(function: Function) -> Function:
    """A function for the core's kernel, compiled with it."""
    return cast(Function, njit(**OPTIONS)(function))
