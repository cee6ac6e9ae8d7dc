"""What any raw line can do, and how it fails."""

from __future__ import annotations

from typing import Protocol

from ....host.lines.transport import Timekeeper
from ....protocol.requests import Setup
from ..cases import LineKind

__all__ = ["RawLine"]


class RawLine(Protocol):
    """A line by which blocks and requests reach the device, whether they are right or wrong.

    Methods raise a `DeviceError` where the line or the device fails.
    """

    @property
    def kind(self) -> LineKind:
        """Whether it is USB or a serial line."""

    @property
    def name(self) -> str:
        """What is at its other end, for people."""

    @property
    def time(self) -> Timekeeper:
        """The time by which it is waited for."""

    def send_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks of 512 bytes one behind the other; how many bytes were taken in time."""

    def receive_records(self, seconds: float) -> bytes:
        """Wait for what the device sends by itself: whole records as they came, none where none came in time."""

    def request(self, setup: Setup, data: bytes = b"") -> bytes | None:
        """Make a control request; what came back, None for STALL."""

    def reopen(self, seconds: float) -> None:
        """Find the device again in run-time mode, once it has left; it may take so long to come back."""

    def close(self) -> None:
        """Give the line back."""
