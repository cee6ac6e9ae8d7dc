"""Flow control: the queue and its free places, what holds a host back, and the rate that the device promises."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, NotApplicable, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import only
from phasewire.hil.conformance.tools.player import Player, check_in_time, is_fast, soon
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    SILENT,
    Wrong,
    begin,
    expect_all,
    far,
    forge,
    heavy,
    let_stores_go,
    raw_records,
    refuse,
)
from phasewire.protocol.blocks import (
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
from phasewire.protocol.codes import (
    BLOCK_BYTES,
    ENTRIES_PER_BLOCK,
    PROMISED_PERIODS,
    SAMPLES_PER_BLOCK,
    SILENT_PERIODS,
    Action,
    Feature,
    Reason,
    Request,
    State,
)
from phasewire.protocol.replies import Ack

ENDPOINT_OUT = 0x01
REFUSED_SECONDS = 0.02
"""For a block that must get NAK all the time."""
PATIENCE_SECONDS = 5.0
"""For what comes within tenths of a second, with a margin for a busy computer."""
FEATURES = Feature.SEQUENCES | Feature.MODULATION
SYMBOLS = {2: 10, 5: 4}
"""In a token, by the wires of a link (clause BUD-002)."""


def fill(bench: Bench, left: int = 0) -> list[Ack]:
    """Queue changes for distant periods, until so many places are left."""
    named = far(bench)
    changes: list[Body] = [Update(SILENT, named + 100 * place) for place in range(bench.info.queue_blocks - left)]
    acks = send_many(bench, changes)
    for place, ack in enumerate(acks):
        expect_all(ack, reason=Reason.ACCEPTED, commit_period=named + 100 * place)
    return acks


def send_many(bench: Bench, bodies: Sequence[Body]) -> list[Ack]:
    """Send blocks in one go, or in several over a slow line; returns their acknowledgements."""
    at_once = len(bodies) if is_fast(bench) else 10
    return [ack for at in range(0, len(bodies), at_once) for ack in bench.send_all(bodies[at : at + at_once])]


def check_nak(bench: Bench, block: bytes) -> None:
    """Check that a block is not taken and has no effect."""
    before = bench.status()
    expect("bytes taken while the device holds the host back", bench.usb.write(ENDPOINT_OUT, block, REFUSED_SECONDS), 0)
    expect_all(bench.status(), accepted=before.accepted, refused=before.refused)


# The queue


@case("BLK-024", "ACK-002", "REQ-003", since=2)
def test_free_counts_the_places_of_the_queue(bench: Bench) -> None:
    """As many changes as INFO says can wait; `free` counts down to 0 after each, in STATUS too."""
    begin(bench)
    places = bench.info.queue_blocks
    expect("free in STATUS", bench.status().free, places)
    acks = fill(bench)
    expect("free, one after the other", [ack.free for ack in acks], list(range(places - 1, -1, -1)))
    expect("free in STATUS", bench.status().free, 0)
    bench.disable()
    expect("free in STATUS after DISABLE", bench.status().free, places)


@case("BLK-024", "REQ-003", "CHN-029")
def test_a_place_is_free_again_when_its_change_has_gone(bench: Bench) -> None:
    """`free` counts up when changes go onto the chain: only near their periods, and by these at the latest."""
    begin(bench)
    places, gap = bench.info.queue_blocks, 120 * bench.slowness
    first = soon(bench, places)
    periods = [first + gap * place for place in range(places)]
    acks = send_many(bench, [Update(SILENT, period) for period in periods])
    for ack, period in zip(acks, periods, strict=True):
        check_in_time(ack, period)
    looks_every = gap // 3
    for _ in range(2 * (periods[-1] - bench.period()) // looks_every):
        before, status = bench.period(), bench.status()
        gone_for_sure = min(max((before - first) // gap + 1, 0), places)
        may_be_gone = min(max((status.period + SILENT_PERIODS - first) // gap + 1, 0), places)
        assert gone_for_sure <= status.free <= may_be_gone, (
            f"free is {status.free} in period {status.period}, should be {gone_for_sure} to {may_be_gone}"
        )
        if gone_for_sure == places:
            return
        bench.wait_periods(looks_every)
    raise AssertionError(
        f"period {status.period} is reported, should be past {periods[-1]}, after twice the waiting time"
    )


@case("BLK-024", "BLK-009", "BLK-020", "BLK-019", features=FEATURES)
def test_only_changes_take_a_place(bench: Bench) -> None:
    """Stores, CLOCK and NO_OP take no place in the queue: with one place left any number of them is accepted."""
    begin(bench)
    fill(bench, left=1)
    bodies: list[Body] = [Slot(0, SILENT), Entries((Entry(0, 1),)), Samples(b"\1"), Clock(), NoOp()]
    for body in bodies * bench.tries(4, 1, len(bodies)):
        ack = bench.must(body)
        assert ack.free in (0, 1), f"free is {ack.free} after {body.KIND.name}, should be 1"
    let_stores_go(bench, bench.info.queue_blocks - 1)
    expect("free after the last change", bench.must(Output(Action.SILENCE)).free, 0)


@case("BLK-024", "BLK-007", "ACK-001")
def test_blocks_are_judged_when_they_arrive(bench: Bench) -> None:
    """A block after a change that waits is judged and acknowledged at once, not after the change has taken effect."""
    begin(bench)
    named = far(bench)
    acks = bench.send_all([Update(SILENT, named), NoOp(), Update(SILENT, named + 50), Clock()])
    expect("the reasons", [ack.reason for ack in acks], [Reason.ACCEPTED] * 4)
    expect("the states", [ack.state for ack in acks], [State.READY] * 4)
    expect("since_period", bench.status().since_period, 0)


# What holds a host back


@case("BLK-009", "BLK-024", "ACK-007", line="usb")
def test_a_full_queue_is_answered_with_nak(bench: Bench) -> None:
    """While the queue has no room no block is taken, valid or not and of any kind; requests are answered."""
    begin(bench)
    fill(bench)
    blocks = [pack(bench.numbered(body)) for body in (NoOp(), Clock(), Update(SILENT), Slot(0, SILENT))]
    for block in (*blocks, bytes(BLOCK_BYTES)):
        check_nak(bench, block)
    expect("the state", bench.status().state, State.READY)
    bench.disable()
    number = bench.must(NoOp()).sequence
    expect("the number taken", number, bench.numbered(NoOp()).sequence - 1 & 0xFFFFFFFF)
    expect("what else comes", bench.listen(), [])


@case("BLK-009", "BLK-024", outputs=("BLK-009", "BLK-007"))
def test_more_updates_than_fit_all_play(bench: Bench) -> None:
    """Three times as many updates as the queue holds, sent in one go, are held back, and all play in order, in time."""
    if not is_fast(bench):
        raise Inconclusive("the line is so slow that the queue never fills")
    player = Player(bench)
    count, gap = 3 * bench.info.queue_blocks, 40 * bench.slowness
    first = soon(bench, bench.info.queue_blocks)
    updates = [bench.weak(0.2) for _ in range(7)]
    acks = player.send_all([Update(updates[number % 7], first + gap * number) for number in range(count)])
    arrived = [ack.now_period for ack in acks]
    assert arrived[-1] >= first, (
        f"the last of {count} updates was taken in period {arrived[-1]}, should have been held back to {first} at least"
    )
    if min(ack.free for ack in acks):
        raise TooSlow("the line was so slow that the queue never filled")
    player.judge(first - 10, first + gap * count)


@case("BLK-009", "BLK-024", outputs=("BLK-009", "BLK-013"), features=Feature.SEQUENCES, line="usb")
def test_more_stores_than_wait_are_all_kept(bench: Bench) -> None:
    """A hundred slots in one transfer are all accepted and play as stored, even if NAK holds them back."""
    player, many = Player(bench), 100
    acks = bench.send_all([Entries(tuple(Entry(number, 1) for number in range(many)))])
    acks += bench.send_all(slots := [Slot(number, only(3 * number, number)) for number in range(many)])
    for ack in acks:
        expect("the reason", ack.reason, Reason.ACCEPTED)
        assert ack.free in (0, bench.info.queue_blocks), f"free is {ack.free} after a store"
    let_stores_go(bench)
    began = bench.must(PlaySequence(0, many)).commit_period
    player.score.play(began, [(slot.pulses, 1) for slot in slots])
    player.judge(began, began + 2 * many)


@case("BLK-009", "SAF-003", line="usb")
def test_a_block_that_is_held_back_is_no_sign_of_life(bench: Bench) -> None:
    """While blocks get NAK the watchdog runs and fires: a waiting host must ask for STATUS."""
    begin(bench)
    fill(bench)
    bench.order(Request.WATCHDOG, 150)
    bench.status()
    block = pack(bench.numbered(NoOp()))
    taken, end = 0, bench.line.time.monotonic() + PATIENCE_SECONDS
    while not taken and bench.line.time.monotonic() < end:
        taken = bench.usb.write(ENDPOINT_OUT, block, REFUSED_SECONDS)
    expect("bytes taken after the watchdog has emptied the queue", taken, BLOCK_BYTES)
    status = bench.status()
    expect("the state", status.state, State.OFF)
    assert status.watchdog_fired, "STATUS does not say that the watchdog has fired"


@case("ACK-001", "ACK-007", "USB-015", line="usb")
def test_records_that_are_not_read_hold_the_host_back(bench: Bench) -> None:
    """With as many records waiting as INFO says no block is taken; reading finds them all, in order."""
    bench.must(NoOp())
    places = bench.info.queue_records
    blocks = [pack(bench.numbered(NoOp())) for _ in range(places + 1)]
    taken = bench.usb.write(ENDPOINT_OUT, b"".join(blocks), 0.2 + places / 1000)
    expect("blocks taken", taken / BLOCK_BYTES, places)
    check_nak(bench, blocks[-1])
    bench.outlast(0.02)
    waiting = bench.listen(0.05)
    numbers = [int.from_bytes(block[4:8], "little") for block in blocks[:-1]]
    expect("the acknowledgements", [record.sequence for record in waiting if isinstance(record, Ack)], numbers)
    (record,) = raw_records(bench, blocks[-1:])
    expect("the number of the next", record[4:8], blocks[-1][4:8])


# The rate


def stream(bench: Bench, first: int, gap: int, count: int) -> Iterable[Update]:
    """Updates for periods that follow each other at a distance."""
    updates = [bench.weak(0.5) for _ in range(5)]
    return [Update(updates[number % 5], first + gap * number) for number in range(count)]


@case("BUD-001/1", "BUD-004", "BLK-023", "BLK-005/2", outputs=("BUD-001/1", "BUD-003", "CHN-019"))
def test_a_stream_at_the_rate_that_holds_is_played_in_full(bench: Bench) -> None:
    """Updates as close as INFO says, far more than fit the queue, all play at their periods: none is late or missed."""
    if not is_fast(bench) or bench.line.kind == "serial":
        raise Inconclusive("the line is too slow for a stream")
    player, gap = Player(bench), bench.info.periods_per_update
    if bench.usb.bulk_bytes < BLOCK_BYTES:
        gap = max(gap, 20)  # a full-speed bus carries 2375 blocks a second (USB-010)
    places = bench.info.queue_blocks
    before = bench.status()
    first = soon(bench, places)
    acks: list[Ack] = []
    updates = list(stream(bench, first, gap, 20 * places))
    for at in range(0, len(updates), places):
        acks += bench.send_all(updates[at : at + places])
    check_stream(bench, player, updates, acks)
    bench.wait_until(acks[-1].commit_period + 400)
    expect_all(
        bench.status(),
        missed_commits=before.missed_commits,
        damaged_messages=before.damaged_messages,
        faults=before.faults,
    )
    player.judge(first - 10, acks[-1].commit_period + 10)


@case("BUD-001/2", "BUD-004", outputs=("BUD-001/2", "BUD-007", "CHN-019", "CHN-020"), features=FEATURES)
def test_a_stream_holds_its_rate_beside_stores(bench: Bench) -> None:
    """A stream at the promised rate plays completely while slots, entries and samples are stored between updates."""
    player, gap = Player(bench), bench.info.periods_per_update
    places = bench.info.queue_blocks - 2
    first = soon(bench, places + 3)
    before = bench.status()
    updates = list(stream(bench, first, gap, places))
    stores: list[Body] = [
        Slot(1, SILENT),
        Entries((Entry(1, 5),) * ENTRIES_PER_BLOCK),
        Samples(bytes(SAMPLES_PER_BLOCK)),
    ]
    acks = send_many(bench, [*updates, *stores])
    check_stream(bench, player, updates, acks[:places])
    expect("the reasons of stores", [ack.reason for ack in acks[places:]], [Reason.ACCEPTED] * 3)
    bench.wait_until(first + gap * places + 400)
    expect_all(bench.status(), late=before.late, missed_commits=before.missed_commits, faults=before.faults)
    player.judge(first - 10, first + gap * places + 10)


def check_stream(bench: Bench, player: Player, updates: Iterable[Update], acks: Iterable[Ack]) -> None:
    """Check that each update that came in time takes effect in time, and enter them all into the score."""
    margin = PROMISED_PERIODS + 2 * bench.info.periods_per_update
    in_time = behind = 0
    for update, ack in zip(updates, acks, strict=True):
        player.follow(update, ack)
        if update.period < ack.now_period + margin or behind:
            behind += 1
            continue
        in_time += 1
        expect("commit_period", ack.commit_period, update.period)
        expect("whether it is late", ack.late, False)
    if behind > in_time:
        told = f"the line brought {behind} of {in_time + behind} updates too late"
        if in_time + behind <= bench.info.queue_blocks:
            raise TooSlow(told)
        raise Inconclusive(f"{told}: it does not carry {bench.info.max_updates_per_second:g} a second")


@case("BLK-023", "ACK-003", "BLK-008")
def test_updates_closer_than_the_rate_are_refused(bench: Bench) -> None:
    """An update less than u periods after the last named period is refused with RATE; u periods after, it is not."""
    begin(bench)
    u = needs_two(bench)
    named = far(bench)
    bench.must(Update(SILENT, named))
    for _ in range(3):
        close = [
            Wrong(f"{ahead} later", forge(bench, Update(SILENT, named + ahead)), Reason.RATE) for ahead in range(1, u)
        ]
        refuse(bench, close)
        named += u
        expect("commit_period", bench.must(Update(SILENT, named)).commit_period, named)


@case("BLK-023")
def test_an_update_that_is_not_later_is_not_refused_for_its_rate(bench: Bench) -> None:
    """For the same or an earlier period, or for now, an update is never refused with RATE, but it may be late."""
    begin(bench)
    named = far(bench)
    for period, late in ((named, True), (named - 1, True), (named - 100, True), (0, False)):
        name_anew(bench, named)
        ack = bench.must(Update(SILENT, period))
        expect(f"whether an update {named - period if period else 'for now'} is late", ack.late, late)
        assert ack.commit_period > named, f"commit_period is {ack.commit_period}, should be after {named}"


@case("BLK-023")
def test_the_rate_counts_from_the_last_that_was_named(bench: Bench) -> None:
    """RATE counts from the period that the last accepted UPDATE named: not from now, refusals or other changes."""
    bench.order(Request.LIMIT, 1)
    begin(bench)
    needs_two(bench)
    named = far(bench)

    def refused(period: int) -> None:
        refuse(bench, [Wrong("an update a period later", forge(bench, Update(SILENT, period)), Reason.RATE)])

    name_anew(bench, named)
    bench.must(Update(SILENT))
    refused(named + 1)
    bench.must(Output(Action.SILENCE, named + 500))
    refused(named + 1)
    bench.must(Update(SILENT, named + 501))
    name_anew(bench, named + 501)
    refuse(bench, [Wrong("too much drive", forge(bench, Update(heavy(2), named + 600)), Reason.DRIVE)])
    bench.must(Update(SILENT, named + 601))
    bench.must(Update(SILENT, named - 50))
    refused(named - 49)
    bench.must(Update(SILENT, named + 602))


def name_anew(bench: Bench, period: int) -> None:
    """Queue only one update, for a period that becomes the last named one, as after ENABLE."""
    bench.disable()
    bench.enable()
    bench.must(Update(SILENT, period))


@case("BLK-023", "SAF-002")
@pytest.mark.parametrize("how", ["request", "block", "watchdog"])
def test_the_rate_counts_anew_after_enable(bench: Bench, how: str) -> None:
    """After the outputs were disabled and enabled no period counts as named: any period is accepted."""
    begin(bench)
    needs_two(bench)
    named = far(bench)
    if how == "request":
        bench.must(Update(SILENT, named))
        bench.disable()
    elif how == "watchdog":
        bench.must(Update(SILENT, named))
        bench.order(Request.WATCHDOG, 10)
        bench.await_unasked(1)
        bench.order(Request.WATCHDOG, LONG_MS)
    else:
        named = soon(bench, 4)
        bench.must(Update(SILENT, named))
        bench.wait_until(bench.must(Output(Action.DISABLE, named + 20)).commit_period)
    bench.enable()
    expect("the reason", bench.send(Update(SILENT, named + 1)).reason, Reason.ACCEPTED)


def needs_two(bench: Bench) -> int:
    """u, if updates can be closer than that at all."""
    u = bench.info.periods_per_update
    if u == 1:
        raise NotApplicable("its links carry an update every period, so that none is too close")
    return u


@case("BUD-004", "BUD-002", "BLK-023")
def test_info_reports_a_rate_that_the_links_can_carry(bench: Bench) -> None:
    """`periods_per_update` is at least the time of ten slices and ten commits on links of this kind."""
    wires = bench.info.link_wires
    assert wires in SYMBOLS, f"link_wires is {wires}, should be 2 or 5"
    cycles = 680 * SYMBOLS[wires] * bench.info.cycles_per_symbol
    least = max(-(-cycles // 10_000), 1)
    u = bench.info.periods_per_update
    assert u >= least, f"periods_per_update is {u}, and ten slices and commits take {cycles} cycles of {10_000 * u}"
