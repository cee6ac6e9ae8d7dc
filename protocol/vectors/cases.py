"""The form of the vectors: cases, and sections of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..plain import plain

__all__ = ["Section", "Vector", "section", "vector"]

Vector = dict[str, Any]
"""One case: its name, what it shows, bytes, and what they mean."""

Section = dict[str, Any]
"""What cases of one kind have in common, and the cases."""


def vector(name: str, shows: str, **rest: Any) -> Vector:
    """A case, with everything in it made plain."""
    return {"name": name, "shows": shows} | {key: plain(value) for key, value in rest.items()}


def section(about: str, vectors: Iterable[Vector]) -> Section:
    """Cases of one kind under what they have in common."""
    return {"about": about, "vectors": list(vectors)}
