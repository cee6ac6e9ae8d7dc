"""Mutants of blocks, acknowledgements, time, outputs and safety: each comes up, differs as it says, and is undone.

What is right in a scenario is what SPEC.md says; a sound emulator must show it, and the mutant must not.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.lines.usb import UsbLine
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.patching import Patch
from phasewire.hil.conformance.sight.waveforms import expected_words, only
from phasewire.hil.conformance.tools.forge import FIELDS, forged, seal
from phasewire.protocol.blocks import (
    Block,
    Body,
    Clock,
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
from phasewire.protocol.codes import Action, Kind, Reason, Request, State
from phasewire.protocol.pulses import Pulses

from tests.hil.conformance.mutant_bench import (
    FULL,
    SHIFTED,
    WEAK,
    Difference,
    Scenario,
    bench_of,
    check_difference,
    high,
    levels,
)

GROUPS = {
    "acknowledgements",
    "blocks",
    "flow",
    "modulation",
    "numbering",
    "pulses",
    "safety",
    "sequences",
    "sorting",
    "timing",
}
MINE = {name: mutant for name, mutant in MUTANTS.items() if mutant.group in GROUPS}
FAR = 40
"""Periods: far enough for changes to be queued."""


class Recorder(Patch):
    """A patch that remembers what it changed."""

    def __init__(self) -> None:
        super().__init__()
        self.changed: list[tuple[Any, str, Any]] = []

    def replace(self, owner: Any, name: str, value: Any) -> None:
        self.changed.append((owner, name, vars(owner)[name]))
        super().replace(owner, name, value)


@pytest.mark.parametrize("name", MINE)
def test_a_mutant_comes_up_and_is_undone(name: str) -> None:
    mutant, patch = MINE[name], Recorder()
    mutant.apply(patch)
    try:
        assert any(vars(owner)[attribute] is not before for owner, attribute, before in patch.changed)
        with bench_of(mutant.url) as bench:
            assert bench.info.channels == 320
    finally:
        patch.undo()
    firsts = {(id(owner), attribute): before for owner, attribute, before in reversed(patch.changed)}
    owners = {id(owner): owner for owner, _, _ in patch.changed}
    assert all(vars(owners[owner])[attribute] is before for (owner, attribute), before in firsts.items())


def test_names_of_files_are_those_of_groups() -> None:
    assert {mutant.group for mutant in MINE.values()} == GROUPS
    assert len(MINE) >= 55


# What is said to a block


def reason(body: Body, *, enabled: bool = False, raw: Callable[[bytes], bytes] = bytes, **fields: Any) -> Scenario:
    """What becomes of a block with other fields, or with other bytes."""

    def scenario(bench: Bench) -> Reason:
        if enabled:
            bench.enable()
        block = pack(bench.numbered(body))
        (ack,) = bench.send_raw(raw(forged(block, **fields) if fields else block))
        return ack.reason

    return scenario


def flipped(at: int, bits: int = 1) -> Callable[[bytes], bytes]:
    return lambda block: block[:at] + bytes([block[at] ^ bits]) + block[at + 1 :]


def sealed(at: int, octet: int) -> Callable[[bytes], bytes]:
    return lambda block: seal(block[:at] + bytes([octet]) + block[at + 1 :])


def pulse(code: int) -> bytes:
    return code.to_bytes(2, "little")


def entries(count: int) -> Entries:
    return Entries((Entry(0, 1),) * count)


CHECKSUM, MAGIC, KIND, FIELD = Reason.CHECKSUM, Reason.MAGIC, Reason.KIND, Reason.FIELD
PULSE, DISABLED, DRIVE, ACCEPTED = Reason.PULSE, Reason.DISABLED, Reason.DRIVE, Reason.ACCEPTED
IN_USE, EMPTY, SEQUENCE, LENGTH = Reason.IN_USE, Reason.EMPTY, Reason.SEQUENCE, Reason.LENGTH
assert FIELDS["flags"] == (26, 1)

JUDGED: list[Difference] = [
    ("checksum-of-a-slot-is-ignored", reason(Slot(1, WEAK), raw=flipped(100)), CHECKSUM, ACCEPTED),
    ("half-of-the-checksum-is-compared", reason(NoOp(), raw=flipped(30)), CHECKSUM, ACCEPTED),
    ("half-of-the-magic-is-compared", reason(NoOp(), raw=sealed(1, 0)), MAGIC, ACCEPTED),
    ("unknown-kinds-do-nothing", reason(NoOp(), kind=10), KIND, ACCEPTED),
    ("second-reserved-byte-is-not-checked", reason(NoOp(), reserved=256), FIELD, ACCEPTED),
    ("payload-that-is-not-used-is-not-checked", reason(NoOp(), raw=sealed(511, 1)), FIELD, ACCEPTED),
    ("bytes-behind-the-items-are-not-checked", reason(entries(2), raw=sealed(40, 1)), FIELD, ACCEPTED),
    ("unattended-is-accepted-in-an-update", reason(Update(WEAK), enabled=True, flags=2), FIELD, ACCEPTED),
    ("hold-0-is-accepted", reason(Modulation(0, 1, 1), hold=0), FIELD, DISABLED),
    ("action-0-is-accepted", reason(Output(Action.SILENCE), enabled=True, action=0), FIELD, ACCEPTED),
    ("entries-may-end-one-behind-the-table", reason(entries(3), first=1022), FIELD, ACCEPTED),
    ("full-entries-are-refused", reason(entries(120)), ACCEPTED, FIELD),
    ("full-samples-are-refused", reason(Samples(bytes(480))), ACCEPTED, FIELD),
    ("last-slot-is-refused", reason(Slot(255, WEAK)), ACCEPTED, FIELD),
    ("width-26-is-accepted", reason(Slot(1, WEAK), payload=pulse(26 << 7)), PULSE, ACCEPTED),
    ("phase-100-is-accepted", reason(Slot(1, WEAK), payload=pulse(100 | 2 << 7)), PULSE, ACCEPTED),
    ("phase-of-a-silent-pulse-is-not-checked", reason(Slot(1, WEAK), payload=pulse(100)), PULSE, ACCEPTED),
    ("pulses-are-judged-before-fields", reason(Slot(1, WEAK), payload=pulse(100), hold=1), FIELD, PULSE),
    ("magic-is-judged-before-the-checksum", reason(NoOp(), raw=flipped(0)), CHECKSUM, MAGIC),
    ("state-is-judged-before-contents", reason(Update(WEAK), payload=pulse(100)), PULSE, DISABLED),
    ("stores-are-refused-while-disabled", reason(Slot(1, WEAK)), ACCEPTED, DISABLED),
    ("ending-no-modulation-is-refused", reason(Output(Action.END_MODULATION), enabled=True), ACCEPTED, EMPTY),
    ("changes-are-taken-while-disabled", reason(Update(WEAK)), DISABLED, ACCEPTED),
    ("horizon-is-not-judged", reason(Update(WEAK), enabled=True, period=2**34), Reason.HORIZON, ACCEPTED),
]


def last_refusal(bench: Bench) -> Reason:
    bench.send_raw(seal(flipped(0)(pack(bench.numbered(NoOp())))), forged(pack(bench.numbered(NoOp())), kind=77))
    return bench.status().last_refusal


def counts_of_a_refusal(bench: Bench) -> tuple[int, int]:
    before = bench.status()
    bench.send_raw(forged(pack(bench.numbered(NoOp())), kind=77))
    after = bench.status()
    return after.accepted - before.accepted, after.refused - before.refused


def old_number_while_off(bench: Bench) -> Reason:
    number = bench.must(NoOp()).sequence
    return bench.send_raw(pack(Block(Update(WEAK), number)))[0].reason


def strong_slot_in_use(bench: Bench) -> Reason:
    bench.order(Request.LIMIT, 10)
    bench.enable()
    bench.must(Slot(1, WEAK))
    bench.must(Entries((Entry(1, 5),)))
    bench.must(Sequence(0, 1))
    return bench.send(Slot(1, FULL)).reason


def slot_that_was_refused(bench: Bench) -> int:
    bench.enable()
    bench.must(Slot(1, WEAK))
    bench.must(Entries((Entry(1, 5),)))
    bench.must(Sequence(0, 1))
    assert bench.send(Slot(1, SHIFTED)).reason is IN_USE
    bench.wait_periods(20)
    bench.must(Sequence(0, 1))
    bench.wait_periods(20)
    return int(bench.read_back().pulses.phase[0])


def queue_behind_a_refusal(bench: Bench) -> int:
    bench.enable()
    bench.must(Update(WEAK, bench.period() + 400))
    assert bench.send(Sequence(7, 1)).reason is EMPTY
    return bench.status().free


def silence_behind_an_update(bench: Bench) -> bool:
    bench.enable()
    period = bench.period() + 400
    bench.must(Update(WEAK, period))
    return bench.must(Output(Action.SILENCE)).commit_period > period


def state_behind_a_disabling_block(bench: Bench) -> State:
    bench.enable()
    bench.wait_until(bench.must(Output(Action.DISABLE)).commit_period + 1)
    return bench.status().state


def short_block(bench: Bench) -> Reason:
    return bench.send_raw(pack(bench.numbered(NoOp()))[:500])[0].reason


JUDGED += [
    ("horizon-is-not-judged", reason(Update(WEAK), enabled=True, period=2**64 - 2), Reason.HORIZON, ACCEPTED),
    ("last-refusal-is-always-checksum", last_refusal, KIND, CHECKSUM),
    ("last-refusal-is-the-first", last_refusal, KIND, MAGIC),
    ("refused-blocks-count-as-accepted", counts_of_a_refusal, (0, 1), (1, 1)),
    ("numbers-are-judged-before-the-state", old_number_while_off, DISABLED, SEQUENCE),
    ("contents-of-the-stores-are-judged-before-the-drive", strong_slot_in_use, DRIVE, IN_USE),
    ("refused-stores-are-kept", slot_that_was_refused, 30, 60),
    ("refused-change-empties-the-queue", queue_behind_a_refusal, 31, 32),
    ("silence-overtakes-what-is-queued", silence_behind_an_update, True, False),
    ("disabling-block-only-silences", state_behind_a_disabling_block, State.OFF, State.READY),
    ("short-block-is-filled-up", short_block, LENGTH, ACCEPTED),
]

# Numbers


def answers(*numbers: int, kinds: dict[int, int] | None = None) -> Scenario:
    """What is said to NO_OPs of these numbers, behind one that begins the numbering: reasons and gaps, and the lost."""

    def scenario(bench: Bench) -> tuple[str, int]:
        lost = bench.status().lost
        said = ""
        for place, number in enumerate(numbers):
            block = pack(Block(NoOp(), number, restart=not place))
            (ack,) = bench.send_raw(forged(block, kind=(kinds or {}).get(place, Kind.NO_OP)))
            said += {ACCEPTED: "g" if ack.flags else "a", SEQUENCE: "s"}.get(ack.reason, "r")
        return said, (bench.status().lost - lost) % 2**32

    return scenario


def restarted(bench: Bench) -> tuple[Reason, int, int]:
    bench.must(NoOp(), number=10, restart=True)
    lost = bench.status().lost
    ack = bench.send(NoOp(), number=5, restart=True)
    second = bench.send(NoOp(), number=9, restart=True)
    return ack.reason, int(second.flags), (bench.status().lost - lost) % 2**32


def number_in_a_new_session(bench: Bench) -> Reason:
    bench.must(NoOp(), number=10)
    bench.usb.set_configuration()
    return bench.send_raw(pack(Block(NoOp(), 3)))[0].reason


NUMBERED: list[Difference] = [
    ("numbers-are-compared-without-wrap", answers(2**32 - 1, 0), ("aa", 0), ("as", 0)),
    ("same-number-follows", answers(5, 5), ("as", 0), ("aa", 0)),
    ("half-the-range-follows", answers(5, 5 + 2**31), ("as", 0), ("ag", 2**31 - 1)),
    ("old-numbers-follow", answers(5, 4), ("as", 0), ("ag", 2**31 - 2)),
    ("gap-is-never-said", answers(5, 9), ("ag", 3), ("aa", 3)),
    ("lost-counts-one-too-many", answers(5, 9), ("ag", 3), ("ag", 4)),
    ("lost-counts-gaps", answers(5, 9), ("ag", 3), ("ag", 1)),
    ("restart-is-ignored", restarted, (ACCEPTED, 0, 0), (SEQUENCE, 0, 0)),
    ("restart-counts-as-a-gap", restarted, (ACCEPTED, 0, 0), (ACCEPTED, 2, 2**32 - 6 + 3)),
    ("number-survives-a-new-session", number_in_a_new_session, ACCEPTED, SEQUENCE),
    ("refused-sequence-is-the-last", answers(5, 2, 3), ("ass", 0), ("asa", 0)),
]


def number_of_a_refused_update(bench: Bench) -> tuple[Reason, bool]:
    bench.must(NoOp(), number=5)
    assert bench.send(Update(WEAK), number=6).reason is DISABLED
    again = bench.send(NoOp(), number=6)
    return again.reason, bool(again.flags)


NUMBERED.append(("refused-number-is-the-last", number_of_a_refused_update, (ACCEPTED, False), (SEQUENCE, False)))

# Acknowledgements


def now_of_an_ack(bench: Bench) -> bool:
    before = bench.clock().now
    return before < bench.must(NoOp()).now < bench.clock().now


def raw_ack(at: int) -> Scenario:
    def scenario(bench: Bench) -> int:
        bench.line.send_blocks(pack(Block(NoOp(), 0x0101, restart=True)), 0.1)
        return bench.line.receive_records(0.1)[at]

    return scenario


def sealed_ack(bench: Bench) -> bool:
    bench.line.send_blocks(pack(bench.numbered(NoOp())), 0.1)
    record = bench.line.receive_records(0.1)
    return zlib.crc32(record[:28]) == int.from_bytes(record[28:], "little")


def free_of_an_ack(bench: Bench) -> int:
    bench.enable()
    return bench.must(Update(WEAK, bench.period() + 400)).free


def free_of_many_acks(bench: Bench) -> list[int]:
    bench.enable()
    period = bench.period() + 400
    return [ack.free for ack in bench.send_all([Update(WEAK, period + number) for number in range(5)])]


def state_of_an_ack(bench: Bench) -> State:
    bench.enable()
    return bench.must(Update(WEAK)).state


def period_of_a_refusal(bench: Bench) -> int:
    return bench.send(Update(WEAK, 5000)).commit_period


def period_of_a_late_change(bench: Bench) -> bool:
    bench.enable()
    ack = bench.must(Update(WEAK, 1))
    assert ack.late
    return ack.commit_period > 1


def period_of_a_clock(bench: Bench) -> int:
    bench.wait_until(4096 + 100)
    return bench.must(Clock()).commit_period


def period_of_a_clock_is_whole(bench: Bench) -> bool:
    return period_of_a_clock(bench) % 4096 == 0


def order_of_acks(bench: Bench) -> list[int]:
    blocks = [pack(bench.numbered(NoOp())) for _ in range(3)]
    bench.line.send_blocks(blocks[0] + forged(blocks[1], kind=77) + blocks[2], 0.1)
    found = bench.line.receive_records(0.1)
    numbers = [found[at + 4 : at + 8] for at in range(0, len(found), 32)]
    return [[block[4:8] for block in blocks].index(number) for number in numbers]


def lone_ack(bench: Bench) -> int:
    bench.line.send_blocks(pack(bench.numbered(NoOp())), 0.1)
    return len(bench.line.receive_records(0.01))


def statuses_unasked(bench: Bench) -> list[int]:
    """Sizes of the records that come where the watchdog bites twice while an acknowledgement waits."""
    assert isinstance(bench.line, UsbLine)
    bench.order(Request.WATCHDOG, 10)
    bench.enable()
    bench.line.write(1, pack(bench.numbered(NoOp())), 0.1)
    bench.wait(0.02)
    bench.enable()
    bench.wait(0.02)
    found, sizes = b"".join(bench.line.read(0x81, 512, 0.01) or b"" for _ in range(3)), []
    while found:
        sizes.append(64 if found[:2] == b"PS" else 32)
        found = found[sizes[-1] :]
    return sizes


def unasked_over_frames(bench: Bench) -> int:
    bench.serial.enter_frames()
    bench.order(Request.WATCHDOG, 10)
    bench.enable()
    bench.wait(0.02)
    return len(bench.serial.receive_records(0.01))


def split_records(bench: Bench) -> list[int]:
    """Sizes of packets at full speed, where an acknowledgement waits before a status record."""
    assert isinstance(bench.line, UsbLine)
    bench.order(Request.WATCHDOG, 10)
    bench.enable()
    bench.line.write(1, pack(bench.numbered(NoOp())), 0.1)
    bench.wait(0.02)
    return [len(bench.line.read(0x81, 64, 0.01) or b"") for _ in range(2)]


def state_behind_silence(bench: Bench) -> State:
    bench.enable()
    bench.must(Update(WEAK))
    bench.wait_until(bench.must(Output(Action.SILENCE)).commit_period + 1)
    return bench.status().state


def acks_of_no_ops(bench: Bench) -> int:
    bench.line.send_blocks(pack(bench.numbered(NoOp())), 0.1)
    return len(bench.line.receive_records(0.1))


ACKNOWLEDGED: list[Difference] = [
    ("now-is-in-periods", now_of_an_ack, True, False),
    ("now-is-that-of-the-millisecond", now_of_an_ack, True, False),
    ("acks-are-of-version-2", raw_ack(2), 1, 2),
    ("reserved-byte-of-an-ack-is-not-cleared", raw_ack(27), 0, 1),
    ("free-is-counted-before-the-change", free_of_an_ack, 31, 32),
    ("free-is-counted-before-the-change", free_of_many_acks, [31, 30, 29, 28, 27], [32, 31, 30, 29, 28]),
    ("state-is-that-after-the-change", state_of_an_ack, State.READY, State.PLAYING),
    ("refused-change-says-the-period-that-it-named", period_of_a_refusal, 0, 5000),
    ("late-change-says-the-period-that-it-named", period_of_a_late_change, True, False),
    ("ack-checksum-covers-27-bytes", sealed_ack, True, False),
    ("clock-says-no-period", period_of_a_clock, 4096, 0),
    ("clock-says-its-own-period", period_of_a_clock_is_whole, True, False),
    ("refusals-overtake", order_of_acks, [0, 1, 2], [1, 0, 2]),
    ("lone-ack-waits-for-company", lone_ack, 32, 0),
    ("unasked-status-overtakes", statuses_unasked, [32, 64], [64, 32]),
    ("unasked-statuses-pile-up", statuses_unasked, [32, 64], [32, 64, 64]),
    ("states-are-told-only-when-asked-for", statuses_unasked, [32, 64], [32]),
    ("records-are-cut-at-the-end-of-a-packet", split_records, [32, 64], [64, 32]),
    ("serial-lines-are-told-nothing-unasked", unasked_over_frames, 64, 0),
    ("silence-counts-as-playing", state_behind_silence, State.READY, State.PLAYING),
    ("no-ops-are-not-acknowledged", acks_of_no_ops, 32, 0),
]

# Outputs


def plays(phase: int, width: int, *, after: int = 1, transducer: int = 0) -> Scenario:
    """What an output does so many periods after its pulse began to play."""

    def scenario(bench: Bench) -> str:
        bench.enable()
        ack = bench.must(Update(only(transducer, phase, width)))
        return levels(bench, ack.commit_period + after, transducer)

    return scenario


def at_the_wrap(bench: Bench) -> str:
    """An output behind the first wrap of a 16-bit count of ticks, at tick 65 536."""
    bench.wait_until(1250)
    bench.enable()
    bench.must(Update(only(0, 20, 10)))
    return levels(bench, 1312)


def clip(pattern: str, begin: int) -> str:
    return "." * begin + pattern[begin:]


def silent_pulse(bench: Bench) -> str:
    bench.enable()
    ack = bench.must(Update(Pulses(np.full(320, 20), np.zeros(320, int))))
    return levels(bench, ack.commit_period + 1)


def right(transducers: Pulses, shift: int = 0) -> Scenario:
    """Whether all outputs do what they should from a period on that is so many behind the one that was said."""

    def scenario(bench: Bench) -> list[bool]:
        assert bench.sight is not None
        bench.enable()
        bench.must(Update(WEAK))
        period = bench.must(Update(transducers, bench.period() + FAR)).commit_period + shift
        bench.keep_alive((FAR + 10) / 40_000)
        bench.wait_until(period + 3)
        before, words = expected_words(WEAK, bench.wiring), expected_words(transducers, bench.wiring)
        seen = bench.sight.seen(period - 1, period + 2)
        return [
            bool((seen.period(period - 1) == before).all()),
            bool((seen.period(period) == words).all()),
            bool((seen.period(period + 1) == words).all()),
        ]

    return scenario


def scattered() -> Pulses:
    rng = np.random.default_rng(5)
    return Pulses(rng.integers(0, 100, 320), rng.integers(1, 26, 320))


PLAYED = [True, True, True]
LATE = [True, False, True]
EARLY = [False, True, True]
WRONG = [True, False, False]

SEEN: list[Difference] = [
    ("odd-pairs-are-half-a-tick-late", plays(21, 10), high(5, 10), high(6, 10)),
    ("widest-pulse-has-24-ticks", plays(51, 25), high(13, 25), high(13, 24)),
    ("pulse-ends-with-the-period", plays(90, 20), high(35, 20), clip(high(35, 20), 35)),
    ("pulse-ends-in-the-next-period", plays(90, 20, after=0), high(35, 20), clip(high(35, 20), 35)),
    ("pulse-ends-in-the-next-period", plays(90, 20), high(35, 20), high(35, 20)),
    ("phase-99-is-taken-for-0", plays(99, 3), high(48, 3), high(48, 3)),
    ("phase-99-is-taken-for-0", plays(99, 4), high(47, 4), high(48, 4)),
    ("width-0-plays-a-tick", silent_pulse, high(0, 0), high(9, 1)),
    ("phase-is-that-of-the-leading-edge", plays(20, 10), high(5, 10), high(10, 10)),
    ("phase-is-in-whole-ticks", plays(21, 9), high(6, 9), high(5, 9)),
    ("odd-widths-are-one-less", plays(21, 9), high(6, 9), high(6, 8)),
    ("pulses-run-backwards", plays(20, 10), high(5, 10), high(35, 10)),
    ("tick-0-repeats-the-last", plays(10, 10), high(0, 10), high(1, 9)),
    ("place-in-the-period-is-that-of-the-counter", at_the_wrap, high(5, 10), high(41, 10)),
    ("changes-begin-a-period-late", right(scattered()), PLAYED, LATE),
    ("changes-begin-a-period-early", right(scattered()), PLAYED, EARLY),
    ("half-of-the-processors-change-a-period-later", right(scattered()), PLAYED, LATE),
    ("one-board-is-a-tick-late", right(scattered()), PLAYED, [False, False, False]),
    ("changes-begin-within-a-period", right(scattered()), PLAYED, LATE),
    ("two-transducers-are-swapped", right(scattered()), PLAYED, WRONG),
    ("processors-of-a-board-are-swapped", right(scattered()), PLAYED, WRONG),
    ("array-is-mirrored", right(scattered()), PLAYED, WRONG),
    ("one-pair-of-outputs-is-swapped", right(scattered()), PLAYED, WRONG),
    ("pairs-are-unpacked-the-wrong-way-round", right(scattered()), PLAYED, WRONG),
    ("wiring-goes-column-by-column", right(scattered()), PLAYED, WRONG),
    ("one-output-is-inverted", right(scattered()), PLAYED, [False, False, False]),
]


# Time


def wrap_of_ticks(bench: Bench) -> bool:
    before = bench.clock().now
    bench.wait(8.5)
    return bench.clock().now - before >= 17_000_000


def lost_ticks(bench: Bench) -> bool:
    """Whether a change still begins soon behind the tick of its acknowledgement, half a minute after power-up."""
    bench.wait(30)
    bench.enable()
    ack = bench.must(Update(WEAK))
    return ack.commit_period - ack.now_period < 6


def session_tick(bench: Bench) -> bool:
    bench.wait(0.1)
    before = bench.clock().now
    bench.usb.set_configuration()
    return bench.clock().now > before


def far_change(bench: Bench) -> bool:
    bench.enable()
    period = bench.period() + 2**32 - 100
    return bench.must(Update(WEAK, period)).commit_period == period


def late_change(body: Callable[[int], Body]) -> Scenario:
    """Whether a late change says so, counts, and what plays of it."""

    def scenario(bench: Bench) -> tuple[bool, int, bool]:
        bench.enable()
        late = bench.status().late
        bench.must(Update(WEAK))
        ack = bench.must(body(1))
        assert bench.sight is not None
        bench.wait_until(ack.commit_period + 2)
        seen = bench.sight.seen(ack.commit_period, ack.commit_period + 1).words
        return ack.late, bench.status().late - late, bool((seen == expected_words(WEAK, bench.wiring)).all())

    return scenario


def soonest(bench: Bench) -> tuple[bool, int]:
    bench.enable()
    late = bench.status().late
    return bench.must(Update(WEAK)).late, bench.status().late - late


def fifth_period(bench: Bench) -> bool:
    bench.enable()
    ack = bench.must(Update(WEAK, bench.period() + 6))
    assert ack.now_period >= ack.commit_period - 9
    return ack.late


def two_changes(second: int) -> Scenario:
    """Whether the second of two changes is late, which names so many periods more than the first."""

    def scenario(bench: Bench) -> bool:
        bench.enable()
        period = bench.must(Update(WEAK, bench.period() + 100)).commit_period
        return bench.must(Update(SHIFTED, period + second)).late

    return scenario


def steps_together(bench: Bench) -> bool:
    """Whether all processors begin a sequence in the period that was said."""
    assert bench.sight is not None
    bench.enable()
    bench.must(Slot(1, WEAK))
    bench.must(Entries((Entry(1, 50),)))
    period = bench.must(Sequence(0, 1)).commit_period
    bench.wait_until(period + 1)
    return bool((bench.sight.seen(period, period + 1).words == expected_words(WEAK, bench.wiring)).all())


def to_shifted(period: int) -> Body:
    return Update(SHIFTED, period)


def to_silence(period: int) -> Body:
    return Output(Action.SILENCE, period)


TIMED: list[Difference] = [
    ("wraps-of-the-counter-are-counted-in-a-byte", wrap_of_ticks, True, False),
    ("ticks-are-lost-at-sync-pulses", lost_ticks, True, False),
    ("ticks-begin-anew-with-a-session", session_tick, True, False),
    ("periods-are-compared-in-32-bits", far_change, True, False),
    (
        "late-changes-are-dropped",
        late_change(to_shifted),
        (True, 1, False),
        (True, 1, True),
    ),
    ("late-is-not-said", late_change(to_shifted), (True, 1, False), (False, 1, False)),
    ("late-is-not-counted", late_change(to_shifted), (True, 1, False), (True, 0, False)),
    ("late-is-said-of-updates-alone", late_change(to_silence), (True, 1, False), (False, 1, False)),
    ("as-soon-as-possible-is-late", soonest, (False, 0), (True, 1)),
    ("fifth-period-is-not-met", fifth_period, False, True),
    ("change-for-an-earlier-period-overtakes", two_changes(-20), True, False),
    ("change-for-the-same-period-takes-the-place-of-the-other", two_changes(0), True, False),
    ("one-board-runs-programs-a-period-later", steps_together, True, False),
]

# Flow


def room_of_the_queue(bench: Bench) -> tuple[int, int]:
    """How many changes are taken at once, and the free places behind the last."""
    bench.enable()
    period = bench.period() + 2000
    blocks = [pack(bench.numbered(Update(WEAK, period + number))) for number in range(40)]
    taken = sum(bench.line.send_blocks(block, 0.0002) for block in blocks) // 512
    acks = bench.line.receive_records(0.001)
    return taken, acks[-32 + 25]


def first_of_too_many(bench: Bench) -> bool:
    """Whether the first of many changes plays, and the last is held back until there is room."""
    assert bench.sight is not None
    bench.enable()
    period = bench.period() + 200
    acks = bench.send_all([Update(only(0, 20, 10), period), *(Update(WEAK, period + n) for n in range(1, 33))])
    bench.keep_alive(0.01)
    bench.wait_until(period + 40)
    begins = bench.sight.seen(period, period + 1).words.any()
    return bool(begins) and acks[-1].now_period >= period - 5


def no_op_at_a_full_queue(bench: Bench) -> int:
    bench.enable()
    period = bench.period() + 300
    bench.send_all([Update(WEAK, period + number) for number in range(32)])
    return bench.line.send_blocks(pack(bench.numbered(NoOp())), 0.0005)


def no_op_over_frames_at_a_full_queue(bench: Bench) -> int:
    bench.enable()
    bench.serial.enter_frames()
    period = bench.period() + 2000
    bench.send_all([Update(WEAK, period + number) for number in range(32)])
    bench.serial.send_blocks(pack(bench.numbered(NoOp())), 0.0005)
    return len(bench.serial.receive_records(0.001))


def free_of(body: Body) -> Scenario:
    def scenario(bench: Bench) -> int:
        return bench.must(body).free

    return scenario


def free_behind_disable(bench: Bench) -> int:
    bench.enable()
    bench.must(Update(WEAK, bench.period() + 4000))
    bench.disable()
    return bench.status().free


def close_update(apart: int, *, enable: bool = False) -> Scenario:
    def scenario(bench: Bench) -> Reason:
        bench.enable()
        period = bench.must(Update(WEAK, bench.period() + 50)).commit_period
        if enable:
            bench.disable()
            bench.enable()
        return bench.send(Update(WEAK, period + apart)).reason

    return scenario


def waiting_records(count: int) -> Scenario:
    """How many acknowledgements come of so many blocks that are sent before any is read."""

    def scenario(bench: Bench) -> int:
        taken = bench.line.send_blocks(b"".join(pack(bench.numbered(NoOp())) for _ in range(count)), 0.01) // 512
        found = b"".join(bench.line.receive_records(0.001) for _ in range(4))
        assert len(found) // 32 <= taken
        return taken - len(found) // 32

    return scenario


def free_behind_many(bench: Bench) -> int:
    bench.enable()
    for _ in range(25):
        bench.send_all([Update(WEAK)] * 8)
    bench.wait_periods(100)
    return bench.status().free


def stored_in_a_hurry(bench: Bench) -> bool:
    """Whether a sequence plays what was stored just before it, behind much else."""
    assert bench.sight is not None
    bench.enable()
    bench.must(Slot(1, WEAK))
    bench.must(Slot(2, SHIFTED))
    stores = [Entries((Entry(2, 5),) * 120, 120 * place) for place in range(8)]
    acks = bench.send_all([*stores, Slot(1, SHIFTED), Entries((Entry(1, 20),), 1000), Sequence(1000, 1)])
    period = acks[-1].commit_period
    bench.wait_until(period + 1)
    return bool((bench.sight.seen(period, period + 1).words == expected_words(SHIFTED, bench.wiring)).all())


FLOWS: list[Difference] = [
    ("queue-is-one-smaller-than-info-says", room_of_the_queue, (32, 0), (31, 0)),
    ("full-queue-overwrites-its-oldest", first_of_too_many, True, False),
    ("full-queue-drops-what-comes", room_of_the_queue, (32, 0), (40, 0)),
    ("blocks-that-need-no-place-pass-a-full-queue", no_op_at_a_full_queue, 0, 512),
    ("blocks-that-need-no-place-pass-a-full-queue", no_op_over_frames_at_a_full_queue, 0, 32),
    ("stores-take-places-in-the-queue", free_of(Slot(1, WEAK)), 32, 31),
    ("clock-and-no-op-need-a-free-place", free_of(NoOp()), 32, 31),
    ("places-come-back-after-the-period-alone", free_behind_disable, 32, 31),
    ("rate-is-never-refused", close_update(1), Reason.RATE, ACCEPTED),
    ("rate-is-refused-across-enable", close_update(1, enable=True), ACCEPTED, Reason.RATE),
    ("rate-is-refused-for-earlier-periods-too", close_update(0), ACCEPTED, Reason.RATE),
    ("records-behind-the-sixteenth-are-dropped", waiting_records(40), 0, 24),
    ("nothing-waits-for-room-for-records", waiting_records(300), 0, 44),
    ("places-leak", free_behind_many, 32, 30),
    ("stores-in-a-hurry-are-lost", stored_in_a_hurry, True, False),
    ("programs-do-not-wait-for-stores", stored_in_a_hurry, True, False),
]


@pytest.mark.parametrize(
    ("name", "scenario", "sound", "broken"), JUDGED + NUMBERED + ACKNOWLEDGED + SEEN + TIMED + FLOWS
)
def test_a_mutant_differs(name: str, scenario: Scenario, sound: Any, broken: Any) -> None:
    check_difference(name, scenario, sound, broken)
