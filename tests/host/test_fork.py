"""A process that has a device open is copied by os.fork, and the copy ends: the device stays with the first."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack

import pytest

from tests.host.serving import served_url

SCRIPT = """
import os, sys
import phasewire
from phasewire.base.errors import DeviceError

pulses = phasewire.Pulses([10] * 320, [25] * 320)

def copied(url):
    with phasewire.open_device(url) as device:
        device.set_watchdog(60)
        device.show(pulses)
        if not (child := os.fork()):
            try:
                device.show(pulses)
            except DeviceError as error:
                told = f"was opened by process {os.getppid()}" in str(error)
                sys.exit(0 if told else 1)  # within the statement: its end must not turn the outputs off
            sys.exit(2)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        device.show(pulses)
        print(url.partition(":")[0], status, device.status().state.name, flush=True)

with phasewire.Emulator() as emulator:
    for url in ("emulator:", emulator.url + "?door=serial", *sys.argv[1:]):
        copied(url)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_copy_of_a_process_leaves_every_line_to_the_first() -> None:
    with ExitStack() as stack:
        schemes = ("usbip", "serial", "socket", "rfc2217")
        urls = [stack.enter_context(served_url(scheme))[0] for scheme in schemes]
        command = [sys.executable, "-W", "ignore", "-c", SCRIPT, *urls]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    expected = [f"{scheme} 0 PLAYING" for scheme in ("emulator", "emulator", *schemes)]
    assert (done.stdout.splitlines(), done.stderr, done.returncode) == (expected, "", 0)
