"""Touch, live: hands from a tracker meet objects, and a device plays what they should feel.

This room takes hands from a source, asks the solver's contact room where they touch, and keeps a device playing the
newest answer. Everything in it waits by the device's clock, so that an emulated device needs no wall time.
"""

from __future__ import annotations

from .loop import TouchLoop, TouchMoment
from .report import TouchReport

__all__ = ["TouchLoop", "TouchMoment", "TouchReport"]
