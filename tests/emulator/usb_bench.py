"""A USB device on the bench, with stand-ins for firmware and controller that note their calls."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from phasewire.emulator.door import Door, Stall
from phasewire.emulator.interfaces.usb_device import UsbDevice
from phasewire.emulator.scheduler import Scheduler
from phasewire.emulator.trace import Tracer
from phasewire.protocol.enumeration import HIGH_SPEED, Speed
from phasewire.protocol.requests import Setup

SET_CONFIGURATION = Setup(0x00, 9, 1, 0, 0)
MILLISECOND = 400_000
"""In core cycles of 2.5 ns."""


@dataclass
class Controller:
    """Acknowledges blocks with their numbers, in the order in which they come."""

    told: list[str] = field(default_factory=list)
    blocks: list[bytes] = field(default_factory=list)
    doors: list[Door] = field(default_factory=list)
    waiters: list[Callable[[], None]] = field(default_factory=list)
    can_accept: bool = True
    can_detach: bool = True

    def attach(self, door: Door) -> None:
        self.doors.append(door)

    def await_room(self, waiter: Callable[[], None]) -> None:
        self.waiters.append(waiter)

    def accept(self, packet: bytes, door: Door) -> None:
        door.acknowledge(ack(len(self.blocks)))
        self.blocks.append(packet)

    def take(self, packets: NDArray[np.uint8], began: int, deadline: int, door: Door) -> tuple[int, int]:
        return 0, began

    def request(self, setup: Setup, data: bytes, door: Door) -> bytes:
        self.told.append(f"request {setup.request}")
        if setup.request == 0x77:
            raise Stall("unknown")
        return bytes(64)

    def new_session(self, door: Door) -> None:
        self.told.append("new session")

    def suspend(self) -> None:
        self.told.append("suspend")

    def resume(self) -> None:
        self.told.append("resume")

    def detach(self, door: Door) -> bool:
        self.told.append("detach")
        return self.can_detach

    def host_arrived(self) -> None:
        self.told.append("host arrived")


@dataclass
class Line:
    """Sends what is put into `output`."""

    told: list[str] = field(default_factory=list)
    received: bytes = b""
    output: deque[int] = field(default_factory=deque)
    can_receive: bool = True

    def receive(self, data: bytes) -> None:
        self.received += data

    def take(self, room: int) -> bytes:
        return bytes(self.output.popleft() for _ in range(min(room, len(self.output))))

    def open(self) -> None:
        self.told.append("open")

    def hang_up(self) -> None:
        self.told.append("hang up")


@dataclass
class Upgrade:
    """Boots at every bus reset that counts."""

    requests: list[Setup] = field(default_factory=list)

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        self.requests.append(setup)
        return bytes([2])

    def bus_reset(self, configured: bool) -> bool:
        return configured


class Bench:
    """A device that has come up, and its stand-ins."""

    def __init__(self, speed: Speed = HIGH_SPEED) -> None:
        self.scheduler = Scheduler()
        self.controller = Controller()
        self.line = Line()
        self.upgrade = Upgrade()
        self.restarts = 0
        self.usb = UsbDevice(
            self.scheduler,
            "BENCH-1",
            speed=speed,
            enter_dfu=lambda: self.upgrade,
            restart=self._restart,
            tracer=Tracer(),
        )
        self.usb.connect(self.controller, self.line, (1, 2, 3))

    @property
    def door(self) -> Door:
        """The door that the controller notifies."""
        (door,) = self.controller.doors
        return door

    def _restart(self) -> None:
        self.restarts += 1

    def run_ms(self, milliseconds: float) -> None:
        """Let time pass."""
        self.scheduler.run_until(self.scheduler.now + round(milliseconds * MILLISECOND))


def configured(speed: Speed = HIGH_SPEED) -> Bench:
    """A device that a host has just configured; the notes so far are deleted."""
    bench = Bench(speed)
    bench.usb.control(SET_CONFIGURATION)
    bench.controller.told.clear()
    bench.line.told.clear()
    return bench


def ack(number: int) -> bytes:
    """A record of 32 bytes that has a number."""
    return b"PA" + number.to_bytes(30, "little")


def status(number: int) -> bytes:
    """A record of 64 bytes that has a number."""
    return b"PS" + number.to_bytes(62, "little")
