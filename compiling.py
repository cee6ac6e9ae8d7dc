"""How compiled kernels are compiled: by numba, which keeps the result on disk where it can.

This module stands at the bottom. It takes as long to import as numba does, so only modules of kernels may import it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["kernel", "part"]

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function, **options: Any) -> Function:
    """A function as numba compiles it at its first call, without the interpreter's lock.

    Parameters
    ----------
    function : callable
        Of plain numbers and arrays.
    **options
        Further options of ``numba.njit``.
    """
    try:
        return cast(Function, njit(cache=True, nogil=True, **options)(function))
    except RuntimeError:  # there is no folder that numba's cache could be written to
        return cast(Function, njit(nogil=True, **options)(function))


def part(function: Function) -> Function:
    """A function for kernels of the same module, compiled with them. It is not cached alone."""
    return cast(Function, njit(function))
