"""What the device does on its interfaces: the array, the console, and firmware upgrade at run time and in DFU mode.

A function knows its own requests and packets, and what becomes of them when a session ends. What USB asks of every
device, from descriptors to halts, is in `usb_device`, which calls a function for nothing that USB forbids: no packet of
an endpoint that is halted, no request to an interface before the device is configured.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import CYCLES_PER_MS
from ...protocol.codes import (
    BLOCK_BYTES,
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    DfuRequest,
    DfuState,
    DfuStatus,
)
from ...protocol.dfu import DfuReply
from ...protocol.enumeration import (
    CONSOLE_ENDPOINT_IN,
    CONSOLE_ENDPOINT_NOTIFICATION,
    CONSOLE_ENDPOINT_OUT,
    CONSOLE_INTERFACE,
    ENDPOINT_IN,
    ENDPOINT_OUT,
)
from ...protocol.framing import BAUD
from ...protocol.layout.usb import LINE_CODING
from ...protocol.requests import ConsoleRequest, Setup
from ...protocol.timing import FULL_SPEED_PACKET_CYCLES, PACKET_CYCLES
from ..control.requests import QUEUE_RECORDS
from ..door import Door, Handshake, Stall
from ..scheduler import Scheduler
from ..trace import Tracer

__all__ = [
    "ArrayFunction",
    "ConsoleFunction",
    "ConsoleLine",
    "DfuModeFunction",
    "DfuRunTimeFunction",
    "FirmwareUpgrade",
    "UsbController",
    "UsbFunction",
]

DETACH_CYCLES = 20 * CYCLES_PER_MS
"""From DETACH until the device leaves the bus; clause DFU-002 allows 10 to 1000 ms."""

# Class requests of the console, by interface, type and number, and of DFU, by type and number.
_SET_LINE_CODING = (CONSOLE_INTERFACE, CLASS_REQUEST_TYPE_OUT, ConsoleRequest.SET_LINE_CODING)
_GET_LINE_CODING = (CONSOLE_INTERFACE, CLASS_REQUEST_TYPE_IN, ConsoleRequest.GET_LINE_CODING)
_SET_CONTROL_LINE_STATE = (CONSOLE_INTERFACE, CLASS_REQUEST_TYPE_OUT, ConsoleRequest.SET_CONTROL_LINE_STATE)
_DETACH = (CLASS_REQUEST_TYPE_OUT, DfuRequest.DETACH)
_GETSTATUS = (CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATUS)
_GETSTATE = (CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATE)

_DTR = 1 << 0  # of wValue of SET_CONTROL_LINE_STATE (PSTN 1.2, table 18)
_115200_8N1 = bytes(LINE_CODING.build({"dwDTERate": BAUD, "bCharFormat": 0, "bParityType": 0, "bDataBits": 8}))


TakePackets = Callable[[memoryview, int, int], tuple[int, int]]


class UsbFunction:
    """What answers on one or more interfaces.

    Attributes
    ----------
    outs : mapping of int to callable
        What takes a packet from the host, for each OUT endpoint: ACK, or NAK and the packet comes again.
    ins : mapping of int to callable
        What gives the next packet, which may be empty, for each IN endpoint; NAK if there is none.
    streams : mapping of int to callable
        What takes many packets at once, for OUT endpoints that can; see `UsbDevice.stream_out`.
    """

    outs: Mapping[int, Callable[[bytes], Handshake]] = MappingProxyType({})
    ins: Mapping[int, Callable[[], bytes | Handshake]] = MappingProxyType({})
    streams: Mapping[int, TakePackets] = MappingProxyType({})

    def request(self, setup: Setup, data: bytes, /) -> bytes:
        """Carry out a class or vendor request to an interface of it.

        Raises
        ------
        Stall
            If it does not know the request, or not now.
        """
        raise NotImplementedError

    def configure(self, configuration: int, /) -> None:
        """SET_CONFIGURATION begins a session, or ends the last one."""

    def bus_reset(self) -> None:
        """The bus was reset: the device is not configured."""
        self.configure(0)

    def set_interface(self) -> None:
        """SET_INTERFACE of an interface of it."""

    def clear_halt(self, endpoint: int, /) -> None:
        """CLEAR_FEATURE of an endpoint of it, halted or not."""

    def suspend(self) -> None:
        """The bus fell silent."""

    def resume(self) -> None:
        """The bus came to life again, and had kept its voltage."""

    def unplug(self) -> None:
        """The voltage of the bus is gone, and the configuration with it."""


def unknown(setup: Setup) -> Stall:
    """The answer to a request that nobody here knows (clause USB-004)."""
    return Stall(
        f"request 0x{setup.request:02x} of type 0x{setup.request_type:02x} with value {setup.value}, index "
        f"{setup.index} and length {setup.length} is unknown"
    )


class _Packets:
    """What waits for the host, cut into packets; after a last one that is full comes an empty one (clause USB-019)."""

    def __init__(self, take: Callable[[int], bytes], packet_bytes: int) -> None:
        self._take = take
        self._packet_bytes = packet_bytes
        self._goes_on = False

    def next(self) -> bytes | Handshake:
        """The next packet, or NAK."""
        packet = self._take(self._packet_bytes)
        if not packet and not self._goes_on:
            return Handshake.NAK
        self._goes_on = len(packet) == self._packet_bytes
        return packet

    def forget(self) -> None:
        """No transfer is under way any more."""
        self._goes_on = False


class UsbController(Protocol):
    """What the device's USB side needs of the controller."""

    @property
    def can_accept(self) -> bool:
        """Whether the queue has room for another block."""

    def attach(self, door: Door) -> None:
        """Notify a door from now on."""

    def accept(self, packet: bytes, door: Door) -> None:
        """Judge a block of any length and acknowledge it to the door that it came by."""

    def await_room(self, waiter: Callable[[], None]) -> None:
        """Call somebody once the queue has room."""

    def take(self, packets: NDArray[np.uint8], began: int, deadline: int, door: Door) -> tuple[int, int]:
        """Accept updates that arrive back to back, up to anything else; how many, and when the last arrived."""

    def request(self, setup: Setup, data: bytes, door: Door) -> bytes:
        """Carry out a vendor request, or raise `Stall`."""

    def new_session(self, door: Door) -> None:
        """The event BUS_RESET: outputs off, and numbering begins anew (clause STA-002)."""

    def suspend(self) -> None:
        """The event SUSPEND."""

    def resume(self) -> None:
        """The event RESUME."""

    def detach(self, door: Door) -> bool:
        """The event DETACH; False if it has no transition in this state (clause STA-005)."""

    def host_arrived(self) -> None:
        """A host has configured the device: its firmware works (clause FWU-020)."""


class ArrayFunction(UsbFunction, Door):
    """Interface 0: blocks come by 01 OUT, records go by 81 IN, and vendor requests are the controller's."""

    def __init__(self, scheduler: Scheduler, controller: UsbController, packet_bytes: int, tracer: Tracer) -> None:
        self._scheduler = scheduler
        self._controller = controller
        self._tracer = tracer
        self._packet_bytes = packet_bytes
        self._packet_cycles = PACKET_CYCLES if packet_bytes == BLOCK_BYTES else FULL_SPEED_PACKET_CYCLES
        self._part = b""  # of a block that has not ended
        self._records: deque[bytes] = deque()
        self._unasked = b""  # the unsolicited one of them, if any
        self._packets = _Packets(self._take_records, packet_bytes)
        self.outs = {ENDPOINT_OUT: self._take}
        self.ins = {ENDPOINT_IN: self._packets.next}
        if packet_bytes == BLOCK_BYTES:
            self.streams = {ENDPOINT_OUT: self._take_many}
        self._awaits_room = False
        self._adopted = False
        controller.attach(self)

    def acknowledge(self, record: bytes) -> None:
        """Keep an acknowledgement until the host reads it."""
        self._records.append(record)

    def notify(self, record: bytes) -> None:
        """Keep a status record after what waits, instead of an older one (clause ACK-006).

        Nobody can read it while the device is not configured, and then it is dropped.
        """
        if self._unasked:
            self._records.remove(self._unasked)
        self._records.append(record)
        self._unasked = record

    def _take_records(self, room: int) -> bytes:
        """As many of the records that wait as fit (clause ACK-005)."""
        packet = b""
        while self._records and len(packet) + len(self._records[0]) <= room:
            record = self._records.popleft()
            if record is self._unasked:
                self._unasked = b""
            packet += record
        return packet

    def request(self, setup: Setup, data: bytes) -> bytes:
        """Carry out a vendor request (chapter REQ)."""
        if setup.request_type not in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
            raise unknown(setup)
        return self._controller.request(setup, data, self)

    @property
    def _room_for_records(self) -> int:
        return QUEUE_RECORDS - (len(self._records) - bool(self._unasked))

    @property
    def _has_room(self) -> bool:
        if not self._controller.can_accept and not self._awaits_room:
            self._awaits_room = True
            self._controller.await_room(self._stop_waiting)
        return self._controller.can_accept and self._room_for_records > 0

    def _stop_waiting(self) -> None:
        self._awaits_room = False  # the host sends again what was answered with NAK

    def _take_many(self, data: memoryview, began: int, deadline: int) -> tuple[int, int]:
        """Take whole blocks, at high speed, where each is a packet."""
        count = min(len(data) // BLOCK_BYTES, self._room_for_records)
        if count < 2:
            return 0, began
        packets = np.frombuffer(data[: count * BLOCK_BYTES], np.uint8).reshape(count, BLOCK_BYTES)
        taken, ended = self._controller.take(packets, began, deadline, self)
        return taken * BLOCK_BYTES, ended

    def _take(self, packet: bytes) -> Handshake:
        """Take a packet; with its 512th byte, or a short packet, a block ends (clauses USB-017 and USB-018)."""
        if not self._has_room:
            return Handshake.NAK
        now = self._scheduler.now
        self._tracer.span(now - self._packet_cycles, now, "USB", "packet")
        self._part += packet
        ended = len(self._part) == BLOCK_BYTES or len(packet) < self._packet_bytes
        if ended and self._part:
            block, self._part = self._part, b""
            self._controller.accept(block, self)
        return Handshake.ACK

    def configure(self, configuration: int) -> None:
        """Begin anew, with the outputs off (clause USB-003)."""
        self._begin_anew()
        if configuration:
            self._adopted = True
            self._controller.host_arrived()

    def set_interface(self) -> None:
        """Begin anew, with the outputs off (clause USB-016)."""
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._controller.new_session(self)
        self._part = b""
        self._records.clear()
        self._unasked = b""
        self._packets.forget()

    def clear_halt(self, endpoint: int) -> None:
        """Forget a block of which a part has arrived; records stay (clause USB-015)."""
        if endpoint == ENDPOINT_OUT:
            self._part = b""

    def suspend(self) -> None:
        """Turn the outputs off, unless no bus has ever configured the device (clauses USB-020 and STA-006)."""
        if self._adopted:
            self._controller.suspend()

    def resume(self) -> None:
        """Leave the outputs disabled."""
        if self._adopted:
            self._controller.resume()

    def unplug(self) -> None:
        """Turn the outputs off and wait for another bus (clause STA-006)."""
        self.suspend()
        self.resume()
        self._adopted = False


class ConsoleLine(Protocol):
    """The serial line behind the console."""

    @property
    def can_receive(self) -> bool:
        """Whether the host reads what it is sent; otherwise it is to wait before it sends more."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""

    def take(self, room: int) -> bytes:
        """Give bytes for the host, at most `room` of them."""

    def open(self) -> None:
        """DTR went high: from now on text may be sent (clause USB-023)."""

    def hang_up(self) -> None:
        """The host has gone, or another has come: be as at first."""


class ConsoleFunction(UsbFunction):
    """Interfaces 1 and 2: a serial line as CDC-ACM (clauses USB-023 and SER-001)."""

    def __init__(self, line: ConsoleLine, packet_bytes: int) -> None:
        self._line = line
        self._packets = _Packets(line.take, packet_bytes)
        self.outs = {CONSOLE_ENDPOINT_OUT: self._take}
        self.ins = {CONSOLE_ENDPOINT_IN: self._packets.next, CONSOLE_ENDPOINT_NOTIFICATION: lambda: Handshake.NAK}
        self._line_coding = _115200_8N1
        self._dtr = False

    def request(self, setup: Setup, data: bytes) -> bytes:
        """Keep and tell the line coding, and heed DTR."""
        request = (setup.index, setup.request_type, setup.request)
        if request == _SET_LINE_CODING and len(data) == len(_115200_8N1):
            self._line_coding = data
        elif request == _GET_LINE_CODING:
            return self._line_coding
        elif request == _SET_CONTROL_LINE_STATE:
            self._set_dtr(bool(setup.value & _DTR))
        else:
            raise unknown(setup)
        return b""

    def _set_dtr(self, dtr: bool) -> None:
        if dtr and not self._dtr:
            self._line.open()
        elif self._dtr and not dtr:
            self._hang_up()
        self._dtr = dtr

    def _hang_up(self) -> None:
        self._line.hang_up()
        self._packets.forget()

    def _take(self, packet: bytes) -> Handshake:
        if not self._line.can_receive:
            return Handshake.NAK
        self._line.receive(packet)
        return Handshake.ACK

    def configure(self, _: int) -> None:
        """Be as at first (clause USB-026)."""
        self._dtr = False
        self._line_coding = _115200_8N1
        self._hang_up()

    def unplug(self) -> None:
        """Be as at first."""
        self.configure(0)


class DfuRunTimeFunction(UsbFunction):
    """Interface 3 at run time: the way into DFU mode (clauses USB-024 and DFU-002)."""

    def __init__(self, scheduler: Scheduler, controller: UsbController, door: Door, leave: Callable[[], None]) -> None:
        self._scheduler = scheduler
        self._controller = controller
        self._door = door
        self._leave = leave
        self._detaching = False
        self._state = DfuState.APP_IDLE

    def request(self, setup: Setup, _: bytes) -> bytes:
        """Answer GETSTATUS and GETSTATE, and heed DETACH; whatever else leads to appIDLE (clause DFU-006)."""
        request = (setup.request_type, setup.request)
        if request == _GETSTATUS:
            return DfuReply(DfuStatus.OK, 0, self._state).encode()
        if request == _GETSTATE:
            return bytes([self._state])
        self._state = DfuState.APP_IDLE
        if request != _DETACH:
            raise unknown(setup)
        self.detach(self._door)
        return b""

    def detach(self, door: Door) -> None:
        """Turn the outputs off and leave the bus in a while, as a door asks.

        Raises
        ------
        Stall
            If the device's state does not allow it (clause STA-005).
        """
        if not self._controller.detach(door):
            raise Stall("the device cannot be detached in this state")
        self._detaching = True
        self._state = DfuState.APP_DETACH
        self._scheduler.at(self._scheduler.now + DETACH_CYCLES, self._leave)

    def bus_reset(self) -> None:
        """Leave at once if a DETACH was heeded."""
        if self._detaching:
            self._leave()


class FirmwareUpgrade(Protocol):
    """What answers in DFU mode."""

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a class request, or raise `Stall`."""

    def bus_reset(self, configured: bool) -> bool:
        """Whether the device boots now."""


class DfuModeFunction(UsbFunction):
    """Interface 0 in DFU mode (chapter DFU)."""

    def __init__(self, upgrade: FirmwareUpgrade, boot: Callable[[], None]) -> None:
        self._upgrade = upgrade
        self._boot = boot
        self._was_configured = False

    def request(self, setup: Setup, data: bytes) -> bytes:
        """Carry out a request of the class."""
        if setup.request_type not in (CLASS_REQUEST_TYPE_IN, CLASS_REQUEST_TYPE_OUT):
            raise unknown(setup)
        return self._upgrade.control(setup, data)

    def configure(self, configuration: int) -> None:
        """From now on a bus reset counts (clause DFU-015)."""
        self._was_configured |= bool(configuration)

    def bus_reset(self) -> None:
        """Boot, if the reset is no part of enumeration."""
        if self._upgrade.bus_reset(self._was_configured):
            self._boot()
