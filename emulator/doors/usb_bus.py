"""The bus between a host's transfers and a device: the order and the times of packets, in device time.

A simple host controller. Clients submit transfers, which go packet by packet; a transfer that gets NAK waits, and is
tried again after an event in the device. The bus has a real one's capacity: 13 packets of 512 bytes in a microframe, or
19 of 64 in a frame, and one control request in either. An interrupt endpoint is polled like a bulk endpoint, not only
once in its interval.

It knows only the device's clock, and not the protocol that carries the transfers.
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

__all__ = ["Peripheral", "Transfer", "TransferOutcome", "UsbBus"]

_FRAME_CYCLES = CYCLES_PER_MS
_PACKETS_PER_FRAME = 19  # USB 2.0, table 5-9


class _Times(NamedTuple):
    """How many core cycles the bus is busy."""

    packet: int
    control: int


_TIMES = {
    HIGH_SPEED: _Times(PACKET_CYCLES, MICROFRAME_CYCLES),
    FULL_SPEED: _Times(_FRAME_CYCLES // _PACKETS_PER_FRAME, _FRAME_CYCLES),
}

STREAM_CYCLES = CYCLES_PER_MS
"""How long packets are sent at once before others get their turn: a millisecond."""

JOINED_BYTES = 1 << 14
"""The most transfers that are sent together: as many as a device's queue takes at once."""

_CONTROL = 0
"""The queue of the control endpoint, in both directions."""


class Peripheral(Protocol):
    """The part of a device that the bus needs."""

    @property
    def attached(self) -> bool:
        """Whether it is visible on the bus."""

    @property
    def generation(self) -> int:
        """The number of its attachments; a new number means a new device to a host."""

    @property
    def speed(self) -> Speed:
        """Its speed."""

    @property
    def enumeration(self) -> Enumeration:
        """Its descriptors."""

    @property
    def configuration(self) -> int:
        """The selected configuration, 0 for none."""

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a request; raises `Stall`."""

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        """Take a packet."""

    def stream_out(self, endpoint: int, data: memoryview, began: int, deadline: int) -> tuple[int, int]:
        """Take many packets at once, if possible: returns how many bytes, and when the last had arrived."""

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        """Give a packet."""

    def reset(self) -> None:
        """The bus was reset."""

    def plug(self) -> None:
        """The cable was plugged in."""

    def unplug(self) -> None:
        """The cable was unplugged."""


class TransferOutcome(IntEnum):
    """The result of a transfer, with Linux's numbers."""

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
        The data to send.
    setup : Setup
        The setup stage, for the control endpoint only.
    zero_packet, short_not_ok : bool
        Whether an empty packet follows if the last one sent is full; whether it is an error to receive less than the
        room.
    on_end : callable
        A function that is called once with the transfer and its `TransferOutcome`, unless it is cancelled before.
    """

    endpoint: int
    length: int
    data: bytes
    setup: Setup
    zero_packet: bool
    short_not_ok: bool
    on_end: Callable[[Transfer, TransferOutcome], None]
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
        """The queue in which it waits: its endpoint's address, or that of the control endpoint for both directions."""
        return _CONTROL if self.is_control else self.endpoint


class UsbBus:
    """The bus between one host and one device, from one attachment of the device to the next.

    Attributes
    ----------
    last_word : int or None
        When the device last took data, in core cycles.
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
        self._next_end = 0  # the end of the present packet or request
        self._waits = True  # for an event in the device

    @property
    def presses(self) -> bool:
        """Whether a transfer can be carried as soon as the bus is free."""
        return not self._waits

    @property
    def stuck(self) -> bool:
        """Whether data wait for the device, which answers NAK."""
        return self._waits and any(not queue[0].is_in for queue in self._queues.values())

    def submit(self, transfer: Transfer) -> None:
        """Queue a transfer after the others of its endpoint."""
        self._queues.setdefault(transfer.queue, deque()).append(transfer)
        if self._waits:
            self._waits = False
            self._next_end = max(self._next_end, self._scheduler.now + self._cost())

    def cancel(self, transfer: Transfer) -> None:
        """Cancel a transfer that has not ended. Its carried part stays carried."""
        queue = self._queues[transfer.queue]
        queue.remove(transfer)
        if not queue:
            del self._queues[transfer.queue]

    def next_time(self, event: int | None) -> int | None:
        """The time of the next packet.

        Parameters
        ----------
        event : int or None
            The time of the device's next event.
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
        """Carry a request, or a packet of the first endpoint that does not answer NAK; returns when it had arrived."""
        now = self._scheduler.now
        if _CONTROL in self._queues:
            self._request(self._queues[_CONTROL][0])
            self.last_word = now
            return now
        for endpoint, queue in self._queues.items():
            ended = self._receive_many(queue) if queue[0].is_in else self._stream(queue) or self._send(queue[0])
            if ended is not None:
                if endpoint in self._queues:
                    self._queues[endpoint] = self._queues.pop(endpoint)  # after the others: they take turns
                return ended
        return None

    def _request(self, transfer: Transfer) -> None:
        setup = transfer.setup
        if setup.length != transfer.length or (setup.length and setup.is_in != transfer.is_in):
            self._end(transfer, TransferOutcome.MALFORMED)
            return
        try:
            answer = self._device.control(setup, transfer.data)
        except Stall:
            self._end(transfer, TransferOutcome.STALLED)
            return
        transfer.sent = len(transfer.data)
        self._take(transfer, answer, ends=True)

    def _stream(self, queue: deque[Transfer]) -> int | None:
        """Send many packets at once, with the same effect but faster, if the device can take them so.

        Whole packets of the following transfers go with those of the first, because a client may send each separately.
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
                self._end(transfer, TransferOutcome.DONE)
        return ended

    def _joined(self, queue: deque[Transfer]) -> list[Transfer]:
        """The first transfers of an endpoint whose packets follow each other without a short one in between."""
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
            self._end(transfer, TransferOutcome.STALLED)
        else:
            transfer.sent += len(packet)
            self.last_word = self._scheduler.now
            if len(packet) < size or (transfer.sent == transfer.length and not transfer.zero_packet):
                self._end(transfer, TransferOutcome.DONE)
        return self._scheduler.now

    def _receive_many(self, queue: deque[Transfer]) -> int | None:
        """Receive the device's data, for as long as a stream in the other direction may take.

        One packet for each stream would slow the streams down: it holds the acknowledgements of 16 blocks.
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
            self._end(transfer, TransferOutcome.STALLED)
        return True

    def _take(self, transfer: Transfer, data: bytes, ends: bool) -> None:
        if len(transfer.received) + len(data) > transfer.length:
            self._end(transfer, TransferOutcome.OVERFLOW)
            return
        transfer.received += data
        missing = transfer.is_in and len(transfer.received) < transfer.length
        if ends or not missing:
            self._end(transfer, TransferOutcome.SHORT if missing and transfer.short_not_ok else TransferOutcome.DONE)

    def _size(self, transfer: Transfer) -> int:
        return self._packet_bytes.get(transfer.endpoint, self._device.speed.bulk_bytes)

    def _end(self, transfer: Transfer, outcome: TransferOutcome) -> None:
        self.cancel(transfer)
        transfer.on_end(transfer, outcome)
