"""What a conformance case cannot see of the controller: each core cycle of arrival, messages, and its log."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Emulator
from phasewire.emulator.boards.processor import Processor
from phasewire.emulator.door import Handshake
from phasewire.protocol.blocks import NoOp, Update
from phasewire.protocol.chain import Message
from phasewire.protocol.codes import Request
from phasewire.protocol.replies import Ack
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import FULL, PERIOD, Device, pulses


def ready(link: Link = FIVE_WIRE, *, unfolded: bool = False) -> Device:
    return Device(Emulator(link=link, unfolded=unfolded), enabled=True)


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE])
@given(arrival=st.integers(0, 3 * PERIOD))
def test_the_fifth_period_after_arrival_is_always_in_time(link: Link, arrival: int) -> None:
    """Clause BLK-005; and not before the hardware can: the first period is always too early."""
    device = ready(link)
    device.run_until(arrival)
    fifth = arrival // PERIOD + 5
    ack = device.send(Update(FULL, fifth))
    assert (ack.commit_period, ack.late) == (fifth, False)
    device = ready(link)
    device.run_until(arrival)
    assert device.send(Update(FULL, arrival // PERIOD + 1)).late


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE])
@given(
    waits=st.lists(st.integers(0, 3 * PERIOD), min_size=1, max_size=12),
    orders=st.lists(st.sampled_from(["now", "soon", "off", "on"]), min_size=12, max_size=12),
)
def test_all_processors_play_the_same_whatever_the_moments(link: Link, waits: list[int], orders: list[str]) -> None:
    """Updates, stops and starts at any cycle: one sequence of swaps, the same on all ten, and silence in time."""
    device, off_at = ready(link), -1
    for n, (wait, what) in enumerate(zip(waits, orders, strict=False)):
        device.run_until(device.cycle + wait)
        if what == "off":
            device.order(Request.DISABLE)
            off_at = device.period if off_at < 0 else off_at
        elif what == "on":
            device.order(Request.ENABLE)
            off_at = -1
        else:
            device.send_in_time(Update(pulses(1 + n), 0 if what == "now" else device.period + 5))
    device.run(30)
    capture = device.emulator.capture()
    assert {tuple(latches) for latches in capture.latches} == {tuple(capture.latches[0])}
    words = capture.bits(0, capture.end_tick)
    assert (words == words[:, :1]).all()
    assert device.status().missed_commits == 0
    if off_at >= 0:
        assert max(device.high_periods(), default=0) < off_at + 6


def test_enabling_twice_arms_one_watchdog() -> None:
    device = ready()
    for _ in range(5):
        device.order(Request.ENABLE)
    device.run(4100)
    assert sum("watchdog" in event.what for event in device.emulator.events) == 1


def test_a_refusal_names_the_block_and_the_moment() -> None:
    device = ready()
    device.run(50)
    broken = bytearray(device.pack(NoOp(), 0x01020304))
    broken[-1] ^= 1
    for block in (bytes(broken), b"PW\x01\x01\x05\x06"):
        assert device.usb.bulk_out(0x01, block) is Handshake.ACK
    whole, short = device.records()
    assert isinstance(whole, Ack)
    assert isinstance(short, Ack)
    assert (whole.sequence, whole.now_period, whole.commit_period) == (0x01020304, 50, 0)
    assert short.sequence == 0x0605


@pytest.mark.parametrize(("link", "cycles_per_token"), [(FIVE_WIRE, 8), (TWO_WIRE, 20)])
def test_messages_arrive_after_the_links_have_carried_them(
    link: Link, cycles_per_token: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sorting 17.5 µs, then 52 tokens a slice and 16 a commit one after the other, and 100 ns for each hop."""
    arrivals: list[tuple[int, int, int]] = []
    genuine = Processor.receive

    def noting(self: Processor, tokens: bytes) -> Message | None:
        arrivals.append((device.cycle, tokens[2], len(tokens)))
        return genuine(self, tokens)

    device = ready(link, unfolded=True)
    monkeypatch.setattr(Processor, "receive", noting)
    device.send(Update(FULL))
    device.run(10)
    start = 7000
    arrivals = [arrival for arrival in arrivals if arrival[1] in (1, 2)]
    slices = [(start + 52 * (n + 1) * cycles_per_token + (n + 1) * 40, 1, 52) for n in range(10)]
    commits = [(start + (520 + 16 * (n + 1)) * cycles_per_token + (n + 1) * 40, 2, 16) for n in range(10)]
    assert sorted(arrivals) == sorted(slices + commits)
