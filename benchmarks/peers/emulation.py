"""What every emulator's script shares: the scene, timing, writing the results.

It runs in each peer's own environment, so it may import the standard library and NumPy only, and never phasewire.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from contest import Set, attempt, measure

TIME_STEP_NS = 500
"""Of instantaneous fields: a tick of phasewire's outputs."""
WARM_UP_SECONDS = 0.5e-3
"""Of the device's time: enough for kernels to be loaded and tables to be made."""


@dataclass(frozen=True)
class Scene(Set):
    """A focus above the middle of the array, modulated by a sine, and a square of points around it.

    Parameters
    ----------
    height, side : float
        Height of the focus and side of the square, m.
    points : int
        Points along each side of the square.
    modulation : float
        Frequency, Hz; `samples` steps go from silence to all and back.
    samples : int
    stretches : dict of float
        Seconds of the device's time for each row.
    budget : float
        Seconds to spend on timing one row; a call that takes longer is made once.
    """

    height: float
    side: float
    points: int
    modulation: float
    samples: int
    stretches: dict[str, float]
    budget: float


@dataclass(frozen=True)
class Entry:
    """An emulator that takes part.

    Parameters
    ----------
    transducers : int
        Number of transducers of its device.
    record : callable
        Takes seconds; has the scene played for so long, beginning at rest, and returns the recording.
    rows : dict of callable
        A function for each row that takes a recording and its seconds to an array or frame with a shape, or
        several; of a field that is (points, moments).
    notes : list of str
        What one must know to read the numbers.
    """

    transducers: int
    record: Callable[[float], Any]
    rows: dict[str, Callable[[Any, float], Any]]
    notes: list[str] = field(default_factory=list)


RECORD = "record"
FIELDS = ("rms field", "instantaneous field")


def row_case(entry: Entry, scene: Scene, row: str) -> dict[str, Any]:
    """Time one row, and look at what came out."""
    seconds = scene.stretches[row]
    if row == RECORD:
        _, times = measure(lambda: entry.record(seconds), scene.budget, 1)
        return {"times": times, "shapes": []}
    recording = entry.record(seconds)
    result, times = measure(lambda: entry.rows[row](recording, seconds), scene.budget, 1, warm_up=0)
    arrays = result if isinstance(result, tuple) else (result,)
    case: dict[str, Any] = {"times": times, "shapes": [list(array.shape) for array in arrays]}
    if row in FIELDS:
        loudness = np.sqrt(np.mean(np.square(np.asarray(result)), axis=1)).reshape(scene.points, scene.points)
        case["loudest"] = [int(place) for place in np.unravel_index(int(loudness.argmax()), loudness.shape)]
        case["rms_pa"] = float(loudness.max())
    return case


def main(enter: Callable[[Scene], Entry]) -> None:
    """Run an emulator's script: ``script SCENE RESULT.json``."""
    scene_path, result_path = map(Path, sys.argv[1:])
    scene = Scene.load(scene_path)
    small = enter(replace(scene, points=2))
    recording = small.record(WARM_UP_SECONDS)
    for call in small.rows.values():
        call(recording, WARM_UP_SECONDS)
    entry = enter(scene)
    cases = {row: attempt(lambda row=row: row_case(entry, scene, row)) for row in scene.stretches}  # type: ignore[misc]  # lambda
    record = {"transducers": entry.transducers, "rows": cases, "notes": entry.notes}
    result_path.write_text(json.dumps(record), encoding="utf-8")
