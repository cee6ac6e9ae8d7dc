"""The protocol against an oracle that was written from the specification alone (`tests.from_spec`).

The normative layouts, which construct reads, judge the same bytes.
"""

import hashlib
from typing import Any

import numpy as np
import pytest
from cobs import cobs
from construct import Construct, ConstructError
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import example, given, settings
from hypothesis import strategies as st
from phasewire.base.errors import BlockError, ChainError, CommandError, FrameError, ImageError, ReplyError
from phasewire.protocol import (
    Action,
    AmplitudeModulation,
    Block,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Pulses,
    Samples,
    Slot,
    State,
    Update,
    chain,
    console,
    dfu,
    firmware,
    framing,
    numbering,
    pack,
    replies,
    states,
    unpack,
    unpack_updates,
)
from phasewire.protocol.codes import Bank, ChannelEnd, ConsoleCode, DfuState, DfuStatus, ImageReason
from phasewire.protocol.layout import chain as chain_layouts
from phasewire.protocol.layout.firmware import IMAGE
from phasewire.protocol.layout.serial import FRAME, SERIAL_REPLY, SERIAL_REQUEST

from tests import from_spec as spec
from tests.protocol.blocks import by_construct, reason_by_construct

EDGES = (0, 1, 2, 12, 13, 48, 49, 99, 100, 120, 121, 255, 256, 480, 481, 904, 1023, 1024, 1025, 4095, 4096)

words = st.one_of(st.sampled_from(EDGES), st.integers(0, 0xFFFF))
periods = st.one_of(st.sampled_from((0, 1, 2**32, 2**63, 2**64 - 1)), st.integers(0, 2**64 - 1))
numbers = st.one_of(st.sampled_from((0, 1, 2**31 - 1, 2**31, 2**31 + 1, 2**32 - 1)), st.integers(0, 2**32 - 1))
pulse = st.tuples(st.integers(0, 99), st.integers(0, 25))
steps = st.tuples(st.integers(0, 255), st.integers(1, 65535))


@st.composite
def pulse_lists(draw: st.DrawFn, size: int) -> list[spec.Pulse]:
    """Some pulses, then silence with one phase: few decisions, so that examples shrink."""
    some = draw(st.lists(pulse, max_size=8))
    return (some + [draw(pulse)] * size)[:size]


@st.composite
def blocks(draw: st.DrawFn) -> spec.Fields:
    """A valid block of each kind."""
    kind = draw(st.integers(1, 9))
    most = {spec.ENTRIES: 120, spec.SEQUENCE: 1024, spec.SAMPLES: 480, spec.MODULATION: 4096}.get(kind, 0)
    count = draw(st.one_of(st.just(most), st.integers(1, most))) if most else 0
    block: spec.Fields = {"kind": kind, "sequence": draw(numbers), "count": count}
    for name, (least, greatest) in spec.used_fields(kind, count).items():
        if name != "count":
            ends = st.sampled_from((least, greatest))
            block[name] = draw(st.one_of(ends, st.integers(least, greatest)))
    block["flags"] = draw(st.sampled_from((0, 1, 2, 3) if kind == spec.SEQUENCE else (0, 1)))
    if kind in (spec.UPDATE, spec.SLOT):
        block["pulses"] = draw(pulse_lists(320))
    elif kind == spec.ENTRIES:
        block["entries"] = (draw(st.lists(steps, min_size=1, max_size=4)) * 120)[:count]
    elif kind == spec.SAMPLES:
        block["samples"] = (draw(st.binary(min_size=1, max_size=8)) * 480)[:count]
    return block


@st.composite
def edited(draw: st.DrawFn, data: bytes, header: int) -> bytes:
    """The same number of bytes, one to three of them changed, more often in the header than after it."""
    changed = bytearray(data)
    places = st.one_of(st.integers(0, min(header, len(data)) - 1), st.integers(0, len(data) - 1))
    values = st.one_of(st.sampled_from((0, 1, 2, 3, 4, 9, 10, 255)), st.integers(0, 255))
    for _ in range(draw(st.integers(1, 3))):
        changed[draw(places)] = draw(values)
    return bytes(changed)


@st.composite
def wild_blocks(draw: st.DrawFn) -> bytes:
    """A block with fields of any value, edited or not, sealed or not, or of another length."""
    data = spec.build_block(draw(blocks()))
    how = draw(st.sampled_from(("whole", "fields", "bytes", "raw", "cut")))
    if how == "fields":
        names = st.sampled_from([name for name in spec.BLOCK if name[0] not in ("magic", "payload", "checksum")])
        changed = bytearray(data)
        for name, offset, size, _ in draw(st.lists(names, min_size=1, max_size=3)):
            value = draw(periods if name == "period" else numbers if size == 4 else words) % 256**size
            changed[offset : offset + size] = value.to_bytes(size, "little")
        data = bytes(changed)
    elif how in ("bytes", "raw"):
        data = draw(edited(data, 32))
    elif how == "cut":
        return data[: draw(st.integers(0, 511))] + draw(st.binary(max_size=2)) * draw(st.integers(0, 1))
    return data if how == "raw" else spec.seal_block(data)


def as_pulses(pairs: list[spec.Pulse]) -> Pulses:
    return Pulses([phase for phase, _ in pairs], [width for _, width in pairs])


def as_pairs(pulses: Pulses) -> list[spec.Pulse]:
    return list(zip(pulses.phase.tolist(), pulses.width.tolist(), strict=True))


def as_body(block: spec.Fields) -> Any:
    """The body with the fields of a block."""
    first, count, period = block.get("first", 0), block.get("count", 0), block.get("period", 0)
    match block["kind"]:
        case spec.UPDATE:
            return Update(as_pulses(block["pulses"]), period)
        case spec.SLOT:
            return Slot(first, as_pulses(block["pulses"]))
        case spec.ENTRIES:
            return Entries(tuple(Entry(*step) for step in block["entries"]), first)
        case spec.SEQUENCE:
            unattended = bool(block["flags"] & spec.UNATTENDED)
            return PlaySequence(first, count, period, repeats=block["repeats"], unattended=unattended)
        case spec.SAMPLES:
            return Samples(block["samples"], first)
        case spec.MODULATION:
            return AmplitudeModulation(first, count, block["hold"], period)
        case spec.OUTPUT:
            return Output(Action(block["action"]), period)
        case spec.CLOCK:
            return Clock()
        case _:
            return NoOp()


def same_body(left: Any, right: Any) -> bool:
    if isinstance(left, (Update, Slot)):
        rest = left.period == right.period if isinstance(left, Update) else left.number == right.number
        return type(left) is type(right) and rest and as_pairs(left.pulses) == as_pairs(right.pulses)
    return bool(left == right)


def unpack_reason(data: bytes) -> int:
    """The reason for which `unpack` refuses bytes; the normative layout must refuse them too."""
    reason = 0
    try:
        unpack(data)
    except BlockError as error:
        reason = int(error.reason)
    assert reason == reason_by_construct(data)
    return reason


def as_specified(read: Any, decode: Any, error: type[Exception], data: bytes) -> Any:
    """What the oracle reads; None if it refuses the bytes, which the code must refuse too."""
    try:
        return read(data)
    except spec.Refused:
        with pytest.raises(error):
            decode(data)
        return None


def parses(layout: Construct, data: bytes) -> bool:
    """Whether a normative layout takes these bytes."""
    try:
        layout.parse(data)
    except ConstructError:
        return False
    return True


# Chapter PUL


@given(pulse_lists(320), st.integers(0, 255))
def test_pulses(pairs: list[spec.Pulse], sample: int) -> None:
    pulses = as_pulses(pairs)
    assert pulses.start.tolist() == [spec.start_tick(pair) for pair in pairs]
    assert pulses.total_drive == spec.total_drive(pairs)
    modulated = [(phase, spec.modulated_width(width, sample)) for phase, width in pairs]
    assert as_pairs(pulses.modulated(sample)) == modulated


@given(st.integers(-2, 130), st.integers(-2, 40))
def test_reserved_pulses(phase: int, width: int) -> None:
    if spec.pulse_allowed((phase, width)):
        Pulses([phase], [width])
    else:
        with pytest.raises(ValueError, match=r"."):
            Pulses([phase], [width])


# Chapter BLK, NUM


@given(blocks())
@settings(max_examples=100)
def test_packed_block(block: spec.Fields) -> None:
    restart = bool(block["flags"] & spec.RESTART)
    made = Block(as_body(block), block["sequence"], restart)
    data = pack(made)
    assert data == spec.build_block(block) == by_construct(made)
    read = unpack(data)
    assert same_body(read.body, as_body(spec.read_block(data)))
    assert (read.sequence, read.restart) == (block["sequence"], restart)


@given(wild_blocks())
@settings(max_examples=400)
def test_judged_block(data: bytes) -> None:
    reason = spec.judge_block(data)
    assert unpack_reason(data) == reason
    if reason == spec.ACCEPTED:
        assert same_body(unpack(data).body, as_body(spec.read_block(data)))


@given(st.binary(max_size=600))
def test_random_block(data: bytes) -> None:
    assert unpack_reason(data) == spec.judge_block(data)


@given(st.lists(wild_blocks().filter(lambda data: len(data) == 512), min_size=1, max_size=4))
@settings(max_examples=100)
def test_judged_updates(several: list[bytes]) -> None:
    array = np.frombuffer(b"".join(several), np.uint8).reshape(-1, 512)
    expected = []
    for data in several:
        reason = spec.judge_block(data)
        other_kind = reason in (spec.ACCEPTED, spec.FIELD, spec.PULSE) and data[3] != spec.UPDATE
        expected.append(spec.KIND if other_kind else reason)
    assert unpack_updates(array).reason.tolist() == expected


@given(numbers, numbers)
@example(5, 5)
@settings(max_examples=200)
def test_numbers(number: int, last: int) -> None:
    assert numbering.follows(number, last) == spec.follows(number, last)
    if spec.follows(number, last):
        assert numbering.missing(number, last) == spec.missing(number, last)


# Chapter ACK, REQ


def size_of(layout: spec.Layout) -> int:
    return max(offset + size for _, offset, size, _ in layout)


record_fields = {1: st.integers(0, 255), 2: words, 4: numbers, 8: periods}


@st.composite
def records(draw: st.DrawFn, layout: spec.Layout, build: Any) -> bytes:
    """A sealed record with fields of any value; values that a table does not list are rare."""
    fields = {}
    wrong = draw(st.sampled_from((None, None, None, *[field[0] for field in layout])))
    for name, _, size, kind in layout:
        if name in ("magic", "checksum"):
            continue
        if name == "version":
            fields[name] = draw(st.sampled_from((0, 2, 255))) if wrong == name else 1
        elif name == "reserved":
            fields[name] = draw(st.integers(1, 255)) if wrong == name else 0
        elif kind == "s":
            fields[name] = draw(st.integers(-128, 127))
        elif name in ("reason", "last_refusal", "state", "flags", "faults"):
            limits = {"reason": 16, "last_refusal": 16, "state": 6, "faults": 127}
            limits["flags"] = 7 if size_of(layout) == 64 else 3
            greatest = limits[name]
            fields[name] = greatest + 1 if wrong == name else draw(st.integers(0, greatest))
        else:
            fields[name] = draw(record_fields[size])
    data: bytes = build(fields)
    return draw(edited(data, len(data))) if draw(st.integers(0, 9)) == 9 else data


def agree(data: bytes, read: Any, decode: Any) -> None:
    """Both refuse, or both read the same values under the same names."""
    fields = as_specified(read, decode, ReplyError, data)
    if fields is None:
        return
    record = decode(data)
    for name, value in fields.items():
        if hasattr(record, name):
            expected = tuple(value) if name == "firmware" else value
            assert getattr(record, name) == expected
    assert record.encode() == data


@given(records(spec.ACK, spec.build_ack))
@settings(max_examples=200)
def test_acknowledgement(data: bytes) -> None:
    agree(data, spec.read_ack, replies.Ack.decode)


@given(records(spec.STATUS, spec.build_status))
@settings(max_examples=200)
def test_status(data: bytes) -> None:
    agree(data, spec.read_status, replies.Status.decode)


some_records = st.one_of(records(spec.ACK, spec.build_ack), records(spec.STATUS, spec.build_status))


@given(st.lists(some_records, max_size=4), st.sampled_from((0, 0, 0, 1, 32)))
@settings(max_examples=100)
def test_records(several: list[bytes], cut: int) -> None:
    packets = b"".join(several)[cut:]
    expected = as_specified(spec.read_records, replies.records, ReplyError, packets)
    if expected is not None:
        kinds = [replies.Ack if one["magic"] == b"PA" else replies.Status for one in expected]
        found = replies.records(packets)
        assert [type(one) for one in found] == kinds
        assert b"".join(one.encode() for one in found) == packets


@given(st.binary(min_size=64, max_size=64), st.sampled_from((2, 5, 5, 2, 3, 0)))
def test_info(data: bytes, wires: int) -> None:
    agree(data[:31] + bytes([wires]) + data[32:], spec.read_info, replies.Info.decode)


@given(st.binary(min_size=20, max_size=20), st.sampled_from((bytes(4), bytes(3), b"\x00\x00\x00\x01")))
def test_clock(data: bytes, reserved: bytes) -> None:
    agree(data + reserved, spec.read_clock, replies.ClockReading.decode)


@given(periods, periods, pulse_lists(320), st.data())
def test_read_back(since: int, read: int, pairs: list[spec.Pulse], data: st.DataObject) -> None:
    answer = since.to_bytes(8, "little") + read.to_bytes(8, "little") + spec.pack_pulses(pairs)
    answer = data.draw(st.one_of(st.just(answer), edited(answer, 496)))
    expected = as_specified(spec.read_back, replies.ReadBack.decode, ReplyError, answer)
    if expected is not None:
        back = replies.ReadBack.decode(answer)
        assert (back.since_period, back.read_period) == (expected["since_period"], expected["read_period"])
        assert as_pairs(back.pulses) == expected["pulses"]
        assert back.encode() == answer


@given(st.binary(min_size=16, max_size=16), st.integers(0, 9), st.integers(0, 4), st.sampled_from((0, 0, 0, 1)))
def test_reports(report: bytes, place: int, bank: int, reserved: int) -> None:
    report = bytes([report[0] % 128, report[1] % 2 * (bank == 3), report[2], bank]) + report[4:15] + bytes([reserved])
    good = bytes(3) + b"\x01" + bytes(12)
    answer = good * place + report + good * (9 - place)
    expected = as_specified(spec.read_processors, replies.decode_reports, ReplyError, answer)
    if expected is not None:
        for one, fields in zip(replies.decode_reports(answer), expected, strict=True):
            for name in ("faults", "temperature_c", "bank", "missed_commits", "damaged_messages"):
                assert (getattr(one, name) or 0) == fields[name]
            assert one.firmware == tuple(fields["firmware"])


@given(st.sampled_from((32, 64, 24, 496, 160)), st.integers(-1, 1), st.binary(max_size=40))
def test_random_replies(size: int, more: int, start: bytes) -> None:
    data = start.ljust(size + more, b"\x00")[: size + more]
    pairs: list[tuple[Any, Any]] = [
        (spec.read_ack, replies.Ack.decode),
        (spec.read_status, replies.Status.decode),
        (spec.read_info, replies.Info.decode),
        (spec.read_processors, replies.decode_reports),
    ]
    for read, decode in pairs:
        as_specified(read, decode, ReplyError, data)


# Chapter STA


@pytest.mark.parametrize("state", spec.STATES)
def test_states(state: str) -> None:
    assert [one.name for one in State] == list(spec.STATES)
    assert [one.name for one in states.StateEvent] == list(spec.EVENTS)
    for event in spec.EVENTS:
        assert states.after(State[state], states.StateEvent[event]).name == spec.after(state, event)


# Chapter CHN


@st.composite
def messages(draw: st.DrawFn) -> spec.Fields:
    """A message of any kind, with values allowed or not."""
    name = draw(st.sampled_from(sorted(spec.MESSAGES)))
    node = draw(st.sampled_from((0, 3, 9, 10, 0xFF, 0x100, 0xFFFF)))
    if draw(st.booleans()):
        node = {"REPORT": 0xFF, "PLAYING": 0xFF, "IDENTITY": 0xFF, "NUMBER": 0xFFFF}.get(name, draw(st.integers(0, 9)))
    message: spec.Fields = {"message": name, "node": node}
    for field, _, size, kind in spec.MESSAGES[name][2]:
        if kind == "b":
            message[field] = draw(st.binary(max_size=size)).ljust(size, b"\x00")
        elif kind == "s":
            message[field] = draw(st.one_of(st.sampled_from((-128, -127, 127)), st.integers(-128, 127)))
        else:
            message[field] = draw(record_fields[size])
    if "pulses" in message and draw(st.integers(0, 3)):
        message["pulses"] = spec.pack_pulses(draw(pulse_lists(32)))
    small = {"memory": 4, "answer": 9, "number": 10, "processor": 10, "last": 2}
    for field in small.keys() & message.keys():
        message[field] %= small[field] + 1
    return message


@st.composite
def plausible(draw: st.DrawFn) -> spec.Fields:
    """A load or a program near the ends of what is allowed."""
    node = draw(st.integers(0, 9))
    if draw(st.booleans()):
        memory = draw(st.integers(1, 3))
        items, most, size = ((256, 1, 48), (1024, 12, 4), (4096, 48, 1))[memory - 1]
        count = draw(st.integers(0, most + 1))
        item = {1: spec.pack_pulses([(99, 25)] * 32), 2: b"\xff\x00\x01\x00", 3: b"\x07"}[memory]
        data = (item * most)[: min(count * size, 48)].ljust(48, draw(st.sampled_from((b"\x00", b"\x00", b"\x01"))))
        first = draw(st.sampled_from((0, max(items - count, 0), max(items - count, 0) + 1, items)))
        return {"message": "LOAD", "node": node, "memory": memory, "first": first, "count": count, "data": data}
    memory = draw(st.integers(2, 3))
    count = draw(st.sampled_from((0, 0, 1, 1024, 1025, 4096, 4097)))
    first = draw(st.sampled_from((0, 0, 1, 1023, 1024, 4095, 4096)))
    hold, repeats = draw(st.sampled_from((0, 1, 65535))), draw(st.sampled_from((0, 0, 1)))
    fields = {
        "memory": memory,
        "first": first,
        "count": count,
        "hold": hold,
        "repeats": repeats,
        "period": draw(periods),
    }
    return {"message": "PROGRAM", "node": node, **fields}


def raw_message(message: spec.Fields) -> bytes:
    """The sealed tokens of a message, whether its values are allowed or not."""
    end, size, layout = spec.MESSAGES[message["message"]]
    tokens = spec.put(size, layout, message)
    tokens[:3] = message["node"].to_bytes(2, "big") + bytes([end])
    if end > 2:
        tokens[-5:-1] = spec.crc(bytes(tokens[:-5])).to_bytes(4, "little")
    tokens[-1] = spec.END_TOKEN
    return bytes(tokens)


MESSAGE_LAYOUTS = [getattr(chain_layouts, end.name) for end in ChannelEnd]


def compare_message(tokens: bytes) -> None:
    parsed = any(parses(layout, tokens) for layout in MESSAGE_LAYOUTS)
    expected = as_specified(spec.decode_message, chain.decode, ChainError, tokens)
    assert parsed == (expected is not None)
    if expected is None:
        return
    message = chain.decode(tokens)
    assert type(message).__name__.upper() == expected["message"]
    assert message.encode() == tokens == spec.encode_message(expected)
    assert message.node == expected["node"]
    names = {"pulses": "packed", "data": ""}
    for field, value in expected.items():
        attribute = names.get(field, field)
        if attribute in ("", "message", "node"):
            continue
        converted: Any = value
        if field == "firmware":
            converted = tuple(value)
        elif field == "unique_id":
            converted = int.from_bytes(value, "little")
        assert getattr(message, attribute) == converted


@given(st.one_of(messages(), plausible()))
@settings(max_examples=500)
def test_message(message: spec.Fields) -> None:
    compare_message(raw_message(message))


@given(messages(), st.data())
@settings(max_examples=150)
def test_damaged_message(message: spec.Fields, data: st.DataObject) -> None:
    tokens = raw_message(message)
    compare_message(data.draw(edited(tokens, 12)))
    compare_message(tokens[: data.draw(st.integers(0, len(tokens)))])
    compare_message(tokens + b"\x01")


@given(st.binary(max_size=70))
def test_random_message(tokens: bytes) -> None:
    compare_message(tokens)


RESERVED_PULSE = b"\x64".ljust(48, b"\x00")
RESERVED_ITEMS: dict[str, spec.Fields] = {
    "slice": {"message": "SLICE", "node": 3, "pulses": RESERVED_PULSE},
    "slot": {"message": "LOAD", "node": 3, "memory": 1, "first": 0, "count": 1, "data": RESERVED_PULSE},
    "slot of an entry": {"message": "LOAD", "node": 3, "memory": 2, "count": 1, "data": b"\0\1\1".ljust(48, b"\0")},
    "periods of an entry": {"message": "LOAD", "node": 3, "memory": 2, "first": 0, "count": 1, "data": bytes(48)},
    "playing": {"message": "PLAYING", "node": 0xFF, "pulses": RESERVED_PULSE},
    "drift": {"message": "REPORT", "node": 0xFF, "firmware": b"\1\0\0", "drift": -128},
}


@pytest.mark.parametrize("name", RESERVED_ITEMS)
def test_items_within_a_message_are_not_judged_again(name: str) -> None:
    compare_message(raw_message(RESERVED_ITEMS[name]))
    assert spec.decode_message(raw_message(RESERVED_ITEMS[name]))


@given(pulse_lists(32), periods, st.integers(0, 9))
def test_commit(pairs: list[spec.Pulse], period: int, processor: int) -> None:
    packed = spec.pack_pulses(pairs)
    commit = chain.Commit.of(period, chain.Slice(processor, packed))
    assert commit.checksum == spec.commit_checksum(packed, period)
    assert commit.guards(packed)
    assert not commit.guards(packed[:-1] + bytes([packed[-1] ^ 1]))
    assert not chain.Commit(processor, period ^ 1, commit.checksum).guards(packed)


# Chapter SER

contents = st.one_of(
    st.binary(max_size=20),
    st.tuples(st.integers(250, 256), st.integers(0, 260), st.booleans()).map(
        lambda parts: b"\x01" * parts[0] + b"\x00" * parts[2] + b"\x02" * parts[1]
    ),
)


def raw_frame(kind: int, body: bytes) -> bytes:
    content = bytes([kind]) + body
    return spec.cobs_encode(content + spec.crc(content).to_bytes(4, "little")) + b"\x00"


BOTH = (*spec.TO_DEVICE, *spec.TO_HOST)


def compare_frame(frame: bytes) -> None:
    expected = as_specified(lambda line: spec.decode_frame(line[:-1], BOTH), framing.decode, FrameError, frame)
    if expected is None:
        # The layout reads one frame from a stream, which may go on after the first zero.
        assert frame.find(0) < len(frame) - 1 or not parses(FRAME, frame)
        return
    assert FRAME.build(FRAME.parse(frame)) == frame
    decoded = framing.decode(frame)
    assert (int(decoded.kind), decoded.body) == expected
    assert framing.encode(decoded) == frame == spec.encode_frame(*expected)


@given(contents)
def test_cobs(content: bytes) -> None:
    encoded = spec.cobs_encode(content)
    assert spec.cobs_decode(encoded) == content
    assert encoded == cobs.encode(content)
    assert len(encoded) <= len(content) + max(1, -(-len(content) // 254))


@st.composite
def bodies(draw: st.DrawFn) -> tuple[int, bytes]:
    """Type and body of a frame, of the size that its type has or of another."""
    kind = draw(st.integers(0, 6))
    if kind == spec.BLOCK_FRAME:
        return kind, draw(contents).ljust(draw(st.sampled_from((511, 512, 512, 512, 513))), b"\x03")
    if kind == spec.RECORD_FRAME:
        start = draw(st.sampled_from((b"PA\x01", b"PS\x01", b"PA", b"PB")))
        return kind, start.ljust(draw(st.sampled_from((32, 64, 33))), b"\x05")
    if kind == spec.REQUEST_FRAME:
        length = draw(st.sampled_from((0, 1, 5, 64, 639, 640, 641, 65535)))
        request_type = draw(st.sampled_from((0xC1, 0x41, 0xC0, 0x80, 0x21, 0)))
        head = bytes([draw(st.integers(0, 255)), request_type, 2, 0, 0, 0, 0]) + length.to_bytes(2, "little")
        return kind, head + draw(st.sampled_from((b"", b"\x06" * min(length, 641), b"\x06")))
    if kind == spec.REPLY_FRAME:
        data = b"\x07" * draw(st.sampled_from((0, 0, 1, 24, 639, 640, 641)))
        return kind, bytes([draw(st.integers(0, 255)), draw(st.integers(0, 2))]) + data
    return kind, draw(st.sampled_from((b"", b"", b"\x00")))


@given(bodies())
@settings(max_examples=150)
def test_frame(frame: tuple[int, bytes]) -> None:
    compare_frame(raw_frame(*frame))


@given(bodies(), st.data())
@settings(max_examples=150)
def test_damaged_frame(frame: tuple[int, bytes], data: st.DataObject) -> None:
    line = raw_frame(*frame)
    compare_frame(data.draw(edited(line[:-1], 4)) + b"\x00")
    compare_frame(line[:-1] + data.draw(st.sampled_from((b"\x01", b"\x01\x01", b"\x02"))) + b"\x00")


@given(st.lists(st.integers(1, 255), max_size=30).map(bytes))
def test_random_frame(data: bytes) -> None:
    compare_frame(data + b"\x00")


@given(bodies().filter(lambda frame: frame[0] in (spec.REQUEST_FRAME, spec.REPLY_FRAME)))
def test_request_and_reply(frame: tuple[int, bytes]) -> None:
    kind, body = frame
    read: Any = spec.read_request if kind == spec.REQUEST_FRAME else spec.read_reply
    decoder: Any = framing.SerialRequest if kind == spec.REQUEST_FRAME else framing.SerialReply
    expected = as_specified(read, decoder.decode, FrameError, body)
    if expected is None:
        return
    decoded = decoder.decode(body)
    assert {name: getattr(decoded, name) for name in expected} == expected
    layout = SERIAL_REQUEST if kind == spec.REQUEST_FRAME else SERIAL_REPLY
    assert decoded.encode() == layout.build(expected) == body


pieces = st.one_of(
    bodies().map(lambda frame: raw_frame(*frame)),
    st.sampled_from((b"\x00", b"\x00\x00", b"\xff", b"\x05abcd\x00", b"\x11" * 657 + b"\x00", b"\x11" * 658 + b"\x00")),
)


@given(st.lists(pieces, max_size=5), st.integers(1, 700))
def test_stream_of_frames(stream: list[bytes], at_once: int) -> None:
    line = b"".join(stream)
    expected, dropped = spec.read_frames(line, BOTH)
    reader = framing.FrameReader()
    found = [one for start in range(0, len(line), at_once) for one in reader.feed(line[start : start + at_once])]
    good = [(int(one.kind), one.body) for one in found if isinstance(one, framing.SerialFrame)]
    assert (good, len(found) - len(good)) == (expected, dropped)


line_pieces = st.one_of(pieces, st.sampled_from((b"stop\r", b"\x00", raw_frame(spec.CONSOLE_FRAME, b""))))


@given(st.lists(line_pieces, max_size=6), st.integers(1, 700))
@settings(max_examples=200)
def test_line(stream: list[bytes], at_once: int) -> None:
    data = b"".join(stream)
    line = framing.LineReader()
    found: list[tuple[str, bytes]] = []
    for start in range(0, len(data), at_once):
        for event in line.feed(data[start : start + at_once]):
            if isinstance(event, framing.LineMode):
                found.append((event.name.lower(), b""))
            elif isinstance(event, framing.SerialFrame):
                found.append(("frame", bytes([event.kind]) + event.body))
            elif isinstance(event, FrameError):
                found.append(("damaged", b""))
            elif found and found[-1][0] == "text":
                found[-1] = ("text", found[-1][1] + event)
            else:
                found.append(("text", event))
    assert found == spec.read_line(data, BOTH)


# Chapter CON


def parsed_line(line: str) -> tuple[str, int | None] | int | None:
    try:
        command = console.parse_command(line)
    except CommandError as error:
        console.format_error(ConsoleCode(error.reason), str(error))  # its text is printable
        return error.reason
    return None if command is None else (command.name, command.argument)


console_words = st.one_of(
    st.sampled_from(sorted(spec.COMMANDS)),
    st.sampled_from(("ENABLE", "-1", "+1", "1_0", "007", "0", "1", "4", "5", "9", "10", "319", "320", "321", "60000")),
    st.sampled_from(("60001", "1.0", "99999999999999999999", "x", "\u00b2", "\u0663", "\t", "\x7f", "\u2003")),
    st.text(max_size=5),
)
lines = st.lists(console_words, max_size=4).map(" ".join)
padded = st.tuples(st.sampled_from((0, 0, 1, 70, 74, 80, 81)), lines, st.sampled_from((0, 0, 1))).map(
    lambda parts: " " * parts[0] + parts[1] + " " * parts[2]
)


@given(padded)
@example(" " * 81)
@example("enable\u00a0")
@settings(max_examples=400)
def test_command(line: str) -> None:
    data = bytes(min(ord(character), 255) for character in line)
    assert parsed_line(line) == spec.parse_command(data)


keys = st.sampled_from((b"a", b" ", b"stop", b"\r", b"\n", b"\r\n", b"\x08", b"\x7f", b"\x03", b"\x15", b"\t", b"\xe9"))
typing = st.lists(st.one_of(keys, st.sampled_from((b"x" * 78, b"y" * 80, b"z" * 83))), max_size=10).map(b"".join)


@given(typing, st.booleans(), st.sampled_from((1, 2, 3, 1000)))
@settings(max_examples=300)
def test_typing(data: bytes, echo: bool, at_once: int) -> None:
    expected, shown = spec.typed(data, echo)
    editor = console.LineEditor(echo=echo)
    fed = [editor.feed(data[start : start + at_once]) for start in range(0, len(data), at_once)]
    assert [line for found, _ in fed for line in found] == [line.decode("latin-1") for line in expected]
    assert b"".join(sent for _, sent in fed) == (shown if echo else b"")


# Chapter FWU

KEYS = [Ed25519PrivateKey.from_private_bytes(bytes([value]) * 32) for value in (1, 2)]
RAW_KEYS = [key.public_key().public_bytes_raw() for key in KEYS]


@st.composite
def images(draw: st.DrawFn) -> bytes:
    """A valid image, signed or not."""
    targets = draw(st.sampled_from(([10, 11], [10, 11], [*range(10), 11])))
    segments = [bytes([7 + target]) * draw(st.sampled_from((1, 2, 3, 4, 5, 9))) for target in targets]
    table, content, place = b"", b"", 32 + 48 * len(targets)
    for target, segment in zip(targets, segments, strict=True):
        entry = {"target": target, "offset": place, "size": len(segment), "checksum": spec.crc(segment)}
        entry["digest"] = hashlib.sha256(segment).digest()
        table += bytes(spec.put(48, spec.SEGMENT_ENTRY, entry))
        content += segment.ljust(spec.multiple_of_4(len(segment)), b"\x00")
        place += spec.multiple_of_4(len(segment))
    signer = draw(st.sampled_from((None, 0, 1)))
    header = {"magic": b"PWFW", "version": 1, "segments": len(targets), "hardware": 1, "total": place + 64}
    header |= {"major": draw(st.integers(0, 99)), "minor": 9, "patch": draw(st.integers(0, 9)), "protocol": 1}
    header["key_id"] = bytes(8) if signer is None else hashlib.sha256(RAW_KEYS[signer]).digest()[:8]
    image = seal_image(bytes(spec.put(32, spec.IMAGE_HEADER, header)) + table + content + bytes(64))
    return image if signer is None else image[:-64] + KEYS[signer].sign(image[:-64])


def seal_image(image: bytes) -> bytes:
    """The same image with the checksum of header and table that belongs to it."""
    end = 32 + 48 * image[5]
    return image[:28] + spec.crc(image[:28] + image[32:end]).to_bytes(4, "little") + image[32:]


@st.composite
def wild_images(draw: st.DrawFn) -> bytes:
    """An image, edited and sealed again in none, some or all of its layers."""
    image = draw(images())
    if draw(st.booleans()):
        image = draw(edited(image, draw(st.sampled_from((32, 90, 140, len(image))))))
    if draw(st.integers(0, 3)) == 0:
        _, offset, size, _ = draw(st.sampled_from((*spec.IMAGE_HEADER[1:8], *spec.IMAGE_HEADER[9:])))
        value = draw(st.sampled_from((0, 1, 2, 9, 10, 11, 99, 100, 255))) % 256**size
        image = image[:offset] + value.to_bytes(size, "little") + image[offset + size :]
    if draw(st.integers(0, 4)) == 0:
        image = draw(st.sampled_from((image + b"\x00", image[:-1], image[: draw(st.integers(0, len(image)))])))
    if draw(st.integers(0, 3)) and len(image) >= 32:
        image = seal_image(image)
    if draw(st.booleans()) and len(image) > 96:
        signer = draw(st.integers(0, 1))
        image = image[:-64] + KEYS[signer].sign(image[:-64])
    return image


def reason_of(parse: Any, data: bytes) -> int:
    try:
        parse(data)
    except ImageError as error:
        return int(error.reason)
    return 0


def trust_of(image: firmware.Image, keys: list[Ed25519PrivateKey]) -> str:
    names = {"SIGNED": "trusted", "UNKNOWN_KEY": "unknown", "UNSIGNED": "unsigned"}
    try:
        return names[firmware.trust(image, [key.public_key() for key in keys]).name]
    except ImageError as error:
        return "wrong" if error.reason == ImageReason.SIGNATURE else "refused"


@given(wild_images())
@settings(max_examples=300)
def test_image(image: bytes) -> None:
    expected = spec.judge_image(image)
    file = image + spec.suffix_of(image)
    assert reason_of(firmware.parse, file) == expected == spec.judge_file(file)
    assert parses(IMAGE, image) == (expected == 0)
    assert reason_of(firmware.ImageHeader.decode, image) == spec.judge_header(image)
    if expected == 0:
        parsed = firmware.parse(file)
        assert firmware.build(parsed)[:-16] == image
        for number in range(3):
            assert trust_of(parsed, KEYS[:number]) == spec.signature_of(image, RAW_KEYS[:number])


@pytest.mark.parametrize("size", [0, 1, 65535, 65536, 65537, 2**32 - 1])
@pytest.mark.parametrize("place", [0, 1])
def test_segment_sizes(size: int, place: int) -> None:
    sizes = [4, 4]
    sizes[place] = size
    table, offset = b"", 128
    for target, one in zip((10, 11), sizes, strict=True):
        table += bytes(spec.put(48, spec.SEGMENT_ENTRY, {"target": target, "offset": offset % 2**32, "size": one}))
        offset = spec.multiple_of_4(offset + one)
    header = {"magic": b"PWFW", "version": 1, "segments": 2, "hardware": 1, "protocol": 1}
    image = seal_image(bytes(spec.put(32, spec.IMAGE_HEADER, {**header, "total": (offset + 64) % 2**32})) + table)
    assert reason_of(firmware.ImageHeader.decode, image) == spec.judge_header(image)


@given(images(), st.data())
@settings(max_examples=100)
def test_suffix(image: bytes, data: st.DataObject) -> None:
    file = image + spec.suffix_of(image, data.draw(words), data.draw(words), data.draw(words))
    tail = data.draw(edited(file[-16:], 16))
    if data.draw(st.booleans()):
        tail = tail[:12] + (spec.crc(image + tail[:12]) ^ 0xFFFFFFFF).to_bytes(4, "little")
    assert reason_of(firmware.parse, image + tail) == spec.judge_file(image + tail)
    cut = file[-data.draw(st.integers(1, len(file))) :]
    assert reason_of(firmware.parse, cut) == spec.judge_file(cut)


marks = st.sampled_from((0xFFFFFFFF, 0xFFFFFFFF, 0, 0xFFFFFFFE, 0x7FFFFFFF))


@st.composite
def boot_records(draw: st.DrawFn) -> bytes:
    record = {
        "magic": b"PWBR",
        "generation": draw(numbers),
        "size": draw(st.sampled_from((0, 1, 200, 721520, 721521, 2**32 - 1))),
        "digest": bytes(32),
        "started": draw(marks),
        "confirmed": draw(marks),
    }
    data = bytes(spec.put(56, spec.BOOT_RECORD, record))
    data = data[:44] + spec.crc(data[:44]).to_bytes(4, "little") + data[48:]
    return draw(edited(data, 12)) if draw(st.integers(0, 5)) == 0 else data


@given(boot_records(), boot_records())
@settings(max_examples=300)
def test_boot(bank_a: bytes, bank_b: bytes) -> None:
    expected_a, expected_b = spec.read_boot_record(bank_a), spec.read_boot_record(bank_b)
    decoded = firmware.BootRecord.decode(bank_a)
    assert (decoded is None) == (expected_a is None)
    if decoded is not None and expected_a is not None:
        assert (decoded.generation, decoded.size, decoded.digest) == tuple(
            expected_a[name] for name in ("generation", "size", "digest")
        )
        assert decoded.may_boot == spec.may_boot(expected_a)
        assert decoded.encode() == bank_a
    assert firmware.boot_order(bank_a, bank_b) == tuple(
        Bank[name] for name in spec.banks_to_try(expected_a, expected_b)
    )


# Chapter DFU


def test_dfu_states() -> None:
    assert [state.name for state in DfuState] == list(spec.DFU_STATES)
    events = {event.name for event in dfu.DfuEvent}
    assert events >= set(spec.DFU_HAPPENINGS)
    for state in spec.DFU_STATES:
        for event in sorted(events):
            step = dfu.TRANSITIONS.get((DfuState[state], dfu.DfuEvent[event]))
            found = (state, False) if step is None else (step.state.name, step.stalls)
            assert (state, event, *found) == (state, event, *spec.dfu_after(state, event))


@given(st.integers(0, 4), st.sampled_from((0, 1, 10, 952, 2047, 2048, 2049)), st.integers(0, 3), st.integers(1, 6))
@settings(max_examples=300)
def test_dfu_blocks(block: int, length: int, blocks_received: int, total_blocks: int) -> None:
    total = 2048 * (total_blocks - 1) + 952
    received = min(2048 * blocks_received, total)
    assert dfu.check_block(block, length, received, total).name == spec.dfu_judge_block(block, length, received, total)
    assert dfu.program_ms(block) == spec.dfu_poll_ms(block)


@pytest.mark.parametrize("reason", range(15))
def test_dfu_reasons(reason: int) -> None:
    assert [one.name for one in ImageReason] == list(spec.IMAGE_REASONS)
    status, string = spec.dfu_status_of(reason)
    assert dfu.status_of(ImageReason(reason)) == DfuStatus[status]
    assert dfu.reason_string(ImageReason(reason)) == string
