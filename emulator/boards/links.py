"""When tokens pass the links of the chain: their rate, the buffers behind them, and what waits for room.

A message goes from the controller through links 0 to k to processor k, or from there to the controller over wires of
their own. It takes its way like a worm: its header opens the route switch by switch, its tokens follow as far as there
is room, and END frees each link behind it (SPEC.md, clauses CHN-002, CHN-008, CHN-020 and BUD-002). All times are core
cycles and exact; what a token says, and to whom a header leads, is for others (`switches`) to know.

The rules, which the tests follow token by token:

- A link sends a token in its `cycles_per_token`, one after the other, message after message.
- A switch, and the one that a message ends at too, passes each symbol on `hop_cycles` after it came, or later.
- A token takes one of the 8 places in the buffer behind its link from its first symbol on until its last has left that
  buffer. The sender knows of the free place `credit_cycles` later.
- A buffer gives its tokens in the order in which they came, a message at a time.
- A receiver takes tokens at once, and the last switch takes the three of the header off.

If all links are alike and nothing holds a message up, this comes to what clause BUD-002 says, which is then used as
it stands. From the first message on that is held up, or the first fault, the tokens are followed one by one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import whole
from ...protocol.board import PROCESSORS
from ...protocol.chain import ROUTE
from ...protocol.timing import HOP_CYCLES, Link
from ..scheduler import NEVER
from .switches import Direction

__all__ = ["BUFFER_TOKENS", "CREDIT_CYCLES", "LinkSpan", "Links", "Passage"]

BUFFER_TOKENS = 8  # clause CHN-020
CREDIT_CYCLES = 8  # not published; a token of the fastest link is assumed. Up to 16 these links keep their full rate
LONG_AGO = -NEVER

# Places that tokens pass into. The first ten are the links, each with the buffer behind it.
CHANNEL_ENDS = range(PROCESSORS, 2 * PROCESSORS)
NOWHERE = 2 * PROCESSORS  # nothing passes into it


class Passage(NamedTuple):
    """How a message passes. Core cycles; None: never, as something holds it up for good."""

    processor: int
    """The processor that receives a message on its way down, or sends one on its way up."""
    begins: int | None
    """When its first token begins to leave the sender."""
    leaves: int | None
    """When its last one has left the sender."""
    arrives: int | None
    """When the receiver has taken its last one."""


class LinkSpan(NamedTuple):
    """When a message occupied a link, from its first token to its last. Core cycles; None: never."""

    link: int
    begins: int | None
    ends: int | None


class Links:
    """The ten links of a chain, in both directions.

    Messages are carried in the order of the calls, and what happens to one is settled by its call: a fault afterwards
    concerns later ones only. RESET and power-up empty the chain: they take new ones.

    Parameters
    ----------
    links : sequence of Link
        Set-up of links 0 to 9; link n leads to processor n.
    hop_cycles, credit_cycles : int
        Delay of a switch, and of a credit on its way back, in core cycles.

    Raises
    ------
    ValueError
        If there are not ten links, or a delay is negative.

    Notes
    -----
    On the way up processors share links, and whoever is called first goes first. That is exact as long as its header
    also comes first to the switch at which they meet, as it does when the controller asks one after the other
    (clause CHN-017); a nearer processor that begins while the header of a farther one is on its way is held up here,
    and would go first on hardware.
    """

    def __init__(self, links: Sequence[Link], hop_cycles: int = HOP_CYCLES, credit_cycles: int = CREDIT_CYCLES) -> None:
        if len(links) != PROCESSORS:
            raise ValueError(f"a chain of {PROCESSORS} processors has as many links, not {len(links)}")
        for name, delay in (("hop_cycles", hop_cycles), ("credit_cycles", credit_cycles)):
            if delay < 0:
                raise ValueError(f"{name} {delay} is negative; at least 0")
        numbers = range(PROCESSORS)
        cycles = [link.cycles_per_token for link in links]
        delays = hop_cycles, credit_cycles
        self._down = _Wires([_Way(list(range(n + 1)), CHANNEL_ENDS[n]) for n in numbers], cycles, *delays)
        self._up = _Wires([_Way(list(range(n, -1, -1)), CHANNEL_ENDS[0]) for n in numbers], cycles, *delays)

    def down(self, processor: int, tokens: int, at: int, *, ends: bool = True, reached: bool = True) -> Passage:
        """Carry a message from the controller to a processor; it begins at a cycle or when the first link is free.

        Parameters
        ----------
        processor : int
            The receiver, 0 to 9: see `switches.destination`. While a route is open it leads to another: see `ends`.
        tokens : int
            How many, header and END among them, at least 1. Lost and doubled ones are not or twice among them.
        at : int
            Core cycle.
        ends : bool
            Whether its END is there. Without, the route stays open, and whatever is sent next runs into the same
            channel end, header and all, up to and with its own END.
        reached : bool
            Whether the processor is its destination. If not, its header stays in the switch there, for ever, unless it
            follows an open route.

        Returns
        -------
        Passage
            `processor` is who gets it.

        Raises
        ------
        ValueError
            If an argument is out of range.
        """
        _check(processor, tokens, at)
        opened = self._down.opened
        if opened is not None:
            processor, reached = opened, True
        self._down.opened = None if ends else processor
        return self._down.carry(processor, tokens, at, reached=reached, opens=opened is None)

    def train(self, processors: Sequence[int], tokens: Sequence[int], at: int) -> list[int] | None:
        """Carry messages one right after the other from the controller, as as many calls of `down` would.

        Parameters
        ----------
        processors, tokens : sequence of int
            The arguments of `down` for each message. Each has its END and reaches its processor.
        at : int
            Core cycle.

        Returns
        -------
        list of int or None
            When each has arrived. None if tokens must be followed one by one: nothing was carried then.
        """
        return None if self._down.opened is not None else self._down.carry_train(processors, tokens, at)

    def up(self, processor: int, tokens: int, at: int, *, ends: bool = True) -> Passage:
        """Carry a message from a processor to the controller; it begins at a cycle or when its first link is free.

        Parameters
        ----------
        processor : int
            The sender, 0 to 9.
        tokens, at
            The arguments of `down`.
        ends : bool
            Whether its END is there. Without, the route stays open: the same processor's next message runs into the
            same channel end and may close it. What others send until then is held up, and given up here.

        Raises
        ------
        ValueError
            If an argument is out of range.
        """
        _check(processor, tokens, at)
        opened = self._up.opened
        if opened is not None and opened != processor:
            return Passage(processor, None, None, None)
        self._up.opened = None if ends else processor
        return self._up.carry(processor, tokens, at, reached=True, opens=opened is None)

    def free_at(self) -> int | None:
        """Cycle from which on the controller may begin the next message; None: never."""
        return self._down.free_at

    def spans(self, direction: Direction) -> list[LinkSpan]:
        """Which links the last message in a direction occupied, and when, in the order of its way."""
        return (self._down if direction is Direction.DOWN else self._up).spans

    def set_link(self, index: int, link: Link) -> None:
        """Set a link up anew, for all later messages.

        Raises
        ------
        ValueError
            If there is no such link.
        """
        whole("link", index, 0, PROCESSORS - 1)
        for wires in (self._down, self._up):
            wires.set_cycles(index, link.cycles_per_token)

    def cut(self, index: int) -> None:
        """Let nothing come through a link any more: what its senders have credit for is lost, the rest gets stuck.

        Raises
        ------
        ValueError
            If there is no such link.
        """
        whole("link", index, 0, PROCESSORS - 1)
        for wires in (self._down, self._up):
            wires.stop(index)

    def block(self, processor: int) -> None:
        """Let a processor take no tokens any more: the buffer of its channel end fills, then all before it.

        Raises
        ------
        ValueError
            If there is no such processor.
        """
        whole("processor", processor, 0, PROCESSORS - 1)
        self._down.stop(CHANNEL_ENDS[processor])


def _check(processor: int, tokens: int, at: int) -> None:
    whole("processor", processor, 0, PROCESSORS - 1)
    whole("tokens", tokens, 1, NEVER)
    whole("at", at, 0, NEVER)


def _cycle(value: int) -> int | None:
    return None if value == NEVER else value


class _Way(NamedTuple):
    """The places that messages pass."""

    links: list[int]
    channel_end: int


class _Sent(NamedTuple):
    """A message that nothing held up."""

    order: int
    processor: int
    tokens: int
    begins: int
    leaves: int
    opens: bool


class _Buffers:
    """When places were and will be free: what `link_kernels.carry` keeps."""

    def __init__(self) -> None:
        places = NOWHERE + 1
        self.busy = np.full(places, LONG_AGO)
        self.busy[NOWHERE] = NEVER
        self.freed = np.full((places, BUFFER_TOKENS), LONG_AGO)
        self.passed = np.zeros(places, np.int64)


class _Wires:
    """The links in one direction."""

    def __init__(self, ways: list[_Way], cycles: list[int], hop_cycles: int, credit_cycles: int) -> None:
        self.opened: int | None = None
        self._times: Callable[[], list[tuple[int, int, int]]] = list
        self._ways = ways
        self._cycles = np.array(cycles)
        self._cycles_per_token = cycles[0]
        self._hop_cycles = hop_cycles
        self._credit_cycles = credit_cycles
        self._stuck = np.zeros(NOWHERE + 1, np.bool_)
        self._buffers: _Buffers | None = None
        # The rest is in use while there are no buffers: when each link will be free, and what may still take places in
        # buffers, which is 8 tokens of each link, so at most 8 messages of each processor.
        self._busy = [0] * PROCESSORS
        self._recent: list[deque[_Sent]] = [deque(maxlen=BUFFER_TOKENS) for _ in ways]
        self._order = count()
        # A place is taken for a token and the delays of a switch and a credit; 8 tokens must outlast that.
        full_rate = hop_cycles + credit_cycles <= (BUFFER_TOKENS - 1) * cycles[0]
        if len(set(cycles)) > 1 or not full_rate:
            self._follow()

    @property
    def free_at(self) -> int | None:
        busy = self._busy[0] if self._buffers is None else max(0, int(self._buffers.busy[0]))
        return _cycle(busy)

    def set_cycles(self, link: int, cycles: int) -> None:
        self._follow()
        self._cycles[link] = cycles

    def stop(self, place: int) -> None:
        """Let nothing go on from a place any more."""
        self._follow()
        self._stuck[place] = True

    @property
    def spans(self) -> list[LinkSpan]:
        """Of the last message."""
        return [LinkSpan(link, _cycle(begins), _cycle(ends)) for link, begins, ends in self._times()]

    def carry(self, processor: int, tokens: int, at: int, *, reached: bool, opens: bool) -> Passage:
        links = self._ways[processor].links
        hop = self._hop_cycles
        begins = max(at, self._busy[links[0]])
        # Whatever crosses one of these links before the last crosses the last too, a delay later for each: that one is
        # the last to be free.
        held_up = begins + (len(links) - 1) * hop < self._busy[links[-1]]
        if not reached or held_up:
            self._follow()
        if self._buffers is not None:
            return self._carry_tokens(self._buffers, processor, tokens, at, reached=reached, opens=opens)
        leaves = begins + tokens * self._cycles_per_token
        self._recent[processor].append(_Sent(next(self._order), processor, tokens, begins, leaves, opens))
        for hops, link in enumerate(links):
            self._busy[link] = leaves + hops * hop
        self._times = lambda: [(link, begins + hops * hop, leaves + hops * hop) for hops, link in enumerate(links)]
        return Passage(processor, begins, leaves, leaves + len(links) * hop)

    def carry_train(self, processors: Sequence[int], tokens: Sequence[int], at: int) -> list[int] | None:
        begins, hop = max(at, self._busy[0]), self._hop_cycles
        # If every link is free when the first symbol may come, each message finds free what the one before has left.
        if self._buffers is not None or any(begins + link * hop < busy for link, busy in enumerate(self._busy)):
            return None
        arrives = []
        for processor, size in zip(processors, tokens, strict=True):
            leaves = begins + size * self._cycles_per_token
            self._recent[processor].append(_Sent(next(self._order), processor, size, begins, leaves, True))
            self._busy[: processor + 1] = [leaves + link * hop for link in range(processor + 1)]
            arrives.append(leaves + (processor + 1) * hop)
            begins = leaves
        return arrives

    def _carry_tokens(
        self, buffers: _Buffers, processor: int, tokens: int, at: int, *, reached: bool, opens: bool
    ) -> Passage:
        from . import link_kernels  # numba takes longer to import than everything else together

        links, channel_end = self._ways[processor]
        path = np.array([*links, channel_end if reached else NOWHERE])
        spans: NDArray[np.int64] = np.empty((len(path), 2), np.int64)
        taken = link_kernels.carry(
            path=path,
            header=ROUTE.size if opens else 0,
            tokens=tokens,
            at=at,
            hop_cycles=self._hop_cycles,
            credit_cycles=self._credit_cycles,
            never=NEVER,
            cycles=self._cycles,
            stuck=self._stuck,
            busy=buffers.busy,
            freed=buffers.freed,
            passed=buffers.passed,
            spans=spans,
        )
        self._times = lambda: [
            (link, begins, ends) for link, (begins, ends) in zip(links, spans[:-1].tolist(), strict=True)
        ]
        return Passage(processor, _cycle(int(spans[0, 0])), _cycle(int(spans[0, 1])), _cycle(taken))

    def _follow(self) -> None:
        """Follow the tokens one by one from now on, beginning with those that may still take places."""
        if self._buffers is not None:
            return
        self._buffers = _Buffers()
        for sent in sorted(message for messages in self._recent for message in messages):
            self._carry_tokens(self._buffers, sent.processor, sent.tokens, sent.begins, reached=True, opens=sent.opens)
