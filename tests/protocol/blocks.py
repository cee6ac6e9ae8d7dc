"""What the tests of blocks share: strategies, and blocks as the normative definition builds and judges them."""

from __future__ import annotations

import struct
import zlib
from typing import Any

from construct import ConstructError, StreamError, TerminatedError
from hypothesis import strategies as st
from phasewire.protocol import (
    Action,
    Block,
    Clock,
    Entry,
    Modulation,
    ModulationStart,
    NoOp,
    Output,
    Pulses,
    Reason,
    Sequence,
    SequenceStart,
    Slot,
    Update,
)
from phasewire.protocol.layout.blocks import BLOCK

from tests.strategies import pulses

U16, U32, U64 = (st.integers(0, 2**bits - 1) for bits in (16, 32, 64))
PERIODS = st.just(0) | st.integers(2**64 - 3, 2**64 - 1) | U64
SEQUENCES = st.integers(2**32 - 3, 2**32 - 1) | U32


def _listed(
    start: st.SearchStrategy[Any], most: int, room: int, item: st.SearchStrategy[Any]
) -> st.SearchStrategy[Any]:
    """Items, their place and perhaps a start, that fit."""
    lists = st.lists(item, min_size=1, max_size=most) | st.lists(item, min_size=most, max_size=most)
    placed = lists.flatmap(
        lambda items: st.tuples(
            st.just(items), st.integers(0, room - len(items)) | st.just(room - len(items)), st.none() | start
        )
    )
    return placed | st.tuples(st.just([]), st.integers(0, room), start)


def bodies() -> st.SearchStrategy[Any]:
    """Any body that a block can have."""
    entries = st.builds(Entry, st.integers(0, 255), st.integers(1, 2**16 - 1))
    sequence_start = st.builds(SequenceStart, st.integers(1, 1024), PERIODS, U16, st.booleans())
    modulation_start = st.builds(ModulationStart, st.integers(1, 4096), st.integers(1, 2**16 - 1), PERIODS) | st.builds(
        ModulationStart, st.just(0), st.just(0), PERIODS
    )
    return st.one_of(
        st.builds(Update, pulses(), PERIODS),
        st.builds(Slot, st.integers(0, 255), pulses()),
        _listed(sequence_start, 120, 1024, entries).map(lambda parts: Sequence(tuple(parts[0]), *parts[1:])),
        _listed(modulation_start, 480, 4096, st.integers(0, 255)).map(
            lambda parts: Modulation(bytes(parts[0]), *parts[1:])
        ),
        st.builds(Output, st.sampled_from(Action), PERIODS),
        st.just(Clock()),
        st.just(NoOp()),
    )


def blocks() -> st.SearchStrategy[Block]:
    """Any block."""
    return st.builds(Block, bodies(), SEQUENCES, st.booleans())


def by_construct(block: Block) -> bytes:
    """The block as the normative definition builds it."""
    body, sequence, restart = block
    fields: dict[str, Any] = {"flags": int(restart)}
    if isinstance(body, Update | Slot):
        fields["pulses"] = pairs(body.pulses)
    if isinstance(body, Update | Output):
        fields["period"] = body.period
    if isinstance(body, Slot):
        fields["first"] = body.number
    if isinstance(body, Output):
        fields["action"] = int(body.action)
    if isinstance(body, Sequence | Modulation):
        items = body.entries if isinstance(body, Sequence) else body.samples
        fields |= {"first": body.first, "count": len(items), "length": 0, "period": 0}
        if body.start:
            fields["flags"] += 2
            fields |= {"length": body.start.length, "period": body.start.period}
    if isinstance(body, Sequence):
        fields["repeats"] = body.start.repeats if body.start else 0
        fields["flags"] += 4 if body.start and body.start.unattended else 0
        fields["entries"] = [{"slot": entry.slot, "periods": entry.periods} for entry in body.entries]
    if isinstance(body, Modulation):
        fields["hold"] = body.start.hold if body.start else 0
        fields["samples"] = body.samples
    return bytes(BLOCK.build({"block": {"kind": int(body.KIND), "sequence": sequence, "body": fields}}))


def pairs(made: Pulses) -> list[dict[str, int]]:
    """Pulses as the normative definition takes them."""
    phase, width = made.phase.tolist(), made.width.tolist()
    return [
        {"even_phase": phase[i], "even_width": width[i], "odd_phase": phase[i + 1], "odd_width": width[i + 1]}
        for i in range(0, len(phase), 2)
    ]


def reason_by_construct(data: bytes) -> Reason:
    """Why the normative definition refuses bytes: the field at which it stops."""
    try:
        BLOCK.parse(data)
    except TerminatedError:
        return Reason.LENGTH
    except StreamError as error:
        return Reason.LENGTH if error.path == "(parsing) -> block" else Reason.FIELD
    except ConstructError as error:
        path = (error.path or "").split(" -> ")
        for name in ("checksum", "magic", "version", "kind", "pulses"):
            if name in path:
                return Reason.PULSE if name == "pulses" else Reason[name.upper()]
        return Reason.FIELD
    return Reason.ACCEPTED


def resealed(block: bytes | bytearray) -> bytes:
    """The block with its CRC-32 made right again, computed here from the specification's sentence."""
    checksum = zlib.crc32(bytes(block[:28]) + bytes(4) + bytes(block[32:]))
    return bytes(block[:28]) + struct.pack("<I", checksum) + bytes(block[32:])
