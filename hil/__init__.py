"""How to prove that it works: checks that stand outside both ends and compare them.

This room may import every other one. It holds the conformance suite (`conformance`), which judges any device; the
end-to-end check, which compares the intended drive with the square waves that a device plays and with their pressure;
and the reconstruction of sound from captured bits.
"""

from __future__ import annotations

from .air import Playback
from .end_to_end import Check, EndToEnd, run_end_to_end
from .touching import TouchRun, run_touch

__all__ = ["Check", "EndToEnd", "Playback", "TouchRun", "run_end_to_end", "run_touch"]


def __dir__() -> list[str]:
    return __all__
