"""Versions of firmware (SPEC.md, clause FWU-004)."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Version"]


class Version(NamedTuple):
    """A firmware version; a newer one is larger."""

    major: int
    minor: int
    patch: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.patch}"

    @property
    def valid(self) -> bool:
        """Whether binary-coded decimal holds it: at most 99.9.9 (clause FWU-004)."""
        return 0 <= self.major <= 99 and 0 <= self.minor <= 9 and 0 <= self.patch <= 9

    @property
    def bcd(self) -> int:
        """As USB's bcdDevice, 16 bits."""
        return int(f"{self.major}{self.minor}{self.patch}", 16)
