"""Sorting: the output of each transducer (WIRING, and the array order of blocks)."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, case, expect
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import only
from phasewire.hil.conformance.tools.player import Player
from phasewire.protocol.blocks import Entries, Entry, PlaySequence, Slot, Update
from phasewire.protocol.board import CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS, TICKS_PER_PERIOD
from phasewire.protocol.codes import Feature, Request
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.wiring import Pin

SLOW_TRANSDUCERS = 12
AT_ONCE = 64


def all_different(bench: Bench) -> Pulses:
    """A different narrow pulse for every transducer, so that each can be identified."""
    pairs = bench.random.sample(range(4 * 100), CHANNELS)
    return Pulses([pair // 4 for pair in pairs], [1 + pair % 4 for pair in pairs])


@case("REQ-004")
def test_wiring_names_every_output_once(bench: Bench) -> None:
    """WIRING names each of the 320 channels once, in two bytes each, and the same ones whenever it is asked."""
    answer = bench.ask(Request.WIRING)
    channels = sorted(int.from_bytes(answer[at : at + 2], "little") for at in range(0, len(answer), 2))
    expect("the channels, sorted", channels, list(range(CHANNELS)))
    expect("WIRING, asked again", bench.ask(Request.WIRING), answer)


@case("REQ-004", "BLK-006", "CHN-001", "CHN-003", needs=[Need.CAPTURE])
def test_each_transducer_drives_its_output_alone(bench: Bench, player: Player) -> None:
    """Each transducer alone drives exactly the output that WIRING names, all 320 in turn, fewer on a slow line."""
    transducers = bench.random.sample(range(CHANNELS), bench.tries(CHANNELS, SLOW_TRANSDUCERS))
    begun: list[int] = []
    for at in range(0, len(transducers), AT_ONCE):
        acks = player.send_all([Update(only(transducer)) for transducer in transducers[at : at + AT_ONCE]])
        begun += [ack.commit_period for ack in acks]

    def check(seen: Seen) -> None:
        driven = np.bitwise_or.reduce(seen.words.reshape(-1, TICKS_PER_PERIOD, PROCESSORS), axis=1)
        for period, transducer in zip(begun, transducers, strict=True):
            channel = int(bench.wiring.channels[transducer])
            wanted = only_output(channel) & seen.observed
            expect(
                f"in period {period}, in which transducer {transducer} plays alone, what is driven",
                names(driven[period - begun[0]]),
                names(wanted),
            )
        player.score.check(seen)

    bench.judge(begun[0], begun[-1] + 2, check)


def only_output(channel: int) -> NDArray[np.uint32]:
    """One output, as bits of its processor's word, (10,)."""
    words = np.zeros(PROCESSORS, np.uint32)
    processor, bit = divmod(channel, CHANNELS_PER_PROCESSOR)
    words[processor] = 1 << bit
    return words


def names(words: NDArray[np.uint32]) -> list[str]:
    """The outputs given as bits of the processors' words, (10,)."""
    return [
        Pin.of(CHANNELS_PER_PROCESSOR * processor + bit).name
        for processor, word in enumerate(words.tolist())
        for bit in range(CHANNELS_PER_PROCESSOR if word else 0)
        if word >> bit & 1
    ]


@case("REQ-004", "BLK-006", "CHN-003", needs=[Need.CAPTURE])
def test_all_transducers_drive_their_outputs_at_once(bench: Bench, player: Player) -> None:
    """An update of 320 different pulses plays each of them on exactly the output that WIRING names."""
    acks = [player.send(Update(all_different(bench))) for _ in range(3)]
    player.judge(acks[0].commit_period, acks[-1].commit_period + 3)


@case("BLK-013", "REQ-004", "CHN-012/2", needs=[Need.CAPTURE], features=Feature.SEQUENCES)
def test_slots_are_sorted_like_updates(bench: Bench, player: Player) -> None:
    """Slots of 320 different pulses play each of them on the output that WIRING names, as an update does."""
    player.send_all([Slot(slot, all_different(bench)) for slot in (0, 255)])
    player.send(Entries((Entry(0, 1), Entry(255, 1)), 77))
    begin = player.send(PlaySequence(77, 2)).commit_period
    player.judge(begin, begin + 4)


@case("REQ-007", "REQ-004", "BLK-006", features=Feature.READ_BACK)
def test_pulses_are_read_back_in_array_order(bench: Bench, player: Player) -> None:
    """PULSES answers the 320 different pulses of an update at the right transducers."""
    for _ in range(3):
        pulses = all_different(bench)
        ack = player.send(Update(pulses))
        bench.wait_until(ack.commit_period + 1)
        back = bench.read_back()
        expect("since_period", back.since_period, ack.commit_period)
        check_pulses(back.pulses, pulses)


@case("REQ-007", "REQ-004", features=Feature.READ_BACK)
@pytest.mark.parametrize(
    "transducer", [0, 1, 3, 4, 19, 20, CHANNELS // 2 - 1, CHANNELS // 2, CHANNELS - 2, CHANNELS - 1]
)
def test_each_transducer_is_read_back_alone(bench: Bench, player: Player, transducer: int) -> None:
    """PULSES answers the pulse of a single transducer in its place, and silence in all others."""
    pulses = only(transducer, 77, 13)
    ack = player.send(Update(pulses))
    bench.wait_until(ack.commit_period + 1)
    check_pulses(bench.read_back().pulses, pulses)


def check_pulses(seen: Pulses, wanted: Pulses) -> None:
    """Fail if the pulses read back differ from those sent."""
    for transducer in range(CHANNELS):
        expect(
            f"phase and width of transducer {transducer}",
            (int(seen.phase[transducer]), int(seen.width[transducer])),
            (int(wanted.phase[transducer]), int(wanted.width[transducer])),
        )
