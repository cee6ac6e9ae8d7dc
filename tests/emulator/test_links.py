"""Tokens on the links, against sums by hand and a simulation that moves each token, place and credit."""

from __future__ import annotations

import heapq
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.boards.links import Links, LinkSpan, Passage
from phasewire.emulator.boards.switches import Direction
from phasewire.protocol.board import CORE_HZ
from phasewire.protocol.timing import FIVE_WIRE, LINKS, Link

from tests.specification import table

SLICE, COMMIT, COLLECT = 52, 16, 9
BUFFER = 8


Make = Callable[[Link], Links]


def chain(link: Link = FIVE_WIRE) -> Links:
    return Links([link] * 10)


def slow(cycles: int) -> Link:
    """A link that takes so many cycles for a token."""
    return Link("slow", wires=5, symbols_per_token=4, token_delay=cycles - 8)


def followed(link: Link = FIVE_WIRE) -> Links:
    """The same chain as `chain`, its tokens followed one by one."""
    links = chain(link)
    links.set_link(0, link)
    return links


# Clauses BUD-002, CHN-006 and BUD-003


@pytest.fixture
def links() -> Links:
    return chain()


@pytest.mark.parametrize("make", [chain, followed])
@pytest.mark.parametrize(("name", "column"), [("5wire", 2), ("2wire", 3)])
def test_messages_hold_a_link_and_arrive_as_the_specification_says(make: Make, name: str, column: int) -> None:
    for row in table("table: message times"):
        cycles = int(Fraction(row[column].removesuffix(" µs")) * CORE_HZ / 1_000_000)
        for processor in range(10):
            links = make(LINKS[name])
            passage = links.down(processor, int(row[0]), 1000)
            assert passage == (processor, 1000, 1000 + cycles, 1000 + cycles + (processor + 1) * 40)
            assert links.up(processor, int(row[0]), 1000) == passage
            for direction in (Direction.DOWN, Direction.UP):
                for span in links.spans(direction):
                    assert span.begins is not None
                    assert span.ends is not None
                    assert span.ends - span.begins == cycles
            assert links.free_at() == 1000 + cycles


@given(
    before=st.lists(st.tuples(st.integers(0, 9), st.integers(1, 70), st.integers(0, 3000)), max_size=4),
    train=st.lists(st.tuples(st.integers(0, 9), st.integers(1, 70)), min_size=1, max_size=20),
    after=st.lists(st.tuples(st.integers(0, 9), st.integers(1, 70), st.integers(0, 9000)), max_size=4),
    at=st.integers(0, 4000),
)
def test_a_train_goes_as_its_messages_would(
    before: list[tuple[int, int, int]], train: list[tuple[int, int]], after: list[tuple[int, int, int]], at: int
) -> None:
    together, apart = chain(), chain()
    for links in (together, apart):
        for message in before:
            links.down(*message)
    arrives = together.train([place for place, _ in train], [tokens for _, tokens in train], at)
    if arrives is None:
        return
    assert arrives == [apart.down(place, tokens, at).arrives for place, tokens in train]
    assert [together.down(*message) for message in after] == [apart.down(*message) for message in after]


def test_a_train_is_not_for_links_whose_tokens_are_followed() -> None:
    assert followed().train([0, 1], [SLICE, SLICE], 0) is None
    opened = chain()
    opened.down(3, SLICE, 0, ends=False)
    assert opened.train([0], [SLICE], 9000) is None


# Places and credits


def test_credits_that_are_slow_to_return_halve_the_rate() -> None:
    """Eight tokens go in 64 cycles; the place of the first is left at 48, and its credit there at 128."""
    links = Links([FIVE_WIRE] * 10, credit_cycles=80)
    assert links.down(0, 16, 0).leaves == 128 + 64


def test_a_slower_switch_slows_the_links() -> None:
    """At 49 the ninth token, and every eighth after it, waits a cycle: 52 tokens wait six times."""
    assert Links([FIVE_WIRE] * 10, 49).down(0, SLICE, 0) == (0, 0, 416 + 6, 416 + 6 + 49)


# What holds everything up


def test_the_room_before_a_blocked_processor() -> None:
    """The switch takes 3 tokens off, the channel end holds 8, and so does the buffer before it: 19 leave, no more."""
    for tokens in (19, 20):
        links = chain()
        links.block(0)
        leaves = tokens * 8 if tokens == 19 else None
        assert links.down(0, tokens, 0) == (0, 0, leaves, None)
        assert links.free_at() == leaves


# Routes without END


def test_a_message_that_enters_an_open_route_keeps_its_header(links: Links) -> None:
    """Of 8 places the first message takes 5 and the second the other 3: its fourth token has no room."""
    links.block(0)
    links.down(0, 3 + 5, 0, ends=False)
    assert links.down(1, 3 + BUFFER, 0) == (0, 64, 64 + 88, None)
    assert links.down(1, 1, 0) == (1, None, None, None)


def test_an_open_route_to_the_controller_belongs_to_its_sender(links: Links) -> None:
    links.up(3, COLLECT - 1, 0, ends=False)
    assert links.up(5, COLLECT, 0) == (5, None, None, None)
    assert links.up(3, COLLECT, 0) == (3, 64, 136, 136 + 160)
    assert links.up(5, COLLECT, 1000) == (5, 1000, 1072, 1072 + 240)


# Wrong arguments


def test_wrong_arguments_are_refused_by_name(links: Links) -> None:
    with pytest.raises(ValueError, match="as many links, not 9"):
        Links([FIVE_WIRE] * 9)
    with pytest.raises(ValueError, match="hop_cycles -1 is negative"):
        Links([FIVE_WIRE] * 10, -1)
    with pytest.raises(ValueError, match="credit_cycles -1 is negative"):
        Links([FIVE_WIRE] * 10, credit_cycles=-1)
    with pytest.raises(ValueError, match="processor 10 must be a whole number"):
        links.down(10, 1, 0)
    with pytest.raises(ValueError, match="tokens 0 must be a whole number"):
        links.up(0, 0, 0)
    with pytest.raises(ValueError, match="at -1 must be a whole number"):
        links.up(0, 1, -1)
    with pytest.raises(ValueError, match="link 10 must be a whole number"):
        links.set_link(10, FIVE_WIRE)
    with pytest.raises(ValueError, match="link -1 must be a whole number"):
        links.cut(-1)
    with pytest.raises(ValueError, match="processor -1 must be a whole number"):
        links.block(-1)


def test_no_slow_import_without_congestion() -> None:
    code = (
        "import sys; from phasewire.emulator.boards.links import Links;"
        "from phasewire.protocol.timing import FIVE_WIRE;"
        "Links([FIVE_WIRE] * 10).down(9, 52, 0); print('numba' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout.strip() == "False"


# The simulation. Switches, buffers and credits are moved one token at a time, in the order of time; it does not use
# recurrences. An input is a buffer behind a link or a sender, an output is a link or a channel end.


@dataclass(frozen=True)
class Sent:
    """A message, and the chain as it was when it was handed over."""

    processor: int
    tokens: int
    at: int
    ends: bool
    reached: bool
    cycles: tuple[int, ...]
    cut: frozenset[int]
    blocked: frozenset[int]


class Token(NamedTuple):
    number: int  # of its message
    place: int
    began: int  # on the link that it came by; of a sender's: when it may leave
    ended: int


@dataclass
class Input:
    link: int | None
    tokens: deque[Token] = field(default_factory=deque)
    output: Output | None = None
    clear: int = 0


@dataclass
class Output:
    link: int | None
    credits: list[int] = field(default_factory=lambda: [0] * BUFFER)  # when each may be used
    free: int = 0
    turns: deque[int] | None = None
    header: int = 0
    holder: Input | None = None


class Simulation:
    def __init__(self, sent: list[Sent], upward: bool, hop: int, credit: int) -> None:
        self.sent, self.upward, self.hop, self.credit = sent, upward, hop, credit
        self.buffers = [Input(link) for link in range(10)]
        self.links = [Output(link) for link in range(10)]
        self.channel_ends = [Output(None) for _ in range(10)]
        self.senders = [Input(None) for _ in range(10 if upward else 1)]
        for number, message in enumerate(sent):
            queue = self.senders[message.processor if upward else 0].tokens
            queue += [Token(number, index, message.at - hop, message.at - hop) for index in range(message.tokens)]
        if upward:  # messages take turns in the order in which they were handed over, but for those lost before
            for index, link in enumerate(self.links):
                link.turns = deque(
                    number
                    for number, message in enumerate(sent)
                    if message.processor >= index
                    and message.cut.isdisjoint(range(index + 1, message.processor + 1))
                    and (number == 0 or sent[number - 1].ends)
                )
        self.begins: dict[tuple[int, int | None], int] = {}
        self.ends: dict[tuple[int, int | None], int] = {}
        self.taken: dict[int, int] = {}
        self.times = [message.at for message in sent]
        heapq.heapify(self.times)
        while self.times:
            now = heapq.heappop(self.times)
            while self.times and self.times[0] == now:
                heapq.heappop(self.times)
            while sum(self.move(source, now) for source in (*self.senders, *self.buffers)):
                pass

    def wanted(self, source: Input, message: Sent) -> Output | None:
        """The processor to which a header leads; None if there is none."""
        if self.upward:
            here = message.processor + 1 if source.link is None else source.link
            return self.links[here - 1] if here else self.channel_ends[0]
        here = -1 if source.link is None else source.link
        if here != message.processor:
            return self.links[here + 1]
        return self.channel_ends[here] if message.reached else None

    def move(self, source: Input, now: int) -> bool:
        """Let the first token of an input begin to pass, if it can."""
        if not source.tokens:
            return False
        token = source.tokens[0]
        message = self.sent[token.number]
        output = source.output
        if output is None:
            output = self.wanted(source, message)
            if (
                output is None
                or output.holder is not None
                or (output.turns is not None and output.turns[0] != token.number)
            ):
                return False
        # Its first symbol may go on one delay after it came, and its last too.
        cycles = token.ended - token.began if output.link is None else message.cycles[output.link]
        ready = max(token.began + self.hop, token.ended + self.hop - cycles, source.clear, output.free)
        opens_end = output.link is None and source.output is None
        needs_place = not (opens_end or output.header)
        if needs_place:
            if not output.credits:
                return False
            ready = max(ready, output.credits[0])
        if ready > now:
            heapq.heappush(self.times, ready)
            return False
        if source.output is None:
            source.output, output.holder = output, source
            output.header = 3 if output.link is None else 0
            if output.turns is not None:
                output.turns.popleft()
        self.pass_on(source.tokens.popleft(), source, output, now, now + cycles)
        return True

    def pass_on(self, token: Token, source: Input, output: Output, now: int, end: int) -> None:
        message = self.sent[token.number]
        is_last = token.place == message.tokens - 1
        source.clear = output.free = end
        if source.link is not None:
            self.links[source.link].credits.append(end + self.credit)
        if token.place == 0:
            self.begins[token.number, output.link] = now
        if is_last:
            self.ends[token.number, output.link] = end
        if output.link is not None:
            output.credits.pop(0)
            if output.link not in message.cut:
                self.buffers[output.link].tokens.append(Token(token.number, token.place, now, end))
        else:
            receiver = -1 if self.upward else self.channel_ends.index(output)
            takes = receiver not in message.blocked
            if output.header:
                output.header -= 1
            else:
                output.credits.pop(0)
                if takes:
                    output.credits.append(end + self.credit)
            if is_last and takes:
                self.taken[token.number] = end
        if is_last and message.ends:
            source.output = output.holder = None
        for time in (now + self.hop, end, end + self.credit):
            heapq.heappush(self.times, time)

    def passage(self, number: int, processor: int, links: Sequence[int]) -> tuple[Passage, list[LinkSpan]]:
        spans = [LinkSpan(link, self.begins.get((number, link)), self.ends.get((number, link))) for link in links]
        return Passage(processor, spans[0].begins, spans[0].ends, self.taken.get(number)), spans


def way(processor: int, upward: bool) -> list[int]:
    return list(range(processor, -1, -1)) if upward else list(range(processor + 1))


PLACES_IN_CHAIN = st.integers(0, 9)
CYCLES = st.integers(8, 30) | st.sampled_from([8, 100])
DELAYS = st.integers(0, 24) | st.integers(0, 120)


@st.composite
def messages(draw: st.DrawFn, upward: bool) -> tuple[list[Sent], list[int]]:
    """Messages, some without END, between faults at any time; and the processor that gets or sends each."""
    alike = draw(st.booleans())
    cycles = [draw(CYCLES)] * 10 if alike else draw(st.lists(CYCLES, min_size=10, max_size=10))
    cut: set[int] = set()
    blocked: set[int] = set()
    faults = draw(st.lists(st.sampled_from(["slow", "cut", "block", *[None] * 5]), min_size=1, max_size=6))
    sent, ways = [], []
    at = 0
    opened: int | None = None
    for fault in faults:
        if opened is None or not upward:
            where = draw(PLACES_IN_CHAIN)
            if fault == "slow":
                cycles[where] = draw(CYCLES)
            elif fault == "cut":
                cut.add(where)
            elif fault == "block" and not upward:
                blocked.add(where)
        at += draw(st.integers(0, 30) | st.integers(0, 1500))
        ends = draw(st.integers(0, 5)) > 0
        tokens = draw(st.integers(1 if ends else 3, 26))
        processor = draw(PLACES_IN_CHAIN)
        if upward and opened is not None:
            processor = opened
        ways.append(processor if opened is None else opened)
        opened = None if ends else ways[-1]
        reached = upward or draw(st.integers(0, 9)) > 0
        sent.append(Sent(processor, tokens, at, ends, reached, tuple(cycles), frozenset(cut), frozenset(blocked)))
    return sent, ways


def carried(links: Links, sent: list[Sent], upward: bool) -> Iterator[tuple[Passage, list[LinkSpan]]]:
    """The model's result for each message; faults begin at their times."""
    before = sent[0]
    for message in sent:
        for index, (old, new) in enumerate(zip(before.cycles, message.cycles, strict=True)):
            if old != new:
                links.set_link(index, slow(new))
        for index in message.cut - (before.cut if message is not sent[0] else frozenset()):
            links.cut(index)
        for processor in message.blocked - (before.blocked if message is not sent[0] else frozenset()):
            links.block(processor)
        before = message
        if upward:
            passage = links.up(message.processor, message.tokens, message.at, ends=message.ends)
        else:
            passage = links.down(
                message.processor, message.tokens, message.at, ends=message.ends, reached=message.reached
            )
        yield passage, links.spans(Direction.UP if upward else Direction.DOWN)


def compare(sent: list[Sent], ways: list[int], upward: bool, hop: int, credit: int) -> None:
    simulated = Simulation(sent, upward, hop, credit)
    expected = [simulated.passage(number, processor, way(processor, upward)) for number, processor in enumerate(ways)]
    links = Links([slow(cycles) for cycles in sent[0].cycles], hop, credit)
    assert list(carried(links, sent, upward)) == expected
    followed = Links([slow(cycles) for cycles in sent[0].cycles], hop, credit)
    followed.set_link(0, slow(sent[0].cycles[0]))
    assert list(carried(followed, sent, upward)) == expected


@given(messages(upward=False), DELAYS, DELAYS)
def test_messages_pass_down_as_token_by_token(made: tuple[list[Sent], list[int]], hop: int, credit: int) -> None:
    compare(*made, upward=False, hop=hop, credit=credit)


@given(messages(upward=True), DELAYS, DELAYS)
def test_messages_pass_up_as_token_by_token(made: tuple[list[Sent], list[int]], hop: int, credit: int) -> None:
    compare(*made, upward=True, hop=hop, credit=credit)
