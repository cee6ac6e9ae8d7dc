"""Planning: the arithmetic that gives one change its time on the chain and the period at which it takes effect.

The functions know nothing but their arguments, integers in core cycles or periods. `Agenda` keeps what they planned,
and `Dispatch` has it sent. The same functions, compiled, plan many updates (`batch_kernels`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...protocol.board import CYCLES_PER_PERIOD

__all__ = ["Cost", "Progress", "Rules", "is_late", "plan"]


class Cost(NamedTuple):
    """What a change needs of the chain, in core cycles."""

    occupies: int
    """How long the first link is busy with it."""
    forward: int
    """From its first token to the last processor that is ready with it."""
    lead: int
    """From its first token to its first commit, which must not come while an earlier commit waits for its period."""


class Rules(NamedTuple):
    """By what updates are judged and planned: times in core cycles, the limit in thousandths (clause SAF-006)."""

    origin: int
    packet: int
    sort: int
    end: int
    """Of the time that there is."""
    limit: int
    periods_per_update: int
    horizon: int
    """In periods."""
    occupies: int
    forward: int
    lead: int
    """This and the two before it: as of `Cost`."""


class Progress(NamedTuple):
    """How far updates are judged and planned: the time, the last number, the last named period, the end of the plan."""

    now: int
    number: int
    named: int
    """-1 for none."""
    sent: int
    period: int
    table: int


def plan(
    origin: int, ready: int, sent: int, waits: int, period: int, requested: int, forward: int, lead: int
) -> tuple[int, int]:
    """Where a change goes after others.

    Parameters
    ----------
    origin : int
        When period 0 began.
    ready : int
        When it can be sent.
    sent : int
        When the change before it has left the controller.
    waits : int
        Period until which something waits in the processors that this may not meet.
    period : int
        The period at which the change before it takes effect.
    requested : int
        The period that it names; 0 for as soon as possible.
    forward, lead : int
        See `Cost`.

    Returns
    -------
    start : int
        When its first token leaves; not sooner than needed (clause CHN-029).
    period : int
        The period at which it takes effect (clauses BLK-005 and BLK-007).
    """
    start = max(ready, sent, origin + waits * CYCLES_PER_PERIOD - lead)
    reached = -((origin - start - forward) // CYCLES_PER_PERIOD)
    taken = max(reached, requested, period + 1)
    return max(start, origin + (taken - 1) * CYCLES_PER_PERIOD - forward), taken


def is_late(requested: Any, period: Any) -> Any:
    """Whether a change takes effect after the period that it names, 0 for none (clause BLK-005); also of arrays."""
    return (requested > 0) & (requested < period)
