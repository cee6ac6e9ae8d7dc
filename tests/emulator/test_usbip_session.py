"""Sessions of USB/IP without a socket: the client's bytes go straight in, and time passes when it waits."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.emulator.doors.station import Pace, Station
from phasewire.emulator.doors.usbip_session import Exported, UsbIpSession
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.requests import Setup

from tests.emulator.stand_ins import StandInDevice
from tests.emulator.usbip_client import Client, setup

TAKEN_BACK = -104  # ECONNRESET
FIRST_LOOK, SECOND_LOOK = setup(0x80, 6, 0x0100, 0, 64), setup(0x80, 6, 0x0100, 0, 18)


class Desk:
    """Two devices, and clients of them at the fast pace."""

    def __init__(self) -> None:
        self.devices = [StandInDevice(), StandInDevice()]
        self.clock = 0.0
        self.stations = [Station(Scheduler(), Pace.FAST, lambda: self.clock) for _ in self.devices]
        self.exports = {
            f"1-{number}": Exported(1, number, device, station)
            for number, (device, station) in enumerate(zip(self.devices, self.stations, strict=True), start=1)
        }

    @property
    def device(self) -> StandInDevice:
        return self.devices[0]

    @property
    def scheduler(self) -> Scheduler:
        return self.stations[0].scheduler

    def client(self) -> tuple[Client, UsbIpSession]:
        session = UsbIpSession(self.exports)

        def send(data: bytes) -> None:
            session.receive(data)

        def receive(count: int) -> bytes:
            self.run(session)
            if session.pending < count:
                raise EOFError
            return session.take(count)

        return Client(send, receive), session

    def run(self, session: UsbIpSession) -> None:
        if session.station:
            assert session.station.pass_time(1.0)

    def attached(self) -> tuple[Client, UsbIpSession]:
        client, session = self.client()
        assert client.attach("1-1") == 0
        return client, session


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_packets_go_both_ways(desk: Desk) -> None:
    client, _ = desk.attached()
    assert client.write(0x01, bytes(1000))[2:4] == (0, 1000)
    assert [len(packet) for _, packet in desk.device.taken] == [512, 488]
    assert client.wait_for(client.submit(0x01, 512, bytes(512), flags=0x0040)).status == 0  # and an empty packet
    assert [len(packet) for _, packet in desk.device.taken[2:]] == [512, 0]
    desk.device.give(0x81, b"r" * 32, b"s" * 64)
    assert client.read(0x81, 512).data == b"r" * 32
    number = client.submit(0x81, 512, flags=0x0001)
    assert client.wait_for(number)[2:] == (-121, 64, b"s" * 64)  # EREMOTEIO: short was not OK


@pytest.mark.parametrize(("bus_id", "status"), [("1-3", 4), ("", 4), ("1-1", 2)])
def test_an_absent_or_attached_device_cannot_be_attached(desk: Desk, bus_id: str, status: int) -> None:
    desk.attached()
    client, session = desk.client()
    assert client.attach(bus_id) == status
    assert session.over
    assert session.end


def test_another_device_can_be_attached_and_each_again_after_its_client_left(desk: Desk) -> None:
    _, first = desk.attached()
    second, _ = desk.client()
    assert second.attach("1-2") == 0
    first.hang_up()
    assert desk.device.happened == ["unplug", "plug"]
    assert desk.stations[0].conversations == []
    desk.attached()
    first.hang_up()  # again, and late: it has no device any more
    assert desk.device.happened == ["unplug", "plug"]


def test_a_waiting_transfer_can_be_cancelled(desk: Desk) -> None:
    client, _ = desk.attached()
    first, second = client.submit(0x81, 512), client.submit(0x81, 512)
    unlink = client.unlink(first)
    assert client.answer()[:3] == (4, unlink, TAKEN_BACK)
    desk.scheduler.at(desk.scheduler.now + 10_000, lambda: desk.device.give(0x81, b"r" * 32))
    client.write(0x01, b"say something")
    assert client.wait_for(second).data == b"r" * 32
    with pytest.raises(EOFError):
        client.answer()  # nothing for the first


def test_a_finished_transfer_cannot_be_cancelled(desk: Desk) -> None:
    client, _ = desk.attached()
    done = client.submit(0x01, 512, bytes(512))
    client.wait_for(done)
    assert client.wait_for(client.unlink(done)).status == 0


@pytest.mark.parametrize("start", [0x1000, 0xFFFF_FFFE])
def test_a_transfer_may_be_cancelled_before_it_comes(desk: Desk, start: int) -> None:
    """Linux sends cancellations and transfers from two queues; the numbers wrap after 32 bits."""
    client, _ = desk.attached()
    client.wait_for(client.submit(0x01, 512, b"1" * 512, number=start))
    unlinked, unlink, other = ((start + step) % 2**32 for step in (2, 3, 4))
    client.unlink(unlinked, number=unlink)
    with pytest.raises(EOFError):
        client.answer()  # it is kept until the transfer comes
    client.submit(0x01, 512, b"2" * 512, number=unlinked)
    assert client.answer()[:3] == (4, unlink, TAKEN_BACK)
    client.wait_for(client.submit(0x01, 512, b"3" * 512, number=other))
    assert [packet[:1] for _, packet in desk.device.taken] == [b"1", b"3"]


def test_a_transfer_of_the_last_connection_is_cancelled_at_once() -> None:
    """Linux still cancels what it submitted before the device attached itself again, and waits for the answer."""
    client, _ = Desk().attached()
    client.unlink(7, number=8)
    assert client.answer()[:3] == (4, 8, TAKEN_BACK)
    client.wait_for(client.submit(0x01, 512, b"1" * 512, number=9))


def test_a_cancelled_transfer_reports_how_much_was_sent(desk: Desk) -> None:
    client, session = desk.attached()
    desk.device.room = 2
    sent = client.submit(0x01, 1536, bytes(1536))
    desk.run(session)
    unlink = client.unlink(sent)
    answer = client.answer()
    assert (answer.number, answer.status, answer.length) == (sent, TAKEN_BACK, 1024)
    assert client.answer()[:3] == (4, unlink, 0)


def test_a_cancelled_transfer_loses_no_received_bytes(desk: Desk) -> None:
    client, session = desk.attached()
    wanted = client.submit(0x81, 1024)
    desk.device.give(0x81, b"r" * 512)
    desk.run(session)
    unlink = client.unlink(wanted)
    answer = client.answer()
    assert (answer.number, answer.status, answer.data) == (wanted, TAKEN_BACK, b"r" * 512)
    assert client.answer()[:3] == (4, unlink, 0)


def test_a_bus_reset_is_inferred_when_a_host_begins_to_enumerate(desk: Desk) -> None:
    client, _ = desk.attached()
    client.enumerate()
    assert desk.device.happened == ["reset"]
    assert desk.device.configuration == 1
    client.descriptor(1, 18)
    assert desk.device.happened == ["reset"]  # that was a program that only reads descriptors
    client.descriptor(1, 64)
    client.descriptor(1, 9)
    client.descriptor(1, 18)
    assert desk.device.happened == ["reset"]
    client.enumerate()
    assert desk.device.happened == ["reset", "reset"]


def test_no_bus_reset_is_inferred_during_a_transfer(desk: Desk) -> None:
    client, _ = desk.attached()
    client.submit(0x81, 512)
    client.descriptor(1, 64)
    client.descriptor(1, 18)
    assert desk.device.happened == []


def test_a_device_that_attaches_again_ends_the_connection_and_keeps_its_power(desk: Desk) -> None:
    client, session = desk.attached()
    client.submit(0x81, 512)

    def come_back() -> None:
        desk.device.generation += 1
        desk.device.give(0x81, b"from another life")

    desk.scheduler.at(200_000, come_back)
    client.submit(0x01, 8, b"go away!")
    assert client.answer().status == 0
    desk.run(session)
    assert (session.over, session.pending) == (True, 0)
    assert "left the bus" in session.end
    assert desk.device.happened == []
    desk.attached()


def test_a_device_that_leaves_the_bus_over_a_request_still_answers_it(desk: Desk) -> None:
    """As one that enters a test mode does (USB 2.0, 9.4.9)."""
    client, session = desk.attached()

    def leave(setup: Setup, data: bytes = b"") -> bytes:
        desk.device.attached = False
        return b""

    desk.device.control = leave  # type: ignore[method-assign]  # made to leave
    assert client.request(0x00, 3, 2, 0x0100).status == 0
    assert session.over


def test_a_device_that_does_not_come_back_from_a_reset_ends_the_connection(desk: Desk) -> None:
    client, session = desk.attached()
    client.descriptor(1, 64)
    desk.device.reset = lambda: setattr(desk.device, "attached", False)  # type: ignore[method-assign]  # made to leave
    client.submit(0x80, 18, setup=SECOND_LOOK)
    with pytest.raises(EOFError):
        client.answer()
    assert "did not attach" in session.end


def test_a_client_does_not_wait_long_for_a_device(desk: Desk) -> None:
    desk.device.attached = False
    desk.scheduler.run_until(1_000_000)
    client, session = desk.client()
    assert client.attach("1-1") == 1
    assert desk.scheduler.now == 401_000_000  # a second later
    assert "did not attach" in session.end


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (b"\xff" * 48, "command 4294967295"),
        (struct.pack(">5I", 1, 1, 0x10002, 1, 1) + struct.pack(">7I", 0, 64, 0, 0, 0, 0, 0), "device 0x10002"),
        (struct.pack(">5I", 2, 1, 0x10002, 0, 0) + bytes(28), "device 0x10002"),
        (struct.pack(">5I", 1, 1, 0x10001, 1, 1) + struct.pack(">7I", 0, 64, 0, 5, 0, 0, 0), "isochronous"),
        (struct.pack(">5I", 1, 1, 0x10001, 0, 1) + struct.pack(">7I", 0, 2**31, 0, 0, 0, 0, 0), "2147483648 bytes"),
    ],
)
def test_a_client_that_breaks_the_protocol_is_dropped_and_its_device_unplugged(
    desk: Desk, command: bytes, reason: str
) -> None:
    _, session = desk.attached()
    session.receive(command)
    assert session.over
    assert reason in session.end
    assert desk.device.happened == ["unplug", "plug"]
    session.receive(command)
    assert session.pending == 0


def test_a_client_may_not_use_a_number_twice_at_once() -> None:
    client, session = Desk().attached()
    client.submit(0x81, 512, number=5)
    client.submit(0x81, 512, number=5)
    assert "second transfer 5" in session.end


def test_a_client_s_pending_transfers_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phasewire.emulator.doors.usbip_session.MOST_TRANSFERS", 5)
    monkeypatch.setattr("phasewire.emulator.doors.usbip_session.MOST_BYTES", 3000)
    desk = Desk()
    client, session = desk.attached()
    for _ in range(5):
        client.write(0x01, bytes(1000))  # one after the other: few bytes at a time
    desk.device.room = 0
    for _ in range(3):
        client.submit(0x01, 1000, bytes(1000))
    client.wait_for(client.unlink(client.number))
    client.submit(0x01, 1000, bytes(1000))
    assert not session.over
    client.submit(0x01, 1, b"1")
    assert session.over
    client, session = desk.attached()
    for _ in range(5):
        client.submit(0x81, 512)
    assert not session.over
    client.submit(0x81, 512)
    assert session.over
    client, session = desk.attached()
    client.submit(0x81, 512)
    for number in range(5):
        client.unlink(2**20 + number, number=1)
    assert not session.over
    client.unlink(2**21, number=1)
    assert session.over


def test_a_client_that_does_not_read_gets_nothing_more(desk: Desk) -> None:
    client, session = desk.attached()
    desk.device.give(0x81, *[bytes(512)] * 8192)
    for _ in range(4):
        client.submit(0x81, 1 << 20)
    desk.run(session)
    assert session.full
    assert session.next_time(None) is None
    assert 0 <= 8192 - 2048 - len(desk.device.given[0x81]) < 104, "no more than a bus carries in a millisecond"
    assert len(client.answer().data) == 1 << 20


FIELDS = st.tuples(
    st.sampled_from([1, 1, 1, 2, 3]),
    st.integers(1, 6),
    st.sampled_from([0x10001, 0x10001, 0x10001, 0]),
    st.integers(0, 1),
    st.integers(0, 4),
    st.sampled_from([0, 1, 0x40, 3]),
    st.integers(0, 700),
    st.sampled_from([FIRST_LOOK, SECOND_LOOK, setup(0, 9, 1, 0, 0), bytes(8), b"\xff" * 8]),
)


@settings(max_examples=50, deadline=None)
@given(st.lists(FIELDS, max_size=12))
def test_no_commands_of_a_client_raise_anything(
    commands: list[tuple[Any, ...]],
) -> None:
    desk = Desk()
    desk.device.give(0x81, *[bytes(512)] * 3, bytes(32))
    _, session = desk.attached()
    for code, number, device, direction, endpoint, flags, length, stage in commands:
        head = struct.pack(">10I", code, number, device, direction, endpoint, flags, length, 0, 0, 0)
        session.receive(head + stage + (b"" if direction or code != 1 else bytes(length)))
        desk.run(session)
        session.take(1 << 20)
    assert session.over == (session.station is None)
