"""``phasewire emulate`` as a process, and a USB/IP client of it that was written from the kernel's document."""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
import serial
from cobs import cobs
from phasewire.protocol.blocks import Block, Update, pack
from phasewire.protocol.codes import Fault, Request, State
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import Status

from tests.cli.runner import Run
from tests.emulator.usbip_client import Client, client_on, setup

pytestmark = pytest.mark.slow  # each begins processes

LOOPBACK = "127.0.0.1"
PATIENCE = 20.0  # seconds; the process takes a few to start on a busy machine
STALLED = -32  # EPIPE
STATUS_REQUEST = bytes.fromhex("05032AC102 01 0101 0240 05CDC288CE 00")  # the worked example of chapter SER


class Served:
    """The process and its announcement."""

    def __init__(self, process: subprocess.Popen[str], announced: dict[str, Any]) -> None:
        self.process = process
        self.announced = announced

    @contextmanager
    def client(self, bus_id: str = "1-1") -> Iterator[Client]:
        usbip = self.announced["usbip"]
        with closing(socket.create_connection((usbip["host"], usbip["port"]), PATIENCE)) as connection:
            client = client_on(connection)
            assert client.attach(bus_id) == 0
            yield client

    def end(self, number: signal.Signals) -> tuple[int, str]:
        """Send a signal; returns the exit code and the text on standard error."""
        self.process.send_signal(number)
        _, said = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, said


@contextmanager
def emulate(*options: str) -> Iterator[Served]:
    command = [sys.executable, "-m", "phasewire", "emulate", "--port", "0", "--json", "-", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            line = process.stdout.readline()
            assert line, process.communicate(timeout=PATIENCE)
            yield Served(process, json.loads(line))
        finally:
            process.kill()


@pytest.mark.parametrize("pace", ["wall", "fast"])
def test_a_device_that_restarts_or_is_detached_can_be_attached_again(pace: str) -> None:
    with emulate("--pace", pace) as served:
        with served.client() as client:
            client.enumerate()
            client.submit(0x00, 0, setup=setup(0x41, Request.RESET, 0, 0, 0))
            with pytest.raises(EOFError):
                client.wait_for(client.submit(0x81, 512))
        with served.client() as client:
            client.enumerate()
            assert client.request(0x21, 0, 1000, 3).status == 0  # DETACH
            with pytest.raises(EOFError):
                client.wait_for(client.submit(0x81, 512))
        with served.client() as client:
            assert client.descriptor(1, 18)[8:12] == bytes.fromhex("09120200")  # 1209:0002, DFU mode
            client.enumerate()
            client.descriptor(1, 64)
            assert client.descriptor(1, 18)[8:12] == bytes.fromhex("09120100")  # a bus reset boots it


def test_each_device_is_offered_by_usbredir() -> None:
    with emulate("--usbredir", "--count", "2") as served:
        assert served.announced["usbip"] is None
        for device in served.announced["devices"]:
            with socket.create_connection((LOOPBACK, device["usbredir_port"]), PATIENCE) as line:
                hello = line.recv(80)
                assert hello[:21] == struct.pack("<III", 0, 68, 0) + b"phasewire"


@pytest.mark.parametrize(("kind", "pace"), [("pty", "wall"), ("tcp", "fast")])
def test_a_serial_line_carries_text_and_frames(kind: str, pace: str) -> None:
    with emulate("--serial", kind, "--pace", pace, "--baud", "1000000") as served:
        assert served.announced["usbip"] is None
        with serial.serial_for_url(served.announced["devices"][0]["serial_line"], 1_000_000, timeout=PATIENCE) as port:
            port.write(b"\r")
            assert port.read_until(b"> ")[-2:] == b"> "
            port.write(bytes.fromhex("00") + STATUS_REQUEST)
            assert port.read_until(b"\0")[-1:] == b"\0"  # the end of the text
            answer = cobs.decode(port.read_until(b"\0")[:-1])
        assert answer[:3] == bytes([4, 0x2A, 0])  # REPLY, tag, DONE
        status = Status.decode(answer[3:-4])
        assert (status.enabled, zlib.crc32(answer[:-4])) == (False, int.from_bytes(answer[-4:], "little"))


def test_a_terminal_shows_commands_and_states_until_the_time_is_over() -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "phasewire", "emulate", "--port", "0", "--seconds", "0.3"]
    with subprocess.Popen(command, stdout=theirs, stderr=theirs, close_fds=True) as process:
        os.close(theirs)
        said = b""
        with closing(os.fdopen(ours, "rb", buffering=0)) as terminal:
            while True:
                try:
                    said += terminal.read(4096)
                except OSError:  # it has gone
                    break
        assert process.wait(PATIENCE) == 0
    text = said.decode()
    assert "modprobe vhci-hcd" in text
    assert re.search(rf"phasewire attach {LOOPBACK}:\d+ 1-1 --loop", text)
    assert "EMU-0001 OFF at " in text
    assert "Ctrl-C ends" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--count", "2", "--serial-number", "a"], "2 devices need as many serial numbers, or none; there are 1"),
        (["--serial-number", "a", "--serial-number", "a"], "same serial number: a, a"),
        (["--serial-number", "a b"], "serial number 'a b'"),
        (["--serial", "usb"], "unknown kind of serial line 'usb'; known are pty and tcp"),
        (["--link", "3wire"], "unknown link '3wire'; known are 5wire and 2wire"),
        (["--speed", "super"], "unknown speed 'super'; known are high and full"),
        (["--pace", "slow"], "unknown pace 'slow'; known are wall and fast"),
        (["--host", "192.0.2.1"], "cannot listen on 192.0.2.1, port 3240"),
        (["--serial", "tcp", "--baud", "0"], "0 baud"),
    ],
)
def test_wrong_use_is_refused(phasewire: Run, options: list[str], message: str) -> None:
    outcome = phasewire("emulate", *options)
    assert outcome.code == 2
    assert message in " ".join(outcome.err.split())


def test_listening_on_all_interfaces_gives_a_warning(phasewire: Run) -> None:
    outcome = phasewire("emulate", "--host", "0.0.0.0", "--port", "0", "--seconds", "0")
    assert outcome.code == 0
    assert "warning: whoever reaches 0.0.0.0" in outcome.err
    assert "warning" not in outcome.out


def test_the_time_line_of_an_update_is_drawn(phasewire: Run, tmp_path: Path) -> None:
    """52.715 and 73.115 µs by clause BUD-003."""
    for link, ready in (("5wire", "52.7"), ("2wire", "73.1")):
        outcome = phasewire("emulate", "--timeline", f"{link}.png", "--link", link)
        assert outcome.code == 0
        assert (tmp_path / f"{link}.png").read_bytes().startswith(b"\x89PNG")
        assert f"all tables ready {ready} µs" in outcome.out
    outcome = phasewire("emulate", "--timeline", "p.xyz")
    assert (outcome.code, "a picture's name ends in .png" in outcome.err) == (2, True)


def test_the_outputs_are_exported_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "last.vcd"
    with emulate("--export", str(path)) as served:
        with served.client() as client:
            client.enumerate()
            client.request(0x41, Request.ENABLE)
            client.write(0x01, pack(Block(Update(Pulses([25] * 320, [25] * 320)), 0, restart=True)))
            client.read(0x81, 512)
        assert served.end(signal.SIGINT)[0] == 0
    assert path.read_text().count("1") > 320


def test_a_flash_file_serves_one_device_and_has_its_size(phasewire: Run, tmp_path: Path) -> None:
    outcome = phasewire("emulate", "--flash", "flash.bin", "--count", "2")
    assert (outcome.code, "is the flash of one device, not of 2" in outcome.err) == (2, True)
    (tmp_path / "flash.bin").write_bytes(b"too short")
    outcome = phasewire("emulate", "--port", "0", "--seconds", "0", "--flash", "flash.bin")
    assert (outcome.code, "a flash is kept in a file of" in outcome.err) == (2, True)


def test_a_flash_outlives_a_process_that_is_killed_and_has_one_emulator(phasewire: Run, tmp_path: Path) -> None:
    """`test_upgrade` checks what each step of an upgrade writes."""
    path = tmp_path / "flash.bin"
    with emulate("--flash", str(path), "--serial-number", "KEPT-1") as served:
        served.process.kill()
    with emulate("--flash", str(path)) as served:
        assert served.announced["devices"][0]["serial"] == "KEPT-1"
        before, outcome = path.read_bytes(), phasewire("emulate", "--port", "0", "--seconds", "0", "--flash", str(path))
        assert (outcome.code, f"in use by process {served.process.pid}" in outcome.err) == (2, True)
        assert path.read_bytes() == before
        assert served.end(signal.SIGINT)[0] == 0
    assert list(tmp_path.iterdir()) == [path]


def test_a_scenario_breaks_what_it_names(phasewire: Run, tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text('[[fault]]\nname = "hot-board"\nboard = 2\ncelsius = 90\n')
    with emulate("--scenario", str(path)) as served:
        with served.client() as client:
            client.enumerate()
            deadline = time.monotonic() + PATIENCE
            while time.monotonic() < deadline:
                status = Status.decode(client.request(0xC1, Request.STATUS, length=Status.BYTES).data)
                if status.faults:
                    break
            assert (status.faults, status.state, status.temperature_c) == (Fault.TEMPERATURE, State.FAULT, 90)
        assert served.end(signal.SIGTERM)[0] == 0
    path.write_text('[[fault]]\nname = "cold-board"\n')
    outcome = phasewire("emulate", "--seconds", "0", "--scenario", "scenario.toml")
    assert outcome.code == 2
    assert "scenario.toml, fault 1: unknown name 'cold-board'; known are" in " ".join(outcome.err.split())


@pytest.mark.skipif(shutil.which("umockdev-wrapper") is None, reason="umockdev is not installed")
def test_a_program_under_umockdev_gives_its_exit_code(phasewire: Run) -> None:
    command = f"{sys.executable} -c 'import sys; sys.exit(5)'"
    assert phasewire("emulate", "--umockdev", command).code == 5
