"""The machine without a guest: what is left of it when the program that started it is gone."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PATIENCE = 20.0
START = """
import sys, tempfile
from pathlib import Path
from phasewire.hil.conformance.guest import Guest, GuestKernel
tempfile.tempdir = sys.argv[1]
Guest._warm_up = lambda self: {}
Guest(GuestKernel(Path("nowhere"), "none")).__enter__()
"""
QEMU = """#!/bin/sh
echo $$ > "$PID_FILE.new" && mv "$PID_FILE.new" "$PID_FILE"
exec sleep 60
"""


def is_alive(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not (shutil.which("setpriv") and shutil.which("prlimit")), reason="util-linux is not installed")
def test_no_qemu_outlives_the_program_that_started_it(tmp_path: Path) -> None:
    qemu, pid_file = tmp_path / "qemu-system-x86_64", tmp_path / "pid"
    qemu.write_text(QEMU)
    qemu.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PID_FILE": str(pid_file)}
    program = subprocess.Popen([sys.executable, "-c", START, str(tmp_path)], env=environment)
    end = time.monotonic() + PATIENCE
    while not pid_file.exists():
        assert program.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)
    pid = int(pid_file.read_text())
    assert is_alive(pid)
    program.send_signal(signal.SIGKILL)
    program.wait()
    while is_alive(pid):
        assert time.monotonic() < end + PATIENCE
        time.sleep(0.02)
