"""Supervisor: asks each processor in turn how it is, and finds faults in what it answers or leaves unanswered.

`KnownFaults` decides what a fault means to the device; `Chain` carries the questions and answers.

On a folded chain every question would be answered as before, so none is asked; what the processors report is read off
them. On an unfolded chain questions and answers are messages, and pulses of the sync line are events.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from ...base.errors import ChainError
from ...protocol.board import CYCLES_PER_MS, PROCESSORS, TICKS_PER_PERIOD
from ...protocol.chain import Collect, Identity, Playing, Report, decode
from ...protocol.codes import COLLECT_MS, COLLECTIONS_MISSED, DEAF_MS, SYNC_PERIODS, Bank, ChannelEnd, Fault
from ...protocol.replies import ProcessorReport
from ..ports.clock import Timebase
from ..scheduler import Scheduler
from .chain import Chain

__all__ = ["BROKEN", "QUESTION_CYCLES", "ChainSchedule", "Supervisor"]

BROKEN = Fault.CHAIN | Fault.PROCESSOR
"""What a chain that carries nothing any more means (clause CHN-021)."""
LEFT_ALONE_CYCLES = (DEAF_MS + 1) * CYCLES_PER_MS
QUESTION_CYCLES = COLLECT_MS * CYCLES_PER_MS // PROCESSORS
"""One processor after the other is asked, a millisecond apart (clause CHN-017)."""


class ChainSchedule(Protocol):
    """What else goes onto the chain, as far as questions must make way for it."""

    @property
    def commits_due(self) -> int:
        """How many commits must have taken effect, or been missed, at each processor."""

    def question_time(self) -> int:
        """From which core cycle on a question does not hold up a change."""

    def reading_time(self) -> int:
        """From which core cycle on a question what a processor plays holds up neither a change nor a load."""

    def settle(self) -> None:
        """Let what is planned up to now have taken effect."""


class Supervisor:
    """Watches over the processors."""

    def __init__(
        self,
        scheduler: Scheduler,
        time: Timebase,
        chain: Chain,
        schedule: ChainSchedule,
        identities: Sequence[Identity],
        bank: Bank,
        *,
        on_fault: Callable[[Fault, str], None],
        on_miss: Callable[[int], None],
    ) -> None:
        self._scheduler = scheduler
        self._time = time
        self._chain = chain
        self._schedule = schedule
        self._bank = bank
        self._on_fault = on_fault
        self._on_miss = on_miss
        self.complete = len(identities) == PROCESSORS
        self._reports = [chain.first_report(number, identity) for number, identity in enumerate(identities)]
        self._latched = [Fault(report.faults) for report in self._reports] + [Fault(0)] * PROCESSORS
        self._unanswered = [0] * PROCESSORS
        self._left_alone: dict[int, int] = {}
        """Processors that were left alone since the outputs were enabled, and until when."""
        self._due_when_asked = [0] * PROCESSORS
        self._lost_commits = [0] * PROCESSORS
        self._playing: dict[int, Playing] = {}
        chain.hear = self._hear

    # What is known

    @property
    def found(self) -> Fault:
        """Faults that were there from the beginning (clauses CHN-021 and CHN-024)."""
        faults = Fault(0) if self.complete else Fault.PROCESSOR
        if self._chain.broken:
            faults |= BROKEN
        for report in self._reports:
            faults |= Fault(report.faults)
        return faults

    @property
    def temperature_c(self) -> int:
        """Of the hottest board."""
        return max((report.temperature_c for report in self._reports), default=0)

    @property
    def missed_commits(self) -> int:
        """Of all processors, as last reported."""
        return sum(report.missed_commits for report in self._reports)

    @property
    def damaged_messages(self) -> int:
        """Of all processors, as last reported."""
        return sum(report.damaged_messages for report in self._reports)

    @property
    def all_answer(self) -> bool:
        """Whether all ten processors are there and answer."""
        lost = any(count >= COLLECTIONS_MISSED for count in self._unanswered)
        return self.complete and not lost and not self._chain.broken

    def persists(self, fault: Fault) -> bool:
        """Whether a processor said last that it has a fault."""
        return any(report.faults & fault for report in self._reports)

    def forget(self, faults: Fault) -> None:
        """These faults were cleared: events that were reported are over."""
        self._latched = [latched & ~faults for latched in self._latched]
        self._reports = [replace(report, faults=report.faults & ~faults.value) for report in self._reports]

    def reports(self) -> list[ProcessorReport]:
        """Answer the PROCESSORS request (clause REQ-008)."""
        known = [
            ProcessorReport(
                Fault(report.faults) | latched,
                report.temperature_c,
                self._bank,
                report.missed_commits,
                report.damaged_messages,
                report.firmware,
            )
            for report, latched in zip(self._reports, self._latched, strict=False)
        ]
        absent = ProcessorReport(Fault.PROCESSOR, 0, None, 0, 0, (0, 0, 0))
        return known + [absent] * (PROCESSORS - len(known))

    # Questions and answers

    def unfold(self) -> None:
        """From now on ask, and let the sync line pulse."""
        now = self._scheduler.now
        number = (now - self._time.origin) // QUESTION_CYCLES + 1
        self._scheduler.at(self._time.origin + number * QUESTION_CYCLES, self._ask_next)
        pulse = (now - self._time.origin) // (self._time.boundary(SYNC_PERIODS) - self._time.origin)
        for processor in self._chain.processors[: len(self._reports)]:
            processor.listen(now)
            processor.take_up_pulses(pulse * SYNC_PERIODS * TICKS_PER_PERIOD)
        self._schedule_pulse(pulse + 1)

    def _ask_next(self) -> None:
        now = self._scheduler.now
        number = (now - self._time.origin) // QUESTION_CYCLES % PROCESSORS
        self._scheduler.at(now + QUESTION_CYCLES, self._ask_next)
        if number < len(self._reports) and not self._chain.broken:
            self._scheduler.at(max(now, self._schedule.question_time()), lambda: self._ask(number))

    def _ask(self, number: int) -> None:
        if self._chain.broken or self._scheduler.now < self._left_alone.get(number, 0):
            return
        if (later := self._schedule.question_time()) > self._scheduler.now:
            self._scheduler.at(later, lambda: self._ask(number))
            return
        if self._unanswered[number] == COLLECTIONS_MISSED:
            self._on_fault(Fault.PROCESSOR, f"processor {number} does not answer")
        self._unanswered[number] = min(self._unanswered[number] + 1, COLLECTIONS_MISSED)
        self._due_when_asked[number] = self._schedule.commits_due
        self._chain.pass_down(Collect(number, ChannelEnd.REPORT))

    def _hear(self, tokens: bytes) -> None:
        try:
            answer = decode(tokens)
        except ChainError as error:
            self._on_fault(Fault.CHAIN, f"an answer is damaged: {error}")
            return
        match answer:
            case Report():
                self._heed(answer)
            case Playing():
                self._playing[answer.processor] = answer

    def _heed(self, report: Report) -> None:
        number, before = report.processor, self._reports[report.processor]
        self._unanswered[number] = 0
        self._reports[number] = report
        faults = Fault(report.faults)
        # A commit that was neither carried out nor missed has never arrived.
        lost = (self._due_when_asked[number] - report.carried_out - report.missed_commits) % 2**32
        missed = report.missed_commits != before.missed_commits
        if 0 < lost < 2**31 and lost > self._lost_commits[number]:
            self._lost_commits[number] = lost
            missed = True
        if missed or report.damaged_messages != before.damaged_messages:
            faults |= Fault.CHAIN
        self._latched[number] |= faults
        if faults:
            self._on_fault(faults, f"processor {number} reports {faults.name}")
        if missed:
            self._on_miss(number)

    def leave_alone(self, number: int) -> bool:
        """Ask a processor nothing for so long that it falls silent by itself (clause CHN-018); False if done before."""
        if number in self._left_alone:
            return False
        self._left_alone[number] = self._scheduler.now + LEFT_ALONE_CYCLES
        return True

    def attend(self) -> None:
        """The outputs are enabled: from now on ask all processors."""
        self._left_alone.clear()

    def collect_playing(self, timeout_cycles: int) -> tuple[list[Playing], int]:
        """What each processor plays, and the period in which the last was read.

        They are fewer than ten if some do not answer in time.
        """
        if self._chain.folded:
            return self._read_folded()
        self._playing.clear()
        deadline = self._scheduler.now + timeout_cycles
        read = self._scheduler.now
        for number in range(len(self._reports)):
            while self._scheduler.now < (later := min(self._schedule.reading_time(), deadline)):
                self._scheduler.run_until(later)
            if self._scheduler.now >= deadline:
                break  # the chain is broken
            read = self._chain.pass_down(Collect(number, ChannelEnd.PLAYING)) or read
        while len(self._playing) < len(self._reports):
            upcoming = self._scheduler.next_time()
            if upcoming is None or upcoming > deadline:
                break
            self._scheduler.run_until(upcoming)
        return [self._playing[number] for number in sorted(self._playing)], self._time.period(read)

    def _read_folded(self) -> tuple[list[Playing], int]:
        """The same, in the time that it takes on an idle chain."""
        asked, answered = self._chain.reading_cycles
        begun = self._scheduler.now
        self._scheduler.run_until(begun + asked)
        self._schedule.settle()
        period = self._time.period(self._scheduler.now)
        found = [self._chain.playing(number, period) for number in range(len(self._reports))]
        self._scheduler.run_until(begun + answered)
        return found, period

    # The sync line

    def _schedule_pulse(self, pulse: int) -> None:
        period = pulse * SYNC_PERIODS
        self._scheduler.at(self._time.boundary(period), lambda: self._pulse(pulse))

    def _pulse(self, pulse: int) -> None:
        self._schedule_pulse(pulse + 1)
        tick = pulse * SYNC_PERIODS * TICKS_PER_PERIOD
        for processor in self._chain.processors[: len(self._reports)]:
            processor.feel_pulse(tick)
