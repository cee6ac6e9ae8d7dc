"""The protocol as its specification words it: an oracle that shares no code with the implementation.

Everything here was written from SPEC.md alone, in small literal functions that name their clauses; layouts, codes and
transitions are read from its tables. Numbers are plain integers, records are dictionaries under the field names of the
specification's layouts, and what has to be refused raises `Refused`. Slowness does not matter.
"""

import hashlib
import math
import re
import struct
import zlib
from collections.abc import Sequence
from typing import Any

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from tests.specification import SPEC, codes, layout_rows, table

Pulse = tuple[int, int]
"""Phase in half ticks, width in ticks (PUL-001)."""

Fields = dict[str, Any]
"""Values by the names that the layouts of the specification give them."""

Layout = tuple[tuple[str, int, int, str], ...]
"""Name, offset, bytes and kind of each field: u unsigned, s signed, b bytes as they are."""

KINDS = {"temperature_c": "s", "drift": "s"} | dict.fromkeys(
    ("magic", "payload", "pulses", "data", "firmware", "unique_id", "later", "key_id", "digest", "signature"), "b"
)
"""The kinds of the fields that are not unsigned numbers."""


def layout_of(name: str) -> Layout:
    """A layout that the specification prints."""
    return tuple((field, offset, size, KINDS.get(field, "u")) for offset, size, field in layout_rows(name))


class Refused(ValueError):
    """A refusal of the specification; `reason` is the number in its table, 0 if there is no table."""

    def __init__(self, why: str, reason: int = 0) -> None:
        super().__init__(why)
        self.reason = reason


def number(data: bytes, offset: int, size: int) -> int:
    """An unsigned little-endian integer: all are, unless a clause says otherwise."""
    return int.from_bytes(data[offset : offset + size], "little")


def crc(data: bytes) -> int:
    """The CRC-32 of IEEE 802.3, as in zlib (BLK-003, SER-002)."""
    return zlib.crc32(data)


def take(data: bytes, layout: Layout) -> Fields:
    """Read the fields of a layout."""
    fields: Fields = {}
    for name, offset, size, kind in layout:
        part = data[offset : offset + size]
        fields[name] = part if kind == "b" else int.from_bytes(part, "little", signed=kind == "s")
    return fields


def put(size: int, layout: Layout, fields: Fields) -> bytearray:
    """Write the fields of a layout; missing ones are 0."""
    data = bytearray(size)
    for name, offset, width, kind in layout:
        if name in fields:
            value = fields[name]
            data[offset : offset + width] = (
                value if kind == "b" else value.to_bytes(width, "little", signed=kind == "s")
            )
    return data


# Chapter PUL


def pulse_allowed(pulse: Pulse) -> bool:
    """Phase 0 to 99, width 0 to 25; other values are reserved (PUL-001)."""
    return 0 <= pulse[0] <= 99 and 0 <= pulse[1] <= 25


def pack_pulses(pulses: Sequence[Pulse]) -> bytes:
    """Two pulses of 12 bits form 24 bits, the first in the low half, least significant byte first (PUL-005)."""
    data = b""
    for first, second in zip(pulses[0::2], pulses[1::2], strict=True):
        low = first[0] + first[1] * 128
        high = second[0] + second[1] * 128
        data += (low + high * 4096).to_bytes(3, "little")
    return data


def unpack_pulses(data: bytes) -> list[Pulse]:
    """The pulses as they stand, reserved ones too (PUL-005)."""
    pulses: list[Pulse] = []
    for offset in range(0, len(data), 3):
        both = number(data, offset, 3)
        low, high = both % 4096, both // 4096
        pulses += [(low % 128, low // 128), (high % 128, high // 128)]
    return pulses


def pulses_allowed(data: bytes) -> bool:
    """None of the packed pulses has a reserved value (PUL-001)."""
    return all(pulse_allowed(pulse) for pulse in unpack_pulses(data))


def start_tick(pulse: Pulse) -> int:
    """The tick of the period at which the pulse begins (PUL-004)."""
    phase, width = pulse
    return (phase - width) // 2 % 50


def high_ticks(pulse: Pulse) -> set[int]:
    """The ticks of the period in which the output is high, round its end if need be (PUL-002, PUL-004)."""
    return {(start_tick(pulse) + tick) % 50 for tick in range(pulse[1])}


def modulated_width(width: int, sample: int) -> int:
    """The width under a modulation sample (PUL-006)."""
    return math.floor(50 / math.pi * math.asin(sample / 255 * math.sin(math.pi * width / 50)) + 0.5)


def power(width: int) -> int:
    """The power of a pulse in thousandths of that of 25 ticks (SAF-006)."""
    return math.floor(1000 * math.sin(math.pi * width / 50) ** 2 + 0.5)


def total_drive(pulses: Sequence[Pulse]) -> int:
    """The sum of the powers (SAF-006)."""
    return sum(power(width) for _, width in pulses)


# Chapter BLK

ACCEPTED, LENGTH, CHECKSUM, MAGIC, VERSION, KIND, FIELD, PULSE = range(8)
UPDATE, SLOT, ENTRIES, SEQUENCE, SAMPLES, MODULATION, OUTPUT, CLOCK, NO_OP = range(1, 10)
RESTART, UNATTENDED = 1, 2

BLOCK = layout_of("BLOCK")
"""The header and the payload (BLK-002)."""


def used_fields(kind: int, count: int) -> dict[str, tuple[int, int]]:
    """The fields that a kind uses, each with its least and its greatest value (BLK-011, BLK-018)."""
    period = (0, 2**64 - 1)
    return {
        UPDATE: {"period": period},
        SLOT: {"first": (0, 255)},
        ENTRIES: {"first": (0, 1024 - count), "count": (1, 120)},
        SEQUENCE: {"period": period, "first": (0, 1024 - count), "count": (1, 1024), "repeats": (0, 65535)},
        SAMPLES: {"first": (0, 4096 - count), "count": (1, 480)},
        MODULATION: {"period": period, "first": (0, 4096 - count), "count": (1, 4096), "hold": (1, 65535)},
        OUTPUT: {"period": period, "action": (1, 3)},
        CLOCK: {},
        NO_OP: {},
    }[kind]


def used_payload(kind: int, count: int) -> int:
    """How many bytes of the payload a kind uses (BLK-011)."""
    return {UPDATE: 480, SLOT: 480, ENTRIES: 4 * count, SAMPLES: count}.get(kind, 0)


def allowed_flags(kind: int) -> int:
    """RESTART in every kind, UNATTENDED in SEQUENCE only (BLK-011)."""
    return RESTART | UNATTENDED if kind == SEQUENCE else RESTART


def entries_of(payload: bytes, count: int) -> list[tuple[int, int]]:
    """Steps of four bytes: the slot and for how many periods it plays (BLK-014)."""
    return [(number(payload, 4 * place, 2), number(payload, 4 * place + 2, 2)) for place in range(count)]


def entry_allowed(slot: int, periods: int) -> bool:
    """Slot 0 to 255, 1 to 65 535 periods (BLK-014)."""
    return 0 <= slot <= 255 and 1 <= periods <= 65535


def fields_allowed(block: Fields) -> bool:
    """Every field in its range, every unused field and byte 0, every entry one that can be (BLK-011, BLK-014)."""
    kind, count, payload = block["kind"], block["count"], block["payload"]
    used = used_fields(kind, count)
    for name in ("period", "first", "count", "hold", "repeats", "action", "reserved"):
        least, greatest = used.get(name, (0, 0))
        if not least <= block[name] <= greatest:
            return False
    if block["flags"] & ~allowed_flags(kind):
        return False
    if any(payload[used_payload(kind, count) :]):
        return False
    return kind != ENTRIES or all(entry_allowed(slot, periods) for slot, periods in entries_of(payload, count))


def block_checksum(data: bytes) -> int:
    """The CRC-32 of the 512 bytes with the checksum's four taken as 0 (BLK-003)."""
    return crc(data[:28] + bytes(4) + data[32:])


def judge_block(data: bytes) -> int:
    """The reason that depends on the block alone: the first that fails in the order of ACK-003, or 0."""
    if len(data) != 512:  # BLK-001
        return LENGTH
    block = take(data, BLOCK)
    if block["checksum"] != block_checksum(data):  # BLK-003
        return CHECKSUM
    if block["magic"] != b"PW":  # BLK-002
        return MAGIC
    if block["version"] != 1:  # VER-002
        return VERSION
    if not UPDATE <= block["kind"] <= NO_OP:  # BLK-004
        return KIND
    if not fields_allowed(block):  # BLK-011
        return FIELD
    if block["kind"] in (UPDATE, SLOT) and not pulses_allowed(block["payload"]):  # PUL-001
        return PULSE
    return ACCEPTED


def read_block(data: bytes) -> Fields:
    """The fields of a valid block, its payload as `pulses`, `entries` or `samples` (BLK-002, BLK-006, BLK-013 to 16).

    Unused fields are 0; unused bytes of the payload are left out.
    """
    reason = judge_block(data)
    if reason != ACCEPTED:
        raise Refused("block", reason)
    block = take(data, BLOCK)
    payload, kind, count = block["payload"], block["kind"], block["count"]
    read = {name: block[name] for name in ("kind", "sequence", "period", "first", "count", "hold", "repeats", "flags")}
    read["action"] = block["action"]
    if kind in (UPDATE, SLOT):
        read["pulses"] = unpack_pulses(payload)
    elif kind == ENTRIES:
        read["entries"] = entries_of(payload, count)
    elif kind == SAMPLES:
        read["samples"] = payload[:count]
    return read


def build_block(block: Fields) -> bytes:
    """The 512 bytes of fields as `read_block` gives them; missing ones are 0 (BLK-002, BLK-003)."""
    payload = b""
    if "pulses" in block:
        payload = pack_pulses(block["pulses"])
    elif "entries" in block:
        payload = b"".join(struct.pack("<HH", slot, periods) for slot, periods in block["entries"])
    elif "samples" in block:
        payload = bytes(block["samples"])
    given = {"magic": b"PW", "version": 1, **block, "payload": payload.ljust(480, b"\x00")}
    data = seal_block(bytes(put(512, BLOCK, given)))
    reason = judge_block(data)
    if reason != ACCEPTED:
        raise Refused("block", reason)
    return data


def seal_block(data: bytes) -> bytes:
    """The same 512 bytes with the checksum that belongs to them (BLK-003)."""
    return data[:28] + block_checksum(data).to_bytes(4, "little") + data[32:]


# Chapter NUM


def follows(number_a: int, number_b: int) -> bool:
    """Whether number a follows number b (NUM-002)."""
    return 0 < (number_a - number_b) % 2**32 < 2**31


def missing(accepted: int, last: int) -> int:
    """How many numbers were left out before the one that was accepted (NUM-003)."""
    return (accepted - last) % 2**32 - 1


# Chapter ACK, REQ

ACK, STATUS, INFO = layout_of("ACK"), layout_of("STATUS"), layout_of("INFO")  # ACK-002, REQ-003, REQ-002
CLOCK_READING, PROCESSOR_REPORT = layout_of("CLOCK"), layout_of("PROCESSOR_REPORT")  # REQ-006, REQ-008


def read_record(data: bytes, layout: Layout, magic: bytes, size: int) -> Fields:
    """The fields of an acknowledgement or a status record with its size, magic and checksum (ACK-002, REQ-003)."""
    if len(data) != size:
        raise Refused("size")
    fields = take(data, layout)
    if fields["magic"] != magic:
        raise Refused("magic")
    if fields["checksum"] != crc(data[: size - 4]):
        raise Refused("checksum")
    return fields


def read_ack(data: bytes) -> Fields:
    """An acknowledgement of version 1 whose codes are in the tables (ACK-002 to 4, STA-001)."""
    ack = read_record(data, ACK, b"PA", 32)
    if ack["version"] != 1:
        raise Refused("version")
    if ack["reason"] > 16 or ack["flags"] > 3 or ack["state"] > 6 or ack["reserved"] != 0:
        raise Refused("value")
    return ack


def read_status(data: bytes) -> Fields:
    """A status record whose codes are in the tables (REQ-003, STA-001, SAF-008)."""
    status = read_record(data, STATUS, b"PS", 64)
    if status["version"] != 1:
        raise Refused("version")
    if status["state"] > 6 or status["faults"] > 127 or status["last_refusal"] > 16 or status["flags"] > 7:
        raise Refused("value")
    if status["reserved"] != 0:
        raise Refused("reserved")
    return status


def build_ack(fields: Fields) -> bytes:
    """An acknowledgement with magic and checksum (ACK-002)."""
    data = bytes(put(32, ACK, {"magic": b"PA", **fields}))
    return data[:28] + crc(data[:28]).to_bytes(4, "little")


def build_status(fields: Fields) -> bytes:
    """A status record with magic, version and checksum (REQ-003)."""
    data = bytes(put(64, STATUS, {"magic": b"PS", "version": 1, **fields}))
    return data[:60] + crc(data[:60]).to_bytes(4, "little")


def read_records(packets: bytes) -> list[Fields]:
    """The acknowledgements and status records of whole packets, told apart by their magic (ACK-005)."""
    found = []
    while packets:
        size = 64 if packets[:2] == b"PS" else 32
        read = read_status if size == 64 else read_ack
        found.append(read(packets[:size]))
        packets = packets[size:]
    return found


def read_info(data: bytes) -> Fields:
    """The 64 bytes of INFO, whose links have 2 or 5 wires (REQ-002, VER-003)."""
    if len(data) != 64:
        raise Refused("size")
    info = take(data, INFO)
    if info["link_wires"] not in (2, 5):
        raise Refused("link_wires")
    return info


def read_clock(data: bytes) -> Fields:
    """The 24 bytes of CLOCK (REQ-006). Assumed, as for all answers: reserved bytes that are not 0 are refused."""
    if len(data) != 24:
        raise Refused("size")
    reading = take(data, CLOCK_READING)
    if reading["reserved"] != 0:
        raise Refused("reserved")
    return reading


def read_back(data: bytes) -> Fields:
    """The 496 bytes of PULSES; reserved pulses are refused (REQ-007, PUL-001)."""
    if len(data) != 496:
        raise Refused("size")
    if not pulses_allowed(data[16:]):
        raise Refused("pulse")
    return {
        "since_period": number(data, 0, 8),
        "read_period": number(data, 8, 8),
        "pulses": unpack_pulses(data[16:]),
    }


def read_processors(data: bytes) -> list[Fields]:
    """The 160 bytes of PROCESSORS, each processor with faults and a bank of the tables (REQ-008, SAF-008, FWU-016)."""
    if len(data) != 160:
        raise Refused("size")
    reports = [take(data[offset : offset + 16], PROCESSOR_REPORT) for offset in range(0, 160, 16)]
    for report in reports:
        if report["faults"] > 127 or report["bank"] not in (0, 1, 2, 3) or report["reserved"] != 0:
            raise Refused("value")
    return reports


# Chapter STA

STATES = tuple(codes("State"))
EVENTS = tuple(row[0].strip("`") for row in table("table: Event"))
TRANSITIONS = {
    (state, event.strip("`")): following.strip("`")
    for before, event, following, _ in table("table: transitions")
    for state in before.replace("`", "").split(", ")
} | {(state, "RESTART"): "OFF" for state in STATES}
"""The rows of the table of STA-003, and its sentence about RESTART."""


def after(state: str, event: str) -> str:
    """The state after an event: these transitions and no others (STA-003)."""
    return TRANSITIONS.get((state, event), state)


# Chapter CHN

CONTROLLER_NODE, UNNUMBERED_NODE, END_TOKEN = 0x00FF, 0xFFFF, 1
SLOTS_MEMORY, ENTRIES_MEMORY, SAMPLES_MEMORY = 1, 2, 3


def message_layout(name: str) -> tuple[int, Layout]:
    """How many tokens a message has, and its fields between route header and checksum."""
    *fields, end = layout_of(name)
    return end[1] + 1, tuple(field for field in fields[2:] if field[0] != "checksum" or name == "COMMIT")


MESSAGES = {name: (end, *message_layout(name)) for name, end in codes("ChannelEnd").items()}
"""Channel end, tokens and the fields between route header and checksum (CHN-009, CHN-011, CHN-012, CHN-014, 16, 22)."""


def message_of(channel_end: int) -> str:
    """The message that goes to a channel end (CHN-009)."""
    for name, (end, _, _) in MESSAGES.items():
        if end == channel_end:
            return name
    raise Refused("channel end")


def node_allowed(name: str, node: int) -> bool:
    """0 to 9 for the processors' messages, FFFF for NUMBER, 00FF for the controller's (CHN-008, the layouts)."""
    if name in ("REPORT", "PLAYING", "IDENTITY"):
        return node == CONTROLLER_NODE
    if name == "NUMBER":
        return node == UNNUMBERED_NODE
    return 0 <= node <= 9


def load_allowed(load: Fields) -> bool:
    """The items lie in the memory, and 0 follows them (CHN-012, CHN-028)."""
    memory, first, count, data = load["memory"], load["first"], load["count"], load["data"]
    if memory not in (SLOTS_MEMORY, ENTRIES_MEMORY, SAMPLES_MEMORY):
        return False
    items, most, size = {1: (256, 1, 48), 2: (1024, 12, 4), 3: (4096, 48, 1)}[memory]
    return 1 <= count <= most and first + count <= items and not any(data[count * size :])


def program_allowed(program: Fields) -> bool:
    """Whether a PROGRAM plays a sequence or a modulation within its memory, or stops one (CHN-014)."""
    memory, first, count, hold, repeats = (program[name] for name in ("memory", "first", "count", "hold", "repeats"))
    if memory not in (ENTRIES_MEMORY, SAMPLES_MEMORY):
        return False
    if count == 0:
        return bool(first == hold == repeats == 0)
    if memory == ENTRIES_MEMORY:
        return bool(first + count <= 1024 and hold == 0)
    return bool(first + count <= 4096 and hold >= 1 and repeats == 0)


def message_allowed(name: str, message: Fields) -> bool:
    """Whether the fields are such as the layouts allow (CHN-010)."""
    if not node_allowed(name, message["node"]):
        return False
    if name == "LOAD":
        return load_allowed(message)
    if name == "PROGRAM":
        return program_allowed(message)
    if name == "COLLECT":
        return bool(message["answer"] in (7, 8))
    if name == "NUMBER":
        return bool(0 <= message["number"] <= 9)
    if name == "IDENTITY" and message["last"] not in (0, 1):
        return False
    return name not in ("REPORT", "PLAYING", "IDENTITY") or 0 <= message["processor"] <= 9


def decode_message(tokens: bytes) -> Fields:
    """A message with its route header and END, or refused (CHN-002, CHN-008 to CHN-016, CHN-022).

    The checksum of a commit stays among its fields: it can be checked with the slice only (`commit_checksum`).
    """
    if len(tokens) < 3:
        raise Refused("size")
    name = message_of(tokens[2])
    _, size, layout = MESSAGES[name]
    if len(tokens) != size or tokens[-1] != END_TOKEN:
        raise Refused("size")
    if name not in ("SLICE", "COMMIT") and crc(tokens[:-5]) != number(tokens, size - 5, 4):
        raise Refused("checksum")
    message = take(tokens, layout)
    message["message"] = name
    message["node"] = int.from_bytes(tokens[:2], "big")
    if not message_allowed(name, message):
        raise Refused("field")
    return message


def encode_message(message: Fields) -> bytes:
    """The tokens of a message as `decode_message` gives it (CHN-002, CHN-008, CHN-010)."""
    name = message["message"]
    if not message_allowed(name, message):
        raise Refused("field")
    end, size, layout = MESSAGES[name]
    tokens = put(size, layout, message)
    tokens[0:3] = message["node"].to_bytes(2, "big") + bytes([end])
    if name not in ("SLICE", "COMMIT"):
        tokens[-5:-1] = crc(bytes(tokens[:-5])).to_bytes(4, "little")
    tokens[-1] = END_TOKEN
    return bytes(tokens)


def commit_checksum(slice_pulses: bytes, period: int) -> int:
    """The CRC-32 of the slice's 48 bytes followed by the 8 of the period (CHN-011)."""
    return crc(slice_pulses + period.to_bytes(8, "little"))


# Chapter SER

BLOCK_FRAME, RECORD_FRAME, REQUEST_FRAME, REPLY_FRAME, CONSOLE_FRAME = range(1, 6)
TO_DEVICE = (BLOCK_FRAME, REQUEST_FRAME, CONSOLE_FRAME)
TO_HOST = (RECORD_FRAME, REPLY_FRAME, CONSOLE_FRAME)


def cobs_encode(content: bytes) -> bytes:
    """Cut after each zero, groups of 254, no group after a last full one (SER-003)."""
    pieces = content.split(b"\x00")
    encoded = b""
    for place, piece in enumerate(pieces):
        rest = piece
        while len(rest) >= 254:
            encoded += b"\xff" + rest[:254]
            rest = rest[254:]
        ends_with_group = place == len(pieces) - 1 and len(piece) >= 254 and not rest
        if not ends_with_group:
            encoded += bytes([len(rest) + 1]) + rest
    return encoded


def cobs_decode(encoded: bytes) -> bytes:
    """The content; refused if `cobs_encode` would have sent something else (SER-003)."""
    if not encoded or 0 in encoded:
        raise Refused("no COBS")
    content = b""
    while encoded:
        length = encoded[0]
        group, encoded = encoded[1:length], encoded[length:]
        if len(group) != length - 1:
            raise Refused("cut short")
        content += group
        if length == 0xFF and encoded == b"\x01":
            raise Refused("an empty group after a full one")
        if encoded and length != 0xFF:
            content += b"\x00"
    return content


def body_allowed(kind: int, body: bytes) -> bool:
    """Whether a body has the size and the layout of its type (SER-004, SER-006 to SER-008).

    Assumed: whether a record is valid in itself is judged after the frame, as SER-006 says of a block.
    """
    if kind == BLOCK_FRAME:
        return len(body) == 512
    if kind == RECORD_FRAME:
        return len(body) in (32, 64)
    if kind == REQUEST_FRAME:
        return request_allowed(body)
    if kind == REPLY_FRAME:
        return 2 <= len(body) <= 642 and (body[1] == 0 or (body[1] == 1 and len(body) == 2))
    return kind == CONSOLE_FRAME and body == b""


def request_allowed(body: bytes) -> bool:
    """Tag, SETUP packet, and as many bytes as `length` says if bit 7 of the type is 0 (SER-007)."""
    if len(body) < 9:
        return False
    length = number(body, 7, 2)
    return length <= 640 and len(body) == 9 + (0 if body[1] & 0x80 else length)


def encode_frame(kind: int, body: bytes) -> bytes:
    """COBS of type, body and checksum, then one zero (SER-002)."""
    if not body_allowed(kind, body):
        raise Refused("body")
    content = bytes([kind]) + body
    return cobs_encode(content + crc(content).to_bytes(4, "little")) + b"\x00"


def decode_frame(frame: bytes, directions: Sequence[int]) -> tuple[int, bytes]:
    """Type and body of the bytes before a zero; `Refused` is a damaged frame (SER-006)."""
    if len(frame) + 1 > 658:
        raise Refused("too long")
    content = cobs_decode(frame)
    if len(content) < 5:
        raise Refused("too short")
    if crc(content[:-4]) != number(content, len(content) - 4, 4):
        raise Refused("checksum")
    kind, body = content[0], content[1:-4]
    if kind not in directions or not body_allowed(kind, body):
        raise Refused("type or body")
    return kind, body


def read_frames(stream: bytes, directions: Sequence[int]) -> tuple[list[tuple[int, bytes]], int]:
    """The undamaged frames of a stream and the number of damaged ones; adjacent zeros enclose no frame (SER-005)."""
    frames, dropped = [], 0
    for part in stream.split(b"\x00")[:-1]:
        if part:
            try:
                frames.append(decode_frame(part, directions))
            except Refused:
                dropped += 1
    return frames, dropped


def read_line(stream: bytes, directions: Sequence[int]) -> list[tuple[str, bytes]]:
    """The content of one direction of a line, from the console on: text, frames, damaged ones, modes (SER-010).

    Text is joined; a frame's bytes are its type and its body; the frame CONSOLE shows as the mode that it begins.
    """
    found: list[tuple[str, bytes]] = []
    rest = stream
    while rest:
        text, zero, rest = rest.partition(b"\x00")
        if text:
            found.append(("text", text))
        if zero:
            found.append(("frames", b""))
        while zero and b"\x00" in rest:
            frame, _, rest = rest.partition(b"\x00")
            if not frame:
                continue
            try:
                kind, body = decode_frame(frame, directions)
            except Refused:
                found.append(("damaged", b""))
                continue
            if kind == CONSOLE_FRAME:
                found.append(("console", b""))
                break
            found.append(("frame", bytes([kind]) + body))
        else:
            return found
    return found


SERIAL_REQUEST = layout_of("SERIAL_REQUEST")
"""The body of a REQUEST before its data (SER-007)."""


def read_request(body: bytes) -> Fields:
    """The fields and the data of a REQUEST (SER-007)."""
    if not request_allowed(body):
        raise Refused("request")
    return {**take(body, SERIAL_REQUEST), "data": body[9:]}


def read_reply(body: bytes) -> Fields:
    """Tag, outcome and data of a REPLY (SER-008)."""
    if not body_allowed(REPLY_FRAME, body):
        raise Refused("reply")
    return {"tag": body[0], "outcome": body[1], "data": body[2:]}


# Chapter CON

COMMANDS = {
    name.strip("`"): (int(ends[0]), int(ends[1])) if (ends := re.findall(r"\d+", argument)) else None
    for name, argument, *_ in table("commands")
}
"""The commands, each with the range of its argument, if it takes one (CON-005)."""


def parse_command(line: bytes) -> tuple[str, int | None] | int | None:
    """The command and its argument; a code of CON-006; None for a line without words (CON-001, CON-002, CON-006)."""
    if len(line) > 80:
        return 1
    if any(not 0x20 <= character <= 0x7E for character in line):
        return 2
    words = [word for word in line.decode("ascii").split(" ") if word]
    if not words:
        return None
    if words[0] not in COMMANDS:
        return 3
    allowed = COMMANDS[words[0]]
    if allowed is None:
        return (words[0], None) if len(words) == 1 else 4
    if len(words) != 2 or any(digit not in "0123456789" for digit in words[1]):
        return 4
    value = int(words[1])
    return (words[0], value) if allowed[0] <= value <= allowed[1] else 5


def typed(data: bytes, echo: bool = True) -> tuple[list[bytes], bytes]:
    """The lines that typed bytes end, and the echo; a line too long has 81 characters (CON-003, CON-006).

    Assumed: erasing a character that was not shown leaves the screen as it is.
    """
    lines: list[bytes] = []
    shown, line, after_cr = b"", b"", False
    for character in (bytes([value]) for value in data):
        if character in (b"\r", b"\n"):
            if not (character == b"\n" and after_cr):
                lines.append(line)
                line = b""
                shown += b"\r\n" if echo else b""
            after_cr = character == b"\r"
            continue
        after_cr = False
        if character in (b"\x08", b"\x7f", b"\x03", b"\x15"):
            whole = character in (b"\x03", b"\x15")
            kept = b"" if whole else line[:-1]
            shown += b"\x08 \x08" * (len(line[:80]) - len(kept[:80])) if echo else b""
            line = kept
        elif len(line) < 80:
            line += character
            if echo:
                shown += character if 0x20 <= character[0] <= 0x7E else b"?"
        else:
            line += b"" if len(line) > 80 else character
            shown += b"\x07" if echo else b""
    return lines, shown


# Chapter FWU

IMAGE_HEADER, SEGMENT_ENTRY = layout_of("IMAGE_HEADER"), layout_of("SEGMENT_ENTRY")  # FWU-002, FWU-006
IMAGE_REASONS = tuple(codes("ImageReason"))
"""The reasons in the order in which an image is checked (FWU-015)."""


def multiple_of_4(value: int) -> int:
    """The next multiple of 4, the value itself if it is one (FWU-009)."""
    return (value + 3) // 4 * 4


def segment_table(image: bytes) -> list[Fields]:
    """The entries that follow the header (FWU-006)."""
    return [take(image[32 + 48 * place : 80 + 48 * place], SEGMENT_ENTRY) for place in range(image[5])]


def judge_header(image: bytes) -> int:
    """The reasons from LENGTH to OFFSET, which need no more than header and table (FWU-015)."""
    if len(image) < 32 or len(image) < 32 + 48 * image[5]:  # FWU-001
        return 2
    header, table = take(image, IMAGE_HEADER), segment_table(image)
    if header["magic"] != b"PWFW":
        return 3
    if header["version"] != 1:
        return 4
    if header["checksum"] != crc(image[:28] + image[32 : 32 + 48 * len(table)]):  # FWU-003
        return 5
    firmware_reserved = header["major"] > 99 or header["minor"] > 9 or header["patch"] > 9 or header["protocol"] == 0
    if firmware_reserved or header["reserved"] != 0 or any(entry["reserved"] for entry in table):  # FWU-004
        return 6
    if header["hardware"] != 1:  # FWU-005
        return 7
    if [entry["target"] for entry in table] not in ([10, 11], [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 11]):  # FWU-007
        return 8
    if any(not 1 <= entry["size"] <= 65536 for entry in table):  # FWU-008
        return 9
    place = 32 + 48 * len(table)
    for entry in table:  # FWU-009
        if entry["offset"] != place:
            return 10
        place = multiple_of_4(place + entry["size"])
    return 0 if header["total"] == place + 64 else 10


def judge_content(image: bytes) -> int:
    """TOTAL, PADDING and HASH of an image whose header is good (FWU-009, FWU-010, FWU-015)."""
    table = segment_table(image)
    if len(image) != number(image, 12, 4):
        return 11
    for entry in table:
        end = entry["offset"] + entry["size"]
        if any(image[end : multiple_of_4(end)]):
            return 12
    for entry in table:
        segment = image[entry["offset"] : entry["offset"] + entry["size"]]
        if entry["checksum"] != crc(segment) or entry["digest"] != hashlib.sha256(segment).digest():
            return 13
    return 0


def signature_of(image: bytes, keys: Sequence[bytes]) -> str:
    """One of trusted, unknown, unsigned, wrong (FWU-011, FWU-012)."""
    key_id, signature = image[16:24], image[-64:]
    if key_id == bytes(8):
        return "unsigned" if signature == bytes(64) else "wrong"
    for key in keys:
        if hashlib.sha256(key).digest()[:8] == key_id:
            try:
                Ed25519PublicKey.from_public_bytes(key).verify(signature, image[:-64])
            except InvalidSignature:
                return "wrong"
            return "trusted"
    return "unknown"


def judge_image(image: bytes, keys: Sequence[bytes] = ()) -> int:
    """The first reason that fails, for a device that trusts these keys (FWU-015, FWU-012)."""
    reason = judge_header(image) or judge_content(image)
    if reason:
        return reason
    signed = signature_of(image, keys)
    if signed == "wrong" or (keys and signed != "trusted"):
        return 14
    return 0


def suffix_of(image: bytes, release: int = 0xFFFF, product: int = 0xFFFF, vendor: int = 0xFFFF) -> bytes:
    """The 16 bytes of the DFU suffix; its checksum is the complement of zlib's (FWU-014)."""
    suffix = struct.pack("<HHHH", release, product, vendor, 0x0100) + b"UFD" + b"\x10"
    return suffix + (crc(image + suffix) ^ 0xFFFFFFFF).to_bytes(4, "little")


def judge_file(file: bytes, keys: Sequence[bytes] = ()) -> int:
    """The first reason that fails, SUFFIX before all others (FWU-014, FWU-015)."""
    image, suffix = file[:-16], file[-16:]
    if len(suffix) != 16 or suffix[6:8] != b"\x00\x01" or suffix[8:12] != b"UFD\x10":
        return 1
    if number(suffix, 12, 4) != crc(file[:-4]) ^ 0xFFFFFFFF:
        return 1
    return judge_image(image, keys)


BOOT_RECORD = layout_of("BOOT_RECORD")
"""The record at the beginning of a bank (FWU-017)."""


def read_boot_record(data: bytes) -> Fields | None:
    """The record, or None if the bank is empty; a mark counts as soon as one bit is 0 (FWU-017, FWU-020)."""
    record = take(data[:56], BOOT_RECORD)
    if len(data) < 56 or record["magic"] != b"PWBR" or not 1 <= record["size"] <= 721520:
        return None
    if record["checksum"] != crc(data[:44]):
        return None
    started, confirmed = (record[mark] != 0xFFFFFFFF for mark in ("started", "confirmed"))
    return {
        "generation": record["generation"],
        "size": record["size"],
        "digest": record["digest"],
        "started": started,
        "confirmed": confirmed,
    }


def may_boot(record: Fields | None) -> bool:
    """An image that was started and never confirmed may not boot again (FWU-020)."""
    return record is not None and (record["confirmed"] or not record["started"])


def newer(generation_g: int, generation_h: int) -> bool:
    """Whether generation g is newer than h (FWU-019)."""
    return 0 < (generation_g - generation_h) % 2**32 < 2**31


def banks_to_try(bank_a: Fields | None, bank_b: Fields | None) -> list[str]:
    """A and B if they may boot, the newer first, A if neither is newer; the factory image last (FWU-019)."""
    order = []
    if bank_a is not None and may_boot(bank_a):
        order.append("A")
    if bank_b is not None and may_boot(bank_b):
        order.append("B")
    if bank_a is not None and bank_b is not None and len(order) == 2:
        order = ["B", "A"] if newer(bank_b["generation"], bank_a["generation"]) else ["A", "B"]
    return [*order, "FACTORY"]


# Chapter DFU

DFU_STATES = tuple(codes("DfuState"))
DFU_HAPPENINGS = ("REATTACHED", "POLL_TIMEOUT", "FAILURE", "BUS_RESET")

DFU_WORKING = set(DFU_STATES) - {"APP_IDLE", "APP_DETACH", "ERROR"}
DFU_DRAWN = {
    (state, event): following
    for before, following, event in re.findall(r"(\w+) --> (\w+): (\w+)", SPEC.split("**DFU-006**")[1].split("```")[1])
    for state in (DFU_WORKING if before == "WORKING" else {before})
}
"""The arrows of DFU-006, those of the state WORKING for each state in it."""


def dfu_after(state: str, event: str) -> tuple[str, bool]:
    """The next state, and whether the request is answered with STALL (DFU-006)."""
    if (state, event) in DFU_DRAWN:
        return DFU_DRAWN[state, event], False
    if event in DFU_HAPPENINGS:
        return state, False
    deaf = state in ("DNBUSY", "MANIFEST", "MANIFEST_WAIT_RESET")
    if event in ("GETSTATUS", "GETSTATUS_BUSY", "GETSTATE") and not deaf:
        return state, False
    return ("APP_IDLE" if state in ("APP_IDLE", "APP_DETACH") else "ERROR"), True


def dfu_poll_ms(block: int) -> int:
    """How long the writing of a block takes: sectors of 60 ms, eight pages of 1 ms (DFU-008)."""
    sectors = 2 if block == 0 else 1 if block % 2 == 0 else 0
    return 60 * sectors + 8


def dfu_judge_block(block: int, length: int, received: int, total: int) -> str:
    """The status of a DNLOAD in a download of which this much has come (DFU-009).

    Assumed: the number of the block that ends the download is not looked at, as the clause says.
    """
    if length == 0:
        return "OK" if received == total else "NOTDONE"
    if block * 2048 != received or received + length > total:
        return "ADDRESS"
    return "OK" if length == 2048 or received + length == total else "ADDRESS"


def dfu_status_of(reason: int) -> tuple[str, int]:
    """Status and string for an image that was refused for a reason of FWU-015 (DFU-012)."""
    if reason == 0:
        return "OK", 0
    return ("TARGET" if IMAGE_REASONS[reason] in ("MAGIC", "HARDWARE") else "FILE"), 16 + reason
