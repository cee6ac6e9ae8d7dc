"""Files: read up to a bound; written completely or not at all, and never over a needed file."""

from __future__ import annotations

import errno
import os
import secrets
import stat
import struct
import sys
import tomllib
import zlib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any, BinaryIO, TextIO, TypeAlias
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

from .errors import InputFileError

__all__ = [
    "FilePath",
    "check_outputs",
    "open_plain",
    "open_zip",
    "read_file",
    "read_text",
    "read_toml",
    "replacing",
    "standard_input",
]

FilePath: TypeAlias = str | os.PathLike[str]
"""The name of a file: text or a `Path`. Every public function that takes one takes both."""
MOST_AT_ONCE = 2**22
"""Bytes of an archive that are read at once: its directory, or a piece of a member."""
MOST_TOML_BYTES = 2**18
MOST_TOML_LINE = 1024
"""Bytes. The time that tomllib takes for a key grows with the square of its dots."""
MOST_TOML_DEPTH = 16
_BLAMELESS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # errors of a write that name no file


def standard_input() -> TextIO:
    """Standard input.

    Raises
    ------
    InputFileError
        If it is closed, as by ``<&-``.
    """
    if sys.stdin is None:
        raise InputFileError("standard input is closed; give it a file or a pipe, or name a file instead of -")
    return sys.stdin


def read_file(path: FilePath, most_bytes: int) -> bytes:
    """The contents of a file, a pipe or a device, up to a bound.

    Parameters
    ----------
    path : str or Path
        The file to read.
    most_bytes : int
        The greatest allowed size; not much more is read.

    Raises
    ------
    InputFileError
        If it is larger.
    OSError
        If it cannot be read.
    """
    with Path(path).open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(most_bytes + 1) if size <= most_bytes else b""
    if size > most_bytes or len(data) > most_bytes:
        found = size if size > most_bytes else f"more than {most_bytes}"
        raise InputFileError(f"{path} has {found} bytes; such a file may have at most {most_bytes}")
    return data


def read_text(path: FilePath, most_bytes: int) -> str:
    """The text of a file in UTF-8, with or without a byte order mark; errors as `read_file`, and if it is no text."""
    return _decoded(path, read_file(path, most_bytes))


def _decoded(path: FilePath, data: bytes) -> str:
    if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        raise InputFileError(f"{path} is text in UTF-16; save it as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path} is no text in UTF-8: {error}") from error


def read_toml(path: FilePath) -> dict[str, Any]:
    """The contents of a TOML file; errors as `read_file`, and if it is no TOML, or nested too deeply."""
    data = read_file(path, MOST_TOML_BYTES)
    text = _decoded(path, data)
    for number, line in enumerate(data.splitlines(), start=1):
        if len(line) > MOST_TOML_LINE:
            raise InputFileError(f"{path}, line {number} has {len(line)} bytes; at most {MOST_TOML_LINE} may be")
    try:
        table = tomllib.loads(text)
    except ValueError as error:
        raise InputFileError(f"{path} is no TOML file: {error}") from error
    except RecursionError as error:
        raise _too_deep(path) from error
    level: list[Any] = [table]
    for _ in range(MOST_TOML_DEPTH):
        level = [inner for value in level for inner in _inside(value)]
    if level:
        raise _too_deep(path)
    return table


def _inside(value: object) -> Iterable[object]:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def _too_deep(path: FilePath) -> InputFileError:
    return InputFileError(f"{path} is nested too deeply: at most {MOST_TOML_DEPTH} levels of tables and lists may be")


def open_plain(path: FilePath) -> BinaryIO:
    """Open a plain file, any part of which can be read; a pipe is refused at once.

    Raises
    ------
    InputFileError
        If it is a pipe, a terminal or another device.
    OSError
        If it cannot be opened.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    kind = os.fstat(handle).st_mode
    if stat.S_ISREG(kind):
        return os.fdopen(handle, "rb")
    os.close(handle)
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise InputFileError(f"{path} must be a plain file; copy its contents to one")


class _InPieces(FileIO):
    """A file that returns at most `MOST_AT_ONCE` at once, whatever sizes an archive in it claims.

    zipfile asks for the rest of an uncompressed member, but not of its directory: a larger one than that is an error.
    """

    directory_is_read = False

    def read(self, size: int | None = -1, /) -> bytes:
        if size is None or size <= MOST_AT_ONCE:
            return super().read(size)
        if not self.directory_is_read:
            raise BadZipFile(f"a part of {size} bytes is too large")
        return super().read(MOST_AT_ONCE)


@contextmanager
def open_zip(path: FilePath, otherwise: str) -> Iterator[ZipFile]:
    """Open a zip archive, whose members must be read in pieces of a stated size: their own sizes are only claims.

    Parameters
    ----------
    path : str or Path
        A plain file.
    otherwise : str
        Its description in the error if it cannot be read.

    Raises
    ------
    InputFileError
        If it is no plain file, no archive, a damaged one, or packed by another method than deflate; also in the block.
    OSError
        If it cannot be opened.
    """
    try:
        with open_plain(path) as file, ZipFile(pieces := _InPieces(file.fileno(), closefd=False)) as archive:
            pieces.directory_is_read = True
            for member in archive.infolist():
                if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED):  # zipfile unpacks others without a bound
                    raise BadZipFile(f"{member.filename} is packed by method {member.compress_type}")
            yield archive
    except InputFileError:
        raise
    except OSError as error:
        if error.errno != errno.EINVAL:  # raised by a seek to a place before the file's beginning
            raise
        raise InputFileError(f"{path} is {otherwise}: it refers to a place that is not in it") from error
    except (BadZipFile, zlib.error, struct.error, EOFError, RuntimeError, OverflowError, ValueError) as error:
        raise InputFileError(f"{path} is {otherwise}: {error}") from error


def check_outputs(outputs: Iterable[FilePath | None], inputs: Iterable[FilePath] = ()) -> None:
    """Check before any work that its results can be written and will not overwrite a needed file.

    Parameters
    ----------
    outputs : iterable of path, str or None
        Files to be written; None and ``-`` stand for no file.
    inputs : iterable of path
        Files that are read.

    Raises
    ------
    ValueError
        If an output is an input, or occurs twice.
    OSError
        If it is a folder, or its folder does not exist or cannot be written.
    """
    taken = {Path(path).resolve(): "is also what is read" for path in inputs}
    for output in outputs:
        if output is None or output == "-":
            continue
        path = Path(output)
        if path.is_dir():
            raise IsADirectoryError(f"{str(output)!r} cannot be written: it is a folder")
        if path.exists() and not path.is_file():
            continue  # a pipe or a terminal: nothing is replaced
        real = path.resolve()
        if not real.parent.is_dir():
            raise FileNotFoundError(f"{path} cannot be written: there is no folder {path.parent}")
        if not os.access(real.parent, os.W_OK):
            raise PermissionError(f"{path} cannot be written: its folder is read-only")
        if real in taken:
            raise ValueError(f"{path} cannot be written: it {taken[real]}")
        taken[real] = "is to be written twice"


@contextmanager
def replacing(path: FilePath) -> Iterator[Path]:
    """Yield a temporary path that replaces ``path`` if the block succeeds.

    The data are on the disk before the replacement, so that a crash at any moment leaves the old file or the new one. A
    link is followed, and anything but a plain file, such as a pipe, is written directly.

    Raises
    ------
    OSError
        If the folder cannot be written, or the disk is full; it names ``path``, whose old contents are unchanged.
    """
    path = Path(path)
    real = path.resolve()
    mode = stat.S_IMODE(real.stat().st_mode) if real.exists() else None
    is_direct = real.exists() and not real.is_file()
    part = path if is_direct else real.parent / f".phasewire-{secrets.token_hex(8)}"
    try:
        if is_direct:
            yield part
            return
        # The system removes the umask from a new file's mode; whoever may not read the old file cannot read this
        # either.
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666 if mode is None else 0o600))
        yield part
        if mode is not None:
            part.chmod(mode)
        with part.open("rb") as written:
            os.fsync(written.fileno())
        part.replace(real)
    except OSError as error:
        if error.filename == str(part) or (error.filename is None and error.errno in _BLAMELESS):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if not is_direct:
            part.unlink(missing_ok=True)
