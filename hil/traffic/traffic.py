"""Recorded traffic in pieces: a block, a record, a control request or a stretch of a serial line, one at a time.

Every reader of a recording yields these pieces, and everything that explains traffic takes them. The readers of plain
bytes and of hex text are in this module; `usbmon` reads captures of a USB bus.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import BinaryIO, Literal

from ...base.errors import FrameError, InputFileError
from ...protocol import framing
from ...protocol.codes import ACK_MAGIC, BLOCK_BYTES, IMAGE_MAX_BYTES, RECORD_BYTES, STATUS_MAGIC
from ...protocol.describe import (
    Description,
    describe_block,
    describe_frame,
    describe_image,
    describe_message,
    describe_record,
    describe_text,
)
from ...protocol.firmware import SUFFIX_BYTES
from ...protocol.framing import DELIMITER
from ...protocol.replies import Ack, Status

__all__ = [
    "DESCRIBERS",
    "LineCutter",
    "Piece",
    "Traffic",
    "TransferDirection",
    "cut",
    "hex_bytes",
    "is_hex",
    "read_bytes",
    "read_serial",
    "read_text",
    "read_whole",
]

RECORD_SIZES = {ACK_MAGIC: Ack.BYTES, STATUS_MAGIC: Status.BYTES}
"""Sizes of the records on bulk IN, by their first bytes."""

LONGEST_FRAME_BYTES = 4096
"""A longer part of a serial line without a zero is cut: it is noise."""

LARGEST_TEXT_BYTES = 64_000_000
"""How much hex text is read at once, and the greatest number of its bytes."""

LARGEST_WHOLE_BYTES = IMAGE_MAX_BYTES + SUFFIX_BYTES
"""The largest piece: the file of a firmware image."""

SERIAL_CHUNK_BYTES = 65536
_CONSOLE_FRAME = framing.encode(framing.CONSOLE_FRAME)

TransferDirection = Literal["out", "in"]


class Traffic(StrEnum):
    """The kind of traffic of a piece."""

    BLOCK = "block"
    RECORD = "record"
    REQUEST = "control request"
    FRAME = "frame"
    TEXT = "text"
    MESSAGE = "message"
    FIRMWARE = "firmware image"
    OTHER = "other"


def _describe_other(data: bytes) -> Description:
    return Description("transfer", f"{len(data)} bytes of something else")


DESCRIBERS: Mapping[Traffic, Callable[[bytes], Description]] = {
    Traffic.BLOCK: describe_block,
    Traffic.RECORD: describe_record,
    Traffic.FRAME: describe_frame,
    Traffic.TEXT: describe_text,
    Traffic.FIRMWARE: describe_image,
    Traffic.MESSAGE: describe_message,
    Traffic.OTHER: _describe_other,
}
"""What explains the bytes of each kind of traffic but requests, which `describe_request` does."""


@dataclass(frozen=True, slots=True)
class Piece:
    """One piece of traffic, as recorded."""

    where: str
    """Its place in the recording: ``packet 17``, ``offset 512``."""
    traffic: Traffic
    """What kind of traffic it is."""
    direction: TransferDirection | None
    """From the host, to the host, or unknown."""
    data: bytes
    """The recorded bytes; for a control request its data stage."""
    time: float | None = None
    """Seconds since the recording began."""
    setup: bytes = b""
    """The eight bytes of a control request's setup stage; empty otherwise."""
    missing: int = 0
    """Bytes at the end that travelled but were not recorded."""
    stalled: bool = False
    """Whether the device answered STALL, as it does to an unknown request."""
    problem: str = ""
    """What went wrong on the way; empty if all went well."""


def cut(traffic: Traffic, data: bytes, travelled: int) -> Iterator[tuple[int, bytes, int]]:
    """Cut the data of one transfer into blocks or records: the offset of each, its bytes, how many were not recorded.

    The recorded data begin with the transfer, of which so many bytes travelled.
    """
    at = 0
    while at < len(data):
        whole = BLOCK_BYTES if traffic is Traffic.BLOCK else RECORD_SIZES.get(data[at : at + 2], RECORD_BYTES)
        size = min(whole, travelled - at)
        recorded = data[at : at + size]
        yield at, recorded, size - len(recorded)
        at += size
    if at < travelled:
        yield at, b"", travelled - at


def read_bytes(stream: BinaryIO) -> Iterator[Piece]:
    """Read blocks and records that stand one after the other, told apart by their first bytes."""
    offset, held = 0, b""
    while held := held + stream.read(BLOCK_BYTES - len(held)):
        if (begin := held[:2]) in RECORD_SIZES:
            data, held = held[: RECORD_SIZES[begin]], held[RECORD_SIZES[begin] :]
            yield Piece(f"offset {offset}", Traffic.RECORD, "in", data)
        else:
            data, held = held, b""
            yield Piece(f"offset {offset}", Traffic.BLOCK, "out", data)
        offset += len(data)


class LineCutter:
    """Cuts one direction of a serial line into frames and console text, however its bytes arrive (clause SER-010).

    Frames are returned as they stand, without the zero that ends them, and are not judged.
    """

    def __init__(self) -> None:
        self._held = b""
        self._offset = 0
        self._in_console = True

    def feed(self, data: bytes) -> Iterator[tuple[int, Traffic, bytes]]:
        """Take the next data; yields offset, kind and bytes of everything that is then complete."""
        *ended, self._held = (self._held + data).split(DELIMITER)
        for part in ended:
            # A recording from the middle of a line begins with a frame, not with text.
            traffic = Traffic.TEXT if self._in_console and not is_frame(part) else Traffic.FRAME
            self._in_console = traffic is Traffic.FRAME and part + DELIMITER == _CONSOLE_FRAME
            if part:
                yield self._offset, traffic, part
            self._offset += len(part) + len(DELIMITER)
        if self._in_console or len(self._held) > LONGEST_FRAME_BYTES:
            yield from self.rest()

    def rest(self) -> Iterator[tuple[int, Traffic, bytes]]:
        """Yield what is left at the end of the line, or is too long for a frame."""
        if self._held:
            yield self._offset, Traffic.TEXT if self._in_console else Traffic.FRAME, self._held
        self._offset += len(self._held)
        self._held = b""


def is_frame(data: bytes) -> bool:
    """Whether bytes, without the zero that ends them, are an undamaged frame."""
    try:
        framing.decode(data + DELIMITER)
    except FrameError:
        return False
    return True


def read_whole(stream: BinaryIO, name: str, traffic: Traffic) -> Iterator[Piece]:
    """Read all of a recording as one piece: a firmware image, or a message of the chain.

    Raises `InputFileError` if it is larger than any of these.
    """
    data = stream.read(LARGEST_WHOLE_BYTES + 1)
    if len(data) > LARGEST_WHOLE_BYTES:
        raise InputFileError(f"{name}: a {traffic} has at most {LARGEST_WHOLE_BYTES} bytes")
    yield Piece("offset 0", traffic, None, data)


def read_serial(stream: BinaryIO) -> Iterator[Piece]:
    """Read one direction of a serial line."""
    cutter = LineCutter()
    while data := stream.read(SERIAL_CHUNK_BYTES):
        for offset, traffic, part in cutter.feed(data):
            yield Piece(f"offset {offset}", traffic, None, part)
    for offset, traffic, part in cutter.rest():
        yield Piece(f"offset {offset}", traffic, None, part)


_XXD_LINE = re.compile(r"([0-9a-f]+): ([0-9a-f ]*?)(?:  .*)?", re.IGNORECASE)
_HEXDUMP_LINE = re.compile(r"([0-9a-f]{8,})(?:  ([0-9a-f ]*)(?:\|.*)?)?", re.IGNORECASE)
_DUMP_BEGINS = re.compile(r"0+: |0{8,}  ")
_ZEROS = re.compile(r"00 × ([0-9]{1,6})")
_PLAIN_TEXT = re.compile(r"(?:\s|,|0x|[0-9a-f]|#.*)*", re.IGNORECASE)


def is_hex(head: str) -> bool:
    """Whether text looks like what `hex_bytes` reads, judged by its first line that is no comment."""
    first = next(_content_lines(head), (0, ""))[1]
    return bool(first) and bool(_DUMP_BEGINS.match(first) or _PLAIN_TEXT.fullmatch(first))


def hex_bytes(text: str) -> bytes:
    """Read bytes from hex text.

    It accepts pairs of hex digits, with ``0x``, commas and white space anywhere, comments from ``#`` to the end of the
    line, and ``00 × 480`` on a line of its own for so many zeros; and the dumps of ``xxd`` and ``hexdump -C`` from
    offset 0, whose lines state the offset.

    Raises `ValueError` if it is anything else; it names the line.
    """
    lines = list(_content_lines(text))
    if lines and _DUMP_BEGINS.match(lines[0][1]):
        return _dumped_bytes(lines)
    data = bytearray()
    for number, line in lines:
        digits = line.partition("#")[0].strip()
        if zeros := _ZEROS.fullmatch(digits):
            count = int(zeros[1])
            if len(data) + count > LARGEST_TEXT_BYTES:
                raise ValueError(
                    f"line {number}: with {count} more zeros there are more than {LARGEST_TEXT_BYTES} bytes"
                )
            data += bytes(count)
            continue
        for word in digits.replace(",", " ").split():
            data += _pairs(word.lower().removeprefix("0x"), number)
    return bytes(data)


def _pairs(digits: str, line: int) -> bytes:
    try:
        return bytes.fromhex(digits)
    except ValueError:
        raise ValueError(f"line {line}: {_short(digits)} is not bytes of two hex digits each") from None


def _content_lines(text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line.strip()


def _dumped_bytes(lines: Iterable[tuple[int, str]]) -> bytes:
    data, last, repeats = bytearray(), b"", False
    for number, line in lines:
        if line == "*":  # lines equal to the last one were left out
            repeats = True
            continue
        match = _XXD_LINE.fullmatch(line) or _HEXDUMP_LINE.fullmatch(line)
        if match is None:
            raise ValueError(f"line {number}: {_short(line)} is no line of a hex dump, unlike those before it")
        offset = int(match[1], 16)
        if repeats and last and len(data) < offset <= LARGEST_TEXT_BYTES:
            data += (last * ((offset - len(data)) // len(last) + 1))[: offset - len(data)]
        if offset != len(data):
            raise ValueError(f"line {number}: offset {offset:#x} should be {len(data):#x}; lines are missing")
        last, repeats = _pairs(match[2] or "", number), False
        data += last
    return bytes(data)


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "…")


def read_text(stream: BinaryIO, name: str) -> bytes:
    """Read the bytes that a file of hex text stands for.

    Raises `InputFileError` if it is no hex text, or more than is read at once.
    """
    text = stream.read(LARGEST_TEXT_BYTES + 1)
    if len(text) > LARGEST_TEXT_BYTES:
        raise InputFileError(f"{name}: hex text may have at most {LARGEST_TEXT_BYTES} bytes")
    try:
        return hex_bytes(text.decode("utf-8", errors="replace"))
    except ValueError as error:
        raise InputFileError(f"{name}: {error}") from error
