"""Linux enumerates the device, and its drivers and tools find nothing wrong with it."""

from __future__ import annotations

import json
import re

import pytest
from phasewire.protocol.enumeration import run_time

from tests.emulator.test_umockdev import COMPLAINT

from .conftest import Bench

pytestmark = pytest.mark.guest


def test_the_kernel_finds_the_device_and_complains_of_nothing(bench: Bench) -> None:
    bench.attach()
    assert bench.complaints() == []
    said = bench.check("dmesg", "--notime")
    for line in (
        "new high-speed USB device",
        "idVendor=1209, idProduct=0001",
        "Product: phasewire five-board array (emulated)",
        "SerialNumber: EMU-0001",
        "ttyACM0: USB ACM device",
    ):
        assert line in said


def test_its_descriptors_are_those_of_the_specification(bench: Bench) -> None:
    bench.attach()
    found = bench.python(
        "import pathlib\n"
        "for path in pathlib.Path('/sys/bus/usb/devices').glob('*/idVendor'):\n"
        "    if path.read_text() == '1209\\n': print((path.parent / 'descriptors').read_bytes().hex())"
    )
    data = bytes.fromhex(found)
    wanted = run_time((0, 1, 0), "phasewire five-board array (emulated)", "EMU-0001")
    assert data == (wanted.find(1, 0, language=0) or b"") + wanted.configuration


def test_lsusb_finds_no_fault(bench: Bench) -> None:
    bench.attach()
    done = bench.run("lsusb", "-v", "-d", "1209:0001")
    assert (done.code, done.err) == (0, "")
    assert not COMPLAINT.search(done.out)
    assert "Self Powered" in done.out


def test_the_tools_of_the_project_find_it(bench: Bench) -> None:
    bench.attach()
    (device,) = [
        each
        for each in json.loads(bench.check("phasewire", "devices", "--json", "-"))["devices"]
        if each["url"].startswith("usb:")
    ]
    assert device["serial"] == "EMU-0001"
    assert re.search(r"20 × 16 transducers", bench.check("phasewire", "info", "--device", "usb:EMU-0001"))


def test_the_udev_rule_gives_it_to_users_and_names_the_console(bench: Bench) -> None:
    bench.attach()
    assert "EMU-0001" in bench.check("ls", "/dev/serial/by-id")
    properties = bench.check("sh", "-c", "udevadm info --query=property --name=/dev/ttyACM0")
    assert "ID_MM_DEVICE_IGNORE=1" in properties
