"""Packages that only some commands need; each set of them is an extra of phasewire in pyproject.toml."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .errors import MissingExtraError

__all__ = ["install_command", "needing"]


def install_command(extra: str) -> str:
    """The command that adds an extra, from the place that phasewire was installed from (PEP 610)."""
    import json  # all this is slow to import, and only an error needs it
    from importlib.metadata import distributions
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    records = (each.read_text("direct_url.json") for each in distributions(name="phasewire"))
    origin = json.loads(next(filter(None, records), "{}"))
    url = origin.get("url", "")
    if origin.get("dir_info", {}).get("editable"):
        return f"pip install --editable '{url2pathname(urlsplit(url).path)}[{extra}]'"
    if "vcs_info" in origin:
        url = f"{origin['vcs_info']['vcs']}+{url}"
    return f"pip install 'phasewire[{extra}]{f' @ {url}' if url else ''}'"


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
        If a package is not installed, or is too old or broken. It says what to install.
    """
    try:
        yield
    except ImportError as error:
        why = "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be used ({error})"
        raise MissingExtraError(
            f"{what} needs the package {error.name}, which {why}: {install_command(extra)}"
        ) from error
