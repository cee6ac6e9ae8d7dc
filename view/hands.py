"""Hands for a view: the one that a page moves, and any other at the pace of the wall clock."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from threading import Event, Thread

import numpy as np

from ..host.hands.frames import HandFrame, TrackedHand
from ..host.hands.sources import HandSource, LiveHands, PlayedHands
from ..solver.contact.hand import Hand
from .settings import HandSetting

__all__ = ["MouseHands", "at_wall_pace", "hand_at"]

RATE = 100.0
SMOOTH_SECONDS = 0.04
"""Time constant of the hand's motion to the place that a page names: a mouse moves in steps."""


def hand_at(setting: HandSetting) -> Hand:
    """The hand that a page describes."""
    hand = Hand.flat((setting.x, setting.y, setting.z), curl=setting.curl)
    return hand.rotated(setting.turn) if setting.turn else hand


class MouseHands(LiveHands):
    """A hand that follows what a page says, in even steps, from where a setting puts it."""

    def __init__(self, setting: HandSetting) -> None:
        super().__init__("the hand of the page", RATE)
        hand_at(setting)  # loads what is compiled, which a thread must not do while the program ends
        self._wanted = setting
        self._now = np.array(_numbers(setting))
        self._stop = Event()
        self._thread = Thread(target=self._move, name="phasewire hand", daemon=True)
        self._thread.start()

    def follow(self, setting: HandSetting) -> None:
        """Go there. Any thread may call it."""
        self._wanted = setting

    def close(self) -> None:
        """Stop it."""
        self._stop.set()
        self._thread.join()
        super().close()

    def _move(self) -> None:
        share = 1 - math.exp(-1 / (RATE * SMOOTH_SECONDS))
        number = 0
        while not self._stop.wait(1 / RATE):
            self._now += share * (np.array(_numbers(self._wanted)) - self._now)
            hand = hand_at(HandSetting(*self._now.tolist()))
            self.put(HandFrame(time.monotonic(), (TrackedHand(hand, 1),), number))
            number += 1


class _PacedHands(PlayedHands):
    """Frames of a gesture or a recording whose times are by the wall clock, as a tracker's are.

    A loop of touch then lets an emulated device's time follow that clock. Numbers are counted, as those of a recording
    may stand still or go back.
    """

    live = True


def at_wall_pace(source: HandSource) -> HandSource:
    """A source of hands, opened with the module `time` as its clock, that keeps the pace of the wall clock."""
    if source.live:
        return source
    counted = (replace(frame, number=number) for number, frame in enumerate(source))
    paced = _PacedHands(source.name, counted, source.rate, close=source.close)
    paced.notes = source.notes
    return paced


def _numbers(setting: HandSetting) -> tuple[float, float, float, float, float]:
    return setting.x, setting.y, setting.z, setting.turn, setting.curl
