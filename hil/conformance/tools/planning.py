"""Two things at once: what cases plan for a period, and a device on which nothing of it is left."""

from __future__ import annotations

from ....protocol.blocks import Samples
from ....protocol.codes import PAYLOAD_BYTES, Feature, Request, State, StatusFlag
from ....protocol.replies import Status
from ..bench import Bench
from ..cases import expect
from .player import is_fast
from .steps import expect_all, store_entry
from .watchdog import far_ahead

PLACE, SAMPLE = 40, 128
APART = 20
"""Periods between consecutive queued changes: any chain can carry that."""
MOST_PERIODS = 120_000
"""Half of it is the duration of a sequence's entry, which has 16 bits."""
SETTLED = 60
"""Periods after which all that was due has taken effect."""


def some_time(bench: Bench) -> int:
    """Periods within which a case can queue what it needs, disable it, and begin something new."""
    return min(4 * far_ahead(bench), MOST_PERIODS) if is_fast(bench) else 60_000


def check_rest(status: Status, bench: Bench, state: State, what: str) -> None:
    """Fail unless nothing plays, modulates or is queued."""
    expect_all(status, f" {what}", state=state, since_period=0)
    expect(f"the flags {what}", status.flags & ~StatusFlag.WATCHDOG_FIRED, StatusFlag(0))
    expect(f"the free places {what}", status.free, bench.info.queue_blocks)


def check_nothing_is_read_back(bench: Bench, what: str) -> None:
    """Fail unless the processors report that they play nothing, if they can be asked."""
    if Feature.READ_BACK in bench.info.features:
        answer = bench.ask(Request.PULSES)
        expect(f"PULSES {what}, without read_period", answer[:8] + answer[16:], bytes(8 + PAYLOAD_BYTES))


def store_for_plans(bench: Bench) -> None:
    """Store the data of the plans and of what comes after them, while the outputs are off."""
    if Feature.SEQUENCES in bench.info.features:
        store_entry(bench, some_time(bench) // 2, PLACE)
    if Feature.MODULATION in bench.info.features:
        bench.must(Samples(bytes([SAMPLE]), PLACE))
