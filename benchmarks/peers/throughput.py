"""What every streamer's script shares: the task, and what came of each way to stream.

It runs in each peer's own environment, so it may import the standard library and NumPy only, and never phasewire.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from contest import Set, attempt
from numpy.typing import NDArray

WARM_UP_SECONDS = 0.2


@dataclass(frozen=True)
class Task(Set):
    """Fresh patterns for all transducers of one device, each sent and acknowledged.

    Parameters
    ----------
    seconds : float
        Duration of each way of sending.
    patterns : int
        Different ones, which are sent in turn.
    """

    seconds: float
    patterns: int

    def random(self, transducers: int, steps: int, seed: int) -> NDArray[np.uint8]:
        """Patterns (patterns, transducers) of whole numbers below ``steps``."""
        return np.random.default_rng(seed).integers(0, steps, (self.patterns, transducers), dtype=np.uint8)


@dataclass(frozen=True)
class Streamed:
    """What came of one stream.

    Parameters
    ----------
    updates : int
        Acknowledged.
    seconds : float
        Time from the first to the last acknowledgement.
    processor : float
        Processor time of the sending process meanwhile, of all threads.
    host : float, optional
        The part of it that was not the emulator's, if that is in the same process and can be told apart.
    """

    updates: int
    seconds: float
    processor: float
    host: float | None = None


@dataclass(frozen=True)
class Way:
    """One way to stream: ``stream`` does so for about as many seconds as it is given.

    Parameters
    ----------
    name : str
    apart : bool
        Whether the emulator runs in a process of its own.
    stream : callable
    """

    name: str
    apart: bool
    stream: Callable[[float], Streamed]


@dataclass(frozen=True)
class Entry:
    """A device that takes part, the ways to stream to it, and what one must know to read their numbers."""

    transducers: int
    ways: list[Way]
    notes: list[str] = field(default_factory=list)


def main(enter: Callable[[Task], Entry]) -> None:
    """Run a streamer's script: ``script TASK.json RESULT.json``."""
    task_path, result_path = map(Path, sys.argv[1:])
    task = Task.load(task_path)
    entry = enter(task)

    def try_way(way: Way) -> dict[str, Any]:
        way.stream(WARM_UP_SECONDS)
        return asdict(way.stream(task.seconds))

    record = {
        "transducers": entry.transducers,
        "ways": [{"name": way.name, "apart": way.apart} | attempt(partial(try_way, way)) for way in entry.ways],
        "notes": entry.notes,
    }
    result_path.write_text(json.dumps(record), encoding="utf-8")
