"""A flat shape on a palm that lies still: its static outline against a pointer that moves round it.

Hajas, Pittera, Nasce, Georgiou and Obrist (IEEE Trans. Haptics 13, 2020) let people tell a circle, a square and a
triangle apart, drawn as a whole outline or by one moving point that pauses at corners. Here both are played on an
emulated device, and the same classifier answers by the same features of both: the mean picture on the palm, and where
the middle of the sensation was from moment to moment. All are relative, because nobody knows a shape by its strength.

There are two judges. One is trained on the fields themselves: it may know a shape by any trace that the device leaves,
as a person could after much practice with feedback. The other is trained on drawings, lines of even strength that no
device has emitted: it knows what a circle is, and has never felt one in the air, as the participants.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ...emulator import Emulator
from ...feel.perception import radiation_pressures
from ...feel.unfolding import SkinPatch
from ...host import open_device
from ...protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from ...solver import Circle, Polygon, Solver, TransducerArray
from ...solver.rendering.outline import Outline
from ..sound.emission import emitted_waves
from .judging import Confusion, answered, judged
from .noticing import EVERY, HAND_ERROR, SPACING, WINDOW_SECONDS, blurred, cells_of, noticed, over_time

__all__ = [
    "FLAT_SHAPES",
    "HAJAS",
    "Pointer",
    "drawn_on_palm",
    "features_on_palm",
    "felt_on_palm",
    "run_pointer",
    "walk",
]

SIDE = 0.06
LOOP_SECONDS = 2.0
FLAT_SHAPES = {
    "circle": (Circle(SIDE / 2), 0.0),
    "square": (Polygon(4, SIDE / 2**0.5), 0.300),
    "triangle": (Polygon(3, SIDE / 3**0.5), 0.467),
}
"""Each with the pause at its corners in seconds. Size, pauses and the time of a round in Hajas et al. are second-hand,
from a summary on the first author's site; that the sides have 6 cm, as the circle's diameter, is ours."""
WAYS = ("outline", "pointer")
HAJAS = {"outline": 0.51, "pointer": 0.83}
"""Their share of right answers with pauses at corners, hand at rest, from the same summary."""
MODULATION_HZ = 200.0
PALM = SkinPatch((0.0, 0.0, 0.2), 0.1, 0.1, SPACING)
CELLS = 12
"""Of 1 cm along each side of the picture, which a palm that is not where it seems does not leave."""
MEAN_PICTURE = CELLS**2
IMAGINED, SPOT, STEPS = 10.0, 4e-3, 10
"""Strength of a drawing, well above the threshold; its standard deviation in metres, half the width of a focus; and its
steps within each window of time."""


@dataclass(frozen=True, eq=False)
class Pointer:
    """Answers to both ways."""

    outline: Confusion
    pointer: Confusion
    """Answers to flat shapes as a static outline, and as a moving pointer."""

    @property
    def better(self) -> float:
        """By how much more often the pointer is recognised."""
        return self.pointer.accuracy - self.outline.accuracy

    @property
    def error(self) -> float:
        """Standard error of it, from the differences within persons."""
        differences = self.pointer.persons - self.outline.persons
        return float(differences.std(ddof=1) / len(differences) ** 0.5)

    def record(self) -> dict[str, Any]:
        """The figures, for JSON."""
        return {way: getattr(self, way).record() for way in WAYS} | {
            "pointer_minus_outline": self.better,
            "standard_error": self.error,
        }


def run_pointer(persons: int, repeats: int, seed: int) -> dict[str, Pointer]:
    """Play each shape in both ways once; every person meets each so often, its palm each time a little elsewhere.

    Returns
    -------
    dict of str to Pointer
        The answers of a judge trained on "fields", and of one trained on "drawings".
    """
    shapes = [shape for _ in range(persons * repeats) for shape in FLAT_SHAPES]
    who = [person for person in range(persons) for _ in range(repeats * len(FLAT_SHAPES))]
    found: dict[str, list[Confusion]] = {"fields": [], "drawings": []}
    for way in WAYS:
        chance = np.random.default_rng([seed, WAYS.index(way)])
        felt, drawn = (
            np.stack([features_on_palm(levels[shape], chance) for shape in shapes])
            for levels in (
                {shape: source(shape, way) for shape in FLAT_SHAPES} for source in (felt_on_palm, drawn_on_palm)
            )
        )
        answers = {"fields": judged(felt, shapes, who, seed=seed), "drawings": answered(drawn, shapes, felt, seed=seed)}
        for judge, said in answers.items():
            found[judge].append(Confusion.of(shapes, said, who, tuple(FLAT_SHAPES)))
    return {judge: Pointer(*both) for judge, both in found.items()}


def drawn_on_palm(shape: str, way: str) -> NDArray[np.float64]:
    """A round as a person imagines it, (w, k): a line of even strength, or a spot on it, both as wide as a focus."""
    windows = round(LOOP_SECONDS / WINDOW_SECONDS)
    places = walk(shape, windows * STEPS)
    squares = np.square(PALM.positions[:, None] - places).sum(axis=2)
    spots = IMAGINED * np.exp(-squares / (2 * SPOT**2))
    if way == "outline":
        return np.tile(spots.max(axis=1), (windows, 1))
    return np.asarray(spots.reshape(-1, windows, STEPS).mean(axis=2).T)


def walk(shape: str, count: int) -> NDArray[np.float64]:
    """Places of the pointer at equal steps of time of a round, (count, 3) in metres."""
    drawn, pause = FLAT_SHAPES[shape]
    outline = Outline.of(drawn)
    return outline.walk(count, outline.length / (LOOP_SECONDS - pause * getattr(drawn, "sides", 0)), pause)


def felt_on_palm(shape: str, way: str) -> NDArray[np.float64]:
    """Perceived intensity of one round on a palm at rest, (w, k) relative to the threshold, by an emulated device."""
    array = TransducerArray.grid()
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.stream(_frames(shape, way, array), 2 * MODULATION_HZ)
        capture = emulator.capture()
    first = min(latches[0] for latches in capture.latches) // TICKS_PER_PERIOD
    waves = emitted_waves(capture, array, first, first + round(LOOP_SECONDS * CARRIER_HZ)).waves
    with threadpool_limits(1):
        return over_time(radiation_pressures(array, waves, PALM, every=EVERY), PALM)


def _frames(shape: str, way: str, array: TransducerArray) -> Iterator[NDArray[np.complex128]]:
    """Drives of one round: on in the first half of each period of the modulation, off in the second."""
    solver, count = Solver(array), round(LOOP_SECONDS * MODULATION_HZ)
    if way == "outline":
        drives = [solver.solve(FLAT_SHAPES[shape][0]).drive] * count
    else:
        drives = [solver.solve([place]).drive for place in walk(shape, count)]
    for drive in drives:
        yield drive
        yield np.zeros_like(drive)


def features_on_palm(levels: NDArray[np.float64], chance: np.random.Generator) -> NDArray[np.float64]:
    """The sensations from levels (w, k) on the palm: the mean picture, then place and strength over time."""
    cells = cells_of(PALM)
    places = (cells @ PALM.positions)[:, :2] + HAND_ERROR * chance.standard_normal(2)
    strength = noticed(blurred(levels, PALM) @ cells.T, chance)
    bins = np.floor(places / 0.01).astype(int) + CELLS // 2
    inside = ((bins >= 0) & (bins < CELLS)).all(axis=1)
    which = bins[inside] @ (CELLS, 1)
    visits = np.bincount(which, minlength=MEAN_PICTURE)
    picture = np.bincount(which, strength.mean(axis=0)[inside], minlength=MEAN_PICTURE) / np.maximum(visits, 1)
    total = strength.sum(axis=1)
    middle = strength @ places / np.maximum(total, 1e-12)[:, None]
    parts = picture / max(picture.max(), 1e-12), middle.ravel(), total / max(total.max(), 1e-12)
    return np.concatenate(parts)
