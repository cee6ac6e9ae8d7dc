"""Control requests: their setup stage, and what may stand in it (USB 2.0, table 9-2; SPEC.md, chapter REQ)."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import ClassVar

from .board import BOARDS, CHANNELS
from .codes import Request, StandardRequest

__all__ = ["DIRECTION_IN", "VALUES", "ConsoleRequest", "Setup"]

DIRECTION_IN = 0x80
"""The bit of a request's type, and of an endpoint's address, that says to the host."""

KIND, STANDARD, VENDOR = 0x60, 0x00, 0x40
"""The bits of a request's type that say who defines it, and two who do."""

_LAYOUT = struct.Struct("<BBHHH")


@dataclass(frozen=True)
class Setup:
    """The eight bytes that begin a control request."""

    request_type: int
    request: int
    value: int
    index: int
    length: int

    BYTES: ClassVar = _LAYOUT.size

    @property
    def is_in(self) -> bool:
        """Whether its data, if there are any, go to the host."""
        return bool(self.request_type & DIRECTION_IN)

    @property
    def name(self) -> str:
        """What people call it: a vendor request of chapter REQ, a standard request, or else its numbers."""
        kinds: dict[int, type[IntEnum]] = {VENDOR: Request, STANDARD: StandardRequest}
        known = kinds.get(self.request_type & KIND)
        if known is None or self.request not in set(known):
            return f"request {self.request} of type {self.request_type:02X}"
        return known(self.request).name

    def encode(self) -> bytes:
        """Encode as 8 bytes."""
        return _LAYOUT.pack(self.request_type, self.request, self.value, self.index, self.length)

    @classmethod
    def decode(cls, data: bytes) -> Setup:
        """Decode 8 bytes; raise `ValueError` if there are more or fewer."""
        if len(data) != cls.BYTES:
            raise ValueError(f"a setup stage has {cls.BYTES} bytes, not {len(data)}")
        return cls(*_LAYOUT.unpack(data))


class ConsoleRequest(IntEnum):
    """Class requests to the function of the console (CDC 1.2, PSTN subclass, table 13); the last is not answered."""

    SET_LINE_CODING = 0x20
    GET_LINE_CODING = 0x21
    SET_CONTROL_LINE_STATE = 0x22
    SEND_BREAK = 0x23


VALUES: Mapping[Request, range] = MappingProxyType(
    {
        Request.WATCHDOG: range(10, 60_001),
        Request.LIMIT: range(CHANNELS + 1),
        Request.IDENTIFY: range(BOARDS),
    }
)
"""The values that a request takes (clauses REQ-009, REQ-010 and REQ-012); that of the others is 0."""
