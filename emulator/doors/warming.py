"""Compile and load everything before a host waits: a device's first stream would take a second."""

from __future__ import annotations

from ...protocol.blocks import Block, NoOp, Update, pack
from ...protocol.board import CHANNELS, CYCLES_PER_MS
from ...protocol.codes import REQUEST_TYPE_OUT, Request, StandardRequest
from ...protocol.enumeration import CONFIGURATION_VALUE, ENDPOINT_OUT
from ...protocol.pulses import Pulses
from ...protocol.requests import Setup
from ..machine import Emulator

__all__ = ["load_kernels"]

SETTLING_PERIODS = 100


def load_kernels() -> None:
    """Let a private emulated device take a stream, so that all its kernels are loaded."""
    spare = Emulator()
    usb, scheduler = spare.usb, spare.scheduler
    usb.control(Setup(0, StandardRequest.SET_CONFIGURATION, CONFIGURATION_VALUE, 0, 0))
    usb.control(Setup(REQUEST_TYPE_OUT, Request.ENABLE, 0, 0, 0))
    usb.bulk_out(ENDPOINT_OUT, pack(Block(NoOp(), 0, restart=True)))
    spare.run(SETTLING_PERIODS)
    stream = b"".join(pack(Block(Update(Pulses.silent(CHANNELS)), number)) for number in (1, 2))
    usb.stream_out(ENDPOINT_OUT, memoryview(stream), scheduler.now, scheduler.now + CYCLES_PER_MS)
