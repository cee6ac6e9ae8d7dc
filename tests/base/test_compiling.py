from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread
from types import ModuleType
from typing import Any

import numba
import pytest
from numba import config
from phasewire.base import compiling
from phasewire.base.compiling import _fingerprint, _notice, kernel


def test_a_function_without_a_file_is_compiled_uncached() -> None:
    """numba cannot cache a function without a file."""
    there: dict[str, Any] = {}
    exec(compile("def thrice(x):\n    return 3 * x\n", "<nowhere>", "exec"), there)
    assert kernel(there["thrice"])(14) == 42


PIECES = """
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from phasewire.base.compiling import part

FACTOR = 2


class Reason(IntEnum):
    GOOD = 3


class Pair(NamedTuple):
    x: float
    y: float


@part
def add(x):
    pair = Pair(x, np.floor(x))
    return pair.x + 1
"""


@pytest.mark.parametrize(
    "change",
    [
        ("FACTOR = 2", "FACTOR = 5"),
        ("GOOD = 3", "GOOD = 4"),
        ("+ 1", "+ 4"),
        ("np.floor", "np.ceil"),
        ("x: float\n    y: float", "y: float\n    x: float"),
    ],
    ids=["constant", "enum", "code", "name", "fields"],
)
@pytest.mark.parametrize(
    "expression", ["FACTOR * add(x) + Reason.GOOD", "parts.FACTOR * parts.add(x) + parts.Reason.GOOD"]
)
def test_the_fingerprint_covers_all_parts_of_a_kernel(change: tuple[str, str], expression: str) -> None:
    """Every part from another file changes the fingerprint; without a change it stays."""

    def fingerprint(source: str) -> str:
        there: dict[str, Any] = {"__name__": "pieces"}
        exec(source, there)
        module = ModuleType("pieces.parts")
        vars(module).update(there)
        exec(f"def whole(x):\n    return {expression}\n", there | {"parts": module}, places := dict[str, Any]())
        return _fingerprint(places["whole"])

    assert PIECES.count(change[0]) == 1
    assert fingerprint(PIECES) == fingerprint(PIECES)
    assert fingerprint(PIECES.replace(*change)) != fingerprint(PIECES)


@pytest.mark.slow
def test_a_kernel_is_compiled_anew_if_a_part_or_a_constant_of_another_file_has_changed(tmp_path: Path) -> None:
    """The kernel's own file stays as it is; the third run loads the second one's result."""
    (tmp_path / "whole.py").write_text(
        "from pieces import FACTOR, add\nfrom phasewire.base.compiling import kernel\n\n\n"
        "@kernel\ndef whole(x):\n    return FACTOR * add(x)\n\n\n"
        "print(whole(1), sum(whole.stats.cache_hits.values()))\n"
    )
    said = []
    for factor, added in ((2, 1), (2, 3), (2, 3), (5, 3)):
        (tmp_path / "pieces.py").write_text(
            "from phasewire.base.compiling import part\n\n"
            f"FACTOR = {factor}\n\n\n@part\ndef add(x):\n    return x + {added}\n"
        )
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "whole.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        said.append(done.stdout.split())
    assert said == [["4", "0"], ["8", "0"], ["8", "1"], ["20", "0"]]


def test_kernels_are_cached_in_the_users_cache_folder_unless_another_is_named(tmp_path: Path) -> None:
    """A copy of a package leaves nothing beside its files, and numba's own default stays as it is."""
    package = tmp_path / "package"
    package.mkdir()
    (package / "one.py").write_text(
        "from phasewire.base.compiling import kernel\n\n\n@kernel\ndef one():\n    return 1\n"
    )
    code = "import one, numba; one.one(); print(one.one.stats.cache_path, repr(numba.config.CACHE_DIR))"
    base = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    base |= {"PYTHONDONTWRITEBYTECODE": "1", "XDG_CACHE_HOME": str(tmp_path / "user"), "HOME": str(tmp_path)}
    base |= {"LOCALAPPDATA": str(tmp_path / "user")}
    for more, where, default in (
        ({}, tmp_path, "''"),
        ({"NUMBA_CACHE_DIR": str(tmp_path / "named")}, tmp_path / "named", None),
    ):
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=package, env=base | more, capture_output=True, text=True, check=True
        )
        path, said = done.stdout.split()
        assert Path(path).is_relative_to(where)
        assert ("phasewire" in Path(path).parts) is (not more)
        assert said == (default or repr(str(where)))
    assert [path.name for path in package.iterdir()] == ["one.py"]


@pytest.mark.parametrize(
    ("file", "when"), [("{}.py", "the first time on a machine"), ("<nowhere>", r"in each run, .*\$NUMBA_CACHE_DIR")]
)
def test_the_first_compilation_of_a_kernel_of_the_package_is_logged_once(
    file: str, when: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(_notice, "_said", False)
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    there: dict[str, Any] = {}
    for name in ("outside.zero", "phasewire.one", "phasewire.two"):
        there["__name__"] = name
        Path(f"{name}.py").touch()
        exec(compile("def thrice(x):\n    return 3 * x\n", file.format(name), "exec"), there)
        kernel(there["thrice"])(14)
        assert [record.name for record in caplog.records] == ["phasewire.base.compiling"] * (name != "outside.zero")
    assert re.search(when, caplog.messages[0])


def test_threads_that_load_kernels_at_a_time_share_the_users_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """numba's setting is global: without a lock one thread restores it while another one uses it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(config, "CACHE_DIR", "")
    real, places = numba.njit, list[str]()

    def slowly(**options: Any) -> Any:
        time.sleep(0.002)
        return real(**options)

    def load() -> None:
        compiled: Any = kernel(test_a_function_without_a_file_is_compiled_uncached)
        places.append(compiled._cache._cache_path)

    monkeypatch.setattr(compiling, "njit", slowly)
    threads = [Thread(target=load) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(places) == 8
    assert all(place.startswith(str(tmp_path)) for place in places)
