"""Pulses of a given total drive, by the formula of clause SAF-006 and not by a device's table."""

from __future__ import annotations

from functools import cache

from ..dialogue import POWERS

FULL_WIDTH, FULL_POWER = 25, 1000
MOST_BY_SEARCH = 3001
"""Totals up to this use any widths; the rest of larger ones is full pulses."""


def power(width: int) -> int:
    """The power of a pulse, in thousandths of one of 25 ticks, by the formula of clause SAF-006."""
    return int(POWERS[width])


@cache
def _last_widths() -> list[int]:
    """For each total up to the greatest, the width of one of the fewest pulses that make it up; 0 if none do."""
    most = MOST_BY_SEARCH
    fewest, last = [0] + [most] * most, [0] * (most + 1)
    powers = [(width, power(width)) for width in range(1, 26)]
    for total in range(1, most + 1):
        fewest[total], last[total] = min(
            ((fewest[total - part] + 1, width) for width, part in powers if part <= total), default=(most, 0)
        )
    return last


def widths_for(total: int) -> list[int]:
    """Nearly the fewest widths whose powers make up a total in thousandths."""
    full = max(total - MOST_BY_SEARCH + FULL_POWER - 1, 0) // FULL_POWER
    widths, left = [FULL_WIDTH] * full, total - full * FULL_POWER
    while left:
        widths.append(_last_widths()[left])
        left -= power(widths[-1])
    return widths
