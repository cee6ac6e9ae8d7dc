"""The bus between a host's transfers and a device: which packet goes when, in device time.

A host controller in small. Transfers come in as a client submits them and go packet by packet; one that is answered
with NAK waits, and is tried again when something has happened in the device. The bus carries what a real one can: 13
packets of 512 bytes in a microframe, or 19 of 64 in a frame, and one control request in either. An interrupt endpoint
is asked like a bulk endpoint, not only once in its interval.

It knows no protocol by which transfers travel, and no clock but the device's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise
from typing import NamedTuple, Protocol

from ...protocol.board import CYCLES_PER_MS
from ...protocol.descriptors import Endpoint, descriptors
from ...protocol.enumeration import FULL_SPEED, HIGH_SPEED, Enumeration, Speed
from ...protocol.requests import DIRECTION_IN, Setup
from ...protocol.timing import MICROFRAME_CYCLES, PACKET_CYCLES
from ..door import Handshake, Stall
from ..scheduler import Scheduler

__all__ = ["Outcome", "Peripheral", "Transfer", "UsbBus"]

_FRAME_CYCLES = CYCLES_PER_MS
_PACKETS_PER_FRAME = 19  # USB 2.0, table 5-9


class _Times(NamedTuple):
    """How many core cycles the bus is taken for."""

    packet: int
    control: int


_TIMES = {
    HIGH_SPEED: _Times(PACKET_CYCLES, MICROFRAME_CYCLES),
    FULL_SPEED: _Times(_FRAME_CYCLES // _PACKETS_PER_FRAME, _FRAME_CYCLES),
}

STREAM_CYCLES = CYCLES_PER_MS
"""How long packets are sent at once before the others have their turn: a millisecond."""

JOINED_BYTES = 1 << 14
"""Of transfers that are sent together, at most: as much as a device's queue takes at once."""

_CONTROL = 0
"""The queue of the control endpoint, in both directions."""


class Peripheral(Protocol):
    """What the bus needs of a device."""

    @property
    def attached(self) -> bool:
        """Whether it shows itself on the bus."""

    @property
    def generation(self) -> int:
        """How often it has attached itself; another number means another device to a host."""

    @property
    def speed(self) -> Speed:
        """Its speed."""

    @property
    def enumeration(self) -> Enumeration:
        """Its descriptors."""

    @property
    def configuration(self) -> int:
        """The configuration chosen, 0 for none."""

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a request; raises `Stall`."""

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        """Take a packet."""

    def stream_out(self, endpoint: int, data: memoryview, began: int, deadline: int) -> tuple[int, int]:
        """Take many packets at once, if that can be: how many bytes, and when the last had arrived."""

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        """Give a packet."""

    def reset(self) -> None:
        """The bus was reset."""

    def plug(self) -> None:
        """The cable was plugged in."""

    def unplug(self) -> None:
        """The cable was unplugged."""


class Outcome(IntEnum):
    """How a transfer ended, with Linux's numbers."""

    DONE = 0
    GONE = -19  # ENODEV
    STALLED = -32  # EPIPE
    MALFORMED = -71  # EPROTO
    OVERFLOW = -75  # EOVERFLOW
    TAKEN_BACK = -104  # ECONNRESET
    SHORT = -121  # EREMOTEIO


@dataclass(eq=False, slots=True)
class Transfer:
    """Bytes to or from one endpoint.

    Parameters
    ----------
    endpoint : int
        Address, with the bit of its direction.
    length : int
        Bytes to be sent, or room for those to be received.
    data : bytes
        What is to be sent.
    setup : Setup
        The setup stage, which counts for the control endpoint alone.
    zero_packet, short_not_ok : bool
        Whether an empty packet follows where the last one sent is full; whether it is an error to receive less than
        there is room for.
    on_end : callable
        Called once with the transfer and its `Outcome`, unless the transfer is taken back before.
    """

    endpoint: int
    length: int
    data: bytes
    setup: Setup
    zero_packet: bool
    short_not_ok: bool
    on_end: Callable[[Transfer, Outcome], None]
    sent: int = 0
    received: bytearray = field(default_factory=bytearray)

    @property
    def is_in(self) -> bool:
        """Whether it goes to the host."""
        return bool(self.endpoint & DIRECTION_IN)

    @property
    def is_control(self) -> bool:
        """Whether it is a request to the control endpoint."""
        return self.endpoint & ~DIRECTION_IN == _CONTROL

    @property
    def queue(self) -> int:
        """Which queue it waits in: its endpoint's address, or that of the control endpoint for both directions."""
        return _CONTROL if self.is_control else self.endpoint


class UsbBus:
    """The bus between one host and one device, from one attachment of the device to the next.

    Parameters
    ----------
    device : Peripheral
        The device.
    scheduler : Scheduler
        Its time.

    Attributes
    ----------
    last_word : int or None
        When the device last took something, in core cycles.
    """

    def __init__(self, device: Peripheral, scheduler: Scheduler) -> None:
        self._device = device
        self._scheduler = scheduler
        self._times = _TIMES[device.speed]
        self._packet_bytes = {
            each.bEndpointAddress: each.wMaxPacketSize
            for each in descriptors(device.enumeration.configuration)
            if isinstance(each, Endpoint)
        }
        self._queues: dict[int, deque[Transfer]] = {}
        self.last_word: int | None = None
        self._next_end = 0  # when the next packet or request will be over
        self._waits = True  # for something to happen in the device

    @property
    def presses(self) -> bool:
        """Whether something may be carried as soon as the bus is free."""
        return not self._waits

    @property
    def stuck(self) -> bool:
        """Whether something waits to go to the device, which answers NAK."""
        return self._waits and any(not queue[0].is_in for queue in self._queues.values())

    def submit(self, transfer: Transfer) -> None:
        """Put a transfer behind the others of its endpoint."""
        self._queues.setdefault(transfer.queue, deque()).append(transfer)
        if self._waits:
            self._waits = False
            self._next_end = max(self._next_end, self._scheduler.now + self._cost())

    def cancel(self, transfer: Transfer) -> None:
        """Take a transfer back that has not ended. What has been carried of it stays carried."""
        queue = self._queues[transfer.queue]
        queue.remove(transfer)
        if not queue:
            del self._queues[transfer.queue]

    def next_time(self, event: int | None) -> int | None:
        """When there is something to carry.

        Parameters
        ----------
        event : int or None
            When something happens in the device next.
        """
        if not self._queues:
            return None
        if not self._waits:
            return self._next_end
        return None if event is None else max(event, self._next_end)

    def run(self) -> None:
        """Carry one request or packet, or a stream of packets, if the bus is free."""
        if self._queues and self._next_end <= self._scheduler.now:
            ended = self._carry_one()
            self._waits = ended is None or not self._queues
            self._next_end = (self._scheduler.now if ended is None else ended) + self._cost()

    def _cost(self) -> int:
        return self._times.control if _CONTROL in self._queues else self._times.packet

    def _carry_one(self) -> int | None:
        """Carry a request, or something of the first endpoint that does not answer NAK; when it had arrived."""
        now = self._scheduler.now
        if _CONTROL in self._queues:
            self._request(self._queues[_CONTROL][0])
            self.last_word = now
            return now
        for endpoint, queue in self._queues.items():
            ended = self._receive_many(queue) if queue[0].is_in else self._stream(queue) or self._send(queue[0])
            if ended is not None:
                if endpoint in self._queues:
                    self._queues[endpoint] = self._queues.pop(endpoint)  # behind the others: they take turns
                return ended
        return None

    def _request(self, transfer: Transfer) -> None:
        setup = transfer.setup
        if setup.length != transfer.length or (setup.length and setup.is_in != transfer.is_in):
            self._end(transfer, Outcome.MALFORMED)
            return
        try:
            answer = self._device.control(setup, transfer.data)
        except Stall:
            self._end(transfer, Outcome.STALLED)
            return
        transfer.sent = len(transfer.data)
        self._take(transfer, answer, ends=True)

    def _stream(self, queue: deque[Transfer]) -> int | None:
        """Send many packets at once, which is the same and faster, where the device can take them so.

        Whole packets of the transfers that follow go with those of the first, for a client may send each by itself.
        """
        now, endpoint = self._scheduler.now, queue[0].endpoint
        together = self._joined(queue)
        rest = memoryview(queue[0].data)[queue[0].sent :]
        if len(together) > 1:
            rest = memoryview(b"".join([rest, *(each.data for each in together[1:])]))
        taken, ended = self._device.stream_out(endpoint, rest, now - self._times.packet, now + STREAM_CYCLES)
        if not taken:
            return None
        self.last_word = ended
        for transfer in together:
            part = min(taken, transfer.length - transfer.sent)
            transfer.sent += part
            taken -= part
            if part and transfer.sent == transfer.length and not transfer.zero_packet:
                self._end(transfer, Outcome.DONE)
        return ended

    def _joined(self, queue: deque[Transfer]) -> list[Transfer]:
        """The first transfers of an endpoint whose packets follow each other without an end in between."""
        together, size, room = [queue[0]], self._size(queue[0]), JOINED_BYTES - queue[0].length
        for before, after in pairwise(queue):
            room -= after.length
            if before.zero_packet or before.length % size or not (before.length and after.length) or room < 0:
                break
            together.append(after)
        return together

    def _send(self, transfer: Transfer) -> int | None:
        size = self._size(transfer)
        packet = transfer.data[transfer.sent : transfer.sent + size]
        answer = self._device.bulk_out(transfer.endpoint, packet)
        if answer is Handshake.NAK:
            return None
        if answer is Handshake.STALL:
            self._end(transfer, Outcome.STALLED)
        else:
            transfer.sent += len(packet)
            self.last_word = self._scheduler.now
            if len(packet) < size or (transfer.sent == transfer.length and not transfer.zero_packet):
                self._end(transfer, Outcome.DONE)
        return self._scheduler.now

    def _receive_many(self, queue: deque[Transfer]) -> int | None:
        """Receive what the device has, for as long as a stream the other way may take.

        One packet for each stream would hold the streams back: it brings the acknowledgements of 16 blocks.
        """
        ended = None
        for packets in range(STREAM_CYCLES // self._times.packet):
            if not queue or not self._receive(queue[0]):
                break
            ended = self._scheduler.now + packets * self._times.packet
        return ended

    def _receive(self, transfer: Transfer) -> bool:
        answer = self._device.bulk_in(transfer.endpoint)
        if answer is Handshake.NAK:
            return False
        if isinstance(answer, bytes):
            self._take(transfer, answer, ends=len(answer) < self._size(transfer))
        else:
            self._end(transfer, Outcome.STALLED)
        return True

    def _take(self, transfer: Transfer, data: bytes, ends: bool) -> None:
        if len(transfer.received) + len(data) > transfer.length:
            self._end(transfer, Outcome.OVERFLOW)
            return
        transfer.received += data
        missing = transfer.is_in and len(transfer.received) < transfer.length
        if ends or not missing:
            self._end(transfer, Outcome.SHORT if missing and transfer.short_not_ok else Outcome.DONE)

    def _size(self, transfer: Transfer) -> int:
        return self._packet_bytes.get(transfer.endpoint, self._device.speed.bulk_bytes)

    def _end(self, transfer: Transfer, outcome: Outcome) -> None:
        self.cancel(transfer)
        transfer.on_end(transfer, outcome)
