"""The switch of an XS1 node: its configuration registers, and the control messages that read and write them.

A program sends a control message to the configuration resource of a node (number C3, type C), and the switch answers
to the channel end that the message names. Numbers of several bytes travel most significant byte first. Registers and
fields are those of the public register header of the XS1-L.

How fast tokens travel, and to whom, is the affair of whoever owns the switch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .state import CHANNEL_ENDS

if TYPE_CHECKING:
    from .core import Core, Sent

__all__ = [
    "ANSWER_CYCLES",
    "DIMENSION_DIRECTION",
    "LINKS",
    "NODE_ID",
    "SLINK",
    "SWITCH_CONFIGURATION",
    "UNNUMBERED",
    "XLINK",
    "LinkField",
    "Reply",
    "Switch",
    "serve",
]

UNNUMBERED = 0xFFFF
"""The node of a chip that was just powered up."""
SWITCH_CONFIGURATION = 0xC30C
"""The low half of the identifier of a switch's configuration resource; the high half is its node."""
LINKS = 8
MOST_NODES = 2**16
ANSWER_CYCLES = 40
"""From the end of a control message to its answer. It is not published; the delay of a hop between chips is assumed."""

CONTROL = 0x100
"""Bit 8 of a token: it is a control token."""
END = CONTROL | 0x01
ACK = CONTROL | 0x03
NACK = CONTROL | 0x04
WRITEC = CONTROL | 0xC0
READC = CONTROL | 0xC1
READ_TOKENS = 6
WRITE_TOKENS = 10
CHANNEL_END_TYPE = 0x02

DEVICE_ID = 0x00
NODE_CONFIG = 0x04
NODE_ID = 0x05
PLL_CTL = 0x06
CLK_DIVIDER = 0x07
REF_CLK_DIVIDER = 0x08
DIMENSION_DIRECTION = 0x0C
"""The first of two registers; each has 4 bits for each of 8 dimensions."""
DEBUG_CONFIG = 0x10
DEBUG_SOURCE = 0x1F
SLINK = 0x20
"""Status, network and direction of link 0; those of the others follow."""
PLINK = 0x40
PLINKS = 4
XLINK = 0x80
"""Set-up of link 0; those of the others follow."""
XSTATIC = 0xA0
DIMENSIONS_PER_REGISTER = 8
DIRECTION_BITS = 4
DIRECTION_SHIFT = 8
"""Of the direction in SLINK."""


class LinkField:
    """Bits of an XLINK register."""

    INTER_TOKEN_DELAY = 0x7FF
    INTRA_TOKEN_DELAY = 0x7FF << 11
    RX_RESET = 1 << 23
    HELLO = 1 << 24
    TX_CREDIT = 1 << 25
    RX_CREDIT = 1 << 26
    RX_ERROR = 1 << 27
    WIDE = 1 << 30
    ENABLE = 1 << 31


LINK_SETTINGS = LinkField.INTER_TOKEN_DELAY | LinkField.INTRA_TOKEN_DELAY | LinkField.WIDE | LinkField.ENABLE
SLINK_SETTINGS = 0xF << DIRECTION_SHIFT | 0x3 << 4
DEVICE_ID0_VALUE = 0x0000_0300
"""Version 0, revision 3: an XS1-L."""
DEVICE_ID1_VALUE = LINKS << 16 | 1 << 8 | PLINKS

_WRITABLE = {
    NODE_CONFIG: 0x8000_0101,
    NODE_ID: 0xFFFF,
    PLL_CTL: 0x0387_FFFF,
    CLK_DIVIDER: 0xFFFF,
    REF_CLK_DIVIDER: 0xFFFF,
    DIMENSION_DIRECTION: 0xFFFF_FFFF,
    DIMENSION_DIRECTION + 1: 0xFFFF_FFFF,
    DEBUG_CONFIG: 0xFFFF_FFFF,
    **dict.fromkeys(range(SLINK, SLINK + LINKS), SLINK_SETTINGS),
    **dict.fromkeys(range(PLINK, PLINK + PLINKS), SLINK_SETTINGS),
    **dict.fromkeys(range(XLINK, XLINK + LINKS), LINK_SETTINGS),
    **dict.fromkeys(range(XSTATIC, XSTATIC + LINKS), 0x8000_001F),
}
"""The bits of each register that a write sets; the rest stays as it is."""


class Reply(NamedTuple):
    """The answer to a control message."""

    destination: int
    """Identifier of the channel end that it goes to."""
    tokens: NDArray[np.uint16]
    """Its tokens, the last of which is END. Bit 8 marks a control token."""


class Switch:
    """The configuration of one node's switch.

    Parameters
    ----------
    node : int
        Its node at power-up, 16 bits.
    hello : callable, optional
        Takes the number of a link on which the switch says HELLO, and returns whether that is answered with credit at
        once. Later credit comes by `give_credit`.

    Raises
    ------
    ValueError
        If the node has more than 16 bits.
    """

    def __init__(self, node: int = UNNUMBERED, *, hello: Callable[[int], bool] | None = None) -> None:
        if not 0 <= node < MOST_NODES:
            raise ValueError(f"a node has 16 bits, 0 to 65535; not {node}")
        self.registers: dict[int, int] = {
            DEVICE_ID: DEVICE_ID0_VALUE,
            DEVICE_ID + 1: DEVICE_ID1_VALUE,
            DEVICE_ID + 2: 0,
            DEVICE_ID + 3: 0,
            DEBUG_SOURCE: 0,
            **dict.fromkeys(_WRITABLE, 0),
            NODE_ID: node,
        }
        self.hello = hello

    @property
    def node(self) -> int:
        """The node that it is set up as."""
        return self.registers[NODE_ID]

    def give_credit(self, link: int) -> None:
        """A HELLO of this switch was answered: the link may send. Has no effect on a link that is not enabled.

        Raises
        ------
        ValueError
            If there is no such link.
        """
        register = XLINK + _link(link)
        if self.registers[register] & LinkField.ENABLE:
            self.registers[register] |= LinkField.TX_CREDIT

    def has_credit(self, link: int) -> bool:
        """Whether a link is enabled and may send.

        Raises
        ------
        ValueError
            If there is no such link.
        """
        return bool(self.registers[XLINK + _link(link)] & LinkField.TX_CREDIT)

    def route(self, node: int) -> int | None:
        """The link by which a message for a node leaves, or None if it stays here.

        The highest bit in which the nodes differ is the dimension; it names a direction; the lowest enabled link with
        that direction is taken.

        Raises
        ------
        ValueError
            If no enabled link has that direction, so that the message would stay in the switch for ever.
        """
        difference = node ^ self.node
        if not difference:
            return None
        dimension = difference.bit_length() - 1
        register = DIMENSION_DIRECTION + dimension // DIMENSIONS_PER_REGISTER
        shift = dimension % DIMENSIONS_PER_REGISTER * DIRECTION_BITS
        direction = self.registers[register] >> shift & 0xF
        for link in range(LINKS):
            enabled = self.registers[XLINK + link] & LinkField.ENABLE
            if enabled and self.registers[SLINK + link] >> DIRECTION_SHIFT & 0xF == direction:
                return link
        raise ValueError(
            f"node {self.node:#06x} sends a message for node {node:#06x} in direction {direction}, "
            f"which no enabled link has"
        )

    def answer(self, tokens: Sequence[int] | NDArray[np.uint16]) -> Reply | None:
        """Carry out a control message; returns the answer, or None if it is malformed and therefore dropped.

        A write takes effect before its answer leaves, so that the answer to a write of NODE_ID travels under the new
        node. That is an assumption: the public documents do not say.

        Parameters
        ----------
        tokens : sequence of int
            Tokens with bit 8 set in control tokens, with or without END at the end.
        """
        values = [int(token) for token in tokens]
        if values and values[-1] == END:
            values.pop()
        kind, rest = (values[0], values[1:]) if values else (0, [])
        size = {READC: READ_TOKENS, WRITEC: WRITE_TOKENS}.get(kind)
        if len(values) != size or any(token & CONTROL for token in rest):
            return None
        body = bytes(rest)
        destination = int.from_bytes(body[:3], "big") << 8 | CHANNEL_END_TYPE
        register = int.from_bytes(body[3:5], "big")
        if kind == READC:
            value = self.registers.get(register)
            payload = [NACK] if value is None else [ACK, *value.to_bytes(4, "big")]
        else:
            payload = [ACK if self.write(register, int.from_bytes(body[5:], "big")) else NACK]
        return Reply(destination, np.array([*payload, END], np.uint16))

    def write(self, register: int, value: int) -> bool:
        """Write a register; returns whether it exists and can be written.

        Bits outside its fields are ignored. HELLO in an XLINK register is carried out if the link is enabled, and reads
        as 0. A link that is not enabled has no credit.
        """
        mask = _WRITABLE.get(register)
        if mask is None:
            return False
        self.registers[register] = self.registers[register] & ~mask | value & mask
        link = register - XLINK
        if 0 <= link < LINKS:
            if not value & LinkField.ENABLE:
                self.registers[register] &= ~(LinkField.TX_CREDIT | LinkField.RX_CREDIT | LinkField.RX_ERROR)
            elif value & LinkField.HELLO and self.hello is not None and self.hello(link):
                self.give_credit(link)
        return True


def serve(core: Core, switch: Switch, sent: Sent) -> bool:
    """Answer a control message that a core has sent to its own switch.

    The answer is at the core's channel end `ANSWER_CYCLES` after the message has left, or as soon as the core can take
    it. The core has the switch's node then.

    Parameters
    ----------
    core : Core
    switch : Switch
        Switch of the core.
    sent : Sent
        Messages that the core has sent to the switch.

    Returns
    -------
    bool
        False if there is no answer: the message is malformed, or the answer is for another node or for a channel end
        that does not exist, and is dropped.
    """
    reply = switch.answer(sent.tokens)
    core.set_node(switch.node)
    if reply is None:
        return False
    node, channel_end = reply.destination >> 16, reply.destination >> 8 & 0xFF
    if node != switch.node or channel_end >= CHANNEL_ENDS:
        return False
    at = max(sent.ends + ANSWER_CYCLES, core.earliest_delivery(channel_end))
    core.deliver(channel_end, reply.tokens, np.full(len(reply.tokens), at, np.int64))
    return True


def _link(link: int) -> int:
    if not 0 <= link < LINKS:
        raise ValueError(f"link {link} does not exist; a switch has links 0 to {LINKS - 1}")
    return link
