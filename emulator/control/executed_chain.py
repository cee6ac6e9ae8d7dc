"""The chain of processors that execute their firmware (SPEC.md, chapter CHN).

Tokens reach a processor's channel ends at their times, and its answers leave when its firmware sends them. So the core
of a processor that was asked something is executed in steps that are shorter than the way of an answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...protocol.board import CYCLES_PER_MS, PROCESSORS
from ...protocol.chain import (
    Collect,
    Commit,
    Identity,
    Message,
    Number,
    Playing,
    Report,
    Slice,
    commit_checksum,
)
from ...protocol.codes import CONTROLLER_NODE, LINK_MS, ChannelEnd
from ...protocol.timing import HOP_CYCLES, Link
from ..boards.executed import DOWN_LINK, UP_LINK, ExecutedProcessor, with_end
from ..boards.links import Passage
from ..boards.package import AMBIENT_C
from ..scheduler import Scheduler
from ..trace import Tracer
from .agenda import Change, UpdateBatch
from .chain import Chain, Passing, Tamper, piece_of

__all__ = ["ExecutedChain"]

STEP_CYCLES = HOP_CYCLES
"""An answer that began within the last step has not reached the controller yet."""
NUMBERING_STEP_CYCLES = 100 * HOP_CYCLES
STARTING_CYCLES = 4_000
"""10 µs, an assumption: the last boot program checks a CRC-32 and starts the firmware, which gets its channel ends."""
GIVE_UP_CYCLES = CYCLES_PER_MS
"""After so long no answer to a question is looked for; clause CHN-016 allows half of it."""
GIVE_UP_IDENTITY_CYCLES = 2 * LINK_MS * CYCLES_PER_MS
"""After so long no identity is looked for: the controller has given up."""
TRAIN_PLACES = [*range(PROCESSORS)] * 2
TRAIN_TOKENS = [Slice.TOKENS] * PROCESSORS + [Commit.TOKENS] * PROCESSORS
"""An update on the chain: ten slices, then ten commits."""


class ExecutedChain(Chain):
    """A chain of processors that execute their firmware."""

    starting_cycles = STARTING_CYCLES

    def __init__(
        self,
        scheduler: Scheduler,
        processors: Sequence[ExecutedProcessor],
        link: Link,
        tracer: Tracer,
        tampers: Sequence[Tamper] = (),
    ) -> None:
        super().__init__(scheduler, processors, link, tracer, tampers)
        self._executed = processors
        self._delays = [0] * PROCESSORS
        """How long each processor took for its last answer, in core cycles: when to look for the next."""

    def apply(self, item: Change | UpdateBatch, begun: int = 0) -> None:
        """Not possible: firmware hears messages only."""
        raise NotImplementedError("a change reaches executed firmware as messages only")

    def playing(self, number: int, period: int) -> Playing:
        """Not possible: only the firmware knows."""
        raise NotImplementedError("executed firmware is asked by messages only")

    def first_report(self, number: int, identity: Identity) -> Report:
        """What it will answer as soon as it is asked, unless something may damage its answers."""
        report = super().first_report(number, identity)
        return report if self._tampers else replace(report, temperature_c=AMBIENT_C)

    def send(self, change: Change) -> None:
        """Send the messages of a change (clause CHN-029)."""
        if not (self._tampers or self.tracer.watching or self.broken) and change.packed is not None:
            arrives = self.links.train(TRAIN_PLACES, TRAIN_TOKENS, self._scheduler.now)
            if arrives is not None:
                self._bring_update(change.period, change.packed, arrives)
                change = replace(change, packed=None)
        super().send(change)

    def _bring_update(self, period: int, packed: bytes, arrives: list[int]) -> None:
        """Bring slices and commits that arrive whole, each at a core cycle, in the order of their sending."""
        named = period.to_bytes(8, "little")
        for processor, slice_arrives, commit_arrives in zip(
            self._executed, arrives[:PROCESSORS], arrives[PROCESSORS:], strict=True
        ):
            piece = piece_of(packed, processor.place)
            checksum = commit_checksum(period, piece).to_bytes(4, "little")
            processor.deliver(ChannelEnd.SLICE, with_end(piece), slice_arrives)
            processor.deliver(ChannelEnd.COMMIT, with_end(named + checksum), commit_arrives)

    def _bring(self, passage: Passage, message: Message, passing: Passing) -> None:
        assert passage.arrives is not None
        place = passage.processor
        node = int.from_bytes(passing.tokens[:2], "big")
        if not all(before.passes(node, DOWN_LINK) for before in self._executed[:place]):
            return
        self._executed[place].bring(passing.tokens, passage.arrives, ends=passing.ends)
        if isinstance(message, Collect):
            at = passage.arrives + max(self._delays[place] - 2 * STEP_CYCLES, STEP_CYCLES)
            self._look(place, passage.arrives, at, STEP_CYCLES, passage.arrives + GIVE_UP_CYCLES)
        elif isinstance(message, Number):
            until = passage.arrives + GIVE_UP_IDENTITY_CYCLES
            self._look(place, passage.arrives, passage.arrives + STEP_CYCLES, NUMBERING_STEP_CYCLES, until)

    def _look(self, place: int, asked: int, at: int, step: int, until: int) -> None:
        self._scheduler.at(at, lambda: self._look_now(place, asked, step, until))

    def _look_now(self, place: int, asked: int, step: int, until: int) -> None:
        """Let a processor come to the present; if it has answered, pass that on, else look again later."""
        processor, now = self._executed[place], self._scheduler.now
        processor.execute()
        answers = processor.take_answers()
        for tokens, begins in answers:
            self._delays[place] = begins - asked
            if all(between.passes(CONTROLLER_NODE, UP_LINK) for between in self._executed[:place]):
                self._pass_up(place, tokens, begins)
        if not answers and now < until and not processor.stopped:
            self._look(place, asked, now + step, step, until)
