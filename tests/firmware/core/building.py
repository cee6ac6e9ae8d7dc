"""The reference device in C: built if there is a compiler, and run as a program."""

from __future__ import annotations

import fcntl
import json
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

REFERENCE = Path(__file__).parents[3] / "firmware"
BUILD_SECONDS = 600
END_SECONDS = 60


def build(target: str) -> None:
    """Build a target of its Makefile; skip the test if there is no compiler, or no zlib for the program."""
    if not shutil.which("make") or not shutil.which("gcc"):
        pytest.skip("no C compiler")
    includes = ["gcc", "-E", "-include", "zlib.h", "-"]
    if target == "posix" and subprocess.run(includes, input=b"", capture_output=True, check=False).returncode:
        pytest.skip("no headers of zlib")
    with (REFERENCE / "Makefile").open() as makefile:
        fcntl.flock(makefile, fcntl.LOCK_EX)  # the workers of a run build it once
        subprocess.run(["make", "-s", "-C", REFERENCE, target], check=True, timeout=BUILD_SECONDS)


@contextmanager
def running(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """The program, and what it says of its doors."""
    build("posix")
    program = REFERENCE / "build" / "phasewire-reference"
    with subprocess.Popen([program, *arguments], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process, json.loads(process.stdout.readline())
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(END_SECONDS)


@contextmanager
def served(door: str) -> Iterator[str]:
    """The URL of the program, by ``usbip`` or ``socket``."""
    options = ["--usbip", "0"] if door == "usbip" else ["--serial", "tcp:0"]
    with running(*options) as (_, doors):
        yield f"usbip:127.0.0.1:{doors['usbip']}" if door == "usbip" else doors["serial"][0]
