"""Broken robustness: effects of nonsense, which must leave everything unchanged."""

from __future__ import annotations

from typing import Any

from ....emulator.control.agenda import QUEUE_BLOCKS, Agenda
from ....emulator.control.controller import Controller
from ....emulator.control.requests import Requests
from ....emulator.interfaces import console
from ....protocol.codes import Reason, Request
from ....protocol.console import LineEditor
from ....protocol.requests import Setup
from .endpoints import halt_on
from .patching import Patch, mutant

LEAST_PLACES = 1


def leak_places(patch: Patch) -> None:
    """Let places that were taken from the queue count as taken for ever."""

    def around(original: Any) -> Any:
        return lambda self, now: original(self, now) + QUEUE_BLOCKS - self.recent.size

    patch.wrap(Agenda, "queued", around)


def leak_a_place(dispatch: Any) -> None:
    """Take a place from the queue, unless it is the last."""
    if dispatch.agenda.recent.size > LEAST_PLACES:
        dispatch.agenda.recent = dispatch.agenda.recent[1:]


@mutant("BLK-003", "BLK-008", "BLK-024", wraps=(Controller, "accept"), also=leak_places)
def each_block_of_ones_takes_a_place_for_ever(original: Any, self: Any, packet: bytes, *given: Any) -> None:
    """A block of 512 bytes FF is refused, and the place that it occupied never returns."""
    if packet and not packet.strip(b"\xff"):
        leak_a_place(self._dispatch)
    original(self, packet, *given)


@mutant("USB-015", "BLK-002")
def blocks_with_another_magic_halt_the_endpoint(patch: Patch) -> None:
    """01 OUT halts itself if a block has another magic: the driver treats it as a protocol error."""
    halt_on(patch, Reason.MAGIC)


@mutant("REQ-001", "USB-004", wraps=(Requests, "request"))
def unknown_requests_restart_the_device(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """An unknown vendor request is answered with STALL and restarts the device: an assertion ends in a trap."""
    if setup.request not in set(Request):
        self._depart(self._restart)
    return original(self, setup, data, door)


class _Deaf(LineEditor):
    """A line editor that goes deaf after a line that is too long."""

    MOST_BYTES = 256

    def __init__(self, *, echo: bool = True) -> None:
        super().__init__(echo=echo)
        self._typed = 0

    def feed(self, data: bytes) -> tuple[list[str], bytes]:
        self._typed += len(data)
        if self._typed > self.MOST_BYTES:
            return [], b""
        if data in (b"\r", b"\n"):
            self._typed = 0
        return super().feed(data)


@mutant("CON-003", "CON-009")
def long_lines_deafen_the_console(patch: Patch) -> None:
    """After 256 bytes without an end of line the console goes deaf: an index runs past its buffer."""
    patch.replace(console, "LineEditor", _Deaf)


@mutant("ACK-001", "BLK-001", wraps=(Controller, "accept"))
def blocks_of_one_byte_are_not_acknowledged(original: Any, self: Any, packet: bytes, *given: Any) -> None:
    """A packet that is too short for a block's number is dropped without an acknowledgement."""
    if len(packet) >= 8:
        original(self, packet, *given)
