"""Open the transport that a URL names, by its scheme.

A scheme is an entry point in the group ``phasewire.transports`` that names a `Scheme`. Other packages may add their
own.
"""

from __future__ import annotations

import os
import re
from typing import Any

from ...base import plugins
from ...base.errors import DeviceNotFoundError, DeviceUrlError, PhasewireError
from .tracing import traced
from .transport import Scheme, Transport

__all__ = [
    "DEFAULT_URL",
    "MEANT",
    "RIG",
    "SCHEMES",
    "URL_VARIABLE",
    "default_url",
    "is_fresh",
    "load_by_scheme",
    "open_transport",
    "open_untraced",
    "refuse_rig",
]

DEFAULT_URL = "emulator:"
URL_VARIABLE = "PHASEWIRE_DEVICE"
SCHEMES = "phasewire.transports"
RIG = "rig:"
"""Before the name of a rig file, if several devices are meant."""
MEANT = "; for this serial port write "
"""In an error, before the URL of a serial port of which only the name was given."""


def default_url() -> str:
    """The device to use if none is named: ``$PHASEWIRE_DEVICE``, else the emulator."""
    return os.environ.get(URL_VARIABLE) or DEFAULT_URL


def is_fresh(url: str) -> bool:
    """Whether a URL means an emulated device that only exists during this process."""
    return url.partition("?")[0] == DEFAULT_URL


def refuse_rig(url: str) -> None:
    """Raise `DeviceUrlError` if a URL means several devices."""
    if url.startswith(RIG):
        raise DeviceUrlError(
            f"{url!r} is several devices, and this is for one; name one of those that `phasewire devices --rig FILE` "
            "lists"
        )


def load_by_scheme(
    group: str, url: str, what: str = "device", missing: type[PhasewireError] = DeviceNotFoundError
) -> Any:
    """Load the entry point of a group that is named as the scheme of a URL, which names a ``what``.

    Raises
    ------
    DeviceUrlError
        If the URL names a rig.
    DeviceNotFoundError, or what is ``missing``
        If there is none, and the known ones are named; or if it cannot be loaded.
    """
    refuse_rig(url)
    return plugins.load_by_scheme(
        group,
        url,
        lambda known: f"no {what} at {url!r}: the URL of a {what} begins with one of {known}{_meant(url)}",
        missing,
    )


def _meant(url: str) -> str:
    """The rest of an error's sentence for a URL that is only the name of a serial port."""
    if url.startswith("/dev/"):
        return f"{MEANT}serial://{url}"
    return f"{MEANT}serial:{url}" if re.fullmatch(r"COM\d+", url, re.IGNORECASE) else ""


def open_transport(url: str) -> Transport:
    """Open the line that a URL names; if somebody listens, it is traced.

    Raises
    ------
    DeviceError
        If the scheme is unknown, nothing answers, or it may not be used.
    """
    return traced(open_untraced(url))


def open_untraced(url: str) -> Transport:
    """Open a line for a transport that wraps it: that one is traced itself. Errors as for `open_transport`."""
    scheme: Scheme = load_by_scheme(SCHEMES, url)
    return scheme.open(url)
