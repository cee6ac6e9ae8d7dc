"""Cost and memory of updates and fields over n transducers and m points, against the arithmetic's floor.

It measures on one thread, each size in a process of its own, whose peak memory is that size's. Times are those of the
processor, the least of some calls, because other programs disturb them only upwards. It prints tables; ``--picture
FILE`` draws them, and ``--json FILE`` writes every number. The whole takes two minutes.

The floor is the arithmetic at the speed of a loop of multiply-adds, as in ``benchmarks/solver.py``. The crossovers are
where `BLOCKED_PAIRS` (solver/compiled/block_kernels.py) and `PAIRS_PER_SAMPLE` (solver/fields/field.py) come from.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np
from bench import machine, options, record
from phasewire import ControlPoints, Medium, Solver, TransducerArray, pressure
from phasewire.base.pictures import new_figure, save_figure
from phasewire.solver.compiled import block_kernels, layout, updates
from phasewire.solver.compiled.simd import LANES
from phasewire.solver.fields.field import PAIRS_PER_SAMPLE
from phasewire.solver.fields.grid import Grid
from phasewire.solver.fields.lattice import lattice_of, shifts_over, spectrum_size
from phasewire.solver.methods.engine import CompiledEngine

from solver import peak

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ARRAYS = {320: (20, 16), 1024: (32, 32), 4096: (64, 64), 16_384: (128, 128)}
COUNTS = (32, 64, 128, 256, 512, 1024)
CROSSINGS = {1024: (64, 96, 128, 192, 256, 384, 512), 4096: (16, 32, 48, 64, 96, 128, 192, 256)}
EXTENTS = (0.05, 0.1, 0.2, 0.4)
PER_PITCH = 10
DRAWN = (320, 16_384)
MOST_PAIRS = 1_000_000_000  # that a direct sum is timed for: a second
HEIGHT = 0.2
MODEL, WAY_BACK, STEPS = 40, 8, 20  # operations for an entry of the model and of a pass over B; steps of the phases
PATIENCE, LEAST_CALLS = 0.3, 2  # seconds, or calls, for one time
MAX_SECONDS = 120  # for one size
MB = 1e6
KEY = {
    "tikhonov; by blocks; FFT": "k-",
    "wgs; whole; direct sum": "k:",
    "floor; work space": "k--",
    "floor of the FFT": "k-.",
    "crossover; the line is the switch": "kx",
}
"""Of the picture: lines and their styles."""


def fastest(call: Callable[[], object]) -> float:
    """Least processor time of a call in seconds."""
    call()
    times: list[float] = []
    while sum(times) < PATIENCE or len(times) < LEAST_CALLS:
        before = process_time()
        call()
        times.append(process_time() - before)
    return min(times)


def memory() -> float:
    """The largest resident memory of this process until now, in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def cloud(array: TransducerArray, m: int) -> ControlPoints:
    """Points at random above an array."""
    half = 0.4 * np.ptp(array.positions, axis=0)[:2]
    low, high = [*-half, 0.15], [*half, 0.3]
    return ControlPoints(np.random.default_rng(1).uniform(low, high, (m, 3)))


def operations(n: int, m: int) -> float:
    """Of an update of tikhonov: model, Gram matrix, phases, factorisation, substitution and way back."""
    return MODEL * m * n + 4 * m * m * n + STEPS * 8 * m * m + 4 / 3 * m**3 + 8 * m * m + WAY_BACK * m * n


def update(n: int, m: int) -> dict[str, Any]:
    """Seconds of an update from scratch, and bytes that it takes."""
    array = TransducerArray.grid(*ARRAYS[n])
    points, few = cloud(array, m), cloud(array, 1)
    solvers = {method: Solver(array, method) for method in ("tikhonov", "wgs")}
    for solver in solvers.values():
        solver.solve(few)
    before, row = memory(), dict[str, Any](n=n, m=m)
    for method, solver in solvers.items():

        def solve(solver: Solver = solver) -> None:
            solver.forget()
            solver.solve(points)

        row[method] = fastest(solve)
        if method == "tikhonov":
            row |= {"bytes": memory() - before, "process": memory()}
    return row | {"work": 4 * layout.work_size(m, -(-n // LANES) * LANES)}


def crossing(n: int, m: int) -> dict[str, Any]:
    """Seconds from the transfer matrix to the phases, whole and by blocks."""
    array = TransducerArray.grid(*ARRAYS[n])
    solver = Solver(array, "tikhonov")
    engine = CompiledEngine(array, Medium(), "tikhonov", solver.options)
    engine.drive(cloud(array, m))
    settings = m, n, np.float32(0), STEPS, False, engine._phases[engine._last], engine._work  # γ = 0 leaves B as it is
    whole, blocks = fastest(lambda: updates.begin(*settings)), fastest(lambda: block_kernels.begin(*settings))
    return {"n": n, "m": m, "whole": whole, "blocks": blocks}


def plane(n: int, extent: float) -> dict[str, Any]:
    """Seconds of a plane by direct sum and by FFT with all that it needs for one drive."""
    array, air = TransducerArray.grid(*ARRAYS[n]), Medium()
    drive = np.exp(1j * np.arange(n) ** 2).astype(np.complex64)
    lattice = lattice_of(array)
    grid = Grid.horizontal(HEIGHT, extent, lattice.pitch / PER_PITCH)
    at = grid.positions().reshape(-1, 3)
    size = math.prod(spectrum_size(lattice, grid.counts, PER_PITCH)) * PER_PITCH**2
    before = memory()
    fft = fastest(lambda: shifts_over(lattice_of(array), grid, HEIGHT, PER_PITCH, air, "single")(drive))
    row = {"n": n, "samples": len(at), "pairs": len(at) * n, "size": size, "fft": fft, "bytes": memory() - before}
    if len(at) * n <= MOST_PAIRS:
        row["direct"] = fastest(lambda: pressure(array, drive, at, air, "single"))
    once, many = MODEL + WAY_BACK, 3 * 5 * math.log2(size / PER_PITCH**2)  # of a transform and the way back
    return row | {"direct_operations": once * len(at) * n, "fft_operations": (once + many) * size}


JOBS: dict[str, Callable[..., dict[str, Any]]] = {
    "updates": update,
    "crossings": crossing,
    "planes": plane,
    "peak": lambda: {"flops": max(peak() for _ in range(3))},
}


def jobs() -> Iterator[tuple[str, tuple[float, ...]]]:
    """Names and arguments of all that is measured."""
    yield "peak", ()
    yield from (("updates", (n, m)) for n in ARRAYS for m in COUNTS)
    yield from (("crossings", (n, m)) for n, counts in CROSSINGS.items() for m in counts)
    yield from (("planes", (n, extent)) for n in ARRAYS for extent in EXTENTS)


def measure() -> dict[str, list[dict[str, Any]]]:
    """Every job in a process of its own, on one thread."""
    results: dict[str, list[dict[str, Any]]] = {name: [] for name in JOBS}
    alone = os.environ | {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    for name, arguments in jobs():
        command = [sys.executable, __file__, "--job", name, *map(str, arguments)]
        done = subprocess.run(command, env=alone, capture_output=True, text=True, timeout=MAX_SECONDS, check=False)
        if done.returncode:
            raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr}")
        results[name].append(json.loads(done.stdout))
    return results


def print_results(results: dict[str, list[dict[str, Any]]], flops: float) -> None:
    print("\nAn update from scratch, one thread; memory is what it adds to the process")
    print(f"{'n':>6}{'m':>6}{'tikhonov':>12}{'floor':>11}{'of peak':>9}{'wgs':>12}{'memory':>10}{'work space':>12}")
    for row in results["updates"]:
        floor = operations(row["n"], row["m"]) / flops
        print(
            f"{row['n']:>6}{row['m']:>6}{row['tikhonov'] * 1e3:>9.2f} ms{floor * 1e3:>8.2f} ms"
            f"{floor / row['tikhonov']:>9.0%}{row['wgs'] * 1e3:>9.2f} ms{row['bytes'] / MB:>7.0f} MB"
            f"{row['work'] / MB:>9.0f} MB"
        )
    print("\nFrom the transfer matrix to the phases")
    print(f"{'n':>6}{'m':>6}{'pairs':>10}{'whole':>12}{'blocks':>12}{'times as fast':>15}")
    for row in results["crossings"]:
        print(
            f"{row['n']:>6}{row['m']:>6}{row['n'] * row['m']:>10}{row['whole'] * 1e3:>9.3f} ms"
            f"{row['blocks'] * 1e3:>9.3f} ms{row['whole'] / row['blocks']:>15.2f}"
        )
    print("\nA plane for one drive")
    print(f"{'n':>6}{'samples':>9}{'pairs/size':>12}{'direct':>12}{'of peak':>9}{'FFT':>12}{'of peak':>9}{'memory':>9}")
    for row in results["planes"]:
        direct = row.get("direct", math.nan)
        print(
            f"{row['n']:>6}{row['samples']:>9}{row['pairs'] / row['size']:>12.0f}{direct * 1e3:>9.1f} ms"
            f"{row['direct_operations'] / flops / direct:>9.0%}{row['fft'] * 1e3:>9.1f} ms"
            f"{row['fft_operations'] / flops / row['fft']:>9.0%}{row['bytes'] / MB:>6.0f} MB"
        )


def draw(results: dict[str, list[dict[str, Any]]], flops: float, path: Path) -> None:
    """The picture: cost over m and over n, memory, and both sides of both crossovers."""
    figure = new_figure(5.4)
    (over_m, over_n), (space, key), (crossed, fields) = figure.subplots(3, 2)
    updates, colours = results["updates"], {n: f"C{index}" for index, n in enumerate(ARRAYS)}
    for n, colour in colours.items():
        rows = [row for row in updates if row["n"] == n]
        over_m.plot(COUNTS, [row["tikhonov"] for row in rows], f"{colour}-")
        over_m.plot(COUNTS, [row["wgs"] for row in rows], f"{colour}:")
        over_m.plot(COUNTS, [operations(n, row["m"]) / flops for row in rows], f"{colour}--", lw=0.8)
        space.plot(COUNTS, [row["bytes"] / MB for row in rows], f"{colour}-")
        space.plot(COUNTS, [row["work"] / MB for row in rows], f"{colour}--", lw=0.8)
    _label(over_m, "control points m", "time / s", "An update, over m", COUNTS)
    _label(space, "control points m", "memory / MB", "Peak memory of an update", COUNTS)
    space.set_ylim(1)
    for grey, m in zip(("0.7", "0.5", "0.3", "0"), (32, 128, 512, 1024), strict=True):
        rows = [row for row in updates if row["m"] == m]
        over_n.plot(tuple(ARRAYS), [row["tikhonov"] for row in rows], "-", color=grey)
        over_n.plot(tuple(ARRAYS), [operations(row["n"], m) / flops for row in rows], "--", color=grey, lw=0.8)
        over_n.annotate(f"m = {m}", (320, rows[0]["tikhonov"]), (0, 4), textcoords="offset points", fontsize="small")
    _label(over_n, "transducers n", "time / s", "An update of tikhonov, over n", tuple(ARRAYS))
    for n in CROSSINGS:
        rows = [row for row in results["crossings"] if row["n"] == n]
        pairs = [n * row["m"] for row in rows]
        for way, style in (("whole", ":"), ("blocks", "-")):
            rates = [4 * n * row["m"] ** 2 / row[way] / flops for row in rows]
            crossed.plot(pairs, rates, f"{colours[n]}{style}")
    crossed.axvline(block_kernels.BLOCKED_PAIRS, color="k", lw=0.8)
    _label(crossed, "points · transducers", "part of the peak", "Gram matrix and phases, whole or by blocks")
    crossed.set_yscale("linear")
    crossed.set_ylim(0, 1)
    for n in DRAWN:
        rows = [row for row in results["planes"] if row["n"] == n]
        samples = [row["samples"] for row in rows]
        for way, style in (("direct", ":"), ("fft", "-")):
            fields.plot(samples, [row.get(way, math.nan) for row in rows], f"{colours[n]}{style}")
            floors = [row[f"{way}_operations"] / flops for row in rows]
            fields.plot(samples, floors, f"{colours[n]}{'-.' if way == 'fft' else '--'}", lw=0.8)
        if (at := _crossing(rows)) is not None:
            fields.plot(*at, "kx")
    _label(fields, "samples", "time / s", "A plane for one drive")
    key.axis("off")
    for label, style in ({f"n = {n}": f"{colour}-" for n, colour in colours.items()} | KEY).items():
        key.plot([], [], style, label=label, lw=0.8 if "floor" in label else None)
    key.legend(loc="center", frameon=False)
    save_figure(figure, path)


def _crossing(rows: list[dict[str, Any]]) -> tuple[float, float] | None:
    """Samples and seconds at which an FFT is as fast as the direct sum, between two sizes on a logarithmic scale."""
    timed = [row for row in rows if "direct" in row]
    gains = [math.log(row["direct"] / row["fft"]) for row in timed]
    for one, other, low, high in zip(timed, timed[1:], gains, gains[1:], strict=False):
        if low < 0 <= high:
            at = -low / (high - low)
            samples, seconds = (one[key] ** (1 - at) * other[key] ** at for key in ("samples", "fft"))
            return samples, seconds
    return None


def _label(axes: Axes, x: str, y: str, title: str, ticks: Any = ()) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set(xlabel=x, ylabel=y, title=title)
    if len(ticks):
        axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
        axes.minorticks_off()


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--picture", type=Path, metavar="FILE", help="also draw the picture")
    parser.add_argument("--job", nargs="+", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.job:
        name, *values = arguments.job
        print(json.dumps(JOBS[name](*(float(value) if "." in value else int(value) for value in values))))
        return
    print(machine())
    results = measure()
    (speed,) = results["peak"]
    flops = speed["flops"]
    print(
        f"Peak of one core: {flops / 1e9:.0f} GFlop/s; blocks from {block_kernels.BLOCKED_PAIRS} pairs on; an FFT for"
    )
    print(f"a plane of {PAIRS_PER_SAMPLE} times as many pairs as numbers in its spectrum")
    print_results(results, flops)
    if arguments.picture:
        draw(results, flops, arguments.picture)
    record(arguments.json, results)


if __name__ == "__main__":
    main()
