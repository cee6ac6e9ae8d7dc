"""New firmware, over the kernel: the device leaves the bus and comes back, and is attached again in a loop."""

from __future__ import annotations

import re

import pytest
from phasewire.hil.guest import Guest

from tests.host.upgrades import FILE, STORED

from .conftest import Bench

pytestmark = pytest.mark.guest


@pytest.fixture
def image(guest: Guest) -> str:
    return guest.share("new.dfu", FILE)


def test_the_device_is_given_new_firmware(bench: Bench, image: str) -> None:
    bench.attach("--loop")
    assert "2.3.4" in bench.check("phasewire", "flash", image, "--device", "usb:", seconds=240)
    assert re.search(r"firmware +│ +2\.3\.4", bench.check("phasewire", "info", "--device", "usb:"))


def test_dfu_util_gives_it_new_firmware_and_reads_it_back(bench: Bench, image: str) -> None:
    bench.attach("--loop")
    assert "Found Runtime: [1209:0001]" in bench.check("dfu-util", "-l")
    both = ("dfu-util", "-d", "1209:0001,1209:0002")
    bench.check(*both, "-e")
    bench.check("sh", "-c", "until dfu-util -l | grep -q 'Found DFU'; do sleep 0.1; done")
    assert "Download done." in bench.check(*both, "-D", image)
    bench.check(*both, "-U", "/tmp/read-back")
    read = bytes.fromhex(bench.check("sh", "-c", "od -An -v -tx1 /tmp/read-back"))
    assert read == STORED
