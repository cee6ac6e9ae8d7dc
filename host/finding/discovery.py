"""Which devices there are, on all lines that are known here, those of other packages included."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ...base.errors import DeviceNotFoundError
from ...base.plugins import entries
from ..transports.opening import SCHEMES
from ..transports.transport import Found, Scheme

__all__ = ["Search", "search"]


class Search(NamedTuple):
    """What was found, and where it could not be looked."""

    found: list[Found]
    """Devices by scheme, as each line tells them. A device that has two lines is found twice."""
    failures: Mapping[str, str]
    """By scheme, why nothing could be found there."""


def search(schemes: Iterable[str] | None = None) -> Search:
    """Look for devices on each line; one that fails does not hide the others.

    Parameters
    ----------
    schemes : iterable of str, optional
        Beginnings of URLs, such as ``usb``; by default all that are known.

    Raises
    ------
    DeviceNotFoundError
        If a scheme is unknown.
    """
    known = entries(SCHEMES)
    names = sorted(known) if schemes is None else list(schemes)
    if unknown := [name for name in names if name not in known]:
        raise DeviceNotFoundError(f"no transport {unknown[0]!r}; known are {', '.join(sorted(known))}")
    found: list[Found] = []
    failures: dict[str, str] = {}
    for name in names:
        try:
            scheme: Scheme = known[name].load()
            found += scheme.find()
        except Exception as error:  # it may be another package's, and do whatever it likes
            failures[name] = str(error) or type(error).__name__
    return Search(found, failures)
