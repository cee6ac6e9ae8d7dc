"""Pulses: their beginning and length, and which are refused (chapter PUL)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, case, expect
from phasewire.hil.conformance.dialogue import POWERS
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import SILENCE, check_play, only
from phasewire.hil.conformance.tools.forge import forged
from phasewire.hil.conformance.tools.player import Player
from phasewire.hil.conformance.tools.steps import expect_all
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Entries,
    Entry,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.board import CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS, TICKS_PER_PERIOD
from phasewire.protocol.codes import Feature, Reason
from phasewire.protocol.pulses import Pulses

PHASES, WIDTHS, SAMPLES = 100, 26, 256
PAIRS = PHASES * WIDTHS
STRIDE = 1009
"""The step from the pair of one output to that of the next, so that the widths of an update are mixed."""
AT_ONCE = 64
JUDGED_AT_ONCE = 512
SLOW_UPDATES = 12


def pairs_in_turn(bench: Bench) -> Iterator[Pulses]:
    """Updates in which every output gets every pair of phase and width once, within the drive limit."""
    channels = bench.wiring.channels
    shares = -(-int(POWERS.mean() * CHANNELS * 1.25) // (1000 * bench.drive_limit))
    for number in range(PAIRS):
        phase, width = np.divmod((number + STRIDE * channels) % PAIRS, WIDTHS)
        for share in range(shares):
            plays = channels % shares == share
            yield Pulses(phase, np.where(plays, width, 0))


def play_all(bench: Bench, player: Player, pulses: list[Pulses]) -> None:
    """Play updates one after the other as fast as possible, and judge each of them."""
    bench.note("updates played", len(pulses))
    acks = [
        ack
        for at in range(0, len(pulses), AT_ONCE)
        for ack in player.send_all([Update(part) for part in pulses[at : at + AT_ONCE]])
    ]
    begun = [ack.commit_period for ack in acks]
    bounds = [*begun[::JUDGED_AT_ONCE], begun[-1] + 3]
    for first, last in pairwise(bounds):
        player.judge(first, last)


@case("PUL-004", "PUL-001", "PUL-002", "PUL-005", "BLK-006", "CHN-003", needs=[Need.CAPTURE], allow=[Risk.DRIVE])
def test_every_pulse_is_right_on_every_output(bench: Bench, player: Player) -> None:
    """Each of the 100 phases and 26 widths plays on each of the 320 outputs, or some of them on a slow line."""
    pulses = list(pairs_in_turn(bench))
    pulses = bench.random.sample(pulses, bench.tries(len(pulses), SLOW_UPDATES))
    play_all(bench, player, pulses)


@case("PUL-004", "PUL-001", "PUL-002", "PUL-005", "BLK-006", needs=[Need.CAPTURE])
def test_every_pulse_is_right_on_some_output(bench: Bench, player: Player) -> None:
    """Each pair of phase and width plays on an output of its own, as many at a time as the limit allows."""
    pairs = bench.random.sample(range(PAIRS), PAIRS)
    updates = []
    while pairs:
        phase, width, room = np.zeros(CHANNELS, int), np.zeros(CHANNELS, int), 1000 * bench.drive_limit
        for transducer in bench.random.sample(range(CHANNELS), CHANNELS):
            if not pairs or POWERS[pairs[-1] % WIDTHS] > room:
                break
            phase[transducer], width[transducer] = divmod(pairs.pop(), WIDTHS)
            room -= POWERS[width[transducer]]
        updates.append(Pulses(phase, width))
    updates = updates[: bench.tries(len(updates), SLOW_UPDATES)]
    play_all(bench, player, updates)


WRAPPING = [(0, 25), (1, 25), (99, 25), (0, 1), (1, 1), (99, 2), (0, 2), (24, 25), (76, 25), (75, 24), (99, 1), (98, 3)]
"""Pairs whose pulses wrap around the end of the period, begin with it or end with it, of equal and of odd parity."""


@case("PUL-004", "PUL-001", needs=[Need.CAPTURE])
@pytest.mark.parametrize(("phase", "width"), WRAPPING)
def test_a_pulse_goes_round_the_end_of_the_period(bench: Bench, player: Player, phase: int, width: int) -> None:
    """A pulse that wraps is one pulse of its width in the formula's ticks, in its first period too."""
    transducer = bench.random.randrange(CHANNELS)
    ack = player.send(Update(only(transducer, phase, width)))
    channel = int(bench.wiring.channels[transducer])
    start = (phase - width) // 2 % TICKS_PER_PERIOD
    wanted = sorted((start + tick) % TICKS_PER_PERIOD for tick in range(width))
    processor, bit = divmod(channel, CHANNELS_PER_PROCESSOR)
    first = ack.commit_period

    def check(seen: Seen) -> None:
        if seen.observed[processor] >> np.uint32(bit) & 1:
            for period in range(first, first + 4):
                levels = seen.period(period)[:, processor] >> np.uint32(bit) & 1
                expect(f"the high ticks of period {period}", np.flatnonzero(levels).tolist(), wanted)
        player.score.check(seen)

    bench.judge(first - 2, first + 4, check)


@case("PUL-002", outputs=("PUL-002", "PUL-001"))
def test_width_0_is_silent_whatever_the_phase(bench: Bench, player: Player) -> None:
    """Pulses of width 0 with every phase leave all outputs low, although they count as an update that plays."""
    player.send(Update(bench.weak()))
    phases = [37 * transducer % PHASES for transducer in range(CHANNELS)]
    ack = player.send(Update(Pulses(phases, np.zeros(CHANNELS, int)), player.soon()))
    bench.wait_until(ack.commit_period + 5)
    expect("since_period", bench.status().since_period, ack.commit_period)

    def check(seen: Seen) -> None:
        check_play(seen, [(ack.commit_period, SILENCE)])

    bench.judge(ack.commit_period, ack.commit_period + 40, check)


@case("PUL-001", "BLK-008")
@pytest.mark.parametrize(("phase", "width"), [(100, 0), (100, 10), (127, 25), (0, 26), (99, 31), (127, 31)])
def test_a_reserved_pulse_is_refused(bench: Bench, player: Player, phase: int, width: int) -> None:
    """A phase above 99 or a width above 25 of a single transducer has its block refused, and what plays goes on."""
    ack = player.send(Update(bench.weak()))
    bench.wait_until(ack.commit_period + 1)
    silent = Pulses.silent(CHANNELS)
    bodies: list[Body] = [Update(silent)]
    if Feature.SEQUENCES in bench.info.features:
        bodies.append(Slot(5, silent))
    for place in (0, 1, bench.random.randrange(2, CHANNELS - 1), CHANNELS - 1):
        for body in bodies:
            before = bench.status()
            (refused,) = bench.send_raw(with_pulse(pack(bench.numbered(body)), place, phase, width))
            expect_all(refused, f", with the pulse at place {place}", reason=Reason.PULSE, commit_period=0)
            after = bench.status()
            expect("the count of refused blocks", after.refused - before.refused, 1)
            expect("the count of accepted blocks", after.accepted, before.accepted)
            expect("the last refusal", after.last_refusal, Reason.PULSE)
            expect("the period since which the update plays", after.since_period, ack.commit_period)


@case("PUL-001")
def test_the_extreme_pulses_are_accepted(bench: Bench, player: Player) -> None:
    """Phase 99 and width 25, the greatest values, are accepted."""
    for phase, width in [(99, 25), (99, 0), (0, 25), (0, 0)]:
        player.send(Update(only(bench.random.randrange(CHANNELS), phase, width)))


def with_pulse(block: bytes, place: int, phase: int, width: int) -> bytes:
    """A block with one pulse replaced, in the packing of clause PUL-005."""
    payload = bytearray(block[32:])
    pulse = width << 7 | phase
    at = 3 * (place // 2)
    pair = int.from_bytes(payload[at : at + 3], "little")
    pair = pair & 0xFFF | pulse << 12 if place % 2 else pair & 0xFFF000 | pulse
    payload[at : at + 3] = pair.to_bytes(3, "little")
    return forged(block, bytes(payload))


@case("PUL-005", "BLK-006", needs=[Need.CAPTURE])
def test_pulses_are_packed_as_the_specification_shows(bench: Bench, player: Player) -> None:
    """The three bytes of the example drive the first two transducers as specified: low half first, least byte first."""
    block = forged(pack(bench.numbered(Update(Pulses.silent(CHANNELS)))), bytes.fromhex("E31C10"))
    (ack,) = bench.send_raw(block)
    expect("the reason", ack.reason, Reason.ACCEPTED)
    phase, width = np.zeros(CHANNELS, int), np.zeros(CHANNELS, int)
    phase[:2], width[:2] = [99, 1], [25, 2]
    player.score.update(ack.commit_period, Pulses(phase, width))
    player.judge(ack.commit_period, ack.commit_period + 4)


@case("PUL-006", "BLK-016", "BLK-017", "TIM-003", needs=[Need.CAPTURE], features=Feature.SEQUENCES | Feature.MODULATION)
def test_every_width_is_right_under_every_sample(bench: Bench, player: Player) -> None:
    """On each processor each of the 26 widths plays under each of the 256 samples, with phases of either parity."""
    transducers = bench.wiring.channels.argsort().reshape(PROCESSORS, CHANNELS_PER_PROCESSOR)
    if POWERS.sum() > 1000 * bench.drive_limit:
        raise Inconclusive(f"all widths at once need more drive than {bench.drive_limit} transducers'")
    slots = []
    for processor in range(PROCESSORS):
        phase, width = np.zeros(CHANNELS, int), np.zeros(CHANNELS, int)
        chosen = bench.random.sample(transducers[processor].tolist(), WIDTHS)
        width[chosen] = np.arange(WIDTHS)
        phase[chosen] = [bench.random.randrange(PHASES) for _ in range(WIDTHS)]
        slots.append(Slot(processor, Pulses(phase, width)))
    samples = bytes(bench.random.sample(range(SAMPLES), SAMPLES))
    player.send_all([*slots, Entries(tuple(Entry(slot.number, SAMPLES) for slot in slots)), Samples(samples)])
    begin = player.send(AmplitudeModulation(0, SAMPLES, 1, player.soon(2))).commit_period
    play = player.send(PlaySequence(0, PROCESSORS, begin + PROCESSORS, repeats=1)).commit_period
    player.judge(play - 1, play + PROCESSORS * SAMPLES + 4)
