"""What is plugged in to the bench by the scheme of a text, ``SCHEME:REST``: levers, and captures of the outputs.

This package has some schemes of its own; other packages add theirs as entry points of the same group.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...base.plugins import load_by_scheme
from ...emulator import Emulator
from ...emulator.machine import open_emulator

__all__ = ["named_emulator", "opener"]


def opener(group: str, own: Mapping[str, Callable[..., Any]], text: str) -> tuple[Callable[..., Any], str]:
    """What opens a text ``SCHEME:REST``, and the rest of it.

    The schemes are this package's own, and the names of a group of entry points. Raises `ValueError` if the scheme is
    unknown, and names the known ones; or if it cannot be loaded.
    """
    opens = load_by_scheme(
        group,
        text,
        lambda known: f"{text!r} is not known in {group}; it should begin with one of {known}",
        ValueError,
        own,
    )
    return opens, text.partition(":")[2]


def named_emulator(serial: str) -> Emulator:
    """The emulated device of this process with a serial number; raises `ValueError` if there is none."""
    emulator = open_emulator(serial)
    if emulator is None:
        raise ValueError(f"emulator:{serial} goes with a device that is emulated in this process alone")
    return emulator
