"""The reference device in C, built where there is a compiler, as a device in this process."""

from __future__ import annotations

import fcntl
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from phasewire.protocol.wiring import Wiring

REFERENCE = Path(__file__).parents[2] / "reference"
BUILD_SECONDS = 600


@pytest.fixture(scope="session")
def machine() -> Callable[..., Any]:
    """Make a device of the library, with a wiring; skip if there is no compiler."""
    if not shutil.which("make") or not shutil.which("gcc"):
        pytest.skip("no C compiler")
    with (REFERENCE / "Makefile").open() as makefile:
        fcntl.flock(makefile, fcntl.LOCK_EX)  # the workers of a run build it once
        subprocess.run(["make", "-s", "-C", REFERENCE, "library"], check=True, timeout=BUILD_SECONDS)
    sys.path.insert(0, str(REFERENCE / "python"))
    try:
        machine_class = import_module("phasewire_reference").Machine
    finally:
        sys.path.pop(0)

    def make(wiring: Wiring) -> Any:
        return machine_class(wiring)

    return make
