"""The chain's messages against the specification's tables and examples, its construct layouts, and damage."""

from __future__ import annotations

import struct
import zlib
from dataclasses import astuple
from typing import Any

import pytest
from construct import Construct, ConstructError
from hypothesis import given
from hypothesis import strategies as st
from phasewire.errors import ChainError
from phasewire.protocol import codes as limits
from phasewire.protocol.chain import (
    Collect,
    Commit,
    Identity,
    Load,
    Message,
    Number,
    Playing,
    Program,
    Report,
    Slice,
    decode,
    loads,
)
from phasewire.protocol.codes import ChannelEnd, Memory
from phasewire.protocol.layout import chain as layouts

from tests.specification import codes, fields, hex_examples, layout_rows

LAYOUTS: dict[ChannelEnd, Construct] = {end: getattr(layouts, end.name) for end in ChannelEnd}
UNGUARDED = (ChannelEnd.SLICE, ChannelEnd.COMMIT)

# Bits 0, 2, 4 … high from tick 0 for 25 ticks: phase 25, width 25 is 0xC99; the odd ones are silent.
STRIPES = bytes.fromhex("990c00") * 16

EXAMPLES: dict[str, Message] = {
    "SLICE": Slice(3, STRIPES),
    "COMMIT": Commit.of(1000, Slice(3, STRIPES)),
    "LOAD": Load(3, Memory.ENTRIES, 12, struct.pack("<4H", 0, 100, 1, 100)),
    "PROGRAM": Program(3, Memory.ENTRIES, 1000, 0, 2),
    "COLLECT": Collect(3, ChannelEnd.REPORT),
    "NUMBER": Number(3),
    "REPORT": Report(3, 31, 0, (1, 0, 0), -1, 250_000, 2, 1),
    "PLAYING": Playing(3, 1000, STRIPES),
    "IDENTITY": Identity(3, False, (1, 0, 0), 0x0123456789ABCDEF),
}

processors = st.integers(0, 9)
packed = st.binary(min_size=48, max_size=48)
u16, u32, u64 = (st.integers(0, 2**bits - 1) for bits in (16, 32, 64))
signed = st.integers(-128, 127)
versions = st.tuples(*[st.integers(0, 255)] * 3)


@st.composite
def any_loads(draw: st.DrawFn) -> Load:
    memory = draw(st.sampled_from(Memory))
    items, size = {Memory.SLOTS: (256, 48), Memory.ENTRIES: (1024, 4), Memory.SAMPLES: (4096, 1)}[memory]
    count = draw(st.integers(1, 48 // size))
    data = draw(st.binary(min_size=count * size, max_size=count * size))
    return Load(draw(processors), memory, draw(st.integers(0, items - count)), data)


@st.composite
def started(draw: st.DrawFn) -> Program:
    memory = draw(st.sampled_from([Memory.ENTRIES, Memory.SAMPLES]))
    room = {Memory.ENTRIES: 1024, Memory.SAMPLES: 4096}[memory]
    count = draw(st.integers(1, room) | st.just(room))
    first = draw(st.integers(0, room - count) | st.just(room - count))
    hold, repeats = (0, draw(u16)) if memory is Memory.ENTRIES else (draw(st.integers(1, 2**16 - 1)), 0)
    return Program(draw(processors), memory, draw(u64), first, count, hold, repeats)


programs = st.one_of(
    started(),
    st.builds(Program, processors, st.sampled_from([Memory.ENTRIES, Memory.SAMPLES]), u64, st.just(0), st.just(0)),
)

messages: st.SearchStrategy[Message] = st.one_of(
    st.builds(Slice, processors, packed),
    st.builds(Commit, processors, u64, u32),
    any_loads(),
    programs,
    st.builds(Collect, processors, st.sampled_from([ChannelEnd.REPORT, ChannelEnd.PLAYING])),
    st.builds(Number, processors),
    st.builds(Report, processors, signed, u16, versions, signed, u32, u32, u32),
    st.builds(Playing, processors, u64, packed),
    st.builds(Identity, processors, st.booleans(), versions, u64),
)


def flipped(tokens: bytes, bit: int) -> bytes:
    changed = bytearray(tokens)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def taken(tokens: bytes) -> bool:
    """Whether the decoder takes these tokens; if so, they must come out again."""
    try:
        message = decode(tokens)
    except ChainError:
        return False
    assert message.encode() == tokens
    return True


def parses(tokens: bytes) -> bool:
    """Whether the normative layout takes these tokens."""
    try:
        LAYOUTS[ChannelEnd(tokens[2])].parse(tokens)
    except ConstructError:
        return False
    return True


@pytest.mark.parametrize("enumeration", [ChannelEnd, Memory])
def test_the_tables_of_the_specification_are_these_codes(enumeration: type[ChannelEnd] | type[Memory]) -> None:
    assert codes(enumeration.__name__) == {code.name: code.value for code in enumeration}


def test_the_limits_of_the_specification_are_these() -> None:
    table = codes("limits of the chain")
    assert len(table) == 14
    assert {name: getattr(limits, name) for name in table} == table


@pytest.mark.parametrize("end", ChannelEnd)
def test_the_layouts_of_the_specification_are_construct_s(end: ChannelEnd) -> None:
    assert layout_rows(end.name) == fields(LAYOUTS[end])


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_of_the_specification_are_these_messages(name: str) -> None:
    tokens = hex_examples()[name]
    assert decode(tokens) == EXAMPLES[name]
    assert EXAMPLES[name].encode() == tokens
    assert len(tokens) == EXAMPLES[name].TOKENS
    assert parses(tokens)


@given(messages)
def test_messages_come_back(message: Message) -> None:
    tokens = message.encode()
    assert decode(tokens) == message
    assert parses(tokens)
    assert tokens[2] == message.CHANNEL_END
    assert int.from_bytes(tokens[:2], "big") == message.node


@given(any_loads())
def test_construct_reads_the_same_fields_of_a_load(load: Load) -> None:
    fields: Any = layouts.LOAD.parse(load.encode()).checked.value
    assert (fields.node, fields.memory, fields.first) == (load.processor, load.memory, load.first)
    assert fields.data[: len(load.data)] == load.data
    assert fields["count"] * {1: 48, 2: 4, 3: 1}[fields.memory] == len(load.data)


@given(programs)
def test_construct_reads_the_same_fields_of_a_program(program: Program) -> None:
    fields: Any = layouts.PROGRAM.parse(program.encode()).checked.value
    read = (fields.node, fields.memory, fields.period, fields.first, fields.count, fields.hold, fields.repeats)
    assert read == astuple(program)


@given(st.builds(Report, processors, signed, u16, versions, signed, u32, u32, u32))
def test_construct_reads_the_same_fields_of_a_report(report: Report) -> None:
    fields: Any = layouts.REPORT.parse(report.encode()).checked.value
    assert (fields.processor, fields.temperature_c, fields.faults) == (
        report.processor,
        report.temperature_c,
        report.faults,
    )
    assert (tuple(fields.firmware), fields.drift) == (report.firmware, report.drift)
    counts = ("carried_out", "missed_commits", "damaged_messages")
    assert [fields[name] for name in counts] == [getattr(report, name) for name in counts]


@given(st.data())
def test_what_construct_refuses_is_refused_and_nothing_else(data: st.DataObject) -> None:
    """Any payload under a right header, checksum and END; small numbers make allowed ones likely."""
    end = data.draw(st.sampled_from(ChannelEnd))
    size = fields(LAYOUTS[end])[-1][0] - 3 - (0 if end in UNGUARDED else 4)
    node = data.draw(st.sampled_from([0, 3, 9, 10, 0x00FF, 0x0300, 0xFFFF]))
    octets = st.one_of(st.integers(0, 9), st.integers(0, 255))
    payload = bytes(data.draw(st.lists(octets, min_size=size, max_size=size)))
    if end is ChannelEnd.LOAD and data.draw(st.booleans()):
        payload = payload[:4] + bytes(48)
    tokens = struct.pack(">HB", node, end) + payload
    if end not in UNGUARDED:
        tokens += zlib.crc32(tokens).to_bytes(4, "little")
    tokens += b"\x01"
    assert taken(tokens) == parses(tokens)


def resealed(tokens: bytes, changes: dict[int, int]) -> bytes:
    """A message with some of its bytes changed and a CRC-32 that is right again."""
    changed = bytearray(tokens)
    for position, octet in changes.items():
        changed[position] = octet
    body = bytes(changed[:-5])
    return body + zlib.crc32(body).to_bytes(4, "little") + b"\x01"


@given(messages.filter(lambda message: message.GUARDED), st.data())
def test_a_value_that_construct_refuses_is_refused_and_no_other(message: Message, data: st.DataObject) -> None:
    positions = st.sampled_from(sorted({0, 1, 3, 4, 5, 6, 7, 8, 9, 10, message.TOKENS - 6} - {message.TOKENS - 5}))
    changes = data.draw(st.dictionaries(positions.filter(lambda n: n < message.TOKENS - 5), st.integers(0, 255)))
    tokens = resealed(message.encode(), changes)
    assert taken(tokens) == parses(tokens)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("LOAD", {0: 1}),  # node 259
        ("LOAD", {1: 10}),  # node 10
        ("LOAD", {3: 0}),  # no such memory
        ("LOAD", {3: 4}),
        ("LOAD", {4: 0xFF, 5: 3}),  # entries 1023 and 1024
        ("LOAD", {6: 0}),  # no entries
        ("LOAD", {6: 1}),  # one entry, and bytes behind it
        ("LOAD", {6: 13}),  # 52 bytes of entries
        ("LOAD", {54: 1}),  # a byte behind the entries
        ("PROGRAM", {3: 1}),  # slots cannot be started
        ("PROGRAM", {6: 1, 7: 4}),  # 1025 entries
        ("PROGRAM", {4: 0xFF, 5: 3}),  # entries 1023 and 1024
        ("PROGRAM", {4: 1, 6: 0}),  # a stop with a first entry
        ("PROGRAM", {8: 1}),  # a sequence with a hold
        ("PROGRAM", {3: 3}),  # a modulation without
        ("PROGRAM", {3: 3, 8: 1, 10: 1}),  # a modulation that is repeated
        ("PROGRAM", {6: 0, 10: 1}),  # a stop that is repeated
        ("PROGRAM", {3: 3, 6: 0, 8: 1}),  # a stop with a hold
        ("COLLECT", {3: 6}),
        ("COLLECT", {3: 9}),
        ("NUMBER", {0: 0, 1: 3}),  # not to node FFFF
        ("NUMBER", {3: 10}),
        ("REPORT", {1: 3}),  # not to the controller
        ("REPORT", {3: 10}),
        ("PLAYING", {0: 0xFF}),
        ("PLAYING", {3: 10}),
        ("IDENTITY", {3: 10}),
        ("IDENTITY", {4: 2}),  # neither the last nor not
    ],
)
def test_what_no_message_may_say_is_refused(name: str, changes: dict[int, int]) -> None:
    tokens = resealed(EXAMPLES[name].encode(), changes)
    assert not taken(tokens)
    assert not parses(tokens)


@given(st.binary(max_size=80))
def test_any_tokens_are_a_message_or_refused(tokens: bytes) -> None:
    taken(tokens)
    taken(tokens + b"\x01")


@pytest.mark.parametrize("name", sorted(set(EXAMPLES) - {"SLICE", "COMMIT"}))
def test_a_single_wrong_bit_is_refused(name: str) -> None:
    tokens = EXAMPLES[name].encode()
    assert not any(taken(flipped(tokens, bit)) for bit in range(8 * len(tokens)))


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_message_that_is_cut_or_too_long_is_refused(name: str) -> None:
    tokens = EXAMPLES[name].encode()
    assert not any(taken(tokens[:length]) for length in range(len(tokens)))
    assert not any(taken(tokens[:length] + b"\x01") for length in range(len(tokens) - 1))
    assert not taken(tokens + b"\x01")


def test_a_commit_guards_its_slice_and_its_period() -> None:
    piece = Slice(3, STRIPES)
    commit = Commit.of(1000, piece)
    assert commit.guards(piece.packed)
    assert not any(commit.guards(flipped(piece.packed, bit)) for bit in range(8 * 48))
    for bit in range(3 * 8, 15 * 8):  # period and checksum
        damaged = decode(flipped(commit.encode(), bit))
        assert isinstance(damaged, Commit)
        assert not damaged.guards(piece.packed)


def test_a_commit_s_checksum_is_of_slice_and_period() -> None:
    expected = zlib.crc32(STRIPES + b"\xe8\x03" + bytes(6))
    assert Commit.of(1000, Slice(0, STRIPES)).checksum == expected


@pytest.mark.parametrize(
    ("memory", "size", "first", "parts"),
    [
        (Memory.SLOTS, 48, 255, [(255, 48)]),
        (Memory.ENTRIES, 120 * 4, 904, [(904 + 12 * n, 48) for n in range(10)]),
        (Memory.ENTRIES, 13 * 4, 0, [(0, 48), (12, 4)]),
        (Memory.SAMPLES, 480, 3616, [(3616 + 48 * n, 48) for n in range(10)]),
        (Memory.SAMPLES, 0, 0, []),
    ],
)
def test_items_go_in_loads_of_48_bytes(memory: Memory, size: int, first: int, parts: list[tuple[int, int]]) -> None:
    data = bytes(n % 251 for n in range(size))
    made = loads(7, memory, first, data)
    assert [(load.first, len(load.data)) for load in made] == parts
    assert b"".join(load.data for load in made) == data
    assert {load.processor for load in made} <= {7}


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Slice(10, bytes(48)), "processor 10 is outside 0 to 9"),
        (lambda: Slice(0, bytes(47)), "take 48 bytes, not 47"),
        (lambda: Commit.of(2**64, Slice(0, bytes(48))), "period 18446744073709551616 is outside"),
        (lambda: Commit(0, 0, -1), "checksum -1 is outside"),
        (lambda: Load(0, 4, 0, bytes(4)), "4 is no memory of a processor; SLOTS, ENT"),  # type: ignore[arg-type]  # meant
        (lambda: Load(0, Memory.SLOTS, 256, bytes(48)), "first 256 is outside 0 to 255"),
        (lambda: Load(0, Memory.ENTRIES, 1023, bytes(8)), "first 1023 is outside 0 to 1022"),
        (lambda: Load(0, Memory.ENTRIES, 0, bytes(6)), "6 bytes are not 1 to 12 items of 4 bytes"),
        (lambda: Load(0, Memory.SAMPLES, 0, b""), "0 bytes are not 1 to 48 items"),
        (lambda: Load(0, Memory.SAMPLES, 0, bytes(49)), "49 bytes are not 1 to 48 items"),
        (lambda: Program(0, Memory.SLOTS, 0, 0, 1), "cannot be started"),
        (lambda: Program(0, Memory.ENTRIES, 0, 0, 1025), "count 1025 is outside 0 to 1024"),
        (lambda: Program(0, Memory.ENTRIES, 0, 0, 1, hold=1), "hold 1 is outside 0 to 0"),
        (lambda: Program(0, Memory.SAMPLES, 0, 4095, 1), "hold 0 is outside 1 to 65535"),
        (lambda: Program(0, Memory.SAMPLES, 0, 0, 1, hold=1, repeats=1), "repeats 1 is outside 0 to 0"),
        (lambda: Program(0, Memory.ENTRIES, 0, 1024, 1), "first 1024 is outside 0 to 1023"),
        (lambda: Program(0, Memory.ENTRIES, 0, 1, 0), "first 1 is outside 0 to 0"),
        (lambda: Program(0, Memory.ENTRIES, 0, 0, 0, repeats=1), "repeats 1 is outside 0 to 0"),
        (lambda: Collect(0, ChannelEnd.SLICE), "cannot be asked for"),
        (lambda: Number(10), "processor 10"),
        (lambda: Report(0, 128, 0, (0, 0, 0), 0, 0, 0, 0), "temperature_c 128 is outside -128 to 127"),
        (lambda: Report(0, 0, 0, (0, 0, 256), 0, 0, 0, 0), "three numbers of 0 to 255"),
        (lambda: Playing(0, -1, bytes(48)), "period -1"),
        (lambda: Identity(0, True, (0, 0, 0), 2**64), "unique_id"),
        (lambda: Identity(0, 2, (0, 0, 0), 0), "last 2 is outside 0 to 1"),  # type: ignore[arg-type]  # meant
    ],
)
def test_values_that_cannot_travel_are_named(make: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        make()


@pytest.mark.parametrize(
    ("tokens", "complaint"),
    [
        (b"", "0 tokens are no message"),
        (b"\x00\x00\x01\x02", "END last"),
        (b"\x00\x00\x0a\x01", "nothing is received at channel end 10"),
        (b"\x00\x00\x01\x01", "SLICE has 52 tokens, not 4"),
        (b"\x00\x0a\x02" + bytes(12) + b"\x01", "processor 10"),
        (b"\x00\x00\x05\x07\x00\x00\x00\x00\x01", "CRC-32 of COLLECT"),
    ],
)
def test_a_refusal_says_what_is_wrong(tokens: bytes, complaint: str) -> None:
    with pytest.raises(ChainError, match=complaint):
        decode(tokens)


# Clause CHN-025, literally: the link that a switch takes for a node, or None where it is its own.
def direction(own: int, node: int) -> str | None:
    if own == node:
        return None
    bit = (own ^ node).bit_length() - 1
    if own == 0x00FF:
        return "down"
    if own == 0xFFFF:
        return "up"
    if bit >= 8:
        return "down"
    if bit >= 4:
        return "up"
    return "up" if own >> bit & 1 else "down"


@pytest.mark.parametrize("numbered", range(11))
def test_the_switches_bring_every_message_where_it_belongs(numbered: int) -> None:
    """Place 0 is the controller; behind the numbered processors come those without a number."""
    chain = [0x00FF, *range(numbered), *[0xFFFF] * (10 - numbered)]
    begun = [(0, node) for node in [*range(numbered), *([0xFFFF] if numbered < 10 else [])]]
    begun += [(place, 0x00FF) for place in range(1, 11)]
    for begin, node in begun:
        place, steps = begin, 0
        while (way := direction(chain[place], node)) is not None:
            place += 1 if way == "down" else -1
            steps += 1
            assert steps <= 10
        assert place == chain.index(node)


def test_the_port_counter_s_advance_between_two_pulses_is_what_the_specification_says() -> None:
    assert limits.SYNC_PERIODS * 50 == 204_800
    assert 204_800 % 2**16 == 8192
