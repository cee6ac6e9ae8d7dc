"""Linux enumerates the device; its drivers and tools find no fault."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.emulator.test_umockdev import COMPLAINT
from tests.specification import hex_examples, table

from .conftest import Bench
from .lsusb import descriptors

pytestmark = pytest.mark.guest

EXAMPLES = hex_examples()
PRODUCT, SERIAL = "phasewire five-board array (emulated)", "EMU-0001"
RULE = "60-phasewire.rules"
GUIDE = (Path(__file__).parents[2] / "docs/how-to/usb_device.md").read_text(encoding="utf-8")


def specified(speed: str) -> bytes:
    """Device and configuration descriptor of firmware 0.1.0 by chapter USB of the specification."""
    device, configuration = EXAMPLES["USB_DEVICE"], EXAMPLES["USB_CONFIGURATION"]
    if speed == "full":  # clause USB-010
        configuration = configuration.replace(bytes.fromhex("02 00 02 01"), bytes.fromhex("02 40 00 01"))
        configuration = configuration.replace(bytes.fromhex("82 03 10 00 09"), bytes.fromhex("82 03 10 00 20"))
    return device[:12] + bytes.fromhex("10 00") + device[14:] + configuration


@pytest.mark.parametrize("speed", ["high", "full"])
def test_linux_reads_the_descriptors_of_the_specification_and_has_no_complaint(bench: Bench, speed: str) -> None:
    bench.serve("--speed", speed)
    bench.attach()
    assert bench.complaints() == []
    said = bench.check("dmesg", "--notime")
    for line in (f"new {speed}-speed USB device", f"Product: {PRODUCT}", f"SerialNumber: {SERIAL}", "ttyACM0: USB ACM"):
        assert line in said
    done = bench.run("lsusb", "-v", "-d", "1209:0001")
    assert (done.code, done.err) == (0, "")
    assert not COMPLAINT.search(done.out)
    assert descriptors(done.out) == {
        "Device Descriptor": specified(speed),
        "Binary Object Store Descriptor": EXAMPLES["USB_BOS"],
    }
    strings = {row[0]: row[1].partition(" (")[0] for row in table("strings")} | {"2": PRODUCT, "3": SERIAL}
    assert set(re.findall(r" i[A-Z]\w+ +([1-9]\d*) (.*)", done.out)) == set(strings.items())


def test_the_tools_of_the_project_find_it(bench: Bench) -> None:
    bench.attach()
    found = json.loads(bench.check("phasewire", "devices", "--json", "-"))["devices"]
    assert {(each["url"], each["serial"], each["firmware"]) for each in found} == {
        ("usb:EMU-0001", "EMU-0001", "0.1.0"),
        ("serial:///dev/ttyACM0", "EMU-0001", ""),
    }
    assert re.search(r"20 × 16 transducers", bench.check("phasewire", "info", "--device", "usb:EMU-0001"))


def test_the_udev_rule_gives_it_to_the_group_only(bench: Bench) -> None:
    """Installed as docs/how-to/first-connection.md says, by programs that need no driver: dfu-util opens the device."""

    def seen_by(group: str) -> str:
        user = ("setpriv", "--reuid=nobody", f"--regid={group}", "--clear-groups")
        done = bench.run(*user, "dfu-util", "--list")
        return done.out + done.err

    rule = bench.check("phasewire", "doctor", "--udev-rule")
    bench.check("sh", "-c", f"rm /run/udev/rules.d/{RULE} && udevadm control --reload")
    try:
        bench.attach()
        assert "LIBUSB_ERROR_ACCESS" in seen_by("plugdev")
        bench.check("sh", "-c", f'printf %s "$0" > /etc/udev/rules.d/{RULE} && udevadm control --reload', rule)
        bench.serve()
        bench.attach()
        assert "Found Runtime: [1209:0001]" in seen_by("plugdev")
        assert "LIBUSB_ERROR_ACCESS" in seen_by("nogroup")
        (console,) = re.findall(r"/dev/serial/by-id/\S*[^\s`]", GUIDE)[:1]
        assert bench.check("readlink", "--canonicalize", console) == "/dev/ttyACM0\n"
        assert bench.check("stat", "--dereference", "--format=%a %G", console) == "660 dialout\n"
        properties = bench.check("udevadm", "info", "--query=property", "--name=/dev/ttyACM0")
        assert "ID_MM_DEVICE_IGNORE=1" in properties
    finally:
        bench.check("sh", "-c", f"cp host/finding/{RULE} /run/udev/rules.d/; rm -f /etc/udev/rules.d/{RULE}")
        bench.check("udevadm", "control", "--reload")
