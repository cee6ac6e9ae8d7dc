"""The watchdog: its time in cases, and whether it fires in time after the last sign of life (SAF-003)."""

from __future__ import annotations

from ....protocol.board import TICK_HZ, TICKS_PER_PERIOD
from ....protocol.codes import Request, State
from ....protocol.replies import Status
from ..bench import Bench
from ..cases import TooSlow, expect
from ..transports.line import RawLine
from .steps import LONG_MS

TICKS_PER_MS = TICK_HZ // 1000
SHORT_MS = 10
"""The shortest watchdog time (clause REQ-009)."""
PERIODS_PER_MS = TICKS_PER_MS // TICKS_PER_PERIOD


def patience(bench: Bench, line: RawLine | None = None) -> int:
    """A watchdog time in ms within which some blocks arrive on a line, by default on the bench's own."""
    return bench.slowness * (60 if (line or bench.line).kind == "usb" else 250)


def far_ahead(bench: Bench) -> int:
    """Periods within which some blocks arrive on this line, and the queue can be examined."""
    return bench.slowness * (2_000 if bench.line.kind == "usb" else 40_000)


def let_watchdog_fire(bench: Bench) -> None:
    """Give no sign of life for longer than the shortest watchdog time."""
    bench.order(Request.WATCHDOG, SHORT_MS)
    bench.outlast(3 * SHORT_MS / 1000)
    bench.order(Request.WATCHDOG, LONG_MS)


def check_fired(told: Status, first_sign: int, last_sign: int, ms: int) -> None:
    """Fail unless the watchdog fired in time after a sign of life that arrived between two ticks."""
    expect("the state in the record", told.state, State.OFF)
    assert told.watchdog_fired, f"the flags in the record are {told.flags!r}, should have WATCHDOG_FIRED"
    after_ms = ms * TICKS_PER_MS
    earliest, latest = first_sign + after_ms, last_sign + after_ms + TICKS_PER_PERIOD
    assert earliest <= told.now <= latest, (
        f"the watchdog of {ms} ms fired at tick {told.now}, {told.now - first_sign} ticks after the last sign of life "
        f"(not before tick {first_sign}); it should be from tick {earliest} to {latest}"
    )


def await_firing(bench: Bench, first_sign: int, last_sign: int, ms: int) -> Status:
    """Wait for the watchdog, which must fire in time."""
    told = bench.await_unasked(ms / 1000 + 1)
    check_fired(told, first_sign, last_sign, ms)
    return told


def check_not_yet(bench: Bench, tick: int, now: int | None = None) -> None:
    """Inconclusive if a tick has come before a case was ready for it: by now, or when the device said so."""
    if now is None:
        now = bench.clock().now
    if now >= tick:
        raise TooSlow(f"this line is too slow: it is tick {now}, and the case should have been ready before {tick}")
