"""C into assembly of the XS1, by a clang that is installed. Nothing else needs one: assembly and images do not."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from ...base.errors import InputFileError
from ...base.storage import FilePath
from .assembler import AssemblySource

__all__ = ["CompilerMissingError", "compile_c", "find_clang"]

_OPTIONS = ("--target=xcore", "-std=c11", "-O2", "-S", "-x", "c")
_NEWEST, _OLDEST = 30, 11  # of the numbered names of clang that are tried
_PATIENCE_S = 60


class CompilerMissingError(InputFileError):
    """C cannot be compiled, because no clang with a target for the XS1 is installed."""


@cache
def find_clang() -> str | None:
    """The path of a clang that has the target xcore: ``clang``, or the newest of ``clang-11`` and so on; else None."""
    for name in ("clang", *(f"clang-{version}" for version in range(_NEWEST, _OLDEST - 1, -1))):
        if path := shutil.which(name):
            asked = subprocess.run(
                [path, "--print-targets"], capture_output=True, text=True, timeout=_PATIENCE_S, check=False
            )
            if re.search(r"^\s*xcore\b", asked.stdout, re.MULTILINE):
                return path
    return None


def compile_c(
    path: FilePath, *, defines: Mapping[str, int] | None = None, options: Sequence[str] = ()
) -> AssemblySource:
    """Compile a file of C.

    Parameters
    ----------
    path : str or Path
        The file; what it includes in quotes is looked for beside it.
    defines : mapping, optional
        Numbers that the preprocessor knows by name.
    options : sequence of str
        Further options of clang.

    Returns
    -------
    AssemblySource
        Assembly by the name of the file.

    Raises
    ------
    CompilerMissingError
        If no clang with the target xcore is installed.
    InputFileError
        If clang refuses the file; the message has its errors.
    OSError
        If the file cannot be read.
    """
    with Path(path).open("rb"):
        pass  # a missing file is named as other commands do
    clang = find_clang()
    if clang is None:
        raise CompilerMissingError(
            f"{path} is C, and no clang with the target xcore is installed; install clang (11 or newer), "
            "or compile it elsewhere by `clang --target=xcore -O2 -S` and give the .s file"
        )
    given = [f"-D{name}={value}" for name, value in (defines or {}).items()]
    ended = subprocess.run(
        [clang, *_OPTIONS, *options, *given, str(path), "-o", "-"],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=_PATIENCE_S,
        check=False,
    )
    if ended.returncode:
        raise InputFileError(f"{path} does not compile:\n{ended.stderr.strip()}")
    return AssemblySource(Path(path).name, ended.stdout)
