"""The chain: how messages get from the controller to the processors and back (SPEC.md, chapter CHN).

While nothing is wrong and nobody watches, the outcome of every message is known beforehand, and the chain is *folded*:
changes reach the processors at their period without a message. Once a fault is armed or a tracer looks on, it is
*unfolded*: each message travels token by token, may be damaged on its way, and may get stuck. What outputs and records
say is the same either way, and the tests hold one against the other. One thing may come a period apart: a sequence
or a modulation that waits for stores, if a question took the place of one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ...errors import ChainError
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
    Slice,
    decode,
)
from ...protocol.codes import LINK_MS, NUMBER_MS, STALL_MS, UNNUMBERED_NODE
from ...protocol.timing import HOP_CYCLES, Link
from ..boards.links import Links
from ..boards.processor import Processor
from ..boards.switches import Direction, destination
from ..scheduler import NEVER, Scheduler
from ..trace import Tracer
from .agenda import Change, UpdateBatch

__all__ = ["Chain", "Numbering", "Passing", "Tamper"]

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


class Chain:
    """Ten processors behind one controller.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    processors : sequence of Processor
        In the order of the chain.
    link : Link
        Set-up of all links.
    tracer : Tracer
        Is told of every message.
    tampers : sequence of callable
        What is done to messages, one after the other; each takes a message and gives it as it arrives.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        processors: Sequence[Processor],
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
        self._begun = [b""] * PROCESSORS
        self._heard = b""
        self.hear: Callable[[bytes], None] = lambda _: None
        self.stuck: Callable[[], None] = lambda: None

    # Folded

    def apply(self, item: Change | UpdateBatch, begun: int = 0) -> None:
        """Let a change take effect on all processors; of a batch the updates from `begun` up to its `next`."""
        if isinstance(item, UpdateBatch):
            part = slice(begun, item.next)
            for processor in self.processors:
                at = processor.place * SLICE_BYTES
                processor.play(item.periods[part], item.packed[part, at : at + SLICE_BYTES])
            return
        for processor in self.processors:
            if item.packed is not None:
                piece = np.frombuffer(_piece(item.packed, processor.place), np.uint8)[None]
                processor.play(np.array([item.period]), piece)
            for program in item.programs:
                processor.carry_out(program)

    # Unfolded

    def send(self, change: Change) -> None:
        """Send the messages of a change (clause CHN-029)."""
        messages: list[Message] = []
        if change.packed is not None:
            slices = [Slice(place, _piece(change.packed, place)) for place in range(PROCESSORS)]
            messages += [*slices, *(Commit.of(change.period, piece) for piece in slices)]
        for program in change.programs:
            fields = (program.memory, program.period, program.first, program.count, program.hold, program.repeats)
            messages += [Program(place, *fields) for place in range(PROCESSORS)]
        for message in messages:
            self.pass_down(message)

    def load(self, load: Load) -> None:
        """Store items of a memory of a processor."""
        if self.folded:
            self.processors[load.processor].load(load.memory, load.first, load.data)
        else:
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
        if self.folded:
            return 0
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
            self._scheduler.at(passage.arrives, lambda: self._arrive(passage.processor, tokens, passing.ends))
        return passage.arrives

    def _break(self) -> None:
        if not self.broken:
            self.broken = True
            self.stuck()

    def _arrive(self, place: int, tokens: bytes, ends: bool) -> None:
        tokens, self._begun[place] = self._begun[place] + tokens, b""
        if not ends:  # its route is still open: what follows runs into the same channel end
            self._begun[place] = tokens
            return
        answer = self.processors[place].receive(tokens)
        if answer is None:
            return
        wait = ANSWER_CYCLES
        if isinstance(answer, Identity) and answer.last and place < PROCESSORS - 1:
            wait = max(wait, LINK_CYCLES)  # it waits in vain for the link behind it
        self._scheduler.at(self._scheduler.now + wait, lambda: self._pass_up(place, answer))

    def _pass_up(self, place: int, answer: Message) -> None:
        if self.processors[place].stopped:
            return
        now = self._scheduler.now
        passing = self._tampered(Passing(place, False, answer.encode()))
        passage = self.links.up(place, len(passing.tokens), now, ends=passing.ends)
        self.tracer.passed(answer, self.links.spans(Direction.UP))
        if passage.arrives is not None:
            self._scheduler.at(passage.arrives, lambda: self._hear(passing))

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


def _piece(packed: bytes, place: int) -> bytes:
    return packed[place * SLICE_BYTES : (place + 1) * SLICE_BYTES]


class Numbering:
    """Numbers the processors from 0 up, each after the answer of the one before (clause CHN-023).

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    chain : Chain
        Whose `hear` it takes over meanwhile.
    done : callable
        Takes the identities, in the order of the chain; the chain is complete with ten.
    """

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
        if identity.last:
            self._finish()
        else:
            self._ask()

    def _give_up(self, number: int) -> None:
        if len(self._identities) == number:
            self._finish()

    def _finish(self) -> None:
        self._chain.hear = lambda _: None
        self._done(self._identities)
