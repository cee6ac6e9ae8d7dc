"""The expected trace of one update, message by message, by chapter BUD and clause CHN-006."""

from __future__ import annotations

from phasewire.emulator.trace import Span
from phasewire.protocol.board import CYCLES_PER_PERIOD, PROCESSORS
from phasewire.protocol.timing import HOP_CYCLES, PACKET_CYCLES, RASTERISE_CYCLES, SORT_CYCLES, Budget, Link

SLICE_TOKENS, COMMIT_TOKENS = 52, 16


def one_update(link: Link, begins: int, shown_periods: int = 1) -> list[Span]:
    """Spans of an update on an idle chain, whose packet begins at a core cycle, to some periods after its boundary."""
    boundary = Budget.of(link).first_period(begins) * CYCLES_PER_PERIOD
    sorted_at = begins + PACKET_CYCLES + SORT_CYCLES
    spans = [
        Span(begins, begins + PACKET_CYCLES, "USB", "packet"),
        Span(begins + PACKET_CYCLES, sorted_at, "controller", "sort"),
    ]
    leaves, has_slice = sorted_at, dict[int, int]()
    for kind, tokens in (("slice", SLICE_TOKENS), ("commit", COMMIT_TOKENS)):
        for node in range(PROCESSORS):
            takes = tokens * link.cycles_per_token
            for hop in range(node + 1):
                from_there = leaves + hop * HOP_CYCLES
                spans.append(Span(from_there, from_there + takes, f"link {hop}", f"{kind} {node}"))
            leaves += takes
            arrives = leaves + (node + 1) * HOP_CYCLES
            if kind == "slice":
                has_slice[node] = arrives
                continue
            ready = arrives + RASTERISE_CYCLES
            spans += [
                Span(has_slice[node], arrives, f"mailbox {node}", "mailbox"),
                Span(arrives, ready, f"processor {node}", "rasterise"),
                Span(ready, boundary, f"processor {node}", "waits"),
                Span(boundary, boundary + shown_periods * CYCLES_PER_PERIOD, f"port {node}", "plays"),
            ]
    return spans
