"""`phasewire devices` and `phasewire doctor`: their output and their exit codes."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from phasewire import Emulator
from phasewire.emulator import faults
from phasewire.emulator.doors.umockdev import run_under_mock
from phasewire.host.finding.computer_checks import udev_rule
from phasewire.host.finding.doctor import CHECKS
from phasewire.protocol.enumeration import FULL_SPEED

from ..host.buses import in_dfu_mode
from .runner import Outcome, Run

PHASEWIRE = [sys.executable, "-m", "phasewire"]


@pytest.fixture
def phasewire(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setenv("COLUMNS", "200")
    return phasewire


# In this process


def test_devices_are_listed(phasewire: Run) -> None:
    with Emulator(serial="CLI-A"), Emulator(serial="CLI-B"):
        outcome = phasewire("devices")
        record = json.loads(phasewire("devices", "--json", "-").out)
    assert outcome.code == 0
    assert "emulator:CLI-A" in outcome.out
    assert "run time" in outcome.out
    assert record["format"] == "phasewire-devices-1"
    told = {each["serial"]: each for each in record["devices"]}
    assert told["CLI-B"] == {
        "url": "emulator:CLI-B",
        "product": "phasewire five-board array (emulated)",
        "serial": "CLI-B",
        "mode": "run time",
        "firmware": "0.1.0",
        "location": told["CLI-B"]["location"],
        "problem": None,
    }


def test_without_a_device_the_next_steps_are_printed(phasewire: Run, tmp_path: Path) -> None:
    outcome = phasewire("devices", "--json", str(tmp_path / "devices.json"))
    assert (outcome.code, outcome.out) == (3, "")
    assert "phasewire doctor" in outcome.err
    assert "emulator: always works" in outcome.err
    assert json.loads((tmp_path / "devices.json").read_text())["devices"] == []


def test_a_line_that_fails_is_a_warning(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("libusb_package.get_libusb1_backend", lambda: None)
    with Emulator(serial="CLI-C"):
        outcome = phasewire("devices")
    assert outcome.code == 0
    assert "CLI-C" in outcome.out
    assert "warning: usb: " in outcome.err
    assert "libusb could not be loaded" in outcome.err


def test_the_doctor_in_json(phasewire: Run, emulator: Emulator) -> None:
    outcome = phasewire("doctor", "--device", emulator.url, "--json", "-")
    record = json.loads(outcome.out)
    assert (record["format"], record["verdict"]) == ("phasewire-doctor-1", "ok")
    assert [finding["name"] for finding in record["findings"]] == list(CHECKS)
    assert set(record["findings"][0]) == {"name", "verdict", "seen", "advice"}
    assert "self-test" in outcome.err


def test_a_check_that_fails_is_code_1(phasewire: Run, emulator: Emulator) -> None:
    emulator.inject(faults.HotBoard(board=1, celsius=95))
    outcome = phasewire("doctor", "--device", emulator.url)
    assert outcome.code == 1
    assert "→ let it cool below 80 °C" in outcome.out


def test_a_warning_is_code_0(phasewire: Run) -> None:
    """At full speed everything works, only slower."""
    with Emulator(serial="CLI-D", speed=FULL_SPEED):
        assert phasewire("doctor", "--device", "emulator:CLI-D").code == 0


def test_no_device_is_code_3(phasewire: Run) -> None:
    assert phasewire("doctor", "--device", "emulator:NOT-THERE").code == 3
    assert phasewire("doctor").code == 3


def test_the_only_device_is_examined_unless_the_environment_names_one(
    phasewire: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Emulator(serial="CLI-E"):
        assert "CLI-E answers" in phasewire("doctor").out
        with Emulator(serial="CLI-F"):
            outcome = phasewire("doctor")
            assert outcome.code == 3
            assert "emulator:CLI-E or emulator:CLI-F" in outcome.out
            monkeypatch.setenv("PHASEWIRE_DEVICE", "emulator:CLI-F")
            assert "CLI-F answers" in phasewire("doctor").out


def test_the_udev_rule_is_printed_as_it_is(phasewire: Run) -> None:
    outcome = phasewire("doctor", "--udev-rule")
    assert outcome == (0, udev_rule(), "")


# On a mocked Linux, through the real libusb


def needs(*programs: str) -> pytest.MarkDecorator:
    missing = [program for program in ("umockdev-wrapper", *programs) if not shutil.which(program)]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


def under_mock(folder: Path, *command: str, machines: list[Emulator]) -> Outcome:
    out, err = folder / "out", folder / "err"
    bounded = ["timeout", "--signal=KILL", "60", *command]
    with out.open("wb") as stdout, err.open("wb") as stderr:
        code = run_under_mock(bounded, machines, stdout=stdout, stderr=stderr)
    return Outcome(code, out.read_text(), err.read_text())


@pytest.mark.slow
@needs()
def test_the_doctor_examines_the_only_device_on_a_real_bus(tmp_path: Path) -> None:
    code, out, err = under_mock(tmp_path, *PHASEWIRE, "doctor", "--json", "-", machines=[Emulator(serial="REAL-4")])
    assert code == 0, out + err
    findings = {finding["name"]: finding for finding in json.loads(out)["findings"]}
    assert {name for name, finding in findings.items() if finding["verdict"] == "fail"} == set()
    assert findings["device"]["seen"] == "usb:REAL-4 at 1-1, firmware 0.1.0"
    assert findings["usb bus"]["verdict"] == "ok"
    for name in ("access", "cable", "open", "self-test", "faults", "outputs"):
        assert findings[name]["verdict"] == "ok", findings[name]


RULES_OF_ITS_OWN = """
set -e
mount -t tmpfs none /run
mkdir -p /run/udev/rules.d
cp "$RULE" /run/udev/rules.d/60-phasewire.rules
tty=$UMOCKDEV_DIR/sys/devices/platform/phasewire/usb1/1-1/1-1:1.1/tty/ttyACM0
mkdir -p "$tty" "$UMOCKDEV_DIR/sys/class/tty"
printf 'MAJOR=166\\nMINOR=0\\nDEVNAME=ttyACM0\\n' > "$tty/uevent"
echo 166:0 > "$tty/dev"
ln -s ../../devices/platform/phasewire/usb1/1-1/1-1:1.1/tty/ttyACM0 "$UMOCKDEV_DIR/sys/class/tty/ttyACM0"
ln -s ../../../../../../../../class/tty "$tty/subsystem"
for device in 1-1 1-1/1-1:1.1/tty/ttyACM0 1-2 1-3; do
  echo "DEVICE=$device"
  udevadm test --action=add "/sys/devices/platform/phasewire/usb1/$device" 2>&1
done
"""


def may_mount() -> bool:
    return not subprocess.run(
        ["unshare", "-m", "mount", "-t", "tmpfs", "none", "/run"], capture_output=True, check=False
    ).returncode


@needs("udevadm", "unshare")
def test_udev_gives_access_to_arrays_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """udev judges devices in both modes, a console, and a foreign device with the same numbers."""
    if not may_mount():
        pytest.skip("no right to mount, which keeps the rule out of the computer's own")
    foreign = Emulator(serial="OTHERS")
    genuine = foreign.usb.enumeration
    other = genuine.configuration.replace(bytes([0xFF, 0x50, 0x01]), bytes([0xFF, 0x00, 0x00]))
    monkeypatch.setattr(foreign.usb, "enumeration", dataclasses.replace(genuine, configuration=other))
    rule = tmp_path / "rule"
    rule.write_text(udev_rule(), encoding="utf-8")
    machines = [Emulator(), in_dfu_mode("WAITS"), foreign]
    command = ("unshare", "-m", "env", f"RULE={rule}", "sh", "-c", RULES_OF_ITS_OWN)
    code, out, err = under_mock(tmp_path, *command, machines=machines)
    assert code == 0, out + err
    told = {part.splitlines()[0]: part for part in out.split("DEVICE=")[1:]}
    assert "60-phasewire.rules: " not in out  # udev's complaints
    access = {device: bool(re.search("^TAGS=.*:uaccess:", text, re.MULTILINE)) for device, text in told.items()}
    assert access == {"1-1": True, "1-1/1-1:1.1/tty/ttyACM0": True, "1-2": True, "1-3": False}
    ignored = {device: "ID_MM_DEVICE_IGNORE=1" in text for device, text in told.items()}
    assert ignored == access
