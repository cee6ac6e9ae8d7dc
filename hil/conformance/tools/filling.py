"""A queue full of future changes, which leave it in their time or all at once on DISABLE."""

from __future__ import annotations

from ....protocol.blocks import Update
from ....protocol.board import CARRIER_HZ, CHANNELS
from ....protocol.codes import Request
from ....protocol.framing import MAX_FRAME_BYTES
from ....protocol.pulses import Pulses
from ....protocol.replies import Ack
from ..bench import Bench
from ..cases import Inconclusive, expect
from ..transports.serial import RawSerialLine

__all__ = ["fill_queue"]

WATCHDOG_MS = 60_000
MOST_SECONDS = 5
FAR_TIMES = 5
"""The factor on that time for a real device, because the computer may be busy."""
FAR_SECONDS = 0.03
"""Time for a block and its acknowledgement over a line to a real device, at worst."""


def fill_queue(bench: Bench, seconds: float) -> list[Ack]:
    """Enable the outputs, and queue as many silent updates as there is room for; returns their acknowledgements.

    The queue is full for at least so many seconds before the first of them leaves it. It is inconclusive if filling
    takes too long over this line.
    """
    rooms, step = bench.info.queue_blocks, 10 * max(bench.info.periods_per_update, 1)
    carries = bench.line.transit(2 * MAX_FRAME_BYTES) if isinstance(bench.line, RawSerialLine) else 0.0
    fills = rooms * (carries + FAR_SECONDS)
    if fills > MOST_SECONDS:
        raise Inconclusive(f"to fill a queue of {rooms} changes over this line may take {fills:.0f} s")
    bench.order(Request.WATCHDOG, WATCHDOG_MS)
    bench.enable()
    first = bench.period() + round(CARRIER_HZ * (seconds * (FAR_TIMES if bench.is_far else 1) + fills))
    silence = Pulses.silent(CHANNELS)
    acks = [bench.must(Update(silence, first + step * number)) for number in range(rooms)]
    expect("the free places in the queue", acks[-1].free, 0)
    return acks
