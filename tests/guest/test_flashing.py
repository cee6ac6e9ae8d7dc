"""New firmware, over the kernel: the device leaves the bus and comes back, and is attached again in a loop."""

from __future__ import annotations

import re

import pytest
from phasewire.hil.guest import Guest

from tests.host.upgrades import FILE

from .conftest import Bench

pytestmark = pytest.mark.guest


@pytest.fixture
def image(guest: Guest) -> str:
    return guest.share("new.dfu", FILE)


def test_the_device_is_given_new_firmware(bench: Bench, image: str) -> None:
    bench.attach("--loop")
    assert "2.3.4" in bench.check("phasewire", "flash", image, "--device", "usb:", seconds=240)
    assert re.search(r"firmware +│ +2\.3\.4", bench.check("phasewire", "info", "--device", "usb:"))


def test_dfu_util_detaches_it_and_reads_back_what_it_wrote(bench: Bench, image: str) -> None:
    bench.attach("--loop")
    assert "Found Runtime: [1209:0001]" in bench.check("dfu-util", "-l")
    bench.check("dfu-util", "-d", "1209:0001,1209:0002", "-e")
    bench.check(
        "sh", "-c", "for i in $(seq 200); do dfu-util -l | grep -q 'Found DFU' && exit 0; sleep 0.1; done; exit 1"
    )
    done = bench.run("dfu-util", "-d", ",1209:0002", "-D", image, "-R", seconds=240)
    assert "Download done." in done.out
