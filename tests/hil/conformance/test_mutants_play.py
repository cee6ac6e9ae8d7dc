"""Mutants of sequences, modulation and safety: what plays, for how long, and what ends it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.sight.waveforms import SILENCE, expected_words
from phasewire.protocol.blocks import (
    Body,
    Entries,
    Entry,
    Modulation,
    NoOp,
    Output,
    Samples,
    Sequence,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.codes import Action, Reason, Request, State, StatusFlag
from phasewire.protocol.pulses import Pulses

from tests.hil.conformance.mutant_bench import FULL, SHIFTED, WEAK, Difference, Scenario, check_difference, high, levels

ACCEPTED, EMPTY, IN_USE = Reason.ACCEPTED, Reason.EMPTY, Reason.IN_USE


def walk(bench: Bench, *, repeats: int = 0, slots: tuple[int, int] = (1, 2), first: int = 10, **how: Any) -> int:
    """Play a slot of phase 30 for 3 periods and one of phase 60 for 4; the period at which it begins."""
    bench.enable()
    bench.must(Slot(slots[0], WEAK))
    bench.must(Slot(slots[1], SHIFTED))
    bench.must(Entries((Entry(slots[0], 3), Entry(slots[1], 4)), first))
    return bench.must(Sequence(first, 2, bench.period() + 12, repeats, **how)).commit_period


def story(bench: Bench, period: int, periods: int = 18) -> str:
    """What plays in successive periods: a or b for the two slots, a dot for silence, a question mark for all else."""
    assert bench.sight is not None
    bench.wait_until(period + periods)
    known = {
        expected_words(WEAK, bench.wiring).tobytes(): "a",
        expected_words(SHIFTED, bench.wiring).tobytes(): "b",
        SILENCE.tobytes(): ".",
    }
    seen = bench.sight.seen(period, period + periods)
    return "".join(known.get(seen.period(number).tobytes(), "?") for number in range(period, period + periods))


def walked(**how: Any) -> Scenario:
    return lambda bench: story(bench, walk(bench, **how))


def long_entry(bench: Bench) -> str:
    bench.enable()
    bench.must(Slot(1, WEAK))
    bench.must(Slot(2, SHIFTED))
    bench.must(Entries((Entry(1, 260), Entry(2, 4)), 10))
    period = bench.must(Sequence(10, 2, bench.period() + 12)).commit_period
    return story(bench, period + 255, 10)


def many_entries(bench: Bench) -> str:
    bench.enable()
    bench.must(Slot(1, WEAK))
    bench.must(Slot(2, SHIFTED))
    for place in range(0, 360, 120):
        bench.must(Entries((Entry(1, 1),) * 120, place))
    bench.must(Entries((Entry(2, 1),), 257))
    return story(bench, bench.must(Sequence(0, 258, bench.period() + 30)).commit_period + 250, 10)


def silenced_sequence(bench: Bench) -> str:
    period = walk(bench)
    bench.wait_until(period)
    return story(bench, bench.must(Output(Action.SILENCE)).commit_period, 10)


def end_of_a_sequence(bench: Bench) -> tuple[State, int, int]:
    """The state behind the last repeat, since when it plays, and how many status records say so."""
    period = walk(bench, repeats=1)
    bench.wait_until(period + 12)
    status = bench.status()
    told = bench.line.receive_records(0.001)
    return status.state, status.since_period and status.since_period - period + 1, len(told) // 64


def overwrite(body: Body, *, queued: bool = False, disabled: bool = False) -> Scenario:
    """What becomes of a store while a sequence plays, is queued, or was disabled."""

    def scenario(bench: Bench) -> Reason:
        period = walk(bench)
        if not queued:
            bench.wait_until(period + 1)
        if disabled:
            bench.disable()
        return bench.send(body).reason

    return scenario


def empty(body: Body) -> Scenario:
    """What becomes of a change, where entries 10 to 12 play slots 1 to 3, and slot 3 was never stored."""

    def scenario(bench: Bench) -> Reason:
        walk(bench)
        bench.must(Entries((Entry(3, 4),), 12))
        return bench.send(body).reason

    return scenario


def kept_over(how: str) -> Scenario:
    """What becomes of a sequence and a modulation whose slots and samples were stored before something."""

    def scenario(bench: Bench) -> tuple[Reason, Reason]:
        walk(bench)
        bench.must(Samples(bytes([255])))
        if how == "disable":
            bench.disable()
        elif how == "session":
            bench.usb.set_configuration()
        else:
            bench.order(Request.RESET)
            bench.wait(0.1)
            bench.line.reopen(5)
            bench.must(Entries((Entry(1, 3), Entry(2, 4)), 10), restart=True)
        bench.enable()
        return bench.send(Sequence(10, 2)).reason, bench.send(Modulation(0, 1, 1)).reason

    return scenario


def last_samples(bench: Bench) -> str:
    bench.enable()
    bench.must(Update(WEAK))
    bench.must(Samples(bytes([255]) * 40, 4056))
    return story(bench, bench.must(Modulation(4090, 4, 1)).commit_period, 4)


LOOP, ONCE = "aaabbbbaaabbbbaaab", "aaabbbb..........."
ENDED = (State.READY, 0, 1)

SEQUENCES: list[Difference] = [
    ("sequence-plays-once-too-often", walked(repeats=1), ONCE, "aaabbbbaaabbbb...."),
    ("loop-leaves-out-its-first-entry", walked(), LOOP, "aaabbbbbbbbbbbbbbb"),
    ("loop-has-a-silent-period", walked(), LOOP, "aaabbbb.aaabbbb.aa"),
    ("last-entry-is-a-period-short", walked(), LOOP, "aaabbbaaabbbaaabbb"),
    ("periods-of-an-entry-are-counted-in-a-byte", long_entry, "aaaaabbbba", "baaaabbbba"),
    ("slot-numbers-have-7-bits", walked(slots=(1, 129)), LOOP, "a" * 18),
    ("sequence-begins-with-the-table", walked(repeats=1), ONCE, "." * 18),
    ("sequence-counts-its-entries-in-a-byte", many_entries, "aaaaaaabaa", "a" * 10),
    ("silence-does-not-end-a-sequence", silenced_sequence, "." * 10, "aabbbbaaab"),
    ("last-repeat-is-held", walked(repeats=1), ONCE, "aaabbbbbbbbbbbbbbb"),
    ("end-of-a-sequence-is-not-said", end_of_a_sequence, ENDED, (State.READY, 0, 0)),
    ("device-is-off-behind-a-sequence", end_of_a_sequence, ENDED, (State.OFF, 0, 1)),
    ("since-period-stays-behind-a-sequence", end_of_a_sequence, ENDED, (State.READY, 1, 1)),
    ("device-plays-on-behind-a-sequence", end_of_a_sequence, ENDED, (State.PLAYING, 0, 1)),
    ("in-use-is-never-refused", overwrite(Slot(1, WEAK)), IN_USE, ACCEPTED),
    ("in-use-is-never-refused", overwrite(Entries((Entry(1, 1),), 11)), IN_USE, ACCEPTED),
    ("queued-sequence-uses-nothing-yet", overwrite(Slot(1, WEAK), queued=True), IN_USE, ACCEPTED),
    ("queued-sequence-uses-nothing-yet", overwrite(Slot(1, WEAK)), IN_USE, IN_USE),
    ("slots-in-use-are-not-looked-for", overwrite(Slot(1, WEAK)), IN_USE, ACCEPTED),
    ("slots-in-use-are-not-looked-for", overwrite(Entries((Entry(1, 1),), 11)), IN_USE, IN_USE),
    ("uses-survive-disable", overwrite(Slot(1, WEAK), disabled=True), ACCEPTED, IN_USE),
    ("entries-of-empty-slots-play", empty(Sequence(10, 3)), EMPTY, ACCEPTED),
    ("entries-of-empty-slots-play", empty(Sequence(10, 4)), EMPTY, EMPTY),
    ("entries-that-were-never-stored-play", empty(Sequence(10, 4)), EMPTY, ACCEPTED),
    ("samples-that-were-never-stored-play", empty(Modulation(0, 3, 1)), EMPTY, ACCEPTED),
    ("slots-survive-reset", kept_over("reset"), (EMPTY, EMPTY), (ACCEPTED, EMPTY)),
    ("samples-survive-reset", kept_over("reset"), (EMPTY, EMPTY), (EMPTY, ACCEPTED)),
    ("disable-clears-the-stores", kept_over("disable"), (ACCEPTED, ACCEPTED), (EMPTY, EMPTY)),
    ("new-session-clears-the-stores", kept_over("session"), (ACCEPTED, ACCEPTED), (EMPTY, EMPTY)),
    ("entries-are-placed-within-a-block", walked(first=130, repeats=1), ONCE, "." * 18),
    ("samples-beyond-4080-are-lost", last_samples, "aaaa", "...."),
    ("slots-are-not-sorted", walked(), LOOP, LOOP),  # all transducers alike: seen with others below
]


def sorted_slot(bench: Bench) -> bool:
    assert bench.sight is not None
    pulses = Pulses(np.arange(320) % 100, np.arange(320) % 20)
    bench.enable()
    bench.must(Slot(1, pulses))
    bench.must(Entries((Entry(1, 50),)))
    period = bench.must(Sequence(0, 1)).commit_period
    bench.wait_until(period + 1)
    return bool((bench.sight.seen(period, period + 1).words == expected_words(pulses, bench.wiring)).all())


def read_back(bench: Bench) -> bool:
    pulses = Pulses(np.arange(320) % 100, np.arange(320) % 20)
    bench.enable()
    bench.wait_until(bench.must(Update(pulses)).commit_period + 1)
    return bench.read_back().pulses == pulses


SEQUENCES += [
    ("slots-are-not-sorted", sorted_slot, True, False),
    ("read-back-is-in-channel-order", read_back, True, False),
    ("two-transducers-are-swapped", read_back, True, True),
]

# Modulations

PALE = Pulses(np.full(320, 50), np.full(320, 24))


def widths(bench: Bench, period: int, periods: int, transducer: int = 0) -> list[int]:
    """How long an output is high in successive periods."""
    return [levels(bench, number, transducer).count("#") for number in range(period, period + periods)]


def paled(*samples: int, hold: int = 2, periods: int = 12, first: int = 0) -> Scenario:
    """The widths that a pulse of 24 ticks has in successive periods of a modulation."""

    def scenario(bench: Bench) -> list[int]:
        bench.enable()
        bench.must(Update(PALE))
        bench.must(Samples(bytes(samples)))
        return widths(bench, bench.must(Modulation(0, len(samples), hold)).commit_period + first, periods)

    return scenario


def updated_under_a_modulation(bench: Bench) -> list[int]:
    bench.enable()
    bench.must(Update(PALE))
    bench.must(Samples(bytes([255, 0, 128])))
    period = bench.must(Modulation(0, 3, 4)).commit_period
    bench.must(Update(PALE, period + 5))
    return widths(bench, period, 10)


def modulated_sequence(bench: Bench) -> list[int]:
    period = walk(bench)
    bench.must(Samples(bytes([0])))
    return widths(bench, bench.must(Modulation(0, 1, 1, period + 20)).commit_period - 2, 4)


def modulated_edge(bench: Bench) -> str:
    bench.enable()
    bench.must(Update(PALE))
    bench.must(Samples(bytes([128])))
    return levels(bench, bench.must(Modulation(0, 1, 1)).commit_period)


def unmodulated_by(body: Body) -> Scenario:
    """The width behind an end, and that of an update behind it."""

    def scenario(bench: Bench) -> list[int]:
        bench.enable()
        bench.must(Update(PALE))
        bench.must(Samples(bytes([0])))
        bench.must(Modulation(0, 1, 1))
        ended = bench.must(body).commit_period
        again = bench.must(Update(PALE)).commit_period
        return widths(bench, ended, 1) + widths(bench, again, 1)

    return scenario


def disabled_modulation(bench: Bench) -> int:
    bench.enable()
    bench.must(Update(PALE))
    bench.must(Samples(bytes([0])))
    bench.wait_until(bench.must(Modulation(0, 1, 1)).commit_period)
    bench.disable()
    bench.enable()
    return widths(bench, bench.must(Update(PALE)).commit_period, 1)[0]


def flags_of_a_modulation(bench: Bench) -> StatusFlag:
    bench.enable()
    bench.must(Samples(bytes([0])))
    bench.wait_until(bench.must(Modulation(0, 1, 1)).commit_period + 1)
    return bench.status().flags


def width_17_under_200(bench: Bench) -> int:
    bench.enable()
    bench.must(Update(Pulses(np.full(320, 51), np.full(320, 17))))
    bench.must(Samples(bytes([200])))
    return widths(bench, bench.must(Modulation(0, 1, 1)).commit_period, 1)[0]


def samples_of_two_processors(bench: Bench) -> list[int]:
    """Widths of two transducers, of processors 0 and 1, in one period."""
    bench.enable()
    bench.must(Update(PALE))
    bench.must(Samples(bytes([0, 255])))
    period = bench.must(Modulation(0, 2, 1)).commit_period
    return [widths(bench, period, 1, bench.wiring.channels.tolist().index(channel))[0] for channel in (0, 32)]


# 50/π·asin(s/255·sin(πw/50)): 8.35 for w = 24 and s = 128, 16.51 for w = 24 and s = 220, 12.03 for w = 17 and s = 200
STEPS = [24] * 4 + [0] * 4 + [8] * 2

MODULATED: list[Difference] = [
    ("widths-are-truncated", paled(220, hold=1, periods=1), [17], [16]),
    ("widths-are-linear", paled(128, hold=1, periods=1), [8], [12]),
    ("widths-follow-the-widest", width_17_under_200, 12, 10),
    ("sample-0-is-not-silent", paled(0, hold=1, periods=1), [0], [1]),
    ("one-modulated-width-is-off", width_17_under_200, 12, 11),
    ("sample-255-is-not-full", paled(255, hold=1, periods=1), [24], [23]),
    ("modulation-keeps-the-leading-edge", modulated_edge, high(21, 8), high(13, 8)),
    ("samples-hold-a-period-longer", paled(255, 0), [24, 24, 0, 0] * 3, [24, 24, 24, 0, 0, 0] * 2),
    ("hold-is-a-byte", paled(255, 0, hold=257, periods=3), [24] * 3, [24, 0, 24]),
    ("loop-repeats-its-last-sample", paled(255, 0), [24, 24, 0, 0] * 3, [24, 24, 0, 0, 0, 0] * 2),
    ("loop-leaves-out-its-last-sample", paled(255, 0), [24, 24, 0, 0] * 3, [24] * 12),
    ("modulation-begins-again-at-each-update", updated_under_a_modulation, STEPS, [24] * 4 + [0] + [24] * 4 + [0]),
    ("update-ends-the-modulation", updated_under_a_modulation, STEPS, [24] * 4 + [0] + [24] * 5),
    ("sequences-are-not-modulated", modulated_sequence, [2, 2, 0, 0], [2, 2, 2, 2]),
    ("half-of-the-processors-are-a-sample-ahead", samples_of_two_processors, [0, 0], [0, 24]),
    ("end-of-the-modulation-silences", unmodulated_by(Output(Action.END_MODULATION)), [24, 24], [0, 24]),
    ("silence-leaves-the-modulation", unmodulated_by(Output(Action.SILENCE)), [0, 24], [0, 0]),
    ("modulation-survives-disable", disabled_modulation, 24, 0),
    ("modulation-is-not-in-the-status", flags_of_a_modulation, StatusFlag.MODULATION, StatusFlag(0)),
]

# Safety


def bite(bench: Bench, feed: Any = None, *, at: float = 0.006, milliseconds: int = 10) -> float:
    """Milliseconds from a sign of life until the device is OFF, where something is done meanwhile."""
    bench.order(Request.WATCHDOG, milliseconds)
    bench.enable()
    began = bench.must(NoOp()).now
    bench.unasked.clear()
    if feed is not None:
        bench.wait(at)
        feed(bench)
    return (bench.await_unasked(0.5).now - began) / 2000


def bitten(feed: Any = None, **how: Any) -> Scenario:
    def scenario(bench: Bench) -> int:
        return round(bite(bench, feed, **how) * 40)

    return scenario


def refused_block(bench: Bench) -> None:
    bench.send_raw(bytes(512))


def nak(bench: Bench) -> int:
    """Whether the device is OFF behind a write for which there is no room for longer than the watchdog's time."""
    bench.order(Request.WATCHDOG, 20)
    bench.enable()
    period = bench.period() + 4000
    bench.send_all([Update(WEAK, period + number) for number in range(32)])
    bench.line.send_blocks(pack(bench.numbered(NoOp())), 0.04)
    return bench.status().state


def after_a_sequence(bench: Bench) -> State:
    bench.wait_until(walk(bench, repeats=1) + 10)
    bench.wait(0.2)
    return bench.status().state


def fed_until(feed: Any) -> Scenario:
    """Whether the device is still enabled where something is done every 6 ms of a watchdog of 10 ms."""

    def scenario(bench: Bench) -> bool:
        bench.order(Request.WATCHDOG, 10)
        bench.enable()
        for _ in range(4):
            bench.wait(0.006)
            feed(bench)
        return bench.status().enabled

    return scenario


def enabled_again(bench: Bench) -> bool:
    bench.order(Request.WATCHDOG, 10)
    bench.enable()
    bench.wait(0.006)
    bench.enable()
    bench.wait(0.006)
    return bench.status().enabled


def fired(bench: Bench) -> list[bool]:
    bench.enable()
    bench.wait(0.15)
    first = bench.status().watchdog_fired
    bench.enable()
    return [first, bench.status().watchdog_fired]


def shortened(bench: Bench) -> State:
    bench.enable()
    bench.wait(0.05)
    bench.order(Request.WATCHDOG, 20)
    bench.wait(0.001)
    return bench.status().state


def shortened_late(bench: Bench) -> State:
    bench.enable()
    bench.wait(0.05)
    bench.order(Request.WATCHDOG, 60)
    bench.wait(0.02)
    return bench.status().state


def outputs_from(bench: Bench, period: int) -> list[bool]:
    """Whether anything is high in 30 successive periods."""
    assert bench.sight is not None
    bench.wait_until(period + 31)
    seen = bench.sight.seen(period, period + 30)
    return [bool(seen.period(number).any()) for number in range(period, period + 30)]


def silent_in_time(bench: Bench) -> bool:
    """Whether all outputs are silent within six periods of that in which DISABLE arrives, and stay so."""
    bench.enable()
    bench.wait_until(bench.must(Update(WEAK)).commit_period + 2)
    asked = bench.period()
    bench.order(Request.DISABLE)  # which takes a microframe, five periods
    played = outputs_from(bench, asked)
    return not any(played[5 + 6 + 1 :])


def silent_behind_the_watchdog(bench: Bench) -> bool:
    bench.enable()
    bench.must(Update(WEAK))
    bench.wait(0.11)
    return not any(outputs_from(bench, bench.period()))


def whole_periods(bench: Bench) -> bool:
    """Whether the outputs do whole periods of what they did until they are silent, whenever DISABLE comes."""
    found: set[int] = set()
    for quarter in range(4):
        bench.enable()
        bench.wait_until(bench.must(Update(PALE)).commit_period + 2)
        bench.wait_periods(quarter / 4)
        bench.order(Request.DISABLE)
        period = bench.period()
        found |= set(widths(bench, period - 8, 16))
    return found == {0, 24}


def queued_at_disable(bench: Bench) -> bool:
    """Whether all stays silent behind DISABLE, where a change was queued."""
    assert bench.sight is not None
    bench.enable()
    period = bench.must(Update(WEAK, bench.period() + 60)).commit_period
    bench.order(Request.DISABLE)
    bench.wait_until(period + 3)
    return not bench.sight.seen(period - 10, period + 2).words.any()


def behind_a_disabling_block(bench: Bench) -> bool:
    assert bench.sight is not None
    bench.enable()
    off = bench.must(Output(Action.DISABLE, bench.period() + 30)).commit_period
    bench.must(Update(WEAK, off + 20))
    bench.wait_until(off + 30)
    return not bench.sight.seen(off, off + 28).words.any()


def at_power_up(bench: Bench) -> bool:
    assert bench.sight is not None
    bench.levers.power_down()
    bench.wait(0.1)
    bench.levers.power_up()
    bench.line.reopen(15)
    bench.wait_until(200)
    return not bench.sight.seen(0, 100).words.any()


def behind_reset(bench: Bench) -> bool:
    assert bench.sight is not None
    bench.enable()
    bench.wait_until(bench.must(Update(WEAK)).commit_period + 2)
    bench.order(Request.RESET)
    bench.wait(0.1)
    bench.line.reopen(15)
    bench.wait_until(200)
    return not bench.sight.seen(0, 20).words.any()


def state_at_power_up(bench: Bench) -> State:
    bench.levers.power_down()
    bench.wait(0.1)
    bench.levers.power_up()
    bench.wait(0.1)
    bench.line.reopen(15)
    return bench.status().state


def drive(body: Body, limit: int) -> Scenario:
    def scenario(bench: Bench) -> Reason:
        bench.order(Request.LIMIT, limit)
        bench.enable()
        return bench.send(body).reason

    return scenario


def drive_of_a_sequence(bench: Bench) -> Reason:
    walk(bench)
    bench.disable()
    bench.order(Request.LIMIT, 1)
    bench.enable()
    return bench.send(Sequence(10, 2)).reason


def strong(count: int, width: int = 25) -> Pulses:
    return Pulses(np.zeros(320, int), np.where(np.arange(320) < count, width, 0))


def limit_while_enabled(bench: Bench) -> bool:
    bench.enable()
    return bench.try_order(Request.LIMIT, 5)


def limit_behind_disable(bench: Bench) -> int:
    bench.order(Request.LIMIT, 5)
    bench.enable()
    bench.disable()
    return bench.status().drive_limit


def in_fault(bench: Bench) -> tuple[bool, Reason, Reason]:
    from phasewire.emulator.faults import HotBoard

    bench.levers.cause(HotBoard(board=1, celsius=90))
    bench.wait(0.05)
    assert bench.status().state is State.FAULT
    stored, changed = bench.send(Slot(1, WEAK)).reason, bench.send(Update(WEAK)).reason
    return bench.try_order(Request.ENABLE), stored, changed


def unattended(what: Any) -> Scenario:
    """The state behind something, while a sequence plays that may go on without the host."""

    def scenario(bench: Bench) -> State:
        bench.wait_until(walk(bench, unattended=True) + 2)
        what(bench)
        return bench.status().state

    return scenario


def attended(bench: Bench) -> State:
    bench.wait_until(walk(bench) + 2)
    bench.wait(0.2)
    return bench.status().state


def suspend(bench: Bench) -> None:
    bench.levers.suspend()
    bench.levers.resume()


def update_and_wait(bench: Bench) -> None:
    bench.must(Update(WEAK))
    bench.wait(0.2)


FAULTED = (False, Reason.FAULT, Reason.FAULT)
DRIVE = Reason.DRIVE

SAFE: list[Difference] = [
    ("watchdog-never-bites-after-a-sequence", after_a_sequence, State.OFF, State.READY),
    ("refused-blocks-feed-the-watchdog", fed_until(refused_block), False, True),
    (
        "blocks-refused-for-what-they-would-play-feed-the-watchdog",
        fed_until(lambda bench: bench.send(Sequence(0, 1))),
        False,
        True,
    ),
    ("nak-feeds-the-watchdog", nak, State.OFF, State.READY),
    ("every-request-feeds-the-watchdog", fed_until(lambda bench: bench.clock()), False, True),
    ("status-does-not-feed-the-watchdog", fed_until(lambda bench: bench.status()), True, False),
    ("enable-does-not-feed-the-watchdog", enabled_again, True, False),
    ("stores-do-not-feed-the-watchdog", fed_until(lambda bench: bench.must(NoOp())), True, False),
    ("watchdog-bites-a-period-early", bitten(), 400, 399),
    ("watchdog-bites-2-ms-late", bitten(), 400, 480),
    ("watchdog-is-never-said-to-have-fired", fired, [True, False], [False, False]),
    ("enable-does-not-clear-watchdog-fired", fired, [True, False], [True, True]),
    ("watchdog-time-holds-from-the-next-sign-of-life", shortened, State.OFF, State.READY),
    ("watchdog-time-begins-anew-with-watchdog", shortened_late, State.OFF, State.READY),
    ("disable-leaves-a-board-playing", silent_in_time, True, False),
    ("disable-takes-ten-periods", silent_in_time, True, False),
    ("watchdog-stops-the-state-alone", silent_behind_the_watchdog, True, False),
    ("disable-cuts-within-a-period", whole_periods, True, False),
    ("queued-changes-begin-after-disable", queued_at_disable, True, False),
    ("changes-behind-a-disabling-block-are-played", behind_a_disabling_block, True, False),
    ("outputs-are-high-at-power-up", at_power_up, True, False),
    ("reset-leaves-the-outputs-playing", behind_reset, True, False),
    ("outputs-are-enabled-at-power-up", state_at_power_up, State.OFF, State.READY),
    ("drive-of-slots-is-not-judged", drive(Slot(1, FULL), 10), DRIVE, ACCEPTED),
    ("drive-of-sequences-is-not-judged", drive_of_a_sequence, DRIVE, ACCEPTED),
    ("drive-at-the-limit-is-refused", drive(Update(strong(10)), 10), ACCEPTED, DRIVE),
    ("drive-is-compared-in-whole-transducers", drive(Update(strong(11, 24)), 10), DRIVE, ACCEPTED),
    ("drive-is-the-sum-of-widths", drive(Update(strong(12, 20)), 10), DRIVE, ACCEPTED),
    ("limit-is-taken-while-enabled", limit_while_enabled, False, True),
    ("limit-goes-back-with-disable", limit_behind_disable, 5, 320),
    ("enable-is-possible-in-fault", in_fault, FAULTED, (True, Reason.FAULT, Reason.FAULT)),
    ("blocks-are-taken-in-fault", in_fault, FAULTED, (False, ACCEPTED, Reason.DISABLED)),
    ("unattended-is-ignored", unattended(lambda bench: bench.wait(0.2)), State.UNATTENDED, State.OFF),
    ("every-sequence-is-unattended", attended, State.OFF, State.UNATTENDED),
    (
        "unattended-sequence-survives-a-new-session",
        unattended(lambda bench: bench.usb.set_configuration()),
        State.OFF,
        State.UNATTENDED,
    ),
    ("suspend-ends-what-is-unattended", unattended(suspend), State.UNATTENDED, State.OFF),
    ("update-does-not-wake-the-watchdog", unattended(update_and_wait), State.OFF, State.PLAYING),
]


@pytest.mark.parametrize(("name", "scenario", "sound", "broken"), SEQUENCES + MODULATED + SAFE)
def test_a_mutant_differs(name: str, scenario: Scenario, sound: Any, broken: Any) -> None:
    check_difference(name, scenario, sound, broken)
