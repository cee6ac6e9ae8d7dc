"""One guest for all tests, and a fresh server for each."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from phasewire.hil.guest import SERVER, Done, Guest, fetch_kernel, missing_programs

COMPLAINT = re.compile(
    r"error|fail|warn|not resp|timed? ?out|unable|did not claim|reset|cannot|BUG|Oops", re.IGNORECASE
)
"""What the kernel says when something is wrong."""
PATIENCE = 60.0
DETACHED = r"hs\s+\d{4} 00[^4]"


@pytest.fixture(scope="session")
def guest() -> Iterator[Guest]:
    """A running guest."""
    if missing := missing_programs():
        pytest.skip(f"not installed: {', '.join(missing)}")
    try:
        kernel = fetch_kernel()
    except OSError as error:
        pytest.skip(f"no kernel can be had: {error}")
    with Guest(kernel) as machine:
        yield machine


class Bench:
    """The guest and one emulated device that it can attach.

    Parameters
    ----------
    guest : Guest
        The guest.
    folder : Path
        For files of the server.
    """

    def __init__(self, guest: Guest, folder: Path) -> None:
        self._guest, self._folder = guest, folder
        self._attaching: int | None = None

    def serve(self, *options: str) -> None:
        """Begin a fresh server, to which the guest's connections lead."""
        where = self._folder / "where.json"
        command = [
            sys.executable,
            "-m",
            "phasewire",
            "emulate",
            "--usbip",
            "--port",
            "0",
            "--json",
            str(where),
            *options,
        ]
        self._server = subprocess.Popen(command, cwd=self._folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        end = time.monotonic() + PATIENCE
        while not where.exists():
            assert self._server.poll() is None, self._server.communicate()
            assert time.monotonic() < end
            time.sleep(0.05)
        self._guest.serve(json.loads(where.read_text())["usbip"]["port"])
        self._guest.run("dmesg", "--clear")

    def run(self, *command: str, seconds: float = PATIENCE) -> Done:
        """Run a command in the guest."""
        return self._guest.run(*command, seconds=seconds)

    def check(self, *command: str, seconds: float = PATIENCE) -> str:
        """Run a command in the guest that must succeed; what it writes."""
        done = self.run(*command, seconds=seconds)
        assert done.code == 0, f"{' '.join(command)}: {done}"
        return done.out

    def python(self, program: str, seconds: float = PATIENCE) -> str:
        """Run a program in the guest by the project's Python; what it writes."""
        return self.check(sys.executable, "-c", program, seconds=seconds)

    def attach(self, *options: str) -> None:
        """Attach the device, and wait until its drivers are there."""
        command = ("phasewire", "attach", ":".join(map(str, SERVER)), *options)
        if options:
            self._attaching = self._guest.start(*command, seconds=600)
        else:
            self.check(*command)
        self.check("sh", "-c", "for i in $(seq 200); do [ -e /dev/ttyACM0 ] && break; sleep 0.05; done; udevadm settle")

    def complaints(self) -> list[str]:
        """What the kernel complained of since the server began."""
        return [line for line in self.check("dmesg", "--notime").splitlines() if COMPLAINT.search(line)]

    def close(self) -> None:
        """End the server; the guest sees the device leave."""
        if self._attaching is not None:
            self._guest.interrupt(self._attaching)
            self._guest.wait(self._attaching)
        self._server.send_signal(signal.SIGTERM)
        try:
            self._server.communicate(timeout=PATIENCE)
        finally:
            self._server.kill()
        status = "/sys/devices/platform/vhci_hcd.0/status"
        self._guest.run("sh", "-c", f"for i in $(seq 100); do grep -qE '{DETACHED}' {status} || break; sleep 0.1; done")


@pytest.fixture
def bench(guest: Guest, tmp_path: Path) -> Iterator[Bench]:
    """A fresh device, not yet attached, with wall-clock time."""
    bench = Bench(guest, tmp_path)
    bench.serve("--flash", str(tmp_path / "flash"))
    yield bench
    bench.close()
