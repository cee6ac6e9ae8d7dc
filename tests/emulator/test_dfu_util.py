"""The firmware of an emulated device replaced by the real dfu-util, from run-time mode to the new image and back."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from phasewire import Emulator
from phasewire.__main__ import main
from phasewire.emulator.firmware.loader import FACTORY_IMAGE, next_image
from phasewire.protocol import firmware
from phasewire.protocol.codes import Target
from phasewire.protocol.firmware import Image, Segment
from phasewire.protocol.versions import Version

from tests.emulator.test_umockdev import Runner, needs

DFU_UTIL = "dfu-util --device 1209:0001,1209:0002 --detach-delay 1"


def made(minor: int) -> Image:
    body = np.random.default_rng(minor).bytes(9000)
    return Image(Version(3, minor, 0), (Segment(Target.ALL_PROCESSORS, body), Segment(Target.CONTROLLER, body[:72])))


def built(folder: Path) -> Image:
    """The same image, built by the command line as new.dfu."""
    image = made(1)
    for target, data in image.segments:
        (folder / target.name).write_bytes(data)
    programs = ("--processors", str(folder / "ALL_PROCESSORS"), "--controller", str(folder / "CONTROLLER"))
    with pytest.raises(SystemExit) as exited:
        main(["firmware", "build", *programs, "--firmware-version", "3.1.0", "-o", str(folder / "new.dfu")])
    assert not exited.value.code
    return image


@pytest.fixture
def run(tmp_path: Path) -> Runner:
    return Runner(tmp_path)


FOUND = re.compile(r"Found (\w+): \[1209:000[12]\] ver=(\d+)")


@needs("dfu-util")
@pytest.mark.slow
def test_an_image_is_downloaded_and_read_back(run: Runner, tmp_path: Path) -> None:
    """The upload is the image that boots next, as it is stored: without the suffix."""
    emulator, new = Emulator(), built(tmp_path)
    script = f"""
        set -e
        cd {tmp_path}
        dfu-util --list
        {DFU_UTIL} --detach
        sleep 1
        dfu-util --list
        {DFU_UTIL} --download new.dfu
        dfu-util --list
        {DFU_UTIL} --upload read.bin --reset || test $? -eq 251
        sleep 0.2
        dfu-util --list
    """
    code, out, err = run("sh", "-c", script, machines=[emulator])
    assert code == 0, err
    assert "DFU state(2) = dfuIDLE, status(0) = No error condition is present\nDone!" in out
    assert FOUND.findall(out) == [("Runtime", "0010"), ("DFU", "0010"), ("DFU", "0010"), ("Runtime", "0310")]
    assert (tmp_path / "read.bin").read_bytes() == new.encode()
    assert emulator.running.info().firmware == (3, 1, 0)


@needs("dfu-util")
@pytest.mark.slow
def test_a_corrupted_image_is_refused_and_the_old_one_boots(run: Runner, tmp_path: Path) -> None:
    """The checksum of the suffix, which dfu-util checks itself, is right."""
    emulator = Emulator()
    stored = bytearray(made(1).encode())
    stored[5000] ^= 0x10
    suffix = firmware.Suffix(vendor=0x1209, product=0x0001, release=0x0310)
    (tmp_path / "bad.dfu").write_bytes(firmware.with_suffix(bytes(stored), suffix))
    script = f"cd {tmp_path}; {DFU_UTIL} --download bad.dfu --reset; sleep 0.2; dfu-util --list"
    _, out, _ = run("sh", "-c", script, machines=[emulator])
    assert "DFU state(10) = dfuERROR, status(2) = File is for this device but fails some vendor-specific test" in out
    assert FOUND.findall(out) == [("Runtime", "0010")]
    assert next_image(emulator.flash) == FACTORY_IMAGE.encode()
