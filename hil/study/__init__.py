"""The paper's user study, simulated: hands explore objects, and a classifier answers by what skin could feel.

A person (`persons`) explores an object; hands go the whole way to the bits of an emulated device (`trials`); what these
emit moves the skin, and a noisy person notices some of it (`noticing`, `features`); a classifier that was trained on
other persons answers (`judging`). `pointer` compares two ways to draw a flat shape on a palm. `running` does it all.
"""

from __future__ import annotations

from .judging import Confusion
from .running import Study, run_study

__all__ = ["Confusion", "Study", "run_study"]


def __dir__() -> list[str]:
    return __all__
