"""The device's clock against the host's, on a computer that may be busy."""

from __future__ import annotations

import os
from collections.abc import Callable

from ....protocol.board import TICK_HZ
from ..bench import Bench
from ..cases import Inconclusive

STRETCHES = 4
CATCHES_UP = 3
"""A simulated device that lags catches up; it is never this many times as fast as the host's clock."""


def load_average() -> float | None:
    """The load average of this computer over a minute, if its system has one."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


def unless_busy(bench: Bench, what: str) -> None:
    """Continue to judge a delay, unless this computer alone may have caused it: more programs run than it has cores."""
    load, cores = load_average(), os.cpu_count() or 1
    if bench.is_far and load is not None and load > cores:
        raise Inconclusive(f"{what}, on a computer with a load of {load:.1f} on {cores} cores: it cannot judge that")


def compare_clocks(bench: Bench, meanwhile: Callable[[], object], tolerance: float) -> None:
    """Fail if the device's ticks over some time do not match the host's clock, within a relative tolerance.

    Both clocks are right if they agree at once. A wrong clock is wrong by the same share again. A busy computer delays
    the host, or a simulated device, by another time at each attempt: then it is inconclusive.
    """
    told: list[str] = []
    rates: list[float] = []
    for _ in range(STRETCHES if bench.is_far else 1):
        now = bench.line.time.monotonic
        earliest = now()
        first = bench.clock().now
        latest = now()
        meanwhile()
        at_least = now() - latest
        second = bench.clock().now
        at_most = now() - earliest
        passed = (second - first) / TICK_HZ
        if at_least * (1 - tolerance) <= passed <= at_most * (1 + tolerance):
            break
        told.append(
            f"{second - first} ticks ({passed:.6f} s) have passed on the device, while the host saw {at_least:.6f} to "
            f"{at_most:.6f} s pass"
        )
        rates.append(passed / at_most)
        may_be_held_up = bench.is_far and 0 < passed < CATCHES_UP * at_most
        assert may_be_held_up, told[-1]
    else:
        assert max(rates) - min(rates) > tolerance, told[-1]
    middle = (at_least + at_most) / 2
    ppm, error = 1e6 * (passed / middle - 1), 5e5 * (at_most - at_least) / middle
    bench.note("device clock against the host's", f"{ppm:+.1f} ± {error:.1f} ppm")
    if told:
        raise Inconclusive(f"the two clocks differ by another share each time, on a busy computer: {'; '.join(told)}")
