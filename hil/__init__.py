"""How to prove that it works: checks that stand outside both ends and compare them.

This room may import every other one. It holds the conformance suite (`conformance`), which judges any device; the
end-to-end check, which compares the intended drive with the square waves that a device plays and with their pressure;
the reconstruction of sound from captured bits; and
what skin and ears get of it.
"""

from __future__ import annotations

from .loop.end_to_end import Check, EndToEnd, run_end_to_end
from .loop.rig_run import RigRun, run_rig
from .loop.sensing import Sensation, sense
from .loop.touching import TouchRun, run_touch
from .sound.air import Playback
from .sound.emission import EmittedWaves, emitted_waves

__all__ = [
    "Check",
    "EmittedWaves",
    "EndToEnd",
    "Playback",
    "RigRun",
    "Sensation",
    "TouchRun",
    "emitted_waves",
    "run_end_to_end",
    "run_rig",
    "run_touch",
    "sense",
]


def __dir__() -> list[str]:
    return __all__
