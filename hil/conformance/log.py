"""The log of a case: what was sent and what came, in order, with the meaning of its bytes."""

from __future__ import annotations

import re
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from ...protocol.describe import Description, describe_request
from ...protocol.framing import DELIMITER
from ...protocol.requests import Setup
from ..traffic.traffic import DESCRIBERS, Traffic, cut, is_frame
from .verdicts import Evidence

__all__ = ["CaseLog"]

NOTES = 60
"""Pieces of evidence kept for a case: the first half, and the newest before it ended."""
NOTED_BYTES = 1024
"""Bytes of a serial line, one way, that are kept as one piece of evidence."""
SHOWN_BYTES = 64
_TYPED = re.compile(rb"[\t\n\r\x20-\x7e]*")
"""What people read and type. No frame consists of it: the code of its kind is below."""


@dataclass
class _Note:
    """A piece of evidence, its number in the case, and the exception that was on its way when it was noted."""

    label: str
    what: str | bytes
    traffic: Traffic
    setup: bytes
    number: int
    during: BaseException | None


class CaseLog:
    """The log of one case after the other. What a case does after its end or its failure is clean-up.

    Clean-up never takes the room of what came before it.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start with no evidence."""
        self._notes: list[_Note] = []
        self._count = 0
        self._dropped = {False: 0, True: 0}
        self._wrong: int | None = None
        self._over: int | None = None

    def note(self, label: str, what: object, traffic: Traffic = Traffic.OTHER, setup: bytes = b"") -> None:
        """Keep something as evidence; bytes are shown in hexadecimal, and explained by their kind of traffic.

        A request is its setup stage and its data; its answer comes with that setup stage.
        """
        shown = bytes(what) if isinstance(what, bytes | bytearray) else str(what)
        during = sys.exception()
        self._notes.append(_Note(label, shown, traffic, setup, self._count, during))
        self._count += 1
        if len(self._notes) > NOTES:
            is_late = during is not None or self._over is not None
            del self._notes[-1 if is_late else NOTES // 2]
            self._dropped[is_late] += 1

    def note_line(self, label: str, data: bytes, traffic: Traffic) -> None:
        """Keep bytes of a serial line as evidence, with those that went the same way just before."""
        last = self._notes[-1] if self._notes and self._over is None else None
        way = (label, traffic, sys.exception())
        if last is None or (last.label, last.traffic, last.during) != way or len(last.what) >= NOTED_BYTES:
            self.note(label, data, traffic)
        else:
            assert isinstance(last.what, bytes)
            last.what += data

    def mark_wrong(self) -> None:
        """Mark that the outputs were wrong; the case goes on."""
        if self._wrong is None:
            self._wrong = self._count

    def end(self, error: BaseException | None = None) -> None:
        """End the case: with its failure if it failed, which may have happened before it cleaned up."""
        if self._over is None:
            failed = error is not None
            self._over = next((note.number for note in self._notes if failed and note.during is error), self._count)
            if failed:
                self._wrong = None  # the case went on with wrong outputs, and its failure decides

    def evidence(self, *, whole: bool) -> tuple[Evidence, ...]:
        """The log since the case began: of many bytes only the first, or all of them."""
        end = min(each for each in (self._wrong, self._over, self._count) if each is not None)
        begun: dict[str, bytes] = {}
        shown = []
        for note in self._notes:
            meaning = "\n".join(each.line for each in _described(note, begun))
            shown.append(Evidence(note.label, _shown(note.what, whole=whole), meaning, note.number >= end))
        if self._dropped[False]:
            shown.insert(NOTES // 2, Evidence("…", f"{self._dropped[False]} more"))
        if self._dropped[True]:
            shown.append(Evidence("…", f"{self._dropped[True]} more", after=True))
        return tuple(shown)


def _described(note: _Note, begun: dict[str, bytes]) -> Iterator[Description]:
    """What bytes mean: each block, record or request, and each frame that ends in them."""
    if isinstance(note.what, str):
        return
    match note.traffic:
        case Traffic.REQUEST if note.setup:
            yield describe_request(note.setup, note.what)
        case Traffic.REQUEST:
            yield describe_request(note.what[: Setup.BYTES], note.what[Setup.BYTES :] or None)
        case Traffic.BLOCK | Traffic.RECORD:
            for _, part, _ in cut(note.traffic, note.what, len(note.what)):
                yield DESCRIBERS[note.traffic](part)
        case Traffic.TEXT | Traffic.FRAME:
            *ended, rest = (begun.pop(note.label, b"") + note.what).split(DELIMITER)
            if note.traffic is Traffic.TEXT or _TYPED.fullmatch(rest):
                ended.append(rest)
            else:
                begun[note.label] = rest
            for part in filter(None, ended):
                is_text = not is_frame(part) and (note.traffic is Traffic.TEXT or _TYPED.fullmatch(part))
                yield DESCRIBERS[Traffic.TEXT if is_text else Traffic.FRAME](part)


def _shown(what: str | bytes, *, whole: bool) -> str:
    if isinstance(what, str):
        return what
    if whole or len(what) <= SHOWN_BYTES:
        return what.hex(" ")
    return f"{what[:SHOWN_BYTES].hex(' ')} … ({len(what)} bytes, CRC-32 {zlib.crc32(what):08X})"
