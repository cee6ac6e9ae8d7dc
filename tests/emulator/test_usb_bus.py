from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.doors.usb_bus import Transfer, TransferOutcome, UsbBus
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.enumeration import FULL_SPEED
from phasewire.protocol.requests import Setup

from tests.emulator.stand_ins import StandInDevice

NO_SETUP = Setup(0, 0, 0, 0, 0)
PACKET = 3846  # core cycles of 2.5 ns: a thirteenth of 125 µs
MICROFRAME = 50_000
FRAME = 400_000


class Bench:
    """A bus, its device, and how transfers on it ended."""

    def __init__(self, device: StandInDevice | None = None) -> None:
        self.device = device or StandInDevice()
        self.scheduler = Scheduler()
        self.bus = UsbBus(self.device, self.scheduler)
        self.ended: list[tuple[Transfer, TransferOutcome]] = []

    def out(self, data: bytes, endpoint: int = 0x01, zero_packet: bool = False) -> Transfer:
        return self.submit(endpoint, len(data), data, zero_packet=zero_packet)

    def into(self, length: int, endpoint: int = 0x81, short_not_ok: bool = False) -> Transfer:
        return self.submit(endpoint, length, b"", short_not_ok=short_not_ok)

    def request(self, setup: Setup, data: bytes = b"", length: int | None = None) -> Transfer:
        size = setup.length if length is None else length
        return self.submit(0x80 if setup.is_in else 0x00, size, data, setup)

    def submit(
        self,
        endpoint: int,
        length: int,
        data: bytes,
        setup: Setup = NO_SETUP,
        zero_packet: bool = False,
        short_not_ok: bool = False,
    ) -> Transfer:
        transfer = Transfer(
            endpoint, length, data, setup, zero_packet, short_not_ok, lambda *end: self.ended.append(end)
        )
        self.bus.submit(transfer)
        return transfer

    def run(self) -> int:
        """Let time pass until nothing is left to do; returns how much it was."""
        begin = self.scheduler.now
        while (time := self.bus.next_time(self.scheduler.next_time())) is not None:
            self.scheduler.run_until(time)
            self.bus.run()
        return self.scheduler.now - begin

    @property
    def outcomes(self) -> list[TransferOutcome]:
        return [outcome for _, outcome in self.ended]


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize(
    ("size", "zero_packet", "packets"),
    [
        (0, False, [0]),
        (0, True, [0]),
        (1, False, [1]),
        (512, False, [512]),
        (512, True, [512, 0]),
        (513, True, [512, 1]),
        (1536, False, [512, 512, 512]),
    ],
)
def test_a_transfer_is_cut_into_packets(bench: Bench, size: int, zero_packet: bool, packets: list[int]) -> None:
    transfer = bench.out(bytes(size), zero_packet=zero_packet)
    assert bench.run() == len(packets) * PACKET
    assert [len(packet) for _, packet in bench.device.taken] == packets
    assert bench.ended == [(transfer, TransferOutcome.DONE)]
    assert transfer.sent == size


@given(st.lists(st.tuples(st.sampled_from([0, 1, 512, 1024, 1536, 1600, 20_480]), st.booleans()), max_size=12))
def test_transfers_that_are_sent_together_are_the_same_as_one_by_one(sizes: list[tuple[int, bool]]) -> None:
    ends = []
    for at_once in (0, 1, 3, 10**6):
        bench = Bench()
        bench.device.streams = (bench.scheduler, at_once)
        sent = [bench.out(bytes([n]) * size, zero_packet=zero) for n, (size, zero) in enumerate(sizes)]
        assert [transfer for transfer, _ in bench.ended] == []
        ends.append((bench.run(), bench.bus.last_word, bench.device.taken))
        assert bench.ended == [(transfer, TransferOutcome.DONE) for transfer in sent]
        assert [transfer.sent for transfer in sent] == [size for size, _ in sizes]
    assert all(end == ends[0] for end in ends)


@pytest.mark.parametrize(
    ("length", "packets", "outcome", "received"),
    [
        (512, [64], TransferOutcome.DONE, 64),
        (512, [512], TransferOutcome.DONE, 512),
        (1024, [512, 96], TransferOutcome.DONE, 608),
        (1024, [512, 0], TransferOutcome.DONE, 512),
        (1024, [512, 512], TransferOutcome.DONE, 1024),
        (100, [64, 64], TransferOutcome.DONE, 64),
        (32, [64], TransferOutcome.OVERFLOW, 0),
        (600, [512, 100], TransferOutcome.OVERFLOW, 512),
        (0, [0], TransferOutcome.DONE, 0),
    ],
)
def test_a_short_packet_or_a_full_buffer_ends_a_transfer_in(
    bench: Bench, length: int, packets: list[int], outcome: TransferOutcome, received: int
) -> None:
    bench.device.give(0x81, *(bytes([number]) * size for number, size in enumerate(packets)))
    transfer = bench.into(length)
    bench.run()
    assert bench.outcomes == [outcome]
    assert len(transfer.received) == received


def test_transfers_of_an_endpoint_keep_their_order_and_endpoints_take_turns(bench: Bench) -> None:
    first, second = bench.out(b"a" * 1024), bench.out(b"b" * 512)
    console = bench.out(b"c" * 1024, 0x03)
    bench.run()
    assert [packet[:1] for _, packet in bench.device.taken] == [b"a", b"c", b"a", b"c", b"b"]
    assert [transfer for transfer, _ in bench.ended] == [first, console, second]


@pytest.mark.parametrize("streams", [0, 10**6])
def test_records_keep_up_with_the_blocks_of_a_stream(bench: Bench, streams: int) -> None:
    """Acknowledgements of 16 blocks fill a packet; if each waited for a stream, a device could hold no more of them."""
    bench.device.streams = (bench.scheduler, streams)
    bench.device.give(0x81, *(bytes([number]) * 512 for number in range(20)), b"")
    bench.out(bytes(512 * 400))
    answers = [bench.into(2048) for _ in range(6)]
    assert bench.run() == (400 + 21) * PACKET
    assert b"".join(bytes(each.received[::512]) for each in answers) == bytes(range(20))
    ended = [transfer for transfer, _ in bench.ended]
    assert ended[-1].length == 512 * 400
    assert ended[:-1] == answers


def test_a_transfer_that_gets_nak_waits_for_an_event_of_the_device(bench: Bench) -> None:
    bench.device.room = 1
    bench.out(bytes(1024))
    bench.into(512)
    assert (bench.bus.presses, bench.bus.stuck) == (True, False)
    bench.run()
    assert (bench.ended, len(bench.device.taken)) == ([], 1)
    assert bench.bus.next_time(None) is None
    assert (bench.bus.presses, bench.bus.stuck) == (False, True)

    def make_room() -> None:
        bench.device.room = 1
        bench.device.give(0x81, bytes(32))

    bench.scheduler.at(1_000_000, make_room)
    bench.run()
    assert bench.outcomes == [TransferOutcome.DONE, TransferOutcome.DONE]
    assert 1_000_000 <= bench.scheduler.now < 1_000_000 + 3 * PACKET


def test_a_pending_transfer_in_is_neither_pressing_nor_stuck(bench: Bench) -> None:
    bench.into(512)
    assert (bench.bus.presses, bench.bus.stuck) == (True, False)
    bench.run()
    assert (bench.bus.presses, bench.bus.stuck, bench.bus.last_word) == (False, False, None)
    bench.out(b"word")
    bench.run()
    assert bench.bus.last_word == 2 * PACKET
    bench.request(Setup(0x80, 6, 0x0100, 0, 18))
    bench.run()
    assert bench.bus.last_word == 3 * PACKET + MICROFRAME


def test_requests_take_a_microframe_each_and_go_first(bench: Bench) -> None:
    bench.out(bytes(512))
    device = bench.request(Setup(0x80, 6, 0x0100, 0, 18))
    configure = bench.request(Setup(0x00, 9, 1, 0, 0))
    bench.run()
    assert [transfer.queue for transfer, _ in bench.ended] == [0, 0, 1]
    assert device.received == bench.device.enumeration.device.encode()
    assert (len(configure.received), bench.device.configuration) == (0, 1)
    alone = Bench()
    alone.request(Setup(0x80, 6, 0x0100, 0, 18))
    assert alone.run() == MICROFRAME


@pytest.mark.parametrize(
    ("ask", "outcome"),
    [
        (
            lambda bench: bench.request(Setup(0x80, 6, 0x0100, 0, 64)),
            TransferOutcome.DONE,
        ),  # 18 bytes come: not an error
        (lambda bench: bench.request(Setup(0x41, 9, 0, 0, 3), b"abc"), TransferOutcome.DONE),
        (lambda bench: bench.request(Setup(0xC1, 99, 0, 0, 8)), TransferOutcome.STALLED),
        (lambda bench: bench.request(Setup(0x80, 6, 0x0100, 0, 18), length=8), TransferOutcome.MALFORMED),
        (lambda bench: bench.request(Setup(0x41, 9, 0, 0, 3), b"ab", length=2), TransferOutcome.MALFORMED),
    ],
)
def test_requests_end_as_they_should(bench: Bench, ask: Callable[[Bench], Transfer], outcome: TransferOutcome) -> None:
    ask(bench)
    bench.run()
    assert bench.outcomes == [outcome]


def test_a_request_may_not_go_both_ways(bench: Bench) -> None:
    wrong = Transfer(
        0x00, 18, bytes(18), Setup(0x80, 6, 0x0100, 0, 18), False, False, lambda *end: bench.ended.append(end)
    )
    bench.bus.submit(wrong)
    bench.run()
    assert (bench.outcomes, bench.device.requests) == ([TransferOutcome.MALFORMED], [])


def test_a_full_speed_bus_carries_nineteen_small_packets_in_a_frame() -> None:
    bench = Bench(StandInDevice(FULL_SPEED))
    bench.out(bytes(19 * 64))
    assert FRAME - 19 < bench.run() <= FRAME
    assert {len(packet) for _, packet in bench.device.taken} == {64}


def test_a_high_speed_bus_carries_thirteen_packets_in_a_microframe(bench: Bench) -> None:
    bench.out(bytes(13 * 512))
    assert MICROFRAME - 13 < bench.run() <= MICROFRAME
