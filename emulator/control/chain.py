"""The chain: how messages get from the controller to the processors and back (SPEC.md, chapter CHN).

`Chain` carries messages token by token over its links. What a processor is, its two kinds know. Behind a
`ModelledChain` are models of processors. While nothing is wrong and nobody watches, the outcome of every message is
known beforehand, and the chain is *folded*: changes reach the processors at their period without a message. Once a
fault is armed or a tracer looks on, it is *unfolded*: each message travels token by token, may be damaged on its way,
and may get stuck. What outputs and records say is the same either way, and the tests hold one against the other. One
thing may come a period apart: a sequence or a modulation that waits for stores, if a question took the place of one of
them. Behind an `ExecutedChain` (`executed_chain`) are processors that execute their firmware; it is never folded while
something plays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ...base.errors import ChainError
from ...protocol.board import CYCLES_PER_MS, PROCESSORS
from ...protocol.chain import (
    SLICE_BYTES,
    Collect,
    Commit,
    Identity,
    Load,
    Message,
    Number,
    Playing,
    Program,
    Report,
    Slice,
    decode,
)
from ...protocol.codes import LINK_MS, NUMBER_MS, STALL_MS, UNNUMBERED_NODE, ChannelEnd
from ...protocol.timing import HOP_CYCLES, Link
from ..boards.links import Links, Passage
from ..boards.package import Package
from ..boards.processor import Processor
from ..boards.switches import Direction, destination
from ..scheduler import NEVER, Scheduler
from ..trace import Tracer
from .agenda import Change, UpdateBatch

__all__ = ["Chain", "ModelledChain", "Numbering", "Passing", "Tamper", "piece_of"]

STALL_CYCLES = STALL_MS * CYCLES_PER_MS
LINK_CYCLES = LINK_MS * CYCLES_PER_MS
NUMBER_CYCLES = NUMBER_MS * CYCLES_PER_MS
ANSWER_CYCLES = 400
"""From a question to the first token of the answer: a microsecond, an estimate; clause CHN-016 allows 0.5 ms."""


class Passing(NamedTuple):
    """A message that is about to go onto the chain."""

    node: int
    """Whom it goes to or comes from."""
    down: bool
    """Whether it goes to the processor."""
    tokens: bytes
    ends: bool = True
    """Whether its END is there; without, the route stays open."""


Tamper = Callable[[Passing], Passing]


class Chain(ABC):
    """Ten processors behind one controller."""

    starting_cycles = 0
    """From the start of the last program until it can be numbered."""

    def __init__(
        self,
        scheduler: Scheduler,
        processors: Sequence[Package],
        link: Link,
        tracer: Tracer,
        tampers: Sequence[Tamper] = (),
    ) -> None:
        self._scheduler = scheduler
        self.processors = processors
        self.link = link
        self.tracer = tracer
        self.links = Links([link] * PROCESSORS)
        self.folded = True
        self.broken = False
        self._tampers = tampers
        self._heard = b""
        self.hear: Callable[[bytes], None] = lambda _: None
        self.stuck: Callable[[], None] = lambda: None

    # What only one of the two kinds can do

    @abstractmethod
    def apply(self, item: Change | UpdateBatch, begun: int = 0) -> None:
        """Let a change take effect on all processors; of a batch the updates from `begun` up to its `next`."""

    @abstractmethod
    def playing(self, number: int, period: int) -> Playing:
        """What a processor of a folded chain plays in a period."""

    def first_report(self, number: int, identity: Identity) -> Report:
        """What is known of a processor when period 0 begins, before it has answered a question (clause REQ-008)."""
        return Report(number, 0, 0, identity.firmware, 0, 0, 0, 0)

    @abstractmethod
    def _bring(self, passage: Passage, message: Message, passing: Passing) -> None:
        """Let a processor have tokens that reach it."""

    # Messages

    def send(self, change: Change) -> None:
        """Send the messages of a change (clause CHN-029)."""
        messages: list[Message] = []
        if change.packed is not None:
            slices = [Slice(place, piece_of(change.packed, place)) for place in range(PROCESSORS)]
            messages += [*slices, *(Commit.of(change.period, piece) for piece in slices)]
        for program in change.programs:
            fields = (program.memory, program.period, program.first, program.count, program.hold, program.repeats)
            messages += [Program(place, *fields) for place in range(PROCESSORS)]
        for message in messages:
            self.pass_down(message)

    def load(self, load: Load) -> None:
        """Store items of a memory of a processor."""
        self.pass_down(load)

    @property
    def reading_cycles(self) -> tuple[int, int]:
        """On an idle chain, from the first of ten questions what plays to the last of them, and to the last answer."""
        token = self.link.cycles_per_token
        asked = PROCESSORS * (Collect.TOKENS * token + HOP_CYCLES)
        # Answers follow each other on the first link; the first of them sets out as soon as its question is there.
        answered = Collect.TOKENS * token + ANSWER_CYCLES + PROCESSORS * Playing.TOKENS * token + 2 * HOP_CYCLES
        return asked, max(asked, answered)

    @property
    def free_at(self) -> int:
        """Core cycle from which on the first link takes another message."""
        free = self.links.free_at()
        return NEVER if free is None else free

    def pass_down(self, message: Message) -> int | None:
        """Let a message go to whomever its header names; the core cycle at which it will have arrived, if it does."""
        if self.broken:
            return None
        now = self._scheduler.now
        passing = self._tampered(Passing(message.node, True, message.encode()))
        tokens = passing.tokens
        nodes = [UNNUMBERED_NODE if processor.number is None else processor.number for processor in self.processors]
        processor, reached = destination(nodes, int.from_bytes(tokens[:2], "big"))
        passage = self.links.down(processor, len(tokens), now, ends=passing.ends, reached=reached)
        self.tracer.passed(message, self.links.spans(Direction.DOWN))
        if passage.leaves is None or passage.leaves > now + STALL_CYCLES:
            self._scheduler.at(now + STALL_CYCLES, self._break)
        if passage.arrives is not None:
            self._bring(passage, message, passing)
        return passage.arrives

    def _break(self) -> None:
        if not self.broken:
            self.broken = True
            self.stuck()

    def _pass_up(self, place: int, tokens: bytes, begins: int) -> None:
        """Let a processor's message go to the controller, from a core cycle on."""
        if self.processors[place].stopped:
            return
        passing = self._tampered(Passing(place, False, tokens))
        passage = self.links.up(place, len(passing.tokens), begins, ends=passing.ends)
        self.tracer.passed(tokens, self.links.spans(Direction.UP))
        if passage.arrives is not None:
            self._scheduler.at(max(passage.arrives, self._scheduler.now), lambda: self._hear(passing))

    def _hear(self, passing: Passing) -> None:
        tokens, self._heard = self._heard + passing.tokens, b""
        if passing.ends:
            self.hear(tokens)
        else:
            self._heard = tokens

    def _tampered(self, passing: Passing) -> Passing:
        for tamper in self._tampers:
            passing = tamper(passing)
        return passing

    def lose(self, place: int) -> None:
        """Let a processor have no power any more: nothing passes it, and the one before it gets no credit."""
        self.processors[place].stop()
        self.links.cut(place)
        if place:
            self.processors[place - 1].is_last = True


class ModelledChain(Chain):
    """A chain of models of processors."""

    def __init__(
        self,
        scheduler: Scheduler,
        processors: Sequence[Processor],
        link: Link,
        tracer: Tracer,
        tampers: Sequence[Tamper] = (),
    ) -> None:
        super().__init__(scheduler, processors, link, tracer, tampers)
        self._models = processors
        self._begun = [b""] * PROCESSORS

    # Folded

    def apply(self, item: Change | UpdateBatch, begun: int = 0) -> None:
        """Let a change take effect on all processors; of a batch the updates from `begun` up to its `next`."""
        if isinstance(item, UpdateBatch):
            part = slice(begun, item.next)
            for processor in self._models:
                at = processor.place * SLICE_BYTES
                processor.play(item.periods[part], item.packed[part, at : at + SLICE_BYTES])
            return
        for processor in self._models:
            if item.packed is not None:
                piece = np.frombuffer(piece_of(item.packed, processor.place), np.uint8)[None]
                processor.play(np.array([item.period]), piece)
            for program in item.programs:
                processor.carry_out(program)

    def load(self, load: Load) -> None:
        """Store items of a memory of a processor."""
        if self.folded:
            self._models[load.processor].load(load.memory, load.first, load.data)
        else:
            super().load(load)

    @property
    def free_at(self) -> int:
        """Core cycle from which on the first link takes another message."""
        return 0 if self.folded else super().free_at

    def playing(self, number: int, period: int) -> Playing:
        """What a processor plays in a period."""
        return self._models[number].playing(period)

    def first_report(self, number: int, identity: Identity) -> Report:
        """Its report, read off it, unless something may damage its answers."""
        if self._tampers:
            return super().first_report(number, identity)
        report = self._models[number].receive(Collect(number, ChannelEnd.REPORT).encode())
        assert isinstance(report, Report)
        return report

    # Unfolded

    def _bring(self, passage: Passage, message: Message, passing: Passing) -> None:  # noqa: ARG002  # a base class decides
        assert passage.arrives is not None
        self._scheduler.at(passage.arrives, lambda: self._arrive(passage.processor, passing.tokens, passing.ends))

    def _arrive(self, place: int, tokens: bytes, ends: bool) -> None:
        tokens, self._begun[place] = self._begun[place] + tokens, b""
        if not ends:  # its route is still open: what follows runs into the same channel end
            self._begun[place] = tokens
            return
        answer = self._models[place].receive(tokens)
        if answer is None:
            return
        wait = ANSWER_CYCLES
        if isinstance(answer, Identity) and answer.last and place < PROCESSORS - 1:
            wait = max(wait, LINK_CYCLES)  # it waits in vain for the link behind it
        self._scheduler.at(self._scheduler.now + wait, lambda: self._answer(place, answer.encode()))

    def _answer(self, place: int, tokens: bytes) -> None:
        self._pass_up(place, tokens, self._scheduler.now)


def piece_of(packed: bytes, place: int) -> bytes:
    """A processor's 48 bytes of an update."""
    return packed[place * SLICE_BYTES : (place + 1) * SLICE_BYTES]


class Numbering:
    """Numbers the processors from 0 up, each after the answer of the one before (clause CHN-023)."""

    def __init__(self, scheduler: Scheduler, chain: Chain, done: Callable[[list[Identity]], None]) -> None:
        self._scheduler = scheduler
        self._chain = chain
        self._done = done
        self._identities: list[Identity] = []
        chain.hear = self._hear
        self._ask()

    def _ask(self) -> None:
        number = len(self._identities)
        self._chain.pass_down(Number(number))
        self._scheduler.at(self._scheduler.now + NUMBER_CYCLES, lambda: self._give_up(number))

    def _hear(self, tokens: bytes) -> None:
        try:
            identity = decode(tokens)
        except ChainError:
            return  # it is dropped (clause CHN-010), and no other one comes
        if not isinstance(identity, Identity):
            return
        self._identities.append(identity)
        if identity.last or len(self._identities) == PROCESSORS:
            self._finish()
        else:
            self._ask()

    def _give_up(self, number: int) -> None:
        if len(self._identities) == number:
            self._finish()

    def _finish(self) -> None:
        self._chain.hear = lambda _: None
        self._done(self._identities)
