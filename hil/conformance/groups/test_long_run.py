"""Long runs: every promise holds again and again, and no resource runs out."""

from __future__ import annotations

import time

from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, case, expect
from phasewire.hil.conformance.tools.clocks import compare_clocks
from phasewire.hil.conformance.tools.player import FAST_PERIODS, Player, block_periods, is_fast
from phasewire.hil.conformance.tools.steps import LONG_MS, SILENT, Wrong, expect_all, forge, refuse
from phasewire.hil.conformance.tools.watchdog import await_firing
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.board import CHANNELS, TICK_HZ
from phasewire.protocol.codes import RECORD_BYTES, Action, Feature, Reason, Request, State
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import Status

WALL_SECONDS = 8.0
"""Time that a case may take if the device runs on the host's clock."""
DEVICE_SECONDS = 300
FED_SECONDS, FED_EVERY_SECONDS, SOON_MS = 2**32 / TICK_HZ + 60, 40.0, 1000
SETTLED_PERIODS = 400
MOST_PPM = 1000
"""More than the greatest difference of two quartz clocks."""
BOTH = Feature.SEQUENCES | Feature.MODULATION
PAST_A_BYTE, PAST_TWO_BYTES = 256, 65_536
AT_ONCE_BYTES, TAKEN_SECONDS = 2**17, 0.01
"""Bytes of a transfer, and for how long they may wait: the records of some must be read first."""
COUNTERS = ("refused", "late", "lost", "missed_commits", "damaged_messages", "dropped_frames")


def check_counters(bench: Bench, before: Status, **counted: int) -> Status:
    """Fail unless exactly these counters advanced, by these amounts; returns the status."""
    after = bench.status()
    for name in ("accepted", *COUNTERS):
        gone = getattr(after, name) - getattr(before, name)
        expect(f"how far the count {name} went on", gone % 2**32, counted.get(name, 0))
    expect("faults", after.faults, before.faults)
    return after


def let_pass(bench: Bench, seconds: float, every: float = 1.0) -> float:
    """Let the device's time pass with signs of life, within the host's time; returns how much passed."""
    wall, began = time.perf_counter() + WALL_SECONDS, bench.clock().now
    while (passed := (bench.clock().now - began) / TICK_HZ) < seconds and time.perf_counter() < wall:
        bench.keep_alive(min(every, seconds - passed), every=every)
    bench.note("device time that passed", f"{passed:.3f} s")
    return passed


@case("BLK-005", "ACK-001", "NUM-002", "REQ-003", "BUD-001/2", outputs=("TIM-003", "BLK-005", "CHN-020"))
def test_a_long_stream_of_updates_plays_whole(bench: Bench, player: Player) -> None:
    """Of two seconds of updates, 500 a second, none is late, missed or lost, and twelve excerpts show them playing.

    On a slow line they are fewer and further apart, because only the queue bridges a gap in the transfers.
    """
    fast = is_fast(bench)
    count, spacing, at_once = (1024, 4 * FAST_PERIODS, 16) if fast else (16, 2 * block_periods(bench), 4)
    count, spacing = max(count // bench.slowness, 4 * at_once), spacing * bench.slowness
    patterns = [bench.weak() for _ in range(24)]
    before = bench.status()
    first = player.soon(at_once)
    for number in range(0, count, at_once):
        player.send_all(
            Update(bench.random.choice(patterns), first + spacing * place) for place in range(number, number + at_once)
        )
    last = first + spacing * count
    bench.wait_until(last)
    expect_all(check_counters(bench, before, accepted=count), free=bench.info.queue_blocks, since_period=last - spacing)
    for _ in range(12):
        at = bench.random.randrange(first, last - 200)
        player.judge(at, at + 200)


@case("BLK-024", "BLK-008", "REQ-003", "ACK-002", features=BOTH)
def test_no_place_in_the_queue_is_lost(bench: Bench, player: Player) -> None:
    """After 5000 blocks of all kinds, some refused, the queue has as many places as at first."""
    player.send_all([Slot(0, bench.weak()), Slot(1, bench.weak()), Entries((Entry(0, 1), Entry(1, 2)))])
    player.send(Samples(bytes([255, 0])))
    bench.wait_periods(SETTLED_PERIODS)
    before = bench.status()
    expect("free places", before.free, bench.info.queue_blocks)
    update = Update(bench.weak())
    beyond = Update(Pulses.silent(CHANNELS), 2**64 - 1)
    kinds: list[Body] = [update, PlaySequence(0, 2), AmplitudeModulation(0, 2, 1), Output(Action.END_MODULATION)]
    kinds += [Output(Action.SILENCE), Clock(), NoOp(), Slot(2, bench.weak()), beyond]
    updates, mixed = bench.tries(4000, 12), bench.tries(1000, 12)
    at_once = 250 if is_fast(bench) else 4
    bodies = [update] * updates + [bench.random.choice(kinds) for _ in range(mixed)]
    for at in range(0, len(bodies), at_once):
        sent = bodies[at : at + at_once]
        for body, ack in zip(sent, bench.send_all(sent), strict=True):
            expect("the reason", ack.reason, Reason.HORIZON if body is beyond else Reason.ACCEPTED)
    refused = bodies.count(beyond)
    bench.wait_periods(SETTLED_PERIODS)
    after = bench.status()
    expect("accepted blocks", after.accepted - before.accepted, len(bodies) - refused)
    expect("refused blocks", after.refused - before.refused, refused)
    expect_all(after, late=before.late, missed_commits=before.missed_commits, free=bench.info.queue_blocks)
    places = bench.info.queue_blocks if is_fast(bench) else 4
    far = player.soon(places) + 2000
    free = [ack.free for ack in player.send_all(Update(update.pulses, far + 10 * place) for place in range(places))]
    wanted = [bench.info.queue_blocks - 1 - place for place in range(places)]
    expect("free places as changes are queued", free, wanted)
    bench.disable()
    expect("free places after DISABLE", bench.status().free, bench.info.queue_blocks)


@case("REQ-003", "NUM-003", "BLK-005")
def test_counts_of_blocks_go_on_past_a_byte(bench: Bench) -> None:
    """More than 255 blocks that are accepted, refused, late or lost are counted in STATUS whole."""
    Player(bench)
    bench.must(NoOp())
    before = bench.status()
    refuse(bench, [Wrong("a wrong checksum", forge(bench, NoOp(), checksum=0), Reason.CHECKSUM)] * PAST_A_BYTE)
    acks = bench.send_all([Update(SILENT, 1)] * PAST_A_BYTE)  # the number of the refused block is lost
    expect("how many changes for period 1 are LATE", sum(ack.late for ack in acks), PAST_A_BYTE)
    bench.must(NoOp(), number=(acks[-1].sequence + PAST_A_BYTE) % 2**32)
    check_counters(bench, before, accepted=PAST_A_BYTE + 1, refused=PAST_A_BYTE, late=PAST_A_BYTE, lost=PAST_A_BYTE)


@case("REQ-003", "BLK-020", needs=[Need.FREE_TIME])
def test_counts_of_blocks_go_on_past_two_bytes(bench: Bench) -> None:
    """More than 65 535 accepted and as many refused blocks are counted in STATUS whole."""
    if not is_fast(bench):
        raise Inconclusive("the line is so slow that so many blocks take an hour")
    with bench.spare() as device:
        device.must(NoOp())
        before = device.status()
        for block in (pack(device.numbered(NoOp(), restart=True)), forge(device, NoOp(), checksum=0)):
            blocks = memoryview(block * PAST_TWO_BYTES)
            sent = answered = 0
            while answered < PAST_TWO_BYTES * RECORD_BYTES:
                if sent < len(blocks):
                    sent += device.line.send_blocks(bytes(blocks[sent : sent + AT_ONCE_BYTES]), TAKEN_SECONDS)
                answered += len(device.line.receive_records(TAKEN_SECONDS))
        check_counters(device, before, accepted=PAST_TWO_BYTES, refused=PAST_TWO_BYTES)


@case("NUM-004", "NUM-002", "NUM-003", "BLK-020", "REQ-003")
def test_many_sessions_follow_each_other(bench: Bench, player: Player) -> None:
    """Session after session begins with RESTART and its own number, and none reports a loss."""
    before = bench.status()
    sessions = bench.tries(100, 5, 4)
    for _ in range(sessions):
        bench.must(NoOp(), restart=True, number=bench.random.randrange(2**32))
        for ack in player.send_all([Update(Pulses.silent(CHANNELS)), NoOp(), Clock()]):
            assert not ack.flags, f"flags of block {ack.sequence} of a session are {ack.flags!r}, should be none"
    check_counters(bench, before, accepted=4 * sessions)


@case("STA-003", "SAF-002", "SAF-004", "REQ-005", "BLK-024", outputs=("SAF-002", "SAF-004"))
def test_outputs_are_enabled_and_disabled_again_and_again(bench: Bench, player: Player) -> None:
    """After each enabling an update plays, after each disabling it ends, and the queue is complete again."""
    bench.disable()
    before = bench.status()
    times = bench.tries(50, 5, 6)
    stretches = []
    for _ in range(times):
        bench.enable()
        ack = player.send(Update(bench.weak()))
        player.bench.send(Update(bench.weak(), ack.commit_period + 2**20))
        bench.wait_until(ack.commit_period + 3)
        expect("the state", bench.status().state, State.PLAYING)
        bench.disable()
        off = bench.period() + 1
        player.score.silence(off)
        status = bench.status()
        expect("state and free places", (status.state, status.free), (State.OFF, bench.info.queue_blocks))
        bench.wait_periods(10)
        stretches.append((ack.commit_period, off))
    check_counters(bench, before, accepted=2 * times)
    for begin, off in bench.random.sample(stretches, 5):
        player.judge(begin, begin + 3)
        player.judge(off, off + 8)


@case("TIM-001", "TIM-002")
def test_the_clock_keeps_time(bench: Bench) -> None:
    """Over five seconds the clocks of device and host differ by less than a thousandth."""
    compare_clocks(bench, lambda: bench.wait(5), MOST_PPM / 1e6)


@case("CHN-015", "BLK-015", "BLK-017", "TIM-004", features=BOTH, needs=[Need.CAPTURE])
def test_a_modulated_sequence_stays_in_step_for_minutes(bench: Bench, player: Player) -> None:
    """After minutes, or seconds on the host's clock, entries and samples are at the places that their starts imply."""
    player.send_all([Slot(number, bench.weak()) for number in range(3)])
    player.send_all([Entries((Entry(0, 3), Entry(1, 1), Entry(2, 7))), Samples(bytes([255, 180, 30, 90, 128]))])
    player.send_all([AmplitudeModulation(0, 5, 3), PlaySequence(0, 3)])
    bench.wait_periods(SETTLED_PERIODS)
    before = bench.status()
    let_pass(bench, DEVICE_SECONDS)
    check_counters(bench, before)
    last = bench.period()
    player.judge(last - 600, last)


@case("TIM-004", "CHN-018", "SAF-003", outputs=("TIM-004", "CHN-018"))
def test_an_update_plays_on_for_minutes(bench: Bench, player: Player) -> None:
    """An update plays on while its host gives signs of life, and no longer; meanwhile another follows in time.

    Where the device's time is free these are 40 s apart, for longer than 32 bits count ticks; else it takes seconds.
    """
    player.send(Update(bench.weak()))
    bench.wait_periods(SETTLED_PERIODS)
    before = bench.status()
    let_pass(bench, FED_SECONDS, every=FED_EVERY_SECONDS if bench.can(Need.FREE_TIME) else 1.0)
    period = player.soon()
    player.send(Update(bench.weak(), period))
    check_counters(bench, before, accepted=1)
    player.judge(period - 300, period + 100)
    ms = LONG_MS if bench.can(Need.FREE_TIME) else SOON_MS
    bench.order(Request.WATCHDOG, ms)
    last = bench.status().now
    await_firing(bench, last, last, ms)
