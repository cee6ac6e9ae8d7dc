"""Emulators as a host finds them on a bus."""

from __future__ import annotations

from dataclasses import dataclass, field

from phasewire import Emulator
from phasewire.emulator.door import Handshake
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.enumeration import HIGH_SPEED, Enumeration, Speed
from phasewire.protocol.requests import Setup


class Pluggable:
    """The USB side of an emulator, with what it does not have yet: a plug, an address."""

    def __init__(self, emulator: Emulator) -> None:
        self._usb = emulator.usb
        self.attached = True
        self.generation = 1
        self.speed: Speed = HIGH_SPEED
        self.address = 0

    @property
    def enumeration(self) -> Enumeration:
        return self._usb.enumeration

    @property
    def configuration(self) -> int:
        return self._usb.configuration

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        if (setup.request_type, setup.request) == (0, 5):
            self.address = setup.value
            return b""
        return self._usb.control(setup, data)

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        return self._usb.bulk_out(endpoint, packet)

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        return self._usb.bulk_in(endpoint)

    def reset(self) -> None:
        self._usb.reset()

    def plug(self) -> None:
        self.attached = True
        self.generation += 1

    def unplug(self) -> None:
        self.attached = False


@dataclass
class Machine:
    emulator: Emulator = field(default_factory=Emulator)

    def __post_init__(self) -> None:
        self.usb = Pluggable(self.emulator)

    @property
    def scheduler(self) -> Scheduler:
        return self.emulator.scheduler
