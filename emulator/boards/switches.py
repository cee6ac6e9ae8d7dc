"""Where the switches of the chain send a message (SPEC.md, chapter CHN). How long it takes is `links`' affair.

A *node* is what a switch is set up as and what a route header names, 16 bits: 0 to 9, 00FF for the controller, FFFF for
a processor without a number. A *processor* is a place in the chain, whatever its node is at the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from ...protocol.codes import CONTROLLER_NODE, UNNUMBERED_NODE

__all__ = ["Destination", "Direction", "destination", "route"]

DOWN_FROM_BIT = 8
UP_FROM_BIT = 4


class Direction(Enum):
    """Where a switch passes a message on to."""

    HERE = "here"
    """To a channel end of its own."""
    DOWN = "down"
    """Away from the controller."""
    UP = "up"
    """Towards the controller."""


def route(own: int, node: int) -> Direction:
    """Where a switch sends a message (clause CHN-025).

    Parameters
    ----------
    own : int
        The node that the switch is set up as.
    node : int
        The node that the message's header names.
    """
    if own == node:
        return Direction.HERE
    if own == CONTROLLER_NODE:  # it has one link
        return Direction.DOWN
    if own == UNNUMBERED_NODE:
        return Direction.UP
    bit = (own ^ node).bit_length() - 1
    if bit >= DOWN_FROM_BIT:
        return Direction.DOWN
    if bit >= UP_FROM_BIT or own >> bit & 1:
        return Direction.UP
    return Direction.DOWN


class Destination(NamedTuple):
    """How far a message from the controller comes."""

    processor: int
    """The last processor that it comes to."""
    reached: bool
    """Whether it is for that one; else it is for nobody, and stays there for ever."""


def destination(nodes: Sequence[int], node: int) -> Destination:
    """Where a message from the controller ends: at a processor, or where a switch cannot pass it on (clause CHN-023).

    That is behind the last processor of the chain, or where a switch would send it back to where it came from.

    Parameters
    ----------
    nodes : sequence of int
        What the processors' switches are set up as, in the order of the chain; at least one.
    node : int
        The node that the message's header names.

    Raises
    ------
    ValueError
        If the chain has no processor.
    """
    if not nodes:
        raise ValueError("a chain without processors carries no message; at least one")
    for processor, own in enumerate(nodes):
        direction = route(own, node)
        if direction is not Direction.DOWN:
            return Destination(processor, direction is Direction.HERE)
    return Destination(len(nodes) - 1, reached=False)
