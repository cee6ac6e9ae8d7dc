"""One guest for all tests, and a fresh server for each."""

from __future__ import annotations

import io
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from phasewire.hil.conformance.guest import BOUND, NEWEST, SERVER, Done, Guest, fetch_kernel, missing_programs

COMPLAINT = re.compile(
    r"error|fail|warn|not resp|timed? ?out|unable|did not claim|reset|cannot|BUG|Oops", re.IGNORECASE
)
"""What the kernel says when something is wrong."""
PATIENCE = 180.0
"""Seconds that a step may take; on a quiet computer most take one."""
EMULATE = ("-m", "phasewire", "emulate", "--usbip", "--port", "0", "--json")
FAR = ":".join(map(str, SERVER))
"""The server, as ``phasewire attach`` in the guest is told of it."""

PRESENT = """
import pathlib, subprocess, time
for _ in range(600):
    if len(list(pathlib.Path("/dev").glob("ttyACM*"))) == {count}: break
    time.sleep(0.05)
else: raise SystemExit("there are not {count} consoles")
subprocess.run(["udevadm", "settle"], check=True)
"""
"""Waits for the drivers of the devices."""
GONE = """
import pathlib, time
for _ in range(600):
    status = pathlib.Path("/sys/devices/platform/vhci_hcd.0/status").read_text().splitlines()[1:]
    if all(line.split()[2] == "004" for line in status) and not list(pathlib.Path("/dev").glob("ttyACM*")): break
    time.sleep(0.05)
else: raise SystemExit("devices whose server has gone stay attached: " + "; ".join(status))
"""
"""Waits until the host controller has nothing attached any more."""


KERNELS = (
    pytest.param(None, id="this-debian"),
    pytest.param(NEWEST, id=NEWEST, marks=pytest.mark.guest_newest),
)


@pytest.fixture(scope="session", params=KERNELS)
def guest(request: pytest.FixtureRequest) -> Iterator[Guest]:
    """A running guest, one for each kernel."""
    if missing := missing_programs():
        pytest.skip(f"not installed: {', '.join(missing)}")
    try:
        kernel = fetch_kernel(request.param)
    except OSError as error:
        pytest.skip(f"no kernel can be had: {error}")
    with Guest(kernel) as machine:
        yield machine


def pulses(guest: Guest, name: str, widths: Sequence[int]) -> str:
    """A file of frames in which all transducers play pulses of a width; of one frame as `show` takes it."""
    width = np.repeat(np.asarray(widths, np.uint8)[:, None], 320, axis=1)
    width = width[0] if len(widths) == 1 else width
    file = io.BytesIO()
    np.savez(file, width=width, phase=width % 2)
    return guest.share(name, file.getvalue())


class Bench:
    """The guest, and a server with one emulated device, or several, that it can attach.

    Parameters
    ----------
    guest : Guest
        The guest.
    folder : Path
        The folder for files of the server.

    Attributes
    ----------
    offer : dict
        What the server wrote of its doors.
    """

    def __init__(self, guest: Guest, folder: Path) -> None:
        self.guest, self._folder = guest, folder
        self._loops: list[int] = []
        self._server: subprocess.Popen[bytes] | None = None
        self.offer: dict[str, Any] = {}

    def serve(self, *options: str, program: Sequence[str] = EMULATE) -> None:
        """Begin a fresh server instead of the one before, to which the guest's connections lead.

        Parameters
        ----------
        *options : str
            The options of the program.
        program : sequence of str
            What Python runs. Into the file that is named next it writes its TCP port, as ``emulate --json`` does.
        """
        self.stop()
        where, said = self._folder / "where.json", self._folder / "said"
        where.unlink(missing_ok=True)
        command = [*BOUND, sys.executable, *program, str(where)]
        with said.open("ab") as log:
            self._server = subprocess.Popen([*command, *options], cwd=self._folder, stdout=log, stderr=log)
        end = time.monotonic() + PATIENCE
        while not (where.exists() and where.stat().st_size):  # a file is there before its text
            assert self._server.poll() is None, said.read_text()
            assert time.monotonic() < end
            time.sleep(0.02)
        self.offer = json.loads(where.read_text())
        self.guest.serve(self.offer["usbip"]["port"])
        self.guest.run("dmesg", "--clear")

    def stop(self, how: signal.Signals = signal.SIGTERM) -> None:
        """End the server, and all that runs in the guest; the guest sees the devices leave."""
        self.detach()
        self.guest.end_all()
        self.end_server(how)
        self.python(GONE)

    def end_server(self, how: signal.Signals) -> None:
        """End the server, and wait for nothing in the guest."""
        if self._server is not None:
            self._server.send_signal(how)
            try:
                self._server.wait(PATIENCE)
            finally:
                self._server.kill()
            self._server = None

    def run(self, *command: str, seconds: float = PATIENCE) -> Done:
        """Run a command in the guest."""
        return self.guest.run(*command, seconds=seconds)

    def check(self, *command: str, seconds: float = PATIENCE) -> str:
        """Run a command in the guest that must succeed; what it writes."""
        done = self.run(*command, seconds=seconds)
        assert done.code == 0, f"{' '.join(command)}: {done}"
        return done.out

    def python(self, program: str, seconds: float = PATIENCE) -> str:
        """Run a program in the guest by the project's Python; what it writes."""
        return self.check("python", program, seconds=seconds)

    def attach(self, *options: str, count: int = 1) -> None:
        """Attach the first devices of the server, and wait until their drivers are there.

        Parameters
        ----------
        *options : str
            The options of ``phasewire attach``; with ``--loop`` a device that leaves comes back until `detach`.
        count : int
            How many devices.
        """
        for number in range(1, count + 1):
            command = ("phasewire", "attach", FAR, f"1-{number}", *options)
            if "--loop" in options:
                self._loops.append(self.guest.start(*command, seconds=3600))
            else:
                self.check(*command)
        self.python(PRESENT.format(count=count))

    def detach(self) -> None:
        """Attach no device again that leaves."""
        for number in self._loops:
            self.guest.signal(number)
        for number in self._loops:
            self.guest.wait(number)
        self._loops.clear()

    def complaints(self) -> list[str]:
        """What the kernel complained of since the server began."""
        return [line for line in self.check("dmesg", "--notime").splitlines() if COMPLAINT.search(line)]


@pytest.fixture
def bench(guest: Guest, tmp_path: Path) -> Iterator[Bench]:
    """A fresh device, not yet attached, with wall-clock time."""
    bench = Bench(guest, tmp_path)
    bench.serve("--flash", str(tmp_path / "flash"))
    yield bench
    bench.stop()
