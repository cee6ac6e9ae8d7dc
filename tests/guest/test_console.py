"""The kernel's serial driver and the console at its other end."""

from __future__ import annotations

import pytest

from .conftest import Bench

pytestmark = pytest.mark.guest

ASK = """
import serial
port = serial.Serial("/dev/ttyACM0", timeout=5)
port.write(b"\\r\\nstatus\\r\\n")
said = port.read_until(b"drive_limit: 320")
print(said.decode(), port.read_until(b"> ").decode())
"""
"""Asks for the state, whatever stands on the line, and reads to the prompt after it."""

FLOOD = """
import os, subprocess, time, tty
port = os.open("/dev/ttyACM0", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
tty.setraw(port)
line, sent, read, idle = b"clock\\r\\n", 0, b"", 0
while idle < 20 and sent < 1 << 20:
    try:
        sent, idle = sent + os.write(port, (line * 500)[sent % len(line) :]), 0
    except BlockingIOError:
        idle += 1
        time.sleep(0.05)
assert idle, "nothing held the flood back"
print("held back after", sent, flush=True)
rest, idle = line[sent % len(line) :] if sent % len(line) else b"", 0
while idle < 40 or rest:
    try:
        read, idle = read + os.read(port, 4096), 0
    except BlockingIOError:
        idle += 1
        time.sleep(0.05)
        assert idle < 200, "the device does not answer any more"
    if rest:
        try:
            rest = rest[os.write(port, rest) :]
        except BlockingIOError:
            pass
print("answered", read.count(b"\\nok"), "of", -(-sent // len(line)))
"""
"""Asks without reading until there is room for no more; then reads, and counts the answers."""


def test_the_console_answers_through_the_kernels_driver(bench: Bench) -> None:
    bench.attach()
    assert "state: OFF" in bench.python(ASK)
    said = bench.check("sh", "-c", "(sleep 1; printf 'status\\r'; sleep 2) | picocom --quiet /dev/ttyACM0")
    assert "state: OFF" in said
    assert bench.complaints() == []


def test_a_console_answers_after_a_program_hung_up_in_mid_answer(bench: Bench) -> None:
    bench.attach()
    hang_up = "port = serial.Serial('/dev/ttyACM0')\nport.write(b'help\\r\\n' * 20)\nport.read(10)\nport.close()\n"
    assert "state: OFF" in bench.python("import serial\n" + hang_up * 3 + ASK)
    assert bench.complaints() == []


def test_a_program_that_asks_and_does_not_read_is_held_back_and_loses_nothing(bench: Bench) -> None:
    bench.attach()
    flood = bench.guest.start("python", FLOOD, seconds=60)
    assert "OFF" in bench.check("phasewire", "info", "--device", "usb:")
    done = bench.guest.wait(flood)
    assert (done.code, done.err) == (0, "")
    answers, _, asked = done.out.split()[-3:]
    assert answers == asked
    assert "state: OFF" in bench.python(ASK)
    assert bench.complaints() == []
