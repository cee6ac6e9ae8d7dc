"""Blocks: what a host asks a device to do, one 512-byte packet each, packed and unpacked (SPEC.md, chapter BLK).

A block is a body, which says what to do, under a sequence number. The twin of `layout.blocks.BLOCK`: same bytes, and
the same input refused for the same reason. Many updates at once are packed in `updates`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from dataclasses import fields as dataclass_fields
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import flag, whole
from ..base.errors import BlockError
from .board import CHANNELS
from .codes import (
    AMPLITUDES,
    BLOCK_BYTES,
    BLOCK_MAGIC,
    CHECKSUM_OFFSET,
    ENTRIES_PER_BLOCK,
    HEADER_BYTES,
    MODULATION_SAMPLES,
    NOW,
    PAYLOAD_BYTES,
    PROTOCOL_VERSION,
    SAMPLES_PER_BLOCK,
    SEQUENCE_ENTRIES,
    SLOTS,
    Action,
    Flag,
    Kind,
    Reason,
)
from .pulses import Pulses

__all__ = [
    "AmplitudeModulation",
    "Block",
    "Body",
    "Change",
    "Clock",
    "Entries",
    "Entry",
    "NoOp",
    "Output",
    "PlaySequence",
    "Samples",
    "Slot",
    "Update",
    "checksum",
    "header_fields",
    "pack",
    "pack_pulses",
    "pulse_words",
    "unpack",
    "unpack_pulses",
]

_HEADER = struct.Struct("<2sBBIQ5HBBI")
_ENTRY = struct.Struct("<HH")
_WORD, _PAIR = np.dtype("<u2"), np.dtype("<u4")


@dataclass(frozen=True)
class _Fields:
    """The fields of a header whose use depends on the kind, as they follow each other."""

    period: int = 0
    first: int = 0
    count: int = 0
    hold: int = 0
    repeats: int = 0
    reserved: int = 0
    flags: int = 0
    action: int = 0


def _period(value: Any) -> int:
    return whole("period", value, 0, 2**64 - 1)


def _all_pulses(pulses: Pulses) -> Pulses:
    if not isinstance(pulses, Pulses):
        raise TypeError(f"a block carries Pulses, not {type(pulses).__name__}")
    if len(pulses) != CHANNELS:
        raise ValueError(f"a block carries {CHANNELS} pulses, not {len(pulses)}")
    return pulses


def _set(value: Any, **attributes: Any) -> None:
    """Normalise attributes of a frozen dataclass while it is made."""
    for name, attribute in attributes.items():
        object.__setattr__(value, name, attribute)


@dataclass(frozen=True)
class Update:
    """Play these pulses from a period on, until something else follows (clause BLK-006).

    Parameters
    ----------
    pulses : Pulses
        320 pulses in array order.
    period : int
        Carrier period at which they begin to play, 64 bits; `NOW` for as soon as possible.
    """

    pulses: Pulses
    period: int = NOW

    KIND: ClassVar = Kind.UPDATE

    def __post_init__(self) -> None:
        """Check the ranges."""
        _all_pulses(self.pulses)
        _set(self, period=_period(self.period))

    def _parts(self) -> tuple[_Fields, bytes]:
        return _Fields(period=self.period), pack_pulses(self.pulses)


@dataclass(frozen=True)
class Slot:
    """Keep these pulses in a numbered slot, for sequences to play (clause BLK-013)."""

    number: int
    pulses: Pulses

    KIND: ClassVar = Kind.SLOT

    def __post_init__(self) -> None:
        """Check the ranges."""
        _all_pulses(self.pulses)
        _set(self, number=whole("slot", self.number, 0, SLOTS - 1))

    def _parts(self) -> tuple[_Fields, bytes]:
        return _Fields(first=self.number), pack_pulses(self.pulses)


class Entry(NamedTuple):
    """One step of a sequence: play a slot for a number of carrier periods."""

    slot: int
    periods: int


def pack_entries(entries: Iterable[Entry]) -> bytes:
    """Entries as blocks and the chain carry them, 4 bytes each (clause BLK-014)."""
    return b"".join(_ENTRY.pack(*entry) for entry in entries)


@dataclass(frozen=True)
class Entries:
    """Keep these steps in the table of 1024, for sequences to play (clause BLK-014).

    Parameters
    ----------
    entries : sequence of Entry
        1 to 120.
    first : int
        Place of the first of them in the table.
    """

    entries: tuple[Entry, ...]
    first: int = 0

    KIND: ClassVar = Kind.ENTRIES

    def __post_init__(self) -> None:
        """Check the ranges."""
        entries = tuple(
            Entry(whole("slot", slot, 0, SLOTS - 1), whole("number of periods", periods, 1, 2**16 - 1))
            for slot, periods in self.entries
        )
        whole("number of entries", len(entries), 1, ENTRIES_PER_BLOCK)
        first = whole("first entry", self.first, 0, SEQUENCE_ENTRIES - len(entries))
        _set(self, entries=entries, first=first)

    def _parts(self) -> tuple[_Fields, bytes]:
        fields = _Fields(first=self.first, count=len(self.entries))
        return fields, pack_entries(self.entries)


@dataclass(frozen=True)
class PlaySequence:
    """Play steps of the table one after the other, again and again (clause BLK-015).

    Parameters
    ----------
    first, count : int
        The steps of the table that are played.
    period : int
        Carrier period at which the first begins; `NOW` for as soon as possible.
    repeats : int
        How many times they play; 0 for as long as nothing else follows.
    unattended : bool
        Whether they may go on when the host falls silent.
    """

    first: int
    count: int
    period: int = NOW
    repeats: int = 0
    unattended: bool = False

    KIND: ClassVar = Kind.SEQUENCE

    def __post_init__(self) -> None:
        """Check the ranges."""
        count = whole("number of entries", self.count, 1, SEQUENCE_ENTRIES)
        _set(
            self,
            first=whole("first entry", self.first, 0, SEQUENCE_ENTRIES - count),
            count=count,
            period=_period(self.period),
            repeats=whole("number of repeats", self.repeats, 0, 2**16 - 1),
            unattended=flag("unattended", self.unattended),
        )

    def _parts(self) -> tuple[_Fields, bytes]:
        flags = Flag.UNATTENDED if self.unattended else 0
        return _Fields(self.period, self.first, self.count, repeats=self.repeats, flags=flags), b""


@dataclass(frozen=True)
class Samples:
    """Keep these amplitudes in the buffer of 4096, for modulations to play (clause BLK-016).

    Parameters
    ----------
    samples : bytes, or sequence or array of int
        1 to 480 amplitudes, 0 to 255, where 255 leaves pulses as they are.
    first : int
        Place of the first of them in the buffer.
    """

    samples: bytes
    first: int = 0

    KIND: ClassVar = Kind.SAMPLES

    def __post_init__(self) -> None:
        """Check the ranges."""
        samples = self.samples
        if not isinstance(samples, bytes):  # bytes() takes an array's memory for its values, and a number for zeros
            samples = bytes(whole("sample", sample, 0, AMPLITUDES - 1) for sample in samples)
        whole("number of samples", len(samples), 1, SAMPLES_PER_BLOCK)
        _set(self, samples=samples, first=whole("first sample", self.first, 0, MODULATION_SAMPLES - len(samples)))

    def _parts(self) -> tuple[_Fields, bytes]:
        return _Fields(first=self.first, count=len(self.samples)), self.samples


@dataclass(frozen=True)
class AmplitudeModulation:
    """Let amplitudes of the buffer, in a loop, modulate whatever plays (clause BLK-017).

    Parameters
    ----------
    first, count : int
        The samples of the buffer that apply.
    hold : int
        The number of carrier periods that each sample holds.
    period : int
        Carrier period at which the first begins; `NOW` for as soon as possible.
    """

    first: int
    count: int
    hold: int
    period: int = NOW

    KIND: ClassVar = Kind.MODULATION

    def __post_init__(self) -> None:
        """Check the ranges."""
        count = whole("number of samples", self.count, 1, MODULATION_SAMPLES)
        _set(
            self,
            first=whole("first sample", self.first, 0, MODULATION_SAMPLES - count),
            count=count,
            hold=whole("number of periods that a sample holds", self.hold, 1, 2**16 - 1),
            period=_period(self.period),
        )

    def _parts(self) -> tuple[_Fields, bytes]:
        return _Fields(self.period, self.first, self.count, self.hold), b""


@dataclass(frozen=True)
class Output:
    """End what plays, or its modulation, at a period (clause BLK-018)."""

    action: Action
    period: int = NOW

    KIND: ClassVar = Kind.OUTPUT

    def __post_init__(self) -> None:
        """Check the ranges."""
        _set(self, action=Action(self.action), period=_period(self.period))

    def _parts(self) -> tuple[_Fields, bytes]:
        return _Fields(period=self.period, action=self.action), b""


@dataclass(frozen=True)
class Clock:
    """Ask for the device's time, in the acknowledgement (clause BLK-019)."""

    KIND: ClassVar = Kind.CLOCK

    def _parts(self) -> tuple[_Fields, bytes]:
        return _Fields(), b""


@dataclass(frozen=True)
class NoOp:
    """A sign of life (clause BLK-020)."""

    KIND: ClassVar = Kind.NO_OP

    def _parts(self) -> tuple[_Fields, bytes]:
        return _Fields(), b""


Change = Update | PlaySequence | AmplitudeModulation | Output
"""What takes effect at a period (clause BLK-005)."""

Body = Change | Slot | Entries | Samples | Clock | NoOp


class Block(NamedTuple):
    """A body under its sequence number.

    Parameters
    ----------
    body : Body
        What to do.
    sequence : int
        Number of the block, 32 bits; the acknowledgement repeats it (chapter NUM).
    restart : bool
        Whether the numbering begins anew with this block.
    """

    body: Body
    sequence: int
    restart: bool = False


def pack_pulses(pulses: Pulses) -> bytes:
    """Pack an even number of pulses at 12 bits each: phase in the low 7 bits, width in the high 5 (clause PUL-005).

    Raises
    ------
    ValueError
        If the number of pulses is odd.
    """
    if len(pulses) % 2:
        raise ValueError(f"{len(pulses)} pulses are no pairs: two share three bytes")
    pairs = (pulses.width.astype(_WORD) << 7 | pulses.phase).view(_PAIR)
    pairs -= (pairs >> 16) * ((1 << 16) - (1 << 12))  # the second of each pair from bit 16 to bit 12
    return pairs.view(np.uint8).reshape(-1, 4)[:, :3].tobytes()


def pulse_words(packed: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Undo the packing of clause PUL-005 alone: pulses of 12 bits, whatever they are.

    Parameters
    ----------
    packed : (..., 3 k) uint8

    Returns
    -------
    (..., 2 k) uint16
        The phase in the low 7 bits, the width in the high 5.
    """
    octets = packed.reshape(*packed.shape[:-1], -1, 3).astype(np.uint16)
    first, middle, last = octets[..., 0], octets[..., 1], octets[..., 2]
    pairs = np.stack([first | (middle & 0xF) << 8, middle >> 4 | last << 4], axis=-1)
    return pairs.reshape(*packed.shape[:-1], -1)


def unpack_pulses(data: bytes) -> Pulses:
    """Undo `pack_pulses`.

    Raises
    ------
    BlockError
        If a phase or a width is one of the reserved values.
    """
    words = pulse_words(np.frombuffer(data, np.uint8))
    try:
        return Pulses(words & 0x7F, words >> 7)
    except ValueError as error:
        raise BlockError(str(error), Reason.PULSE) from None


def checksum(block: bytes) -> int:
    """CRC-32 of a block with 0 in the checksum's place (clause BLK-003)."""
    return zlib.crc32(block[HEADER_BYTES:], zlib.crc32(bytes(4), zlib.crc32(block[:CHECKSUM_OFFSET])))


def pack(block: Block) -> bytes:
    """Pack a block, 512 bytes.

    Raises
    ------
    ValueError
        If the sequence number does not fit 32 bits.
    """
    if not (isinstance(block, Block) and isinstance(block.body, Body)):
        raise ValueError(f"{block!r} is no Block of a body and a number")
    body, sequence, restart = block
    fields, payload = body._parts()
    if flag("restart", restart):
        fields = replace(fields, flags=fields.flags | Flag.RESTART)
    number = whole("sequence number", sequence, 0, 2**32 - 1)
    header = (BLOCK_MAGIC, PROTOCOL_VERSION, body.KIND, number, *vars(fields).values())
    payload = payload.ljust(PAYLOAD_BYTES, b"\0")
    return _HEADER.pack(*header, checksum(_HEADER.pack(*header, 0) + payload)) + payload


def unpack(data: bytes) -> Block:
    """Validate a block and read what it asks for.

    Raises
    ------
    BlockError
        With the first reason that applies, in the order of `Reason`, as far as it can be told from the bytes alone.
    """
    if len(data) != BLOCK_BYTES:
        raise BlockError(f"a block has {BLOCK_BYTES} bytes, not {len(data)}", Reason.LENGTH)
    magic, version, kind, sequence, *rest, stated = _HEADER.unpack_from(data)
    if stated != (computed := checksum(data)):
        raise BlockError(f"CRC-32 {stated:08x} should be {computed:08x}", Reason.CHECKSUM)
    if magic != BLOCK_MAGIC:
        raise BlockError(f"magic {magic.hex()} should be {BLOCK_MAGIC.hex()}", Reason.MAGIC)
    if version != PROTOCOL_VERSION:
        raise BlockError(f"protocol version {version}; this is version {PROTOCOL_VERSION}", Reason.VERSION)
    if kind not in _READERS:
        raise BlockError(f"unknown kind {kind}; known are {[known.value for known in Kind]}", Reason.KIND)
    fields = _Fields(*rest)
    restart = fields.flags & Flag.RESTART
    try:
        body = _READERS[kind](replace(fields, flags=fields.flags - restart), data[HEADER_BYTES:])
    except BlockError:
        raise
    except ValueError as error:
        raise BlockError(str(error), Reason.FIELD) from None
    return Block(body, sequence, bool(restart))


def header_fields(data: bytes) -> dict[str, Any]:
    """The fields of a block's header as they stand, not judged, by their names in clause BLK-002.

    Parameters
    ----------
    data : bytes
        The bytes of a block, at least the 32 of its header.
    """
    by_kind = (field.name for field in dataclass_fields(_Fields))
    names = ("magic", "version", "kind", "sequence", *by_kind, "checksum")
    return dict(zip(names, _HEADER.unpack_from(data), strict=True))


def _check_unused(fields: _Fields, *used: str) -> None:
    for name, value in vars(fields).items():
        if value and name not in used:
            raise ValueError(f"{name} {value} should be 0: a block of this kind does not use it")


def _items(payload: bytes, count: int, size: int = 1) -> bytes:
    """The items at the head of a payload, after which only zeros may follow."""
    if any(payload[count * size :]):
        raise ValueError(f"bytes after the {count} items of the payload should be 0")
    return payload[: count * size]


def _read_update(fields: _Fields, payload: bytes) -> Update:
    _check_unused(fields, "period")
    return Update(unpack_pulses(payload), fields.period)


def _read_slot(fields: _Fields, payload: bytes) -> Slot:
    _check_unused(fields, "first")
    whole("slot", fields.first, 0, SLOTS - 1)  # before the pulses, as a header comes before its payload
    return Slot(fields.first, unpack_pulses(payload))


def _read_entries(fields: _Fields, payload: bytes) -> Entries:
    _check_unused(fields, "first", "count")
    whole("number of entries", fields.count, 1, ENTRIES_PER_BLOCK)
    items = _ENTRY.iter_unpack(_items(payload, fields.count, _ENTRY.size))
    return Entries(tuple(Entry(*item) for item in items), fields.first)


def _read_sequence(fields: _Fields, payload: bytes) -> PlaySequence:
    unattended = fields.flags & Flag.UNATTENDED
    _check_unused(replace(fields, flags=fields.flags - unattended), "period", "first", "count", "repeats")
    _items(payload, 0)
    return PlaySequence(fields.first, fields.count, fields.period, fields.repeats, bool(unattended))


def _read_samples(fields: _Fields, payload: bytes) -> Samples:
    _check_unused(fields, "first", "count")
    whole("number of samples", fields.count, 1, SAMPLES_PER_BLOCK)
    return Samples(_items(payload, fields.count), fields.first)


def _read_modulation(fields: _Fields, payload: bytes) -> AmplitudeModulation:
    _check_unused(fields, "period", "first", "count", "hold")
    _items(payload, 0)
    return AmplitudeModulation(fields.first, fields.count, fields.hold, fields.period)


def _read_output(fields: _Fields, payload: bytes) -> Output:
    _check_unused(fields, "period", "action")
    _items(payload, 0)
    return Output(Action(fields.action), fields.period)


def _read_nothing(body: type[Clock | NoOp], fields: _Fields, payload: bytes) -> Clock | NoOp:
    _check_unused(fields)
    _items(payload, 0)
    return body()


_READERS: dict[int, Callable[[_Fields, bytes], Body]] = {
    Kind.UPDATE: _read_update,
    Kind.SLOT: _read_slot,
    Kind.ENTRIES: _read_entries,
    Kind.SEQUENCE: _read_sequence,
    Kind.SAMPLES: _read_samples,
    Kind.MODULATION: _read_modulation,
    Kind.OUTPUT: _read_output,
    Kind.CLOCK: partial(_read_nothing, Clock),
    Kind.NO_OP: partial(_read_nothing, NoOp),
}
