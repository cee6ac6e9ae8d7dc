"""Arrays from NumPy's files, NPZ and NPY; a header that claims more than the file holds takes no memory."""

from __future__ import annotations

import math
import os
from typing import IO, Any

from numpy.lib import format as npy
from numpy.typing import NDArray

from ..base.errors import InputFileError
from ..base.storage import FilePath, open_plain, open_zip

__all__ = ["MOST_BYTES", "read_array", "read_arrays"]

MOST_BYTES = 500_000_000
"""The arrays of a file may have so many together."""
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(path: FilePath) -> dict[str, NDArray[Any]]:
    """Read every array of an NPZ file.

    `InputFileError` if the file is truncated, corrupted or no NPZ file, or holds too much; `OSError` if it cannot be
    opened.
    """
    with open_zip(path, "truncated, corrupted or not an NPZ file") as archive:
        members = archive.infolist()
        size = sum(member.file_size for member in members)
        if size > MOST_BYTES:
            raise InputFileError(f"{path} holds {size} bytes; it may hold at most {MOST_BYTES}")
        arrays = {}
        for member in members:
            with archive.open(member) as stream:
                arrays[member.filename.removesuffix(".npy")] = _read(path, stream, member.file_size)
        return arrays


def read_array(path: FilePath) -> NDArray[Any]:
    """Read the array of an NPY file; errors as `read_arrays`."""
    with open_plain(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > MOST_BYTES:
            raise InputFileError(f"{path} has {size} bytes; it may have at most {MOST_BYTES}")
        return _read(path, file, size)


def _read(path: FilePath, stream: IO[bytes], size: int) -> NDArray[Any]:
    """An array; the file must hold as many bytes as its header says."""
    try:
        version = npy.read_magic(stream)
        if version not in _HEADERS:
            raise ValueError(f"version {version} of the format is unknown")
        shape, _, kind = _HEADERS[version](stream)
        claimed, held = math.prod(shape) * kind.itemsize, size - stream.tell()
        if kind.hasobject or not kind.itemsize or claimed != held:
            raise ValueError(f"an array of {kind} {shape} does not have {held} bytes")
        stream.seek(0)
        return npy.read_array(stream, allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # on foreign bytes numpy and zipfile raise nearly anything
        raise InputFileError(f"{path} is truncated, corrupted or not an NPZ file: {error}") from error
