"""The board at high speed and at full speed, as the kernel sees it (clause USB-010)."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from phasewire.emulator.doors.address import SPEEDS
from phasewire.hil.conformance.guest import Guest
from phasewire.protocol.codes import DescriptorType
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed, run_time

from tests.emulator.test_umockdev import COMPLAINT
from tests.host.upgrades import FILE

from .conftest import Bench

pytestmark = pytest.mark.guest

PRODUCT, SERIAL = "phasewire five-board array (emulated)", "EMU-0001"
BULK_ENDPOINTS = 4

READ_DESCRIPTORS = """
import libusb_package
device = libusb_package.find(idVendor=0x1209)
for kind in {kinds}: print(bytes(device.ctrl_transfer(0x80, 6, kind << 8, 0, 255)).hex())
"""


@pytest.fixture(params=[pytest.param("high", marks=pytest.mark.guest_slow), "full"])
def at_speed(request: pytest.FixtureRequest, guest: Guest, tmp_path: Path) -> Iterator[tuple[Bench, Speed]]:
    """A fresh device at one speed, attached."""
    bench = Bench(guest, tmp_path)
    bench.serve("--speed", request.param)
    bench.attach()
    yield bench, SPEEDS[request.param]
    bench.stop()


def test_the_kernel_runs_it_at_its_speed_and_knows_of_the_other(at_speed: tuple[Bench, Speed]) -> None:
    bench, speed = at_speed
    assert bench.complaints() == []
    said = bench.check("dmesg", "--notime")
    assert f"new {'high' if speed == HIGH_SPEED else 'full'}-speed USB device" in said
    assert ("not running at top speed" in said) == (speed == FULL_SPEED)
    wanted = run_time((0, 1, 0), PRODUCT, SERIAL, speed)
    kinds = [
        DescriptorType.DEVICE,
        DescriptorType.CONFIGURATION,
        DescriptorType.DEVICE_QUALIFIER,
        DescriptorType.OTHER_SPEED_CONFIGURATION,
        DescriptorType.BOS,
    ]
    read = bench.python(READ_DESCRIPTORS.format(kinds=[int(kind) for kind in kinds])).split()
    assert [bytes.fromhex(each) for each in read] == [wanted.find(kind, 0, language=0) for kind in kinds]
    done = bench.run("lsusb", "-v", "-d", "1209:0001")
    assert (done.code, done.err) == (0, "")
    assert not COMPLAINT.search(done.out)
    assert done.out.count(f"wMaxPacketSize     0x{speed.bulk_bytes:04x}") == BULK_ENDPOINTS


@pytest.mark.guest_slow
def test_it_plays_and_gets_new_firmware_at_full_speed(guest: Guest, tmp_path: Path) -> None:
    bench = Bench(guest, tmp_path)
    bench.serve("--speed", "full", "--flash", str(tmp_path / "flash"))
    bench.attach("--loop")
    frame = io.BytesIO()
    np.savez(frame, phase=np.zeros(320, np.uint8), width=np.full(320, 10, np.uint8))
    bench.check("phasewire", "show", guest.share("frame.npz", frame.getvalue()), "--device", "usb:")
    assert "2.3.4" in bench.check("phasewire", "flash", guest.share("new.dfu", FILE), "--device", "usb:", seconds=240)
    assert re.search(r"firmware +│ +2\.3\.4", bench.check("phasewire", "info", "--device", "usb:"))
    assert "new full-speed USB device" in bench.check("dmesg", "--notime")
    bench.stop()
