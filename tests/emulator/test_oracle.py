"""Random programs on the emulated device, against an oracle that was written from the specification alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from phasewire import Emulator, Wiring
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.protocol.codes import Action, Flag, Kind, Reason, Request
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests import from_spec as spec
from tests.emulator.passing import now, pass_until
from tests.referee import PERIOD, TICK, Referee
from tests.tick_oracle import Pulses, Words, pulses_in

LINKS = [FIVE_WIRE, TWO_WIRE]
BOTH_LINKS = pytest.mark.parametrize("link", LINKS, ids=lambda link: link.name)
SCRAMBLED = Wiring(np.random.default_rng(1810).permutation(320))
COLLECTING = 12 * 400_000
"""Longer than it takes to hear from every processor (CHN-017)."""


class Bench:
    """A device, a host that does one thing after another at given cycles, and the referee who watches both."""

    def __init__(
        self,
        link: Link = FIVE_WIRE,
        *,
        unfolded: bool = False,
        wiring: Wiring = SCRAMBLED,
        device: Any = None,
        slack_periods: int = 0,
    ) -> None:
        self.link = link
        self.emulator = device or Emulator(wiring, link=link, unfolded=unfolded)
        self.emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
        info = spec.read_info(self.ask(Request.INFO))
        answer = self.ask(Request.WIRING)
        channels = [spec.number(answer, place, 2) for place in range(0, 640, 2)]
        self.referee = Referee(info, channels, slack_periods)
        self.bus = EmulatorBackend([self.emulator])
        self.handle = self.bus.open_device(next(iter(self.bus.enumerate_devices())))
        self.heard: list[object] = []
        """Everything that came back, in order."""
        self.number = 0
        self.kinds: dict[int, Kind] = {}
        """Of the blocks that were sent last under each number."""

    @property
    def cycle(self) -> int:
        """Core cycles since period 0."""
        return now(self.emulator)

    @property
    def period(self) -> int:
        return self.cycle // PERIOD

    def wait(self, cycles: int) -> None:
        """Let core cycles pass."""
        self.until(self.cycle + cycles)

    def until(self, cycle: int) -> None:
        """Let time pass until a core cycle."""
        pass_until(self.emulator, cycle)
        self.referee.poll(self.cycle, self.records())

    def records(self) -> list[bytes]:
        """The records that wait on the bulk endpoint."""
        data = b""
        while isinstance(packet := self.emulator.usb.bulk_in(0x81), bytes):
            data += packet
        found = []
        while data:
            size = 64 if data[:2] == b"PS" else 32
            found.append(data[:size])
            data = data[size:]
        self.heard += found
        return found

    def ask(self, request: Request) -> bytes:
        answer: bytes = self.emulator.usb.control(Setup(0xC1, request, 0, 0, 640))
        return answer

    def order(self, request: Request, value: int = 0) -> bool:
        """Whether a request without data was carried out rather than stalled."""
        try:
            self.emulator.usb.control(Setup(0x41, request, value, 0, 0))
        except Stall:
            return False
        return True

    def enable(self) -> None:
        assert self.order(Request.ENABLE)
        self.referee.enable(self.cycle)

    def disable(self) -> None:
        assert self.order(Request.DISABLE)
        self.referee.disable(self.cycle)

    def status(self) -> spec.Fields:
        record = self.ask(Request.STATUS)
        self.heard.append(record)
        return self.referee.status(self.cycle, record, asked=True)

    def configure(self) -> None:
        """SET_CONFIGURATION, which is the event BUS_RESET (STA-002, USB-003, NUM-004)."""
        self.emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
        self.referee.disable(self.cycle)
        self.referee.last_number = None

    def watchdog(self, ms: int) -> None:
        assert self.order(Request.WATCHDOG, ms)
        self.referee.set_watchdog(self.cycle, ms)

    def limit(self, transducers: int) -> None:
        self.referee.set_limit(self.cycle, transducers, stalled=not self.order(Request.LIMIT, transducers))

    def send(self, kind: Kind, *, ahead: int = 1, **fields: Any) -> spec.Fields | None:
        """Send a block whose number is some ahead of the last; None if the device answers NAK."""
        number = (self.number + ahead) % 2**32
        self.kinds[number] = kind
        ack = self.deliver(spec.build_block({"kind": kind, "sequence": number, **fields}))
        if ack and ack["reason"] != Reason.SEQUENCE:
            self.number = number
        return ack

    def accepted(self, kind: Kind, **fields: Any) -> int:
        """Send a block that has to be accepted; the period at which it takes effect."""
        ack = self.send(kind, **fields)
        assert ack is not None
        assert ack["reason"] == Reason.ACCEPTED
        return int(ack["commit_period"])

    def refused(self, kind: Kind, **fields: Any) -> int:
        """Send a block; the reason of its refusal."""
        ack = self.send(kind, **fields)
        assert ack is not None
        return int(ack["reason"])

    def read_back(self) -> None:
        """Read what plays (REQ-007)."""
        asked = self.period
        answer = spec.read_back(self.ask(Request.PULSES))
        self.referee.poll(self.cycle, self.records())
        assert asked <= answer["read_period"] <= self.period
        if answer["since_period"] != 2**64 - 1:
            assert tuple(answer["pulses"]) == pulses_in(self.referee.changes, answer["read_period"])

    def deliver(self, data: bytes) -> spec.Fields | None:
        """Send the bytes of a block."""
        may, must = self.referee.may_wait(self.cycle)
        handshake = self.emulator.usb.bulk_out(0x01, data)
        self.heard.append(handshake)
        assert (handshake is Handshake.NAK) in (may, must), f"{handshake} at {self.cycle}"
        if handshake is Handshake.NAK:
            return None
        (record,) = self.records()
        return self.referee.block(self.cycle, data, record)

    def finish(self, first: int) -> Words:
        """Let all that was accepted take effect, and compare the bits of the ports with the referee's."""
        last = max([self.cycle, *(change.period * PERIOD for change in self.referee.changes)])
        self.until(last + 20 * PERIOD)
        end = self.period
        if self.referee.watchdog > 2 * COLLECTING:
            self.wait(COLLECTING)
        self.status()
        capture = self.emulator.capture()
        self.referee.check_bits(capture.bits, first, end)
        bits: Words = capture.bits(first * 50, end * 50)
        return bits


@pytest.fixture(
    params=itertools.product(LINKS, (False, True)), ids=["5wire", "5wire-unfolded", "2wire", "2wire-unfolded"]
)
def bench(request: pytest.FixtureRequest) -> Bench:
    """Each kind of links, folded and unfolded, with a watchdog that is long enough for any program."""
    link, unfolded = request.param
    bench = Bench(link, unfolded=unfolded)
    bench.watchdog(1000)
    return bench


def pulses(seed: int, most: int = 25) -> Pulses:
    """Any pulses."""
    rng = np.random.default_rng(seed)
    phases, widths = rng.integers(0, 100, 320), rng.integers(0, most + 1, 320)
    return tuple(zip(phases.tolist(), widths.tolist(), strict=True))


# Programs


class Step(NamedTuple):
    """Something that the host does some cycles after what it did before."""

    wait: int
    what: str
    value: dict[str, int | tuple[Any, ...]]


SEEDS = st.integers(0, 5)
PLACES = st.integers(0, 3)
COUNTS = st.integers(1, 4)
# None names no period; others are counted from the one in which the block arrives
AHEAD = st.sampled_from([None, None, None, *range(-1, 13), 30, 2**32 + 1])
WAITS = st.sampled_from([0, 1, 2, 2, 4, 12]).flatmap(lambda periods: st.integers(0, periods * PERIOD))
HOW = {
    "jump": st.sampled_from([1] * 30 + [0, 2, 5, -1, 2**31 - 1, 2**31]),
    "restart": st.sampled_from([0] * 12 + [1]),
}


def step(what: str, **value: st.SearchStrategy[Any]) -> st.SearchStrategy[Step]:
    return st.builds(Step, WAITS, st.just(what), st.fixed_dictionaries(value))


def some(items: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.lists(items, min_size=1, max_size=4)


UPDATES = step("update", seed=SEEDS, ahead=AHEAD, **HOW)
STORES = st.one_of(
    step("slot", first=PLACES, seed=SEEDS, **HOW),
    step(
        "entries", first=PLACES, entries=st.lists(st.tuples(PLACES, st.integers(1, 5)), min_size=1, max_size=4), **HOW
    ),
    step("samples", first=PLACES, samples=st.lists(st.integers(0, 255), min_size=1, max_size=4), **HOW),
)
SEQUENCES = step(
    "sequence", first=PLACES, count=COUNTS, repeats=st.integers(0, 3), unattended=st.integers(0, 1), ahead=AHEAD
)
MODULATIONS = step("modulation", first=PLACES, count=COUNTS, hold=st.integers(1, 4), ahead=AHEAD)
OUTPUTS = step("output", action=st.sampled_from([1, 1, 1, 2, 2, 3]), ahead=AHEAD)
SIGNS = st.one_of(step("no_op", **HOW), step("clock", **HOW), step("status"), step("damaged"))
SWITCHES = st.one_of(step("disable"), step("configure"), step("limit", transducers=st.sampled_from([140, 160, 320])))
ENABLES = step("enable")
# A list of strategies, because an alternative that stands in it twice is no more likely
KINDS = [*[UPDATES] * 6, STORES, STORES, *[SEQUENCES] * 4, MODULATIONS, MODULATIONS, OUTPUTS, SIGNS, SWITCHES, ENABLES]
STEPS = st.sampled_from(KINDS).flatmap(lambda kind: kind)
PROGRAMS = st.lists(STEPS, min_size=10, max_size=60)
FILLED = [
    *(Step(0, "slot", {"first": place, "seed": place}) for place in range(4)),
    Step(0, "entries", {"first": 0, "entries": ((0, 1), (1, 3), (2, 1), (3, 2), (1, 4), (0, 2), (2, 1))}),
    Step(0, "samples", {"first": 0, "samples": (0, 255, 128, 31, 200, 77, 254)}),
]
"""Slots, entries and samples that a program may play."""


CROWDS = st.sampled_from([0, 0, QUEUE_BLOCKS - 8, QUEUE_BLOCKS - 2]).map(
    lambda count: [Step(0, "update", {"seed": n % 6, "ahead": 12 + 2 * n}) for n in range(count)]
)
"""Updates that wait in the queue when a program begins, and may leave little room."""


FIELDS = ("first", "count", "hold", "repeats", "action", "entries", "samples")


def carry_out(bench: Bench, what: str, value: dict[str, Any]) -> None:
    """Carry out one step of the host."""
    fields = {name: value[name] for name in FIELDS if name in value}
    ahead = value.get("ahead")
    period = 0 if ahead is None else max(1, bench.period + ahead)
    flags = Flag.RESTART * value.get("restart", 0) | Flag.UNATTENDED * value.get("unattended", 0)
    jump = value.get("jump", 1)
    if what == "update":
        bench.send(Kind.UPDATE, ahead=jump, pulses=pulses(value["seed"]), period=period, flags=flags)
    elif what == "slot":
        bench.send(Kind.SLOT, ahead=jump, first=fields["first"], pulses=pulses(100 + value["seed"]), flags=flags)
    elif what in ("entries", "samples"):
        fields["count"] = len(value[what])
        bench.send(Kind[what.upper()], ahead=jump, flags=flags, **fields)
    elif what in ("sequence", "modulation", "output"):
        bench.send(Kind[what.upper()], period=period, flags=flags, **fields)
    elif what in ("no_op", "clock"):
        bench.send(Kind[what.upper()], ahead=jump, flags=flags)
    elif what == "damaged":
        bench.deliver(bytes(512))
    else:
        getattr(bench, what)(**value)


def play(bench: Bench, base: int, steps: Sequence[Step]) -> Words:
    """Carry out a program that begins near a period; the bits from there on."""
    bench.watchdog(1000)
    bench.until(base * PERIOD)
    bench.enable()
    for wait, what, value in steps:
        bench.wait(wait)
        carry_out(bench, what, value)
    return bench.finish(base)


# 65 536 ticks are 1310.72 periods; the sync line pulses every 4096
BASES = st.sampled_from([3, 1300, 2610, 4080])
"""Periods near the beginning, near wraps of the port counter, and near a pulse of the sync line."""


def compare(link: Link, base: int, steps: Sequence[Step]) -> None:
    """Play a program on the folded and the unfolded device: both keep the clauses, and answer alike with one exception.

    A sequence or a modulation that waits for stores may come a period apart, as questions take the place of
    loads here and there (see `chain`). From there on the two are different programs.
    """
    folded, unfolded = (Bench(link, unfolded=way) for way in (False, True))
    bits = [play(bench, base, steps) for bench in (folded, unfolded)]
    apart = next((pair for pair in zip(folded.heard, unfolded.heard, strict=False) if pair[0] != pair[1]), None)
    if apart is None:
        assert unfolded.heard == folded.heard
        assert np.array_equal(bits[0], bits[1])
    else:
        one, other = (spec.read_ack(record) for record in apart if isinstance(record, bytes))
        assert folded.kinds[one["sequence"]] in (Kind.SEQUENCE, Kind.MODULATION)
        assert abs(one["commit_period"] - other["commit_period"]) == 1
        assert all(one[name] == other[name] for name in ("reason", "sequence", "now"))


@BOTH_LINKS
@settings(max_examples=40)
@given(base=BASES, crowd=CROWDS, steps=PROGRAMS)
def test_random_programs_play_as_the_specification_says(
    link: Link, base: int, crowd: list[Step], steps: list[Step]
) -> None:
    compare(link, base, [*FILLED, *crowd, *steps])


DROPPED = [
    Step(7350, "output", {"action": 1, "ahead": 4}),
    Step(1064, "update", {"seed": 0, "ahead": 5}),
    Step(5736, "update", {"seed": 3, "ahead": 4}),
    Step(132, "update", {"seed": 2, "ahead": 7}),
    Step(38, "entries", {"first": 3, "entries": ((0, 1), (1, 2))}),
    Step(6527, "disable", {}),
    Step(146, "enable", {}),
    Step(939, "sequence", {"first": 3, "count": 2, "repeats": 2, "unattended": 0, "ahead": 2}),
]
"""Loads wait behind updates that leave no room between them, and are dropped; a sequence counts on the loads."""


@example(steps=DROPPED)
@settings(max_examples=10)
@given(steps=st.lists(st.one_of(UPDATES, STORES, SEQUENCES, SWITCHES, ENABLES), min_size=5, max_size=20))
def test_a_dropped_change_delays_nothing(steps: list[Step]) -> None:
    """DISABLE comes while stores, updates and programs wait for each other."""
    compare(TWO_WIRE, 3, [*FILLED, *steps])


# Silence


def busy(bench: Bench, seed: int) -> None:
    """Keep the chain busy for some dozen periods, then disable the outputs at any moment."""
    rng = np.random.default_rng(seed)
    bench.watchdog(1000)
    bench.until(3 * PERIOD)
    bench.enable()
    for what, value in [step[1:] for step in FILLED]:
        carry_out(bench, what, value)
    bench.wait(30 * PERIOD)
    if rng.random() < 0.5:
        bench.send(Kind.MODULATION, first=0, count=7, hold=1, period=bench.period + int(rng.integers(0, 8)))
    if rng.random() < 0.5:
        bench.send(Kind.SEQUENCE, first=0, count=7, period=bench.period + int(rng.integers(0, 12)))
    for number in range(int(rng.integers(1, 25))):
        bench.wait(int(rng.integers(0, 2 * bench.referee.turn * PERIOD)))
        period = bench.period + int(rng.integers(1, 9)) if rng.random() < 0.5 else 0
        bench.send(Kind.UPDATE, pulses=pulses(number % 4), period=period)
        if rng.random() < 0.4:
            bench.send(Kind.SLOT, first=int(rng.integers(8, 200)), pulses=pulses(9))
    bench.wait(int(rng.integers(0, 4 * PERIOD)))
    bench.disable()


@BOTH_LINKS
@pytest.mark.parametrize("seed", range(20))
def test_disable_silences_within_six_periods_whatever_is_on_the_chain(link: Link, seed: int) -> None:
    """Clause SAF-004; and the next update is in time as ever."""
    seen = []
    for unfolded in (False, True):
        bench = Bench(link, unfolded=unfolded)
        busy(bench, seed)
        bench.wait(seed * 1777)
        bench.enable()
        bench.send(Kind.UPDATE, pulses=pulses(5))
        seen.append((bench.finish(3).tobytes(), bench.heard))
    assert seen[0] == seen[1]


def test_a_planned_end_leaves_the_chain_free(bench: Bench) -> None:
    bench.until(3 * PERIOD)
    bench.enable()
    bench.send(Kind.UPDATE, pulses=pulses(1))
    bench.send(Kind.OUTPUT, action=Action.DISABLE, period=20)
    bench.send(Kind.UPDATE, pulses=pulses(2), period=21)  # dropped
    bench.until(20 * PERIOD + 500)
    bench.enable()
    # 200 500 + 6000 + 5440 + 400 + 4400 = 216 740
    assert bench.accepted(Kind.UPDATE, pulses=pulses(3)) == (22 if bench.link is FIVE_WIRE else 23)
    bench.finish(3)


# The queue and the stores


def test_a_full_queue_answers_nak_until_a_change_goes_onto_the_chain(bench: Bench) -> None:
    bench.until(3 * PERIOD)
    bench.enable()
    periods = range(100, 100 + 2 * bench.referee.capacity, 2)
    assert [bench.accepted(Kind.UPDATE, pulses=pulses(1), period=period) for period in periods] == list(periods)
    assert bench.send(Kind.NO_OP) is None
    bench.until(96 * PERIOD)
    assert bench.send(Kind.NO_OP) is None
    bench.until(99 * PERIOD)
    assert bench.send(Kind.NO_OP) is not None
    bench.finish(3)


@pytest.mark.parametrize("modulated", [False, True])
@pytest.mark.parametrize("phase", [0, 2500, 5000, 9000])
def test_stores_beside_a_stream_delay_no_update(bench: Bench, modulated: bool, phase: int) -> None:
    """A slot every two or four periods, as BUD-007 says, beside updates at the rate that holds (CHN-019)."""
    bench.until(3 * PERIOD)
    bench.enable()
    bench.send(Kind.SAMPLES, first=0, count=3, samples=(200, 13, 255))
    bench.wait(30 * PERIOD)
    if modulated:
        bench.send(Kind.MODULATION, first=0, count=3, hold=1)
    bench.wait(10 * PERIOD + phase)
    apart = bench.referee.turn
    for number in range(60):
        bench.wait(apart * PERIOD)
        assert bench.accepted(Kind.UPDATE, pulses=pulses(number % 4), period=bench.period + 5) == bench.period + 5
        if number % 2:
            bench.accepted(Kind.SLOT, first=number, pulses=pulses(9))
    bench.finish(3)


def test_updates_for_as_soon_as_possible_keep_the_rate(bench: Bench) -> None:
    """The host offers one every 500 cycles; there is one in each period, or three in four of those of two wires."""
    bench.until(3 * PERIOD)
    bench.enable()
    commits: list[int] = []
    while len(commits) < 60:
        bench.wait(500)
        if (ack := bench.send(Kind.UPDATE, pulses=pulses(len(commits) % 4))) is not None:
            commits.append(ack["commit_period"])
    assert commits[-1] - commits[0] <= 59 * bench.referee.turn
    bench.finish(3)


def test_read_back_does_not_delay_a_load_that_a_sequence_needs(bench: Bench) -> None:
    bench.until(3 * PERIOD)
    bench.enable()
    for slot in range(15):
        bench.accepted(Kind.SLOT, first=slot, pulses=pulses(slot))
    bench.until(63 * PERIOD)
    bench.accepted(Kind.ENTRIES, first=0, count=15, entries=tuple((14 - place, 1) for place in range(15)))
    for slot in range(14):
        bench.accepted(Kind.SLOT, first=slot, pulses=pulses(slot + 40))
    bench.accepted(Kind.SEQUENCE, first=0, count=15)
    for _ in range(15):
        bench.read_back()
    bench.wait(20 * PERIOD)
    for _ in range(5):
        bench.read_back()
    bench.finish(3)


# Watchdog


@BOTH_LINKS
@pytest.mark.parametrize("sign", ["no_op", "clock", "status", "enable"])
@pytest.mark.parametrize("moment", [0, 1, 199, 9999])
def test_the_watchdog_fires_within_a_period_of_its_time(link: Link, sign: str, moment: int) -> None:
    """Clause SAF-003: the status record that it sends says when it fired, and the referee judges that."""
    bench = Bench(link)
    bench.until(3 * PERIOD)
    bench.enable()
    bench.watchdog(10)
    bench.send(Kind.UPDATE, pulses=pulses(1))
    bench.wait(123_000 + moment)
    carry_out(bench, sign, {})
    bench.wait(2 * PERIOD)
    bench.deliver(bytes(512))  # a refused block is no sign of life
    bench.wait(10 * 400_000 - 2 * PERIOD - 1)
    assert not bench.referee.fired
    bench.wait(1 + PERIOD)
    assert bench.referee.fired
    bench.finish(3)


@pytest.mark.parametrize("repeats", [0, 2])
def test_the_watchdog_rests_while_a_sequence_plays_unattended(bench: Bench, repeats: int) -> None:
    """It restarts at the end of the sequence, or at the update that ends it (clauses SAF-005 and STA-003)."""
    bench.watchdog(10)
    bench.until(3 * PERIOD)
    bench.enable()
    bench.accepted(Kind.SLOT, first=0, pulses=pulses(1))
    bench.accepted(Kind.ENTRIES, first=0, count=1, entries=((0, 500),))
    begins = bench.accepted(Kind.SEQUENCE, first=0, count=1, repeats=repeats, flags=Flag.UNATTENDED)
    ends = begins + 500 * repeats
    if not repeats:
        bench.wait(1000 * PERIOD)
        ends = bench.accepted(Kind.UPDATE, pulses=pulses(2), period=bench.period + 700)
    bench.until((ends + 400) * PERIOD - 1)
    assert not bench.referee.fired
    bench.wait(1 + PERIOD)
    assert bench.referee.fired
    bench.finish(3)


# Streams


def judge_stream(bench: Bench, blocks: Sequence[bytes]) -> None:
    """Send blocks in one transfer. An acknowledgement has the tick of a block's arrival, not the cycle."""
    first = last = bench.cycle
    assert bench.bus.bulk_write(bench.handle, 0x01, 0, b"".join(blocks), 10_000) == 512 * len(blocks)
    records = bench.records()
    acks = [record for record in records if record[:2] == b"PA"]
    for block, record in zip(blocks, acks, strict=True):
        tick = spec.read_ack(record)["now"]
        first, last = first + 3846, last + 3846  # as fast as USB carries them, unless the queue is full
        waited = bench.referee.may_wait(first)[0]
        assert waited or tick <= last // TICK
        first = max(first, tick * TICK)
        last = tick * TICK + TICK - 1 if waited else min(last, tick * TICK + TICK - 1)
        bench.referee.block(first, block, record, last - first)


@BOTH_LINKS
@settings(max_examples=15)
@given(data=st.data())
def test_streams_are_judged_like_blocks_that_come_one_by_one(link: Link, data: st.DataObject) -> None:
    transfers = data.draw(
        st.lists(st.tuples(st.integers(0, 40 * PERIOD), st.sampled_from([0, 1, 2]), st.integers(1, 60)), max_size=3)
    )
    modulated = data.draw(st.booleans())
    seen = []
    for unfolded in (False, True):
        bench = Bench(link, unfolded=unfolded)
        bench.watchdog(1000)
        bench.until(1290 * PERIOD)
        bench.enable()
        bench.send(Kind.SAMPLES, first=0, count=3, samples=(200, 13, 255))
        bench.wait(10 * PERIOD)
        if modulated:
            bench.send(Kind.MODULATION, first=0, count=3, hold=2)
        for wait, apart, count in transfers:
            bench.wait(wait)
            begins = bench.period + 6 if apart else 0
            blocks = []
            for number in range(count):
                bench.number += 1
                update = {"sequence": bench.number, "period": begins + number * apart, "pulses": pulses(number % 5)}
                blocks.append(spec.build_block({"kind": Kind.UPDATE, **update}))
            judge_stream(bench, blocks)
        seen.append((bench.finish(1290).tobytes(), bench.heard))
    assert seen[0] == seen[1]


# The oracle itself


def test_no_modulated_width_is_close_to_a_tie() -> None:
    """Clause PUL-006; so the oracle's double precision cannot round one the wrong way."""
    for width, sample in itertools.product(range(26), range(256)):
        ticks = 50 / math.pi * math.asin(sample / 255 * math.sin(math.pi * width / 50))
        assert abs(ticks % 1 - 0.5) > 9e-5
