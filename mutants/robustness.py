"""What nonsense does to a broken device: it must leave everything as it is."""

from __future__ import annotations

from typing import Any

from ..emulator.control import controller
from ..emulator.control.agenda import Agenda
from ..emulator.interfaces import console
from ..protocol.codes import Reason, Request
from ..protocol.console import LineEditor
from ..protocol.requests import Setup
from .endpoints import halt_on
from .patching import Patch, mutant

Controller = controller.Controller
LEAST_PLACES = 1


def leak_places(patch: Patch) -> None:
    """Let places of the queue that were taken out of it count as taken for ever."""

    def around(original: Any) -> Any:
        return lambda self, now: original(self, now) + controller.QUEUE_BLOCKS - self.recent.size

    patch.wrap(Agenda, "queued", around)


def leak_a_place(device: Any) -> None:
    """Take a place out of the queue of a controller, unless it is the last."""
    if device._agenda.recent.size > LEAST_PLACES:
        device._agenda.recent = device._agenda.recent[1:]


@mutant("BLK-003", "BLK-008", "BLK-024", wraps=(Controller, "accept"), also=leak_places)
def each_block_of_ones_takes_a_place_for_ever(original: Any, self: Any, packet: bytes, *given: Any) -> None:
    """A block of 512 bytes FF is refused, and the place that it was read into never comes back."""
    if packet and not packet.strip(b"\xff"):
        leak_a_place(self)
    original(self, packet, *given)


@mutant("USB-015", "BLK-002")
def blocks_with_another_magic_halt_the_endpoint(patch: Patch) -> None:
    """01 OUT halts itself when a block has another magic: the driver treats it as a protocol error."""
    halt_on(patch, Reason.MAGIC)


@mutant("REQ-001", "USB-004", wraps=(Controller, "request"))
def unknown_requests_restart_the_device(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """An unknown vendor request is answered with STALL, and restarts the device: an assertion ends in a trap."""
    if setup.request not in set(Request):
        self._depart(self._restart)
    return original(self, setup, data, door)


class _Deaf(LineEditor):
    """A line editor that hears nothing more once too much was typed into one line."""

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
    """After 256 bytes without an end of line the console hears nothing more: an index runs behind its buffer."""
    patch.replace(console, "LineEditor", _Deaf)


@mutant("ACK-001", "BLK-001", wraps=(Controller, "accept"))
def blocks_of_one_byte_are_not_acknowledged(original: Any, self: Any, packet: bytes, *given: Any) -> None:
    """A packet of fewer bytes than the number of a block needs is dropped without an acknowledgement."""
    if len(packet) >= 8:
        original(self, packet, *given)
