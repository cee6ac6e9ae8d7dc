"""The command that computes the capacity of the hardware: ``budget``."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Column, Table

from ..base.pictures import check_picture_path, new_figure, save_figure
from ..base.storage import check_outputs
from ..protocol.board import CORE_HZ
from ..protocol.chain import LOAD_BYTES
from ..protocol.codes import ENTRIES_PER_BLOCK, SAMPLES_PER_BLOCK, Kind, Memory
from ..protocol.timing import (
    FIVE_WIRE,
    HOP_CYCLES,
    LINKS,
    PROCESSOR_MEMORY,
    PROCESSOR_MEMORY_BYTES,
    Budget,
    block_loads,
)
from .console import JsonOption, among, console_for, write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["commands", "draw_budget"]

commands = typer.Typer(rich_markup_mode=None)

CYCLES_PER_MICROSECOND = CORE_HZ // 10**6
BAR = 20  # characters
LONGEST_HOP_NS = 1e6
BLOCKS = {
    Kind.SLOT.name: (1, Memory.SLOTS),
    Kind.ENTRIES.name: (ENTRIES_PER_BLOCK, Memory.ENTRIES),
    Kind.SAMPLES.name: (SAMPLES_PER_BLOCK, Memory.SAMPLES),
}
"""The items of each memory that a full block of each kind stores."""


@commands.command(epilog="Example: phasewire budget --link 2wire --picture budget.png")
def budget(
    link: Annotated[
        str,
        typer.Option(
            "--link", metavar="LINK", help=f"Links of the chain: {' or '.join(LINKS)}.", autocompletion=among(LINKS)
        ),
    ] = FIVE_WIRE.name,
    cycles_per_symbol: Annotated[
        int, typer.Option("--cycles-per-symbol", metavar="N", help="Core cycles from symbol to symbol, at least 2.")
    ] = FIVE_WIRE.cycles_per_symbol,
    token_delay: Annotated[
        int, typer.Option("--token-delay", metavar="N", help="Core cycles added after each token of a link.")
    ] = FIVE_WIRE.token_delay,
    hop_ns: Annotated[
        float, typer.Option("--hop-ns", metavar="X", help="Delay of a switch in ns, which no document states.")
    ] = HOP_CYCLES * 1000 / CYCLES_PER_MICROSECOND,
    baud: Annotated[
        int | None, typer.Option("--baud", metavar="N", help="Blocks come by a serial line of N baud instead of USB.")
    ] = None,
    json_target: JsonOption = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Also draw the time line: .png, .svg or .pdf.")
    ] = None,
) -> None:
    """Show how long an update takes from the host to the outputs, the highest rate, and the bottleneck.

    Times are those of the hardware's documents if these state any, and otherwise estimates of firmware and switches;
    the emulator uses the same times.
    """
    if picture is not None:
        check_picture_path(picture)
    check_outputs([picture, json_target])
    if link not in LINKS:
        raise ValueError(f"unknown link {link!r}; known are {', '.join(LINKS)}")
    if not 0 <= hop_ns <= LONGEST_HOP_NS:
        raise ValueError(f"a switch cannot delay by {hop_ns:g} ns; 0 to {LONGEST_HOP_NS:.0f}")
    chosen = replace(LINKS[link], cycles_per_symbol=cycles_per_symbol, token_delay=token_delay)
    hop_cycles = math.ceil(hop_ns * CYCLES_PER_MICROSECOND / 1000)
    found = Budget.of(chosen, hop_cycles=hop_cycles, baud=baud)

    out = console_for(json_target)
    _print_time_line(out, found)
    _print_rates(out, found)
    _print_threads(out, found)
    if picture is not None:
        save_figure(draw_budget(found), picture)
        out.print(f"Drawn to {picture}.")
    write_json(json_target, _record(found))


def _unit(found: Budget) -> tuple[str, int]:
    """The unit of a time line, and its core cycles."""
    slow = found.worst_cycles >= CORE_HZ // 100
    return ("ms", CORE_HZ // 1000) if slow else ("µs", CYCLES_PER_MICROSECOND)


def _table(*headers: str) -> Table:
    """An empty table, narrow enough for 80 columns: a name, numbers, and a bar."""
    left, *numbers, last = headers
    columns = (Column(header, justify="right", no_wrap=True) for header in numbers)
    return Table(left, *columns, Column(last, no_wrap=True), box=None, padding=(0, 2, 0, 0), pad_edge=False)


def _bar(begins: int, ends: int, whole: int, mark: str) -> str:
    """A span of a time line in characters; at least one, however short."""
    first = min(begins * BAR // whole, BAR - 1)
    return " " * first + mark * max(1, -(-ends * BAR // whole) - first)


def _print_time_line(out: Console, found: Budget) -> None:
    link = found.link
    nanoseconds = link.cycles_per_token * 1000 / CYCLES_PER_MICROSECOND
    out.print(f"An update over {link.wires}-wire links of {nanoseconds:g} ns a token, from the first bit:\n")
    unit, cycles_per_unit = _unit(found)
    digits = 2 if unit == "µs" else 3

    def told(cycles: int) -> str:
        return f"{cycles / cycles_per_unit:,.{digits}f}"

    table = _table("stage", f"from/{unit}", f"to/{unit}", f"takes/{unit}", "most/s", "# works  . waits")
    for stage in found.stages:
        mark = "." if stage is found.stages[-1] else "#"
        times = (told(cycles) for cycles in (stage.begins, stage.ends, stage.cycles))
        bar = _bar(stage.begins, stage.ends, found.worst_cycles, mark)
        table.add_row(stage.name, *times, f"{float(stage.updates_per_second):,.0f}", bar)
    out.print(table)
    out.print(
        f"\nFirst bit to first tick: {told(found.best_cycles)} {unit} at best; "
        f"{told(found.worst_cycles)} {unit} just missing a boundary."
    )


def _print_rates(out: Console, found: Budget) -> None:
    every = "every period" if found.periods_per_update == 1 else f"every {found.periods_per_update:,} periods"
    rate = float(found.updates_per_second)
    out.print(f"Bottleneck: {found.bottleneck.name}.")
    out.print(f"Sustained rate: {rate:,.6g} updates/s, one {every}.", style="bold")
    out.print(
        f"\nBesides them the chain carries {found.spare_loads:,} loads of {LOAD_BYTES} bytes between two updates:\n"
    )
    table = _table("block", "items", "loads", "takes", "")
    for name, (items, memory) in BLOCKS.items():
        loads = block_loads(items, memory)
        periods = found.periods_for(loads)
        table.add_row(name, str(items), str(loads), "never fits" if periods is None else f"{periods:,} periods", "")
    out.print(table)


def _print_threads(out: Console, found: Budget) -> None:
    out.print("\nThreads at this rate, estimated:\n")
    table = _table("of the", "cycles", "available", "share", "")
    for of in found.threads:
        name = f"{of.where}: {of.name}" + f" ×{of.threads}" * (of.threads > 1)
        share, bar = f"{of.cycles / of.available:.0%}", _bar(0, of.cycles, of.available, "#")
        table.add_row(name, f"{of.cycles:,}", f"{of.available:,}", share, bar)
    out.print(table)
    memory = sum(PROCESSOR_MEMORY.values())
    share = f"{memory / PROCESSOR_MEMORY_BYTES:.0%}"
    out.print(f"\nMemory of a processor: {memory:,} of {PROCESSOR_MEMORY_BYTES:,} bytes, {share}.")


def draw_budget(found: Budget) -> Figure:
    """The time line of an update that just misses a boundary, and the highest rate of each stage."""
    figure = new_figure(3.3)
    when, often = figure.subplots(1, 2, sharey=True, width_ratios=[2, 1])
    unit, cycles_per_unit = _unit(found)
    names = [stage.name for stage in found.stages]
    for row, stage in enumerate(found.stages):
        waits = stage is found.stages[-1]
        bar = when.barh(
            row,
            stage.cycles / cycles_per_unit,
            left=stage.begins / cycles_per_unit,
            color="none" if waits else f"C{row}",
            edgecolor="0.4" if waits else "none",
            hatch="///" if waits else None,
        )
        when.bar_label(bar, [f"{stage.cycles / cycles_per_unit:.3g} {unit}"], padding=3)
    for cycles, what, side in ((found.best_cycles, "at best ", "right"), (found.worst_cycles, " at worst", "left")):
        when.axvline(cycles / cycles_per_unit, color="0.3", linestyle="--", linewidth=1)
        when.text(cycles / cycles_per_unit, -0.75, what, ha=side, va="center", color="0.3")
    when.set(
        title="Time from the first bit to the first tick\nof an update that just misses a boundary",
        xlabel=f"time / {unit}",
        xlim=(0, 1.25 * found.worst_cycles / cycles_per_unit),
        yticks=range(len(names)),
        yticklabels=names,
        ylim=(len(names) - 0.5, -1.1),
    )
    rates = [float(stage.updates_per_second) / 1000 for stage in found.stages]
    bars = often.barh(range(len(rates)), rates, color=[f"C{row}" for row in range(len(rates))])
    often.bar_label(bars, [f"{rate:.3g}" for rate in rates], padding=3)
    often.axvline(float(found.updates_per_second) / 1000, color="k", linestyle="--", linewidth=1)
    often.set(
        title="Highest rate of each stage\n(dashed: rate of the whole chain)",
        xlabel="thousand updates per second",
        xlim=(0, 1.25 * max(rates)),
        ylim=when.get_ylim(),
    )
    often.tick_params(axis="y", length=0)
    figure.suptitle(
        f"{found.link.wires}-wire links: {float(found.updates_per_second):,.6g} updates/s, "
        f"bottleneck: {found.bottleneck.name}"
    )
    return figure


def _record(found: Budget) -> dict[str, Any]:
    def seconds(cycles: int) -> float:
        return cycles / CORE_HZ

    return {
        "format": "phasewire-budget-1",
        "link": asdict(found.link) | {"seconds_per_token": seconds(found.link.cycles_per_token)},
        "stages": [
            {
                "name": stage.name,
                "begins_s": seconds(stage.begins),
                "ends_s": seconds(stage.ends),
                "updates_per_second": float(stage.updates_per_second),
            }
            for stage in found.stages
        ],
        "best_s": seconds(found.best_cycles),
        "worst_s": seconds(found.worst_cycles),
        "bottleneck": found.bottleneck.name,
        "periods_per_update": found.periods_per_update,
        "updates_per_second": float(found.updates_per_second),
        "spare_loads": found.spare_loads,
        "blocks": {
            name: {"loads": block_loads(items, memory), "periods": found.periods_for(block_loads(items, memory))}
            for name, (items, memory) in BLOCKS.items()
        },
        "threads": [threads._asdict() for threads in found.threads],
        "memory_bytes": PROCESSOR_MEMORY,
    }
