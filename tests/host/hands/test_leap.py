from __future__ import annotations

import json
import logging
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import TrackerError, TrackerLostError, TrackerNotFoundError
from phasewire.host.hands import HandFrame, leap, open_hands
from phasewire.host.hands.leap import LEAP, MOST_GARBLED, POLICIES, Address, LeapHands, ServiceClock
from phasewire.host.hands.liveness import STEADY_SECONDS
from websockets.sync.server import ServerConnection

from tests.host.hands.leap_service import PATIENCE, LeapService, leap_frame, sending


def newest(source: LeapHands, number: int) -> HandFrame:
    """The frame with this number, which is the last that the service sends."""
    for _ in range(10_000):
        frame = source.next_frame(PATIENCE)
        assert frame is not None
        if frame.number == number:
            return frame
    raise AssertionError(f"there was no frame {number}")


def opened(service: LeapService) -> LeapHands:
    source = open_hands(service.url)
    assert isinstance(source, LeapHands)
    return source


# A service that behaves


def test_hands_come_as_the_service_sees_them() -> None:
    heard: list[object] = []

    def script(connection: ServerConnection) -> None:
        heard.extend(json.loads(connection.recv(PATIENCE)) for _ in POLICIES)
        sending(*(leap_frame(number, 1e6 + 9e3 * number, {4: "right", 5: "left"}) for number in range(3)))(connection)

    with LeapService(script) as service, opened(service) as source:
        assert source.live
        frames = [next(source) for _ in range(3)]
        assert source.version == "2.3.1+33747"
        assert source.rate == 110.5
    assert service.paths == ["/v6.json"]
    assert heard == [{"background": True}, {"focused": True}, {"optimizeHMD": False}]
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert [(hand.id, hand.hand.side) for hand in frames[2].hands] == [(4, "right"), (5, "left")]
    assert all(after.time >= before.time for before, after in pairwise(frames))
    assert source.ended


def test_what_the_service_says_of_its_devices() -> None:
    def event(number: str, attached: bool, streaming: bool) -> dict[str, Any]:
        state = {"attached": attached, "id": number, "streaming": streaming, "type": "Peripheral"}
        return {"event": {"type": "deviceEvent", "state": state}}

    said: list[dict[str, Any]] = [{"event": 7}, event("A", True, True), event("A", False, False), leap_frame(1)]
    with LeapService(sending(*said)) as service, opened(service) as source:
        newest(source, 1)
        assert source.notes == (leap.NO_DEVICE,)
    with LeapService(sending(event("B", True, True), leap_frame(1))) as service, opened(service) as source:
        newest(source, 1)
        assert (source.notes, source.devices) == ((), {"B": True})


# One that does not

GARBAGE: dict[str, str | bytes] = {
    "no json": "hello",
    "bytes": b"\xff\xfe\x00",
    "a list": "[]",
    "a number": "1",
    "nothing": "",
    "no hands": '{"id": 1, "timestamp": 2}',
    "hands that are none": '{"hands": [1], "pointables": []}',
    "too many hands": json.dumps({"hands": [{}] * 17, "pointables": []}),
    **{f"no {name}": json.dumps({**leap_frame(), name: None}) for name in ("id", "timestamp")},
    "an id of text": json.dumps({**leap_frame(), "id": "5"}),
    "a time that is none": json.dumps({**leap_frame(), "timestamp": float("nan")}),
    "a time without end": json.dumps({**leap_frame(), "timestamp": 10**400}),
    "nested": "[" * 50_000,
    "digits": '{"id": ' + "9" * 100_000 + "}",
}


@pytest.mark.parametrize("garbage", GARBAGE.values(), ids=GARBAGE)
def test_a_message_that_is_no_frame_is_counted_and_passed_over(garbage: str | bytes) -> None:
    with LeapService(sending(garbage, leap_frame(1), garbage, leap_frame(2))) as service, opened(service) as source:
        newest(source, 2)
        assert source.garbled == 2


def test_a_service_that_sends_only_garbage_is_lost() -> None:
    with LeapService(sending(*["hello"] * MOST_GARBLED * 20)) as service, opened(service) as source:
        with pytest.raises(TrackerLostError, match="sends messages that are no frames"):
            source.next_frame(PATIENCE)
        assert source.ended


def test_of_a_flood_the_newest_frame_is_given_and_the_others_are_counted() -> None:
    count = 3000
    flood = [json.dumps(leap_frame(number, number)) for number in range(count)]
    taken = 0
    with LeapService(sending(*flood)) as service, opened(service) as source:
        last = -1
        while last < count - 1:
            frame = source.next_frame(PATIENCE)
            assert frame is not None
            assert frame.number > last
            last = frame.number
            taken += 1
        assert taken + source.dropped == count
        assert source.next_frame(0) is None


def test_a_source_can_be_closed_while_its_service_stalls() -> None:
    service = LeapService(lambda connection: service.stall(connection))
    with service:
        source = opened(service)
        source.close()
        source.close()
        assert "leap" not in [thread.name for thread in threading.enumerate()]
        assert source.next_frame(0) is None


def tear(connection: ServerConnection) -> None:
    connection.socket.shutdown(socket.SHUT_RDWR)


ENDS: dict[str, Callable[[ServerConnection], object]] = {
    "it closes": lambda connection: connection.close(),
    "it ends": lambda connection: None,
    "the line is cut": tear,
    "a message without measure": lambda connection: connection.send("[" * 2**22),
    "bytes that are no message": lambda connection: connection.socket.sendall(b"\x00\xff" * 1000),
    "text that is none": lambda connection: connection.socket.sendall(b"\x81\x02\xff\xff"),
}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS)
def test_a_service_that_goes_away_is_lost_after_its_last_frame(end: Callable[[ServerConnection], object]) -> None:
    received = threading.Event()

    def script(connection: ServerConnection) -> None:
        connection.send(json.dumps(leap_frame(1)))
        if end is tear:  # a reset discards what has not been read yet
            received.wait(PATIENCE)
        end(connection)

    with LeapService(script) as service, opened(service) as source:
        newest(source, 1)
        received.set()
        with pytest.raises(TrackerLostError, match=f"the Leap service at 127.0.0.1:{service.port} has closed"):
            source.next_frame(PATIENCE)


# A server that is no Leap service


def test_a_silent_server_is_no_service() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = Address("127.0.0.1", server.getsockname()[1])
        with pytest.raises(TrackerNotFoundError, match="is no Leap service: timed out"):
            LeapHands(address, patience=0.1)
    silent = LeapService(lambda connection: silent.stall(connection), greeting=None)
    with silent, pytest.raises(TrackerNotFoundError, match=r"does not greet as a Leap service|timed out"):
        LeapHands(Address("127.0.0.1", silent.port), patience=0.5)


@pytest.mark.parametrize(
    ("answer", "endless"),
    [
        (b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n", False),
        (b"HTTP/1.1 302 Found\r\nLocation: ws://example/\r\n\r\n", False),
        (b"HTTP/1.1 101 Swi", False),
        (b"hello\r\n", False),
        (b"", False),
        (bytes(1000), False),
        (bytes(2**16), True),
        (b"\xff" * 2**16, True),
    ],
)
def test_another_server_is_no_service(
    answer: bytes, endless: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # as in a program that sets up no logging
    with socket.create_server(("127.0.0.1", 0)) as server:

        def respond() -> None:
            connection, _ = server.accept()
            with connection, suppress(OSError):
                connection.recv(4096)
                connection.sendall(answer)
                while endless:
                    connection.sendall(answer)

        thread = threading.Thread(target=respond, daemon=True)
        thread.start()
        with pytest.raises(TrackerNotFoundError, match=r"is no Leap service: \w"):
            LeapHands(Address("127.0.0.1", server.getsockname()[1]), patience=0.5)
        thread.join(PATIENCE)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("greeting", "error", "message"),
    [
        ('{"version": 5}', TrackerError, "speaks version 5 of its protocol, not 6; install"),
        ('{"version": 60000000000000000000000000}', TrackerError, "speaks version 60000000000000000000 of"),
        ("{}", TrackerError, "speaks version None"),
        ("hello", TrackerNotFoundError, "does not greet"),
        (b"\xff", TrackerNotFoundError, "does not greet"),
        ("[" * 100_000, TrackerNotFoundError, "does not greet"),
    ],
)
def test_a_service_of_another_version_is_refused(
    greeting: str | bytes, error: type[TrackerError], message: str
) -> None:
    with LeapService(sending(), greeting) as service, pytest.raises(error, match=message) as failed:
        opened(service)
    assert type(failed.value) is error


def test_a_probe_connects_and_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    with LeapService(sending()) as service:
        monkeypatch.setattr(leap, "PROBE_PATIENCE", PATIENCE)
        monkeypatch.setattr(Address, "__new__", lambda cls: tuple.__new__(cls, ("127.0.0.1", service.port)))
        ready = LEAP.probe()
        assert ready.ready
        assert ready.says == f"Leap service at 127.0.0.1:{service.port}, version 2.3.1+33747, answers"
    assert not LEAP.probe().ready


# URLs


@pytest.mark.parametrize(
    ("text", "host", "port", "shown"),
    [
        ("", "127.0.0.1", 6437, "127.0.0.1:6437"),
        ("tracker.local", "tracker.local", 6437, "tracker.local:6437"),
        ("tracker:1", "tracker", 1, "tracker:1"),
        (":7000", "127.0.0.1", 7000, "127.0.0.1:7000"),
        ("[::1]:65535", "::1", 65535, "[::1]:65535"),
    ],
)
def test_addresses(text: str, host: str, port: int, shown: str) -> None:
    address = Address.parse(text)
    assert (address, str(address)) == ((host, port), shown)


@pytest.mark.parametrize(
    "text", ["a:0", "a:65536", "a:b", "a b", "http://a", "::1", "a:1:2", "a:١", "hands.txt/", "a\n"]
)
def test_an_invalid_address_of_a_service_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no address of a service; such a URL has the form leap:, leap:HOST:PORT"):
        open_hands(f"leap:{text}")


# Clocks


@given(
    st.lists(st.tuples(st.floats(0.001, 0.02), st.floats(0, 0.05)), min_size=1, max_size=50),
    st.floats(-1e6, 1e6),
)
def test_the_frame_with_the_shortest_way_sets_the_clock(steps: list[tuple[float, float]], offset: float) -> None:
    clock = ServiceClock()
    stamps = np.cumsum([step for step, _ in steps])
    arrivals = np.maximum.accumulate(stamps + [late for _, late in steps])
    best, last = np.inf, -np.inf
    for stamp, arrival in zip(stamps, arrivals, strict=True):
        best = min(best, arrival - stamp)
        found = clock.seen((stamp + offset) * 1e6, arrival)
        slack = ServiceClock.DRIFT * (arrival - arrivals[0]) + 1e-8
        assert best - 1e-8 <= max(found, stamp + best) - stamp <= best + slack
        assert last <= found <= arrival + 1e-8
        last = found


@pytest.mark.parametrize("first", [0.0, 1e9], ids=["back", "ahead"])
def test_a_service_that_restarts_sets_the_clock_again_once_it_keeps_pace(first: float) -> None:
    clock = ServiceClock()
    assert clock.seen(9e6, 100.0) == 100.0
    assert clock.seen(9e6 + 1e4, 100.02) == pytest.approx(100.01, abs=1e-4)
    times = [clock.seen(first + 1e4 * count, 101 + 0.01 * count) for count in range(80)]
    steady = round(100 * STEADY_SECONDS)
    assert times[:steady] == [pytest.approx(100.01, abs=1e-4)] * steady
    assert times[steady + 1 :] == pytest.approx(101 + 0.01 * np.arange(steady + 1, 80), abs=1e-4)


HUNG: dict[str, Callable[[int], float]] = {
    "stands still": lambda _: 1e6,
    "creeps": lambda count: 1e6 + count,
    "is slow": lambda count: 1e6 + 5e3 * count,
    "is late from some time on": lambda count: 1e6 + 1e4 * (min(count, 50) if count < 250 else count - 200),
    "jumps back and forth": lambda count: 1e6 - 7e5 * (count % 3),
    "jumps far": lambda count: 1e6 - 1e7 * (count % 3),
    "goes in circles": lambda count: 1e6 + 1e4 * (count % 20),
}


@pytest.mark.parametrize("stamp", HUNG.values(), ids=HUNG)
def test_a_stamp_of_a_service_that_hangs_never_becomes_young_again(stamp: Callable[[int], float]) -> None:
    """However long it comes, its time is that of the newest stamp, by the clock as it was, but for the drift."""
    clock, newest = ServiceClock(), 0.0
    for count in range(2000):  # twenty seconds
        newest = max(newest, stamp(count))
        slack = ServiceClock.DRIFT * 0.01 * count + 1e-9
        assert clock.seen(stamp(count), 100 + 0.01 * count) <= 100 + (newest - 1e6) * 1e-6 + slack
