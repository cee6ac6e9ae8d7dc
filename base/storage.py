"""Files: read up to a bound; written completely or not at all, and never over a needed file.

Every output file of every command is written here, so that all have the same rules: what is write-protected or written
by another program is refused, and the file at a place stays as it is until a whole one replaces it.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
import struct
import sys
import time
import tomllib
import zlib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from hashlib import sha256
from io import FileIO
from itertools import count
from pathlib import Path
from shutil import copymode
from typing import Any, BinaryIO, TextIO, TypeAlias
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

from .errors import InputFileError

__all__ = [
    "FilePath",
    "GrowingFile",
    "check_outputs",
    "claimed",
    "growing",
    "open_plain",
    "open_zip",
    "read_file",
    "read_text",
    "read_toml",
    "real_path",
    "replacing",
    "standard_input",
    "write_file",
]

FilePath: TypeAlias = str | os.PathLike[str]
"""The name of a file: text or a `Path`. Every public function that takes one takes both."""
MOST_AT_ONCE = 2**22
"""Bytes of an archive that are read at once: its directory, or a piece of a member."""
MOST_TOML_BYTES = 2**18
MOST_TOML_LINE = 1024
"""Bytes. The time that tomllib takes for a key grows with the square of its dots."""
MOST_TOML_DEPTH = 16
LOCK_PATIENCE = 2.0
"""Seconds. Another program needs less to replace a file that it has made."""
_claims: set[Path] = set()
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


def real_path(path: FilePath) -> Path:
    """The absolute path with all links followed; the file need not exist.

    Raises
    ------
    OSError
        If links lead in a loop. `Path.resolve` raises `RuntimeError`, or returns the link, by the version of Python.
    """
    real = Path(os.path.realpath(path))
    try:
        real.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(error.errno, "it is a link that leads back to itself", str(path)) from error
    return real


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
        As `replacing`.
    """
    taken = {real_path(path): "is also what is read" for path in inputs}
    for output in outputs:
        if output is None or output == "-" or (real := _checked(output)) is None:
            continue
        if real in taken:
            raise ValueError(f"{output} cannot be written: it {taken[real]}")
        taken[real] = "is to be written twice"


def _checked(path: FilePath) -> Path | None:
    """The real path of an output; None for a pipe, a terminal or a device, of which nothing is replaced."""
    real = real_path(path)
    if real.is_dir():
        raise IsADirectoryError(f"{str(path)!r} cannot be written: it is a folder")
    if real.exists() and not real.is_file():
        return None
    if not real.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: there is no folder {Path(path).parent}")
    if not os.access(real.parent, os.W_OK):
        raise PermissionError(f"{path} cannot be written: its folder is read-only")
    if real.exists() and not (real.stat().st_mode & 0o222 and os.access(real, os.W_OK)):  # root may write any file
        raise PermissionError(
            f"{path} cannot be written: it is write-protected; name another file, or allow it by chmod u+w"
        )
    return real


@contextmanager
def claimed(path: FilePath) -> Iterator[None]:
    """Keep a file to this block: whoever else claims or replaces it, in another program or here, is refused.

    The lock is on a hidden file beside it, because a file that is replaced takes its own lock away. The system ends the
    lock with the process. Systems and disks without such locks have no protection.

    Raises
    ------
    OSError
        If it is claimed already; it names the process that holds it. If links lead in a loop.
    """
    with _locked(path, real := real_path(path), 0.0):
        _claims.add(real)
        try:
            yield
        finally:
            _claims.discard(real)


@contextmanager
def _locked(path: FilePath, real: Path, patience: float) -> Iterator[None]:
    lock = real.parent / f".phasewire-{sha256(os.fsencode(real.name)).hexdigest()[:16]}.lock"
    end = time.monotonic() + patience
    handle = _try_lock(lock)
    while handle is None and time.monotonic() < end:
        time.sleep(0.02)
        handle = _try_lock(lock)
    if handle is None:
        holder = b""
        with suppress(OSError):
            holder = lock.read_bytes()[:20]
        by = f"process {holder.decode()}" if holder.isdigit() else "another program"
        raise BlockingIOError(f"{path} is in use by {by}; wait until it has ended, or name another file")
    try:
        yield
    finally:
        if handle >= 0:
            lock.unlink(missing_ok=True)
            os.close(handle)


def _try_lock(lock: Path) -> int | None:
    """The handle of a lock file; None if another one holds it, -1 if there are no locks here."""
    try:
        import fcntl

        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except (ImportError, OSError):
        return -1
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(handle), lock.stat()):  # else its holder has just removed it
            with suppress(OSError):  # on a full disk the holder has no name
                os.truncate(handle, 0)
                os.write(handle, str(os.getpid()).encode())
            return handle
    except (BlockingIOError, FileNotFoundError):
        pass
    except OSError:
        os.close(handle)
        return -1
    os.close(handle)
    return None


@contextmanager
def replacing(path: FilePath) -> Iterator[Path]:
    """Yield a temporary path that replaces ``path`` if the block succeeds.

    The data are on the disk before the replacement, so that a crash at any moment leaves the old file or the new one. A
    link is followed, and anything but a plain file, such as a pipe, is written directly.

    Raises
    ------
    OSError
        If it is a folder or write-protected, if another program writes or has claimed it, if the folder cannot be
        written, if links lead in a loop, or if the disk is full; it names ``path``, whose old contents are unchanged.
    """
    path = Path(path)
    real = _checked(path)
    if real is None:
        with _blaming(path, path):
            yield path
        return
    mode = stat.S_IMODE(real.stat().st_mode) if real.exists() else None
    part = real.parent / f".phasewire-{secrets.token_hex(8)}"
    with ExitStack() as stack:
        if real not in _claims:
            stack.enter_context(_locked(path, real, LOCK_PATIENCE))
        stack.callback(part.unlink, missing_ok=True)
        stack.enter_context(_blaming(path, part))
        # The system removes the umask from a new file's mode; whoever may not read the old file cannot read this
        # either.
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666 if mode is None else 0o600))
        yield part
        if mode is not None:
            part.chmod(mode)
        with part.open("rb") as written:
            os.fsync(written.fileno())
        part.replace(real)


@contextmanager
def _blaming(path: Path, part: Path) -> Iterator[None]:
    """Name ``path`` in errors of its temporary file, and in those of a write, which name no file."""
    try:
        yield
    except OSError as error:
        if error.filename == str(part) or (error.filename is None and error.errno in _BLAMELESS):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def write_file(path: FilePath, data: bytes | str) -> None:
    """Write a file at once, text as UTF-8; see `replacing`."""
    with replacing(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


class GrowingFile:
    """A file that `growing` has opened."""

    trouble: OSError | None = None
    """Why it cannot be written any longer."""

    def __init__(self, raw: FileIO, path: Path) -> None:
        self._raw, self._path = raw, path
        self.writes = 0

    def write(self, data: bytes) -> None:
        """Add data, without a buffer that would fail once more when the file is closed.

        Raises
        ------
        OSError
            If they cannot be written, or an earlier write failed; it names the file.
        """
        with self._trying():
            left = memoryview(data)
            while left:
                left = left[self._raw.write(left) :]
        self.writes += 1

    def rewrite(self, data: bytes) -> None:
        """Write over the beginning of the file; errors as `write`."""
        self._raw.seek(0)
        self.write(data)

    def finish(self) -> None:
        """Bring all to the disk; errors as `write`."""
        with self._trying():
            if stat.S_ISREG(os.fstat(self._raw.fileno()).st_mode):
                os.fsync(self._raw.fileno())

    @contextmanager
    def _trying(self) -> Iterator[None]:
        if self.trouble is not None:
            raise self.trouble
        try:
            yield
        except OSError as error:
            self.trouble = OSError(error.errno, error.strerror, str(self._path))
            raise self.trouble from error


@contextmanager
def growing(path: FilePath) -> Iterator[GrowingFile]:
    """Yield a file that is written bit by bit, such as a recording; it replaces ``path`` if the block succeeds.

    Raises
    ------
    OSError
        As `replacing`. After a failed write of anything but the first piece, which is a head, the written pieces are
        kept beside ``path``, which stays as it was; the error names both.
    """
    path = Path(path)
    with replacing(path) as part, part.open("wb", buffering=0) as raw:
        file = GrowingFile(raw, path)
        try:
            yield file
            file.finish()
        except OSError as error:
            if file.trouble is None or file.writes < 2 or part == path:
                raise
            names = (real_path(path).with_name(f"{path.stem}.part{number or ''}{path.suffix}") for number in count())
            kept = next(name for name in names if not os.path.lexists(name))
            if path.exists():
                copymode(path, part)
            part.replace(kept)
            said = f"{file.trouble.strerror}; what was written is kept in {kept}"
            raise OSError(file.trouble.errno, said, str(path)) from error
