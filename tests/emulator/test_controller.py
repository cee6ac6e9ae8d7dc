"""The controller through its USB side: blocks in, acknowledgements out, square waves after."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Emulator, Pulses
from phasewire.emulator import Event
from phasewire.emulator.processor import Processor
from phasewire.emulator.usb_device import Handshake, Setup
from phasewire.protocol import Ack, Reason, Status, Update, pack
from phasewire.protocol.chain import FIVE_WIRE, TWO_WIRE, ChannelEnd, Link
from phasewire.protocol.codes import Request

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
        emulator.scheduler.run_until(upcoming)


def read_ack(emulator: Emulator) -> Ack:
    answer = emulator.usb.bulk_in(0x81)
    assert isinstance(answer, bytes)
    return Ack.decode(answer)


def ready(link: Link = FIVE_WIRE) -> Emulator:
    emulator = Emulator(link=link)
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    order(emulator, Request.ENABLE)
    return emulator


def loudness(emulator: Emulator) -> np.ndarray:
    """Number of outputs that are high, per tick since power-up."""
    capture = emulator.capture()
    return np.asarray(capture.channels(0, capture.end_tick).sum(axis=1, dtype=int))


def test_updates_are_refused_until_enabled() -> None:
    emulator = Emulator()
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    ack = send(emulator, pack(Update(FULL, 5)))
    assert (ack.reason, ack.sequence) == (Reason.DISABLED, 5)
    emulator.run(10)
    assert not loudness(emulator).any()
    assert status(emulator).last_refusal is Reason.DISABLED


def test_a_refused_block_leaves_what_plays() -> None:
    emulator = ready()
    send(emulator, pack(Update(FULL, 1)))
    emulator.run(5)
    broken = bytearray(pack(Update(Pulses.silent(320), 2)))
    broken[100] ^= 1
    assert send(emulator, bytes(broken)).reason is Reason.CHECKSUM
    emulator.run(5)
    assert loudness(emulator)[-50:].sum() == 320 * 25
    assert (status(emulator).accepted, status(emulator).refused) == (1, 1)


def test_an_update_begins_at_the_period_it_names() -> None:
    emulator = ready()
    ack = send(emulator, pack(Update(FULL, 1, period=100)))
    assert (ack.commit_period, ack.late) == (100, False)
    emulator.run(110)
    assert int(np.argmax(loudness(emulator) > 0)) == 100 * 50


def test_an_update_for_the_past_is_late_and_begins_as_soon_as_possible() -> None:
    emulator = ready()
    emulator.run(50)
    ack = send(emulator, pack(Update(FULL, 1, period=3)))
    assert ack.late
    assert 51 <= ack.commit_period <= 53
    emulator.run(10)
    assert int(np.argmax(loudness(emulator) > 0)) == ack.commit_period * 50
    assert status(emulator).late == 1


@pytest.mark.parametrize(("link", "periods_apart"), [(FIVE_WIRE, 1), (TWO_WIRE, 2)])
def test_a_fresh_update_plays_in_every_period_that_the_links_can_hold(link: Link, periods_apart: int) -> None:
    emulator, count = ready(link), 200
    for n in range(count):
        period = 10 + n * periods_apart
        emulator.scheduler.run_until((period - 6) * PERIOD)
        width = np.full(320, 1 + n % 25)
        ack = send(emulator, pack(Update(Pulses(width % 100, width), n, period)))
        assert (ack.reason, ack.commit_period, ack.late) == (Reason.ACCEPTED, period, False)
    emulator.run(10)
    per_period = loudness(emulator)[: 50 * (emulator.capture().periods)].reshape(-1, 50).sum(axis=1) // 320
    assert per_period[10 : 10 + count * periods_apart : periods_apart].tolist() == [1 + n % 25 for n in range(count)]
    assert (status(emulator).late, status(emulator).missed_commits) == (0, 0)


def test_a_stream_faster_than_the_links_is_late_but_whole() -> None:
    """Twice what two-wire links hold: nothing is lost or torn, and everything is counted."""
    emulator, count = ready(TWO_WIRE), 30
    for n in range(count):
        emulator.scheduler.run_until((10 + n - 6) * PERIOD)
        send_in_time(emulator, pack(Update(FULL, n, period=10 + n)))
    commits = []
    while not isinstance(answer := emulator.usb.bulk_in(0x81), Handshake):
        commits.append(Ack.decode(answer).commit_period)
    assert len(commits) == count
    assert commits == sorted(set(commits))
    emulator.run(200)
    assert status(emulator).missed_commits == 0
    assert status(emulator).late > 0
    for starts in emulator.capture().starts:
        assert starts[1:].tolist() == [50 * period for period in commits]


def test_a_full_queue_answers_nak_until_a_block_has_left() -> None:
    emulator = ready()
    block = pack(Update(FULL, 0, period=1000))
    handshakes = [emulator.usb.bulk_out(0x01, block) for _ in range(9)]
    assert handshakes == [Handshake.ACK] * 8 + [Handshake.NAK]
    assert [read_ack(emulator).free for _ in range(8)] == [7, 6, 5, 4, 3, 2, 1, 0]
    emulator.run(1000)
    assert emulator.usb.bulk_out(0x01, block) is Handshake.ACK


def test_unread_acknowledgements_hold_the_endpoint() -> None:
    emulator = ready()
    for _ in range(64):
        assert emulator.usb.bulk_out(0x01, b"junk") is Handshake.ACK
    assert emulator.usb.bulk_out(0x01, b"junk") is Handshake.NAK
    assert read_ack(emulator).reason is Reason.LENGTH
    assert emulator.usb.bulk_out(0x01, b"junk") is Handshake.ACK


@pytest.mark.parametrize("wait", range(0, 100_000, 3_700))
def test_nothing_plays_once_the_outputs_are_off(wait: int) -> None:
    """Whenever the order comes, also while updates are on the chain or queued for the far end of time."""
    emulator = ready()
    for n, period in enumerate((None, 8, 9, 2**32)):
        send(emulator, pack(Update(FULL, n, period)))
    emulator.scheduler.run_until(wait)
    order(emulator, Request.DISABLE)
    emulator.run(100)
    off_by = -(-wait // PERIOD) + 4
    assert not loudness(emulator)[off_by * 50 :].any()
    assert status(emulator).missed_commits == 0
    assert not status(emulator).enabled


def test_it_plays_again_after_it_was_off() -> None:
    emulator = ready()
    send(emulator, pack(Update(FULL, 0, period=2**32)))
    order(emulator, Request.DISABLE)
    order(emulator, Request.ENABLE)
    ack = send(emulator, pack(Update(FULL, 1)))
    assert ack.commit_period < 10
    emulator.run(10)
    assert loudness(emulator)[-50:].sum() == 320 * 25


def test_updates_that_were_dropped_free_the_queue() -> None:
    emulator = ready()
    for n in range(8):
        send(emulator, pack(Update(FULL, n, period=2**31 + n)))
    order(emulator, Request.DISABLE)
    order(emulator, Request.ENABLE)
    assert send(emulator, pack(Update(FULL, 8))).free == 7


def test_the_horizon_is_2_to_the_32_periods() -> None:
    emulator = ready()
    emulator.run(100)
    assert send(emulator, pack(Update(FULL, 0, period=100 + 2**32))).reason is Reason.ACCEPTED
    assert send(emulator, pack(Update(FULL, 1, period=101 + 2**32))).reason is Reason.HORIZON


def test_blocks_that_are_refused_are_no_sign_of_life() -> None:
    emulator = ready()
    for _ in range(5):
        emulator.run(1000)
        send(emulator, b"garbage")
    assert status(emulator).watchdog_fired


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE])
@given(
    waits=st.lists(st.integers(0, 3 * PERIOD), min_size=1, max_size=12),
    orders=st.lists(st.sampled_from(["now", "soon", "off", "on"]), min_size=12, max_size=12),
)
def test_all_processors_play_the_same_whatever_the_moments(link: Link, waits: list[int], orders: list[str]) -> None:
    """Updates, stops and starts at any cycle: one sequence of swaps, the same on all ten, and silence in time."""
    emulator, off_at = ready(link), -1
    for n, (wait, what) in enumerate(zip(waits, orders, strict=False)):
        emulator.scheduler.run_until(emulator.scheduler.now + wait)
        if what == "off":
            order(emulator, Request.DISABLE)
            off_at = emulator.scheduler.now if off_at < 0 else off_at
        elif what == "on":
            order(emulator, Request.ENABLE)
            off_at = -1
        else:
            width = np.full(320, 1 + n)
            period = None if what == "now" else emulator.scheduler.now // PERIOD + 5
            send_in_time(emulator, pack(Update(Pulses(width, width), n, period)))
    emulator.run(30)
    capture = emulator.capture()
    assert {tuple(starts) for starts in capture.starts} == {tuple(capture.starts[0])}
    assert len({tuple(table.sum() > 0 for table in tables) for tables in capture.tables}) == 1
    assert status(emulator).missed_commits == 0
    if off_at >= 0:
        assert not loudness(emulator)[(off_at // PERIOD + 6) * 50 :].any()


def test_the_watchdog_silences_a_device_whose_host_fell_silent() -> None:
    emulator = ready()
    send(emulator, pack(Update(FULL, 0)))
    emulator.run(3990)
    assert loudness(emulator)[-50:].any()
    emulator.run(20)
    assert not loudness(emulator)[-50:].any()
    assert (status(emulator).enabled, status(emulator).watchdog_fired) == (False, True)
    order(emulator, Request.ENABLE)
    assert not status(emulator).watchdog_fired


def test_a_sign_of_life_keeps_it_playing() -> None:
    emulator = ready()
    send(emulator, pack(Update(FULL, 0)))
    for _ in range(10):
        emulator.run(3900)
        assert status(emulator).enabled
    assert emulator.capture().drive(emulator.capture().periods - 1).all()


def test_enabling_twice_arms_one_watchdog() -> None:
    emulator = ready()
    for _ in range(5):
        order(emulator, Request.ENABLE)
    emulator.run(4100)
    assert sum("watchdog" in event.what for event in emulator.events) == 1


def test_configuring_again_turns_off_and_forgets() -> None:
    emulator = ready()
    emulator.usb.bulk_out(0x01, pack(Update(FULL, 0)))
    emulator.run(5)
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    assert emulator.usb.bulk_in(0x81) is Handshake.NAK
    emulator.run(5)
    assert not loudness(emulator)[-50:].any()
    assert not status(emulator).enabled


def test_the_same_calls_give_the_same_capture_and_log() -> None:
    def session() -> tuple[bytes, list[Event]]:
        emulator = ready()
        for n in range(5):
            send(emulator, pack(Update(FULL, n, period=10 + 2 * n)))
        emulator.run(30)
        capture = emulator.capture()
        return capture.bits(0, capture.end_tick).tobytes(), list(emulator.events)

    assert session() == session()


def test_blocks_that_are_accepted_are_a_sign_of_life() -> None:
    emulator = ready()
    for n in range(10):
        emulator.run(3900)
        assert send(emulator, pack(Update(FULL, n))).reason is Reason.ACCEPTED


def test_enabling_again_is_a_sign_of_life() -> None:
    emulator = ready()
    for _ in range(3):
        emulator.run(3900)
        order(emulator, Request.ENABLE)
    assert status(emulator).enabled


def test_a_refusal_names_the_block_and_the_moment() -> None:
    emulator = ready()
    emulator.run(50)
    broken = bytearray(pack(Update(FULL, 0x01020304)))
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

    def noting(self: Processor, end: ChannelEnd, payload: bytes) -> None:
        arrivals.append((emulator.scheduler.now, int(end), len(payload)))
        genuine(self, end, payload)

    monkeypatch.setattr(Processor, "receive", noting)
    emulator = ready(link)
    send(emulator, pack(Update(FULL, 0)))
    emulator.run(10)
    start = 15 * 400
    slices = [(start + 52 * (n + 1) * cycles_per_token + (n + 1) * 40, 1, 48) for n in range(10)]
    commits = [(start + (520 + 16 * (n + 1)) * cycles_per_token + (n + 1) * 40, 2, 12) for n in range(10)]
    assert sorted(arrivals) == sorted(slices + commits)
