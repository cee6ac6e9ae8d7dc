"""Real programs against the emulated device: what they print, without a complaint."""

from __future__ import annotations

import json
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from phasewire import Emulator
from phasewire.base.errors import DeviceNotFoundError
from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.doors import umockdev
from phasewire.emulator.doors.umockdev import MockUsb, run_under_mock
from phasewire.protocol.enumeration import FULL_SPEED

from tests.attacks import no_files

COMPLAINT = re.compile("warning|unknown|unrecognized|invalid|junk|error|can.t|truncated", re.IGNORECASE)
SECOND = 400_000_000  # core cycles


def needs(*programs: str) -> pytest.MarkDecorator:
    missing = [program for program in ("umockdev-wrapper", *programs) if not shutil.which(program)]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


def raising(error: Exception) -> Callable[..., Any]:
    def call(*_: object) -> Any:
        raise error

    return call


class Result(NamedTuple):
    code: int
    out: str
    err: str


class Runner:
    """Runs a command for 30 seconds at most."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __call__(self, *command: str, machines: Sequence[umockdev.Machine] = ()) -> Result:
        out, err = self._folder / "out", self._folder / "err"
        bounded = ["timeout", "--signal=KILL", "30", *command]
        with out.open("wb") as stdout, err.open("wb") as stderr:
            code = run_under_mock(bounded, machines or [Emulator()], stdout=stdout, stderr=stderr)
        return Result(code, out.read_text(), err.read_text())


@pytest.fixture
def run(tmp_path: Path) -> Runner:
    return Runner(tmp_path)


@needs("lsusb")
def test_lsusb_finds_no_fault_at_full_speed(run: Runner) -> None:
    code, out, err = run("lsusb", "-v", machines=[Emulator(speed=FULL_SPEED)])
    assert (code, err) == (0, "")
    assert re.findall(r"wMaxPacketSize +(\w+)", out) == ["0x0040", "0x0040", "0x0010", "0x0040", "0x0040"]
    assert not COMPLAINT.search(out)


@needs()
def test_the_host_driver_plays_a_field_through_libusb(run: Runner) -> None:
    script = """
import phasewire
with phasewire.open_device("usb:REAL-2") as device:
    ack = device.show(phasewire.Pulses([10] * 320, [25] * 320))
    print(device.name, ack.commit_period, device.status().accepted)
"""
    emulators = [Emulator(serial="REAL-1"), Emulator(serial="REAL-2")]
    code, out, err = run(sys.executable, "-c", script, machines=emulators)
    assert (code, err) == (0, "")
    *_, serial, period, accepted = out.split()
    assert (serial, accepted) == ("REAL-2", "2")  # the session began with a NoOp
    idle, played = (emulator.capture() for emulator in emulators)
    assert abs(played.drive(int(period))).min() == pytest.approx(1, abs=1e-6)
    assert abs(idle.drive(int(period))).max() == 0


@needs()
def test_the_console_answers_through_its_endpoints(run: Runner) -> None:
    """As a driver for CDC-ACM: DTR is set with SET_CONTROL_LINE_STATE; text goes out by 03 and comes by 83."""
    script = """
import libusb_package, usb.core
device = usb.core.find(backend=libusb_package.get_libusb1_backend())
device.ctrl_transfer(0x21, 0x22, 1, 1, None)
device.write(0x03, b"status\\r\\n")
text = b""
while not text.endswith(b"> "):
    text += bytes(device.read(0x83, 512, timeout=5000))
print(text.decode())
"""
    code, out, err = run(sys.executable, "-c", script)
    assert (code, err) == (0, "")
    assert "state: OFF" in out.splitlines()
    assert "ok" in out.splitlines()


@needs()
def test_the_command_line_names_the_device(run: Runner) -> None:
    code, out, _ = run(sys.executable, "-m", "phasewire", "info", "--device", "usb:", "--json", "-")
    assert code == 0
    assert json.loads(out)["device"].startswith("phasewire five-board array (emulated) EMU-")


UNPLUGGED = """
import time, usb.core, usb.backend.libusb1
backend = usb.backend.libusb1.get_backend()
device = usb.core.find(backend=backend, idVendor=0x1209)
print(device.address, flush=True)
for attempt in (lambda: device.read(0x81, 512, timeout=10_000), lambda: device.ctrl_transfer(0xC1, 1, 0, 0, 64)):
    try:
        attempt()
    except usb.core.USBError as error:
        print(error.errno)
end = time.monotonic() + 10
while time.monotonic() < end:
    found = usb.core.find(backend=backend, idVendor=0x1209)
    if found is not None and found.address != device.address:
        print(found.address, found.serial_number)
        break
    time.sleep(0.01)
"""


@needs("lsusb")
def test_a_device_is_unplugged_and_plugged_in_again(run: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the libusb of the system, which lsusb needs, too: that of libusb-package does not hear of what comes."""
    machine = Emulator(serial="AGAIN")
    bulk_in, reads = machine.usb.bulk_in, count()

    def read(endpoint: int) -> Handshake | bytes:
        """The cable is pulled soon after the program's first read, however long its start took."""
        if next(reads) == 0:
            machine.scheduler.at(machine.scheduler.now + SECOND // 10, machine.usb.unplug)
            machine.scheduler.at(machine.scheduler.now + SECOND // 2, machine.usb.plug)
        return bulk_in(endpoint)

    monkeypatch.setattr(machine.usb, "bulk_in", read)
    code, out, err = run(sys.executable, "-c", UNPLUGGED, machines=[machine])
    assert (code, err) == (0, "")
    assert out.split() == ["2", "19", "19", "3", "AGAIN"]  # 19 is ENODEV


@needs("lsusb")
def test_a_device_that_cannot_be_enumerated_is_not_there(run: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    mute, other, resets = Emulator(), Emulator(), []
    monkeypatch.setattr(mute.usb, "reset", lambda: resets.append(mute.scheduler.now))
    monkeypatch.setattr(mute.usb, "control", raising(Stall("it says nothing")))
    code, out, _ = run("lsusb", machines=[mute, other])
    assert (code, len(out.splitlines()), len(resets)) == (0, 1, 1)
    code, out, _ = run("lsusb", machines=[mute])
    assert (code, out) == (1, "")  # as lsusb ends if there is no device


@needs()
def test_the_configuration_is_shown(run: Runner) -> None:
    script = """
import libusb_package, pathlib, usb.core
device = usb.core.find(backend=libusb_package.get_libusb1_backend())
for value in (0, 1):
    device.set_configuration(value)
    print(repr(pathlib.Path("/sys/bus/usb/devices/1-1/bConfigurationValue").read_text()))
"""
    code, out, err = run(sys.executable, "-c", script)
    assert (code, err) == (0, "")
    assert out.splitlines() == [r"'\n'", r"'1\n'"]


@needs()
@pytest.mark.parametrize(("script", "code"), [("exit 3", 3), ("kill -KILL $$", 128 + signal.SIGKILL)])
def test_the_program_s_exit_code_is_passed_on(run: Runner, script: str, code: int) -> None:
    assert run_under_mock(["sh", "-c", script], [Emulator()]) == code


@needs()
def test_the_device_s_time_is_the_wall_clock_s(run: Runner) -> None:
    machine = Emulator()
    run("sleep", "0.5", machines=[machine])
    assert 0.4 < machine.scheduler.now / SECOND < 1.5


def test_without_umockdev_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(DeviceNotFoundError, match="apt-get install umockdev"):
        run_under_mock(["true"], [])


def test_a_program_must_be_named() -> None:
    with pytest.raises(ValueError, match="no program to run"):
        run_under_mock([], [])


def test_a_program_gets_an_error_if_it_opens_a_device_that_leaves() -> None:
    """The preloaded library ends a program whose node has no server: it may have opened it a moment before."""
    machine = Emulator()
    with MockUsb([machine]) as bed:
        machine.usb.unplug()
        bed._ports[0].run(1)
        assert not (bed.root / "dev/bus/usb/001/002").exists()
        with socket.socket(socket.AF_UNIX) as program:
            program.connect(str(bed.root / "ioctl/dev/bus/usb/001/002"))


def many_silent(place: str, crowd: ExitStack) -> None:
    for _ in range(2 * umockdev.MOST_PROGRAMS):
        crowd.enter_context(socket.socket(socket.AF_UNIX)).connect(place)


def half_an_ioctl(place: str, crowd: ExitStack) -> None:
    program = crowd.enter_context(socket.socket(socket.AF_UNIX))
    program.connect(place)
    program.sendall(b"\1")


def wrong_bytes(place: str, crowd: ExitStack) -> None:
    program = crowd.enter_context(socket.socket(socket.AF_UNIX))
    program.connect(place)
    program.sendall(b"\xff" * 24 * 100)


def no_file_left(place: str, crowd: ExitStack) -> None:
    no_files(place, crowd)


@pytest.mark.parametrize("attack", [many_silent, half_an_ioctl, wrong_bytes, no_file_left])
def test_a_strange_program_holds_up_no_device(
    attack: Callable[[str, ExitStack], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(umockdev, "ANSWER_S", 60.0)  # longer than this test lasts
    machine = Emulator()

    def serve(seconds: float) -> None:
        """Until so much of the device's time has passed."""
        with subprocess.Popen(["timeout", "20", "cat"], stdin=subprocess.PIPE) as child:
            assert child.stdin
            machine.scheduler.at(machine.scheduler.now + int(seconds * SECOND), child.stdin.close)
            bed.serve(child.pid)
            assert child.wait() == 0

    with MockUsb([machine]) as bed, ExitStack() as crowd:
        place = str(bed.root / "ioctl/dev/bus/usb/001/002")
        machine.scheduler.at(machine.scheduler.now + SECOND // 100, lambda: attack(place, crowd))
        serve(0.1)
        crowd.close()
        with socket.socket(socket.AF_UNIX) as program:
            program.connect(place)
            program.sendall(struct.pack("@LLL", 1, 0, 0))
            serve(0.05)
            assert struct.unpack("@LLL", program.recv(24))[0] == 3, "its ioctl is answered"
