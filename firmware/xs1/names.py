"""Names of an XS1's ports and other resources, as data sheets write them: ``1F``, ``8C``, ``32A``.

A port's identifier has its width in bits 16 to 21 and its number in bits 8 to 15. The numbers of the 1-bit ports do not
follow their letters. Sources: the public header ``xs1_g4000b-512.h``, and the port names of the simulator AXE.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from .instructions import REGISTERS
from .state import (
    PORT_WIDTHS,
    TYPE_CHANNEL,
    TYPE_CLOCK,
    TYPE_CONFIG,
    TYPE_LOCK,
    TYPE_PORT,
    TYPE_PS,
    TYPE_SYNC,
    TYPE_THREAD,
    TYPE_TIMER,
)

__all__ = ["EXCEPTIONS", "PORT_IDS", "THREAD_REGISTERS", "parse_port", "port_name", "resource_name"]

EXCEPTIONS = (
    "none", "link error", "illegal pc", "illegal instruction", "illegal resource", "load or store", "illegal ps",
    "arithmetic", "ecall", "resource dependency", *5 * ("reserved",), "kcall",
)  # fmt: skip
"""Names of the types of exceptions."""

_NUMBERS = {  # by width, in the order of the letters from A
    1: (2, 0, 1, 3, 6, 4, 5, 7, 10, 8, 9, 11, 12, 13, 14, 15),
    4: range(6),
    8: range(4),
    16: range(4),
    32: range(2),
}

PORT_IDS: Mapping[str, int] = MappingProxyType(
    {
        f"{width}{chr(ord('A') + letter)}": width << 16 | number << 8 | TYPE_PORT
        for width, numbers in _NUMBERS.items()
        for letter, number in enumerate(numbers)
    }
)
"""Identifiers of all ports by name. 16C, 16D and 32B have no pins."""

THREAD_REGISTERS = (*REGISTERS, "sr", "ssr", "spc", "sed", "et", "ed", "kep", "ksp")
"""Of a thread, in the order in which a core keeps them."""

_KINDS = {
    TYPE_TIMER: "timer",
    TYPE_CHANNEL: "channel end",
    TYPE_SYNC: "synchroniser",
    TYPE_THREAD: "thread",
    TYPE_LOCK: "lock",
    TYPE_CLOCK: "clock block",
    TYPE_PS: "processor state",
    TYPE_CONFIG: "configuration",
}
_NAMES = {identifier: name for name, identifier in PORT_IDS.items()}
assert len(PORT_IDS) == len(PORT_WIDTHS)


def parse_port(text: str) -> int:
    """The identifier of a port from its name, such as ``1F``, or from the identifier in hexadecimal with ``0x``.

    Raises
    ------
    ValueError
        If there is no such port.

    Examples
    --------
    >>> hex(parse_port("1F"))
    '0x10400'
    """
    known = PORT_IDS.get(text.upper())
    if known is None and re.fullmatch(r"0[xX][0-9a-fA-F]{1,8}", text) and int(text, 16) in _NAMES:
        known = int(text, 16)
    if known is None:
        raise ValueError(
            f"unknown port {text!r}; known are 1A to 1P, 4A to 4F, 8A to 8D, 16A to 16D, 32A and 32B, "
            "or an identifier such as 0x10400"
        )
    return known


def port_name(identifier: int) -> str:
    """The name of a port; the identifier in hexadecimal if it is none of a port."""
    return _NAMES.get(identifier, f"0x{identifier:x}")


def resource_name(identifier: int) -> str:
    """A resource in words, such as ``port 1F``, ``timer 0`` or ``channel end 3``; hexadecimal if it is of no kind."""
    if identifier in _NAMES:
        return f"port {_NAMES[identifier]}"
    if (kind := _KINDS.get(identifier & 0xFF)) is None:
        return f"0x{identifier:x}"
    return f"{kind} {identifier >> 8 & 0xFF}"
