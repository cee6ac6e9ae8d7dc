"""Every decoder, with any bytes: it makes a value that encodes back to the same bytes, or refuses them.

Each function of `GROUPS` takes bytes, gives them to decoders as they would arrive, and fails if one of
them raises an undocumented error, if bytes change on their way through a value, or if two decoders of
the same bytes disagree. Bytes with a corrected checksum are tried too: no fuzzer guesses a CRC-32.

`seeds` gives the first inputs of a fuzzer: the golden vectors. `python -m tests.fuzz` runs the fuzzer, and
test_decoders.py tries the seeds themselves.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from cobs import cobs
from construct import Construct, ConstructError
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from phasewire.base.errors import (
    BlockError,
    ChainError,
    CommandError,
    FrameError,
    ImageError,
    InputFileError,
    PhasewireError,
    ReplyError,
)
from phasewire.hil.traffic.recordings import FORMATS, read_recording
from phasewire.protocol import Kind, Reason, Update, framing, pack, unpack, unpack_updates
from phasewire.protocol import chain as chain_
from phasewire.protocol import describe as describe_
from phasewire.protocol import descriptors as descriptors_
from phasewire.protocol.codes import ChannelEnd
from phasewire.protocol.console import LineEditor, parse_command
from phasewire.protocol.dfu import DfuReply
from phasewire.protocol.firmware import (
    BootRecord,
    Image,
    ImageHeader,
    boot_order,
    parse,
    split_suffix,
    trust,
    with_suffix,
)
from phasewire.protocol.layout import chain as chain_layouts
from phasewire.protocol.layout import firmware as firmware_layouts
from phasewire.protocol.layout.serial import FRAME
from phasewire.protocol.replies import (
    Ack,
    ClockReading,
    Info,
    ReadBack,
    Status,
    decode_acks,
    decode_reports,
    decode_wiring,
    encode_reports,
    encode_wiring,
    records,
)

from tests.captures import bulk_in, bulk_out, pcap, pcapng
from tests.from_spec import seal_block
from tests.fuzz.readers import READERS, reader_seeds
from tests.protocol.blocks import reason_by_construct

__all__ = ["GROUPS", "seeds"]

VECTORS: dict[str, Any] = json.loads((Path(__file__).parents[2] / "protocol" / "vectors.json").read_text("ascii"))


def round_trip(
    decode: Callable[[bytes], Any], encode: Callable[[Any], bytes], refusal: type[PhasewireError], data: bytes
) -> bool:
    """Whether bytes are accepted; they must then come back as they were."""
    try:
        value = decode(data)
    except refusal:
        return False
    assert encode(value) == data, f"{data.hex()} became {encode(value).hex()}"
    return True


def parses(definition: Construct, data: bytes) -> bool:
    """Whether construct accepts bytes."""
    try:
        definition.parse(data)
    except ConstructError:
        return False
    return True


def sealed(data: bytes) -> bytes:
    """Bytes, and their CRC-32."""
    return data + zlib.crc32(data).to_bytes(4, "little")


def fitted(data: bytes, size: int) -> bytes:
    """Bytes cut or filled up to a size."""
    return data[:size].ljust(size, b"\0")


# Blocks


def blocks(data: bytes) -> None:
    """Blocks: three judges agree."""
    for block in (data, fitted(data, 512), seal_block(fitted(data, 512))):
        _judge(block)


def _judge(block: bytes) -> None:
    try:
        read = unpack(block)
        assert pack(read) == block
        reason = Reason.ACCEPTED
    except BlockError as error:
        reason = Reason(error.reason)
    assert reason_by_construct(block) is reason
    if len(block) == 512:
        batch = unpack_updates(np.frombuffer(block, np.uint8).reshape(1, 512))
        in_head = reason in (Reason.CHECKSUM, Reason.MAGIC, Reason.VERSION, Reason.KIND)
        assert batch.reason[0] == (reason if in_head or block[3] == Kind.UPDATE else Reason.KIND)
        if batch.reason[0] == Reason.ACCEPTED:
            assert isinstance(read.body, Update)
            assert read.body.pulses.phase.tolist() == batch.phase[0].tolist()
            assert read.body.pulses.width.tolist() == batch.width[0].tolist()
            assert (read.body.period, *read[1:]) == (batch.period[0], batch.sequence[0], batch.restart[0])


# Records and answers


def replies(data: bytes) -> None:
    """Records, and the answers to control requests."""
    for record in (Ack, Status):
        for piece in (data, fitted(data, record.BYTES), sealed(fitted(data, record.BYTES - 4))):
            round_trip(record.decode, record.encode, ReplyError, piece)
    for packet in (data, sealed(fitted(data, 28)) + sealed(fitted(data[28:], 60))):
        round_trip(records, lambda found: b"".join(record.encode() for record in found), ReplyError, packet)
    for packet in (data, fitted(data, 64), sealed(fitted(data, 28)) + sealed(fitted(data[28:], 28))):
        _acks_at_once(packet)
    for answer in (Info, ClockReading, ReadBack):
        for piece in (data, fitted(data, answer.BYTES)):
            round_trip(answer.decode, answer.encode, ReplyError, piece)
    for piece in (data, fitted(data, 160)):
        round_trip(decode_reports, encode_reports, ReplyError, piece)
    for piece in (data, fitted(data, 640)):
        round_trip(decode_wiring, encode_wiring, ReplyError, piece)


def _acks_at_once(packets: bytes) -> None:
    """Only whole acknowledgements are accepted, with the result of one by one."""
    acks: list[Ack] | None = None
    with suppress(ReplyError):
        acks = [record for record in records(packets) if isinstance(record, Ack)]
    try:
        found = decode_acks(packets)
    except ReplyError:
        assert acks is None or Ack.BYTES * len(acks) != len(packets)
        return
    assert acks is not None
    assert [{name: row[name] for name in vars(ack)} for row, ack in zip(found, acks, strict=True)] == list(
        map(vars, acks)
    )


# The chain


def chain(data: bytes) -> None:
    """Messages: the decoder and the layout of the channel end agree."""
    for tokens in (data, data + b"\1", sealed(data) + b"\1"):
        accepted = round_trip(chain_.decode, chain_.Message.encode, ChainError, tokens)
        end = tokens[2] if len(tokens) > 2 else 0
        assert accepted == (end in LAYOUTS and parses(LAYOUTS[end], tokens))


LAYOUTS = {end.value: getattr(chain_layouts, end.name) for end in ChannelEnd}


# Serial lines


def serial(data: bytes) -> None:
    """Frames one by one, in a stream however it is cut, and on a line that text shares."""
    for frame in (data.removesuffix(b"\0") + b"\0", cobs.encode(sealed(data)) + b"\0"):
        accepted = round_trip(framing.decode, framing.encode, FrameError, frame)
        if len(frame) <= framing.MAX_FRAME_BYTES and frame.index(0) == len(frame) - 1:
            assert accepted == parses(FRAME, frame)
    round_trip(framing.SerialRequest.decode, framing.SerialRequest.encode, FrameError, data)
    round_trip(framing.SerialReply.decode, framing.SerialReply.encode, FrameError, data)

    reader, line = framing.FrameReader(), framing.LineReader()
    whole = framing.FrameReader().feed(data)
    assert [str(found) for piece in pieces(data) for found in reader.feed(piece)] == [str(found) for found in whole]
    assert joined(event for piece in pieces(data) for event in line.feed(piece)) == joined(
        framing.LineReader().feed(data)
    )
    assert len(reader.cut()) <= 1
    assert line.hang_up()[-1] is framing.LineMode.CONSOLE


def pieces(data: bytes) -> list[bytes]:
    """The same bytes in pieces; the bytes themselves give the lengths."""
    found, at = [], 0
    while at < len(data):
        size = 1 + data[at] % 61
        found.append(data[at : at + size])
        at += size
    return found


def joined(events: Iterable[framing.LineEvent]) -> list[object]:
    """Events, with adjacent text joined."""
    found: list[object] = []
    for event in events:
        if isinstance(event, bytes) and found and isinstance(found[-1], bytes):
            found[-1] += event
        else:
            found.append(str(event) if isinstance(event, FrameError) else event)
    return found


def console(data: bytes) -> None:
    """Typed bytes become lines, and lines become commands that encode to the same line."""
    editor, once = LineEditor(), LineEditor().feed(data)
    parts = [editor.feed(piece) for piece in pieces(data)]
    assert ([line for lines, _ in parts for line in lines], b"".join(shown for _, shown in parts)) == once
    assert LineEditor(echo=False).feed(data) == (once[0], b"")
    for text in (*once[0], data.decode("latin-1"), data.decode("utf-8", errors="replace")):
        try:
            command = parse_command(text)
        except CommandError:
            continue
        if command is not None:
            name, argument = command
            assert parse_command(name if argument is None else f"{name} {argument}") == command


# Firmware

TRUSTED = Ed25519PublicKey.from_public_bytes(bytes.fromhex(VECTORS["test_keys"]["vectors"][0]["public_key"]))


def firmware(data: bytes) -> None:
    """Images, files, boot records and DFU's answers."""
    for image in (data, image_resealed(data)):
        accepted = round_trip(Image.decode, Image.encode, ImageError, image)
        assert accepted == parses(firmware_layouts.IMAGE, image)
        round_trip(split_suffix, lambda split: with_suffix(*split), ImageError, image)
        assert round_trip(split_suffix, lambda split: with_suffix(*split), ImageError, with_suffix(image, ANY))
        for read in (ImageHeader.decode, parse, lambda image: trust(Image.decode(image), [TRUSTED])):
            with suppress(ImageError):
                read(image)
    for record in (data, fitted(data, 56), sealed(fitted(data, 44)) + fitted(data[44:], 8)):
        found = BootRecord.decode(record)
        assert found is None or found.encode() == record
    assert boot_order(fitted(data, 56), fitted(data[56:], 56))[-1].name == "FACTORY"
    for reply in (data, fitted(data, 6)):
        round_trip(DfuReply.decode, DfuReply.encode, ReplyError, reply)


ANY = split_suffix(bytes.fromhex(VECTORS["images"]["vectors"][0]["hex"]))[1]


def image_resealed(data: bytes) -> bytes:
    """An image whose checksums and hashes are right, whatever else is wrong with it."""
    image = bytearray(fitted(data, max(len(data), 32)))
    for at in range(32, min(32 + 48 * image[5], len(image) - 47), 48):
        offset, size = struct.unpack_from("<II", image, at + 4)
        segment = image[offset : offset + size]
        struct.pack_into("<I32s", image, at + 12, zlib.crc32(segment), sha256(segment).digest())
    table = image[32 : 32 + 48 * image[5]]
    struct.pack_into("<I", image, 28, zlib.crc32(table, zlib.crc32(image[:28])))
    return bytes(image)


# USB


def descriptors(data: bytes) -> None:
    """Chains of descriptors."""
    for read in (descriptors_.descriptors, descriptors_.ms_os_descriptors):
        round_trip(read, lambda found: descriptors_.encode(*found), ReplyError, data)
    for piece in (data, bytes([(2 + len(data)) % 256, 3]) + data):
        round_trip(descriptors_.Languages.decode, descriptors_.Languages.encode, ReplyError, piece)
        round_trip(descriptors_.String.decode, descriptors_.String.encode, ReplyError, piece)


# Descriptions of traffic


def describe(data: bytes) -> None:
    """Descriptions accept any bytes."""
    for said in (
        describe_.describe_block(data),
        describe_.describe_block(seal_block(fitted(data, 512))),
        describe_.describe_record(data),
        describe_.describe_frame(data),
        describe_.describe_frame(cobs.encode(sealed(data))),
        describe_.describe_message(data),
        describe_.describe_message(sealed(data) + b"\1"),
        describe_.describe_image(data),
        describe_.describe_text(data),
        describe_.describe_request(data),
        describe_.describe_request(data[:8], data[8:]),
        describe_.describe_request(data[:8], None),
        describe_.describe_request(data[:8], data[8:], stalled=True),
    ):
        assert said.kind
        json.dumps(dict(said.fields), allow_nan=False)
        assert "\n" not in said.summary
        assert all("\n" not in finding.text for finding in said.findings)


def recordings(data: bytes) -> None:
    """Recordings in every format."""
    for form in ("auto", *FORMATS):
        try:
            found = list(read_recording(BytesIO(data), "recording", form))
        except InputFileError:
            continue
        if form == "blocks":
            assert b"".join(piece.data for piece in found) == data


GROUPS: dict[str, Callable[[bytes], None]] = {
    group.__name__: group
    for group in (blocks, replies, chain, serial, console, firmware, descriptors, describe, recordings)
} | READERS


def _hex(*parts: str, key: str = "hex") -> list[bytes]:
    return [bytes.fromhex(case[key]) for part in parts for case in VECTORS[part]["vectors"] if case.get(key)]


@cache
def seeds(group: str) -> tuple[bytes, ...]:
    """The first inputs of a group's fuzzer."""
    if group in READERS:
        return tuple(reader_seeds(group, _hex("images", "refused_images")))
    packets = _hex("packets", "blocks")
    requests = [
        setup + data for setup, data in zip(_hex("descriptors", key="setup"), _hex("descriptors"), strict=False)
    ]
    found = {
        "blocks": _hex("blocks", "refused_blocks"),
        "replies": _hex("records", "refused_records", "packets", "refused_packets", "answers", "refused_answers"),
        "chain": _hex("chain_messages", "refused_chain_messages"),
        "serial": [*_hex("frames", "refused_frames", "streams"), *_hex("frames", key="body")],
        "console": [
            *_hex("typing", key="typed"),
            *(case["line"].encode() + b"\r" for case in VECTORS["commands"]["vectors"]),
        ],
        "firmware": [*_hex("images", "refused_images", "signatures", "boot_records", "dfu_replies")],
        "descriptors": _hex("descriptors"),
        "describe": [*_hex("requests", "records", "chain_messages", "frames", "blocks", "images"), *requests],
        "recordings": [
            *packets,
            b"".join(packets),
            *_hex("streams", "images", "chain_messages"),
            packets[0].hex(" ").encode(),
            *(write(bulk_out(1, packets[-1]) + bulk_in(2, packets[0])) for write in (pcap, pcapng)),
        ],
    }
    return tuple(found[group])
