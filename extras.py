"""Packages that only some commands need; each set of them is an extra of phasewire in pyproject.toml."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .errors import MissingExtraError

__all__ = ["needing"]


@contextmanager
def needing(extra: str, what: str) -> Iterator[None]:
    """Import packages of an extra in this block.

    Parameters
    ----------
    extra : str
        The name of the extra, such as ``"signing"``.
    what : str
        The thing that needs it, for the error: the error's first words.

    Raises
    ------
    MissingExtraError
        If a package is not installed. It says what to install.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"{what} needs the package {error.name}, which is not installed: pip install 'phasewire[{extra}]'"
        ) from error
