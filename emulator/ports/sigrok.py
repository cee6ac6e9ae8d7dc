"""An excerpt of a capture as a sigrok session file, for PulseView and sigrok-cli.

The file is a zip archive: a version, a description in the form of an ini file, and samples in pieces, each sample one
bit for each output, the first in the lowest bit. It does not say when its first sample was taken.
"""

from __future__ import annotations

from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from ...base.storage import FilePath, replacing
from ...protocol.board import TICK_HZ
from .excerpt import Excerpt

__all__ = ["write_sigrok"]

SESSION_VERSION = "2"
CAPTURE_FILE = "logic-1"


def write_sigrok(path: FilePath, excerpt: Excerpt) -> None:
    """Write an excerpt as a sigrok session file; the same excerpt gives the same bytes.

    Raises
    ------
    OSError
        If the file cannot be written; what stood there is untouched.
    """
    with replacing(path) as part, ZipFile(part, "w") as archive:
        archive.writestr(_member("version"), SESSION_VERSION)
        archive.writestr(_member("metadata"), _metadata(excerpt))
        for number, levels in enumerate(excerpt.chunks(), start=1):
            samples = np.packbits(levels, axis=1, bitorder="little").tobytes()
            archive.writestr(_member(f"{CAPTURE_FILE}-{number}"), samples)


def _member(name: str) -> ZipInfo:
    """A compressed file of the archive; its date is always the format's first, 1980."""
    member = ZipInfo(name)
    member.compress_type = ZIP_DEFLATED
    return member


def _metadata(excerpt: Excerpt) -> str:
    probes = [f"probe{number}={name}" for number, name in enumerate(excerpt.names, start=1)]
    lines = [
        "[global]",
        "sigrok version=0.5.2",
        "",
        "[device 1]",
        f"capturefile={CAPTURE_FILE}",
        f"total probes={len(probes)}",
        f"samplerate={TICK_HZ // 1_000_000} MHz",
        "total analog=0",
        *probes,
        f"unitsize={-(-len(probes) // 8)}",
    ]
    return "\n".join(lines) + "\n"
