"""Broken endpoints: packets and blocks, halts, sessions, and how the interfaces disturb each other (chapter USB)."""

from __future__ import annotations

from collections import deque
from typing import Any

from ....emulator.control import controller
from ....emulator.door import Handshake, Stall
from ....emulator.interfaces import usb_functions
from ....emulator.interfaces.serial_line import SerialLine
from ....emulator.interfaces.usb_device import UsbDevice
from ....emulator.interfaces.usb_functions import ArrayFunction, ConsoleFunction
from ....protocol.board import CHANNELS, WATCHDOG_MS
from ....protocol.codes import BLOCK_BYTES, Reason
from ....protocol.enumeration import CONSOLE_INTERFACE, ENDPOINT_IN, ENDPOINT_OUT
from ....protocol.requests import Setup
from .patching import Patch, mutant

FULL_SPEED = "emulator:?speed=full"
Controller = controller.Controller


# Halts


@mutant("USB-015", "USB-014")
def halts_do_not_end(patch: Patch) -> None:
    """CLEAR_FEATURE is acknowledged and the endpoint stays halted: only the toggle is set back."""

    def around(original: Any) -> Any:
        def clear_halt(self: Any, setup: Setup) -> bytes:
            halted = set(self._halted)
            original(self, setup)
            self._halted |= halted
            return b""

        return clear_halt

    patch.wrap(UsbDevice, "_clear_halt", around)


@mutant("USB-015", "USB-014")
def halts_have_no_effect(patch: Patch) -> None:
    """SET_FEATURE of ENDPOINT_HALT is acknowledged and the endpoint goes on, though GET_STATUS says 1."""

    def around(original: Any) -> Any:
        def running(self: Any, endpoint: int) -> Any:
            halted, self._halted = self._halted, set()
            pipe = original(self, endpoint)
            self._halted = halted
            return pipe

        return running

    patch.wrap(UsbDevice, "_running", around)


@mutant("USB-014", "USB-015")
def halts_are_not_told(patch: Patch) -> None:
    """GET_STATUS of an endpoint says 0 whether it is halted or not."""

    def around(original: Any) -> Any:
        def status(self: UsbDevice, setup: Setup) -> bytes:
            return bytes(len(original(self, setup)))

        return status

    patch.wrap(UsbDevice, "_endpoint_status", around)


@mutant("USB-015")
def halt_drops_waiting_records(patch: Patch) -> None:
    """Records that wait are gone once a host has halted 81 IN: the endpoint's buffer is emptied."""

    def around(original: Any) -> Any:
        def halt(self: Any, setup: Setup) -> bytes:
            original(self, setup)
            if setup.index == ENDPOINT_IN:
                _drop_records(self._pipe(setup).function)
            return b""

        return halt

    patch.wrap(UsbDevice, "_halt", around)


@mutant("USB-015", "USB-026")
def clear_feature_drops_waiting_records(patch: Patch) -> None:
    """CLEAR_FEATURE of 81 IN drops the records that wait, as it does with a part of a block on 01 OUT."""

    def around(original: Any) -> Any:
        def clear_halt(self: Any, endpoint: int) -> None:
            original(self, endpoint)
            if endpoint == ENDPOINT_IN:
                _drop_records(self)

        return clear_halt

    patch.wrap(ArrayFunction, "clear_halt", around)


def _drop_records(function: Any) -> None:
    function._records.clear()
    function._unasked = b""


def halt_on(patch: Patch, reason: Reason) -> None:
    """Let 01 OUT halt itself on a block that is refused for a reason."""

    def around(original: Any) -> Any:
        def bulk_out(self: Any, endpoint: int, packet: bytes) -> Handshake:
            pipe = self._running(endpoint)
            if pipe is None or endpoint != ENDPOINT_OUT:
                found: Handshake = original(self, endpoint, packet)
                return found
            judge = pipe.function._controller
            before = judge._refused
            answer: Handshake = original(self, endpoint, packet)
            if judge._refused != before and judge._last_refusal is reason:
                self.halt(endpoint)
            return answer

        return bulk_out

    patch.wrap(UsbDevice, "bulk_out", around)


@mutant("USB-015", "USB-017")
def short_blocks_halt_the_endpoint(patch: Patch) -> None:
    """01 OUT halts itself when a block ends before its 512th byte."""
    halt_on(patch, Reason.LENGTH)


# Packets and blocks


@mutant("USB-019")
def full_packets_are_not_followed_by_an_empty_one(patch: Patch) -> None:
    """Where the last packet of those that wait is full, no empty one ends the transfer, and the host waits on."""

    def around(original: Any) -> Any:
        def next_packet(self: Any) -> Any:
            packet = original(self)
            self._goes_on = False
            return packet

        return next_packet

    patch.wrap(usb_functions._Packets, "next", around)


@mutant("USB-018")
def empty_packets_are_answered(patch: Patch) -> None:
    """An empty packet while no block has begun is refused like a short block, and answered."""

    def around(original: Any) -> Any:
        def take(self: Any, packet: bytes) -> Any:
            if packet or self._part or not self._has_room:
                return original(self, packet)
            self._controller.accept(b"", self)
            return Handshake.ACK

        return take

    patch.wrap(ArrayFunction, "_take", around)


@mutant("USB-017")
def short_packets_shift_what_follows(patch: Patch) -> None:
    """Bytes are gathered until there are 512, whatever the packets: after a short one every block is another."""

    def of_packet(_: Any) -> Any:
        def take(self: Any, packet: bytes) -> Handshake:
            if not self._has_room:
                return Handshake.NAK
            self._part += packet
            while len(self._part) >= BLOCK_BYTES:
                block, self._part = self._part[:BLOCK_BYTES], self._part[BLOCK_BYTES:]
                self._controller.accept(block, self)
            return Handshake.ACK

        return take

    def of_stream(original: Any) -> Any:
        return lambda self, data, began, deadline: (0, began) if self._part else original(self, data, began, deadline)

    patch.wrap(ArrayFunction, "_take", of_packet)
    patch.wrap(ArrayFunction, "_take_many", of_stream)


@mutant("USB-015", "USB-026", url=FULL_SPEED)
def part_of_a_block_outlives_clear_feature(patch: Patch) -> None:
    """CLEAR_FEATURE of 01 OUT keeps the part of a block that has arrived, and the next one is appended to it."""
    patch.replace(ArrayFunction, "clear_halt", lambda *_: None)


@mutant("USB-026", url=FULL_SPEED)
def part_of_a_block_outlives_the_session(patch: Patch) -> None:
    """A bus reset, SET_CONFIGURATION and SET_INTERFACE keep the part of a block that has arrived."""

    def around(original: Any) -> Any:
        def begin_anew(self: Any) -> None:
            part = self._part
            original(self)
            self._part = part

        return begin_anew

    patch.wrap(ArrayFunction, "_begin_anew", around)


@mutant("USB-017", url=FULL_SPEED)
def short_packet_ends_no_block_at_full_speed(patch: Patch) -> None:
    """At full speed a short packet within a block is taken for a whole one, and only the 512th byte ends the block."""

    def around(_: Any) -> Any:
        def take(self: Any, packet: bytes) -> Handshake:
            if not self._has_room:
                return Handshake.NAK
            self._part += packet
            if len(self._part) >= BLOCK_BYTES:
                block, self._part = self._part[:BLOCK_BYTES], b""
                self._controller.accept(block, self)
            return Handshake.ACK

        return take

    patch.wrap(ArrayFunction, "_take", around)


# Sessions


@mutant("USB-016", "STA-002")
def set_interface_does_nothing(patch: Patch) -> None:
    """SET_INTERFACE is acknowledged and changes nothing: there is only one setting."""

    def around(_: Any) -> Any:
        def set_interface(self: Any, setup: Setup) -> bytes:
            self._function(setup)
            if setup.value:
                raise Stall("there is one setting")
            return b""

        return set_interface

    patch.wrap(UsbDevice, "_set_interface", around)


@mutant("USB-003", "USB-026")
def records_outlive_the_session(patch: Patch) -> None:
    """Records that wait for 81 IN are still there after a bus reset, SET_CONFIGURATION or SET_INTERFACE."""

    def around(original: Any) -> Any:
        def begin_anew(self: Any) -> None:
            records, unasked = deque(self._records), self._unasked
            original(self)
            self._records, self._unasked = records, unasked

        return begin_anew

    patch.wrap(ArrayFunction, "_begin_anew", around)


@mutant("USB-026", "REQ-009", "REQ-010")
def settings_end_with_the_session(patch: Patch) -> None:
    """SET_CONFIGURATION sets the watchdog time and the drive limit back to those at power-up."""

    def around(original: Any) -> Any:
        def new_session(self: Any, door: Any) -> None:
            original(self, door)
            self._watchdog.set_time(WATCHDOG_MS)
            self._drive_limit = CHANNELS

        return new_session

    patch.wrap(Controller, "new_session", around)


# The console's endpoints


@mutant("USB-025")
def unread_console_holds_up_blocks(patch: Patch) -> None:
    """While a packet of the console waits that nobody reads, 01 OUT answers NAK: all endpoints share a buffer."""

    def waits(device: Any) -> bool:
        console = device._functions.get(CONSOLE_INTERFACE)
        return console is not None and console._line.pending > 0

    def of_packet(original: Any) -> Any:
        def bulk_out(self: Any, endpoint: int, packet: bytes) -> Any:
            return Handshake.NAK if endpoint == ENDPOINT_OUT and waits(self) else original(self, endpoint, packet)

        return bulk_out

    def of_stream(original: Any) -> Any:
        def stream_out(self: Any, endpoint: int, data: memoryview, began: int, deadline: int) -> Any:
            return (0, began) if waits(self) else original(self, endpoint, data, began, deadline)

        return stream_out

    patch.wrap(UsbDevice, "bulk_out", of_packet)
    patch.wrap(UsbDevice, "stream_out", of_stream)


@mutant("USB-023")
def console_speaks_without_dtr(patch: Patch) -> None:
    """The console sends text back before the host has set DTR."""
    patch.replace(SerialLine, "_say", lambda self, text: self._outbox.say(text))


@mutant("USB-023")
def line_coding_is_not_kept(patch: Patch) -> None:
    """SET_LINE_CODING is acknowledged, and GET_LINE_CODING answers 115 200 baud as before."""

    def around(original: Any) -> Any:
        def request(self: Any, setup: Setup, data: bytes) -> Any:
            kept = self._line_coding
            answer = original(self, setup, data)
            self._line_coding = kept
            return answer

        return request

    patch.wrap(ConsoleFunction, "request", around)


@mutant("USB-026", "USB-023")
def line_coding_outlives_the_session(patch: Patch) -> None:
    """The line coding is what the host before has set, after a bus reset and SET_CONFIGURATION too."""

    def around(original: Any) -> Any:
        def configure(self: Any, configuration: int) -> None:
            kept = self._line_coding
            original(self, configuration)
            self._line_coding = kept

        return configure

    patch.wrap(ConsoleFunction, "configure", around)


@mutant("USB-026", "SER-010")
def frames_outlive_the_session(patch: Patch) -> None:
    """After SET_CONFIGURATION the CDC line still carries frames where it did before, and DTR counts as set."""
    patch.replace(ConsoleFunction, "configure", lambda *_: None)


@mutant("USB-023", "USB-004")
def breaks_are_acknowledged_on_cdc(patch: Patch) -> None:
    """SEND_BREAK and whatever else the class knows is acknowledged on interface 1, instead of STALL."""

    def around(original: Any) -> Any:
        def request(self: Any, setup: Setup, data: bytes) -> Any:
            try:
                return original(self, setup, data)
            except Stall:
                return b""

        return request

    patch.wrap(ConsoleFunction, "request", around)
