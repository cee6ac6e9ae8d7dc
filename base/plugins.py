"""Plug-ins: what this and other packages offer under a name, or a URL's scheme, in a group of entry points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType
from typing import Any

__all__ = ["entries", "load", "load_by_scheme"]


@cache
def entries(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group by their names; they are looked for once, because that takes milliseconds."""
    return {entry.name: entry for entry in entry_points(group=group)}


def load(entry: EntryPoint, what: str, failure: type[Exception]) -> Any:
    """Load a plug-in; if that fails, raise ``failure``, whose text begins with ``what``."""
    try:
        return entry.load()
    except Exception as error:  # it may be another package's, and raise whatever it likes
        raise failure(f"{what} cannot be loaded: {error}") from error


def load_by_scheme(
    group: str,
    url: str,
    unknown: Callable[[str], str],
    failure: type[Exception],
    own: Mapping[str, Any] = MappingProxyType({}),
) -> Any:
    """Load the plug-in of a group that is named as the URL's scheme.

    Parameters
    ----------
    group : str
        Group of entry points.
    url : str
        ``SCHEME:REST``.
    unknown : callable
        The error's text if there is no such scheme; takes a list of the known ones.
    failure : type
        Type of the errors.
    own : mapping
        Objects that need no entry point; their schemes come first.
    """
    scheme, colon, _ = url.partition(":")
    there = entries(group)
    if not colon or scheme not in own | there.keys():
        raise failure(unknown(", ".join(f"{name}:" for name in sorted({*own, *there}))))
    if scheme in own:
        return own[scheme]
    return load(there[scheme], f"{url!r}: {there[scheme].value}, which is to open it,", failure)
