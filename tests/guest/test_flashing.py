"""New firmware through the kernel: the device leaves the bus and comes back, and a loop attaches it again."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from zlib import crc32

import pytest
from phasewire.hil.conformance.guest import Guest

from tests.host.upgrades import FILE, STORED

from .conftest import Bench

pytestmark = pytest.mark.guest

GUIDE = (
    (Path(__file__).parents[2] / "docs/how-to/flashing.md").read_text(encoding="utf-8").partition("## By dfu-util")[2]
)
DOWNLOAD, UPLOAD, BACK = (
    shlex.split(line, comments=True) for line in re.findall(r"^dfu-util --.*", GUIDE, re.MULTILINE)
)
DOCUMENTED = {says: int(code) for says, code in re.findall(r"^\|.*\| `([^`]+)`.*\| (\d+) \|$", GUIDE, re.MULTILINE)}
"""What dfu-util says, and its exit code then."""
SLOW = 240.0  # seconds that a command may take on a busy computer
RESET = re.compile(r"usb \S+: reset (?:high|full)-speed USB device number \d+ using vhci_hcd")
"""What the kernel says when a program asks for a reset, as DFU does after a download."""
MODES = {"run time": "Found Runtime: [1209:0001]", "DFU mode": "Found DFU: [1209:0002]"}


def damaged(data: bytes) -> bytes:
    return data[:1000] + bytes((data[1000] ^ 1,)) + data[1001:]


def sealed(body: bytes) -> bytes:
    """A file whose suffix has the right checksum (DFU 1.1, appendix B)."""
    return body + (crc32(body) ^ 0xFFFFFFFF).to_bytes(4, "little")


def wait_for(bench: Bench, mode: str) -> None:
    bench.check("sh", "-c", f"until dfu-util --list | grep -qF '{MODES[mode]}'; do sleep 0.2; done", seconds=SLOW)


def firmware(bench: Bench) -> str:
    """The version in the device descriptor, as the kernel has read it."""
    return bench.check("sh", "-c", "cat $(dirname $(grep -l 1209 /sys/bus/usb/devices/*/idVendor))/bcdDevice").strip()


@pytest.fixture
def image(guest: Guest) -> str:
    return guest.share("new.dfu", FILE)


@pytest.mark.guest_slow
def test_dfu_util_ends_as_the_guide_says_for_files_good_and_bad(bench: Bench, guest: Guest, image: str) -> None:
    files = {
        "new.dfu": image,
        "refused.dfu": guest.share("refused.dfu", sealed(damaged(FILE)[:-4])),
        "damaged.dfu": guest.share("damaged.dfu", damaged(FILE)),
        "read-back.bin": "/tmp/read-back.bin",
    }
    met: dict[str, int] = {}

    def ends(says: str, command: list[str], **changed: str) -> None:
        """Run a command of the guide with these options changed; it must print this."""
        words = list(command)
        for option, value in changed.items():
            words[words.index(f"--{option}") + 1] = value
        done = bench.run(*(files.get(word, word) for word in words), seconds=SLOW)
        assert says in done.out + done.err
        met[says] = done.code

    bench.attach("--loop")
    wait_for(bench, "run time")
    ends("state(10) = dfuERROR", DOWNLOAD, download="refused.dfu")
    wait_for(bench, "DFU mode")
    ends("DFU suffix CRC does not match", DOWNLOAD, download="damaged.dfu")
    ends("File ID 1209:0001 does not match device", DOWNLOAD, device=",1209:0002")
    ends("can't detach", BACK)
    wait_for(bench, "run time")
    assert firmware(bench) == "0010", "what was refused does not run"
    ends("state(2) = dfuIDLE", DOWNLOAD)
    bench.check(*(files.get(word, word) for word in UPLOAD), seconds=SLOW)
    assert bytes.fromhex(bench.check("od", "-An", "-v", "-tx1", files["read-back.bin"])) == STORED
    ends("can't detach", [*DOWNLOAD, "--reset"])
    wait_for(bench, "run time")
    assert firmware(bench) == "0234"
    assert met == DOCUMENTED


def test_the_device_gets_new_firmware_and_returns_to_its_own(bench: Bench, guest: Guest, image: str) -> None:
    bench.attach("--loop")
    broken = bench.run("phasewire", "flash", guest.share("damaged.dfu", damaged(FILE)), "--device", "usb:")
    assert (broken.code, firmware(bench)) == (2, "0010")
    assert "2.3.4" in bench.check("phasewire", "flash", image, "--device", "usb:", seconds=SLOW)
    assert firmware(bench) == "0234"
    assert re.search(r"firmware +│ +2\.3\.4", bench.check("phasewire", "info", "--device", "usb:"))
    bench.check("phasewire", "flash", "--revert", "--device", "usb:", seconds=SLOW)
    wait_for(bench, "run time")
    assert firmware(bench) == "0010"
    assert [line for line in bench.complaints() if not RESET.fullmatch(line)] == []
