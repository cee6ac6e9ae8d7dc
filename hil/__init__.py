"""How to prove that it works: checks that stand outside both ends and compare them.

This room may know everybody. It holds the conformance suite (`conformance`), by which any device is judged; the
end-to-end check, from the intended drive to the square waves that a device really plays and the pressure that they
make; and the way of any captured bits back into the air.
"""

from __future__ import annotations

from .air import Playback
from .end_to_end import Check, EndToEnd, run_end_to_end
from .touching import TouchRun, run_touch

__all__ = ["Check", "EndToEnd", "Playback", "TouchRun", "run_end_to_end", "run_touch"]
