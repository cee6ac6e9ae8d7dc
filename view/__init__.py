"""The live page: what happens on and above the array, in a browser, while it happens, and the controls to change it.

A `Snapshot` is what there is to see at one moment. It is taken in the thread that plays on the device (`Tap`), painted
and packed in a thread of the view, and sent by a server of its own to every page that is open: the newest one only,
when the page has taken in the last. `Studio` plays what the page asks for; `View` alone shows what a program gives it.
This room decides nothing that the outputs do: it calls `host` and reads captures.
"""

from __future__ import annotations

from .snapshot import Rig, Snapshot
from .view import View

__all__ = ["Rig", "Snapshot", "View"]


def __dir__() -> list[str]:
    return __all__
