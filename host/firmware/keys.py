"""Keys of firmware images in PEM files, and what an image's signature is worth to whoever has some of them.

The keys are Ed25519 (RFC 8032, clause FWU-011), in the files that openssl writes. A private key is read to sign and is
kept nowhere; no key is made here, for openssl does.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ...base.errors import ImageError, InputFileError
from ...base.extras import needing
from ...base.storage import FilePath, read_file
from ...protocol.codes import ImageReason
from ...protocol.firmware import Image, Trust, parse, trust

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

__all__ = [
    "MAKE_PRIVATE_KEY",
    "MAKE_PUBLIC_KEY",
    "ImageTrust",
    "exposure",
    "judge",
    "judge_file",
    "read_private_key",
    "read_public_keys",
]

MAKE_PRIVATE_KEY = "openssl genpkey -algorithm ed25519 -out key.pem"
MAKE_PUBLIC_KEY = "openssl pkey -in key.pem -pubout -out public.pem"
PRIVATE, PUBLIC = b"PRIVATE KEY-----", b"-----BEGIN PUBLIC KEY-----"
MOST_BYTES = 64 * 1024
"""More than any key has."""


def read_private_key(path: FilePath) -> Ed25519PrivateKey:
    """Read a key to sign with.

    Raises
    ------
    InputFileError
        If the file holds no private Ed25519 key, or one that is encrypted.
    OSError
        If it cannot be read.
    """
    with needing("signing", f"{path}: a signing key"):  # few commands sign; this is slow to import
        from cryptography.exceptions import InternalError, UnsupportedAlgorithm
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

    text = read_file(path, MOST_BYTES)
    if PUBLIC in text:
        raise InputFileError(f"{path} holds a public key; who signs needs the private one that belongs to it")
    try:
        key = load_pem_private_key(text, password=None)
    except TypeError as error:  # what cryptography raises when a password is needed
        raise InputFileError(
            f"{path} holds a private key that is encrypted; decrypt it first: openssl pkey -in {path} -out PLAIN.pem"
        ) from error
    except (ValueError, UnsupportedAlgorithm, InternalError) as error:
        raise InputFileError(f"{path} holds no private key in PEM; this makes one: {MAKE_PRIVATE_KEY}") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise _wrong_kind(path, key)
    return key


def read_public_keys(paths: Iterable[FilePath]) -> tuple[Ed25519PublicKey, ...]:
    """Read the keys of those who are trusted to sign.

    Raises
    ------
    InputFileError
        If a file holds no public Ed25519 key.
    OSError
        If it cannot be read.
    """
    return tuple(_read_public_key(path) for path in paths)


def _read_public_key(path: FilePath) -> Ed25519PublicKey:
    with needing("signing", f"{path}: a key to verify with"):
        from cryptography.exceptions import InternalError, UnsupportedAlgorithm
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
        from cryptography.hazmat.primitives.serialization import load_pem_public_key

    text = read_file(path, MOST_BYTES)
    if PRIVATE in text:
        raise InputFileError(f"{path} holds a private key; its public half is enough: {MAKE_PUBLIC_KEY}")
    try:
        key = load_pem_public_key(text)
    except (ValueError, UnsupportedAlgorithm, InternalError) as error:
        raise InputFileError(
            f"{path} holds no public key in PEM; this makes one of a private key: {MAKE_PUBLIC_KEY}"
        ) from error
    if not isinstance(key, Ed25519PublicKey):
        raise _wrong_kind(path, key)
    return key


def exposure(path: FilePath) -> str:
    """What is wrong with the permissions of a private key's file, and how to mend it; empty if nothing is."""
    mode = Path(path).stat().st_mode
    if os.name != "posix" or not stat.S_ISREG(mode) or not mode & (stat.S_IRWXG | stat.S_IRWXO):
        return ""
    return (
        f"{path} can be used by others than its owner (mode {stat.S_IMODE(mode):04o}), who can sign firmware with it; "
        f"mend it by: chmod 600 {path}"
    )


def _wrong_kind(path: FilePath, key: object) -> InputFileError:
    return InputFileError(
        f"{path} holds a key of another kind, {type(key).__name__}; images are signed with Ed25519: {MAKE_PRIVATE_KEY}"
    )


class ImageTrust(NamedTuple):
    """What an image is worth to somebody, by the four cases of clause FWU-012."""

    outcome: str
    """The name of a `Trust`, or of the `ImageReason` to refuse it: SIGNATURE if the signature is wrong."""
    words: str

    @property
    def trusted(self) -> bool:
        """Whether a trusted key has signed the image."""
        return self.outcome == Trust.SIGNED.name


def judge(image: Image, keys: Iterable[Ed25519PublicKey]) -> ImageTrust:
    """What the signature of an image is worth to whoever trusts these keys."""
    try:
        found = trust(image, keys)
    except ImageError as refused:
        return _refusal(refused)
    number = "" if image.signature is None else f" (key {image.signature.key_id.hex()})"
    return ImageTrust(found.name, found.value + number)


def judge_file(file: bytes, keys: Iterable[Ed25519PublicKey]) -> ImageTrust:
    """The same for the file of an image, which may be anything."""
    try:
        image = parse(file)
    except ImageError as refused:
        return _refusal(refused)
    return judge(image, keys)


def _refusal(refused: ImageError) -> ImageTrust:
    return ImageTrust(ImageReason(refused.reason).name, str(refused))
