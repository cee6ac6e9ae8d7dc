"""A device that gives and takes as many bytes as a host wants, for the kernel's own tests of USB (usbtest).

The emulated board gives bytes only as answers. This device replaces it if a test needs a source of bytes, a
buffer that can be written and read, or endpoints that answer NAK. All else is the project's: standard requests
(`UsbDevice`), the bus and the USB/IP server. It has the ids of Linux's gadget zero, because usbtest runs its cases of
control writes and of interrupt endpoints for known ids only.

``python source_sink.py FILE high|full`` serves it and writes its TCP port to FILE.
"""

from __future__ import annotations

import asyncio
import json
import sys
from dataclasses import replace
from pathlib import Path

from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.doors.serving import Server
from phasewire.emulator.doors.station import Pace, Station
from phasewire.emulator.doors.usbip_session import Exported
from phasewire.emulator.interfaces.usb_device import UsbDevice
from phasewire.emulator.interfaces.usb_functions import FirmwareUpgrade, UsbFunction
from phasewire.emulator.scheduler import Scheduler
from phasewire.emulator.trace import Tracer
from phasewire.protocol.codes import DescriptorType
from phasewire.protocol.descriptors import (
    Configuration,
    Endpoint,
    Interface,
    OtherSpeedConfiguration,
    encode,
)
from phasewire.protocol.enumeration import CONFIGURATION_VALUE, FULL_SPEED, HIGH_SPEED, Enumeration, Speed, run_time
from phasewire.protocol.requests import Setup

VENDOR, PRODUCT = 0x0525, 0xA4A0
BULK_OUT, BULK_IN, INTERRUPT_OUT, INTERRUPT_IN = 0x01, 0x81, 0x02, 0x82
WRITE = (0x40, 0x5B)
"""Type and number of the request that fills the buffer; `READ` gives it back."""
READ = (0xC0, 0x5C)
HOLD = (0x40, 0x5D)
"""The bulk endpoints answer NAK from now on if the value is 1, and not any more if it is 0."""

BULK, INTERRUPT = 2, 3
INTERRUPT_BYTES = 64
MODULUS = 63  # usbtest's pattern 1: byte i of a packet is i mod 63
USB_2_0 = 0x0200  # without a BOS; usbtest reads the device qualifier of such devices


class SourceSinkFunction(UsbFunction):
    """The endpoints: they send packets of one pattern, and take packets of this pattern or zeros.

    A packet with other bytes is answered with STALL, so that the kernel sees a broken write.
    """

    def __init__(self, packet_bytes: int) -> None:
        self.holds = False
        self._pattern = bytes(each % MODULUS for each in range(packet_bytes))
        self._expected = (bytes(packet_bytes), self._pattern * 2)  # a list of buffers may begin in mid-pattern
        self.outs = {BULK_OUT: self._take, INTERRUPT_OUT: self._take}
        self.ins = {BULK_IN: self._give, INTERRUPT_IN: lambda: self._pattern[:INTERRUPT_BYTES]}

    def _take(self, packet: bytes) -> Handshake:
        if self.holds:
            return Handshake.NAK
        return Handshake.ACK if any(packet in each for each in self._expected) else Handshake.STALL

    def _give(self) -> bytes | Handshake:
        return Handshake.NAK if self.holds else self._pattern

    def request(self, setup: Setup, _data: bytes) -> bytes:
        """Refuse every request to the interface."""
        raise Stall(f"request {setup.request} to the interface")


class WithoutBos(Enumeration):
    """The descriptors of a device of USB 2.0 itself, which has no BOS."""

    def find(self, kind: int, index: int, language: int) -> bytes | None:
        """The answer to GET_DESCRIPTOR, or None."""
        return None if kind == DescriptorType.BOS else super().find(kind, index, language)


class SourceSink(UsbDevice):
    """The device.

    Parameters
    ----------
    scheduler : Scheduler
        Its time.
    speed : Speed
        Speed of the bus.
    """

    def __init__(self, scheduler: Scheduler, speed: Speed) -> None:
        super().__init__(
            scheduler, "SOURCE-SINK", speed=speed, enter_dfu=_no_dfu, restart=lambda: None, tracer=Tracer()
        )
        self._source_sink = SourceSinkFunction(speed.bulk_bytes)
        self._buffer = b""
        self._pull_up(describe(speed), {0: self._source_sink})

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a request to the device's own buffer, or a standard request."""
        kind = setup.request_type, setup.request
        if kind == READ:
            return self._buffer[: setup.length]
        if kind == WRITE:
            self._buffer = data
        elif kind == HOLD:
            self._source_sink.holds = bool(setup.value)
        else:
            return super().control(setup, data)
        return b""


def describe(speed: Speed) -> Enumeration:
    """Its descriptors."""
    other = FULL_SPEED if speed == HIGH_SPEED else HIGH_SPEED
    named = run_time((1, 0, 0), "source and sink", "SOURCE-SINK")
    return WithoutBos(
        device=replace(
            named.device, bcdUSB=USB_2_0, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0, idVendor=VENDOR,
            idProduct=PRODUCT,
        ),
        configuration=_configuration(Configuration, speed),
        other_speed=_configuration(OtherSpeedConfiguration, other),
        ms_os=b"",
        strings=named.strings,
    )  # fmt: skip


def _configuration(head: type[Configuration], speed: Speed) -> bytes:
    endpoints = [Endpoint(address, BULK, speed.bulk_bytes, 1) for address in (BULK_OUT, BULK_IN)]
    endpoints += [Endpoint(address, INTERRUPT, INTERRUPT_BYTES, 1) for address in (INTERRUPT_OUT, INTERRUPT_IN)]
    body = encode(Interface(0, 0, len(endpoints), 0xFF, 0, 0, 0), *endpoints)
    return head(9 + len(body), 1, CONFIGURATION_VALUE, 0, 0xC0, 50).encode() + body


def _no_dfu() -> FirmwareUpgrade:
    raise AssertionError("it has no firmware")


async def serve(where: Path, speed: Speed) -> None:
    """Serve it until the process is ended."""
    station = Station(Scheduler(), Pace.WALL)
    async with Server({"SOURCE-SINK": station}, print) as server:
        device = SourceSink(station.scheduler, speed)
        port = await server.listen_usbip({"1-1": Exported(1, 1, device, station)}, "127.0.0.1", 0)
        where.write_text(json.dumps({"usbip": {"port": port}}))
        await server.serve()


if __name__ == "__main__":
    asyncio.run(serve(Path(sys.argv[1]), FULL_SPEED if sys.argv[2:] == ["full"] else HIGH_SPEED))
