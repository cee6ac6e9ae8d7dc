"""Devices that leave in the middle of something: programs end and say why, and the kernel goes on."""

from __future__ import annotations

import json
import random
import signal
from pathlib import Path

import pytest
from phasewire.hil.conformance.guest import Done
from phasewire.protocol.firmware import Image, build

from tests.host.upgrades import FILE, made

from .conftest import PATIENCE, Bench, pulses
from .test_flashing import SLOW, firmware

pytestmark = pytest.mark.guest

OPENED = """
import os, pathlib, sys, time
for _ in range(1200):
    for link in pathlib.Path("/proc").glob("[0-9]*/fd/*"):
        try: name = os.readlink(link)
        except OSError: continue
        if name.startswith("/dev/bus/usb"): sys.exit()
    time.sleep(0.05)
sys.exit("no program opens the device")
"""
UNPLUG = """
import contextlib, pathlib
with contextlib.suppress(OSError):  # while it changes its mode it is away already
    pathlib.Path("/sys/devices/platform/vhci_hcd.0/detach").write_text("0")
"""
SUSPEND = """
import pathlib, sys, time
vendors = pathlib.Path("/sys/bus/usb/devices").glob("*/idVendor")
(device,) = [each.parent for each in vendors if each.read_text() == "1209\\n"]
(device / "power/autosuspend_delay_ms").write_text("0")
(device / "power/control").write_text("auto")
for _ in range(400):
    if (device / "power/runtime_status").read_text() == "suspended\\n": sys.exit()
    time.sleep(0.05)
sys.exit("the device is not suspended")
"""
DEVICE = "$(dirname $(grep -l 1209 /sys/bus/usb/devices/*/idVendor))"
INTERRUPTIONS = {
    "reset": f"usbreset 1209:$(cat {DEVICE}/idProduct)",
    "not authorised": f"cd {DEVICE}; echo 0 > authorized; sleep 0.2; echo 1 > authorized",
}
IN_DFU_MODE = """
import pathlib, sys, time
for _ in range(9000):
    for vendor in pathlib.Path("/sys/bus/usb/devices").glob("*/idVendor"):
        try:
            if vendor.read_text() == "1209\\n" and vendor.with_name("idProduct").read_text() == "0002\\n":
                time.sleep({seconds})
                sys.exit()
        except OSError: pass  # it leaves
    time.sleep(0.02)
sys.exit("the device does not come in DFU mode")
"""
"""One process, for a shell's loop may miss the seconds in which the device is there in DFU mode."""
SAYS = """
import re, serial, sys, time
for _ in range(20):
    try:
        with serial.Serial("/dev/ttyACM0", timeout=5) as port:
            port.write(b"\\r\\nstatus\\r\\n")
            said = port.read_until(b"drive_limit: 320").decode()
        if re.search("{what}", said): sys.exit()
    except OSError as error: said = str(error)
    time.sleep(3)
sys.exit("the console does not say {what}: " + said)
"""
"""Asks by the console, for a program that opens the array turns its outputs off; seldom, for it is a sign of life."""
RESETS = """
import random, subprocess, sys, threading, time, usb.core
seed = {seed}
draw, over = random.Random(seed), threading.Event()

def use(kind):
    while not over.is_set():
        try:
            device = usb.core.find(idVendor=0x1209, idProduct=1)
            while not over.is_set():
                if kind: device.ctrl_transfer(0x80, 6, 0x0100, 0, 18)
                else: device.read(0x81, 512, 500)
        except (usb.core.USBError, AttributeError, ValueError): pass  # it is being reset

users = [threading.Thread(target=use, args=(kind,)) for kind in (0, 1)]
for user in users: user.start()
for _ in range({count}):
    time.sleep(draw.random() * 0.3)
    subprocess.run(["usbreset", "1209:0001"], check=True, timeout=30, stdout=subprocess.DEVNULL)
over.set()
for user in users:
    user.join(30)
    if user.is_alive(): sys.exit(f"a transfer does not end, with seed {{seed}}")
"""
DETACHES = """
import pathlib, random, sys, time, threading, usb.core
seed, count, seconds = {seed}, {count}, {seconds}
draw, end, status = random.Random(seed), time.monotonic() + seconds, pathlib.Path("/sys/devices/platform/vhci_hcd.0")
errors = set()

def find():
    until = time.monotonic() + 30
    while time.monotonic() < until:
        try:
            device = usb.core.find(idVendor=0x1209, idProduct=1)
            if device is not None and device.serial_number: return device
        except (usb.core.USBError, ValueError): pass
        time.sleep(0.02)
    sys.exit(f"after {{done}} detaches with seed {{seed}} the device does not come back")

def use(device, kind):
    try:
        while True:
            if kind: device.ctrl_transfer(0x80, 6, 0x0100, 0, 18)
            else: device.read(0x81, 512, 60_000)
    except usb.core.USBError as error: errors.add(error.errno)

for done in range(count):
    if time.monotonic() > end: break
    device = find()
    users = [threading.Thread(target=use, args=(device, kind)) for kind in (0, 1)]
    for user in users: user.start()
    time.sleep(draw.random() * 0.2)
    (status / "detach").write_text("0")
    for user in users:
        user.join(30)
        if user.is_alive(): sys.exit(f"after {{done}} detaches with seed {{seed}} a transfer does not end")
    usb.util.dispose_resources(device)
else: done = count
find()
print(done, errors)
"""


def is_told(done: Done) -> bool:
    """Whether a program has ended with a code that says what was wrong, and in words."""
    return done.code in (3, 4) and done.err.splitlines()[-1].startswith("phasewire: ") and "Traceback" not in done.err


STREAM, FLASH = ("stream", "circle:radius=0.02", "--rate", "100", "--seconds", "100"), ("flash",)


@pytest.mark.parametrize(
    ("what", "how"),
    [
        (STREAM, "killed"),
        (FLASH, "unplugged"),
        *(
            pytest.param(*case, marks=pytest.mark.guest_slow)
            for case in ((STREAM, "unplugged"), (STREAM, "ended"), (FLASH, "ended"), (FLASH, "killed"))
        ),
    ],
)
def test_a_device_that_leaves_is_told_of_and_the_kernel_goes_on(bench: Bench, what: tuple[str, ...], how: str) -> None:
    bench.attach("--loop" if what == FLASH else "--patience=30")
    if what == FLASH:
        what = (*what, bench.guest.share("new.dfu", FILE))
    program = bench.guest.start("phasewire", *what, "--device", "usb:", seconds=PATIENCE)
    bench.python(OPENED)
    bench.python(f"import time; time.sleep({random.random()})")
    if how == "unplugged":
        bench.detach()
        bench.python(UNPLUG)
    else:
        bench.end_server(signal.SIGKILL if how == "killed" else signal.SIGTERM)
    done = bench.guest.wait(program)
    assert is_told(done), done
    bench.serve()
    bench.attach()
    assert "EMU-0001" in bench.check("phasewire", "info", "--device", "usb:")


@pytest.mark.guest_slow  # test_ehci.py resets a device that plays, and the case above ends a stream
@pytest.mark.parametrize("how", ["reset", "not authorised", "killed"])
def test_a_stream_that_is_cut_off_leaves_silent_outputs_and_a_device_that_answers(bench: Bench, how: str) -> None:
    bench.attach("--loop")
    bench.check("phasewire", "watchdog", "2", "--device", "usb:")
    stream = ("phasewire", "stream", pulses(bench.guest, "long.npz", [10] * 5000), "--rate", "50", "--modulation", "0")
    program = bench.guest.start(*stream, "--device", "usb:", seconds=2 * PATIENCE)
    bench.python(SAYS.format(what="accepted: [1-9][0-9]"), seconds=2 * PATIENCE)
    interrupt(bench, program, how)
    bench.python(SAYS.format(what="state: OFF"), seconds=2 * PATIENCE)
    told = json.loads(bench.check("phasewire", "info", "--device", "usb:", "--json", "-"))["status"]
    assert (told["state"], told["faults"]) == ("OFF", [])


@pytest.mark.guest_slow
def test_an_upgrade_does_itself_again_after_a_reset_and_can_be_done_again_if_its_program_is_killed(
    bench: Bench, tmp_path: Path
) -> None:
    bench.attach("--loop")

    def flash(image: Image) -> tuple[str, ...]:
        name = bench.guest.share(f"{image.version}.dfu", build(image))
        return "phasewire", "flash", name, "--device", "usb:"

    def begin(command: tuple[str, ...]) -> int:
        program = bench.guest.start(*command, seconds=SLOW)
        bench.python(IN_DFU_MODE.format(seconds=2 * random.random()), seconds=SLOW)
        return program

    program = begin(flash(made(4, size=60_000)))
    bench.check("sh", "-c", INTERRUPTIONS["reset"])
    done = bench.guest.wait(program)
    assert "4.3.4" in done.out, done
    newer = flash(made(5, size=60_000))
    interrupt(bench, begin(newer), "killed")
    bench.end_server(signal.SIGKILL)  # the power goes too
    bench.serve("--flash", str(tmp_path / "flash"))
    bench.attach("--loop")
    assert firmware(bench) in ("0434", "0534")
    assert "5.3.4" in bench.check(*newer, seconds=SLOW)
    assert firmware(bench) == "0534"


def interrupt(bench: Bench, program: int, how: str) -> None:
    """Do something to a program or to its device; it must end and say why if it can."""
    if how == "killed":
        bench.guest.signal(program, signal.SIGKILL)
        assert bench.guest.wait(program).code == -signal.SIGKILL
    else:
        bench.check("sh", "-c", INTERRUPTIONS[how])
        done = bench.guest.wait(program)
        assert is_told(done), done


@pytest.mark.guest_slow
def test_resets_in_the_middle_of_requests_leave_a_device_that_answers(bench: Bench) -> None:
    bench.attach("--loop")
    seed = random.randrange(1 << 32)
    bench.python(RESETS.format(seed=seed, count=20), seconds=240)
    assert "EMU-0001" in bench.check("phasewire", "info", "--device", "usb:")


@pytest.mark.guest_slow  # test_ehci.py has a host controller that suspends its port too
def test_a_device_that_was_suspended_is_resumed_and_answers(bench: Bench) -> None:
    """The host controller keeps the suspension to itself; the device sees a bus on which nobody speaks."""
    bench.attach()
    for _ in range(3):
        bench.python(SUSPEND)
        assert "EMU-0001" in bench.check("phasewire", "info", "--device", "usb:")
    assert bench.complaints() == []


@pytest.mark.guest_slow
def test_two_hundred_detaches_at_random_leave_a_device_that_answers(bench: Bench) -> None:
    bench.attach("--loop")
    seed = random.randrange(1 << 32)
    done, errors = bench.python(DETACHES.format(seed=seed, count=200, seconds=600), seconds=700).split(maxsplit=1)
    assert int(done) > 50, f"the time was too short; seed {seed}"
    assert "19" in errors
    assert "EMU-0001" in bench.check("phasewire", "info", "--device", "usb:")
