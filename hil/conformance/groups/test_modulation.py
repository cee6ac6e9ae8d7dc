"""Modulation: samples of the buffer, and their effect on what plays (clauses BLK-016 to BLK-018, BUD-006)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, Risk, case, expect
from phasewire.hil.conformance.sight.waveforms import only
from phasewire.hil.conformance.tools.player import Player
from phasewire.hil.conformance.tools.steps import check_refused, expect_all
from phasewire.hil.conformance.tools.watchdog import check_not_yet
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Change,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.board import TICKS_PER_PERIOD
from phasewire.protocol.codes import (
    MODULATION_SAMPLES,
    PROMISED_PERIODS,
    SAMPLES_PER_BLOCK,
    SILENT_PERIODS,
    Action,
    Fault,
    Feature,
    Reason,
    Request,
    State,
    StatusFlag,
)
from phasewire.protocol.replies import Status

PLACES = [(0, 1), (4095, 1), (3616, 480), (4047, 49), (479, 3), (47, 2), (48, 50)]
"""Of the first of 4096 samples that modulates, and how many there are; the edge of a block, and the end."""
SETTLED_PERIODS = 400
"""Time for all stores to go onto the chain, and for all due changes to take effect."""

MODULATION = Feature.MODULATION
BOTH = Feature.MODULATION | Feature.SEQUENCES
CAPTURE = [Need.CAPTURE]


def store(player: Player, samples: bytes, first: int = 0) -> None:
    """Store samples, in as many blocks as they need."""
    player.send_all(
        Samples(samples[at : at + SAMPLES_PER_BLOCK], first + at) for at in range(0, len(samples), SAMPLES_PER_BLOCK)
    )


def noise(bench: Bench, count: int) -> bytes:
    """Random samples."""
    return bench.random.randbytes(count)


# What a modulation does


@case("BLK-016", "BLK-017", "PUL-006", "TIM-003", "CHN-014", features=MODULATION, needs=CAPTURE)
@pytest.mark.parametrize(
    ("count", "hold"),
    [(1, 1), (2, 1), (3, 1), (5, 3), (2, 100), (7, 2), (3, 257), (2, 512), (49, 1), (SAMPLES_PER_BLOCK, 2)],
)
def test_a_modulation_loops_without_a_gap(bench: Bench, player: Player, count: int, hold: int) -> None:
    """Each sample holds for its periods, and the first follows the last without a gap."""
    first = bench.random.randrange(MODULATION_SAMPLES - count)
    store(player, noise(bench, count), first)
    player.send(Update(bench.weak()))
    begin = player.begin(AmplitudeModulation(first, count, hold))
    player.judge(begin - 5, begin + 3 * count * hold + 7)


@case("BLK-016", "BLK-017", "CHN-012/2", "CHN-015", features=MODULATION, needs=CAPTURE)
def test_the_whole_buffer_modulates(bench: Bench, player: Player) -> None:
    """A modulation by all 4096 samples plays each in its period, and then the first again."""
    store(player, noise(bench, MODULATION_SAMPLES))
    player.send(Update(bench.weak()))
    begin = player.begin(AmplitudeModulation(0, MODULATION_SAMPLES, 1))
    player.judge(begin - 2, begin + MODULATION_SAMPLES + 100)


@case("BLK-016", "BLK-017", features=MODULATION, needs=CAPTURE)
@pytest.mark.parametrize(("first", "count"), PLACES)
def test_a_modulation_plays_its_part_of_the_buffer(bench: Bench, player: Player, first: int, count: int) -> None:
    """A modulation applies exactly `count` samples from `first`, up to the end of the buffer."""
    store(player, bytes([180 + sample % 76 for sample in noise(bench, count)]), first)
    player.send_all(Samples(bytes(1), place) for place in (first - 1, first + count) if 0 <= place < MODULATION_SAMPLES)
    player.send(Update(bench.weak()))
    begin = player.begin(AmplitudeModulation(first, count, 1))
    player.judge(begin - 2, begin + 2 * count + 5)


@case("BLK-016", "CHN-012", features=MODULATION, needs=CAPTURE)
def test_what_is_stored_last_modulates(bench: Bench, player: Player) -> None:
    """Samples stored over others replace them, and do not change their neighbours."""
    store(player, noise(bench, 200), 1000)
    store(player, noise(bench, 3), 1047)
    store(player, noise(bench, 60), 1090)
    player.send(Update(bench.weak()))
    begin = player.begin(AmplitudeModulation(1000, 200, 1))
    player.judge(begin - 2, begin + 205)


@case("BLK-017", "CHN-015", features=MODULATION, needs=CAPTURE)
def test_a_sample_holds_for_65535_periods(bench: Bench, player: Player) -> None:
    """The longest hold, 1.6 s, ends exactly after its last period."""
    store(player, bytes([70, 230]), 2048)
    player.send(Update(bench.weak()))
    begin = player.begin(AmplitudeModulation(2048, 2, 65_535))
    for place in (0, 127, 255, 300, 32_767, 65_535):
        player.judge(begin + place - 5, begin + place + 20)


@case("PUL-006", "PUL-002", "BLK-017", features=MODULATION, needs=CAPTURE)
def test_sample_0_silences_and_sample_255_changes_nothing(bench: Bench, player: Player) -> None:
    """Under sample 0 all outputs are low; under 255 they are as without modulation, at full width and at one tick."""
    store(player, bytes([0, 255]))
    player.send(Update(bench.weak()))
    begin = player.begin(AmplitudeModulation(0, 2, 4), 3)
    player.send(Update(only(17, 31, 25), begin + 16))
    player.send(Update(only(300, 98, 1), begin + 32))
    player.judge(begin - 2, begin + 48)


@case("BLK-012", "BLK-017", "CHN-015", features=BOTH, needs=CAPTURE)
def test_a_modulation_counts_its_own_periods(bench: Bench, player: Player) -> None:
    """Whatever begins or ends under a modulation, its samples go on by the period at which it took effect."""
    store(player, noise(bench, 7), 3000)
    player.send_all([Slot(1, bench.weak()), Slot(2, bench.weak()), Entries((Entry(1, 3), Entry(2, 2)), 1000)])
    player.send(Update(bench.weak()))
    begin = player.soon(6)
    apart = PROMISED_PERIODS + 6
    story: list[Change] = [
        AmplitudeModulation(3000, 7, 3),
        Update(bench.weak()),
        PlaySequence(1000, 2),
        PlaySequence(1001, 1, repeats=3),
        Update(bench.weak()),
        PlaySequence(1000, 1),
    ]
    player.send_all(replace(change, period=begin + apart * number) for number, change in enumerate(story))
    player.judge(begin - 5, begin + apart * len(story) + 60)


@case("BLK-017", "BLK-012", "CHN-015", features=BOTH, needs=CAPTURE)
def test_a_modulation_of_a_sequence_keeps_both_in_step(bench: Bench, player: Player) -> None:
    """Entries and samples of different lengths change each at its own periods, long after both have begun."""
    store(player, noise(bench, 11))
    player.send_all([Slot(slot, bench.weak()) for slot in (0, 1, 2)])
    player.send(Entries((Entry(0, 4), Entry(1, 1), Entry(2, 8))))
    begin = player.soon(2)
    player.send_all([AmplitudeModulation(0, 11, 2, begin), PlaySequence(0, 3, begin + 7)])
    player.judge(begin - 5, begin + 300)
    player.judge(begin + 50_000, begin + 50_300)


@case("BLK-007", "BLK-012", "STA-001", "REQ-003", outputs=("BLK-007", "BLK-012", "BLK-017"), features=MODULATION)
def test_a_modulation_over_silence_waits_for_what_plays(bench: Bench, player: Player) -> None:
    """A modulation over silence leaves the device silent and READY, and a later update begins under its sample."""
    store(player, noise(bench, 5))
    begin = player.soon(2)
    follows = begin + SETTLED_PERIODS * bench.slowness
    player.send_all([AmplitudeModulation(0, 5, 1, begin), Update(bench.weak(), follows)])
    bench.wait_until(begin + 1)
    status = bench.status()
    check_not_yet(bench, follows * TICKS_PER_PERIOD, status.now)
    expect("state, flags and since_period", told(status), (State.READY, StatusFlag.MODULATION, 0))
    bench.wait_until(follows + 1)
    expect("state, flags and since_period", told(bench.status()), (State.PLAYING, StatusFlag.MODULATION, follows))
    player.judge(begin - 3, follows + 20)


def told(status: Status) -> tuple[State, StatusFlag, int]:
    """What a status says about what plays."""
    return status.state, status.flags, status.since_period


@case("BLK-007", "BLK-017", "BUD-003", features=MODULATION, needs=CAPTURE)
def test_an_update_follows_a_modulation_a_period_later(bench: Bench, player: Player) -> None:
    """A host that wants both gets both: a modulation at one period, and an update at the next."""
    store(player, noise(bench, 5))
    player.send(Update(bench.weak()))
    begin = player.soon(2)
    player.send_all([AmplitudeModulation(0, 5, 1, begin), Update(bench.weak(), begin + 1)])
    player.judge(begin - 3, begin + 40)


@case("BUD-006", "BUD-004", "BUD-001/2", "SAF-008", outputs=("BUD-006", "BUD-001/2", "CHN-019"), features=MODULATION)
def test_the_rate_holds_under_a_modulation(bench: Bench, player: Player) -> None:
    """Updates at the rate of INFO begin each at its period under a modulation of one sample a period: no overrun."""
    spacing = bench.info.periods_per_update
    count = min(bench.info.queue_blocks - 1, 16)
    store(player, noise(bench, 48))
    player.send(Update(bench.weak()))
    before = bench.status()
    begin = player.soon(count + 1)
    player.send(AmplitudeModulation(0, 48, 1, begin))
    first = begin + PROMISED_PERIODS
    player.send_all(Update(bench.weak(), first + spacing * number) for number in range(count))
    bench.wait_until(first + spacing * count + SETTLED_PERIODS)
    after = bench.status()
    expect_all(after, missed_commits=before.missed_commits, late=before.late)
    expect("OVERRUN", Fault.OVERRUN in after.faults, False)
    player.judge(begin - 3, first + spacing * count + 60)


@case("CHN-014/2", outputs=("CHN-014/2", "BLK-012", "BLK-007"), features=MODULATION)
def test_modulations_queued_behind_each_other_begin_in_time(bench: Bench, player: Player) -> None:
    """A modulation replaces the previous one at its own period, and begins with its own first sample."""
    store(player, noise(bench, 64))
    player.send(Update(bench.weak()))
    before = bench.status()
    begin = player.soon(4)
    apart = PROMISED_PERIODS + 1
    player.send_all(AmplitudeModulation(9 * number, 8, 1 + number % 2, begin + apart * number) for number in range(4))
    bench.wait_until(begin + 4 * apart)
    expect("missed commits", bench.status().missed_commits, before.missed_commits)
    player.judge(begin - 3, begin + 4 * apart + 40)


@case("REQ-007", "BLK-017", features=MODULATION | Feature.READ_BACK)
def test_pulses_are_read_back_before_modulation(bench: Bench, player: Player) -> None:
    """PULSES answers what plays as it was sent, under any sample, and since when it plays."""
    store(player, bytes([0, 128, 10]))
    pulses = bench.weak()
    player.send(AmplitudeModulation(0, 3, 1))
    bench.wait_periods(SETTLED_PERIODS)
    ack = player.send(Update(pulses))
    bench.wait_until(ack.commit_period + 3)
    for _ in range(3):
        back = bench.read_back()
        expect("since_period", back.since_period, ack.commit_period)
        expect("whether they are the update's pulses", back.pulses == pulses, True)


# How it ends


@case("BLK-018", "BLK-012", "REQ-003", outputs=("BLK-018", "BLK-017"), features=BOTH)
@pytest.mark.parametrize("beneath", ["update", "sequence"])
def test_the_end_of_a_modulation_leaves_what_plays(bench: Bench, player: Player, beneath: str) -> None:
    """END_MODULATION lets what plays go on unmodulated, in step and with the period of its own start."""
    store(player, noise(bench, 5))
    player.send_all([Slot(1, bench.weak()), Slot(2, bench.weak()), Entries((Entry(1, 3), Entry(2, 2)))])
    ack = player.send(Update(bench.weak()) if beneath == "update" else PlaySequence(0, 2))
    bench.wait_periods(SETTLED_PERIODS)
    player.send(AmplitudeModulation(0, 5, 2))
    end = player.soon()
    player.send(Output(Action.END_MODULATION, end))
    bench.wait_until(end - 500 * bench.slowness)
    before = bench.status()
    check_not_yet(bench, end * TICKS_PER_PERIOD, before.now)
    playing = StatusFlag.SEQUENCE if beneath == "sequence" else StatusFlag(0)
    modulated = playing | StatusFlag.MODULATION
    expect("the status before", told(before), (State.PLAYING, modulated, ack.commit_period))
    bench.wait_until(end + 1)
    expect("the status after", told(bench.status()), (State.PLAYING, playing, ack.commit_period))
    player.judge(end - 30, end + 30)


def silenced(player: Player) -> None:
    """Let SILENCE end everything."""
    player.bench.wait_until(player.send(Output(Action.SILENCE)).commit_period + 1)


def disabled_by_output(player: Player) -> None:
    """Let an OUTPUT disable the outputs, and enable them again."""
    ack = player.send(Output(Action.DISABLE))
    player.bench.wait_until(ack.commit_period + SILENT_PERIODS + 1)
    player.bench.enable()


def disabled_by_request(player: Player) -> None:
    """Let the request DISABLE end everything, and enable the outputs again."""
    player.bench.order(Request.DISABLE)
    period = player.bench.period() + SILENT_PERIODS + 1
    player.bench.wait_until(period)
    player.score.silence(period)
    player.bench.enable()


@case("BLK-018", "SAF-004", outputs=("BLK-018", "BLK-017"), features=MODULATION)
@pytest.mark.parametrize(
    "end", [silenced, disabled_by_output, disabled_by_request], ids=["SILENCE", "DISABLE", "request-DISABLE"]
)
def test_silence_and_disable_end_a_modulation(bench: Bench, player: Player, end: Callable[[Player], None]) -> None:
    """After SILENCE and after DISABLE there is no modulation: the next update plays as it was sent."""
    store(player, bytes([0, 60, 128]))
    player.send_all([Update(bench.weak()), AmplitudeModulation(0, 3, 1)])
    bench.wait_periods(SETTLED_PERIODS)
    end(player)
    expect("the status", told(bench.status()), (State.READY, StatusFlag(0), 0))
    ack = player.send(Update(bench.weak()))
    player.judge(ack.commit_period - 2, ack.commit_period + 30)


@case("BLK-018", "BLK-008", outputs=("BLK-018",), features=MODULATION)
def test_the_end_of_no_modulation_is_accepted(bench: Bench, player: Player) -> None:
    """END_MODULATION without a modulation is accepted, over silence and over an update, and does nothing."""
    ack = player.send(Output(Action.END_MODULATION))
    bench.wait_until(ack.commit_period + 1)
    expect("the status", told(bench.status()), (State.READY, StatusFlag(0), 0))
    update = player.send(Update(bench.weak()))
    end = player.soon()
    player.send(Output(Action.END_MODULATION, end))
    bench.wait_until(end + 1)
    expect("the status", told(bench.status()), (State.PLAYING, StatusFlag(0), update.commit_period))
    player.judge(end - 10, end + 20)


NOT_ENDS: dict[str, Callable[[Bench], object]] = {
    "enable": lambda bench: bench.enable(),
    "a-new-numbering": lambda bench: bench.must(NoOp(), restart=True),
    "a-refused-end": lambda bench: bench.send(Output(Action.END_MODULATION, 2**64 - 1)),
    "clear-faults": lambda bench: bench.order(Request.CLEAR_FAULTS),
}


@case("BLK-017", "BLK-008", "REQ-005", outputs=("BLK-017",), features=MODULATION)
@pytest.mark.parametrize("what", NOT_ENDS)
def test_nothing_else_ends_a_modulation(bench: Bench, player: Player, what: str) -> None:
    """ENABLE, a new numbering, a refused OUTPUT and CLEAR_FAULTS do not disturb a modulation."""
    store(player, noise(bench, 5))
    player.send_all([Update(bench.weak()), AmplitudeModulation(0, 5, 3)])
    bench.wait_periods(SETTLED_PERIODS)
    before = bench.period()
    NOT_ENDS[what](bench)
    bench.wait_periods(40)
    expect("the flags", bench.status().flags, StatusFlag.MODULATION)
    player.judge(before, bench.period())


# What may be stored while it plays


@case("BLK-022", "BLK-008", outputs=("BLK-022", "BLK-008"), features=MODULATION)
def test_what_modulates_is_not_overwritten(bench: Bench, player: Player) -> None:
    """A store over a sample of a modulation, queued or playing, is refused with IN_USE, even with the same bytes."""
    samples = noise(bench, 10)
    store(player, samples, 500)
    player.send(Update(bench.weak()))
    begin = player.soon(8) + SETTLED_PERIODS
    player.send(AmplitudeModulation(500, 10, 2, begin))
    over = [Samples(samples[:1], 500), *(Samples(bytes(n), at) for n, at in ((1, 509), (2, 499), (480, 509)))]
    for body in over:
        check_refused(bench, body, Reason.IN_USE)
    bench.wait_until(begin + 2)
    for body in over:
        check_refused(bench, body, Reason.IN_USE)
    last = bench.period()
    player.judge(begin - 2, begin + 50)
    player.judge(last - 60, last)


def ended(player: Player) -> None:
    """Let END_MODULATION end a modulation."""
    player.bench.wait_until(player.send(Output(Action.END_MODULATION)).commit_period)


def replaced(player: Player) -> None:
    """Let another modulation end a modulation."""
    store(player, bytes(1), 4000)
    player.bench.wait_until(player.send(AmplitudeModulation(4000, 1, 1)).commit_period)


@case("BLK-022", features=MODULATION)
@pytest.mark.parametrize(
    "end",
    [ended, replaced, silenced, disabled_by_output, disabled_by_request],
    ids=["END_MODULATION", "modulation", "SILENCE", "DISABLE", "request-DISABLE"],
)
def test_what_modulates_no_longer_may_be_overwritten(
    bench: Bench, player: Player, end: Callable[[Player], None]
) -> None:
    """A modulation's samples may be stored again as soon as its end has taken effect, and not before."""
    store(player, noise(bench, 4), 7)
    player.send_all([Update(bench.weak()), AmplitudeModulation(7, 4, 1)])
    bench.wait_periods(SETTLED_PERIODS)
    check_refused(bench, Samples(bytes(1), 10), Reason.IN_USE)
    end(player)
    bench.wait_periods(2)
    player.send(Samples(noise(bench, 4), 7))


@case("BLK-022", features=MODULATION)
def test_an_update_frees_no_sample(bench: Bench, player: Player) -> None:
    """What ends an update does not end the modulation: its samples stay in use."""
    store(player, noise(bench, 4))
    player.send_all([Update(bench.weak()), AmplitudeModulation(0, 4, 1)])
    ack = player.send(Update(bench.weak()))
    bench.wait_until(ack.commit_period + 2)
    check_refused(bench, Samples(bytes(1), 3), Reason.IN_USE)


@case("BLK-016", "SAF-002", "SAF-004", outputs=("BLK-016",), features=MODULATION)
def test_what_is_stored_stays_over_disable(bench: Bench, player: Player) -> None:
    """Samples can be stored while the outputs are off, and survive DISABLE and another session."""
    bench.disable()
    store(player, noise(bench, 6), 90)
    expect("the reason for a modulation while off", bench.send(AmplitudeModulation(90, 6, 1)).reason, Reason.DISABLED)
    bench.must(NoOp(), restart=True)
    bench.enable()
    bench.disable()
    bench.enable()
    player.send(Update(bench.weak()))
    ack = player.send(AmplitudeModulation(90, 6, 1))
    player.judge(ack.commit_period, ack.commit_period + 10)


@case("USB-026", outputs=("USB-026", "BLK-016"), features=MODULATION, line="usb")
@pytest.mark.parametrize("how", ["SET_CONFIGURATION", "SET_INTERFACE"])
def test_what_is_stored_stays_over_a_new_configuration(bench: Bench, how: str) -> None:
    """Samples survive SET_CONFIGURATION, although what plays ends: they last until RESET."""
    again = {"SET_CONFIGURATION": bench.usb.set_configuration, "SET_INTERFACE": lambda: bench.usb.set_interface(0)}
    check_stored_over(bench, again[how])


@case("USB-026", outputs=("USB-026", "BLK-016"), features=MODULATION, line="usb", allow=[Risk.RESET])
def test_what_is_stored_stays_over_a_bus_reset(bench: Bench) -> None:
    """Samples survive a bus reset in run-time mode, which does not reset the device."""
    check_stored_over(bench, bench.usb.reset)


def check_stored_over(bench: Bench, disturb: Callable[[], None]) -> None:
    """Fail unless the stored data play after a disturbance that ends what plays."""
    player = Player(bench)
    store(player, noise(bench, 6), 90)
    bench.wait_periods(SETTLED_PERIODS)
    disturb()
    bench.enable()
    player.send(Update(bench.weak()))
    ack = player.send(AmplitudeModulation(90, 6, 1))
    player.judge(ack.commit_period, ack.commit_period + 10)


# What was never stored


@case("BLK-021", "BLK-016", "REQ-013", features=MODULATION, allow=[Risk.RESET])
def test_what_was_never_stored_does_not_modulate(bench: Bench) -> None:
    """After RESET samples are empty: a modulation is refused with EMPTY until all of its samples are stored."""
    bench.restart(lambda: bench.order(Request.RESET))
    player = Player(bench)
    check_refused(bench, AmplitudeModulation(0, 1, 1), Reason.EMPTY)
    check_refused(bench, AmplitudeModulation(0, MODULATION_SAMPLES, 1), Reason.EMPTY)
    store(player, noise(bench, 3), 100)
    check_refused(bench, AmplitudeModulation(100, 4, 1), Reason.EMPTY)
    check_refused(bench, AmplitudeModulation(99, 4, 1), Reason.EMPTY)
    check_refused(bench, AmplitudeModulation(103, 1, 1), Reason.EMPTY)
    player.send(AmplitudeModulation(100, 3, 1))
    store(player, noise(bench, 3), 104)
    check_refused(bench, AmplitudeModulation(100, 7, 1), Reason.EMPTY)
    store(player, noise(bench, 1), 103)
    player.send(AmplitudeModulation(100, 7, 1))
