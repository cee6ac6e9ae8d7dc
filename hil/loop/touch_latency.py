"""The latency from the time stamp of a hand to the first tick of its field, by stage.

The host's stages are measured by this computer's wall clock. The emulated device's stages are measured by its own
clock, which stands still while the host works, so both are put one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.pictures import BLUE, GREEN, ORANGE, new_figure
from ...emulator import Emulator
from ...emulator.trace import Span
from ...host import Device, open_device
from ...protocol.board import CORE_HZ
from ...protocol.pulses import Pulses
from ...protocol.quantise import quantise
from ...solver import TransducerArray, TwoSidedSolver
from ...solver.contact.hand import Hand
from ...solver.contact.mesh import Mesh
from ...solver.contact.touch import Toucher

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["STAGES", "TouchLatency", "draw_touch_latency", "measure_touch_latency"]

STAGES = ("cut", "solve", "quantise", "send")
"""Stages of the host: hands to control points; points to two drives; drives to pulses; a block to the bus."""

NAMES = ("hand to control points", "two fields are solved", "drives to pulses", "block to the bus")

POSES = 300
WARM_UP_POSES = 20
SWAY = 2e-3  # metres by which the hands move to and fro, so that no pose was solved before
SWAY_POSES = 50  # to and fro
POSE_SECONDS = 1e-3
COLOURS = {"host": ORANGE, "USB": BLUE, "device": GREEN}
MICROSECONDS = 1e6
DEVICE_ROWS = (
    ("packet on the bus", "USB", ("packet",)),
    ("controller sorts", "device", ("sort",)),
    ("chain carries slices", "device", ("slice", "commit")),
    ("processors rasterise", "device", ("rasterise",)),
    ("waits for its period", "device", ("waits",)),
)
"""Rows of the picture: name, place, and the kinds of spans."""


class LatencyStage(NamedTuple):
    """One stage of the path, in seconds since the time stamp."""

    name: str
    where: str
    begins: float
    ends: float


@dataclass(frozen=True, eq=False)
class TouchLatency:
    """The path from hands to the outputs."""

    host: NDArray[np.float64]
    """(k, 4) float; seconds of each of `STAGES`, for each of k poses."""
    device: tuple[Span, ...]
    """The busy spans of the device for the last pose, with 0 when the bus began to carry its block."""
    points: int
    """Control points of the last pose."""

    @property
    def first_tick(self) -> float:
        """Seconds from the block's first bit on the bus to the first tick of the new field on the last port."""
        return max(span.begins for span in self.device if span.kind == "plays") / CORE_HZ

    @property
    def total(self) -> NDArray[np.float64]:
        """Seconds from the time stamp to the first tick, for each pose, (k,)."""
        return np.asarray(self.host.sum(axis=1) + self.first_tick)

    def rows(self) -> list[LatencyStage]:
        """The path, stage by stage: the host's medians, then the device's, from the first begin of any to the last end.

        Stages of the device overlap: each processor continues as soon as it has its part.
        """
        ends = np.cumsum(np.median(self.host, axis=0)).tolist()
        begins = [0.0, *ends[:-1]]
        rows = [LatencyStage(name, "host", *times) for name, *times in zip(NAMES, begins, ends, strict=True)]
        for name, where, kinds in DEVICE_ROWS:
            spans = [span for span in self.device if span.kind in kinds]
            first, last = min(span.begins for span in spans), max(span.ends for span in spans)
            rows.append(LatencyStage(name, where, ends[-1] + first / CORE_HZ, ends[-1] + last / CORE_HZ))
        return rows

    def record(self) -> dict[str, Any]:
        """The figures, for JSON."""
        stages = dict(zip(STAGES, self.host.T, strict=True))
        return {
            "poses": len(self.host),
            "points": self.points,
            "stages": {name: _quantiles(seconds) for name, seconds in stages.items()},
            "first_tick_s": self.first_tick,
            "total": _quantiles(self.total),
        }


def measure_touch_latency(
    hands: Sequence[Hand], objects: Sequence[Mesh], toucher: Toucher, *, method: str = "wgs", poses: int = POSES
) -> TouchLatency:
    """Move hands that touch objects a little, and follow each pose to the outputs of a fresh emulated device.

    The toucher's state of earlier frames is reset. Raises `ValueError` if nothing is touched, or the array cannot reach
    it.
    """
    toucher.forget()
    solver, rows = TwoSidedSolver(TransducerArray.grid(), method), []
    with Emulator() as emulator, open_device(emulator.url) as device:
        for number in range(WARM_UP_POSES + poses):
            sway = np.array([0, 0, SWAY * np.sin(2 * np.pi * number / SWAY_POSES)])
            moved = [Hand(hand.landmarks + sway, hand.side) for hand in hands]
            device.time.sleep(POSE_SECONDS)
            if number == WARM_UP_POSES + poses - 1:
                emulator.watch()
            begins = emulator.scheduler.now
            row, points = _follow(moved, objects, toucher, solver, device, emulator, number % 2)
            rows.append(row)
        emulator.run_until(emulator.running.tail_period + 1)
        origin, now = emulator.tracer.origin, emulator.scheduler.now
    since = begins - origin
    spans = [
        span._replace(begins=span.begins - since, ends=span.ends - since)
        for span in emulator.tracer.spans(now)
        if span.begins >= since
    ]
    return TouchLatency(np.array(rows[WARM_UP_POSES:]), tuple(spans), points)


def _follow(
    hands: Sequence[Hand],
    objects: Sequence[Mesh],
    toucher: Toucher,
    solver: TwoSidedSolver,
    device: Device,
    emulator: Emulator,
    half: int,
) -> tuple[list[float], int]:
    """Seconds of each stage of one pose, and its number of control points."""
    marks = [perf_counter()]
    touch = toucher.touch(hands, objects)
    marks.append(perf_counter())
    if touch.points is None:
        raise ValueError("no hand touches an object: there is no field to wait for")
    drives = solver.solve(touch.points).drives
    marks.append(perf_counter())
    frames = quantise(drives)
    pulses = Pulses(frames.phase[half], frames.width[half])
    marks.append(perf_counter())
    # The device's time advances when the bus begins to carry the block.
    emulator.scheduler.at(emulator.scheduler.now + 1, lambda: marks.append(perf_counter()))
    device.show(pulses)
    return np.diff(marks).tolist(), len(touch.points)


def draw_touch_latency(latency: TouchLatency) -> Figure:
    """The time line from the time stamp to the outputs: the median of the host's stages, then those of the device."""
    rows = latency.rows()
    end = rows[-1].ends * MICROSECONDS
    figure = new_figure(3.6)
    axes = figure.subplots()
    for number, row in enumerate(rows):
        waits = row is rows[-1]
        begins, ends = row.begins * MICROSECONDS, row.ends * MICROSECONDS
        axes.barh(
            number,
            ends - begins,
            left=begins,
            color="none" if waits else COLOURS[row.where],
            edgecolor="0.4" if waits else "none",
            hatch="///" if waits else None,
            label=None if waits or any(row.where == before.where for before in rows[:number]) else row.where,
        )
        late = begins > end / 2
        axes.annotate(
            f"{ends - begins:.3g} µs",
            (begins if late else ends, number),
            xytext=(-4 if late else 4, 0),
            textcoords="offset points",
            ha="right" if late else "left",
            va="center",
        )
    axes.axvline(end, color="0.3", linestyle="--", linewidth=1)
    axes.text(end, -0.8, "first tick ", ha="right", va="center", color="0.3")
    axes.set(
        xlabel="time since the time stamp of the hand / µs",
        xlim=(0, 1.02 * end),
        yticks=range(len(rows)),
        yticklabels=[row.name for row in rows],
        ylim=(len(rows) - 0.5, -1.3),
    )
    axes.tick_params(axis="y", length=0)
    axes.spines[["right", "top"]].set_visible(False)
    axes.legend(loc="lower left", frameon=False)
    total = _quantiles(latency.total)
    figure.suptitle(
        f"From the time stamp of a hand to the first tick of its field: {total['median_s'] * 1e3:.2f} ms median, "
        f"{total['p99_s'] * 1e3:.2f} ms 99 %\n{latency.points} control points; host: medians of "
        f"{len(latency.host)} poses on this computer; device: emulated",
        fontsize="medium",
    )
    return figure


def _quantiles(seconds: NDArray[np.float64]) -> dict[str, float]:
    return {
        "median_s": float(np.median(seconds)),
        "p99_s": float(np.quantile(seconds, 0.99)),
        "worst_s": float(seconds.max()),
    }
