"""phasewire's own streaming: to an emulated device in this process by pyusb, and to one in a process of its own.

``phasewire emulate`` is that process, in which the device's time is the wall clock's. It serves a UART over TCP, at the
highest rate that the specification reckons with, and USB/IP.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import cycle
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from phasewire import Pulses
from phasewire.host.streaming.device import Device, open_device
from phasewire.host.transports.serial_line import BLOCK_FRAME_BYTES
from phasewire.protocol import PulseFrames
from phasewire.protocol.board import CARRIER_HZ, CHANNELS
from phasewire.protocol.framing import UART_BITS_PER_BYTE
from throughput import Entry, Streamed, Task, Way, main
from usbip_line import by_usbip, served

sys.path.append(str(Path(__file__).resolve().parents[1]))
from told_apart import Bus, told_apart

PHASES, WIDTHS = 100, 26
BAUD = 12_000_000
LINE_RATE = BAUD // UART_BITS_PER_BYTE // BLOCK_FRAME_BYTES
WATCHDOG_SECONDS = 60.0
"""A busy machine is no failure."""

Sender = Callable[[Device, float], int]


@contextmanager
def by_uart() -> Iterator[Device]:
    """Such a device, by its UART over TCP."""
    with (
        served("--serial=tcp", f"--baud={BAUD}") as (found, _),
        open_device(f"{found['devices'][0]['serial_line']}?baud={BAUD}") as device,
    ):
        yield device


def measured(sender: Sender, device: Device, seconds: float, bus: Bus | None = None) -> Streamed:
    """Send for about so long."""
    device.set_watchdog(WATCHDOG_SECONDS)
    if bus is not None:
        bus.forget()
    wall, processor = perf_counter(), process_time()
    updates = sender(device, seconds)
    wall, processor = perf_counter() - wall, process_time() - processor
    return Streamed(updates, wall, processor, None if bus is None else processor - bus.seconds)


def send_by_uart(sender: Sender, seconds: float) -> Streamed:
    """Send to a device in another process, by its UART."""
    with by_uart() as device:
        return measured(sender, device, seconds)


def send_by_usbip(sender: Sender, seconds: float) -> Streamed:
    """Send to a device in another process, by USB/IP."""
    with by_usbip() as (device, _):
        return measured(sender, device, seconds)


def send_here(sender: Sender, seconds: float) -> Streamed:
    """Send to a device in this process."""
    with told_apart() as (device, bus):
        return measured(sender, device, seconds, bus)


def enter(task: Task) -> Entry:
    """One frame after the other, and a stream at the highest rate, over both lines."""
    phase, width = task.random(CHANNELS, PHASES, 1), task.random(CHANNELS, WIDTHS, 2)
    pulses = [Pulses(*frame) for frame in zip(phase, width, strict=True)]

    def show(device: Device, seconds: float) -> int:
        sent, end = 0, perf_counter() + seconds
        for frame in cycle(pulses):
            if perf_counter() >= end:
                break
            device.show(frame)
            sent += 1
        return sent

    def stream(rate: int, device: Device, seconds: float) -> int:
        shape = (round(rate * seconds), CHANNELS)
        report = device.stream(PulseFrames(np.resize(phase, shape), np.resize(width, shape)), rate)
        if report.accepted != shape[0]:
            raise RuntimeError(f"{shape[0]} frames were sent, of which {report}")
        return shape[0]

    full = partial(stream, CARRIER_HZ)
    return Entry(
        CHANNELS,
        [
            Way("UART over TCP: show, one after the other", True, partial(send_by_uart, show)),
            Way("UART over TCP: stream", True, partial(send_by_uart, partial(stream, LINE_RATE))),
            Way("USB/IP: show, one after the other", True, partial(send_by_usbip, show)),
            Way("USB/IP: stream", True, partial(send_by_usbip, full)),
            Way("pyusb: show, one after the other", False, partial(send_here, show)),
            Way("pyusb: stream", False, partial(send_here, full)),
        ],
        [
            "Pulses come from NumPy arrays of phases and widths. Its emulator puts every change on the outputs' time "
            "line, in the device's time.",
            f"The UART has {BAUD / 1e6:g} Mbaud, in the emulator's time too, so that it carries at most {LINE_RATE:,} "
            f"updates per second, whatever the computer; by USB/IP a device takes {CARRIER_HZ:,}. The benchmark speaks "
            "USB/IP itself, which is usually a kernel's work.",
            "In one process everything is done by one thread; the host's time is what is spent outside the calls of "
            "the bus, and the rate of the host alone is one over that.",
        ],
    )


if __name__ == "__main__":
    main(enter)
