from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
import pytest
from construct import ConstructError
from hypothesis import given
from hypothesis import strategies as st
from phasewire.errors import BlockError
from phasewire.protocol import Pulses, Reason, Update, pack, unpack
from phasewire.protocol.layout.blocks import BLOCK

from tests.strategies import pulses

SEQUENCES = st.integers(0, 2**32 - 1)
PERIODS = st.none() | st.integers(0, 2**64 - 1)


def by_construct(update: Update) -> bytes:
    """The block as the normative definition builds it."""
    phase, width = update.pulses.phase.tolist(), update.pulses.width.tolist()
    pairs = [
        {"even_phase": phase[i], "even_width": width[i], "odd_phase": phase[i + 1], "odd_width": width[i + 1]}
        for i in range(0, len(phase), 2)
    ]
    header = {
        "kind": 1 if update.period is None else 2,
        "sequence": update.sequence,
        "period": update.period or 0,
    }
    return bytes(BLOCK.build({"header": {"value": header}, "pulses": {"value": pairs}}))


def resealed(block: bytes | bytearray) -> bytes:
    """The block with its CRC-32 made right again, computed here from the specification's sentence."""
    checksum = zlib.crc32(bytes(block[:28]) + bytes(block[32:]))
    return bytes(block[:28]) + struct.pack("<I", checksum) + bytes(block[32:])


@given(pulses(), SEQUENCES, PERIODS)
def test_numpy_and_construct_build_the_same_bytes(made: Pulses, sequence: int, period: int | None) -> None:
    update = Update(made, sequence, period)
    assert pack(update) == by_construct(update)


@given(pulses(), SEQUENCES, PERIODS)
def test_both_read_back_what_was_packed(made: Pulses, sequence: int, period: int | None) -> None:
    block = pack(Update(made, sequence, period))
    assert len(block) == 512
    assert unpack(block) == Update(made, sequence, period)
    parsed: Any = BLOCK.parse(block)
    assert parsed.header.value.sequence == sequence
    assert parsed.header.value.period == (period or 0)
    assert [pair.odd_phase for pair in parsed.pulses.value] == made.phase[1::2].tolist()
    assert [pair.even_width for pair in parsed.pulses.value] == made.width[0::2].tolist()


def test_the_layout_by_hand() -> None:
    """Bytes worked out on paper: phase in the low 7 bits, width in the high 5, two pulses in three bytes."""
    phase, width = np.zeros(320, int), np.zeros(320, int)
    phase[:2], width[:2] = (99, 1), (25, 2)  # 25·128 + 99 = 0xce3 and 2·128 + 1 = 0x101, so 0x101ce3
    block = pack(Update(Pulses(phase, width), sequence=0x04030201, period=0x0102030405060708))
    assert block[:16] == b"PW" + bytes([1, 2]) + bytes([1, 2, 3, 4]) + bytes([8, 7, 6, 5, 4, 3, 2, 1])
    assert block[16:28] == bytes(12)
    assert block[32:35] == bytes([0xE3, 0x1C, 0x10])
    assert block[35:] == bytes(477)


def test_every_single_bit_flip_is_refused(sphere_solution: Any) -> None:
    block = pack(Update(Pulses.from_drive(sphere_solution.drive), 7, 99))
    for bit in range(len(block) * 8):
        flipped = bytearray(block)
        flipped[bit // 8] ^= 1 << bit % 8
        with pytest.raises(BlockError):
            unpack(bytes(flipped))


def patched(offset: int, data: bytes, *, period: int | None = 5) -> bytes:
    block = bytearray(pack(Update(Pulses.silent(320), 1, period)))
    block[offset : offset + len(data)] = data
    return resealed(block)


MALFORMED = {
    Reason.LENGTH: [b"", bytes(511), bytes(513)],
    Reason.MAGIC: [patched(0, b"XW")],
    Reason.VERSION: [patched(2, b"\x02"), patched(2, b"\x00")],
    Reason.CHECKSUM: [pack(Update(Pulses.silent(320), 1))[:-1] + b"\x01"],
    Reason.KIND: [patched(3, b"\x00"), patched(3, b"\x03"), patched(3, b"\xff")],
    Reason.RESERVED: [patched(16, b"\x01"), patched(27, b"\x80"), patched(8, b"\x01", period=None)],
    Reason.PHASE: [patched(32, b"\x64"), patched(32, b"\x7f"), patched(509, b"\x00\x40\x06")],
    Reason.WIDTH: [patched(33, b"\x0d"), patched(511, b"\xd0")],
}


@pytest.mark.parametrize(("reason", "block"), [(reason, block) for reason in MALFORMED for block in MALFORMED[reason]])
def test_malformed_blocks_are_refused_with_their_reason_by_both(reason: Reason, block: bytes) -> None:
    with pytest.raises(BlockError) as refused:
        unpack(block)
    assert refused.value.reason == reason
    with pytest.raises(ConstructError):
        BLOCK.parse(block)


@given(st.binary(min_size=480, max_size=480), st.binary(max_size=28))
def test_any_payload_reads_back_to_the_same_bytes_or_is_refused_by_both(payload: bytes, head: bytes) -> None:
    block = bytearray(pack(Update(Pulses.silent(320), 1)))
    block[: len(head)] = head
    block = bytearray(resealed(bytes(block[:32]) + payload))
    try:
        update = unpack(bytes(block))
    except BlockError:
        with pytest.raises(ConstructError):
            BLOCK.parse(bytes(block))
    else:
        assert pack(update) == block == by_construct(update)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((Pulses.silent(319), 0), "an update carries 320 pulses, not 319"),
        ((Pulses.silent(320), 2**32), "sequence number 4294967296 does not fit"),
        ((Pulses.silent(320), -1), "sequence number -1"),
        ((Pulses.silent(320), 0, 2**64), "period 18446744073709551616 does not fit"),
        ((Pulses.silent(320), 0, -1), "period -1"),
    ],
)
def test_updates_that_cannot_travel_are_named(arguments: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Update(*arguments)
