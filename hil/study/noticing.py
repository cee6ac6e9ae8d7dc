"""The sensations of a trial: places on the hand, strengths, and the places of the hand, all of them noisy.

The chain is physical up to the motion of the skin over the thresholds of touch (`feel`). What follows here is a person,
in four numbers from the literature, which were set before any result was seen:

- Place on the skin is blurred: a point is localised with a mean error of 8.5 mm (Wilson, Carter, Subramanian and
  Brewster, CHI 2014), which is σ = 8.5 mm/√(π/2) along each axis.
- Strength has a relative error of 0.2, Weber's fraction at 125 Hz (Forta, Morioka and Griffin, 2012), in each window
  and cell of skin anew. What seems weaker than the threshold is not felt.
- The unseen hand is somewhere else than it seems: joints of the arm are known to 0.6° to 1.1° (van Beers, Sittig and
  Denier van der Gon, Exp. Brain Res. 122, 1998), so that a hand 0.6 m from the shoulder is known to 10 mm along each
  axis. The error stays the same throughout a trial, as in people (Rincon-Gonzalez, Buneo and Helms Tillery, PLoS ONE 6,
  2011).
- Sensations are told apart in time if they are 50 ms apart, ten periods of the modulation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...feel.perception import felt_map, radiation_pressures
from ...feel.unfolding import SkinPlaces, Unfolded
from ...protocol.board import CARRIER_HZ
from ...solver import TransducerArray
from ..sound.emission import emitted_waves
from .persons import Exploration
from .trials import PlayedTrial

__all__ = ["Sensed", "blurred", "cells_of", "felt_on_hand", "noticed", "over_time", "sensed"]

BLUR = 8.5e-3 / math.sqrt(math.pi / 2)
WEBER = 0.2
HAND_ERROR = 0.01
WINDOW_SECONDS = 0.05

SPACING = 4.5e-3
"""Of places of skin, in metres: an intensity across has no period below 9 mm, because waves from opposite edges of the
array meet at angles whose sines are at most 0.5 to either side."""
CELL = 0.01
"""Side of the cells of skin within which places are not told apart, in metres: below the blur's width of 16 mm."""
POSE_PERIODS = 320
"""8 ms, about a frame of the tracker, in which the hand moves by less than 2 mm."""
EVERY = 20
"""Carrier periods between samples of the pressure: 2 kHz, as no channel of touch answers above 1 kHz."""


class Sensed(NamedTuple):
    """The sensations of a person in a trial."""

    levels: NDArray[np.float64]
    """(w, c) perceived intensity in each window and cell of skin, relative to the threshold; 0 if not felt."""
    places: NDArray[np.float64]
    """(w, c, 3) where the cells seemed to be, in metres."""


def cells_of(skin: SkinPlaces) -> NDArray[np.float64]:
    """The matrix that takes the mean over each square of `CELL` of the laid-out skin, (c, k)."""
    rows, columns = np.nonzero(skin.mask)
    squares = np.floor(np.stack([rows, columns], axis=1) * (skin.spacing / CELL) + 1e-9)
    owner = np.unique(squares, axis=0, return_inverse=True)[1].ravel()
    inside = (owner == np.arange(owner.max() + 1)[:, None]).astype(np.float64)
    return np.asarray(inside / inside.sum(axis=1, keepdims=True))


def blurred(levels: NDArray[np.float64], skin: SkinPlaces) -> NDArray[np.float64]:
    """Levels (w, k) as mean over the skin around each place, weighed by the blur; beside the skin there is nothing."""
    from scipy.ndimage import gaussian_filter

    sigma = BLUR / skin.spacing
    grid = np.zeros((len(levels), *skin.mask.shape))
    grid[:, skin.mask] = levels
    share = gaussian_filter(skin.mask.astype(np.float64), sigma)
    spread = gaussian_filter(grid, (0, sigma, sigma))
    return np.asarray((spread / np.maximum(share, 1e-12))[:, skin.mask])


def noticed(levels: NDArray[np.float64], chance: np.random.Generator) -> NDArray[np.float64]:
    """Levels with Weber's error; what is below the threshold is 0."""
    noisy = levels * (1 + WEBER * chance.standard_normal(levels.shape))
    return np.where(noisy >= 1, noisy, 0.0)


def felt_on_hand(
    played: PlayedTrial, path: Exploration, array: TransducerArray
) -> tuple[NDArray[np.float64], Unfolded]:
    """Perceived intensity of the skin of a moving hand, before any error of a person.

    Returns
    -------
    levels : (w, k) float
        The levels in windows of 50 ms, relative to the threshold.
    skin : Unfolded
        The k places, on the hand at the origin.
    """
    waves = emitted_waves(played.capture, array, played.first, played.last).waves
    skin = Unfolded.of(path.hand, SPACING)
    pressures = []
    for start in range(0, len(waves), POSE_PERIODS):
        pose = skin.at(path.at((start + POSE_PERIODS / 2) / CARRIER_HZ))
        pressures.append(radiation_pressures(array, waves[start : start + POSE_PERIODS], pose, every=EVERY))
    return over_time(np.concatenate(pressures), skin), skin


def over_time(pressures: NDArray[np.float32], skin: SkinPlaces) -> NDArray[np.float64]:
    """Perceived intensity (w, k) in windows of 50 ms of a pressure (t, k) at every `EVERY` periods, which then ends."""
    rate = CARRIER_HZ / EVERY
    windows = max(round(len(pressures) / rate / WINDOW_SECONDS), 1)
    silence = np.zeros((len(pressures) // windows, pressures.shape[1]), np.float32)  # in which waves fade
    return felt_map(np.concatenate([pressures, silence]), skin, rate).intensity_over_time(WINDOW_SECONDS)[:windows]


def sensed(
    levels: NDArray[np.float64], skin: Unfolded, path: Exploration, seconds: float, chance: np.random.Generator
) -> Sensed:
    """The sensations from levels (w, k) on the skin of a hand that explores for so many seconds."""
    cells = cells_of(skin)
    error = HAND_ERROR * chance.standard_normal(3)
    times = (np.arange(len(levels)) + 0.5) * seconds / len(levels)
    places = np.stack([cells @ skin.at(path.at(time)).positions for time in times])
    return Sensed(noticed(blurred(levels, skin) @ cells.T, chance), places + error)
