"""A Linux kernel and its tools use the reference device in C, which knows nothing of this project's Python."""

from __future__ import annotations

from pathlib import Path

import pytest
from phasewire.hil.conformance.guest import Guest

from tests.emulator.test_umockdev import COMPLAINT
from tests.firmware.core.building import build
from tests.host.upgrades import FILE
from tests.specification import hex_examples

from .conftest import Bench, pulses
from .lsusb import descriptors
from .test_console import ASK
from .test_flashing import SLOW, firmware
from .test_usbtest import BOARD, judge, usbtest

__all__ = ["usbtest"]
"""A fixture."""

pytestmark = pytest.mark.guest

SERVER = str(Path(__file__).with_name("reference_server.py"))


@pytest.fixture
def reference(bench: Bench, tmp_path: Path) -> Bench:
    """A guest whose device is the reference, attached; a device that leaves comes back."""
    build("posix")
    flash = tmp_path / "reference.flash"
    bench.serve("--flash", str(flash), program=[SERVER])
    bench.attach("--loop")
    return bench


def test_linux_has_no_complaint_of_the_reference_device(reference: Bench, guest: Guest) -> None:
    """It reads the descriptors of the specification, its driver has the console, and a frame is shown."""
    assert reference.complaints() == []
    listed = reference.run("lsusb", "-v", "-d", "1209:0001")
    assert (listed.code, listed.err) == (0, "")
    assert not COMPLAINT.search(listed.out)
    found = descriptors(listed.out)
    assert found["Binary Object Store Descriptor"] == hex_examples()["USB_BOS"]
    assert found["Device Descriptor"][18:] == hex_examples()["USB_CONFIGURATION"]
    assert "state: OFF" in reference.python(ASK)
    frame = pulses(guest, "frame.npz", [3])
    reference.check("phasewire", "show", frame, "--device", "usb:", "--seconds", "0.2")
    assert reference.complaints() == []


def test_the_reference_device_gets_new_firmware(reference: Bench, guest: Guest) -> None:
    """By `phasewire flash` through the kernel: it leaves the bus, comes back in DFU mode, and boots the new image."""
    assert firmware(reference) == "0100"
    image = guest.share("new.dfu", FILE)
    assert "2.3.4" in reference.check("phasewire", "flash", image, "--device", "usb:", seconds=SLOW)
    assert firmware(reference) == "0234"
    reference.check("phasewire", "flash", "--revert", "--device", "usb:", seconds=SLOW)
    assert firmware(reference) == "0100"


def test_the_reference_device_passes_the_kernels_own_tests(usbtest: Bench) -> None:
    """Usbtest carries out the cases that it carries out on the emulated board."""
    build("posix")
    usbtest.serve(program=[SERVER])
    usbtest.check("modprobe", "usbtest", "vendor=0x1209", "product=0x0001", "alt=0", "realworld=0")
    judge(usbtest, "1209:0001", BOARD)
