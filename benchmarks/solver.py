"""How fast the solver is, how far from what the arithmetic allows, and where its time goes.

``make bench`` runs it after the other benchmarks: a few tables of medians, all from one run on one thread unless it
says otherwise. Compare rows with each other and with the floor, which is the same arithmetic at the speed of a loop of
multiply-adds that this run measures; absolute times belong to the machine and promise nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import perf_counter
from typing import Any

import numpy as np
from bench import machine, median, options, record
from numba import njit
from phasewire import ControlPoints, Solver, TransducerArray, pressure
from phasewire.solver import METHODS, PlanePropagator, solve_frames
from phasewire.solver.acoustics.tables import compilation
from phasewire.solver.compiled import algebra, layout, propagation
from phasewire.solver.compiled.simd import LANES, load, spread, total
from phasewire.solver.methods.engine import CompiledEngine

COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512)
ARRAYS = {320: (20, 16), 1024: (32, 32), 4096: (64, 64)}
FRAMES = 4000


def cloud(m: int, seed: int = 1) -> ControlPoints:
    """Points at random above the array."""
    rng = np.random.default_rng(seed)
    return ControlPoints(rng.uniform([-0.08, -0.08, 0.15], [0.08, 0.08, 0.3], (m, 3)))


@njit(fastmath=True)
def multiply_add(matrix: Any, rounds: int) -> Any:
    """Ten independent chains of multiply-adds, 2 · 10 · LANES · rounds operations."""
    x = load(matrix, 0, 0)
    a = b = c = d = e = f = g = h = i = j = spread(np.float32(0))
    for _ in range(rounds):
        a, b, c, d, e = a * x + x, b * x + x, c * x + x, d * x + x, e * x + x
        f, g, h, i, j = f * x + x, g * x + x, h * x + x, i * x + x, j * x + x
    return total(a + b + c + d + e + f + g + h + i + j)


def peak() -> float:
    """Floating point operations per second of one core, float32 multiply-adds from registers."""
    matrix, rounds = np.full((1, LANES), 0.5, np.float32), 100_000
    return 2 * 10 * LANES * rounds / median(lambda: multiply_add(matrix, rounds))


def updates() -> Iterator[dict[str, Any]]:
    """Updates per second of every method, from `ControlPoints` to `Solution`, frame after frame."""
    for n, (columns, rows) in ARRAYS.items():
        array = TransducerArray.grid(columns, rows)
        for method in METHODS if n == 320 else ("tikhonov", "wgs"):
            solver = Solver(array, method)
            for m in COUNTS:
                points = cloud(m)
                yield {"n": n, "method": method, "m": m, "seconds": median(lambda: solver.solve(points))}


def double() -> Iterator[dict[str, Any]]:
    """The same in double precision by NumPy, which single precision is held against."""
    for method in ("tikhonov", "wgs"):
        solver, points = Solver(TransducerArray.grid(), method, precision="double"), cloud(32)
        yield {"n": 320, "method": method, "m": 32, "seconds": median(lambda: solver.solve(points))}


def cores() -> Iterator[dict[str, Any]]:
    """Updates per second of frames, each solved from scratch, on one core and on two."""
    frames = [cloud(32, seed) for seed in range(FRAMES)]
    array = TransducerArray.grid()
    for method in ("tikhonov", "wgs"):
        for workers in (1, 2):
            seconds = median(lambda: solve_frames(array, frames, method, workers=workers)) / FRAMES
            yield {"method": method, "workers": workers, "seconds": seconds}


def stages(flops: float) -> Iterator[dict[str, Any]]:
    """Where an update of tikhonov goes, beside the time of its arithmetic at ``flops`` operations per second.

    Counted per stage: 40 operations for each entry of the model, 4m²n for the Gram matrix (half of it is computed; the
    kernel needs three multiplications for four, and so can beat its floor), 8m² for a step of the phases, (4/3)m³ for
    the factorisation, 8m² + 8mn for the substitution and the way back.
    """
    array = TransducerArray.grid()
    n = len(array)
    for m in (8, 32, 128, 512):
        points, engine = cloud(m), CompiledEngine(array, *_settings("tikhonov"))
        engine.drive(points)
        re, im, gram_re, gram_im, lower_re, lower_im, vectors, spans, _ = layout.carve(engine._work, m, n)
        rows, u = len(re), engine._phases[engine._last]
        wanted, response = vectors[layout.WANTED], vectors[layout.RESPONSE]
        inverse, aim, rhs, y = (vectors[row] for row in (layout.INVERSE, layout.SCRATCH, layout.RHS, layout.SOLUTION))
        reach, weight, x = spans[layout.REACH], spans[layout.WEIGHT], spans[layout.DRIVE]
        tables, mu = engine._tables, np.float32(0.03)
        calls: dict[str, tuple[Callable[[], object], float]] = {
            "model": (
                lambda: propagation.fill_transfer(
                    elements=tables.elements, directivity=tables.wave[0], turns=tables.turns, nepers=None,
                    points=points.positions, origin=tables.origin, wanted=wanted, re=re[:m], im=im[:m], reach=reach,
                ),
                40 * m * n,
            ),
            "gram": (lambda: algebra.fill_gram(re, im, gram_re, gram_im), 4 * m * m * n),
            "phases, 20 steps": (
                lambda: algebra.iterate_phases(gram_re, gram_im, response, rows, 20, False, u, aim),
                20 * 8 * m * m,
            ),
            "factorisation": (
                lambda: algebra.factorise(gram_re, gram_im, m, rows, mu, lower_re, lower_im, inverse),
                4 / 3 * m**3,
            ),
            "substitution and back": (
                lambda: (
                    algebra.substitute(lower_re, lower_im, inverse, rows, rhs, y),
                    algebra.back_project(re, im, weight, y, x),
                ),
                8 * m * m + 8 * m * n,
            ),
        }  # fmt: skip
        whole = median(lambda: engine.drive(points))
        for name, (call, operations) in calls.items():
            yield {"m": m, "stage": name, "seconds": median(call), "floor": operations / flops}
        yield {
            "m": m,
            "stage": "the whole update",
            "seconds": whole,
            "floor": sum(o for _, o in calls.values()) / flops,
        }


def _settings(method: str) -> tuple[Any, str, Any]:
    solver = Solver(TransducerArray.grid(), method)
    return solver.medium, method, solver.options


def fields() -> Iterator[dict[str, Any]]:
    """Points · transducers per second of a plane of 195 × 195 samples, by direct sum and by FFT."""
    array = TransducerArray.grid()
    drive = Solver(array).solve(cloud(32)).drive
    propagate = PlanePropagator(array, 0.2)
    at = propagate.grid.positions().reshape(-1, 3)
    pairs = len(at) * len(array)
    for name, call in {
        "direct, single precision": lambda: pressure(array, drive, at, precision="single"),
        "FFT": lambda: propagate(drive),
        "direct, double precision": lambda: pressure(array, drive, at),
    }.items():
        seconds = median(call)
        yield {"field": name, "pairs_per_second": pairs / seconds, "seconds": seconds}


def print_updates(rows: list[dict[str, Any]]) -> None:
    print("\nUpdates per second, one thread, by number of control points")
    print(f"{'n':>5}  {'method':10}" + "".join(f"{m:>9}" for m in COUNTS))
    for n, method in dict.fromkeys((row["n"], row["method"]) for row in rows):
        rates = [1 / row["seconds"] for row in rows if (row["n"], row["method"]) == (n, method)]
        print(f"{n:>5}  {method:10}" + "".join(f"{rate:>9.0f}" for rate in rates))


def main() -> None:
    arguments = options(__doc__).parse_args()
    before = perf_counter()
    for method in ("tikhonov", "wgs", "polish", "multiplex"):
        Solver(TransducerArray.grid(2, 2), method).solve(cloud(1))
    first = perf_counter() - before
    counts = compilation()
    loaded, built = (sum(count[which] for count in counts.values()) for which in (0, 1))
    print(machine())
    print(f"Kernels: {built} compiled, {loaded} loaded from the cache, in {first:.1f} s")
    flops = peak()
    print(f"Peak of one core: {flops / 1e9:.0f} GFlop/s in float32 multiply-adds")

    results: dict[str, Any] = {"compiled": built, "loaded": loaded, "first_seconds": first, "peak_flops": flops}
    results["updates"] = list(updates())
    print_updates(results["updates"])

    results["double"] = list(double())
    for row in results["double"]:
        (single,) = (r for r in results["updates"] if all(r[key] == row[key] for key in ("n", "method", "m")))
        ratio = row["seconds"] / single["seconds"]
        print(
            f"{row['method']} in double precision by NumPy, m = 32: {1 / row['seconds']:.0f}/s; single is {ratio:.0f} ×"
        )

    results["cores"] = list(cores())
    print(f"\n{FRAMES} frames of 32 points, from scratch each, in one call")
    for row in results["cores"]:
        print(f"{row['method']:10} on {row['workers']} core(s): {1 / row['seconds']:7.0f} updates/s")

    results["stages"] = list(stages(flops))
    print("\nWhere an update of tikhonov goes, n = 320")
    print(f"{'m':>4}  {'stage':24}{'µs':>9}{'floor':>9}{'of peak':>9}")
    for row in results["stages"]:
        part = row["floor"] / row["seconds"]
        print(f"{row['m']:>4}  {row['stage']:24}{row['seconds'] * 1e6:>9.1f}{row['floor'] * 1e6:>9.1f}{part:>9.0%}")

    results["fields"] = list(fields())
    print("\nField over a plane of 195 × 195 samples, n = 320")
    for row in results["fields"]:
        rate = row["pairs_per_second"] / 1e9
        print(f"{row['field']:26}{row['seconds'] * 1e3:9.2f} ms{rate:9.2f} · 10⁹ points·transducers/s")
    record(arguments.json, results)


if __name__ == "__main__":
    main()
