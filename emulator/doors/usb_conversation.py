"""What conversations about a USB device have in common, whatever protocol they are in."""

from __future__ import annotations

from abc import ABC, abstractmethod

from .usb_bus import UsbBus

__all__ = ["UsbConversation"]


class UsbConversation(ABC):
    """The bytes that come and go, and the bus of the device while there is one.

    Attributes
    ----------
    over : bool
        Whether the other end is to be left, once it has what is pending.
    end : str
        Why it is left, in words; empty if it is not, or has got all that it asked for.
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
        """Whether the device does not hear for now what the other end says; perhaps it would later."""
        return self._bus is not None and self._bus.stuck

    @property
    def last_word(self) -> int | None:
        """When the device last heard something of the other end, in its time; None if never."""
        return self._bus.last_word if self._bus else None

    def take(self, room: int) -> bytes:
        """Give bytes to the other end, at most so many."""
        data = bytes(self._pending[:room])
        del self._pending[:room]
        return data

    def hang_up(self) -> None:
        """The other end has gone."""
        self._leave("")

    @abstractmethod
    def _leave(self, reason: str) -> None:
        """Have no more to do with the other end."""
