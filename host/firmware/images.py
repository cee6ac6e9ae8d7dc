"""Firmware images in files: read up to a bound, judged, and refused by the name of the file. No device is needed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from ...base.errors import ImageError
from ...base.storage import FilePath
from ...base.storage import read_file as read_bounded
from ...protocol.codes import ImageReason
from ...protocol.firmware import Image, Suffix, Trust, split_suffix, trust

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

__all__ = ["Firmware", "read_file", "read_firmware", "read_image"]

MOST_FILE_BYTES = 1024 * 1024
"""More than the largest image has (clause FWU-008)."""


ZIP = b"PK\x03\x04"
"""The first bytes of a zip archive, which solved files (.npz) are; people pass one by mistake."""


class Firmware(NamedTuple):
    """A firmware file that has been read and found good."""

    image: Image
    suffix: Suffix
    trust: Trust


def read_file(path: FilePath) -> bytes:
    """What is in a file; raise `InputFileError` if that is more than any image has, `OSError` if it cannot be read."""
    return read_bounded(path, MOST_FILE_BYTES)


def read_image(source: FilePath | bytes) -> tuple[Image, Suffix]:
    """Read a firmware file, whoever has signed it.

    Parameters
    ----------
    source : str, Path or bytes
        The file, or what is in it.

    Raises
    ------
    ImageError
        If the file is none or is damaged (clauses FWU-014 and FWU-015).
    OSError
        If it cannot be read.
    """
    data = source if isinstance(source, bytes) else read_file(source)
    if data.startswith(ZIP):
        raise ImageError(
            f"{'this' if isinstance(source, bytes) else source} is a zip archive, such as a solved file (.npz), and no "
            "firmware image; `phasewire show` plays a solved file, `phasewire firmware build` makes an image",
            ImageReason.SUFFIX,
        )
    with _named(source):
        stored, suffix = split_suffix(data)
        return Image.decode(stored), suffix


def read_firmware(source: FilePath | bytes, keys: Iterable[Ed25519PublicKey] = ()) -> Firmware:
    """Read a firmware file and judge it, as far as that needs no device.

    Parameters
    ----------
    source : str, Path or bytes
        The file, or what is in it.
    keys : iterable of Ed25519PublicKey
        Who is trusted. If there are any, one of them must have signed; if there are none, nobody needs to.

    Raises
    ------
    ImageError
        If the file is none, is damaged, or was not signed as it must be (clauses FWU-012, FWU-014 and FWU-015).
    OSError
        If it cannot be read.
    """
    image, suffix = read_image(source)
    trusted = list(keys)
    with _named(source):
        judged = trust(image, trusted)
        if trusted and judged is not Trust.SIGNED:
            raise ImageError(
                f"the image is {judged.value}, and {len(trusted)} trusted key(s) were given; `phasewire firmware sign` "
                "signs it",
                ImageReason.SIGNATURE,
            )
    return Firmware(image, suffix, judged)


@contextmanager
def _named(source: FilePath | bytes) -> Iterator[None]:
    """Let an error say which file it is about."""
    try:
        yield
    except ImageError as refused:
        if isinstance(source, bytes):
            raise
        raise ImageError(f"{source}: {ImageReason(refused.reason).name}: {refused}", refused.reason) from refused
