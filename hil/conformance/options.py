"""The options of a run of the suite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .cases import Risk
from .profile import Profile

__all__ = ["RunOptions"]


@dataclass(frozen=True)
class RunOptions:
    """The options of a run.

    Parameters
    ----------
    url : str
        The URL by which the host finds the device.
    capture : str or None
        The capture that sees the outputs: ``SCHEME:REST`` such as ``sigrok:FILE`` (`capture_of`), ``emulator`` or
        ``none``. None for the emulator if there is one in this process.
    levers : tuple of str
        What can be done to the device: ``SCHEME:REST`` such as ``command:power=PROGRAM {}`` (`open_levers`), or
        ``emulator``. If there are none, those of the emulator if there is one in this process.
    allowed : frozenset of Risk or None
        The allowed risks; None for none, or for all if the device is emulated in this process.
    profile : Profile
    known : mapping of str to str
        The known failures and their reasons.
    only : tuple of str
        Groups, cases, clauses or chapters, or their beginnings; empty for all.
    seed : int
        Seed of all random numbers.
    enough : int or None
        The run ends after so many cases that break it; None for all of it.
    again : bool
        Whether a case that failed is run once more, which tells a sporadic failure from a permanent one; it breaks the
        run either way.
    doors : tuple of str
        The URLs of further lines of the same device. If there are none, the other line of the emulator if it runs in
        this process.
    groups : tuple of str
        The groups to collect, by their whole names; empty for all. Nothing is known of the cases of others.
    """

    url: str
    capture: str | None = None
    levers: tuple[str, ...] = ()
    allowed: frozenset[Risk] | None = None
    profile: Profile = field(default_factory=Profile)
    known: Mapping[str, str] = field(default_factory=dict)
    only: tuple[str, ...] = ()
    seed: int = 1
    enough: int | None = None
    again: bool = True
    doors: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
