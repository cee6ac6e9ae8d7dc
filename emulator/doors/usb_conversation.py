"""The common part of conversations about a USB device, in any protocol."""

from __future__ import annotations

from abc import ABC, abstractmethod

from .usb_bus import UsbBus

__all__ = ["UsbConversation"]


class UsbConversation(ABC):
    """The received and pending bytes, and the bus of the device while there is one.

    Attributes
    ----------
    over : bool
        Whether the other end is to be dropped after it has received its pending data.
    end : str
        Why it is dropped, in words; empty if it is not, or if it has received all that it requested.
    """

    def __init__(self) -> None:
        self._received = bytearray()
        self._pending = bytearray()
        self._bus: UsbBus | None = None
        self.over = False
        self.end = ""

    @property
    def pending(self) -> int:
        """Bytes that wait for the other end."""
        return len(self._pending)

    @property
    def stuck(self) -> bool:
        """Whether the device cannot receive data now, but may later."""
        return self._bus is not None and self._bus.stuck

    @property
    def last_word(self) -> int | None:
        """When the device last received data of the other end, in its time; None if never."""
        return self._bus.last_word if self._bus else None

    def take(self, room: int) -> bytes:
        """Return at most so many bytes for the other end."""
        data = bytes(self._pending[:room])
        del self._pending[:room]
        return data

    def hang_up(self) -> None:
        """The other end has gone."""
        self._leave("")

    @abstractmethod
    def _leave(self, reason: str) -> None:
        """End the conversation."""
