"""A shell's completions for the URL of a device or of a source of hands.

They run while somebody types: no function here may be slow, write anything, or fail.
"""

from __future__ import annotations

from ..base.plugins import entries
from ..host.finding.discovery import search
from ..host.transports.opening import SCHEMES

__all__ = ["device_urls", "hand_urls"]

HANDS = "phasewire.hands"
"""The entry-point group of transports, whose own module is slow to load."""


def device_urls(incomplete: str) -> list[tuple[str, str]]:
    """Beginnings of URLs, and the URLs of the devices that can be found, each with what it is."""
    names = sorted(entries(SCHEMES))
    fitting = [name for name in names if f"{name}:".startswith(incomplete) or incomplete.startswith(f"{name}:")]
    offered = [(f"{name}:", "") for name in fitting]
    offered += [(found.url, f"{found.product}, {found.location}") for found in search(fitting).found]
    return [(url, about) for url, about in offered if url.startswith(incomplete)]


def hand_urls(incomplete: str) -> list[str]:
    """Beginnings of URLs of sources of hands."""
    return [f"{name}:" for name in sorted(entries(HANDS)) if f"{name}:".startswith(incomplete)]
