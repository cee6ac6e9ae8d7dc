"""The usbredir door: QEMU's own program connects, and its firmware enumerates the device by its driver for EHCI."""

from __future__ import annotations

import asyncio
import re
import shutil
import struct
from asyncio.subprocess import PIPE, STDOUT

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator import Emulator
from phasewire.emulator.doors.serving import Server
from phasewire.emulator.doors.station import Pace, Station
from phasewire.emulator.doors.usbip_session import Exported
from phasewire.emulator.doors.usbredir import UsbRedirSession
from phasewire.emulator.scheduler import Scheduler

from tests.emulator.stand_ins import StandInDevice

PATIENCE = 30.0
HELLO = struct.pack("<III64sI", 0, 68, 0, b"a test", 0xFE)
RESET, SET_CONFIGURATION, CANCEL, CONTROL, BULK = 3, 6, 21, 100, 101
CONNECT, DISCONNECT, CONFIGURATION_STATUS = 1, 2, 8


class Desk:
    """A device and a host of it, written from usbredir-protocol.md."""

    def __init__(self) -> None:
        self.device = StandInDevice()
        self.station = Station(Scheduler(), Pace.FAST, lambda: 0.0)
        self.exported = Exported(1, 1, self.device, self.station)
        self.session = UsbRedirSession(self.exported)
        self.session.receive(HELLO)
        assert self.session.take(80)[:12] == struct.pack("<III", 0, 68, 0)

    def send(self, kind: int, number: int, data: bytes) -> None:
        self.session.receive(struct.pack("<IIQ", kind, len(data), number) + data)

    def hear(self) -> list[tuple[int, int, bytes]]:
        """All messages of the session: kinds, numbers and contents."""
        self.station.pass_time(1.0)
        data, found = self.session.take(1 << 20), []
        while data:
            kind, size, number = struct.unpack_from("<IIQ", data)
            found.append((kind, number, data[16 : 16 + size]))
            data = data[16 + size :]
        return found


@pytest.fixture
def desk() -> Desk:
    desk = Desk()
    *_, (kind, _, told) = desk.hear()
    assert (kind, told) == (CONNECT, struct.pack("<BBBBHHH", 2, 0xEF, 2, 1, 0x1209, 1, 0x0123))
    return desk


def test_transfers_go_both_ways(desk: Desk) -> None:
    desk.send(CONTROL, 7, struct.pack("<BBBBHHH", 0x80, 6, 0x80, 0, 0x0100, 0, 18))
    desk.send(BULK, 8, struct.pack("<BBHIH", 0x01, 0, 600, 0, 0) + bytes(600))
    desk.send(BULK, 9, struct.pack("<BBHIH", 0x81, 0, 512, 0, 0))
    desk.device.give(0x81, b"answer")
    heard = {number: (kind, data) for kind, number, data in desk.hear()}
    head = struct.pack("<BBBBHHH", 0x80, 6, 0x80, 0, 0x0100, 0, 18)
    assert heard[7] == (CONTROL, head + (desk.device.enumeration.find(1, 0, language=0) or b""))
    assert heard[8] == (BULK, struct.pack("<BBHIH", 0x01, 0, 600, 0, 0))
    assert heard[9] == (BULK, struct.pack("<BBHIH", 0x81, 0, 6, 0, 0) + b"answer")
    assert sum(len(packet) for _, packet in desk.device.taken) == 600


def test_a_configuration_is_chosen_and_a_transfer_cancelled(desk: Desk) -> None:
    desk.send(SET_CONFIGURATION, 3, b"\x01")
    assert desk.hear()[-1] == (CONFIGURATION_STATUS, 3, b"\x00\x01")
    desk.send(BULK, 4, struct.pack("<BBHIH", 0x81, 0, 512, 0, 0))
    assert desk.hear() == []
    desk.send(CANCEL, 4, b"")
    assert desk.hear() == [(BULK, 4, struct.pack("<BBHIH", 0x81, 1, 0, 0, 0))]


def test_the_host_resets_the_bus_and_sees_the_device_leave_and_come_back(desk: Desk) -> None:
    desk.send(RESET, 0, b"")
    assert desk.device.happened == ["reset"]
    desk.device.attached = False
    desk.session.run()
    assert [kind for kind, _, _ in desk.hear()] == [DISCONNECT]
    desk.device.plug()
    desk.session.run()
    assert desk.hear()[-1][0] == CONNECT
    desk.session.hang_up()
    assert desk.device.happened[-2:] == ["unplug", "plug"]
    assert not desk.exported.taken


@given(st.lists(st.tuples(st.integers(0, 105), st.binary(max_size=40))), st.binary(max_size=30))
def test_no_bytes_of_a_host_raise_anything(messages: list[tuple[int, bytes]], rest: bytes) -> None:
    desk = Desk()
    for number, (kind, data) in enumerate(messages):
        desk.send(kind, number, data)
        desk.station.pass_time(1.0)
    desk.session.receive(rest)
    desk.station.pass_time(1.0)
    desk.session.hang_up()
    assert desk.station.conversations == []


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("qemu-system-x86_64"), reason="QEMU is not installed (qemu-system-x86)")
def test_qemu_s_firmware_enumerates_the_device_through_ehci() -> None:
    async def run() -> str:
        emulator = Emulator()
        station = Station(emulator.scheduler, Pace.WALL)
        async with Server({emulator.serial: station}, lambda _: None) as server:
            port = await server.listen_usbredir(Exported(1, 1, emulator.usb, station), "127.0.0.1", 0)
            qemu = await asyncio.create_subprocess_exec(
                "timeout", "--signal=KILL", str(PATIENCE), "qemu-system-x86_64", "-accel", "tcg", "-m", "64",
                "-nodefaults", "-no-user-config", "-display", "none", "-device", "usb-ehci,id=ehci",
                "-chardev", f"socket,id=redir,host=127.0.0.1,port={port}",
                "-device", "usb-redir,chardev=redir,bus=ehci.0,debug=4",
                stdout=PIPE, stderr=STDOUT,
            )  # fmt: skip
            said = ""
            assert qemu.stdout
            async for line in qemu.stdout:
                said += line.decode()
                if re.search(r"ctrl-in status 0 len 116", said):
                    break
            qemu.terminate()
            await qemu.wait()
            return said

    said = asyncio.run(run())
    assert "attaching high speed device 1209:0001 version 0.10 class ef" in said
    assert "reset device" in said
    assert re.search(r"ctrl-in status 0 len 116", said), said
