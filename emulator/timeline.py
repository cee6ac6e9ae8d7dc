"""The picture of an update's way through the device: what is busy when, from the packet on USB to the ports.

It draws spans that a trace has found, or a plan foretells, and knows nothing of how they came about.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from ..base.pictures import LANDSCAPE, new_figure
from ..protocol.blocks import Block, Update, pack
from ..protocol.board import CHANNELS, CORE_HZ, CYCLES_PER_PERIOD, MAX_WIDTH_TICKS
from ..protocol.codes import REQUEST_TYPE_OUT, Request, StandardRequest
from ..protocol.enumeration import CONFIGURATION_VALUE, ENDPOINT_OUT
from ..protocol.pulses import Pulses
from ..protocol.requests import Setup
from ..protocol.timing import PACKET_CYCLES
from .machine import Emulator
from .trace import Span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_timeline", "way_of_an_update"]

CYCLES_PER_MICROSECOND = CORE_HZ // 10**6
LANE_INCHES, FRAME_INCHES = 0.14, 1.2
GAP = 0.8  # between groups of lanes, in lanes
MOST_BOUNDARIES = 16
CHARACTER_POINTS = 4.2  # of small text
POINTS_PER_INCH = 72

COLOURS = {
    "packet": "#4477aa",
    "sort": "#66a3d2",
    "slice": "#228833",
    "commit": "#ee7733",
    "mailbox": "#b5d9a8",
    "rasterise": "#aa3377",
    "waits": "#e8c5d9",
    "plays": "#ccbb44",
}
OTHER_COLOUR = "#999999"
DARK = {"packet", "slice", "rasterise"}


def way_of_an_update(emulator: Emulator) -> list[Span]:
    """Send one update to a device that nothing else is sent to, and watch it to one period after it began to play.

    Returns
    -------
    list of Span
        Spans whose time 0 is when its first bit was sent.
    """
    emulator.usb.control(Setup(0x00, StandardRequest.SET_CONFIGURATION, CONFIGURATION_VALUE, 0, 0))
    emulator.usb.control(Setup(REQUEST_TYPE_OUT, Request.ENABLE, 0, 0, 0))
    emulator.watch()
    begins = emulator.scheduler.now
    emulator.scheduler.run_until(begins + PACKET_CYCLES)
    full = Pulses([MAX_WIDTH_TICKS] * CHANNELS, [MAX_WIDTH_TICKS] * CHANNELS)
    emulator.usb.bulk_out(ENDPOINT_OUT, pack(Block(Update(full), 0, restart=True)))
    plays = emulator.running.tail_period
    emulator.run_until(plays + 1)
    since = begins - emulator.tracer.origin
    return [
        span._replace(begins=span.begins - since, ends=span.ends - since)
        for span in emulator.tracer.spans(emulator.scheduler.now)
    ]


def draw_timeline(spans: Sequence[Span], title: str = "") -> Figure:
    """Draw spans over time, with the boundaries of periods.

    Parameters
    ----------
    spans : sequence of Span
        What to draw, in any order. Groups of lanes stand in the order in which they first become busy, and lanes of a
        group in that of their numbers.
    title : str
        Over the picture.

    Raises
    ------
    ValueError
        If there is none, or none takes any time.
    """
    begins, ends = min((span.begins for span in spans), default=0), max((span.ends for span in spans), default=0)
    if ends <= begins:
        raise ValueError("a time line without a span that takes time has nothing to show")
    rows = _rows(spans)
    figure = new_figure(FRAME_INCHES + LANE_INCHES * (max(rows.values()) + 1), LANDSCAPE)
    axes = figure.subplots()
    for kind in dict.fromkeys(span.kind for span in sorted(spans)):
        of_kind = [span for span in spans if span.kind == kind]
        axes.barh(
            [rows[span.lane] for span in of_kind],
            [_microseconds(span.ends - span.begins) for span in of_kind],
            left=[_microseconds(span.begins - begins) for span in of_kind],
            height=0.84,
            color=COLOURS.get(kind, OTHER_COLOUR),
            edgecolor="white",
            linewidth=0.3,
            label=kind,
        )
    _write_labels(axes, spans, rows, begins, ends)
    _mark_boundaries(axes, begins, ends)
    _name_lanes(axes, rows)
    axes.set(
        xlabel="time / µs",
        xlim=(0, _microseconds(ends - begins)),
        ylim=(max(rows.values()) + 0.7, -0.7),
    )
    axes.spines[["left", "right", "top"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=len(COLOURS) + 1, frameon=False, fontsize="small")
    figure.suptitle(title)
    return figure


def _microseconds(cycles: int) -> float:
    return cycles / CYCLES_PER_MICROSECOND


def _rows(spans: Iterable[Span]) -> dict[str, float]:
    """Where each lane stands, from the top."""
    by_time = sorted(spans)
    groups = list(dict.fromkeys(_group(span.lane) for span in by_time))
    lanes = sorted({(groups.index(_group(span.lane)), _number(span.lane), span.lane) for span in by_time})
    return {lane: row + GAP * group for row, (group, _, lane) in enumerate(lanes)}


def _group(lane: str) -> str:
    """A lane without its number."""
    return lane.rstrip("0123456789").rstrip()


def _number(lane: str) -> int:
    return int(lane.removeprefix(_group(lane)) or 0)


def _write_labels(axes: Axes, spans: Iterable[Span], rows: dict[str, float], begins: int, ends: int) -> None:
    """Write into each bar as much of what it says as has room."""
    points_per_cycle = 0.9 * LANDSCAPE * POINTS_PER_INCH / (ends - begins)
    for span in spans:
        cycles = span.ends - span.begins
        room = cycles * points_per_cycle / CHARACTER_POINTS
        texts = (f"{span.label}, {_microseconds(cycles):.3g} µs", span.label, span.label.split()[-1])
        text = next((text for text in texts if len(text) <= room), None)
        if text is None:
            continue
        middle = _microseconds(span.begins - begins) + _microseconds(cycles) / 2
        axes.text(
            middle,
            rows[span.lane],
            text,
            ha="center",
            va="center_baseline",
            fontsize="small",
            color="white" if span.kind in DARK else "black",
        )


def _mark_boundaries(axes: Axes, begins: int, ends: int) -> None:
    """Draw a line at each boundary of a period, or at every so many if they would be too dense."""
    boundaries = range(-(-begins // CYCLES_PER_PERIOD), ends // CYCLES_PER_PERIOD + 1)
    for period in boundaries[:: 1 + len(boundaries) // MOST_BOUNDARIES]:
        at = _microseconds(period * CYCLES_PER_PERIOD - begins)
        axes.axvline(at, color="0.35", linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)
        axes.annotate(
            f"period {period}",
            (at, 1),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            fontsize="small",
            color="0.35",
        )


def _name_lanes(axes: Axes, rows: dict[str, float]) -> None:
    """Write lanes' numbers on the axis and the names of their groups before them."""
    axes.set_yticks(list(rows.values()), [lane.removeprefix(_group(lane)).strip() for lane in rows])
    axes.tick_params(axis="y", length=0, labelsize="small", pad=1)
    for group, lanes in groupby(rows, key=_group):
        places = [rows[lane] for lane in lanes]
        axes.annotate(
            group,
            (0, (places[0] + places[-1]) / 2),
            xycoords=("axes fraction", "data"),
            xytext=(-14, 0),
            textcoords="offset points",
            ha="right",
            va="center",
        )
