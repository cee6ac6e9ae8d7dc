"""Versions of firmware (SPEC.md, clause FWU-004)."""

from __future__ import annotations

from typing import NamedTuple, Self

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

    @classmethod
    def from_bcd(cls, bcd: int) -> Self:
        """The version that a bcdDevice tells (clause FWU-004), whatever its digits are."""
        tens, major, minor, patch = (bcd >> shift & 0xF for shift in (12, 8, 4, 0))
        return cls(10 * tens + major, minor, patch)
