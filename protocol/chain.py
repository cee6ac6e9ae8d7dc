"""What the controller and the processors behind it tell each other, as values and as tokens (SPEC.md, chapter CHN).

A message is a route header (node, channel end), its payload and the control token END. `encode` gives its tokens as
bytes, END as the byte of its code; `decode` makes the value again or refuses. These are the fast twins of
`layout.chain`: same bytes, and the same input refused.

Loading and committing are apart: slices fill the processors' mailboxes, then commits name the period at which all of
them begin to play.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from ..base.arguments import whole
from ..base.errors import ChainError
from .board import CHANNELS_PER_PROCESSOR, PROCESSORS
from .codes import (
    CONTROLLER_NODE,
    END_TOKEN,
    MODULATION_SAMPLES,
    SEQUENCE_ENTRIES,
    SLOTS,
    UNNUMBERED_NODE,
    ChannelEnd,
    Memory,
)

__all__ = [
    "LOAD_BYTES",
    "MEMORIES",
    "SLICE_BYTES",
    "Collect",
    "Commit",
    "Identity",
    "Load",
    "MemoryLayout",
    "Message",
    "Number",
    "Playing",
    "Program",
    "Report",
    "Slice",
    "commit_checksum",
    "decode",
    "loads",
]

SLICE_BYTES = CHANNELS_PER_PROCESSOR * 12 // 8
LOAD_BYTES = SLICE_BYTES
ROUTE = struct.Struct(">HB")  # the switches read the high byte first
CHECKSUM = struct.Struct("<I")
END = bytes([END_TOKEN])


def _check_processor(processor: int) -> None:
    whole("processor", processor, 0, PROCESSORS - 1)


def _check_packed(packed: bytes) -> None:
    if len(packed) != SLICE_BYTES:
        raise ValueError(f"the pulses of a processor take {SLICE_BYTES} bytes, not {len(packed)}")


class Message:
    """One message of the chain; each kind is a frozen dataclass.

    Attributes
    ----------
    CHANNEL_END : ChannelEnd
        The channel end where it arrives.
    CLAUSE : str
        The clause that says what its fields may be.
    TOKENS : int
        Tokens on a link: route header, payload with its CRC-32, and END.
    """

    CHANNEL_END: ClassVar[ChannelEnd]
    CLAUSE: ClassVar[str]
    PAYLOAD: ClassVar[struct.Struct]
    GUARDED: ClassVar[bool] = True
    TOKENS: ClassVar[int]

    def __init_subclass__(cls) -> None:
        checksum = CHECKSUM.size if cls.GUARDED else 0
        cls.TOKENS = ROUTE.size + cls.PAYLOAD.size + checksum + len(END)

    @property
    def node(self) -> int:
        """The node that it goes to."""
        return CONTROLLER_NODE

    def _fields(self) -> tuple[Any, ...]:
        """What the payload packs."""
        raise NotImplementedError

    @classmethod
    def _of(cls, fields: tuple[Any, ...]) -> Self:
        """The message with these fields; raise `ValueError` if it is none."""
        return cls(*fields)

    @classmethod
    def _read(cls, _node: int, payload: bytes) -> Self:
        return cls._of(cls.PAYLOAD.unpack(payload))

    def encode(self) -> bytes:
        """The tokens on the links, END as the byte of its code."""
        tokens = ROUTE.pack(self.node, self.CHANNEL_END) + self.PAYLOAD.pack(*self._fields())
        if self.GUARDED:
            tokens += CHECKSUM.pack(zlib.crc32(tokens))
        return tokens + END

    @classmethod
    def _decode(cls, tokens: bytes) -> Self:
        name = cls.CHANNEL_END.name
        if len(tokens) != cls.TOKENS:
            raise ChainError(f"{name} has {cls.TOKENS} tokens, not {len(tokens)}", "CHN-010")
        node, _ = ROUTE.unpack_from(tokens)
        payload_end = ROUTE.size + cls.PAYLOAD.size
        if cls.GUARDED and tokens[payload_end:-1] != CHECKSUM.pack(zlib.crc32(tokens[:payload_end])):
            raise ChainError(f"the CRC-32 of {name} does not match its tokens", "CHN-010")
        try:
            message = cls._read(node, tokens[ROUTE.size : payload_end])
        except ValueError as error:
            raise ChainError(f"{name} is damaged: {error}", cls.CLAUSE) from error
        if message.node != node:
            raise ChainError(f"{name} goes to node {message.node:#06x}, not {node:#06x}", cls.CLAUSE)
        return message


def decode(tokens: bytes) -> Message:
    """The message that tokens are (clause CHN-010).

    Parameters
    ----------
    tokens : bytes
        The result of `Message.encode`: the last is the control token END.

    Raises
    ------
    ChainError
        If the tokens are no message of this protocol.
    """
    if len(tokens) <= ROUTE.size or tokens[-1] != END_TOKEN:
        raise ChainError(f"{len(tokens)} tokens are no message: a route header comes first and END last", "CHN-002")
    _, channel_end = ROUTE.unpack_from(tokens)
    if channel_end not in _KINDS:
        raise ChainError(f"nothing is received at channel end {channel_end}; 1 to {len(_KINDS)} are in use", "CHN-009")
    return _KINDS[channel_end]._decode(tokens)


class _ToProcessor(Message):
    """A message for one processor."""

    PAYLOAD = struct.Struct("")
    processor: int

    @property
    def node(self) -> int:
        """The processor's number is its node."""
        return self.processor

    @classmethod
    def _read(cls, node: int, payload: bytes) -> Self:
        return cls._of((node, *cls.PAYLOAD.unpack(payload)))


@dataclass(frozen=True)
class Slice(_ToProcessor):
    """The pulses of one processor (clause CHN-003). It has no CRC-32 of its own: its commit guards it.

    Parameters
    ----------
    processor : int
        Place in the chain, 0 to 9.
    packed : bytes
        48 bytes: 32 pulses in the order of the port's bits.
    """

    processor: int
    packed: bytes

    CHANNEL_END = ChannelEnd.SLICE
    CLAUSE = "CHN-011"
    PAYLOAD = struct.Struct(f"{SLICE_BYTES}s")
    GUARDED = False

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        _check_packed(self.packed)

    def _fields(self) -> tuple[Any, ...]:
        return (self.packed,)


@dataclass(frozen=True)
class Commit(_ToProcessor):
    """Play a slice from a period on (clause CHN-004). Its checksum guards slice and period (clause CHN-011).

    Parameters
    ----------
    processor : int
        Place in the chain, 0 to 9.
    period : int
        Carrier period, 64 bits.
    checksum : int
        CRC-32 of the slice's 48 bytes and the period's 8.
    """

    processor: int
    period: int
    checksum: int

    CHANNEL_END = ChannelEnd.COMMIT
    CLAUSE = "CHN-011"
    PAYLOAD = struct.Struct("<QI")
    GUARDED = False

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        whole("period", self.period, 0, 2**64 - 1)
        whole("checksum", self.checksum, 0, 2**32 - 1)

    @classmethod
    def of(cls, period: int, piece: Slice) -> Commit:
        """The commit that goes with a slice."""
        whole("period", period, 0, 2**64 - 1)
        return cls(piece.processor, period, commit_checksum(period, piece.packed))

    def guards(self, packed: bytes) -> bool:
        """Whether both this commit and the slice that a mailbox holds are undamaged and belong together."""
        return self.checksum == commit_checksum(self.period, packed)

    def _fields(self) -> tuple[Any, ...]:
        return self.period, self.checksum


def commit_checksum(period: int, packed: bytes) -> int:
    """The CRC-32 that guards a slice's 48 bytes and its period (clause CHN-011)."""
    return zlib.crc32(period.to_bytes(8, "little"), zlib.crc32(packed))


@dataclass(frozen=True)
class MemoryLayout:
    """How a memory of a processor is divided: ``items`` of ``item_bytes`` each."""

    items: int
    item_bytes: int

    @property
    def size(self) -> int:
        """All of it, in bytes."""
        return self.items * self.item_bytes

    @property
    def per_load(self) -> int:
        """Items that one load carries at most."""
        return LOAD_BYTES // self.item_bytes


MEMORIES = {
    Memory.SLOTS: MemoryLayout(SLOTS, SLICE_BYTES),
    Memory.ENTRIES: MemoryLayout(SEQUENCE_ENTRIES, 4),
    Memory.SAMPLES: MemoryLayout(MODULATION_SAMPLES, 1),
}


@dataclass(frozen=True)
class Load(_ToProcessor):
    """Store items of a memory: one slot, up to 12 entries of the sequence or up to 48 samples (clause CHN-012).

    Parameters
    ----------
    processor : int
        Place in the chain, 0 to 9.
    memory : Memory
        The memory concerned.
    first : int
        First item that is replaced.
    data : bytes
        One or more whole items, at most 48 bytes; on the links the rest of the 48 is 0.
    """

    processor: int
    memory: Memory
    first: int
    data: bytes

    CHANNEL_END = ChannelEnd.LOAD
    CLAUSE = "CHN-012"
    PAYLOAD = struct.Struct(f"<BHB{LOAD_BYTES}s")

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        if self.memory not in MEMORIES:
            raise ValueError(
                f"{self.memory!r} is no memory of a processor; {', '.join(memory.name for memory in MEMORIES)} are"
            )
        layout = MEMORIES[self.memory]
        if len(self.data) % layout.item_bytes or not 0 < len(self.data) <= LOAD_BYTES:
            raise ValueError(
                f"{len(self.data)} bytes are not 1 to {layout.per_load} items of {layout.item_bytes} bytes"
            )
        whole("first", self.first, 0, layout.items - self.count)

    @property
    def count(self) -> int:
        """Items that are replaced."""
        return len(self.data) // MEMORIES[self.memory].item_bytes

    def _fields(self) -> tuple[Any, ...]:
        return self.memory, self.first, self.count, self.data

    @classmethod
    def _of(cls, fields: tuple[Any, ...]) -> Self:
        processor, code, first, count, data = fields
        memory = Memory(code)
        size = count * MEMORIES[memory].item_bytes
        if any(data[size:]):
            raise ValueError(f"bytes after its {count} items are not 0")
        if size > LOAD_BYTES:
            raise ValueError(f"{count} items are more than {LOAD_BYTES} bytes hold")
        return cls(processor, memory, first, data[:size])


def loads(processor: int, memory: Memory, first: int, data: bytes) -> list[Load]:
    """The loads that bring whole items to a processor, as few as possible and in ascending order."""
    layout = MEMORIES[memory]
    step = layout.per_load * layout.item_bytes
    return [
        Load(processor, memory, first + begin // layout.item_bytes, data[begin : begin + step])
        for begin in range(0, len(data), step)
    ]


@dataclass(frozen=True)
class Program(_ToProcessor):
    """Start or stop the sequence or the modulation at a period (clause CHN-014).

    Parameters
    ----------
    processor : int
        Place in the chain, 0 to 9.
    memory : Memory
        `Memory.ENTRIES` or `Memory.SAMPLES`.
    period : int
        Carrier period at which it takes effect, 64 bits.
    first, count : int
        Items that are played; a count of 0 stops it.
    hold : int
        Periods that each sample of a modulation lasts, at least 1; 0 for a sequence and when it stops.
    repeats : int
        Times that a sequence is played, 0 for without end; 0 for a modulation and when it stops.
    """

    processor: int
    memory: Memory
    period: int
    first: int
    count: int
    hold: int = 0
    repeats: int = 0

    CHANNEL_END = ChannelEnd.PROGRAM
    CLAUSE = "CHN-014"
    PAYLOAD = struct.Struct("<BHHHHQ")

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        if self.memory not in (Memory.ENTRIES, Memory.SAMPLES):
            raise ValueError(f"{self.memory!r} cannot be started; a sequence or a modulation can")
        whole("period", self.period, 0, 2**64 - 1)
        room = MEMORIES[self.memory].items
        whole("count", self.count, 0, room)
        whole("first", self.first, 0, room - self.count if self.count else 0)
        started = self.memory if self.count else None
        whole("hold", self.hold, *((1, 2**16 - 1) if started is Memory.SAMPLES else (0, 0)))
        whole("repeats", self.repeats, 0, 2**16 - 1 if started is Memory.ENTRIES else 0)

    def _fields(self) -> tuple[Any, ...]:
        return self.memory, self.first, self.count, self.hold, self.repeats, self.period

    @classmethod
    def _of(cls, fields: tuple[Any, ...]) -> Self:
        processor, memory, first, count, hold, repeats, period = fields
        return cls(processor, Memory(memory), period, first, count, hold, repeats)


@dataclass(frozen=True)
class Collect(_ToProcessor):
    """Ask a processor for a report or for what it plays (clause CHN-016).

    Parameters
    ----------
    processor : int
        Place in the chain, 0 to 9.
    answer : ChannelEnd
        The message wanted: `ChannelEnd.REPORT` or `ChannelEnd.PLAYING`.
    """

    processor: int
    answer: ChannelEnd

    CHANNEL_END = ChannelEnd.COLLECT
    CLAUSE = "CHN-016"
    PAYLOAD = struct.Struct("<B")

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        if self.answer not in (ChannelEnd.REPORT, ChannelEnd.PLAYING):
            raise ValueError(f"{self.answer!r} cannot be asked for; REPORT and PLAYING can")

    def _fields(self) -> tuple[Any, ...]:
        return (self.answer,)

    @classmethod
    def _of(cls, fields: tuple[Any, ...]) -> Self:
        processor, answer = fields
        return cls(processor, ChannelEnd(answer))


@dataclass(frozen=True)
class Number(Message):
    """The number that the next processor without one takes (clause CHN-022).

    Parameters
    ----------
    number : int
        Place in the chain, 0 to 9.
    """

    number: int

    CHANNEL_END = ChannelEnd.NUMBER
    CLAUSE = "CHN-022"
    PAYLOAD = struct.Struct("<B")

    def __post_init__(self) -> None:
        """Check the range."""
        _check_processor(self.number)

    @property
    def node(self) -> int:
        """Whoever has no number."""
        return UNNUMBERED_NODE

    def _fields(self) -> tuple[Any, ...]:
        return (self.number,)


@dataclass(frozen=True)
class Report(Message):
    """How a processor is (clause CHN-016). Counts are since power-up and wrap to 0.

    Parameters
    ----------
    processor : int
        Place in the chain, 0 to 9.
    temperature_c : int
        Temperature of the board, °C.
    faults : int
        Bits of the faults that the processor sees, 16 bits.
    firmware : (int, int, int)
        Version.
    drift : int
        Ticks by which the last pulse of the sync line came late (negative: early), held at -128 and 127.
    carried_out, missed_commits : int
        Commits.
    damaged_messages : int
        Messages that were dropped.
    """

    processor: int
    temperature_c: int
    faults: int
    firmware: tuple[int, int, int]
    drift: int
    carried_out: int
    missed_commits: int
    damaged_messages: int

    CHANNEL_END = ChannelEnd.REPORT
    CLAUSE = "CHN-016"
    PAYLOAD = struct.Struct("<BbH3BbIII")

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        whole("temperature_c", self.temperature_c, -128, 127)
        whole("faults", self.faults, 0, 2**16 - 1)
        _check_firmware(self.firmware)
        whole("drift", self.drift, -128, 127)
        for name in ("carried_out", "missed_commits", "damaged_messages"):
            whole(name, getattr(self, name), 0, 2**32 - 1)

    def _fields(self) -> tuple[Any, ...]:
        counts = (self.carried_out, self.missed_commits, self.damaged_messages)
        return self.processor, self.temperature_c, self.faults, *self.firmware, self.drift, *counts

    @classmethod
    def _of(cls, fields: tuple[Any, ...]) -> Self:
        processor, temperature_c, faults, major, minor, patch, *rest = fields
        return cls(processor, temperature_c, faults, (major, minor, patch), *rest)


@dataclass(frozen=True)
class Playing(Message):
    """What a processor plays and since when (clause CHN-016).

    Parameters
    ----------
    processor : int
        Place in the chain, 0 to 9.
    period : int
        Carrier period at which these pulses began, 64 bits.
    packed : bytes
        48 bytes: 32 pulses in the order of the port's bits.
    """

    processor: int
    period: int
    packed: bytes

    CHANNEL_END = ChannelEnd.PLAYING
    CLAUSE = "CHN-016"
    PAYLOAD = struct.Struct(f"<BQ{SLICE_BYTES}s")

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        whole("period", self.period, 0, 2**64 - 1)
        _check_packed(self.packed)

    def _fields(self) -> tuple[Any, ...]:
        return self.processor, self.period, self.packed


@dataclass(frozen=True)
class Identity(Message):
    """Who took a number (clause CHN-022).

    Parameters
    ----------
    processor : int
        The number taken, 0 to 9.
    last : bool
        Whether nothing answers on the link behind.
    firmware : (int, int, int)
        Version.
    unique_id : int
        Number of the processor's package, 64 bits.
    """

    processor: int
    last: bool
    firmware: tuple[int, int, int]
    unique_id: int

    CHANNEL_END = ChannelEnd.IDENTITY
    CLAUSE = "CHN-022"
    PAYLOAD = struct.Struct("<BB3BQ")

    def __post_init__(self) -> None:
        """Check the ranges."""
        _check_processor(self.processor)
        whole("last", int(self.last), 0, 1)
        _check_firmware(self.firmware)
        whole("unique_id", self.unique_id, 0, 2**64 - 1)

    def _fields(self) -> tuple[Any, ...]:
        return self.processor, self.last, *self.firmware, self.unique_id

    @classmethod
    def _of(cls, fields: tuple[Any, ...]) -> Self:
        processor, last, major, minor, patch, unique_id = fields
        whole("last", int(last), 0, 1)
        return cls(processor, bool(last), (major, minor, patch), unique_id)


def _check_firmware(firmware: tuple[int, int, int]) -> None:
    if len(firmware) != 3 or not all(0 <= part < 256 for part in firmware):
        raise ValueError(f"firmware version {firmware} is not three numbers of 0 to 255")


_KINDS: dict[int, type[Message]] = {
    kind.CHANNEL_END: kind for kind in (Slice, Commit, Load, Program, Collect, Number, Report, Playing, Identity)
}
