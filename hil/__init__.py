"""How to prove that it works: checks that stand outside both ends and compare them.

This room may know everybody. It holds the end-to-end check, from the intended drive to the square waves that a device
really plays and the pressure that they make.
"""

from __future__ import annotations

from .end_to_end import Check, EndToEnd, run_end_to_end

__all__ = ["Check", "EndToEnd", "run_end_to_end"]
