from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Wiring
from phasewire.base.errors import BlockError
from phasewire.protocol import Ack, Block, Info, Pulses, Status, pack, unpack
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.chain import Collect, Commit, Slice
from phasewire.protocol.codes import (
    AckFlag,
    Action,
    Bank,
    ChannelEnd,
    Fault,
    Feature,
    FrameKind,
    Outcome,
    Reason,
    Request,
    State,
    StatusFlag,
    Target,
)
from phasewire.protocol.describe import (
    Description,
    Violation,
    describe_block,
    describe_frame,
    describe_image,
    describe_message,
    describe_record,
    describe_request,
    describe_text,
)
from phasewire.protocol.enumeration import run_time
from phasewire.protocol.firmware import Image, Segment, build
from phasewire.protocol.framing import CONSOLE_FRAME, SerialFrame, SerialReply, SerialRequest, encode
from phasewire.protocol.replies import ClockReading, ProcessorReport, ReadBack, encode_reports, encode_wiring
from phasewire.protocol.versions import Version

from tests.specification import SPEC, clauses
from tests.strategies import update

# One pulse of the full width, one of 30 degrees: sin²(30°) = 1/4. Together 1.25 fully driven transducers.
WIDTH = np.zeros(320, int)
WIDTH[:2] = 25, 0
WIDTH[7] = 8
TWO = Pulses(np.zeros(320, int), WIDTH)
SILENT = Pulses.silent(320)


def resealed(block: bytes | bytearray) -> bytes:
    """The block with its CRC-32 made right again, over the whole with 0 in its place."""
    cleared = bytes(block[:28]) + bytes(4) + bytes(block[32:])
    return cleared[:28] + struct.pack("<I", zlib.crc32(cleared)) + cleared[32:]


@pytest.mark.parametrize(
    ("body", "summary", "fields"),
    [
        (Update(SILENT), "UPDATE 7: silence as soon as possible", {"period": 0}),
        (Update(TWO, 90), "UPDATE 7: 2 pulses of at most 25 ticks, total drive 1.2, from period 90 on", {"period": 90}),
        (Slot(3, SILENT), "SLOT 7: silence into slot 3", {"number": 3}),
        (
            Entries((Entry(1, 100), Entry(2, 50)), 10),
            "ENTRIES 7: store entries 10 to 11",
            {"first": 10, "entries": [[1, 100], [2, 50]]},
        ),
        (
            PlaySequence(0, 2, 40),
            "SEQUENCE 7: play entries 0 to 1 from period 40 on, until something else follows",
            {"first": 0, "count": 2, "period": 40, "repeats": 0, "unattended": False},
        ),
        (
            PlaySequence(1, 1, 0, 5, unattended=True),
            "SEQUENCE 7: play entries 1 to 1 as soon as possible, 5 times, also without the host",
            {"repeats": 5, "unattended": True},
        ),
        (Samples(b"\1\xff", 4), "SAMPLES 7: store samples 4 to 5", {"first": 4, "samples": "01ff"}),
        (
            AmplitudeModulation(0, 10, 3),
            "MODULATION 7: modulate with samples 0 to 9 as soon as possible, 3 periods each",
            {"hold": 3},
        ),
        (Output(Action.SILENCE, 8), "OUTPUT 7: SILENCE from period 8 on", {"action": "SILENCE", "period": 8}),
        (Clock(), "CLOCK 7: tell the time", {}),
        (NoOp(), "NO_OP 7: a sign of life", {}),
    ],
)
def test_descriptions_of_valid_blocks(body: Body, summary: str, fields: dict[str, Any]) -> None:
    described = describe_block(pack(Block(body, 7)))
    assert (described.kind, described.summary, described.valid) == ("block", summary, True)
    assert dict(described.fields) | fields == described.fields
    assert (described.fields["kind"], described.fields["sequence"]) == (body.KIND.name, 7)


def changed(at: int, value: int) -> bytes:
    block = bytearray(update(SILENT, 7, 90))
    block[at] = value
    return resealed(block)


@given(st.binary(max_size=600) | st.binary(min_size=510, max_size=510).map(lambda rest: resealed(b"PW" + rest)))
def test_a_block_is_valid_exactly_when_it_can_be_unpacked(data: bytes) -> None:
    try:
        unpack(data)
    except BlockError as error:
        reasons = [Reason(error.reason).name]
    else:
        reasons = []
    assert [finding.reason for finding in describe_block(data).findings] == reasons


ACK = Ack(Reason.ACCEPTED, 7, 300, 14_000, AckFlag(0), 3, State.PLAYING)


def test_descriptions_of_acknowledgements() -> None:
    described = describe_record(ACK.encode())
    assert described.kind == "acknowledgement"
    assert described.summary == "7 accepted, period 300; PLAYING at tick 14000, room for 3"
    refused = Ack(Reason.DRIVE, 8, 0, 1, AckFlag.GAP | AckFlag.LATE, 0, State.READY)
    described = describe_record(refused.encode())
    assert (
        described.summary
        == "8 refused, DRIVE: the total drive is above the limit, LATE, GAP; READY at tick 1, room for 0"
    )
    assert described.valid  # the record is; the block was not
    assert described.fields["reason"] == "DRIVE"
    assert described.fields["flags"] == ["LATE", "GAP"]


def test_a_description_names_a_broken_field() -> None:
    body = b"PA\1\x63" + ACK.encode()[4:28]
    (finding,) = describe_record(body + struct.pack("<I", zlib.crc32(body))).findings
    assert finding.text.startswith("reason: ")


def setup(kind: int, request: int, value: int = 0, index: int = 0, length: int = 0) -> bytes:
    return struct.pack("<BBHHH", kind, request, value, index, length)


INFO = Info(
    oldest_version=1,
    newest_version=1,
    hardware=1,
    firmware=(0, 3, 9),
    boards=5,
    unique_id=b"abcdefgh",
    carrier_hz=40_000,
    features=Feature.CONSOLE | Feature.DFU,
    channels=320,
    columns=20,
    rows=16,
    pitch_um=10_500,
    processors_per_board=2,
    ticks_per_period=50,
    max_width_ticks=25,
    link_wires=5,
    cycles_per_symbol=2,
    queue_blocks=8,
    periods_per_update=1,
    queue_records=8,
    slots=256,
    sequence_entries=1024,
    modulation_samples=4096,
    drive_limit=320,
    watchdog_ms=100,
)
STATUS = Status(
    State.READY,
    Fault.CHAIN | Fault.SUPPLY,
    Reason.ACCEPTED,
    StatusFlag(0),
    now=5000,
    since_period=0,
    accepted=6,
    refused=5,
    late=4,
    lost=3,
    missed_commits=2,
    damaged_messages=1,
    free=8,
    temperature_c=30,
    watchdog_ms=100,
    drive_limit=320,
    dropped_frames=0,
)
REPORTS = [ProcessorReport(Fault(n == 9), 30, Bank.FACTORY, 0, 0, (0, 3, 9)) for n in range(10)]


@pytest.mark.parametrize(
    ("request_", "answer", "summary"),
    [
        (Request.INFO, INFO.encode(), "INFO: firmware 0.3.9, 5 boards, 320 transducers, CONSOLE, DFU"),
        (
            Request.STATUS,
            STATUS.encode(),
            "STATUS: READY at tick 5000 (period 100), CHAIN, SUPPLY; 6 accepted, 5 refused, 4 late, 3 lost, "
            "2 commits missed; watchdog of 100 ms, drive limit 320, since period 0, room for 8",
        ),
        (
            Request.WIRING,
            encode_wiring(Wiring(np.arange(320))),
            "WIRING: transducer 0 on channel 0, the last on channel 319",
        ),
        (
            Request.CLOCK,
            ClockReading(9, 8, 7).encode(),
            "CLOCK: tick 9, 7 sync pulses, the last in period 8",
        ),
        (Request.PULSES, ReadBack(4, 5, SILENT).encode(), "PULSES: silence since period 4"),
        (
            Request.PROCESSORS,
            encode_reports(REPORTS),
            "PROCESSORS: well, well, well, well, well, well, well, well, well, fault",
        ),
    ],
)
def test_requests_are_described_with_their_answer(request_: Request, answer: bytes, summary: str) -> None:
    described = describe_request(setup(0xC1, request_, length=len(answer)), answer)
    assert (described.kind, described.summary, described.findings) == ("request", summary, ())
    assert described.fields["name"] == request_.name
    cut = describe_request(setup(0xC1, request_, length=10), answer[:10])
    assert cut.summary == f"{request_.name}: the first 10 of {len(answer)} bytes"
    assert cut.valid
    (finding,) = describe_request(setup(0xC1, request_, length=len(answer)), answer[:10]).findings
    assert f"**{finding.clause}** {request_.name} answers" in SPEC


@pytest.mark.parametrize(("request_", "value"), [("WATCHDOG", 9), ("LIMIT", 321), ("IDENTIFY", 5)])
def test_a_wrong_value_breaks_the_clause_of_its_request(request_: str, value: int) -> None:
    (finding,) = describe_request(setup(0x41, Request[request_], value)).findings
    assert f"**{finding.clause}** {request_} " in SPEC


@pytest.mark.parametrize(
    ("setup_stage", "summary", "text"),
    [
        (setup(0x41, Request.ENABLE), "ENABLE", ""),
        (setup(0x41, Request.WATCHDOG, 500), "WATCHDOG 500", ""),
        (setup(0x41, Request.LIMIT, 320), "LIMIT 320", ""),
        (setup(0x41, Request.IDENTIFY, 4), "IDENTIFY 4", ""),
        (setup(0x41, Request.ENABLE, 1), "ENABLE", "value 1 should be 0"),
        (setup(0x41, Request.ENABLE, 0, 1), "ENABLE", "index 1 should be 0"),
        (setup(0x41, Request.ENABLE, 0, 0, 3), "ENABLE", "3 bytes are announced; ENABLE carries none"),
        (setup(0x41, Request.WATCHDOG, 9), "WATCHDOG 9", "value 9 should be 10 to 60000"),
        (setup(0x41, Request.LIMIT, 321), "LIMIT 321", "value 321 should be 0 to 320"),
        (setup(0x41, Request.IDENTIFY, 5), "IDENTIFY 5", "value 5 should be 0 to 4"),
        (setup(0xC1, Request.ENABLE), "ENABLE", "type c1 should be 41: ENABLE goes that way"),
        (setup(0x41, Request.STATUS), "STATUS", "type 41 should be c1: STATUS goes that way"),
        (setup(0xC1, 99), "99?", "unknown request 99"),
    ],
)
def test_wrong_setup_stages_are_found(setup_stage: bytes, summary: str, text: str) -> None:
    for stalled in (False, True):
        described = describe_request(setup_stage, b"", stalled=stalled)
        assert described.summary == summary + ", answered with STALL" * stalled
        assert [finding.text for finding in described.findings] == ([text] if text else [])
        assert described.fields["stalled"] == stalled


def test_a_request_is_described_without_its_data_too() -> None:
    for described in (
        describe_request(setup(0xC1, Request.INFO, length=64)),
        describe_request(setup(0xC1, Request.INFO, length=64), b"", stalled=True),
    ):
        assert described.summary.startswith("INFO")
        assert described.valid


DEVICE = run_time((1, 2, 3), "array", "X1")


@pytest.mark.parametrize(
    ("stage", "data", "summary"),
    [
        (setup(0x80, 6, 0x0100, 0, 18), DEVICE.device.encode(), "GET_DESCRIPTOR DEVICE: 1209:0001, release 0123"),
        (setup(0x80, 6, 0x0200, 0, 9), DEVICE.configuration[:9], "GET_DESCRIPTOR CONFIGURATION: Configuration"),
        (setup(0x80, 6, 0x0300, 0, 255), bytes.fromhex("04030904"), "GET_DESCRIPTOR STRING: 0409"),
        (setup(0x80, 6, 0x0303, 0x0409, 255), bytes.fromhex("060358003100"), "GET_DESCRIPTOR STRING 3: 'X1'"),
        (
            setup(0x80, 6, 0x0100, 0, 8),
            DEVICE.device.encode()[:8],
            "GET_DESCRIPTOR DEVICE: 8 bytes: 12 01 01 02 ef 02 01 40",
        ),
        (setup(0x80, 6, 0x2A00, 0, 8), b"", "GET_DESCRIPTOR 42?"),
        (setup(0x00, 9, 1), b"", "SET_CONFIGURATION 0x1"),
        (setup(0x02, 1, 0, 0x81), b"", "CLEAR_FEATURE 0x0 of 0x81"),
        (setup(0x80, 8, 0, 0, 1), b"\1", "GET_CONFIGURATION 0x0: 01"),
        (setup(0x21, 0x22, 3, 1), b"", "SET_CONTROL_LINE_STATE 0x3"),
        (setup(0xA1, 0x21, 0, 1, 7), bytes(7), "GET_LINE_CODING 0x0: 00 00 00 00 00 00 00"),
        (setup(0x21, 1, 5, 0, 6), b"abcdef", "DNLOAD block 5, 6 bytes: 61 62 63 64 …"),
        (setup(0xA1, 3, 0, 0, 6), bytes.fromhex("008000000400"), "GETSTATUS: DNBUSY, OK, wait 128 ms"),
        (setup(0xA1, 5, 0, 0, 1), b"\5", "GETSTATE: DNLOAD_IDLE"),
        (setup(0x21, 0, 1000, 3), b"", "DETACH"),
        (setup(0xA1, 0x21, 0, 9, 7), b"\1\2", "a1 21, value 0000, index 0009, 2 bytes: 01 02"),
    ],
)
def test_other_requests_are_described_too(stage: bytes, data: bytes, summary: str) -> None:
    described = describe_request(stage, data)
    assert (described.summary, described.findings) == (summary, ())


def test_descriptors_are_described() -> None:
    described = describe_request(setup(0x80, 6, 0x0200, 0, 999), DEVICE.configuration)
    kinds = [each["descriptor"] for each in described.fields["descriptors"]]
    assert kinds[:4] == ["Configuration", "Interface", "Endpoint", "Endpoint"]
    assert described.fields["descriptors"][2]["bEndpointAddress"] == 1
    described = describe_request(setup(0xC0, 0x20, 0, 7, 999), DEVICE.ms_os)
    assert described.fields["descriptors"][0]["descriptor"] == "MsOsSetHeader"
    broken = describe_request(setup(0x80, 6, 0x0100, 0, 99), DEVICE.device.encode()[:-1])
    assert [finding.clause for finding in broken.findings] == ["USB-006"]


def frame(kind: FrameKind, body: bytes) -> Description:
    return describe_frame(encode(SerialFrame(kind, body))[:-1])


def test_frames_are_described_by_their_content() -> None:
    block = update(TWO, 7)
    assert frame(FrameKind.BLOCK, block).summary == describe_block(block).summary
    assert frame(FrameKind.BLOCK, bytes(512)).findings == describe_block(bytes(512)).findings
    assert frame(FrameKind.RECORD, ACK.encode()) == describe_record(ACK.encode())
    asked = frame(FrameKind.REQUEST, SerialRequest(9, 0xC1, Request.INFO, 0, 0, 64).encode())
    assert (asked.kind, asked.summary, asked.fields["tag"], asked.valid) == ("request", "INFO", 9, True)
    wrong = frame(FrameKind.REQUEST, SerialRequest(9, 0x41, Request.WATCHDOG, 1).encode())
    assert [finding.text for finding in wrong.findings] == ["value 1 should be 10 to 60000"]
    reply = frame(FrameKind.REPLY, SerialReply(9, Outcome.DONE, b"\1\2").encode())
    assert (reply.kind, reply.summary) == ("reply", "to request 9: DONE, 2 bytes: 01 02")
    assert describe_frame(encode(CONSOLE_FRAME)[:-1]).summary == "back to the console"


def test_messages_of_the_chain_are_described() -> None:
    described = describe_message(Commit(3, 90, 0x1234).encode())
    assert described.summary == "COMMIT: processor 3, period 90, checksum 4660"
    assert described.fields == {"name": "COMMIT", "node": 3, "processor": 3, "period": 90, "checksum": 4660}
    assert describe_message(Collect(1, ChannelEnd.REPORT).encode()).summary == "COLLECT: processor 1, answer REPORT"
    assert "packed 48 bytes: 00" in describe_message(Slice(0, bytes(48)).encode()).summary
    (finding,) = describe_message(Commit(3, 90, 0x1234).encode()[1:]).findings  # to channel end 90
    assert finding.clause == "CHN-009"


def test_firmware_images_are_described() -> None:
    key = Ed25519PrivateKey.from_private_bytes(bytes(32))
    segments = (Segment(Target.ALL_PROCESSORS, b"abc"), Segment(Target.CONTROLLER, b"defgh"))
    image = Image(Version(1, 2, 3), segments)
    described = describe_image(build(image))
    assert described.summary == "version 1.2.3 for FIVE_BOARDS, 2 segments, not signed"
    assert described.fields["segments"] == [
        {"target": "ALL_PROCESSORS", "bytes": 3},
        {"target": "CONTROLLER", "bytes": 5},
    ]
    assert described.valid
    assert "signed with key " in describe_image(build(image, key)).summary
    (finding,) = describe_image(image.encode()).findings
    assert (finding.reason, finding.clause) == ("SUFFIX", "FWU-014")


def test_text_is_shown_on_one_line() -> None:
    assert describe_text(b"info\r\n\x1b[31m\xff").summary == "info\\r\\n\\x1b[31m\\xff"
    assert describe_text(b"\\xff").summary == "\\\\xff"
    assert describe_text(bytes(range(256))).fields["text"].encode("latin-1") == bytes(range(256))


def test_the_named_clauses_exist() -> None:
    found: set[Violation] = {
        *describe_block(b"").findings,
        *describe_record(b"").findings,
        *describe_record(b"PS").findings,
        *describe_request(b"").findings,
        *describe_request(setup(0xC1, 99)).findings,
        *describe_request(setup(0x80, 6, 0x0100, 0, 99), b"\1").findings,
        *describe_request(setup(0xC0, 0x20, 0, 7, 99), b"\1").findings,
        *describe_request(setup(0xA1, 3, 0, 0, 6), b"\0").findings,
        *describe_frame(b"").findings,
        *describe_image(b"").findings,
        *describe_message(b"").findings,
    }
    assert len(found) == 11
    assert {finding.clause for finding in found} <= set(clauses())
