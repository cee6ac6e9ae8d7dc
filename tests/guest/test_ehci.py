"""The board on an EHCI host controller, by usbredir: Linux's driver for it splits, cancels, resets and suspends."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from phasewire.hil.conformance.guest import Guest

from tests.host.upgrades import FILE

from .conftest import PATIENCE, PRESENT, Bench
from .test_leaving import OPENED, SAYS, STREAM, SUSPEND, is_told

pytestmark = pytest.mark.guest

ON = ("--device", "usb:")
PLAYS = """
import serial
with serial.Serial("/dev/ttyACM0", timeout=30) as port:
    for command in (b"watchdog 60000", b"enable", b"test 17"):
        port.write(command + b"\\r")
        assert port.read_until(b"ok\\r\\n").endswith(b"ok\\r\\n")
"""
RESET = """
import usb.core
device = usb.core.find(idVendor=0x1209)
device.reset()
assert device.get_active_configuration().bConfigurationValue == 1
"""
CANCELLED = """
import array, usb.core, usb.util
device = usb.core.find(idVendor=0x1209)
usb.util.claim_interface(device, 0)
for _ in range(5):
    try: print("read", len(device.read(0x81, 512, 100)))
    except usb.core.USBTimeoutError: print("timeout")
"""
"""Reads what does not come: EHCI takes a transfer that the device answers with NAK off its schedule."""


@pytest.fixture
def plugged(bench: Bench, tmp_path: Path) -> Iterator[Bench]:
    """A fresh device, plugged into the host controller of the guest."""
    bench.check("modprobe", "ehci-pci")
    bench.serve("--usbredir", "--flash", str(tmp_path / "flash"))
    (device,) = bench.offer["devices"]
    bench.guest.plug(device["usbredir_port"])
    try:
        bench.python(PRESENT.format(count=1))
        assert bench.complaints() == []
        yield bench
    finally:
        bench.guest.unplug()


@pytest.mark.guest_slow
def test_ehci_finds_the_board_and_the_board_plays(plugged: Bench, guest: Guest) -> None:
    said = plugged.check("dmesg", "--notime")
    assert re.search(r"new high-speed USB device number \d+ using ehci-pci", said)
    assert "EMU-0001" in plugged.check("phasewire", "info", *ON)
    plugged.check("phasewire", "watchdog", "5", *ON)
    frame = io.BytesIO()
    np.savez(frame, phase=np.zeros((40, 320), np.uint8), width=np.full((40, 320), 10, np.uint8))
    frames = guest.share("frames.npz", frame.getvalue())
    told = json.loads(plugged.check("phasewire", "stream", frames, "--rate", "200", *ON, "--json", "-"))["stream"]
    assert (told["accepted"], told["refused"], told["damaged"]) == (40, 0, 0)
    told = json.loads(plugged.check("phasewire", "doctor", *ON, "--json", "-"))
    assert [each for each in told["findings"] if each["verdict"] == "fail"] == []
    assert plugged.python(CANCELLED).split() == ["timeout"] * 5
    assert plugged.complaints() == []


def test_a_reset_of_its_port_turns_the_outputs_off_and_configures_it_anew(plugged: Bench) -> None:
    """USB-003, by a host controller that tells the device of the reset; vhci keeps it to itself."""
    plugged.python(PLAYS)
    plugged.python(SAYS.format(what="state: PLAYING"))
    plugged.python(RESET)
    assert re.search(r"reset high-speed USB device number \d+ using ehci-pci", plugged.check("dmesg", "--notime"))
    plugged.python(SAYS.format(what="state: OFF"), seconds=2 * PATIENCE)
    assert "EMU-0001" in plugged.check("phasewire", "info", *ON)


@pytest.mark.guest_slow
def test_the_kernel_suspends_and_resumes_its_port(plugged: Bench) -> None:
    """Linux suspends the port of a real host controller; usbredir has no message that would tell the device."""
    for _ in range(3):
        plugged.python(SUSPEND)
        assert "EMU-0001" in plugged.check("phasewire", "info", *ON)


@pytest.mark.guest_slow
def test_it_comes_back_by_itself_with_new_firmware(plugged: Bench, guest: Guest) -> None:
    image = guest.share("new.dfu", FILE)
    assert "2.3.4" in plugged.check("phasewire", "flash", image, *ON, seconds=240)
    assert re.search(r"firmware +│ +2\.3\.4", plugged.check("phasewire", "info", *ON))
    plugged.check("phasewire", "reset", *ON)
    assert "EMU-0001" in plugged.check("phasewire", "info", *ON)


@pytest.mark.guest_slow
def test_a_stream_ends_when_it_is_pulled(plugged: Bench) -> None:
    program = plugged.guest.start("phasewire", *STREAM, *ON)
    plugged.python(OPENED)
    plugged.guest.unplug()
    done = plugged.guest.wait(program)
    assert is_told(done), done
    plugged.guest.plug(plugged.offer["devices"][0]["usbredir_port"])
    plugged.python(PRESENT.format(count=1))
    assert "EMU-0001" in plugged.check("phasewire", "info", *ON)
