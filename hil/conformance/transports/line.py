"""What any raw line can do, and how it fails."""

from __future__ import annotations

from typing import Protocol

from ....host.transports.transport import Timekeeper
from ....protocol.requests import Setup
from ..cases import LineKind
from .watch import ClockWatch

__all__ = ["RawLine"]


class RawLine(Protocol):
    """A line that carries blocks and requests to the device, valid or not.

    Methods raise a `DeviceError` if the line or the device fails.
    """

    watch: ClockWatch

    @property
    def kind(self) -> LineKind:
        """Whether it is USB or a serial line."""

    @property
    def name(self) -> str:
        """A name of the device, for people."""

    @property
    def time(self) -> Timekeeper:
        """The clock for all waiting."""

    def send_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks of 512 bytes one after the other; returns how many bytes were taken in time."""

    def receive_records(self, seconds: float) -> bytes:
        """Wait for unsolicited data: whole records, none if none came in time."""

    def request(self, setup: Setup, data: bytes = b"") -> bytes | None:
        """Make a control request; returns the answer, or None for STALL."""

    def reopen(self, seconds: float) -> None:
        """Find the device again in run-time mode after it has left, within this time."""

    def close(self) -> None:
        """Close the line."""
