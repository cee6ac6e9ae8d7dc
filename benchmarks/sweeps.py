"""How well a sweep uses two cores: one row after the other against two threads and two processes, in one run.

Efficiency is the time of one row after the other over twice that of two workers: with their start, and without it, when
a tenth of the rows is done. Two plain processes that share the rows without Dask are the limit of the machine. Run it
on a quiet machine with two cores or more: what else runs there takes time from two workers, not from one.
"""

from __future__ import annotations

import os
import resource
import statistics
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

from bench import machine, options, record
from phasewire.hil.sweep import Sweep, measure, read_sweep, run_sweep
from threadpoolctl import threadpool_limits

ROWS, REPEATS, GOAL = 600, 3, 0.9
STARTED = 0.1  # of the rows, after which all workers have begun
TEXT = """
source = "circle:radius=0.03"
quantisation = "pulses"
phase_error_deg = 20
[grid]
seed = {{from = 1, to = {rows}, count = {rows}}}
"""


def of(rows: int) -> Sweep:
    """A sweep of so many rows."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.toml"
        path.write_text(TEXT.format(rows=rows))
        return read_sweep(path)


def processor_seconds() -> float:
    """Of this process and of its children that have ended."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def swept(sweep: Sweep, on: str) -> dict[str, float]:
    """Seconds of a sweep, its rows in a second when all workers have begun, and its processor seconds."""
    ends: list[float] = []
    begun, used = perf_counter(), processor_seconds()
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "r.parquet"
        workers = None if on == "serial" else 2
        run_sweep(sweep, output, on=on, workers=workers, on_row=lambda *_: ends.append(perf_counter()))
    first = int(STARTED * len(ends))
    return {
        "seconds": perf_counter() - begun,
        "rate": (len(ends) - 1 - first) / (ends[-1] - ends[first]),
        "processor_seconds": processor_seconds() - used,
    }


def share(rows: int, first: int) -> tuple[float, float]:
    """When every second row of a sweep was done from a tenth on, and how many they were in a second."""
    sweep, ends = of(rows), []
    with threadpool_limits(1):
        for design in sweep.designs[first::2]:
            measure(design, sweep.points[design.source])
            ends.append(perf_counter())
    begun = int(STARTED * len(ends))
    return ends[-1], (len(ends) - 1 - begun) / (ends[-1] - ends[begun])


def apart(rows: int) -> dict[str, float]:
    """The same for two processes that know nothing of each other."""
    begun, used = perf_counter(), processor_seconds()
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        done = list(pool.map(share, [rows] * 2, range(2)))
    return {
        "seconds": max(end for end, _ in done) - begun,
        "rate": sum(rate for _, rate in done),
        "processor_seconds": processor_seconds() - used,
    }


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--rows", type=int, default=ROWS)
    parser.add_argument("--repeats", type=int, default=REPEATS)
    arguments = parser.parse_args()
    sweep = of(arguments.rows)
    swept(of(2), "serial")  # loads the kernels
    ways: dict[str, Callable[[], dict[str, float]]] = {
        "serial": lambda: swept(sweep, "serial"),
        "threads": lambda: swept(sweep, "threads"),
        "processes": lambda: swept(sweep, "processes"),
        "two apart": lambda: apart(arguments.rows),
    }
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(machine(load))
    runs = [{name: way() for name, way in ways.items()} for _ in range(arguments.repeats)]
    print(f"{arguments.rows} rows on 2 workers, medians of {len(runs)}; goal {GOAL:.0%}\n")
    print(f"{'':12}{'s':>8}{'rows/s':>9}{'CPU s':>8}{'efficiency':>12}{'when begun':>12}")
    found = {}
    for name in ways:
        workers = 1 if name == "serial" else 2
        whole = [run["serial"]["seconds"] / run[name]["seconds"] / workers for run in runs]
        begun = [run[name]["rate"] / run["serial"]["rate"] / workers for run in runs]
        middle = {key: statistics.median(run[name][key] for run in runs) for key in runs[0][name]}
        found[name] = middle | {"efficiency": statistics.median(whole), "when_begun": statistics.median(begun)}
        print(
            f"{name:12}{middle['seconds']:>8.2f}{middle['rate']:>9.1f}{middle['processor_seconds']:>8.2f}"
            f"{found[name]['efficiency']:>12.0%}{found[name]['when_begun']:>12.0%}"
        )
    record(arguments.json, found)


if __name__ == "__main__":
    main()
