"""Open what sees the outputs by the scheme of a text.

A capture is plugged in as an entry point of the group ``phasewire.capture``. It names a function that takes the rest of
the text, the output channel of each probe by the probe's name, and the marks that were played so far. The marks grow
while the suite runs. The function returns an `Observer`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType

from ..plugs import named_emulator, opener
from .capture import EmulatorObserver, Observer
from .marks import Mark
from .sigrok import SigrokObserver

__all__ = ["GROUP", "capture_of"]

GROUP = "phasewire.capture"

Opener = Callable[[str, Mapping[str, int], Sequence[Mark]], Observer]


def _sigrok(rest: str, channels: Mapping[str, int], marks: Sequence[Mark]) -> Observer:
    if not rest:
        raise ValueError("'sigrok:' names no file; it should be sigrok:FILE")
    return SigrokObserver(Path(rest), channels, marks)


OWN: Mapping[str, Opener] = MappingProxyType(
    {"emulator": lambda serial, _channels, _marks: EmulatorObserver(named_emulator(serial)), "sigrok": _sigrok}
)
"""The schemes of this package."""


def capture_of(text: str) -> Callable[[Mapping[str, int], Sequence[Mark]], Observer]:
    """What opens a capture by a text such as ``sigrok:FILE``: it takes the output channel of each probe, and the marks.

    Raises `ValueError` if the scheme is unknown; what it returns raises one if the rest of the text is wrong.
    """
    opened, rest = opener(GROUP, OWN, text)
    return partial(opened, rest)
