"""Recordings of traffic: files and standard input; the content tells the format, and they are read piece by piece."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from ...base.errors import InputFileError
from ...base.storage import FilePath, standard_input
from ...protocol.codes import BLOCK_MAGIC, IMAGE_MAGIC
from ...protocol.framing import DELIMITER
from .traffic import RECORD_SIZES, Piece, Traffic, is_frame, is_hex, read_bytes, read_serial, read_text, read_whole
from .usbmon import UsbAddress, read_usbmon

__all__ = ["FORMATS", "open_recording", "read_recording"]

FORMATS = {
    "blocks": "blocks and records, one after the other",
    "hex": "text of hex digits, or a dump by xxd or hexdump -C, of one of the others",
    "pcap": "a pcap or pcapng capture by Linux's usbmon",
    "serial": "one direction of a serial line",
    "firmware": "a firmware image",
    "chain": "one message between controller and processors",
}
"""Formats of recordings, and their contents."""

WHOLES = {"firmware": Traffic.FIRMWARE, "chain": Traffic.MESSAGE}
"""Formats that hold one piece."""

MOST_PIPED_BYTES = 2**32
"""Limit for a pipe, which is copied to the disk."""

HEAD_BYTES = 4096
"""How much of a recording is read to tell its format."""


@contextmanager
def open_recording(source: FilePath) -> Iterator[BinaryIO]:
    """Open a file, or standard input for ``-``, so that it can be read twice.

    Raises `InputFileError` if standard input is closed, and `OSError` if it cannot be opened.
    """
    if source == "-":
        with _seekable(standard_input().buffer) as stream:
            yield stream
    else:
        with Path(source).open("rb") as file, _seekable(file) as stream:
            yield stream


@contextmanager
def _seekable(stream: BinaryIO) -> Iterator[BinaryIO]:
    """The stream itself, or a copy on disk if it is a pipe."""
    if stream.seekable():
        yield stream
        return
    with tempfile.TemporaryFile() as copy:
        while data := stream.read(2**16):
            if copy.tell() + len(data) > MOST_PIPED_BYTES:
                raise InputFileError(f"more than {MOST_PIPED_BYTES} bytes came through a pipe; record them to a file")
            copy.write(data)
        copy.seek(0)
        yield copy


def read_recording(
    stream: BinaryIO, name: str, form: str = "auto", address: UsbAddress | None = None
) -> Iterator[Piece]:
    """Read a recording that can seek, piece by piece, in one of `FORMATS` or, by ``auto``, in the one of its content.

    In a capture of a bus the device with an address is followed; None finds it. The name is for errors. Raises
    `ValueError` if there is no such format, or the format has no addresses, and `InputFileError` if the recording is
    empty or cannot be read as such; pieces before that are given.
    """
    if form not in ("auto", *FORMATS):
        raise ValueError(f"unknown format {form!r}; known are auto, {', '.join(FORMATS)}")
    head = stream.read(HEAD_BYTES)
    stream.seek(0)
    if not head:
        raise InputFileError(f"{name} is empty")
    form = _form_of(head, name) if form == "auto" else form
    if form == "hex":
        return read_recording(BytesIO(read_text(stream, name)), name, address=address)
    if address is not None and form != "pcap":
        raise ValueError(f"{name} holds {FORMATS[form]}; an address chooses a device in a capture of a bus")
    if form == "pcap":
        return read_usbmon(stream, name, address)
    if form in WHOLES:
        return read_whole(stream, name, WHOLES[form])
    return read_bytes(stream) if form == "blocks" else read_serial(stream)


def _form_of(head: bytes, name: str) -> str:
    """The format of a recording, judged by its beginning."""
    from .packets import MAGICS  # dpkt takes a tenth of the command line's time to import

    if head.startswith(MAGICS):
        return "pcap"
    if head.startswith(IMAGE_MAGIC):
        return "firmware"
    if head[:2] in (BLOCK_MAGIC, *RECORD_SIZES):
        return "blocks"
    if is_hex(head.decode("utf-8", errors="replace")):
        return "hex"
    if any(is_frame(part) for part in head.split(DELIMITER)):
        return "serial"
    known = "; ".join(f"{form}: {what}" for form, what in FORMATS.items())
    raise InputFileError(f"{name} begins like no known recording; its format can be stated ({known})")
