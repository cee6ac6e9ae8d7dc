"""The program's C, compiled for the machine that tests run on."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
from phasewire.firmware.xmos.build import FOLDER

SOURCES = ("play.c", "tables.c", "handle.c")


class CMessage(ctypes.Structure):
    _fields_ = (("body", ctypes.c_uint32 * 14), ("kind", ctypes.c_uint32), ("next", ctypes.c_void_p))


class CPlays(ctypes.Structure):
    _fields_ = (("since", ctypes.c_uint64), ("slice", ctypes.c_void_p), ("carried_out", ctypes.c_uint32))


class CTold(ctypes.Structure):
    _fields_ = (
        ("before", CPlays),
        ("after", CPlays),
        *((name, ctypes.c_uint32) for name in ("at", "missed", "damaged", "events", "overruns", "faults")),
        ("drift", ctypes.c_int32),
        ("temperature", ctypes.c_uint32),
        ("settled", ctypes.c_uint32),
    )


@cache
def _built(folder: Path) -> Path:
    library = folder / "processor.so"
    gcc = shutil.which("gcc")
    assert gcc is not None
    sources = [str(FOLDER / name) for name in SOURCES] + [str(Path(__file__).with_name("hardware.c"))]
    options = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared", "-fsanitize=undefined"]
    options += ["-fno-sanitize-recover=undefined", "-static-libubsan"]
    subprocess.run([gcc, *options, *sources, "-o", str(library)], check=True, timeout=120)
    return library


def load(folder: Path) -> ctypes.CDLL:
    """A fresh copy of the library, whose variables begin anew; skips the test without gcc."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    folder.mkdir(parents=True, exist_ok=True)
    built = _built(folder.parent)
    fresh = folder / "fresh.so"
    fresh.write_bytes(built.read_bytes())
    return ctypes.CDLL(str(fresh))


def word(library: ctypes.CDLL, name: str) -> ctypes.c_uint32:
    return ctypes.c_uint32.in_dll(library, name)
