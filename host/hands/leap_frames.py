"""Frames as the Leap and Ultraleap service writes them in JSON, protocol version 6, and the hands that are in them.

Lengths are in millimetres. Its axes are right-handed: x to the right, y up from the tracker, z towards the user.
Without a pose file the tracker lies at the centre of the array and looks up: its x, y and z are x, z and -y of the
array.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...solver.contact.hand import Hand
from .frames import TrackedHand

__all__ = ["MOST_HANDS", "hands_of", "whole"]

MOST_HANDS = 16
TO_ARRAY = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) * 1e-3
"""From millimetres by the tracker's axes to metres by the array's."""
JOINTS = ("mcpPosition", "pipPosition", "dipPosition", "tipPosition")
"""Of each finger, from the base to the tip. The thumb's have the same names, each for the joint before it: its
``mcpPosition`` is where it meets the wrist, its ``pipPosition`` the knuckle."""
FINGERS = ("thumb", "index", "middle", "ring", "little")
LEAST_KNUCKLES, MOST_KNUCKLES = 30.0, 130.0
"""Between the outer knuckles of a hand, in mm. The public recordings have 62 to 74."""
LEAST_WIDTH, MOST_WIDTH = 4.0, 40.0
"""Of a finger, in mm."""
FARTHEST = 5000.0
"""From the tracker, in mm: several times what one can see."""
WRIST = 1.47
"""From the middle of the knuckles to the wrist, in widths of the knuckles. Frames of newer services name the wrist, and
have this; older services, in all public recordings, leave it out."""


def hands_of(frame: Mapping[str, Any]) -> tuple[tuple[TrackedHand, ...], tuple[str, ...]]:
    """The hands in a frame.

    Parameters
    ----------
    frame : mapping
        What its JSON says.

    Returns
    -------
    hands : tuple of TrackedHand
        Those that can be used.
    notes : tuple of str
        A text for each hand that was left out or repaired, and why.

    Raises
    ------
    ValueError
        If it is no frame.
    """
    fingers: dict[int, dict[int, Mapping[str, Any]]] = {}
    for finger in _records(frame, "pointables", len(FINGERS) * MOST_HANDS):
        owner, kind = whole(finger.get("handId")), _kind(finger)
        if kind is not None and owner is not None:
            fingers.setdefault(owner, {})[kind] = finger
    hands: dict[int, TrackedHand] = {}
    notes: list[str] = []
    for said in _records(frame, "hands", MOST_HANDS):
        number = whole(said.get("id"))
        try:
            if number is None or number in hands:
                raise ValueError("its id is no whole number, or that of another hand")
            hand, repairs = _hand(said, fingers.get(number, {}))
            hands[number] = TrackedHand(hand, number)
            notes.extend(f"hand {number}: {repair}" for repair in repairs)
        except ValueError as error:
            notes.append(f"hand {str(said.get('id'))[:20]} is left out: {error}")
    return tuple(hands.values()), tuple(notes)


def whole(value: object) -> int | None:
    """A whole number of 64 bits, as ids are; None if it is something else."""
    return value if isinstance(value, int) and abs(value) < 2**63 else None


def _records(frame: Mapping[str, Any], name: str, most: int) -> list[Mapping[str, Any]]:
    """A list of objects in a frame."""
    found = frame.get(name)
    if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
        raise ValueError(f"a frame has a list of {name}, and this has none")
    if len(found) > most:
        raise ValueError(f"a frame may have {most} {name}, and this has {len(found)}")
    return found


def _kind(finger: Mapping[str, Any]) -> int | None:
    """Which finger it is, 0 for a thumb. Packed recordings do not say it, but its id is its hand's, then this digit."""
    kind, owner, number = finger.get("type"), whole(finger.get("handId")), whole(finger.get("id"))
    if kind is None and number is not None and number // 10 == owner:
        kind = number % 10
    return kind if kind in range(len(FINGERS)) and not finger.get("tool") else None


def _hand(said: Mapping[str, Any], fingers: Mapping[int, Mapping[str, Any]]) -> tuple[Hand, tuple[str, ...]]:
    """The hand that a service describes, and what was repaired; raises ValueError if it cannot be used."""
    side = said.get("type")
    if side not in ("left", "right"):
        raise ValueError("it is neither left nor right")
    if lost := [name for kind, name in enumerate(FINGERS) if kind not in fingers]:
        raise ValueError(f"it has no {' and no '.join(lost)} finger")
    joints = _points(
        (fingers[kind].get(name) for kind in range(len(FINGERS)) for name in JOINTS), "the joints of its fingers"
    )
    knuckles = joints[len(JOINTS) :: len(JOINTS)]
    across = float(np.linalg.norm(knuckles[0] - knuckles[-1]))
    if not LEAST_KNUCKLES <= across <= MOST_KNUCKLES:
        metres = "; its tracker seems to give metres instead of millimetres" * (across < 1)
        raise ValueError(
            f"its knuckles are {across:.3g} mm wide, not {LEAST_KNUCKLES:g} to {MOST_KNUCKLES:g} mm{metres}"
        )
    wrist = _wrist(said, knuckles.mean(axis=0), across)
    if (farthest := float(np.abs(joints).max(initial=float(np.abs(wrist).max())))) > FARTHEST:
        raise ValueError(f"it is {farthest:.3g} mm away")
    return Hand.repaired(np.vstack([wrist, joints]) @ TO_ARRAY.T, side, _widths(fingers))


def _widths(fingers: Mapping[int, Mapping[str, Any]]) -> NDArray[np.float64] | None:
    """(5,) breadth of the fingers in metres; None, for those of the hand's size, if one is missing or cannot be."""
    widths = [fingers[kind].get("width") for kind in range(len(FINGERS))]
    if all(isinstance(width, (int, float)) and LEAST_WIDTH <= width <= MOST_WIDTH for width in widths):
        return np.array(widths, dtype=np.float64) * 1e-3
    return None


def _wrist(said: Mapping[str, Any], middle: NDArray[np.float64], across: float) -> NDArray[np.float64]:
    """The wrist as the service says it, or else from the hand's direction, or from its palm."""
    if said.get("wrist") is not None:
        wrist: NDArray[np.float64] = _points([said["wrist"]], "its wrist")[0]
        return wrist
    if said.get("direction") is not None:
        ahead = _points([said["direction"]], "its direction")[0]
    else:
        ahead = middle - _points([said.get("palmPosition")], "its palm")[0]
    length = float(np.linalg.norm(ahead))
    if not 1e-3 < length < 1e3:
        raise ValueError("its direction is none")
    behind: NDArray[np.float64] = middle - WRIST * across / length * ahead
    return behind


def _points(values: Iterable[Any], what: str) -> NDArray[np.float64]:
    """(k, 3) finite coordinates."""
    every = list(values)
    try:
        points = np.array(every, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{what} are not all places of three coordinates") from error
    if points.shape != (len(every), 3) or not np.isfinite(points).all():
        raise ValueError(f"{what} are not all places of three coordinates")
    return points
