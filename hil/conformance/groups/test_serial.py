"""Serial lines: frames, damage, requests, the two modes, credit, and one device behind several doors (chapter SER)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from statistics import median

import numpy as np
import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Risk, TooSlow, case, expect
from phasewire.hil.conformance.tools.clocks import unless_busy
from phasewire.hil.conformance.tools.exchange import (
    acks,
    ask,
    await_ack,
    damage,
    fill,
    no_op,
    order,
    put_to_wait,
    same_but,
    send,
    statuses,
)
from phasewire.hil.conformance.tools.forge import forged
from phasewire.hil.conformance.tools.frames import console_frame, frame, request_frame, sealed, stuffed, unstuffed
from phasewire.hil.conformance.tools.steps import LONG_MS, enable, expect_all
from phasewire.hil.conformance.tools.watchdog import await_firing, check_not_yet
from phasewire.hil.conformance.transports.serial import QUIET_SECONDS, RawSerialLine
from phasewire.hil.conformance.transports.usb import CONSOLE_OUT
from phasewire.protocol.blocks import NoOp, Slot, Update, pack
from phasewire.protocol.board import CARRIER_HZ, CHANNELS, PROCESSORS, TICK_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import (
    BLOCK_BYTES,
    SERIAL_DATA_BYTES,
    SILENT_PERIODS,
    AckFlag,
    Fault,
    Feature,
    FrameKind,
    Outcome,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import ANSWER_BYTES, Ack, ClockReading, Status, records
from phasewire.protocol.requests import ConsoleRequest, Setup

VENDOR_IN, VENDOR_OUT = 0xC1, 0x41
BLOCK, RECORD, REQUEST, REPLY, CONSOLE = FrameKind
DONE, STALL = Outcome
MOST_DATA = SERIAL_DATA_BYTES
MOST_FRAME_BYTES = 658
ASK_CLOCK = Setup(VENDOR_IN, Request.CLOCK, 0, 0, 24)
ENABLE = Setup(VENDOR_OUT, Request.ENABLE, 0, 0, 0)
SHARED_WATCHDOG_MS = 200
UNREAD_LINES = 40
ANSWER_SECONDS = 0.02
"""Clause SER-013."""
LEAVE_SECONDS = 0.3
"""After a device has said that it restarts, it answers no more."""
CLOCK_ERROR = 0.01
"""More than the greatest difference between the clocks of host and device."""
GRAIN_SECONDS = 0.002
"""The resolution of a line's arrival times."""


# Requests and answers


def raw_frames(line: RawSerialLine, count: int = 1) -> list[bytes]:
    """The next frames as they stand on the line, without their zeros; zeros in a row enclose no frame."""

    def whole(data: bytes) -> list[bytes]:
        return [piece for piece in data.split(b"\0")[:-1] if piece]

    data = line.read(line.patience(count * MOST_FRAME_BYTES), lambda data: len(whole(data)) >= count)
    assert len(whole(data)) == count, f"{count} frames should come, not {len(whole(data))}: {data.hex(' ')}"
    return whole(data)


def exchange(line: RawSerialLine, data: bytes) -> bytes:
    """Send bytes; returns the content of the one frame that answers, which must be in the one form of COBS."""
    line.write(data)
    (answer,) = raw_frames(line)
    line.forget()
    content = unstuffed(answer)
    assert content == sealed(content[0], content[1:-4]), f"the checksum of a frame is wrong: {content.hex(' ')}"
    return content[:-4]


def filled(bench: Bench, size: int) -> bytes:
    """Random bytes without a zero."""
    return bytes(bench.random.randrange(1, 256) for _ in range(size))


def refused_block(bench: Bench, tail: int | None = None) -> bytes:
    """Bytes of a block's size that are no block; in the frame's content so many bytes follow the last zero."""
    while True:
        block = bytearray(filled(bench, BLOCK_BYTES))
        if tail is not None:
            block[BLOCK_BYTES + 4 - tail - 1] = 0
        if 0 not in sealed(BLOCK, bytes(block))[-4:]:
            return bytes(block)


def zero_free_pulses(bench: Bench) -> Pulses:
    """Weak pulses that are packed without a zero byte (clause PUL-005)."""
    phase = [16 * bench.random.randrange(6) + bench.random.randrange(1, 4) for _ in range(CHANNELS)]
    return Pulses(np.array(phase), np.ones(CHANNELS, int))


# Frames


@case("SER-002", "SER-003", "SER-007", "SER-008", "SER-009/1")
def test_the_examples_are_understood_and_answered(frames: RawSerialLine) -> None:
    """The frames that the specification prints byte by byte are understood: all others are built like them."""
    content = exchange(frames, bytes.fromhex("05 03 2A C1 02 01 01 01 02 40 05 CD C2 88 CE 00"))
    expect("kind, tag and outcome of the reply", content[:3], bytes([REPLY, 0x2A, DONE]))
    expect("the state in STATUS", Status.decode(content[3:]).state, State.OFF)
    frames.write(request_frame(0x2A, Setup(VENDOR_IN, 99, 0, 0, 64)))
    expect("the reply to an unknown request", raw_frames(frames), [bytes.fromhex("08 04 2A 01 70 8D 24 E0")])


@case("SER-003", "SER-008")
def test_what_the_device_sends_has_its_one_form(frames: RawSerialLine) -> None:
    """Replies of many lengths are COBS in the only form that SER-003 allows, because a strict host drops any other."""
    for request, full in ((Request.WIRING, ask(frames, Request.WIRING)), (Request.INFO, ask(frames, Request.INFO))):
        for length in (0, 1, 2, 5, 64, 253, 254, 255, 256, 508, SERIAL_DATA_BYTES):
            content = exchange(frames, request_frame(length % 256, Setup(VENDOR_IN, request, 0, 0, length)))
            expect(f"{length} bytes of {request.name}", content, bytes([REPLY, length % 256, DONE]) + full[:length])


@case("SER-003", features=Feature.READ_BACK)
def test_no_empty_group_follows_a_full_one_at_the_end(bench: Bench, frames: RawSerialLine) -> None:
    """Replies that end with 253 to 255 bytes without a zero have their one form, without an empty group at the end."""
    pulses = zero_free_pulses(bench)
    enable(bench)
    bench.wait_until(bench.must(Update(pulses)).commit_period + 2)
    frames.rest()
    head = 16  # the last byte of read_period is 0 for the next million years
    seen = set()
    for tail in (253, 254, 255, 254, 254):
        length = head + tail - 4
        content = exchange(frames, request_frame(tail, Setup(VENDOR_IN, Request.PULSES, 0, 0, length)))
        expect("kind, tag and outcome of the reply", content[:3], bytes([REPLY, tail, DONE]))
        expect("the length of the answer", len(content) - 3, length)
        if 0 not in sealed(content[0], content[1:])[-4:]:
            seen.add(tail)
    if 254 not in seen:
        raise Inconclusive("no reply ended with 254 bytes without a zero, because its checksum had one each time")


@case("SER-003", "SER-006")
@pytest.mark.parametrize("tail", [253, 254, 255, 507, 508, 509])
def test_full_groups_are_understood(bench: Bench, frames: RawSerialLine, tail: int) -> None:
    """A frame with a long run of bytes without a zero at its end is understood: pulses often contain none."""
    block = refused_block(bench, tail)
    before = bench.status()
    expect("the reason, as these bytes are no block", send(frames, block).reason, Reason.CHECKSUM)
    expect_all(bench.status(), dropped_frames=before.dropped_frames, refused=before.refused + 1)


@case("SER-003", "SER-006")
@pytest.mark.parametrize("body", ["zeros", "no-zero", "every-byte"])
def test_any_bytes_can_be_sent(bench: Bench, frames: RawSerialLine, body: str) -> None:
    """Frames of zeros, without zeros, and of all values of a byte are understood: a block may hold any bytes."""
    block = {
        "zeros": bytes(4) + bytes([7]) + bytes(507),
        "no-zero": refused_block(bench),
        "every-byte": bytes(range(256)) + bytes(range(255, -1, -1)),
    }[body]
    before = bench.status()
    expect("the reason, as these bytes are no block", send(frames, block).reason, Reason.CHECKSUM)
    expect("the count of damaged frames", bench.status().dropped_frames, before.dropped_frames)


@case("SER-003", "SER-006")
@pytest.mark.parametrize("tail", [254, 508])
def test_an_empty_group_behind_a_full_one_is_refused(bench: Bench, frames: RawSerialLine, tail: int) -> None:
    """A frame with an empty group after its last full one is dropped, because no content has two encodings."""
    good = frame(BLOCK, refused_block(bench, tail))
    damage(bench, frames, good[:-1] + b"\x01\0")
    frames.forget()
    frames.write(good)
    frames.listen(frames.patience(), lambda: bool(acks(frames)))
    expect("the reasons when it is sent without that group", [ack.reason for ack in acks(frames)], [Reason.CHECKSUM])


@case("SER-004", "SER-005", "SER-006")
def test_the_longest_frame_is_understood(bench: Bench, frames: RawSerialLine) -> None:
    """A REQUEST with 640 bytes, of 658 bytes on the line, is answered, because a receiver must have room for it."""
    data = request_frame(1, Setup(VENDOR_OUT, Request.ENABLE, 0, 0, MOST_DATA), filled(bench, MOST_DATA))
    expect("the length of the longest frame", len(data), MOST_FRAME_BYTES)
    before = bench.status()
    expect("the reply, as ENABLE takes no data", exchange(frames, data), bytes([REPLY, 1, STALL]))
    same_but(before, bench.status())


@case("SER-005", "SER-006")
@pytest.mark.parametrize("size", [MOST_FRAME_BYTES + 1, 2 * MOST_FRAME_BYTES, 3000])
def test_a_frame_that_is_too_long_is_dropped(bench: Bench, frames: RawSerialLine, size: int) -> None:
    """A frame of more than 658 bytes is dropped up to its zero and counted once, and what follows is understood."""
    damage(bench, frames, filled(bench, size - 1) + b"\0")


@case("SER-005")
@pytest.mark.parametrize("what", ["request", "block"])
def test_a_good_frame_at_the_end_of_a_long_one_is_dropped_with_it(
    bench: Bench, frames: RawSerialLine, what: str
) -> None:
    """A frame ends only with its zero: the end of a frame that is too long is not parsed as a frame."""
    sizes = [BLOCK_BYTES, SERIAL_DATA_BYTES, *range(655, 661), 1024]
    good = request_frame(1, ENABLE) if what == "request" else frame(BLOCK, no_op(bench))
    damage(bench, frames, b"".join(size * b"\x01" + good for size in sizes), len(sizes))


@case("SER-005")
def test_zeros_in_a_row_are_no_frames(bench: Bench, frames: RawSerialLine) -> None:
    """Consecutive zeros are neither answered nor counted, because a sender may put one before a frame."""
    damage(bench, frames, bytes(20), count=0)


@case("SER-005")
def test_bytes_may_come_one_by_one(bench: Bench, frames: RawSerialLine) -> None:
    """A frame whose bytes come one by one, with pauses, is understood: there is no time-out between bytes."""
    before = bench.status()
    for number, byte in enumerate(request_frame(77, ASK_CLOCK)):
        frames.write(bytes([byte]))
        bench.wait(0.7 if number in (5, 12) else 0.005)
    (reply,) = raw_frames(frames)
    expect("kind, tag and outcome of the reply", unstuffed(reply)[:3], bytes([REPLY, 77, DONE]))
    expect("the count of damaged frames", bench.status().dropped_frames, before.dropped_frames)


@case("SER-005", "SER-006", "SER-009/1")
def test_frames_may_be_cut_anywhere(bench: Bench, frames: RawSerialLine) -> None:
    """Frames of many kinds, valid and damaged, are told apart wherever the bytes are cut: a line knows no packets."""
    before = bench.status()
    blocks = [pack(bench.numbered(NoOp(), restart=True)) for _ in range(3)]
    stream, tags = b"", []
    for number, block in enumerate(blocks):
        tags.append(number + 1)
        stream += frame(BLOCK, block) + bytes(number) + request_frame(number + 1, ASK_CLOCK) + b"\x09damaged\0"
    cuts = sorted(bench.random.sample(range(1, len(stream)), 60))
    frames.forget()
    for first, last in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        frames.write(stream[first:last])
    frames.listen(frames.patience(len(stream)), lambda: len(frames.frames(REPLY)) == len(tags))
    expect("the tags that are answered", [body[0] for body in frames.frames(REPLY)], tags)
    frames.listen(frames.patience(), lambda: len(acks(frames)) == len(blocks))
    expect("the reasons of the blocks", [ack.reason for ack in acks(frames)], [Reason.ACCEPTED] * len(blocks))
    same_but(before, bench.status(), accepted=len(blocks), dropped_frames=len(blocks))


# Damage

_ENABLE_BODY = bytes([1]) + ENABLE.encode()
_RESTART = forged(bytes(BLOCK_BYTES), magic=0x5750, version=1, kind=9, sequence=5, flags=1)
_ACK = Ack(Reason.ACCEPTED, 1, 0, 0, AckFlag(0), 1, State.OFF).encode()

DAMAGED: dict[str, bytes] = {
    "group-beyond-the-end": bytes.fromhex("0B 03 01 41 04 00"),
    "one-byte-of-a-group": bytes.fromhex("02 00"),
    "no-content": bytes.fromhex("01 00"),
    "only-a-checksum": stuffed(bytes(4)) + b"\0",
    "shorter-than-a-checksum": stuffed(b"\5\5\5") + b"\0",
    "checksum-of-another-frame": stuffed(sealed(REQUEST, _ENABLE_BODY)[:-4] + sealed(CONSOLE)[-4:]) + b"\0",
    "checksum-big-endian": stuffed(sealed(REQUEST, _ENABLE_BODY)[:-4] + sealed(REQUEST, _ENABLE_BODY)[:-5:-1]) + b"\0",
    "checksum-without-the-kind": stuffed(bytes([REQUEST]) + sealed(_ENABLE_BODY[0], _ENABLE_BODY[1:])) + b"\0",
    "kind-0": frame(0, _ENABLE_BODY),
    "kind-6": frame(6, _ENABLE_BODY),
    "kind-255": frame(255),
    "an-acknowledgement": frame(RECORD, _ACK),
    "a-status-record": frame(RECORD, bytes(64)),
    "a-reply": frame(REPLY, bytes([1, DONE])),
    "block-of-no-bytes": frame(BLOCK),
    "block-of-511-bytes": frame(BLOCK, _RESTART[:511]),
    "block-of-513-bytes": frame(BLOCK, _RESTART + b"\0"),
    "console-with-a-body": frame(CONSOLE, b"\0"),
    "request-of-no-bytes": frame(REQUEST),
    "request-of-8-bytes": frame(REQUEST, _ENABLE_BODY[:8]),
    "request-in-with-a-byte": request_frame(1, ASK_CLOCK, b"\1"),
    "request-in-with-as-many-bytes-as-it-asks-for": request_frame(1, ASK_CLOCK, bytes(24)),
    "request-in-of-641-bytes": request_frame(1, Setup(VENDOR_IN, Request.INFO, 0, 0, 641)),
    "request-in-of-65535-bytes": request_frame(1, Setup(VENDOR_IN, Request.INFO, 0, 0, 65535)),
    "request-out-without-its-data": request_frame(1, Setup(VENDOR_OUT, Request.ENABLE, 0, 0, 1)),
    "request-out-with-too-little": request_frame(1, Setup(VENDOR_OUT, Request.ENABLE, 0, 0, 3), b"ab"),
    "request-out-with-too-much": request_frame(1, ENABLE, b"\1"),
}
"""Frames with one defect each; their contents would have an effect."""


@case("SER-006", "SER-003", "SER-004", "SER-007")
@pytest.mark.parametrize("what", DAMAGED)
def test_a_damaged_frame_is_dropped(bench: Bench, frames: RawSerialLine, what: str) -> None:
    """A frame with any damage is dropped, counted and not answered, and what follows is understood."""
    damage(bench, frames, DAMAGED[what])


@case("SER-006", "REQ-003")
def test_damaged_frames_are_counted_past_a_byte(bench: Bench, frames: RawSerialLine) -> None:
    """256 damaged frames are all counted."""
    damage(bench, frames, (stuffed(b"\1") + b"\0") * 256, count=256)


@case("SER-006", "SER-015")
def test_flipped_bits_are_found(bench: Bench, frames: RawSerialLine) -> None:
    """Frames with one to three flipped bits, or a burst of 32, have no effect: CRC-32 detects them all."""
    content = sealed(REQUEST, _ENABLE_BODY)
    damaged: list[bytes] = []
    while len(damaged) < 12:
        flipped = bytearray(content)
        for bit in bench.random.sample(range(8 * len(content)), 1 + len(damaged) % 3):
            flipped[bit // 8] ^= 1 << bit % 8
        damaged.append(bytes(flipped))
    at = bench.random.randrange(1, len(content) - 3)
    burst = bytes(byte ^ bench.random.randrange(1, 256) for byte in content[at : at + 4])
    damaged.append(content[:at] + burst + content[at + 4 :])
    damage(bench, frames, b"".join(stuffed(each) + b"\0" for each in damaged), count=len(damaged))


@case("SER-006", "SER-005")
def test_a_frame_that_was_cut_off_spoils_no_other(bench: Bench, frames: RawSerialLine) -> None:
    """Half a frame, ended by the zero that a sender puts before the next, is dropped alone: the next is understood."""
    for size in (1, 7, 200, 519):
        damage(bench, frames, frame(BLOCK, refused_block(bench))[:size] + b"\0")


@case("SER-006", "SAF-003")
def test_damaged_frames_are_no_sign_of_life(bench: Bench, frames: RawSerialLine) -> None:
    """Damaged frames are no signs of life, because their sender may not be a host."""
    order(frames, Request.WATCHDOG, 300)
    order(frames, Request.ENABLE)
    for _ in range(4):
        bench.outlast(0.1)
        frames.write(b"\0" + DAMAGED["request-out-with-too-much"])
    expect_all(Status.decode(ask(frames, Request.STATUS)), state=State.OFF, flags=StatusFlag.WATCHDOG_FIRED)


@case("SER-006", "BLK-003", "ACK-003")
def test_a_block_that_is_wrong_is_answered(bench: Bench, frames: RawSerialLine) -> None:
    """A wrong block in an undamaged frame is judged as on USB and answered with its reason: the frame is intact."""
    good = no_op(bench)
    before = bench.status()
    for reason, block in (
        (Reason.CHECKSUM, forged(good, checksum=1)),
        (Reason.MAGIC, forged(good, magic=0)),
        (Reason.VERSION, forged(good, version=99)),
        (Reason.KIND, forged(good, kind=77)),
        (Reason.FIELD, forged(good, period=1)),
    ):
        expect_all(
            send(frames, block), " in the acknowledgement", reason=reason, sequence=int.from_bytes(good[4:8], "little")
        )
    same_but(before, bench.status(), refused=5, last_refusal=Reason.FIELD - before.last_refusal)


# Requests

NO_DATA = b""
REFUSED: dict[str, tuple[Setup, bytes]] = {
    "request-0": (Setup(VENDOR_IN, 0, 0, 0, 64), NO_DATA),
    "request-15": (Setup(VENDOR_IN, 15, 0, 0, 64), NO_DATA),
    "request-255": (Setup(VENDOR_OUT, 255, 0, 0, 0), NO_DATA),
    "a-value": (Setup(VENDOR_IN, Request.INFO, 1, 0, 64), NO_DATA),
    "an-index": (Setup(VENDOR_IN, Request.STATUS, 0, 1, 64), NO_DATA),
    "out-instead-of-in": (Setup(VENDOR_OUT, Request.CLOCK, 0, 0, 0), NO_DATA),
    "in-instead-of-out": (Setup(VENDOR_IN, Request.ENABLE, 0, 0, 0), NO_DATA),
    "enable-with-a-value": (Setup(VENDOR_OUT, Request.ENABLE, 1, 0, 0), NO_DATA),
    "enable-with-an-index": (Setup(VENDOR_OUT, Request.ENABLE, 0, 1, 0), NO_DATA),
    "enable-with-data": (Setup(VENDOR_OUT, Request.ENABLE, 0, 0, 1), b"\1"),
    "watchdog-of-9-ms": (Setup(VENDOR_OUT, Request.WATCHDOG, 9, 0, 0), NO_DATA),
    "watchdog-of-60001-ms": (Setup(VENDOR_OUT, Request.WATCHDOG, 60_001, 0, 0), NO_DATA),
    "limit-of-321": (Setup(VENDOR_OUT, Request.LIMIT, 321, 0, 0), NO_DATA),
    "identify-of-board-255": (Setup(VENDOR_OUT, Request.IDENTIFY, 255, 0, 0), NO_DATA),
    "standard-get-status": (Setup(0x80, 0, 0, 0, 2), NO_DATA),
    "standard-get-descriptor": (Setup(0x80, 6, 0x0100, 0, 18), NO_DATA),
    "standard-set-configuration": (Setup(0x00, 9, 0, 0, 0), NO_DATA),
    "standard-of-an-interface": (Setup(0x81, 10, 0, 0, 1), NO_DATA),
    "standard-of-an-endpoint": (Setup(0x02, 3, 0, 0x81, 0), NO_DATA),
    "class-set-line-coding": (Setup(0x21, 0x20, 0, 1, 7), bytes.fromhex("80 25 00 00 00 00 08")),
    "class-get-line-coding": (Setup(0xA1, 0x21, 0, 1, 7), NO_DATA),
    "class-detach": (Setup(0x21, 0, 1000, 3, 0), NO_DATA),
    "vendor-of-the-device-in": (Setup(0xC0, Request.INFO, 0, 0, 64), NO_DATA),
    "vendor-of-the-device-out": (Setup(0x40, Request.ENABLE, 0, 0, 0), NO_DATA),
    "vendor-of-an-endpoint": (Setup(0x42, Request.ENABLE, 0, 0, 0), NO_DATA),
    "vendor-of-something-else": (Setup(0xC3, Request.STATUS, 0, 0, 64), NO_DATA),
    "microsoft-descriptors": (Setup(0xC0, 0x20, 0, 7, 338), NO_DATA),
    "reserved-type": (Setup(0xE1, Request.STATUS, 0, 0, 64), NO_DATA),
}
"""Requests that are answered with STALL on a serial line (clauses REQ-001 and SER-006), and their data."""


@case("SER-006", "SER-008", "SER-009/1", "REQ-001")
@pytest.mark.parametrize("what", REFUSED)
def test_a_request_that_is_refused_is_answered_with_stall(bench: Bench, frames: RawSerialLine, what: str) -> None:
    """A request that is unknown, or of a type other than C1 and 41, is answered with STALL and has no effect."""
    setup, data = REFUSED[what]
    before = bench.status()
    tag = bench.random.randrange(256)
    expect("the reply", exchange(frames, request_frame(tag, setup, data)), bytes([REPLY, tag, STALL]))
    same_but(before, bench.status())


@case("SER-007", "SER-008", "SER-009/1", "REQ-001")
@pytest.mark.parametrize("request_", ANSWER_BYTES, ids=lambda request: request.name.lower())
def test_an_answer_is_as_long_as_was_asked_for(bench: Bench, frames: RawSerialLine, request_: Request) -> None:
    """An answer has as many bytes as requested, or all if more were, as over USB: `length` means the same."""
    size = ANSWER_BYTES[request_]
    there = request_ is not Request.PULSES or Feature.READ_BACK in bench.info.features
    for length in sorted({0, 1, 7, size - 1, size, min(size + 1, MOST_DATA), MOST_DATA}):
        setup = Setup(VENDOR_IN, request_, 0, 0, length)
        answer = frames.request(setup)
        expect("whether it is answered with data", answer is not None, there)
        if answer is not None:
            expect(f"how many of {size} bytes come if {length} are requested", len(answer), min(size, length))
        if bench.line.kind == "usb":
            over_usb = bench.request(setup)
            expect("bytes over USB", over_usb and len(over_usb), answer and len(answer))


@case("SER-007", "SER-016", "REQ-002", "REQ-004")
def test_answers_are_the_same_over_every_line(bench: Bench, frames: RawSerialLine) -> None:
    """INFO and WIRING over a serial line equal the bench's first answers, because it is one device."""
    expect("INFO", frames.request(Setup(VENDOR_IN, Request.INFO, 0, 0, 64)), bench.info.encode())
    expect("WIRING", ask(frames, Request.WIRING), bench.ask(Request.WIRING))


@case("SER-007", "SER-008", "SER-016", "REQ-001")
def test_requests_over_the_line_take_effect(bench: Bench, frames: RawSerialLine) -> None:
    """Requests over the line have the effect that they have over USB: STATUS shows each on either line."""
    order(frames, Request.WATCHDOG, 10_000)
    expect("the watchdog time", bench.status().watchdog_ms, 10_000)
    order(frames, Request.LIMIT, 0)
    expect("the drive limit", bench.status().drive_limit, 0)
    order(frames, Request.LIMIT, bench.drive_limit)
    expect("the drive limit", bench.status().drive_limit, bench.drive_limit)
    order(frames, Request.ENABLE)
    expect("the state", bench.status().state, State.READY)
    refused = frames.request(Setup(VENDOR_OUT, Request.LIMIT, 1, 0, 0))
    expect("the answer to LIMIT while the outputs are enabled", refused, None)
    order(frames, Request.DISABLE)
    expect("the state", bench.status().state, State.OFF)
    order(frames, Request.CLEAR_FAULTS)
    for board in range(bench.info.boards):
        order(frames, Request.IDENTIFY, board)
    first = ClockReading.decode(ask(frames, Request.CLOCK)).now
    second = bench.clock().now
    third = ClockReading.decode(ask(frames, Request.CLOCK)).now
    assert first < second < third, f"ticks {first}, {second} and {third}, asked by turns, should rise: it is one clock"


@case("SER-009/1")
def test_every_tag_is_echoed_in_order(bench: Bench, frames: RawSerialLine) -> None:
    """Each request is answered once, under its tag and in its place, even if a tag repeats."""
    tags = [0, 255, 1, 0, 0, 128, *(bench.random.randrange(256) for _ in range(14))]
    for tag in tags:
        setup = Setup(VENDOR_IN, Request.CLOCK if tag % 2 else 99, 0, 0, 24)
        expect("kind and tag of the reply", exchange(frames, request_frame(tag, setup))[:2], bytes([REPLY, tag]))
    frames.write(b"".join(request_frame(tag, ASK_CLOCK) for tag in (9, 200, 9)))
    expect("the tags of three replies", [unstuffed(each)[1] for each in raw_frames(frames, 3)], [9, 200, 9])
    expect("what comes after them", frames.rest(), b"")


@case("SER-001")
def test_both_directions_may_be_busy_at_once(bench: Bench, frames: RawSerialLine) -> None:
    """A block that arrives while the device sends a long reply is judged, and `now` is the tick at which it came."""
    wiring, block = bench.ask(Request.WIRING), no_op(bench)
    frames.forget()
    frames.write(request_frame(1, Setup(VENDOR_IN, Request.WIRING, 0, 0, MOST_DATA)) + frame(BLOCK, block))
    behind = bench.clock().now
    bench.wait(QUIET_SECONDS)
    ack = await_ack(frames, block)
    expect("the reason of the block", ack.reason, Reason.ACCEPTED)
    assert ack.now <= behind, f"the block had arrived by tick {behind}; its acknowledgement says {ack.now}"
    expect("the replies", frames.frames(REPLY), [bytes([1, DONE]) + wiring])


# Modes


@case("SER-010/1", "SER-010", "CON-003")
@pytest.mark.parametrize("typed", ["", "enabl", "enable"])
def test_a_zero_leads_from_the_console_to_frames(bench: Bench, console: RawSerialLine, typed: str) -> None:
    """00 is answered with 00 and ends the text: an unfinished line is dropped, and frames are understood."""
    console.write(typed.encode())
    expect("what comes back without echo", console.rest(), b"")
    console.write(b"\0")
    expect("the answer to the byte 00", console.answer(), b"\0")
    expect("INFO", ask(console, Request.INFO), bench.info.encode())
    expect("the state", Status.decode(ask(console, Request.STATUS)).state, State.OFF)
    console.write(console_frame())
    expect("the answer to CONSOLE", said(console), console_frame() + b"> ")
    console.write(b"\r")
    expect("the answer to a line without words", said(console), b"> ")


def said(line: RawSerialLine) -> bytes:
    """The bytes up to a silence, without a zero that a sender may put before a frame (clause SER-005)."""
    return line.answer(MOST_FRAME_BYTES).lstrip(b"\0")


@case("SER-010/2", "SER-010")
def test_console_leads_from_frames_to_text(frames: RawSerialLine) -> None:
    """CONSOLE is answered with CONSOLE and the prompt, and the byte after its zero is the first one of text."""
    for _ in range(2):
        frames.write(console_frame() + b"echo 0\r")
        came = said(frames)
        head = console_frame() + b"> "
        assert came.startswith(head), f"CONSOLE is answered {came!r}, should be with {head!r}"
        assert came.endswith(b"ok\r\n> "), f"a command right after CONSOLE is answered {came!r}, should be with ok"
        frames.enter_frames()


@case("SER-010")
def test_the_byte_before_the_zero_is_the_last_one_of_text(bench: Bench, console: RawSerialLine) -> None:
    """Text, 00 and a frame in one go are each read as what they are: the mode changes at a byte, without a pause."""
    console.write(b"watchdog 500\r\0" + request_frame(7, Setup(VENDOR_IN, Request.INFO, 0, 0, 1)))
    reply = frame(REPLY, bytes([7, DONE, bench.info.oldest_version]))
    text, _, answered = said(console).partition(b"\0")
    expect("the text before the frames", text, b"ok\r\n> ")
    expect("the frames", answered.lstrip(b"\0"), reply)
    expect("the watchdog time", Status.decode(ask(console, Request.STATUS)).watchdog_ms, 500)


@case("SER-010")
@pytest.mark.parametrize("where", ["in-console", "in-a-line", "in-frames", "in-a-frame"])
def test_a_host_that_does_not_know_the_mode_ends_in_frames(bench: Bench, frames: RawSerialLine, where: str) -> None:
    """00, CONSOLE, 00 leads to frames in both directions from any mode, so that any host can begin."""
    if where in ("in-console", "in-a-line"):
        frames.write(console_frame())
        frames.rest()
    frames.write({"in-a-line": b"enable", "in-a-frame": request_frame(1, ENABLE)[:9]}.get(where, b""))
    frames.write(b"\0" + console_frame() + b"\0")
    came = frames.answer(MOST_FRAME_BYTES)
    assert came.endswith(console_frame() + b"> \0"), f"CONSOLE, prompt and 00 should end what comes: {came!r}"
    expect("kind and tag of a reply", exchange(frames, request_frame(3, ASK_CLOCK))[:2], bytes([REPLY, 3]))
    expect("the state", bench.status().state, State.OFF)


@case("SER-010", "SER-006")
@pytest.mark.parametrize("where", ["in-frames", "in-a-frame", "in-console", "in-a-line"])
def test_a_host_that_hangs_up_leaves_a_console(bench: Bench, frames: RawSerialLine, where: str) -> None:
    """A break, or DTR low, leads silently to the console; a partial frame or line is dropped."""
    before = bench.status()
    if where in ("in-console", "in-a-line"):
        frames.enter_console()
    begun = {"in-a-line": b"enable", "in-a-frame": request_frame(1, ENABLE)[:9]}.get(where, b"")
    frames.write(begun)
    bench.wait(QUIET_SECONDS)
    frames.hang_up()
    expect("what a console sends when it begins", frames.rest(), b"")
    frames.write(b"\necho 0\r")
    answer = said(frames)
    assert answer.endswith(b"ok\r\n> "), f"a command after it is answered {answer!r}, should be with ok and the prompt"
    assert b"error" not in answer, f"what was typed before is no part of the next line: {answer!r}"
    frames.enter_frames()
    same_but(before, bench.status(), dropped_frames=int(where == "in-a-frame"))


@case("SER-010", line="usb")
def test_an_answer_that_was_not_sent_is_dropped_with_the_mode(bench: Bench, frames: RawSerialLine) -> None:
    """A reply that was not read when DTR goes low is dropped: it would stand in the text of another host."""
    frames.write(request_frame(1, Setup(VENDOR_IN, Request.WIRING, 0, 0, MOST_DATA)))
    bench.wait(QUIET_SECONDS)
    frames.hang_up()
    expect("what comes of the reply", frames.rest(), b"")


@case("SER-010")
@pytest.mark.parametrize("kind", ["request", "block"])
def test_an_answer_does_not_reach_the_next_host(bench: Bench, frames: RawSerialLine, kind: str) -> None:
    """A host that hangs up right after a question leaves no answer to the next one, which enters frames at once."""
    question = request_frame(99, Setup(VENDOR_IN, Request.PULSES, 0, 0, ANSWER_BYTES[Request.PULSES]))
    if kind == "block":
        is_stored = Feature.SEQUENCES in bench.info.features  # what goes onto the chain may be answered later
        question = frame(BLOCK, pack(bench.numbered(Slot(0, Pulses.silent(CHANNELS)) if is_stored else NoOp())))
    frames.write(question)
    frames.hang_up()
    frames.write(b"\0" + request_frame(5, ASK_CLOCK))
    frames.rest(MOST_FRAME_BYTES)
    expect("the tags of the replies to the next host", [body[0] for body in frames.frames(REPLY)], [5])
    expect("the acknowledgements to it", acks(frames), [])


@case("SER-010", "ACK-006", "CON-002")
def test_nothing_comes_unasked_of_a_console(bench: Bench, console: RawSerialLine) -> None:
    """The watchdog's status record is sent only in frames, because a person at a terminal must not get bytes."""
    for command in ("watchdog 20", "enable"):
        expect(f"the answer to {command}", console.command(command), "ok\r\n")
    bench.wait(0.1)
    expect("what comes when the watchdog fires", console.rest(), b"")
    console.enter_frames()
    expect("what comes in frames later", console.rest(), b"")
    expect_all(Status.decode(ask(console, Request.STATUS)), state=State.OFF, flags=StatusFlag.WATCHDOG_FIRED)


@case("ACK-006", "SER-010", "SER-004")
def test_the_watchdog_says_so_among_frames(frames: RawSerialLine) -> None:
    """When the watchdog fires one unsolicited status record comes on a line that carries frames."""
    order(frames, Request.WATCHDOG, 200)
    order(frames, Request.ENABLE)
    frames.listen(frames.patience(), lambda: any(status.watchdog_fired for status in statuses(frames)))
    frames.rest()
    found = [status for status in statuses(frames) if status.watchdog_fired]
    expect("the states in the records that say that it has fired", [status.state for status in found], [State.OFF])


@case("SER-010", "USB-023", line="usb")
def test_frames_need_no_dtr_and_text_does(bench: Bench, frames: RawSerialLine) -> None:
    """With DTR low frames are answered and text is not: a terminal sets DTR, a program may not."""
    frames.wire.set_dtr(False)
    frames.assume_console()
    frames.write(b"status\rhelp\rfoo\r")
    expect("what a console sends before DTR is set", frames.rest(), b"")
    frames.write(b"\0" + request_frame(5, Setup(VENDOR_IN, Request.INFO, 0, 0, 1)))
    answered = frame(REPLY, bytes([5, DONE, bench.info.oldest_version]))
    expect("the answer to a request", said(frames), answered)
    frames.write(console_frame() + b"status\r")
    expect("the answer to CONSOLE and a command", said(frames), console_frame())
    frames.wire.set_dtr(True)
    bench.wait(QUIET_SECONDS)
    frames.rest()
    frames.write(b"\x15\r")
    came = said(frames)
    assert came.endswith(b"> "), f"a line is answered {came!r} once DTR is set, should be with the prompt"


@case("SER-010", "USB-026", line="usb")
def test_set_configuration_leads_to_the_console(bench: Bench, frames: RawSerialLine) -> None:
    """SET_CONFIGURATION resets the line to a console: DTR low, echo on, a partial frame counted."""
    check_at_first(bench, frames, bench.usb.set_configuration)


@case("SER-010", "USB-026", allow=(Risk.RESET,), line="usb")
def test_a_bus_reset_leads_to_the_console(bench: Bench, frames: RawSerialLine) -> None:
    """A bus reset resets the line to a console: DTR low, echo on, a partial frame counted."""
    check_at_first(bench, frames, bench.usb.reset)


def check_at_first(bench: Bench, line: RawSerialLine, reset: Callable[[], None]) -> None:
    """Fail unless something that comes within a frame gives the line on USB its initial state (clause USB-026)."""
    before = bench.status()
    line.write(request_frame(1, ENABLE)[:9])
    reset()
    line.assume_console()
    same_but(before, bench.status(), dropped_frames=1)
    line.write(b"\r")
    expect("what comes while DTR is low", line.rest(), b"")
    line.wire.set_dtr(True)
    bench.wait(QUIET_SECONDS)
    line.rest()
    line.write(b"\rfoo")
    expect("the answer to a line and a word on a console with echo", line.answer(), b"\r\n> foo")


@case("SER-010", "REQ-013", allow=(Risk.RESET,))
def test_reset_is_answered_before_it_is_carried_out(bench: Bench, frames: RawSerialLine) -> None:
    """RESET over the line is answered with its REPLY, then CONSOLE; then the device starts again, with a console."""
    old = bench.clock().now
    refused = frames.request(Setup(VENDOR_OUT, Request.RESET, 1, 0, 0))
    expect("the answer to RESET with a value", refused, None)
    bench.outlast(0.2)
    assert bench.clock().now > old + TICK_HZ // 5, "the device restarted for a RESET that it had refused"
    frames.forget()
    began = bench.line.time.monotonic()
    frames.write(request_frame(9, Setup(VENDOR_OUT, Request.RESET, 0, 0, 0)))
    answer = frame(REPLY, bytes([9, DONE])) + console_frame()
    came = frames.read(frames.patience(), lambda data: data.lstrip(b"\0").endswith(answer))
    expect("the answer to RESET", came.lstrip(b"\0"), answer)
    bench.restart(lambda: bench.wait(LEAVE_SECONDS))
    new = bench.clock().now
    most = (bench.line.time.monotonic() - began) * TICK_HZ * (1 + CLOCK_ERROR)
    assert new < most, f"tick {new} is no beginning of time {most:.0f} ticks after RESET, which was at tick {old}"
    expect("the drive limit after RESET", bench.status().drive_limit, bench.info.drive_limit)


# Credit


WAITING: dict[str, Callable[[Bench], bytes]] = {
    "no-op": no_op,
    "update": lambda bench: pack(bench.numbered(Update(Pulses.silent(CHANNELS)))),
    "no-block": refused_block,
}


@case("SER-011/1", "SER-011")
@pytest.mark.parametrize(
    ("what", "reason"),
    [("no-op", Reason.ACCEPTED), ("update", Reason.DISABLED), ("no-block", Reason.CHECKSUM)],
    ids=list(WAITING),
)
def test_one_block_waits_until_the_queue_has_room(
    bench: Bench, frames: RawSerialLine, what: str, reason: Reason
) -> None:
    """With a full queue a block of any kind waits while requests are answered, and is judged when there is room."""
    fill(bench, frames, 2)
    block = WAITING[what](bench)
    put_to_wait(bench, frames, block)
    arrived = bench.clock().now
    frames.forget()
    order(frames, Request.DISABLE)
    ack = await_ack(frames, block)
    expect("the reason, after DISABLE has made room", ack.reason, reason)
    expect("the state when it was judged", ack.state, State.OFF)
    assert ack.now < arrived, f"the block had arrived before tick {arrived}; its acknowledgement says {ack.now}"


@case("SER-011/1", "BLK-024")
def test_a_block_that_waits_is_judged_when_a_change_leaves_the_queue(bench: Bench, frames: RawSerialLine) -> None:
    """A block that waits is answered when the first change leaves the queue, and plays after those in it."""
    queued = fill(bench, frames, 0.5 * bench.slowness)
    waits, behind = (pack(bench.numbered(Update(Pulses.silent(CHANNELS)))) for _ in range(2))
    ack = send(frames, waits, 10 + bench.slowness)
    first, last = queued[0].commit_period, queued[-1].commit_period
    if ack.now >= TICKS_PER_PERIOD * first:
        raise TooSlow("the queue could not be filled in time: a change had left it before the last block came")
    expect_all(ack, ", after it took the first place that became free", reason=Reason.ACCEPTED, free=0)
    assert ack.commit_period > last, f"it plays from period {ack.commit_period} on, should play after period {last}"
    expect("the reason of a block after it", send(frames, behind, 10 + bench.slowness).reason, Reason.ACCEPTED)


@case("SER-011/3")
def test_a_second_block_that_would_wait_is_dropped(bench: Bench, frames: RawSerialLine) -> None:
    """A block that comes while another waits is dropped and counted as a damaged frame; the first one still waits."""
    fill(bench, frames, 3)
    first, second, third = (pack(bench.numbered(NoOp())) for _ in range(3))
    put_to_wait(bench, frames, first)
    damage(bench, frames, frame(BLOCK, second))
    damage(bench, frames, frame(BLOCK, refused_block(bench)))
    before = bench.status()
    frames.forget()
    order(frames, Request.DISABLE)
    expect("the reason of the block that waited", await_ack(frames, first).reason, Reason.ACCEPTED)
    ack = send(frames, third)
    expect("the reason of a later block", ack.reason, Reason.ACCEPTED)
    expect("its flags, as the dropped block is missing", ack.flags, AckFlag.GAP)
    expect_all(bench.status(), accepted=before.accepted + 2, lost=before.lost + 1)


@case("SER-011", "ACK-006/1", "SAF-003", since=2)
def test_a_block_that_waits_is_no_sign_of_life(bench: Bench, frames: RawSerialLine) -> None:
    """A block that waits does not feed the watchdog; when it fires, the block is judged first, then the record sent."""
    milliseconds = 400
    last = fill(bench, frames, 5)[-1]
    bench.wait_until(bench.clock().now // TICKS_PER_PERIOD + 1)
    block = no_op(bench)
    before = bench.status()
    alive = before.now
    frames.forget()
    bench.wait(0.2)
    frames.write(b"\0" + frame(BLOCK, block))
    sent = ClockReading.decode(ask(frames, Request.CLOCK)).now
    order(frames, Request.WATCHDOG, milliseconds)
    ack = await_ack(frames, block)
    fired = ClockReading.decode(ask(frames, Request.CLOCK)).now  # unless the device told when
    fired = min([fired, *(status.now for status in statuses(frames) if status.watchdog_fired)])
    expect("the reason, as the watchdog has made room", ack.reason, Reason.ACCEPTED)
    expect("the state when it was judged", ack.state, State.OFF)
    assert last.now < ack.now <= sent, f"the block had arrived by tick {sent}; its acknowledgement says {ack.now}"
    least = TICK_HZ * milliseconds // 1000
    assert fired >= alive + least, f"the watchdog fired at tick {fired}, before {milliseconds} ms from tick {alive} on"
    late = fired - least - alive
    assert late < ack.now - alive, f"the watchdog fired {late} ticks late: it counted from the block that waits"
    frames.rest()
    came = [record for body in frames.frames(RECORD) for record in records(body)]
    expect("the kinds of records that come", [type(record).__name__ for record in came], ["Ack", "Status"])
    expect("accepted blocks in that record", [status.accepted for status in statuses(frames)], [before.accepted + 1])


@case("SAF-003", "SER-011", since=3)
def test_a_block_that_waited_is_a_sign_of_life_when_it_is_judged(bench: Bench, frames: RawSerialLine) -> None:
    """The watchdog counts from the tick in which a block that waited is judged, which is later than its arrival."""
    first = fill(bench, frames, 1.5 * bench.slowness)[0].commit_period
    bench.wait_until(first - round(CARRIER_HZ * 0.75 * bench.slowness))
    bench.status()  # a sign of life: the queue of a far line is full for longer than the watchdog's time
    order(frames, Request.WATCHDOG, ms := 5000 * bench.slowness)
    block = no_op(bench)
    frames.write(b"\0" + frame(BLOCK, block))
    ask(frames, Request.CLOCK)
    latest = first * TICKS_PER_PERIOD
    check_not_yet(bench, latest - TICK_HZ // 2)
    expect("the reason", await_ack(frames, block, 2 * bench.slowness).reason, Reason.ACCEPTED)
    await_firing(bench, latest - SILENT_PERIODS * TICKS_PER_PERIOD, latest, ms)


@case("SER-010", "SER-011")
def test_the_later_answer_of_a_block_that_waits_is_dropped_with_the_mode(bench: Bench, frames: RawSerialLine) -> None:
    """A block that waits when the line returns to text is still judged later, but not answered."""
    fill(bench, frames, 3)
    put_to_wait(bench, frames, no_op(bench))
    before = bench.status()
    frames.enter_console()
    frames.enter_frames()
    order(frames, Request.DISABLE)
    frames.rest()
    expect("the acknowledgements that come", acks(frames), [])
    expect("the count of accepted blocks", bench.status().accepted, before.accepted + 1)


# Repeats


@case("SER-012", "NUM-002")
def test_a_block_that_is_repeated_is_carried_out_once(bench: Bench, frames: RawSerialLine) -> None:
    """A block that comes twice is refused with SEQUENCE the second time, so that no block takes effect twice."""
    send(frames, no_op(bench))
    block = no_op(bench)
    before = bench.status()
    expect("the reason at first", send(frames, block).reason, Reason.ACCEPTED)
    expect("the reason when it is repeated", send(frames, block).reason, Reason.SEQUENCE)
    same_but(before, bench.status(), accepted=1, refused=1, last_refusal=Reason.SEQUENCE - before.last_refusal)


@case("SER-012", "NUM-003", "NUM-004")
def test_a_block_that_was_lost_is_missed(bench: Bench, frames: RawSerialLine) -> None:
    """After a damaged block the next is acknowledged with GAP; one with RESTART is accepted with any number."""
    restart = pack(bench.numbered(NoOp(), restart=True))
    for _ in range(2):
        expect("the reason of a block with RESTART", send(frames, restart).reason, Reason.ACCEPTED)
    before = bench.status()
    lost, block = no_op(bench), no_op(bench)
    damage(bench, frames, frame(BLOCK, lost)[:300] + b"\0")
    expect_all(send(frames, block), " of the next block", reason=Reason.ACCEPTED, flags=AckFlag.GAP)
    same_but(before, bench.status(), accepted=1, lost=1, dropped_frames=1)


@case("SER-012", "SER-009/1")
def test_a_request_may_be_repeated(bench: Bench, frames: RawSerialLine) -> None:
    """A request that is repeated under another tag is answered again: a host repeats what was not answered."""
    for tag in (10, 11, 12):
        reply = exchange(frames, request_frame(tag, Setup(VENDOR_OUT, Request.WATCHDOG, 1234, 0, 0)))
        expect("the reply", reply, bytes([REPLY, tag, DONE]))
    expect("the watchdog time", bench.status().watchdog_ms, 1234)


@case("SER-009/1", "SER-012")
def test_the_same_request_again_is_carried_out_again(frames: RawSerialLine) -> None:
    """A request equal to the previous one, tag included, is answered anew, because a host may use a single tag."""
    times = [ClockReading.decode(exchange(frames, request_frame(7, ASK_CLOCK))[3:]).now for _ in range(3)]
    assert times[0] < times[1] < times[2], f"CLOCK answers ticks {times} under one tag, should be later each time"


@case("SER-009/1", "SER-016", "SAF-004")
def test_disable_under_the_same_tag_disables_again(bench: Bench, frames: RawSerialLine) -> None:
    """DISABLE under the tag of an earlier DISABLE turns off what was enabled in between: it is not a repeat."""
    tag = 9
    for _ in range(3):
        enable(bench)
        expect("the state after ENABLE", bench.status().state, State.READY)
        frames.rest()
        reply = exchange(frames, request_frame(tag, Setup(VENDOR_OUT, Request.DISABLE, 0, 0, 0)))
        expect("the reply to DISABLE", reply, bytes([REPLY, tag, DONE]))
        expect("the state after DISABLE", bench.status().state, State.OFF)


# Times


@case("SER-013")
@pytest.mark.parametrize("what", ["request", "refused-request", "pulses", "block", "refused-block"])
def test_an_answer_begins_within_20_ms(bench: Bench, frames: RawSerialLine, what: str) -> None:
    """Most answers to requests and blocks begin within 20 ms of the last byte, plus the line's own delay."""
    ways: dict[str, Callable[[], bytes]] = {
        "request": lambda: request_frame(1, ASK_CLOCK),
        "refused-request": lambda: request_frame(1, Setup(VENDOR_IN, 99, 0, 0, 0)),
        "pulses": lambda: request_frame(1, Setup(VENDOR_IN, Request.PULSES, 0, 0, ANSWER_BYTES[Request.PULSES])),
        "block": lambda: frame(BLOCK, no_op(bench)),
        "refused-block": lambda: frame(BLOCK, refused_block(bench)),
    }
    check_prompt(bench, frames, [ways[what]() for _ in range(5)])


@case("SER-013", "CON-002")
@pytest.mark.parametrize("command", ["status", "boards", "pulses 3", "help", "foo", ""])
def test_a_command_is_answered_within_20_ms(bench: Bench, console: RawSerialLine, command: str) -> None:
    """Most answers to a command begin within 20 ms of the end of its line, plus the line's own delay."""
    check_prompt(bench, console, [command.encode() + b"\r"] * 5)


def check_prompt(bench: Bench, line: RawSerialLine, questions: Sequence[bytes]) -> None:
    """Fail unless most answers begin in time: one may be late by a pause of this computer."""
    passed = []
    for question in questions:
        line.rest()
        began = line.time.monotonic()
        line.write(question)
        first = line.read(line.patience(), bool)
        assert first, f"no answer to {question!r} within {line.patience():.2f} s"
        passed.append(line.time.monotonic() - began - line.transit(len(question) + len(first)))
    line.rest(1000)
    bench.note("answers began after ms", ", ".join(f"{1000 * each:.2f}" for each in passed))
    limit, passes = ANSWER_SECONDS + line.latency + GRAIN_SECONDS, median(passed)
    if passes > limit:
        unless_busy(bench, f"answers begin after {1000 * min(passed):.1f} to {1000 * max(passed):.1f} ms")
    assert passes <= limit, f"answers begin after {1000 * passes:.1f} ms, should begin within {1000 * limit:g} ms"


# Doors


@case("SER-016", "ACK-001", line="usb")
def test_each_door_gets_the_answers_to_what_came_by_it(bench: Bench, frames: RawSerialLine) -> None:
    """A block by the serial line is acknowledged only there, and one by USB only there."""
    block = no_op(bench)
    expect("the reason of a block by the serial line", send(frames, block).reason, Reason.ACCEPTED)
    expect("what comes by USB", bench.listen(), [])
    frames.forget()
    bench.must(NoOp())
    expect("what comes by the serial line of a block by USB", frames.rest(), b"")


@case("SER-016", "NUM-002", "NUM-003", line="usb")
def test_doors_share_one_numbering(bench: Bench, frames: RawSerialLine) -> None:
    """Blocks of one numbering come alternately by USB and by the serial line, because it is one device."""
    bench.must(NoOp())
    before = bench.status()
    block = no_op(bench)
    ack = send(frames, block)
    expect("reason and flags of the next by the serial line", (ack.reason, ack.flags), (Reason.ACCEPTED, 0))
    (ack,) = bench.send_raw(block)
    expect("the reason of the same by USB", ack.reason, Reason.SEQUENCE)
    no_op(bench)
    ack = bench.must(NoOp())
    expect("the flags of the next but one by USB", ack.flags, AckFlag.GAP)
    same_but(before, bench.status(), accepted=2, refused=1, lost=1, last_refusal=Reason.SEQUENCE - before.last_refusal)


@case("SER-016", "SER-011", line="usb")
def test_doors_share_one_queue(bench: Bench, frames: RawSerialLine) -> None:
    """Changes that came by USB fill the queue for the serial line too, and `free` counts those of all doors."""
    enable(bench)
    free = bench.must(NoOp()).free
    first = bench.period() + 40_000
    bench.must(Update(Pulses.silent(CHANNELS), first))
    step = 10 * max(bench.info.periods_per_update, 1)
    ack = send(frames, pack(bench.numbered(Update(Pulses.silent(CHANNELS), first + step))))
    expect("the reason by the serial line", ack.reason, Reason.ACCEPTED)
    expect("the free places after one change by each door", ack.free, free - 2)


@case("SER-016", "ACK-006", line="usb")
def test_what_comes_by_one_door_is_told_the_others(bench: Bench, frames: RawSerialLine) -> None:
    """A change of state through one door is told at the other by an unsolicited status record."""
    order(frames, Request.WATCHDOG, LONG_MS)
    order(frames, Request.ENABLE)
    expect("the state told by USB", bench.await_unasked(1).state, State.READY)
    expect_told(frames, State.OFF, lambda: bench.order(Request.DISABLE))
    expect_told(frames, State.READY, bench.enable)
    expect_told(frames, State.PLAYING, lambda: bench.must(Update(bench.weak())))
    bench.unasked.clear()
    order(frames, Request.DISABLE)
    expect("the state told by USB", bench.await_unasked(1).state, State.OFF)


def expect_told(line: RawSerialLine, state: State, act: Callable[[], object]) -> None:
    """Do something by another door: the newest status record at this one must name the state."""
    line.rest()
    line.forget()
    act()
    line.listen(line.patience(), lambda: any(status.state is state for status in statuses(line)))
    told = [status.state for status in statuses(line)]
    assert told[-1:] == [state], f"{state.name} should be told by the serial line, not {[each.name for each in told]}"


@case("SER-016", "ACK-006", line="usb")
def test_the_watchdog_is_told_at_all_doors(bench: Bench, frames: RawSerialLine) -> None:
    """When the watchdog fires a status record comes by USB and by the line that carries frames."""
    enable(bench, 50)
    frames.listen(frames.patience(), lambda: any(status.watchdog_fired for status in statuses(frames)))
    told = [status.watchdog_fired for status in statuses(frames)]
    assert told[-1:] == [True], "no status record by the serial line says that the watchdog has fired"
    assert bench.await_unasked(1).watchdog_fired, "the status record by USB does not say that the watchdog has fired"


@case("SER-016", "SAF-003", line="usb")
def test_doors_share_one_watchdog(bench: Bench, frames: RawSerialLine) -> None:
    """STATUS over the serial line keeps on what was enabled by USB, because there is one watchdog."""
    enable(bench, ms := SHARED_WATCHDOG_MS * bench.slowness)
    asked = [bench.clock().now]
    for _ in range(10):
        bench.wait(ms / 4000)
        asked.append(Status.decode(ask(frames, Request.STATUS)).now)
    status = bench.status()
    if max(later - former for former, later in pairwise([*asked, status.now])) >= ms * TICK_HZ // 1000:
        raise TooSlow("this line is too slow: the watchdog may have fired between two requests")
    expect_all(status, state=State.READY, flags=StatusFlag(0))


@case("USB-003", "SER-016", "USB-026", line="usb")
def test_what_was_enabled_by_the_serial_line_ends_with_the_session(bench: Bench, frames: RawSerialLine) -> None:
    """SET_CONFIGURATION turns off what was enabled and plays by the serial line, whichever door it came by."""
    order(frames, Request.WATCHDOG, LONG_MS)
    order(frames, Request.ENABLE)
    expect("the reason of an update", send(frames, pack(bench.numbered(Update(bench.weak())))).reason, Reason.ACCEPTED)
    bench.usb.set_configuration()
    frames.assume_console()
    status = bench.status()
    expect("state and faults", (status.state, status.faults), (State.OFF, Fault(0)))
    expect("what plays since", status.since_period, 0)


@case("USB-025", line="usb")
def test_a_console_that_is_not_read_delays_no_block(bench: Bench, console: RawSerialLine) -> None:
    """While a console is full of unread text, blocks and requests are answered by USB as before and after."""
    before = exchanges(bench)
    for _ in range(400):
        if bench.usb.write(CONSOLE_OUT, b"help\r" * 12, 0.005) < 60:
            break
    beside = exchanges(bench)
    console.wire.set_dtr(False)
    after = exchanges(bench)
    # A busy computer delays some of them; a device whose console blocks it delays each of those meanwhile.
    longest = max(before + after) + TICK_HZ // 1000
    assert min(beside) <= longest, (
        f"a block and a request take {min(beside)} ticks or more while a console is not read, "
        f"and {max(before + after)} or fewer before and after that"
    )


@case("SER-013", "CON-002", line="usb", since=3)
def test_a_console_that_is_not_read_loses_no_answer(bench: Bench, console: RawSerialLine) -> None:
    """A console answers all lines that it took while nobody read, each answer whole, once somebody reads."""
    took, end = 0, b"ok\r\n> "
    while took < UNREAD_LINES and bench.usb.write(CONSOLE_OUT, b"boards\r", 0.01) == len(b"boards\r"):
        took += 1
    assert took, "the console takes no line"
    text = console.read(console.patience(took * 2000), lambda data: data.count(end) >= took) + console.rest()
    answers = text.split(end)
    assert len(answers) > took, f"{len(answers) - 1} answers come, should be {took}: the console took so many lines"
    expect("processors in each answer", {answer.count(b"processor ") for answer in answers[:-1]}, {PROCESSORS})
    expect("what comes after them", answers[-1], b"")


def exchanges(bench: Bench) -> list[int]:
    """The device's ticks for a block and a request, several times."""
    ticks = []
    for _ in range(20):
        began = bench.clock().now
        bench.must(NoOp())
        ticks.append(bench.status().now - began)
    return ticks


# CDC-ACM

CODINGS = ("00C20100000008", "2C010000020207", "80250000010410", "00000000000000", "FFFFFFFFFFFFFF")
"""115 200 baud 8N1, 300 baud 7E2, 9600 baud with 1.5 stop bits, spaces and 16 bits, and nonsense."""


@case("SER-001", "USB-023", line="usb")
def test_every_line_coding_is_accepted_and_ignored(bench: Bench, frames: RawSerialLine) -> None:
    """Any line coding is accepted and read back and changes nothing, because CDC-ACM has no UART."""
    for text in CODINGS:
        coding = bytes.fromhex(text)
        done = bench.request(Setup(0x21, ConsoleRequest.SET_LINE_CODING, 0, 1, 7), coding)
        expect("whether SET_LINE_CODING is accepted", done is not None, True)
        expect("GET_LINE_CODING", bench.request(Setup(0xA1, ConsoleRequest.GET_LINE_CODING, 0, 1, 7)), coding)
        expect("INFO", ask(frames, Request.INFO), bench.info.encode())


# UART


@case("SER-001", "SER-014")
def test_a_uart_sends_at_its_baud_rate(bench: Bench, frames: RawSerialLine) -> None:
    """A reply of 640 bytes takes the time of ten bits a byte; another baud rate or character format shows."""
    if not frames.wire.has_break:
        raise Inconclusive("this applies to UARTs")
    passed = []
    for _ in range(5):
        frames.rest()
        frames.write(request_frame(1, Setup(VENDOR_IN, Request.WIRING, 0, 0, MOST_DATA)))
        first = frames.read(frames.patience(), bool)
        began = frames.time.monotonic()
        rest = frames.read(frames.patience(), lambda data: data.endswith(b"\0"))
        passed.append((frames.time.monotonic() - began) / (len(rest) or 1))
        bench.note("came", f"{len(first)} bytes, then {len(rest)}")
    byte, took = frames.transit(1), median(passed)
    slack = (frames.latency + GRAIN_SECONDS) / MOST_DATA + 0.02 * byte
    if abs(took - byte) > slack:
        unless_busy(bench, f"a byte takes {1e6 * min(passed):.1f} to {1e6 * max(passed):.1f} µs")
    assert abs(took - byte) <= slack, f"a byte takes {1e6 * took:.1f} µs, should take {1e6 * byte:.1f} µs"
