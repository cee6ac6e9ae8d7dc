from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.errors import BlockError
from phasewire.protocol import (
    Action,
    Block,
    Clock,
    Entries,
    Entry,
    Kind,
    Modulation,
    NoOp,
    Output,
    Pulses,
    Reason,
    Samples,
    Sequence,
    Slot,
    Update,
    pack,
    unpack,
)
from phasewire.protocol.blocks import Body, pack_pulses
from phasewire.protocol.layout.blocks import BLOCK

from tests.protocol.blocks import blocks, by_construct, reason_by_construct, resealed
from tests.strategies import update

SILENT = Pulses.silent(320)
EXAMPLES = {
    Kind.UPDATE: Block(Update(SILENT, 5), 1),
    Kind.SLOT: Block(Slot(3, SILENT), 1),
    Kind.ENTRIES: Block(Entries((Entry(0, 100), Entry(1, 100))), 1),
    Kind.SEQUENCE: Block(Sequence(0, 2, 77, 3, unattended=True), 1),
    Kind.SAMPLES: Block(Samples(bytes(range(200)), 7), 1),
    Kind.MODULATION: Block(Modulation(7, 200, 10, 88), 1),
    Kind.OUTPUT: Block(Output(Action.SILENCE, 99), 1),
    Kind.CLOCK: Block(Clock(), 1),
    Kind.NO_OP: Block(NoOp(), 1),
}


def reason_of(data: bytes) -> Reason:
    """Why `unpack` refuses bytes."""
    try:
        unpack(data)
    except BlockError as error:
        return Reason(error.reason)
    return Reason.ACCEPTED


@given(blocks())
def test_struct_and_construct_build_the_same_bytes_and_read_them_back(block: Block) -> None:
    data = pack(block)
    assert len(data) == 512
    assert data == by_construct(block)
    assert unpack(data) == block
    assert reason_by_construct(data) is Reason.ACCEPTED


@given(blocks())
def test_what_construct_reads_is_what_was_meant(block: Block) -> None:
    parsed: Any = BLOCK.parse(pack(block)).block
    assert (parsed.kind, parsed.sequence, parsed.body.flags & 1) == (block.body.KIND, block.sequence, block.restart)
    if isinstance(block.body, Update | Slot):
        assert [pair.odd_phase for pair in parsed.body.pulses] == block.body.pulses.phase[1::2].tolist()
        assert [pair.even_width for pair in parsed.body.pulses] == block.body.pulses.width[0::2].tolist()


def test_an_update_by_hand() -> None:
    """Bytes worked out on paper: phase in the low 7 bits, width in the high 5, two pulses in three bytes."""
    phase, width = np.zeros(320, int), np.zeros(320, int)
    phase[:2], width[:2] = (99, 1), (25, 2)  # 25·128 + 99 = 0xce3 and 2·128 + 1 = 0x101, so 0x101ce3
    block = pack(Block(Update(Pulses(phase, width), 0x0102030405060708), 0x04030201))
    assert block[:16] == b"PW" + bytes([1, 1]) + bytes([1, 2, 3, 4]) + bytes([8, 7, 6, 5, 4, 3, 2, 1])
    assert block[16:28] == bytes(12)
    assert block[32:35] == bytes([0xE3, 0x1C, 0x10])
    assert block[35:] == bytes(477)


def test_the_other_kinds_by_hand() -> None:
    def variable(block: Block) -> tuple[int, bytes, bytes]:
        data = pack(block)
        return data[3], data[8:28], data[32:].rstrip(b"\0")

    assert variable(Block(Slot(0xAB, SILENT), 1)) == (2, bytes(8) + bytes([0xAB]) + bytes(11), b"")
    fields = bytes([0, 0, 0, 0, 0, 0, 0, 0, 2, 1, 2, 0, 0, 0, 0, 0, 0, 0, 1, 0])
    entries = Block(Entries((Entry(7, 0x1234), Entry(8, 1)), 0x102), 1, restart=True)
    assert variable(entries) == (3, fields, bytes([7, 0, 0x34, 0x12, 8, 0, 1]))
    fields = bytes([0x99, 0, 0, 0, 0, 0, 0, 0, 2, 1, 3, 2, 0, 0, 5, 4, 0, 0, 3, 0])
    assert variable(Block(Sequence(0x102, 0x203, 0x99, 0x405, True), 1, restart=True)) == (4, fields, b"")
    fields = bytes([0, 0, 0, 0, 0, 0, 0, 0, 4, 3, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0])
    assert variable(Block(Samples(b"\x11\x22\x33", 0x304), 1)) == (5, fields, b"\x11\x22\x33")
    fields = bytes([0x98, 0, 0, 0, 0, 0, 0, 0, 4, 3, 7, 3, 6, 5, 0, 0, 0, 0, 0, 0])
    assert variable(Block(Modulation(0x304, 0x307, 0x506, 0x98), 1)) == (6, fields, b"")
    assert variable(Block(Output(Action.DISABLE, 0x97), 1)) == (7, bytes([0x97]) + bytes(18) + b"\x03", b"")
    assert variable(Block(Clock(), 1)) == (8, bytes(20), b"")
    assert variable(Block(NoOp(), 1)) == (9, bytes(20), b"")


@pytest.mark.parametrize("kind", EXAMPLES)
def test_every_single_bit_flip_is_refused(kind: Kind, sphere_solution: Any) -> None:
    example = EXAMPLES[kind]
    if kind is Kind.UPDATE:
        example = Block(Update(Pulses.from_drive(sphere_solution.drive), 99), 7)
    block = pack(example)
    for bit in range(len(block) * 8):
        flipped = bytearray(block)
        flipped[bit // 8] ^= 1 << bit % 8
        assert reason_of(bytes(flipped)) is Reason.CHECKSUM


def patched(kind: Kind, offset: int, data: bytes) -> bytes:
    block = bytearray(pack(EXAMPLES[kind]))
    block[offset : offset + len(data)] = data
    return resealed(block)


def overfull(body: Body) -> bytes:
    """A block that is full and says that it holds one item more."""
    block = bytearray(pack(Block(body, 1)))
    block[18] += 1
    return resealed(block)


PERIOD, FIRST, COUNT, HOLD, REPEATS, RESERVED, FLAGS, ACTION, PAYLOAD = 8, 16, 18, 20, 22, 24, 26, 27, 32
USED = {
    Kind.UPDATE: {PERIOD},
    Kind.SLOT: {FIRST},
    Kind.ENTRIES: {FIRST, COUNT},
    Kind.SEQUENCE: {PERIOD, FIRST, COUNT, REPEATS},
    Kind.SAMPLES: {FIRST, COUNT},
    Kind.MODULATION: {PERIOD, FIRST, COUNT, HOLD},
    Kind.OUTPUT: {PERIOD, ACTION},
    Kind.CLOCK: set(),
    Kind.NO_OP: set(),
}
FIELDS = {PERIOD, FIRST, COUNT, HOLD, REPEATS, RESERVED, ACTION}
MALFORMED: list[tuple[Reason, bytes]] = [
    *((Reason.LENGTH, data) for data in (b"", bytes(511), bytes(513), pack(EXAMPLES[Kind.CLOCK]) + b"\0")),
    (Reason.CHECKSUM, update(SILENT, 1)[:-1] + b"\x01"),
    (Reason.MAGIC, patched(Kind.UPDATE, 0, b"XW")),
    (Reason.MAGIC, patched(Kind.CLOCK, 1, b"X")),
    (Reason.VERSION, patched(Kind.UPDATE, 2, b"\x02")),
    (Reason.VERSION, patched(Kind.UPDATE, 2, b"\x00")),
    *((Reason.KIND, patched(Kind.UPDATE, 3, bytes([kind]))) for kind in (0, 10, 255)),
    *((Reason.FIELD, patched(kind, at, b"\x01")) for kind, used in USED.items() for at in sorted(FIELDS - used)),
    *((Reason.FIELD, patched(kind, FLAGS, bytes([flag]))) for kind in EXAMPLES for flag in (4, 8, 16, 32, 64, 128)),
    *((Reason.FIELD, patched(kind, FLAGS, bytes([2]))) for kind in EXAMPLES if kind is not Kind.SEQUENCE),
    *((Reason.FIELD, patched(Kind.OUTPUT, ACTION, bytes([action]))) for action in (0, 4, 255)),
    *((Reason.FIELD, patched(kind, 511, b"\x01")) for kind in EXAMPLES if kind not in (Kind.UPDATE, Kind.SLOT)),
    (Reason.FIELD, patched(Kind.SLOT, FIRST, b"\x00\x01")),
    (Reason.FIELD, resealed(patched(Kind.SLOT, FIRST, b"\x00\x01")[:PAYLOAD] + b"\xff" * 480)),  # before its pulses
    (Reason.FIELD, patched(Kind.ENTRIES, PAYLOAD, b"\x00\x01")),  # slot 256
    (Reason.FIELD, patched(Kind.ENTRIES, PAYLOAD + 2, b"\x00\x00")),  # for no period
    (Reason.FIELD, patched(Kind.ENTRIES, COUNT, b"\x00")),
    (Reason.FIELD, patched(Kind.ENTRIES, COUNT, b"\x01")),  # an entry more than is said
    (Reason.FIELD, patched(Kind.ENTRIES, COUNT, b"\x79")),  # 121 entries
    (Reason.FIELD, patched(Kind.ENTRIES, FIRST, b"\xff\x03")),  # 1023 + 2 entries
    (Reason.FIELD, overfull(Entries((Entry(0, 1),) * 120))),
    (Reason.FIELD, overfull(Samples(bytes(480)))),
    (Reason.FIELD, patched(Kind.SEQUENCE, COUNT, b"\x00\x00")),
    (Reason.FIELD, patched(Kind.SEQUENCE, COUNT, b"\x01\x04")),  # 1025
    (Reason.FIELD, patched(Kind.SEQUENCE, FIRST, b"\xff\x03")),  # 1023 + 2 entries
    (Reason.FIELD, patched(Kind.SEQUENCE, FIRST, b"\xff\xff")),
    (Reason.FIELD, patched(Kind.SAMPLES, COUNT, b"\x00")),
    (Reason.FIELD, patched(Kind.SAMPLES, COUNT, b"\xe1\x01")),  # 481
    (Reason.FIELD, patched(Kind.SAMPLES, FIRST, b"\x39\x0f")),  # 3897 + 200 samples
    (Reason.FIELD, patched(Kind.MODULATION, COUNT, b"\x00\x00")),
    (Reason.FIELD, patched(Kind.MODULATION, COUNT, b"\x01\x10")),  # 4097
    (Reason.FIELD, patched(Kind.MODULATION, FIRST, b"\x39\x0f")),
    (Reason.FIELD, patched(Kind.MODULATION, HOLD, b"\x00\x00")),
    (Reason.PULSE, patched(Kind.UPDATE, PAYLOAD, b"\x64")),
    (Reason.PULSE, patched(Kind.UPDATE, PAYLOAD, b"\x7f")),
    (Reason.PULSE, patched(Kind.UPDATE, 509, b"\x00\x40\x06")),
    (Reason.PULSE, patched(Kind.SLOT, PAYLOAD + 1, b"\x0d")),
    (Reason.PULSE, patched(Kind.UPDATE, 511, b"\xd0")),
]


@pytest.mark.parametrize(("reason", "block"), MALFORMED)
def test_malformed_blocks_are_refused_with_their_reason_by_both(reason: Reason, block: bytes) -> None:
    assert (reason_of(block), reason_by_construct(block)) == (reason, reason)


@given(blocks(), st.integers(0, 511), st.binary(min_size=1, max_size=24))
def test_any_change_reads_back_to_the_same_bytes_or_is_refused_for_the_same_reason(
    block: Block, at: int, junk: bytes
) -> None:
    data = bytearray(pack(block))
    data[at : at + len(junk)] = junk
    data = bytearray(resealed(data[:512]))
    reason = reason_of(bytes(data))
    assert reason is reason_by_construct(bytes(data))
    if reason is Reason.ACCEPTED:
        assert pack(unpack(bytes(data))) == data


@given(st.binary(max_size=600))
def test_any_bytes_are_refused_for_the_same_reason(data: bytes) -> None:
    assert reason_of(data) is reason_by_construct(data) is not Reason.ACCEPTED


@given(st.binary(min_size=32, max_size=32), st.binary(min_size=480, max_size=480))
def test_any_bytes_under_a_right_checksum_are_judged_alike(head: bytes, payload: bytes) -> None:
    for prefix in (head[:2], b"PW", b"PW\x01", b"PW\x01" + bytes([1 + head[3] % 7])):
        data = resealed(prefix + head[len(prefix) :] + payload)
        assert reason_of(data) is reason_by_construct(data)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Update(Pulses.silent(319)), "a block carries 320 pulses, not 319"),
        (lambda: Update(SILENT, 2**64), "period 18446744073709551616 is outside"),
        (lambda: Update(SILENT, -1), "period -1"),
        (lambda: Slot(256, SILENT), "slot 256 is outside 0 to 255"),
        (lambda: Slot(0, Pulses.silent(1)), "320 pulses, not 1"),
        (lambda: Entries((Entry(256, 1),)), "slot 256"),
        (lambda: Entries((Entry(0, 0),)), "number of periods 0 is outside 1 to 65535"),
        (lambda: Entries((Entry(0, 2**16),)), "number of periods 65536"),
        (lambda: Entries((Entry(0, 1),) * 121), "number of entries 121 is outside 1 to 120"),
        (lambda: Entries(()), "number of entries 0 is outside 1 to 120"),
        (lambda: Entries((Entry(0, 1),) * 2, 1023), "first entry 1023 is outside 0 to 1022"),
        (lambda: Sequence(0, 0), "number of entries 0 is outside 1 to 1024"),
        (lambda: Sequence(1000, 25), "first entry 1000 is outside 0 to 999"),
        (lambda: Sequence(0, 1, repeats=2**16), "number of repeats 65536"),
        (lambda: Samples(np.array([0, 256])), "sample 256 is outside 0 to 255"),  # type: ignore[arg-type]  # no bytes
        (lambda: Samples(bytes(481)), "number of samples 481 is outside 1 to 480"),
        (lambda: Samples(bytes(2), 4095), "first sample 4095 is outside 0 to 4094"),
        (lambda: Modulation(0, 4097, 1), "number of samples 4097 is outside 1 to 4096"),
        (lambda: Modulation(0, 1, 0), "a sample holds 0 is outside 1 to 65535"),
        (lambda: Output(4), "4 is not a valid Action"),  # type: ignore[arg-type]  # the wrong value is the point
        (lambda: pack(Block(Clock(), 2**32)), "sequence number 4294967296 is outside"),
        (lambda: pack(Block(Clock(), -1)), "sequence number -1"),
    ],
)
def test_what_cannot_travel_is_named(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "of", [list, bytearray, memoryview, lambda samples: np.frombuffer(samples, np.uint8).astype(">i8")]
)
def test_samples_are_taken_by_their_values(of: Callable[[bytes], Any]) -> None:
    assert Samples(of(b"\0\1\xff")) == Samples(b"\0\1\xff")


@pytest.mark.parametrize("wrong", [3, "loud", np.array([0.5]), None])
def test_samples_are_numbers(wrong: Any) -> None:
    with pytest.raises(TypeError):
        Samples(wrong)


def test_half_a_pair_of_pulses_is_refused() -> None:
    with pytest.raises(ValueError, match="3 pulses are no pairs"):
        pack_pulses(Pulses.silent(3))


def test_only_pulses_are_pulses() -> None:
    for make in (lambda: Update([1] * 320), lambda: Slot(0, bytes(320))):  # type: ignore[arg-type]  # the point
        with pytest.raises(TypeError, match="a block carries Pulses, not"):
            make()


@pytest.mark.parametrize("wrong", [1.5, "soon", None])
def test_numbers_are_whole(wrong: Any) -> None:
    for make in (lambda: Update(SILENT, wrong), lambda: Slot(wrong, SILENT), lambda: pack(Block(Clock(), wrong))):
        with pytest.raises(TypeError):
            make()
