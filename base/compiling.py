"""Compiles kernels with numba, which keeps the result in the user's cache folder if it can.

This module stands at the bottom. Importing it imports numba, which is slow, so only modules of kernels may import it.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import EnumType
from hashlib import sha256
from threading import Lock
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np
from numba import config, njit
from numba.core import event
from numba.core.caching import NullCache
from platformdirs import user_cache_path

__all__ = ["kernel", "part"]

Function = TypeVar("Function", bound=Callable[..., Any])

_log = logging.getLogger(__name__)
_ROOT = __name__.removesuffix("base.compiling")
_choosing = Lock()
"""Of numba's setting, which all threads share: several may load kernels at a time."""


class _Notice(event.Listener):
    """Says once that this package compiles, at a terminal, in a notebook, or if the logger's level is INFO."""

    _said = False

    def on_start(self, event: Any) -> None:
        compiled = event.data["dispatcher"]
        if self._said or not str(compiled.py_func.__module__).startswith(_ROOT):
            return
        self._said = True
        when = "the first time on a machine"
        if isinstance(compiled._cache, NullCache):
            when = "in each run, because no folder for the result can be written; name one in $NUMBA_CACHE_DIR"
        if hasattr(sys, "ps1") or getattr(sys.stderr, "isatty", bool)() or _log.isEnabledFor(logging.INFO):
            _log.warning("phasewire compiles its kernels: up to a minute, %s", when)

    def on_end(self, event: Any) -> None:
        """Do nothing; numba requires this method."""


_notice = _Notice()
event.register("numba:compile", _notice)  # type: ignore[no-untyped-call]  # numba has no types


def kernel(function: Function, **options: Any) -> Function:
    """A function that numba compiles at its first call, without the interpreter's lock.

    Parameters
    ----------
    function : callable
        A function of plain numbers and arrays.
    **options
        Further options of ``numba.njit``.

    Notes
    -----
    numba reuses a compiled kernel from the disk if the kernel's own file has the same time and size. Parts and
    constants of other files are compiled into it too, so their contents are added to numba's comparison. The results
    are in ``$NUMBA_CACHE_DIR``, else in the user's cache folder, by the folder of the kernel's file: two installations
    do not share them.
    """
    try:
        with _kernels_folder():
            compiled = njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:  # no folder is writable for numba's cache
        return cast(Function, njit(nogil=True, **options)(function))
    file = compiled._cache._cache_file  # numba has no public name for it
    file._source_stamp = (*file._source_stamp, _fingerprint(function))
    return cast(Function, compiled)


@contextmanager
def _kernels_folder() -> Iterator[None]:
    """Let numba choose the user's cache folder for functions of this block, and no others, unless one is named."""
    settings: Any = config  # numba makes its names while it is imported
    with _choosing:
        before = settings.CACHE_DIR
        settings.CACHE_DIR = before or str(user_cache_path("phasewire") / "kernels")
        try:
            yield
        finally:
            settings.CACHE_DIR = before


def part(function: Function) -> Function:
    """A function for kernels, compiled with them. It has no cache of its own."""
    return cast(Function, njit(function))


def _fingerprint(function: Callable[..., Any]) -> str:
    """Changes with the code and constants of a function and of all its callees in this package, enums included."""
    digest, waiting, seen = sha256(), [function], set()
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        for code in _codes(one.__code__):
            constants = [c for c in code.co_consts if not isinstance(c, CodeType)]
            digest.update(code.co_code + repr((constants, code.co_names)).encode())
            cells = {} if one.__closure__ is None else zip(one.__code__.co_freevars, one.__closure__, strict=True)
            known = one.__globals__ | {name: cell.cell_contents for name, cell in dict(cells).items()}
            for value in _meant(code, known):
                if isinstance(called := _python(value), FunctionType):
                    waiting.append(called)
                elif isinstance(value, np.ndarray):
                    digest.update(value.tobytes())
                elif isinstance(value, (int, float, complex, tuple, str, np.generic)):
                    digest.update(repr(value).encode())
                elif isinstance(value, EnumType):
                    members: dict[str, Any] = dict(value.__members__)
                    digest.update(repr({key: member.value for key, member in members.items()}).encode())
                elif fields := getattr(value, "_fields", ()):  # of a NamedTuple
                    digest.update(repr(fields).encode())
    return digest.hexdigest()


def _meant(code: CodeType, known: dict[str, Any]) -> Iterator[Any]:
    """What the names of a code object mean, as its own globals and as attributes of modules of the same package."""
    package = known["__name__"].partition(".")[0]
    modules = [
        module
        for name in code.co_names
        if isinstance(module := known.get(name), ModuleType) and module.__name__.partition(".")[0] == package
    ]
    for name in (*code.co_names, *code.co_freevars):
        yield known.get(name)
        yield from (getattr(module, name, None) for module in modules)


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A code object, and those of the functions inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _python(value: object) -> object:
    """The Python function of a numba object: of a compiled one or an intrinsic."""
    return getattr(value, "py_func", getattr(value, "_defn", value))
