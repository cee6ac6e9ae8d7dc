"""How to prove that it works: checks that stand outside both ends and compare them.

This room may import every other one. It holds the conformance suite (`conformance`), which judges any device; the
end-to-end check, which compares the intended drive with the square waves that a device plays and with their pressure;
the reconstruction of sound from captured bits; and
what skin and ears get of it.
"""

from __future__ import annotations

from .air import Playback
from .emission import EmittedWaves, emitted_waves
from .end_to_end import Check, EndToEnd, run_end_to_end
from .rig_run import RigRun, run_rig
from .sensing import Sensation, sense
from .touching import TouchRun, run_touch

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
