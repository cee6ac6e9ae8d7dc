"""What a line that leads to the device and the controller behind it expect of each other, whatever the line is."""

from __future__ import annotations

from enum import Enum
from typing import Protocol

__all__ = ["Door", "Handshake", "Stall"]


class Handshake(Enum):
    """How a device answers a bulk transaction."""

    ACK = "ack"
    NAK = "nak"
    STALL = "stall"


class Stall(Exception):
    """The device answers a control request with STALL: it does not know it, or not now."""


class Door(Protocol):
    """A line that blocks come by, and their acknowledgements go back by."""

    def acknowledge(self, record: bytes) -> None:
        """Take the acknowledgement of a block that came by this door, 32 bytes."""

    def notify(self, record: bytes) -> None:
        """Take an unsolicited status record, in place of an older one that waits (clause ACK-006)."""
