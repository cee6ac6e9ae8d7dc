"""The controller through its USB side: blocks in, acknowledgements out, square waves after."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Emulator, Pulses
from phasewire.emulator import Event
from phasewire.emulator.boards.processor import Processor
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.door import Handshake, Stall
from phasewire.protocol import Ack, Clock, Info, NoOp, Output, Reason, State, Status, pack
from phasewire.protocol.blocks import Block
from phasewire.protocol.chain import Message
from phasewire.protocol.codes import AckFlag, Action, Request
from phasewire.protocol.replies import ClockReading, decode_reports, records
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


def read_records(emulator: Emulator) -> list[Ack | Status]:
    answer = emulator.usb.bulk_in(0x81)
    assert isinstance(answer, bytes)
    return records(answer)


def read_acks(emulator: Emulator) -> list[Ack]:
    return [record for record in read_records(emulator) if isinstance(record, Ack)]


def read_ack(emulator: Emulator) -> Ack:
    """The only acknowledgement that waits."""
    (ack,) = read_acks(emulator)
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


def test_updates_are_refused_until_enabled() -> None:
    emulator = Emulator()
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    ack = send(emulator, update(FULL, 5))
    assert (ack.reason, ack.sequence) == (Reason.DISABLED, 5)
    emulator.run(10)
    assert not loudness(emulator).any()
    assert status(emulator).last_refusal is Reason.DISABLED


def test_a_refused_block_leaves_what_plays() -> None:
    emulator = ready()
    send(emulator, update(FULL, 1))
    emulator.run(5)
    broken = bytearray(update(Pulses.silent(320), 2))
    broken[100] ^= 1
    assert send(emulator, bytes(broken)).reason is Reason.CHECKSUM
    emulator.run(5)
    assert loudness(emulator)[-50:].sum() == 320 * 25
    assert (status(emulator).accepted, status(emulator).refused) == (1, 1)


def test_an_update_begins_at_the_period_it_names() -> None:
    emulator = ready()
    ack = send(emulator, update(FULL, 1, period=100))
    assert (ack.commit_period, ack.late) == (100, False)
    emulator.run(110)
    assert int(np.argmax(loudness(emulator) > 0)) == 100 * 50


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


def test_an_update_for_the_past_is_late_and_begins_as_soon_as_possible() -> None:
    emulator = ready()
    emulator.run(50)
    ack = send(emulator, update(FULL, 1, period=3))
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
        pass_until(emulator, (period - 6) * PERIOD)
        width = np.full(320, 1 + n % 25)
        ack = send(emulator, update(Pulses(width % 100, width), n, period))
        assert (ack.reason, ack.commit_period, ack.late) == (Reason.ACCEPTED, period, False)
    emulator.run(10)
    per_period = loudness(emulator)[: 50 * (emulator.capture().periods)].reshape(-1, 50).sum(axis=1) // 320
    assert per_period[10 : 10 + count * periods_apart : periods_apart].tolist() == [1 + n % 25 for n in range(count)]
    assert (status(emulator).late, status(emulator).missed_commits) == (0, 0)


def test_a_stream_that_the_links_cannot_carry_is_refused() -> None:
    """Twice what two-wire links hold: every second block is refused, the others play on time."""
    emulator = ready(TWO_WIRE)
    for n in range(30):
        pass_until(emulator, (10 + n - 6) * PERIOD)
        ack = send(emulator, update(FULL, n, period=10 + n))
        assert (ack.reason, ack.commit_period) == ((Reason.RATE, 0) if n % 2 else (Reason.ACCEPTED, 10 + n))
    emulator.run(20)
    assert (status(emulator).missed_commits, status(emulator).late) == (0, 0)
    for latches in emulator.capture().latches:
        assert latches == [50 * (10 + n) for n in range(0, 30, 2)]


def test_updates_for_as_soon_as_possible_play_in_order_at_the_rate_of_the_links() -> None:
    emulator, count = ready(TWO_WIRE), 15
    for n in range(count):
        send_in_time(emulator, update(FULL, n))
    commits = [ack.commit_period for ack in read_acks(emulator)]
    assert len(commits) == count
    apart = np.diff(commits)
    assert set(apart) == {1, 2}  # 34 µs each
    assert apart.sum() >= (count - 1) * 34 / 25 - 1
    emulator.run(200)
    assert (status(emulator).missed_commits, status(emulator).late) == (0, 0)
    for latches in emulator.capture().latches:
        assert latches == [50 * period for period in commits]


def test_a_full_queue_answers_nak_until_a_block_has_left() -> None:
    emulator = ready()
    blocks = [update(FULL, n, period=1000 + n) for n in range(QUEUE_BLOCKS + 1)]
    handshakes = [emulator.usb.bulk_out(0x01, block) for block in blocks]
    assert handshakes == [Handshake.ACK] * QUEUE_BLOCKS + [Handshake.NAK]
    acks = [ack for _ in range(QUEUE_BLOCKS // 16) for ack in read_acks(emulator)]  # 16 fill a packet
    assert [(ack.sequence, ack.free) for ack in acks] == [(n, QUEUE_BLOCKS - 1 - n) for n in range(QUEUE_BLOCKS)]
    emulator.run(1000)
    assert emulator.usb.bulk_out(0x01, blocks[QUEUE_BLOCKS]) is Handshake.ACK


def test_unread_acknowledgements_hold_the_endpoint() -> None:
    emulator = ready()
    info = Info.decode(emulator.usb.control(Setup(0xC1, Request.INFO, 0, 0, 64)))
    for _ in range(info.queue_records):
        assert emulator.usb.bulk_out(0x01, b"junk") is Handshake.ACK
    assert emulator.usb.bulk_out(0x01, b"junk") is Handshake.NAK
    assert [ack.reason for ack in read_acks(emulator)] == [Reason.LENGTH] * 16
    handshakes = [emulator.usb.bulk_out(0x01, b"junk") for _ in range(17)]
    assert handshakes == [Handshake.ACK] * 16 + [Handshake.NAK]


@pytest.mark.parametrize("wait", range(0, 100_000, 3_700))
def test_nothing_plays_once_the_outputs_are_off(wait: int) -> None:
    """Whenever the order comes, also while updates are on the chain or queued for the far end of time."""
    emulator = ready()
    for n, period in enumerate((0, 8, 9, 2**32)):
        send(emulator, update(FULL, n, period))
    pass_until(emulator, wait)
    order(emulator, Request.DISABLE)
    emulator.run(100)
    off_by = -(-wait // PERIOD) + 4
    assert not loudness(emulator)[off_by * 50 :].any()
    assert status(emulator).missed_commits == 0
    assert not status(emulator).enabled


def test_it_plays_again_after_it_was_off() -> None:
    emulator = ready()
    send(emulator, update(FULL, 0, period=2**32))
    order(emulator, Request.DISABLE)
    order(emulator, Request.ENABLE)
    ack = send(emulator, update(FULL, 1))
    assert ack.commit_period < 10
    emulator.run(10)
    assert loudness(emulator)[-50:].sum() == 320 * 25


def test_updates_that_were_dropped_free_the_queue() -> None:
    emulator = ready()
    for n in range(QUEUE_BLOCKS):
        send(emulator, update(FULL, n, period=2**31 + n))
    order(emulator, Request.DISABLE)
    order(emulator, Request.ENABLE)
    assert send(emulator, update(FULL, QUEUE_BLOCKS)).free == QUEUE_BLOCKS - 1


def test_the_horizon_is_2_to_the_32_periods() -> None:
    emulator = ready()
    emulator.run(100)
    assert send(emulator, update(FULL, 0, period=100 + 2**32)).reason is Reason.ACCEPTED
    assert send(emulator, update(FULL, 1, period=101 + 2**32)).reason is Reason.HORIZON


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


def test_the_watchdog_silences_a_device_whose_host_fell_silent() -> None:
    emulator = ready()
    send(emulator, update(FULL, 0))
    emulator.run(3990)
    assert loudness(emulator)[-50:].any()
    emulator.run(20)
    assert not loudness(emulator)[-50:].any()
    assert (status(emulator).enabled, status(emulator).watchdog_fired) == (False, True)
    order(emulator, Request.ENABLE)
    assert not status(emulator).watchdog_fired


def test_a_sign_of_life_keeps_it_playing() -> None:
    emulator = ready()
    send(emulator, update(FULL, 0))
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
    emulator.usb.bulk_out(0x01, update(FULL, 0))
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
            send(emulator, update(FULL, n, period=10 + 2 * n))
        emulator.run(30)
        capture = emulator.capture()
        return capture.bits(0, capture.end_tick).tobytes(), list(emulator.events)

    assert session() == session()


def test_blocks_that_are_accepted_are_a_sign_of_life() -> None:
    emulator = ready()
    for n in range(10):
        emulator.run(3900)
        assert send(emulator, update(FULL, n)).reason is Reason.ACCEPTED


def test_enabling_again_is_a_sign_of_life() -> None:
    emulator = ready()
    for _ in range(3):
        emulator.run(3900)
        order(emulator, Request.ENABLE)
    assert status(emulator).enabled


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


def test_numbers_must_follow_and_gaps_are_counted() -> None:
    emulator = ready()
    assert send(emulator, update(FULL, 2**32 - 2)).reason is Reason.ACCEPTED
    for number in (2**32 - 2, 2**32 - 3, 2**31 - 2):
        assert send(emulator, update(FULL, number)).reason is Reason.SEQUENCE
    ack = send(emulator, update(FULL, 1))  # 2³² − 1 and 0 are missing
    assert (ack.reason, ack.flags) == (Reason.ACCEPTED, AckFlag.GAP)
    assert status(emulator).lost == 2
    assert send(emulator, pack(Block(NoOp(), 0, restart=True))).flags == AckFlag(0)
    assert send(emulator, update(FULL, 1)).reason is Reason.ACCEPTED


def test_a_new_configuration_takes_any_number() -> None:
    emulator = ready()
    send(emulator, update(FULL, 1000))
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    order(emulator, Request.ENABLE)
    assert send(emulator, update(FULL, 5)).reason is Reason.ACCEPTED


def test_an_unnamed_period_between_does_not_hide_a_stream_that_is_too_fast() -> None:
    emulator = ready(TWO_WIRE)
    reasons = [send(emulator, update(FULL, n, period)).reason for n, period in enumerate((20, 0, 21, 22))]
    assert reasons == [Reason.ACCEPTED, Reason.ACCEPTED, Reason.RATE, Reason.ACCEPTED]


def test_the_first_period_that_is_named_follows_none() -> None:
    emulator = ready(TWO_WIRE)
    assert send(emulator, update(FULL, 0)).reason is Reason.ACCEPTED
    ack = send(emulator, update(FULL, 1, period=1))
    assert (ack.reason, ack.late) == (Reason.ACCEPTED, True)


def test_the_rate_is_judged_anew_once_the_outputs_are_enabled_again() -> None:
    emulator = ready(TWO_WIRE)
    send(emulator, update(FULL, 0, 2**31))
    order(emulator, Request.DISABLE)
    order(emulator, Request.ENABLE)
    assert send(emulator, update(FULL, 1, 2**31 + 1)).reason is Reason.ACCEPTED


def test_the_total_drive_is_limited() -> None:
    emulator = ready()
    order(emulator, Request.DISABLE)
    emulator.usb.control(Setup(0x41, Request.LIMIT, 100, 0, 0))
    order(emulator, Request.ENABLE)
    width = np.where(np.arange(320) < 101, 25, 0)
    assert send(emulator, update(Pulses(width, width), 0)).reason is Reason.DRIVE
    width[0] = 0
    assert send(emulator, update(Pulses(width, width), 1)).reason is Reason.ACCEPTED
    with pytest.raises(Stall, match="while the outputs are off"):
        emulator.usb.control(Setup(0x41, Request.LIMIT, 320, 0, 0))
    assert status(emulator).drive_limit == 100


@pytest.mark.parametrize(("action", "state"), [(Action.SILENCE, State.READY), (Action.DISABLE, State.OFF)])
def test_an_output_block_ends_what_plays_at_its_period(action: Action, state: State) -> None:
    emulator = ready()
    send(emulator, update(FULL, 0, period=20))
    assert send(emulator, pack(Block(Output(action, 40), 1))).commit_period == 40
    emulator.run_until(30)
    assert (status(emulator).state, status(emulator).since_period) == (State.PLAYING, 20)
    emulator.run(40)
    loud = np.flatnonzero(loudness(emulator))
    assert (loud[0] // 50, loud[-1] // 50) == (20, 39)
    assert (status(emulator).state, status(emulator).since_period) == (state, 0)


def test_what_follows_an_output_block_that_disables_is_dropped() -> None:
    emulator = ready()
    send(emulator, pack(Block(Output(Action.DISABLE, 20), 0)))
    for n in range(1, 4):
        send(emulator, update(FULL, n, period=20 + n))
    emulator.run(60)
    assert not loudness(emulator)[24 * 50 :].any()
    assert status(emulator).state is State.OFF


def test_clock_and_no_op_are_answered_whatever_the_state() -> None:
    emulator = ready()
    order(emulator, Request.DISABLE)
    emulator.run_until(5000)
    ack = send(emulator, pack(Block(Clock(), 0)))
    assert (ack.reason, ack.commit_period, ack.now) == (Reason.ACCEPTED, 4096, 5000 * 50)
    reading = ClockReading.decode(emulator.usb.control(Setup(0xC1, Request.CLOCK, 0, 0, 24)))
    assert reading == ClockReading(5000 * 50, 4096, 2)
    assert send(emulator, pack(Block(NoOp(), 1))).commit_period == 0


def test_the_watchdog_tells_by_itself_and_its_time_can_be_set() -> None:
    emulator = ready()
    emulator.usb.control(Setup(0x41, Request.WATCHDOG, 20, 0, 0))
    emulator.run(900)
    (told,) = read_records(emulator)
    assert isinstance(told, Status)
    assert (told.state, told.watchdog_fired, told.watchdog_ms) == (State.OFF, True, 20)
    for wrong in (9, 60_001):
        with pytest.raises(Stall, match="WATCHDOG has index 0 and value 10 to 60000, not"):
            emulator.usb.control(Setup(0x41, Request.WATCHDOG, wrong, 0, 0))


def test_a_longer_watchdog_holds_at_once() -> None:
    emulator = ready()
    emulator.usb.control(Setup(0x41, Request.WATCHDOG, 500, 0, 0))
    emulator.run(15_000)
    assert status(emulator).enabled


def test_a_watchdog_does_not_watch_what_is_off() -> None:
    emulator = ready()
    order(emulator, Request.DISABLE)
    emulator.run(15_000)
    assert not status(emulator).watchdog_fired
    assert emulator.usb.bulk_in(0x81) is Handshake.NAK


def test_boards_blink_and_processors_report() -> None:
    emulator = ready()
    emulator.usb.control(Setup(0x41, Request.IDENTIFY, 4, 0, 0))
    assert "board 4 blinks" in emulator.events[-1].what
    with pytest.raises(Stall, match=r"IDENTIFY has .* value 0 to 4, not .* value 5"):
        emulator.usb.control(Setup(0x41, Request.IDENTIFY, 5, 0, 0))
    reports = decode_reports(emulator.usb.control(Setup(0xC1, Request.PROCESSORS, 0, 0, 160)))
    assert [report.missed_commits for report in reports] == [0] * 10
