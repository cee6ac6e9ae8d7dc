"""The normative layout of every byte that travels, as construct definitions: one module for each part of SPEC.md.

Integers are little-endian unless a name says otherwise. These definitions are the reference; if a faster twin
exists beside them, tests hold the two together.
"""

from __future__ import annotations

from typing import Any

from construct import Construct, ConstructError

__all__ = ["build"]


def build(layout: Construct, fields: Any, what: object) -> bytes:
    """Encode fields; raise `ValueError`, which names what they are of, if one does not fit the layout."""
    try:
        return bytes(layout.build(fields))
    except ConstructError as error:
        raise ValueError(f"{what} does not fit its layout: {error}") from error
