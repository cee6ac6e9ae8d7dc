"""Compiled kernels of `batches`: they judge and plan many updates by the rules for one, and sort their pulses."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.compiling import kernel
from ...protocol.board import CYCLES_PER_PERIOD
from ...protocol.numbering import follows, missing
from .admission import judge_numbers
from .planning import Rules, plan

__all__ = ["plan_updates", "sort_pulses"]

compiled_plan = kernel(plan)
compiled_judge_numbers = kernel(judge_numbers)
compiled_follows = kernel(follows)
compiled_missing = kernel(missing)


@kernel
def _total_drive(width: Any, power: Any) -> int:
    total = 0
    for ticks in width:
        total += power[ticks]
    return total


@kernel
def plan_updates(
    reasons: Any,
    restarts: Any,
    sequences: Any,
    requested: Any,
    widths: Any,
    power: Any,
    recent: Any,
    rules: tuple[int, ...],
    progress: tuple[int, ...],
    planned: Any,
) -> tuple[int, tuple[int, ...]]:
    """Judge and plan updates that arrive back to back, up to the first that is not quite regular.

    Parameters
    ----------
    reasons, restarts, sequences, requested : (k,) int
        The fields of `protocol.unpack_updates`; `requested` are the periods that they name.
    widths : (k, 320) uint8
        Widths of their pulses.
    power : (26,) int
        Power of a pulse of each width, in thousandths (clause SAF-006).
    recent : (q,) int64
        When the last q changes left or leave the queue of q places, oldest first; written.
    rules : tuple
        The fields of `Rules`. A named tuple would cost numba 30 µs at each call.
    progress : tuple
        The fields of `Progress`, up to the update before them.
    planned : (5, k) int64
        Output: when each has arrived, when it goes onto the chain, the period that it gets, how many numbers were left
        out before it, and the free places of the queue when it was judged, itself included.

    Returns
    -------
    int
        How many of them were taken.
    tuple
        The fields of `Progress`, up to the last of these.
    """
    by = Rules(*rules)
    now, number, named, sent, period, table = progress
    arrivals, starts, periods, gaps, free = planned
    places = recent.size
    index = 0
    while index < reasons.size:
        sequence, asked = sequences[index], requested[index]
        arrival = max(now + by.packet, recent[0])
        if reasons[index] != 0 or restarts[index] or arrival > by.end:
            break
        drive = _total_drive(widths[index], power)
        furthest = (arrival - by.origin) // CYCLES_PER_PERIOD + by.horizon
        in_order = compiled_follows(sequence, number)
        if compiled_judge_numbers(in_order, asked, furthest, named, by.periods_per_update, drive, by.limit) != 0:
            break
        ready = arrival + by.sort
        start, period = compiled_plan(by.origin, ready, sent, table, period, asked, by.forward, by.lead)
        table, sent = period, start + by.occupies
        queued = 1
        for place in range(places - 1):
            recent[place] = recent[place + 1]
            queued += recent[place] > arrival
        recent[places - 1] = start
        arrivals[index], starts[index], periods[index], free[index] = arrival, start, period, places - queued
        gaps[index], number = compiled_missing(sequence, number), sequence
        if asked:
            named = asked
        now = arrival
        index += 1
    return index, (now, number, named, sent, period, table)


@kernel
def sort_pulses(payloads: Any, transducers: Any, sorted_payloads: Any) -> None:
    """Bring pulses of 12 bits from array order into the order of the channels.

    Parameters
    ----------
    payloads : (k, 480) uint8
        Packed as in blocks.
    transducers : (320,) int64
        Transducer of each channel.
    sorted_payloads : (k, 480) uint8
        The result, written here.
    """
    for row in range(payloads.shape[0]):
        for pair in range(transducers.size // 2):
            both = np.uint32(0)
            for odd in range(2):
                transducer = transducers[2 * pair + odd]
                at = transducer // 2 * 3
                if transducer % 2:
                    pulse = np.uint32(payloads[row, at + 1]) >> np.uint32(4) | np.uint32(
                        payloads[row, at + 2]
                    ) << np.uint32(4)
                else:
                    pulse = np.uint32(payloads[row, at]) | np.uint32(payloads[row, at + 1] & 15) << np.uint32(8)
                both |= pulse << np.uint32(12 * odd)
            sorted_payloads[row, 3 * pair] = both & np.uint32(0xFF)
            sorted_payloads[row, 3 * pair + 1] = both >> np.uint32(8) & np.uint32(0xFF)
            sorted_payloads[row, 3 * pair + 2] = both >> np.uint32(16)
