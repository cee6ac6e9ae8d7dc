"""The controller through its USB side: blocks in, acknowledgements out, square waves after."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Emulator, Pulses
from phasewire.emulator.boards.processor import Processor
from phasewire.emulator.door import Handshake
from phasewire.protocol import Ack, Status
from phasewire.protocol.chain import Message
from phasewire.protocol.codes import Request
from phasewire.protocol.replies import records
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.passing import now, pass_until
from tests.strategies import update

FULL = Pulses(np.full(320, 25), np.full(320, 25))
PERIOD = 10_000


def order(emulator: Emulator, request: Request) -> None:
    emulator.usb.control(Setup(0x41, request, 0, 0, 0))


def status(emulator: Emulator) -> Status:
    return Status.decode(emulator.usb.control(Setup(0xC1, Request.STATUS, 0, 0, 64)))


def send(emulator: Emulator, block: bytes) -> Ack:
    assert emulator.usb.bulk_out(0x01, block) is Handshake.ACK
    return read_ack(emulator)


def send_in_time(emulator: Emulator, block: bytes) -> None:
    """Send a block as soon as the device takes it."""
    while emulator.usb.bulk_out(0x01, block) is Handshake.NAK:
        upcoming = emulator.scheduler.next_time()
        assert upcoming is not None
        pass_until(emulator, upcoming)


def read_ack(emulator: Emulator) -> Ack:
    """The only acknowledgement that waits."""
    answer = emulator.usb.bulk_in(0x81)
    assert isinstance(answer, bytes)
    (ack,) = (record for record in records(answer) if isinstance(record, Ack))
    return ack


def ready(link: Link = FIVE_WIRE, *, unfolded: bool = False) -> Emulator:
    emulator = Emulator(link=link, unfolded=unfolded)
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    order(emulator, Request.ENABLE)
    return emulator


def loudness(emulator: Emulator) -> np.ndarray:
    """Number of outputs that are high, per tick since power-up."""
    capture = emulator.capture()
    return np.asarray(capture.channels(0, capture.end_tick).sum(axis=1, dtype=int))


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE])
@given(arrival=st.integers(0, 3 * PERIOD))
def test_the_fifth_period_after_arrival_is_always_in_time(link: Link, arrival: int) -> None:
    """Clause BLK-005; and no sooner than the hardware can, which the first period never is."""
    emulator = ready(link)
    pass_until(emulator, arrival)
    fifth = arrival // PERIOD + 5
    ack = send(emulator, update(FULL, 0, fifth))
    assert (ack.commit_period, ack.late) == (fifth, False)
    emulator = ready(link)
    pass_until(emulator, arrival)
    assert send(emulator, update(FULL, 0, arrival // PERIOD + 1)).late


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE])
@given(
    waits=st.lists(st.integers(0, 3 * PERIOD), min_size=1, max_size=12),
    orders=st.lists(st.sampled_from(["now", "soon", "off", "on"]), min_size=12, max_size=12),
)
def test_all_processors_play_the_same_whatever_the_moments(link: Link, waits: list[int], orders: list[str]) -> None:
    """Updates, stops and starts at any cycle: one sequence of swaps, the same on all ten, and silence in time."""
    emulator, off_at = ready(link), -1
    for n, (wait, what) in enumerate(zip(waits, orders, strict=False)):
        pass_until(emulator, now(emulator) + wait)
        if what == "off":
            order(emulator, Request.DISABLE)
            off_at = now(emulator) if off_at < 0 else off_at
        elif what == "on":
            order(emulator, Request.ENABLE)
            off_at = -1
        else:
            width = np.full(320, 1 + n)
            period = 0 if what == "now" else now(emulator) // PERIOD + 5
            send_in_time(emulator, update(Pulses(width, width), n, period))
    emulator.run(30)
    capture = emulator.capture()
    assert {tuple(latches) for latches in capture.latches} == {tuple(capture.latches[0])}
    words = capture.bits(0, capture.end_tick)
    assert (words == words[:, :1]).all()
    assert status(emulator).missed_commits == 0
    if off_at >= 0:
        assert not loudness(emulator)[(off_at // PERIOD + 6) * 50 :].any()


def test_enabling_twice_arms_one_watchdog() -> None:
    emulator = ready()
    for _ in range(5):
        order(emulator, Request.ENABLE)
    emulator.run(4100)
    assert sum("watchdog" in event.what for event in emulator.events) == 1


def test_a_refusal_names_the_block_and_the_moment() -> None:
    emulator = ready()
    emulator.run(50)
    broken = bytearray(update(FULL, 0x01020304))
    broken[-1] ^= 1
    ack = send(emulator, bytes(broken))
    assert (ack.sequence, ack.now_period, ack.commit_period) == (0x01020304, 50, 0)
    assert send(emulator, b"PW\x01\x01\x05\x06").sequence == 0x0605


@pytest.mark.parametrize(("link", "cycles_per_token"), [(FIVE_WIRE, 8), (TWO_WIRE, 20)])
def test_messages_arrive_when_the_links_can_have_carried_them(
    link: Link, cycles_per_token: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sorting 15 µs, then 52 tokens a slice and 16 a commit one after the other, and 100 ns for each hop."""
    arrivals: list[tuple[int, int, int]] = []
    genuine = Processor.receive

    def noting(self: Processor, tokens: bytes) -> Message | None:
        arrivals.append((now(emulator), tokens[2], len(tokens)))
        return genuine(self, tokens)

    emulator = ready(link, unfolded=True)
    monkeypatch.setattr(Processor, "receive", noting)
    send(emulator, update(FULL, 0))
    emulator.run(10)
    start = 15 * 400
    arrivals = [arrival for arrival in arrivals if arrival[1] in (1, 2)]
    slices = [(start + 52 * (n + 1) * cycles_per_token + (n + 1) * 40, 1, 52) for n in range(10)]
    commits = [(start + (520 + 16 * (n + 1)) * cycles_per_token + (n + 1) * 40, 2, 16) for n in range(10)]
    assert sorted(arrivals) == sorted(slices + commits)
