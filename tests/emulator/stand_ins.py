"""Stand-ins for a USB device and a serial line: they do as a test tells them."""

from __future__ import annotations

from collections import deque

from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.enumeration import HIGH_SPEED, Speed, run_time
from phasewire.protocol.requests import Setup


class StandInDevice:
    """It takes packets while it has room, sends those that a test gave it, and notes what happens to it."""

    def __init__(self, speed: Speed = HIGH_SPEED) -> None:
        self.attached = True
        self.generation = 1
        self.speed = speed
        self.enumeration = run_time((1, 2, 3), "stand-in", "S-1", speed)
        self.configuration = 0
        self.room = 10**9
        self.streams: tuple[Scheduler, int] | None = None
        self.taken: list[tuple[int, bytes]] = []
        self.given: dict[int, deque[bytes]] = {}
        self.halted: set[int] = set()
        self.requests: list[tuple[Setup, bytes]] = []
        self.happened: list[str] = []

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        self.requests.append((setup, data))
        if (setup.request_type, setup.request) == (0x80, 6):
            found = self.enumeration.find(*divmod(setup.value, 256), language=setup.index)
            if found is None:
                raise Stall("no such descriptor")
            return found[: setup.length]
        if (setup.request_type, setup.request) == (0x00, 9):
            self.configuration = setup.value
            return b""
        if setup.request_type == 0x41:
            return b""
        raise Stall("unknown")

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        if endpoint in self.halted:
            return Handshake.STALL
        if not self.room:
            return Handshake.NAK
        self.room -= 1
        self.taken.append((endpoint, packet))
        return Handshake.ACK

    def stream_out(self, endpoint: int, data: memoryview, began: int, deadline: int) -> tuple[int, int]:
        """The number of whole packets that it takes at once, in the time of a high-speed bus."""
        if self.streams is None:
            return 0, began
        scheduler, most = self.streams
        packets = min(len(data) // 512, most, (deadline - began) // 3846)
        self.taken += [(endpoint, bytes(data[512 * each : 512 * each + 512])) for each in range(packets)]
        ended = began + 3846 * packets
        scheduler.run_until(max(scheduler.now, ended))
        return 512 * packets, ended

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        if endpoint in self.halted:
            return Handshake.STALL
        queue = self.given.get(endpoint)
        return queue.popleft() if queue else Handshake.NAK

    def give(self, endpoint: int, *packets: bytes) -> None:
        self.given.setdefault(endpoint, deque()).extend(packets)

    def reset(self) -> None:
        self.happened.append("reset")
        self.configuration = 0

    def plug(self) -> None:
        self.happened.append("plug")
        self.attached = True
        self.generation += 1

    def unplug(self) -> None:
        self.happened.append("unplug")
        self.attached = False
        self.configuration = 0


class StandInLine:
    """It echoes what it receives in capitals, unless a test sets another answer."""

    def __init__(self) -> None:
        self.heard = b""
        self.says = b""
        self.hung_up = 0

    @property
    def pending(self) -> int:
        return len(self.says)

    def receive(self, data: bytes) -> None:
        self.heard += data
        self.says += data.upper()

    def take(self, room: int) -> bytes:
        data, self.says = self.says[:room], self.says[room:]
        return data

    def hang_up(self) -> None:
        self.hung_up += 1
        self.says = b""
