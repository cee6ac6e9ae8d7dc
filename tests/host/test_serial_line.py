"""The host's end of a serial line, against a device made by hand and a line that loses and damages what it carries."""

from __future__ import annotations

import dataclasses
import errno
import random
import socket
import termios
import threading
from collections import Counter
from collections.abc import Callable
from functools import partial

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Emulator, open_device
from phasewire.base.errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)
from phasewire.host.transports.serial_line import SerialTransport
from phasewire.protocol import Info, Status
from phasewire.protocol.codes import Fault, FrameKind, Outcome, Request, State
from phasewire.protocol.framing import SerialReply

from tests.from_spec import BLOCK_FRAME, REQUEST_FRAME, encode_frame
from tests.host.serial_bench import BenchPort, Clock, Damage, HandMade, ack
from tests.specification import hex_examples

CONSOLE = bytes.fromhex("06 05 02 1b 68 a2 00")  # the vector frame-console
UNIQUE = bytes.fromhex("0123456789abcdef")
ATTEMPTS = 4


@pytest.fixture(scope="module")
def genuine() -> tuple[Info, Status]:
    """The description and the status of an emulated device."""
    with open_device("emulator:") as device:
        return dataclasses.replace(device.info, unique_id=UNIQUE), device.status()


@pytest.fixture
def device(genuine: tuple[Info, Status]) -> HandMade:
    return HandMade(*genuine)


@pytest.fixture
def port(device: HandMade) -> BenchPort:
    return BenchPort(device, Clock())


@pytest.fixture
def line(port: BenchPort) -> SerialTransport:
    return SerialTransport(port)


def lose(times: int) -> Callable[[bytes], bytes]:
    """Loses the next pieces whole, and none of those after them."""
    left = [times]

    def pass_on(data: bytes) -> bytes:
        if data and left[0]:
            left[0] -= 1
            return b""
        return data

    return pass_on


# Opening and closing


def test_the_line_is_opened_for_a_host_that_does_not_know_its_mode(line: SerialTransport, port: BenchPort) -> None:
    """Clause SER-010: 00, CONSOLE, 00; then INFO, after a zero (SER-005)."""
    request = encode_frame(REQUEST_FRAME, bytes.fromhex("01 C1 01 0000 0000 4000"))
    assert port.written == [b"\0" + CONSOLE + b"\0", b"\0" + request]
    assert port.time.now < 0.02
    assert line.damaged == 0


@pytest.mark.parametrize("before", [b"\0", b"\0\x05abc", b"sta", b"", b"\0" + CONSOLE])
@pytest.mark.parametrize("stale", [b"", b"ok\r\n> ", b"\x09\x09junk", encode_frame(4, b"\x01\x00" + bytes(64))])
def test_whatever_was_on_the_line_before_does_not_matter(port: BenchPort, before: bytes, stale: bytes) -> None:
    """The last is an answer to an earlier host, under the tag and of the size that ours will have.

    Where half a frame stood there, the way to frames is tried twice.
    """
    port.device.receive(before)
    port.device.says[:] = stale
    line = SerialTransport(port)
    assert line.name == "phasewire array 0123456789abcdef"
    assert (line.damaged, port.time.now < 0.3) == (0, True)


def test_closing_leaves_the_line_to_a_person(line: SerialTransport, port: BenchPort) -> None:
    line.close()
    assert port.written[-1] == b"\0" + CONSOLE
    assert not port.is_open
    line.close()
    with pytest.raises(DeviceLostError):
        line.query(Request.STATUS, Status.BYTES)
    with pytest.raises(DeviceLostError):
        line.read_records(0.1)


@pytest.mark.parametrize(
    ("error", "expected", "message"),
    [
        (serial.SerialException(errno.ENOENT, "no such file"), DeviceNotFoundError, "no device at /dev/bench"),
        (serial.SerialException("could not connect"), DeviceNotFoundError, "could not connect"),
        (ValueError("Failed to set custom baud rate"), DeviceNotFoundError, "custom baud rate"),
        (termios.error(22, "Invalid argument"), DeviceNotFoundError, "Invalid argument"),
        (serial.SerialException(errno.EACCES, "denied"), DeviceAccessError, "phasewire doctor"),
        (serial.SerialException("PermissionError(13, 'Access is denied.')"), DeviceAccessError, "phasewire doctor"),
        (serial.SerialException(errno.EBUSY, "busy"), DeviceAccessError, "another program has it open"),
        (serial.SerialException(errno.EAGAIN, "locked"), DeviceAccessError, "another program has it open"),
    ],
)
def test_a_port_that_cannot_be_opened_says_why(
    port: BenchPort, error: Exception, expected: type[DeviceError], message: str
) -> None:
    port.fails["open"] = error
    with pytest.raises(expected, match=message) as raised:
        SerialTransport(port)
    assert type(raised.value) is expected


def test_the_error_for_a_silent_line_names_possible_causes(port: BenchPort) -> None:
    """Four attempts: 1, 2, 4 and 8 times 100 ms, and each the time of 2 · 658 bytes at 11 520 a second; below 2 s."""
    port.to_host = lambda _: b""
    with pytest.raises(DeviceTimeoutError, match=r"nothing comes from there.*switched on.*115200 its baud rate"):
        SerialTransport(port)
    assert len(port.written) == ATTEMPTS + 1  # and a farewell
    assert port.time.now == pytest.approx(15 * 0.1 + 4 * 2 * 658 / 11_520, rel=0.01)
    assert port.time.now < 2
    assert not port.is_open


@pytest.mark.parametrize("junk", [b"\xff\xfe", b"\0", b"login: ", bytes(range(256)), CONSOLE[:-1]])
def test_another_program_at_the_other_end_is_rejected_in_time(port: BenchPort, junk: bytes) -> None:
    port.to_host = lambda _: junk
    with pytest.raises(DeviceTimeoutError, match="what comes from there makes no sense"):
        SerialTransport(port)
    assert port.time.now < 5


def test_a_line_that_echoes_is_no_device(port: BenchPort) -> None:
    port.to_device = lambda data: port.pending.extend(data) or b""  # type: ignore[func-returns-value]
    with pytest.raises(DeviceTimeoutError, match=r"INFO: /dev/bench does not answer.* 4 of its frames.*sends back"):
        SerialTransport(port)


@pytest.mark.parametrize(
    ("way", "told"),
    [
        (lambda data: bytes(each for byte in data for each in (byte, byte)), "each byte comes twice"),
        (lambda data: data[::2], "what comes from there makes no sense|frames came damaged"),
        (lambda data: data[::-1], "what comes from there makes no sense|frames came damaged"),
    ],
    ids=["doubled", "lost", "reversed"],
)
def test_a_line_that_garbles_is_named_and_given_up_in_time(port: BenchPort, way: Damage, told: str) -> None:
    port.to_host = lambda data: way(data) if len(data) > 1 else way(CONSOLE + data)
    with pytest.raises(DeviceTimeoutError, match=told):
        SerialTransport(port)
    assert port.time.now < 5


# Requests


def test_the_worked_example_is_what_is_sent(line: SerialTransport, port: BenchPort) -> None:
    """STATUS under tag 2A; INFO had tag 1."""
    for _ in range(0x2A - 1):
        line.query(Request.STATUS, Status.BYTES)
    assert port.written[-1] == b"\0" + hex_examples()["SERIAL_STATUS_REQUEST"]


def test_tags_go_round(line: SerialTransport, port: BenchPort) -> None:
    for _ in range(300):
        assert line.query(Request.STATUS, Status.BYTES) == port.device.status.encode()
    tags = [request.tag for request in port.device.requests]
    assert tags == [number % 256 for number in range(1, 302)]


def test_a_line_that_another_client_holds_is_in_use() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def turn_away() -> None:
            listener.accept()[0].close()

        threading.Thread(target=turn_away, daemon=True).start()
        with pytest.raises(DeviceAccessError, match="another client probably holds this line"):
            open_device(f"socket://127.0.0.1:{listener.getsockname()[1]}")


def test_all_attempts_lost_is_a_time_out(line: SerialTransport, port: BenchPort) -> None:
    port.to_device = lose(99)
    with pytest.raises(DeviceTimeoutError, match="ordering DISABLE: phasewire array 0123456789abcdef does not answer"):
        line.command(Request.DISABLE)
    assert len(port.written) == 2 + ATTEMPTS


def test_a_late_answer_is_not_taken_for_another_s(line: SerialTransport, port: BenchPort) -> None:
    """Clause SER-009: the answer to the request that was given up comes before that to the next."""
    port.device.answers = False
    with pytest.raises(DeviceTimeoutError):
        line.query(Request.STATUS, Status.BYTES)
    port.device.answers = True
    port.to_device = lose(1)
    for late in (port.device.requests[-1].tag, port.device.requests[-1].tag - 1):
        port.device.say(FrameKind.REPLY, SerialReply(late, Outcome.DONE, bytes(64)).encode())
    assert line.query(Request.STATUS, Status.BYTES) == port.device.status.encode()


@pytest.mark.parametrize(
    ("request_", "way", "expected"),
    [
        (Request.ENABLE, "to_host", [Request.ENABLE, Request.STATUS]),
        (Request.ENABLE, "to_device", [Request.STATUS, Request.ENABLE]),
        (Request.CLEAR_FAULTS, "to_host", [Request.CLEAR_FAULTS, Request.STATUS]),
        (Request.CLEAR_FAULTS, "to_device", [Request.STATUS, Request.CLEAR_FAULTS]),
    ],
)
def test_what_must_not_be_done_twice_is_asked_for_first(
    line: SerialTransport, port: BenchPort, request_: Request, way: str, expected: list[Request]
) -> None:
    port.device.status = dataclasses.replace(port.device.status, faults=Fault.CHAIN)
    setattr(port, way, lose(1))
    line.command(request_)
    assert port.device.done[1:] == expected


@pytest.mark.parametrize("request_", [Request.RESET, Request.REVERT])
def test_a_restart_is_never_repeated(line: SerialTransport, port: BenchPort, request_: Request) -> None:
    port.to_host = lose(1)
    with pytest.raises(DeviceTimeoutError, match=f"ordering {request_.name}"):
        line.command(request_)
    assert port.device.done == [Request.INFO, request_]


# Blocks and records


def test_blocks_go_out_back_to_back(line: SerialTransport, port: BenchPort) -> None:
    blocks = b"".join(bytes(4) + bytes([number]) + bytes(507) for number in range(3))
    assert line.write_blocks(blocks, 1.0) == 3 * 512
    frames = [encode_frame(BLOCK_FRAME, blocks[at : at + 512]) for at in (0, 512, 1024)]
    assert b"".join(port.written[2:]).replace(b"\0\0", b"\0") == b"\0" + b"".join(frames)
    assert line.read_records(1.0) == ack(0) + ack(1) + ack(2)


def test_a_write_reports_the_blocks_that_went_out_in_time(line: SerialTransport, port: BenchPort) -> None:
    """At least one block goes out, and only whole ones."""
    port.to_device = lambda data: port.time.sleep(0.045) or data  # type: ignore[func-returns-value]
    assert line.write_blocks(bytes(5 * 512), 0.1) == 3 * 512
    assert line.write_blocks(bytes(5 * 512), 0) == 512


def test_records_that_come_while_an_answer_is_waited_for_are_kept(line: SerialTransport, port: BenchPort) -> None:
    port.device.say(FrameKind.RECORD, ack(8))
    line.query(Request.STATUS, Status.BYTES)
    assert line.read_records(0) == ack(8)
    assert line.read_records(0) == b""


def test_the_window_is_the_queue_and_one_but_not_more_than_a_stop_should_wait_for(port: BenchPort) -> None:
    """Clause SER-011. 522 bytes a block: at 115 200 baud 22 a second, so two; at 3 Mbaud 57 in 0.1 s."""
    slow = SerialTransport(port)
    assert [slow.window(free, 16) for free in (None, 0, 1, 7)] == [1, 1, 2, 2]
    assert slow.most_blocks_per_second == pytest.approx(11_520 / 522)
    slow.close()
    port.baudrate = 3_000_000
    fast = SerialTransport(port)
    assert [fast.window(free, 16) for free in (None, 0, 7, 32, 200)] == [1, 1, 8, 33, 57]
    fast.close()
    port.bytes_per_second = 53_248_000  # type: ignore[attr-defined]
    assert SerialTransport(port).most_blocks_per_second == pytest.approx(102_007, rel=1e-4)


def test_an_answer_may_take_as_long_as_the_blocks_before_it(line: SerialTransport, port: BenchPort) -> None:
    """Three blocks of 522 bytes, a request of 17, 1316 that may come before the answer, and 100 ms."""
    port.device.answers = False
    line.write_blocks(bytes(3 * 512), 1.0)
    start = port.time.now
    with pytest.raises(DeviceTimeoutError):
        line.command(Request.RESET)
    assert port.time.now - start == pytest.approx(0.1 + (3 * 522 + 17 + 1316) / 11_520, rel=0.01)


# Ports that fail


@pytest.mark.parametrize(
    "error", [serial.SerialException("gone"), OSError(errno.EIO, "gone"), termios.error(5, "gone")]
)
@pytest.mark.parametrize("where", ["in_waiting", "read", "write"])
def test_a_port_that_vanishes_is_a_lost_device(
    line: SerialTransport, port: BenchPort, where: str, error: Exception
) -> None:
    port.fails = {where: error, "close": error}
    with pytest.raises(DeviceLostError, match=r"asking for STATUS: the port is gone .*gone"):
        line.query(Request.STATUS, Status.BYTES)
    if where != "write":
        with pytest.raises(DeviceLostError):
            line.read_records(0.1)
    else:
        with pytest.raises(DeviceLostError, match="sending a block"):
            line.write_blocks(bytes(512), 0.1)
    line.close()


def test_a_port_that_takes_no_bytes_is_a_time_out_and_the_next_frame_is_whole(
    line: SerialTransport, port: BenchPort
) -> None:
    port.fails["write"] = serial.SerialTimeoutException("Write timeout")
    with pytest.raises(DeviceTimeoutError, match="sending a block: the port takes no bytes"):
        line.write_blocks(bytes(512), 1.0)
    port.fails.clear()
    port.device.receive(encode_frame(BLOCK_FRAME, bytes(512))[:100])  # the part that had gone out
    line.command(Request.DISABLE)
    assert port.device.done[-1] is Request.DISABLE
    assert not port.device.blocks


# Coming back


def test_the_same_device_is_opened_again(line: SerialTransport, port: BenchPort, genuine: tuple[Info, Status]) -> None:
    """It is away for a while, and then a port that may not be opened yet."""
    gone = serial.SerialException(errno.ENOENT, "gone")
    port.fails["open"] = gone
    port.device = HandMade(*genuine)
    real_sleep = port.time.sleep

    def sleep(seconds: float) -> None:
        real_sleep(seconds)
        if port.time.now > 2:
            port.fails["open"] = serial.SerialException(errno.EACCES, "not yet")
        if port.time.now > 3:
            port.fails.clear()

    port.time.sleep = sleep  # type: ignore[method-assign]  # looked on
    line.reopen(10)
    assert port.time.now == pytest.approx(3.05, abs=0.06)
    assert port.is_open
    assert line.query(Request.STATUS, Status.BYTES) == port.device.status.encode()


@pytest.mark.parametrize("other", [False, True])
def test_a_device_that_does_not_come_back_or_is_another_is_lost(
    line: SerialTransport, port: BenchPort, *, other: bool
) -> None:
    if other:
        port.device.info = dataclasses.replace(port.device.info, unique_id=bytes(8))
    else:
        port.to_host = lambda _: b""
    with pytest.raises(DeviceLostError, match="phasewire array 0123456789abcdef has not come back within 1 s"):
        line.reopen(1)
    assert 1 <= port.time.now < 1.5
    assert not port.is_open


# Whatever the line does


class Noise:
    """Loses bytes, flips bits and puts junk between, at random; a line that was quiet enough before stays so."""

    def __init__(self, seed: int, per_byte: float) -> None:
        self._random = random.Random(seed)
        self._per_byte = per_byte

    def __call__(self, data: bytes) -> bytes:
        found = bytearray()
        for byte in data:
            if self._random.random() >= self._per_byte:
                found.append(byte)
                continue
            match self._random.randrange(3):
                case 0:
                    found.append(byte ^ 1 << self._random.randrange(8))
                case 1:
                    found += bytes([byte, *self._random.randbytes(self._random.randrange(9))])
        return bytes(found)


REQUESTS = [Request.STATUS, Request.ENABLE, Request.DISABLE, Request.CLEAR_FAULTS, Request.RESET, Request.WATCHDOG]


@given(
    seed=st.integers(0, 2**32),
    per_byte=st.sampled_from([0.0, 0.001, 0.005, 0.02, 0.3]),
    orders=st.lists(st.sampled_from(REQUESTS), max_size=12),
)
def test_on_a_bad_line_no_request_acts_twice_harmfully_and_no_call_hangs(
    genuine: tuple[Info, Status], seed: int, per_byte: float, orders: list[Request]
) -> None:
    """A call that returns has been carried out, and every failure is a `DeviceError`."""
    info, status = genuine
    device = HandMade(info, dataclasses.replace(status, faults=Fault.OVERRUN))
    clock = Clock()
    port = BenchPort(device, clock, to_device=Noise(seed, per_byte), to_host=Noise(seed + 1, per_byte))
    try:
        line = SerialTransport(port)
    except DeviceError:
        assert per_byte
        return
    for order in orders:
        before, start = Counter(device.done), clock.now
        action = partial(line.query, order, Status.BYTES) if order is Request.STATUS else partial(line.command, order)
        try:
            answer = action()
        except DeviceTimeoutError:
            assert per_byte
        else:
            if order is Request.STATUS:
                assert answer == device.status.encode()
            assert device.done[-1] in (order, Request.STATUS)
            assert device.status.enabled or order is not Request.ENABLE
            assert not device.status.faults or order is not Request.CLEAR_FAULTS
        assert clock.now - start < 20
        times = (Counter(device.done) - before)[order]
        if order in (Request.RESET, Request.ENABLE, Request.CLEAR_FAULTS):
            assert times <= 1  # each is done by the first that arrives, and STATUS says so
        device.status = dataclasses.replace(device.status, state=State.OFF, faults=Fault.OVERRUN)
    line.close()


@given(st.lists(st.binary(max_size=300), max_size=20), st.randoms(use_true_random=False))
def test_records_arrive_whole_however_they_are_cut_and_whatever_stands_between(
    genuine: tuple[Info, Status], junk: list[bytes], chance: random.Random
) -> None:
    device = HandMade(*genuine)
    port = BenchPort(device, Clock())
    line = SerialTransport(port)
    stream = b"".join(piece + b"\0" + encode_frame(2, ack(number)) for number, piece in enumerate(junk))
    received = b""
    while stream:
        size = chance.randint(1, 200)
        device.says += stream[:size]
        stream = stream[size:]
        received += line.read_records(0)
    assert received == b"".join(ack(number) for number in range(len(junk)))


# The emulated device


def test_an_emulated_device_is_opened_asked_and_left_at_its_console(emulator: Emulator) -> None:
    with open_device(f"{emulator.url}?door=serial") as device:
        assert device.name == f"phasewire five-board array (emulated) {emulator.serial}"
        assert device.serial == emulator.serial
        assert device.status().dropped_frames == 0
        with pytest.raises(DeviceAccessError, match="is in use: another program has it open"):
            open_device(f"{emulator.url}?door=serial")
    assert emulator.line is not None
    emulator.line.receive(b"\r")
    assert emulator.line.take(100).endswith(b"> ")
