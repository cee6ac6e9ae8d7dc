"""Assembles and links sources of assembly, written by hand or by clang, into a `LinkedProgram`.

Code comes first in memory, in the order of the sources, so that the first source begins with the entry point; then
constants, data, and data that begin as 0. Code is padded with ``mov r0, r0``. The linker defines ``_text``, ``_cp``,
``_dp`` and ``_bss``, where these parts begin, and ``_end``. A program sets cp and dp itself::

    ldap r11, _cp
    set cp, r11
    ldap r11, _dp
    set dp, r11

``ldw r0, dp[counter]`` then reaches a label of the data, ``ldaw r11, cp[table]`` one of the constants; a number there
counts words. Symbols are known in their source only, unless ``.globl`` exports them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ...base.errors import InputFileError
from ...base.storage import FilePath, read_text
from .linking import link
from .parsing import parse
from .program import RAM_BASE, LinkedProgram

__all__ = ["RUNTIME", "AssemblySource", "assemble", "runtime"]

RUNTIME = Path(__file__).with_name("runtime.s")
"""Functions that clang calls: for numbers of 64 bits, and for memory."""

_MOST_BYTES = 16 << 20


class AssemblySource(NamedTuple):
    """Assembly with the name of its file.

    Parameters
    ----------
    name : str
        Name in messages.
    text : str
    library : bool
        Whether only those parts are linked that another part refers to. A part is from ``.cc_top`` to ``.cc_bottom``.
    """

    name: str
    text: str
    library: bool = False

    @classmethod
    def read(cls, path: FilePath, *, library: bool = False) -> AssemblySource:
        """Read a file; raises `InputFileError` if it is no text."""
        return cls(Path(path).name, read_text(path, _MOST_BYTES), library)


def assemble(
    sources: Sequence[AssemblySource], *, base: int = RAM_BASE, defines: Mapping[str, int] | None = None
) -> LinkedProgram:
    """Assemble and link.

    Parameters
    ----------
    sources : sequence of AssemblySource
        The program begins with the first. The runtime library is not added by itself: give `runtime()`.
    base : int
        The address of the first byte, a multiple of 4.
    defines : mapping, optional
        Numbers that all sources know. One replaces an ``.equ`` of the same name.

    Returns
    -------
    LinkedProgram

    Raises
    ------
    InputFileError
        With a line for each error: the file, the line's number, its text, and what is wrong.
    ValueError
        If the base is no multiple of 4.
    """
    if base % 4 or base < 0:
        raise ValueError(f"base is {base}; it must be a multiple of 4, such as 0x10000")
    defines, errors = defines or {}, list[str]()
    try:
        objects = [
            parse(source.name, source.text, library=source.library, defines=defines, errors=errors)
            for source in sources
        ]
        return link(objects, base=base, defines=defines, errors=errors)
    except RecursionError as error:
        names = ", ".join(source.name for source in sources)
        raise InputFileError(f"{names}: an expression has too many terms; name parts of it by .equ") from error


def runtime() -> AssemblySource:
    """The runtime library."""
    return AssemblySource.read(RUNTIME, library=True)
