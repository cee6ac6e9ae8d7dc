from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.door import Stall
from phasewire.emulator.interfaces.serial_line import SerialLine
from phasewire.protocol.codes import State
from phasewire.protocol.requests import Setup

from tests.emulator.model_controller import ModelController, no_op, update
from tests.from_spec import (
    BLOCK_FRAME,
    RECORD_FRAME,
    REPLY_FRAME,
    REQUEST_FRAME,
    TO_DEVICE,
    TO_HOST,
    build_status,
    encode_frame,
    read_ack,
    read_line,
    read_status,
)
from tests.specification import hex_examples

ENOUGH = 10**9
EXAMPLES = hex_examples()
STATUS_REQUEST = EXAMPLES["SERIAL_STATUS_REQUEST"]
CONSOLE = bytes.fromhex("06 05 02 1b 68 a2 00")  # the vector frame-console
TO_FRAMES = b"\0" + CONSOLE + b"\0"


def line_of(
    controller: ModelController, detach: Callable[[], None] = lambda: None, *, needs_dtr: bool = False
) -> SerialLine:
    return SerialLine(controller, detach=lambda _: detach(), needs_dtr=needs_dtr)


def among_frames(controller: ModelController, detach: Callable[[], None] = lambda: None) -> SerialLine:
    line = line_of(controller, detach)
    assert said(line, b"\0") == b"\0"
    return line


def said(line: SerialLine, data: bytes = b"") -> bytes:
    """All that the line sends after it has received some bytes."""
    line.receive(data)
    return line.take(ENOUGH)


def request(tag: int, code: int, value: int = 0, length: int = 0, kind: int = 0xC1, data: bytes = b"") -> bytes:
    numbers = b"".join(number.to_bytes(2, "little") for number in (value, 0, length))
    return encode_frame(REQUEST_FRAME, bytes([tag, kind, code]) + numbers + data)


def block(packet: bytes) -> bytes:
    return encode_frame(BLOCK_FRAME, packet)


RESET = request(0x77, 13, kind=0x41)
REVERT = request(0x77, 14, kind=0x41)
RESTART_REPLY = encode_frame(REPLY_FRAME, b"\x77\x00")


def heard(stream: bytes) -> list[str]:
    """A stream that begins among frames, as a host reads it: each reply by its tag, each record by its number."""
    return [in_short(*event) for event in read_line(b"\0" + stream, TO_HOST)[1:]]


def in_short(event: str, data: bytes) -> str:
    if event != "frame":
        return data.decode() or event
    kind, body = data[0], data[1:]
    if kind == REPLY_FRAME:
        return f"reply {body[0]:02x}" + (" stalled" if body[1] else "")
    if len(body) == 64:
        return f"status {read_status(body)['now']}"
    assert kind == RECORD_FRAME
    return f"ack {read_ack(body)['sequence']}"


def status(now: int) -> bytes:
    return build_status({"now": now})


# Requests


@pytest.fixture
def controller() -> ModelController:
    return ModelController()


@pytest.mark.parametrize(
    ("data", "arrives"),
    [
        (b"\0noise\0" + block(no_op(1)), False),
        (b"\0" + STATUS_REQUEST, True),
        (b"\0" + request(1, 0x77), True),
        (b"status\r", True),
        (b"frames\r", True),
        (b"test 3\r", True),
        (b"\r", False),
        (b"halt\r", False),
        (b"status 1\r", False),
        (b"test 320\r", False),
    ],
    ids=["no request", "request", "stalled", "command", "words", "refused", "empty", "unknown", "arguments", "range"],
)
def test_a_host_that_gets_an_answer_counts_as_arrived(controller: ModelController, data: bytes, arrives: bool) -> None:
    """A refusal is an answer, but one that is dropped instead of sent is none (clause FWU-020)."""
    line = line_of(controller)
    line.receive(data)
    assert controller.arrivals == 0
    line.take(ENOUGH)
    assert controller.arrivals == arrives
    line.receive(data)
    line.hang_up()
    line.take(ENOUGH)
    assert controller.arrivals == arrives


# Modes


def test_a_begun_frame_is_sent_to_its_end() -> None:
    line = among_frames(ModelController())
    line.receive(request(1, 2, length=64) + request(2, 2, length=64))
    begun = line.take(1)
    assert heard(begun + said(line, CONSOLE)) == ["reply 01", "console", "> "]


# Blocks that wait


def test_the_acknowledgement_of_a_block_that_waited_has_its_arrival() -> None:
    """Clause ACK-002: not the time of its judgement."""
    controller = ModelController(room=0)
    line = among_frames(controller)
    controller.now_tick = 100
    said(line, block(update(1)))
    controller.now_tick = 200
    controller.make_room()
    (_, (event, record)) = read_line(b"\0" + line.take(ENOUGH), TO_HOST)
    assert event == "frame"
    assert read_ack(record[1:])["now"] == 100


def test_a_block_waits_on_if_another_line_took_the_room() -> None:
    controller = ModelController(room=0)
    controller.state = State.READY
    first, second = among_frames(controller), among_frames(controller)
    said(first, block(update(1)))
    said(second, block(update(2)))
    controller.make_room()
    assert heard(first.take(ENOUGH)) == ["ack 1"]
    assert second.pending == 0
    controller.make_room()
    assert heard(second.take(ENOUGH)) == ["ack 2"]
    controller.make_room()
    assert first.pending == second.pending == 0


# Unsolicited records


def test_a_begun_unsolicited_record_is_not_replaced() -> None:
    line = among_frames(ModelController())
    line.notify(status(1))
    begun = line.take(2)
    line.notify(status(2))
    assert heard(begun + line.take(ENOUGH)) == ["status 1", "status 2"]


# Leaving


def restarts(controller: ModelController, request: int = 13) -> bool:
    return Setup(0x41, request, 0, 0, 0) in controller.asked


@pytest.mark.parametrize(("order", "code"), [(RESET, 13), (REVERT, 14)])
def test_the_answer_goes_out_then_text_begins_then_the_device_restarts(
    controller: ModelController, order: bytes, code: int
) -> None:
    line = among_frames(controller)
    line.receive(STATUS_REQUEST)
    line.notify(status(1))
    line.receive(order + STATUS_REQUEST)
    line.receive(b"stop\r" + TO_FRAMES)
    line.notify(status(2))
    stream = line.take(line.pending - 1)
    assert not restarts(controller, code)
    stream += line.take(1)
    assert restarts(controller, code)
    assert heard(stream) == ["reply 2a", "reply 77", "console"]
    assert stream.endswith(RESTART_REPLY + CONSOLE)
    assert controller.arrivals == 1
    assert said(line, b"stop\r") == b"stop\r\nok\r\n> ", "the other direction is text again too"


@pytest.mark.parametrize("said_before", [RESET, b"reset\r"])
def test_hanging_up_does_not_stop_a_restart(controller: ModelController, said_before: bytes) -> None:
    line = among_frames(controller) if said_before is RESET else line_of(controller)
    line.receive(said_before)
    line.hang_up()
    assert restarts(controller)
    assert line.pending == 0
    assert heard(said(line, b"\0" + STATUS_REQUEST)[1:]) == ["reply 2a"]


def test_a_device_goes_on_if_it_cannot_detach_after_all() -> None:
    def suspended() -> None:
        raise Stall("suspended")

    line = line_of(ModelController(), suspended)
    assert said(line, b"dfu\r") == b"dfu\r\nok\r\n> "
    assert said(line, b"stop\r") == b"stop\r\nok\r\n> "


# DTR


def test_a_restart_without_a_terminal_does_not_wait(controller: ModelController) -> None:
    line_of(controller, needs_dtr=True).receive(b"reset\r")
    assert restarts(controller)


# The line's owner


def test_an_owner_that_sends_at_once_gets_everything_in_order() -> None:
    sent = bytearray()
    controller = ModelController()
    line = SerialLine(controller, detach=lambda _: None, on_output=lambda: sent.extend(line.take(ENOUGH)))
    line.receive(b"\0" + block(no_op(1)) + STATUS_REQUEST + block(no_op(2)) + RESET)
    assert heard(bytes(sent[1:])) == ["ack 1", "reply 2a", "ack 2", "reply 77", "console"]
    assert restarts(controller)


# Any bytes

FRAMES = st.one_of(
    st.builds(request, st.integers(0, 255), st.integers(0, 14), st.integers(0, 400), st.integers(0, 640)),
    st.builds(
        lambda tag, code, data: request(tag, code, length=len(data), kind=0x41, data=data),
        st.integers(0, 255),
        st.integers(0, 12),
        st.binary(max_size=3),
    ),
    st.builds(lambda kind: request(1, 2, kind=kind), st.integers(0x80, 255)),
    st.builds(lambda sequence: block(update(sequence)), st.integers(0, 9)),
    st.builds(lambda body: block(body.ljust(512, b"\0")), st.binary(max_size=12)),
)
WORDS = ["status\r", "dfu\r", "enable\r\n", "reset\r", "test 3\n", "frames\r", "help\r", "echo 0\r"]
PIECES = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.sampled_from([b"\0", CONSOLE, TO_FRAMES, RESET, REVERT, b"\xff" * 700, *map(str.encode, WORDS)]),
        FRAMES,
    ),
    max_size=12,
)
ACTIONS = st.sampled_from(["", "", "", "take", "take some", "hang up", "open", "notify", "room", "suspend"])


@given(PIECES, st.lists(ACTIONS, min_size=12, max_size=12), st.booleans(), st.integers(0, 2))
def test_the_line_serves_on_after_any_bytes(
    pieces: list[bytes], actions: list[str], needs_dtr: bool, room: int
) -> None:
    controller = ModelController(room)
    line = line_of(controller, needs_dtr=needs_dtr)
    for piece, action in zip(pieces, actions, strict=False):
        line.receive(piece)
        match action:
            case "take":
                line.take(ENOUGH)
            case "take some":
                assert len(line.take(5)) <= 5
            case "hang up":
                line.hang_up()
            case "open":
                line.open()
            case "notify":
                line.notify(status(1))
            case "room":
                controller.make_room()
            case "suspend":
                controller.state = State.SUSPENDED
    line.take(ENOUGH)
    assert said(line, TO_FRAMES).endswith(b"\0")
    assert heard(said(line, STATUS_REQUEST)) == ["reply 2a"]


@given(PIECES, st.data())
def test_any_cut_of_the_bytes_has_the_same_result(pieces: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(pieces)
    whole, cut = ModelController(), ModelController()
    expected = said(line_of(whole), stream)
    line = line_of(cut)
    place = 0
    while place < len(stream):
        size = data.draw(st.integers(1, 60))
        line.receive(stream[place : place + size])
        place += size
    assert line.take(ENOUGH) == expected
    assert (cut.asked, cut.accepted, cut.dropped_frames) == (whole.asked, whole.accepted, whole.dropped_frames)


@given(st.lists(st.one_of(FRAMES, st.binary(max_size=40)), max_size=12))
def test_among_frames_the_oracle_of_the_specification_agrees(pieces: list[bytes]) -> None:
    """They agree on the frames, on the damaged ones, and on an answer to each, in order."""
    controller = ModelController(room=100)
    line = among_frames(controller)
    answers = b"".join(said(line, piece) for piece in pieces)
    events = read_line(b"\0" + b"".join(pieces), TO_DEVICE)[1:]
    assert controller.dropped_frames == sum(event == "damaged" for event, _ in events)
    asked = [body for event, body in events if event == "frame"]
    expected = [
        f"reply {body[1]:02x}" if body[0] == REQUEST_FRAME else f"ack {int.from_bytes(body[5:9], 'little')}"
        for body in asked
    ]
    assert [answer.removesuffix(" stalled") for answer in heard(answers)] == expected
