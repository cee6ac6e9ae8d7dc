"""How compiled kernels are compiled: by numba, which keeps the result on disk if it can.

This module stands at the bottom. It takes as long to import as numba does, so only modules of kernels may import it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from hashlib import sha256
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

import numpy as np
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

    Notes
    -----
    numba takes a compiled kernel from the disk if the kernel's own file is as old and as long as it was. Parts and
    constants of other files are compiled into it too, so what they are is added to what numba compares.
    """
    try:
        compiled = njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:  # there is no folder that numba's cache could be written to
        return cast(Function, njit(nogil=True, **options)(function))
    file = compiled._cache._cache_file  # numba has no public name for it
    file._source_stamp = (*file._source_stamp, _fingerprint(function))
    return cast(Function, compiled)


def part(function: Function) -> Function:
    """A function for kernels, compiled with them. It is not cached alone."""
    return cast(Function, njit(function))


def _fingerprint(function: Callable[..., Any]) -> str:
    """Changes with the code and the constants of a function and of all that it calls in this package."""
    digest, waiting, seen = sha256(), [function], set()
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        for code in _codes(one.__code__):
            digest.update(code.co_code + repr([c for c in code.co_consts if not isinstance(c, CodeType)]).encode())
            cells = {} if one.__closure__ is None else zip(one.__code__.co_freevars, one.__closure__, strict=True)
            known = one.__globals__ | {name: cell.cell_contents for name, cell in dict(cells).items()}
            for name in (*code.co_names, *code.co_freevars):
                value = known.get(name)
                if isinstance(called := _python(value), FunctionType):
                    waiting.append(called)
                elif isinstance(value, np.ndarray):
                    digest.update(value.tobytes())
                elif isinstance(value, (int, float, complex, tuple, str, np.generic)):
                    digest.update(f"{name}={value!r}".encode())
    return digest.hexdigest()


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A code, and those of the functions inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _python(value: object) -> object:
    """The function behind what numba has made of it: a compiled one or an intrinsic."""
    return getattr(value, "py_func", getattr(value, "_defn", value))
