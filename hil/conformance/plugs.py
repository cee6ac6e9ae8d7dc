"""What is plugged in to the bench by the scheme of a text, ``SCHEME:REST``: levers, and captures of the outputs.

This package has some schemes of its own; other packages add theirs as entry points of the same group.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...emulator import Emulator
from ...emulator.machine import open_emulator
from ...host.transports.opening import entries

__all__ = ["named_emulator", "opener"]


def opener(group: str, own: Mapping[str, Callable[..., Any]], text: str) -> tuple[Callable[..., Any], str]:
    """What opens a text ``SCHEME:REST``, and the rest of it.

    The schemes are this package's own, and the names of a group of entry points. Raises `ValueError` if the scheme is
    unknown, and names the known ones; or if it cannot be loaded.
    """
    scheme, colon, rest = text.partition(":")
    there = entries(group)
    if not colon or scheme not in own | there.keys():
        known = ", ".join(f"{name}:" for name in sorted({*own, *there}))
        raise ValueError(f"{text!r} is not known in {group}; it should begin with one of {known}")
    if scheme in own:
        return own[scheme], rest
    try:
        return there[scheme].load(), rest
    except Exception as error:  # another package may raise whatever it likes
        raise ValueError(f"{text!r}: {there[scheme].value}, which should open it, cannot be loaded: {error}") from error


def named_emulator(serial: str) -> Emulator:
    """The emulated device of this process with a serial number; raises `ValueError` if there is none."""
    emulator = open_emulator(serial)
    if emulator is None:
        raise ValueError(f"emulator:{serial} goes with a device that is emulated in this process alone")
    return emulator
