"""Hands at one moment, as a tracker saw them."""

from __future__ import annotations

from dataclasses import dataclass

from ...solver.contact.hand import Hand

__all__ = ["HandFrame", "TrackedHand"]


@dataclass(frozen=True, eq=False)
class TrackedHand:
    """A hand with the number that the tracker gave it.

    Parameters
    ----------
    hand : Hand
        The hand in metres.
    id : int
        Stays the same as long as the tracker follows the hand.
    """

    hand: Hand
    id: int = 0


@dataclass(frozen=True, eq=False)
class HandFrame:
    """All hands that a tracker saw at one moment.

    Parameters
    ----------
    time : float
        When they were seen, in seconds of the source's clock; see `HandSource`.
    hands : tuple of TrackedHand
        None if no hand is in view.
    number : int
        The number of the frame, as the tracker counts them: a gap is a frame that was dropped.
    notes : tuple of str
        What was wrong with the tracker's hands: which ones were repaired or left out, and why.
    """

    time: float
    hands: tuple[TrackedHand, ...] = ()
    number: int = 0
    notes: tuple[str, ...] = ()
