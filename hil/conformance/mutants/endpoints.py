"""Broken endpoints: packets, blocks, halts, sessions, and interfaces that disturb each other (chapter USB)."""

from __future__ import annotations

from collections import deque
from typing import Any

from ....emulator.control.state_machine import StateMachine
from ....emulator.control.watchdog import Watchdog
from ....emulator.door import Handshake, Stall
from ....emulator.interfaces import usb_functions
from ....emulator.interfaces.serial_line import SerialLine
from ....emulator.interfaces.usb_device import UsbDevice
from ....emulator.interfaces.usb_functions import ArrayFunction, ConsoleFunction
from ....protocol.board import CHANNELS, CYCLES_PER_MS, WATCHDOG_MS
from ....protocol.codes import BLOCK_BYTES, Reason
from ....protocol.enumeration import CONSOLE_ENDPOINT_IN, CONSOLE_INTERFACE, ENDPOINT_IN, ENDPOINT_OUT
from ....protocol.requests import ConsoleRequest, Setup
from .patching import Patch, mutant

FULL_SPEED = "emulator:?speed=full"


# Halts


@mutant("USB-015", "USB-014", wraps=(UsbDevice, "_clear_halt"))
def halts_do_not_end(original: Any, self: Any, setup: Setup) -> bytes:
    """CLEAR_FEATURE is acknowledged but the endpoint stays halted: only the toggle is reset."""
    halted = set(self._halted)
    original(self, setup)
    self._halted |= halted
    return b""


@mutant("USB-015", "USB-014", wraps=(UsbDevice, "_running"))
def halts_have_no_effect(original: Any, self: Any, endpoint: int) -> Any:
    """SET_FEATURE of ENDPOINT_HALT is acknowledged but the endpoint goes on, although GET_STATUS answers 1."""
    halted, self._halted = self._halted, set()
    pipe = original(self, endpoint)
    self._halted = halted
    return pipe


@mutant("USB-014", "USB-015", wraps=(UsbDevice, "_endpoint_status"))
def halts_are_not_told(original: Any, self: UsbDevice, setup: Setup) -> bytes:
    """GET_STATUS of an endpoint answers 0, halted or not."""
    return bytes(len(original(self, setup)))


@mutant("USB-015", wraps=(UsbDevice, "_halt"))
def halt_drops_waiting_records(original: Any, self: Any, setup: Setup) -> bytes:
    """Records that wait are lost when a host halts 81 IN: the endpoint's buffer is emptied."""
    original(self, setup)
    if setup.index == ENDPOINT_IN:
        _drop_records(self._pipe(setup).function)
    return b""


@mutant("USB-015", "USB-026", wraps=(ArrayFunction, "clear_halt"))
def clear_feature_drops_waiting_records(original: Any, self: Any, endpoint: int) -> None:
    """CLEAR_FEATURE of 81 IN drops the records that wait, as it drops a partial block on 01 OUT."""
    original(self, endpoint)
    if endpoint == ENDPOINT_IN:
        _drop_records(self)


def _drop_records(function: Any) -> None:
    function._records.clear()
    function._unasked = b""


def halt_on(patch: Patch, reason: Reason) -> None:
    """Let 01 OUT halt itself when a block is refused for a given reason."""

    @patch.around(UsbDevice, "bulk_out")
    def bulk_out(original: Any, self: Any, endpoint: int, packet: bytes) -> Handshake:
        pipe = self._running(endpoint)
        if pipe is None or endpoint != ENDPOINT_OUT:
            found: Handshake = original(self, endpoint, packet)
            return found
        device = pipe.function._controller._device
        before = device.refused
        answer: Handshake = original(self, endpoint, packet)
        if device.refused != before and device.last_refusal is reason:
            self.halt(endpoint)
        return answer


@mutant("USB-015", "USB-017")
def short_blocks_halt_the_endpoint(patch: Patch) -> None:
    """01 OUT halts itself if a block ends before its 512th byte."""
    halt_on(patch, Reason.LENGTH)


# Packets and blocks


@mutant("USB-019", wraps=(usb_functions._Packets, "next"))
def full_packets_are_not_followed_by_an_empty_one(original: Any, self: Any) -> Any:
    """If the last packet of the waiting records is full, no empty one ends the transfer, and the host keeps waiting."""
    packet = original(self)
    self._goes_on = False
    return packet


@mutant("USB-018", wraps=(ArrayFunction, "_take"))
def empty_packets_are_answered(original: Any, self: Any, packet: bytes) -> Any:
    """An empty packet outside a block is refused like a short block, and answered."""
    if packet or self._part or not self._has_room:
        return original(self, packet)
    self._controller.accept(b"", self)
    return Handshake.ACK


@mutant("USB-017")
def short_packets_shift_what_follows(patch: Patch) -> None:
    """Bytes are gathered up to 512 across short packets: after a short one every block is misaligned."""

    @patch.around(ArrayFunction, "_take")
    def of_packet(_: Any, self: Any, packet: bytes) -> Handshake:
        if not self._has_room:
            return Handshake.NAK
        self._part += packet
        while len(self._part) >= BLOCK_BYTES:
            block, self._part = self._part[:BLOCK_BYTES], self._part[BLOCK_BYTES:]
            self._controller.accept(block, self)
        return Handshake.ACK

    def of_stream(original: Any) -> Any:
        return lambda self, data, began, deadline: (0, began) if self._part else original(self, data, began, deadline)

    patch.wrap(ArrayFunction, "_take_many", of_stream)


@mutant("USB-015", "USB-026", url=FULL_SPEED)
def part_of_a_block_outlives_clear_feature(patch: Patch) -> None:
    """CLEAR_FEATURE of 01 OUT keeps a partial block, and the next block is appended to it."""
    patch.replace(ArrayFunction, "clear_halt", lambda *_: None)


@mutant("USB-026", wraps=(ArrayFunction, "_begin_anew"), url=FULL_SPEED)
def part_of_a_block_outlives_the_session(original: Any, self: Any) -> None:
    """A bus reset, SET_CONFIGURATION and SET_INTERFACE keep a partial block."""
    part = self._part
    original(self)
    self._part = part


@mutant("USB-017", wraps=(ArrayFunction, "_take"), url=FULL_SPEED)
def short_packet_ends_no_block_at_full_speed(_: Any, self: Any, packet: bytes) -> Handshake:
    """At full speed a short packet within a block counts as a whole one: only the 512th byte ends the block."""
    if not self._has_room:
        return Handshake.NAK
    self._part += packet
    if len(self._part) >= BLOCK_BYTES:
        block, self._part = self._part[:BLOCK_BYTES], b""
        self._controller.accept(block, self)
    return Handshake.ACK


# Sessions


@mutant("USB-016", "STA-002", wraps=(UsbDevice, "_set_interface"))
def set_interface_does_nothing(_: Any, self: Any, setup: Setup) -> bytes:
    """SET_INTERFACE is acknowledged and changes nothing, because there is only one setting."""
    self._function(setup)
    if setup.value:
        raise Stall("there is one setting")
    return b""


@mutant("USB-003", "USB-026", wraps=(ArrayFunction, "_begin_anew"))
def records_outlive_the_session(original: Any, self: Any) -> None:
    """Records that wait for 81 IN are still there after a bus reset, SET_CONFIGURATION or SET_INTERFACE."""
    records, unasked = deque(self._records), self._unasked
    original(self)
    self._records, self._unasked = records, unasked


@mutant("USB-026", "REQ-009", "REQ-010", wraps=(StateMachine, "new_session"))
def settings_end_with_the_session(original: Any, self: Any, door: Any) -> None:
    """SET_CONFIGURATION resets the watchdog time and the drive limit to their values at power-up."""
    original(self, door)
    self.watchdog.set_time(WATCHDOG_MS)
    self._device.drive_limit = CHANNELS


# The console's endpoints


@mutant("USB-025")
def unread_console_holds_up_blocks(patch: Patch) -> None:
    """While a console packet is not read, 01 OUT answers NAK: all endpoints share one buffer."""

    def waits(device: Any) -> bool:
        console = device._functions.get(CONSOLE_INTERFACE)
        return console is not None and console._line.pending > 0

    @patch.around(UsbDevice, "bulk_out")
    def of_packet(original: Any, self: Any, endpoint: int, packet: bytes) -> Any:
        return Handshake.NAK if endpoint == ENDPOINT_OUT and waits(self) else original(self, endpoint, packet)

    @patch.around(UsbDevice, "stream_out")
    def of_stream(original: Any, self: Any, endpoint: int, data: memoryview, began: int, deadline: int) -> Any:
        return (0, began) if waits(self) else original(self, endpoint, data, began, deadline)


@mutant("USB-023")
def console_speaks_without_dtr(patch: Patch) -> None:
    """The console sends text back before the host has set DTR."""
    patch.replace(SerialLine, "_say", lambda self, text: self._outbox.say(text))


@mutant("USB-023", wraps=(ConsoleFunction, "request"))
def line_coding_is_not_kept(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """SET_LINE_CODING is acknowledged, but GET_LINE_CODING still answers 115 200 baud."""
    kept = self._line_coding
    answer = original(self, setup, data)
    self._line_coding = kept
    return answer


@mutant("USB-026", "USB-023", wraps=(ConsoleFunction, "configure"))
def line_coding_outlives_the_session(original: Any, self: Any, configuration: int) -> None:
    """The line coding of the previous host survives a bus reset and SET_CONFIGURATION."""
    kept = self._line_coding
    original(self, configuration)
    self._line_coding = kept


@mutant("USB-019", wraps=(ConsoleFunction, "__init__"))
def full_packets_of_text_end_a_transfer(original: Any, self: Any, line: Any, packet_bytes: int) -> None:
    """No empty packet comes on 83 IN after a full one: only records are sent with one."""
    original(self, line, packet_bytes)
    self.ins = self.ins | {CONSOLE_ENDPOINT_IN: lambda: line.take(packet_bytes) or Handshake.NAK}


@mutant("USB-026", "SER-010")
def frames_outlive_the_session(patch: Patch) -> None:
    """After SET_CONFIGURATION the CDC line still carries frames if it did before, and DTR still counts as set."""
    patch.replace(ConsoleFunction, "configure", lambda *_: None)


@mutant("USB-023", "USB-004", wraps=(ConsoleFunction, "request"))
def breaks_are_acknowledged_on_cdc(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """SEND_BREAK and other requests of the class are acknowledged on interface 1 instead of STALL."""
    try:
        return original(self, setup, data)
    except Stall:
        return b""


@mutant("USB-025", "SAF-003", wraps=(Watchdog, "_check"))
def unread_text_stops_the_watchdog(original: Any, self: Any, armed: int) -> None:
    """The watchdog does not fire while text waits for a host that does not read: its task waits for the line."""
    lines = [door for door in self._on_fire.__self__._doors if isinstance(door, SerialLine)]
    if any(line.pending and line._sends_text and not line._among_frames for line in lines):
        self._scheduler.at(self._scheduler.now + CYCLES_PER_MS, lambda: self._check(armed))
    else:
        original(self, armed)


@mutant("USB-025", "CON-004", wraps=(SerialLine, "receive"))
def unread_text_holds_back_commands(original: Any, self: Any, data: bytes) -> None:
    """A command is dropped while an earlier answer was not read, even `stop`: the line is busy."""
    if not self.pending or self._among_frames:
        original(self, data)


@mutant("USB-023", "SER-010", wraps=(ConsoleFunction, "request"))
def rts_low_hangs_up(original: Any, self: Any, setup: Any, data: bytes) -> Any:
    """SET_CONTROL_LINE_STATE without RTS hangs up, though DTR stays set: RTS is read for it."""
    before = self._dtr
    answer = original(self, setup, data)
    if setup.request == ConsoleRequest.SET_CONTROL_LINE_STATE and before and self._dtr and not setup.value & 2:
        self._hang_up()
        self._line.open()
    return answer
