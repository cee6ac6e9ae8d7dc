"""``phasewire flash`` as a process of its own, through libusb, on emulated devices that only this process sees."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from phasewire import Emulator
from phasewire.protocol.codes import Bank

from tests.emulator.test_umockdev import Result, Runner, needs
from tests.host.upgrades import FACTORY, FILE, NEW, in_dfu_mode, running, untouched

PHASEWIRE = """
import os, signal, sys
import libusb_package, usb.backend.libusb1
from phasewire.__main__ import main
from phasewire.host.firmware.dfu import DfuLine
# The libusb of the system: that of libusb-package does not hear under umockdev that a device has come back.
libusb_package.get_libusb1_backend = usb.backend.libusb1.get_backend
genuine = DfuLine._send
def send(line, number, *rest):
    if number == 3 and "CTRL_C" in os.environ:
        os.kill(os.getpid(), signal.SIGINT)
    genuine(line, number, *rest)
DfuLine._send = send
main(sys.argv[1:])
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "new.dfu").write_bytes(FILE)
    (tmp_path / "command.py").write_text(PHASEWIRE)
    (tmp_path / "run").mkdir()
    return tmp_path


def run(folder: Path, script: str, *machines: Emulator) -> Result:
    """Run a shell script that may use ``phasewire``, which is the command line on libusb."""
    prelude = f'cd {folder}; phasewire() {{ {sys.executable} command.py "$@"; }}\n'
    return Runner(folder / "run")("sh", "-c", prelude + script, machines=machines)


@needs("lsusb")
@pytest.mark.slow
def test_an_image_is_flashed_listed_and_taken_back(folder: Path) -> None:
    one, other = Emulator(serial="REAL-1"), Emulator(serial="REAL-2")
    script = """
        set -e
        phasewire flash new.dfu --device usb:REAL-2 --json flash.json
        phasewire flash --list --device usb: --json list.json
        phasewire flash --revert --device usb:REAL-2 --json revert.json
    """
    code, out, err = run(folder, script, one, other)
    assert code == 0, err
    assert "was given firmware 2.3.4, which runs on all eleven processors, from bank A" in out
    record = json.loads((folder / "flash.json").read_text())
    assert (record["before"], record["firmware"], record["attempts"]) == ("0.1.0", "2.3.4", 1)
    listed = json.loads((folder / "list.json").read_text())["devices"]
    assert sorted((each["url"], each["mode"], each["firmware"], each["bank"]) for each in listed) == [
        ("usb:REAL-1", "run time", "0.1.0", "FACTORY"),
        ("usb:REAL-2", "run time", "2.3.4", "A"),
    ]
    assert json.loads((folder / "revert.json").read_text())["before"] == "2.3.4"
    assert untouched(one)
    assert running(other) == (FACTORY, Bank.FACTORY)


@needs("lsusb")
@pytest.mark.slow
def test_ctrl_c_leaves_a_device_that_runs_and_can_be_flashed(folder: Path) -> None:
    script = """
        CTRL_C=1 phasewire flash new.dfu --device usb:
        echo code $?
        sleep 0.3
        phasewire flash new.dfu --device usb: --json flash.json
    """
    emulator = Emulator()
    code, out, err = run(folder, script, emulator)
    assert code == 0, err
    assert "code 130" in out.splitlines()
    assert "Stopped. The device boots its old firmware" in err
    assert "Traceback" not in err
    record = json.loads((folder / "flash.json").read_text())
    assert (record["before"], record["attempts"]) == ("0.1.0", 1)
    assert running(emulator) == (NEW.version, Bank.A)


@needs("lsusb")
@pytest.mark.slow
def test_a_cable_that_is_pulled_for_a_moment_costs_an_attempt(folder: Path) -> None:
    emulator = Emulator()

    def pull(address: int, data: bytes) -> None:
        emulator.flash.program = genuine  # type: ignore[method-assign]
        genuine(address, data)
        emulator.scheduler.at(emulator.scheduler.now + 400, emulator.usb.unplug)
        emulator.scheduler.at(emulator.scheduler.now + 100_000_000, emulator.usb.plug)

    genuine, emulator.flash.program = emulator.flash.program, pull  # type: ignore[method-assign]
    code, _, err = run(folder, "phasewire flash new.dfu --device usb: --json flash.json", emulator)
    assert code == 0, err
    assert json.loads((folder / "flash.json").read_text())["attempts"] == 2
    assert running(emulator) == (NEW.version, Bank.A)
    assert not in_dfu_mode(emulator)
