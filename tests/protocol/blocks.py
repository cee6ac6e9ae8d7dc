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
    Entries,
    Entry,
    Modulation,
    NoOp,
    Output,
    Pulses,
    Reason,
    Samples,
    Sequence,
    Slot,
    Update,
)
from phasewire.protocol.layout.blocks import BLOCK

from tests.strategies import pulses

U16, U32, U64 = (st.integers(0, 2**bits - 1) for bits in (16, 32, 64))
PERIODS = st.just(0) | st.integers(2**64 - 3, 2**64 - 1) | U64
SEQUENCES = st.integers(2**32 - 3, 2**32 - 1) | U32


def bodies() -> st.SearchStrategy[Any]:
    """Any body that a block can have."""
    entries = st.builds(Entry, st.integers(0, 255), st.integers(1, 2**16 - 1))
    holds = st.integers(1, 2**16 - 1)
    return st.one_of(
        st.builds(Update, pulses(), PERIODS),
        st.builds(Slot, st.integers(0, 255), pulses()),
        _lists(entries, 120).flatmap(
            lambda items: st.builds(Entries, st.just(tuple(items)), _places(len(items), 1024))
        ),
        _counts(1024).flatmap(lambda n: st.builds(Sequence, _places(n, 1024), st.just(n), PERIODS, U16, st.booleans())),
        _lists(st.integers(0, 255), 480).flatmap(
            lambda items: st.builds(Samples, st.just(bytes(items)), _places(len(items), 4096))
        ),
        _counts(4096).flatmap(lambda n: st.builds(Modulation, _places(n, 4096), st.just(n), holds, PERIODS)),
        st.builds(Output, st.sampled_from(Action), PERIODS),
        st.just(Clock()),
        st.just(NoOp()),
    )


def _lists(item: st.SearchStrategy[Any], most: int) -> st.SearchStrategy[list[Any]]:
    return st.lists(item, min_size=1, max_size=most) | st.lists(item, min_size=most, max_size=most)


def _counts(room: int) -> st.SearchStrategy[int]:
    return st.integers(1, room) | st.just(room)


def _places(count: int, room: int) -> st.SearchStrategy[int]:
    """Where so many items may begin; the last place often."""
    return st.integers(0, room - count) | st.just(room - count)


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
    if isinstance(body, Entries):
        listed = [{"slot": entry.slot, "periods": entry.periods} for entry in body.entries]
        fields |= {"first": body.first, "count": len(listed), "entries": listed}
    if isinstance(body, Samples):
        fields |= {"first": body.first, "count": len(body.samples), "samples": body.samples}
    if isinstance(body, Sequence):
        fields |= {"first": body.first, "count": body.count, "period": body.period, "repeats": body.repeats}
        fields["flags"] += 2 * body.unattended
    if isinstance(body, Modulation):
        fields |= {"first": body.first, "count": body.count, "period": body.period, "hold": body.hold}
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
