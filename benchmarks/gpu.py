"""Batches of solves and fields by JAX, beside the compiled kernels on one core and on two, in one run.

On a machine with a GPU: ``pip install 'phasewire[gpu]'``, then ``python benchmarks/gpu.py --json gpu.json``, in less
than five minutes. The same tests as everywhere then use the GPU: ``pytest tests/solver/accelerated
tests/solver/methods/test_batches.py``. Without a GPU the same programs run on the processor, which says nothing of a
GPU's speed; only the counts of work and the answers are those of a GPU.

The targets are 10 × 56 000 solves a second at m = 32, and 50 × the fields of one core. In a row without "program
alone" points and drives are NumPy's, and the time has everything.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from bench import median, options, record
from phasewire import ControlPoints, Grid, Medium, TransducerArray, pressure
from phasewire.solver import solve_frames
from phasewire.solver.accelerated import propagation, updates
from phasewire.solver.acoustics.tables import pressure_at, tables_of
from phasewire.solver.methods.batches import batch_size, drive_batches, recipe_of
from phasewire.solver.methods.methods import options_of
from phasewire.solver.methods.reference import cold_start

M, N = 32, 320
SOLVES, FIELDS = 10 * 56_000, 50  # per second; times the fields of one core
BYTES, FLOPS = 3e12, 50e12  # per second, of a GPU such as an H100, in float32
ARRAY, AIR = TransducerArray.grid(), Medium()
TABLES = tables_of(ARRAY, AIR)


def cloud(seed: int) -> ControlPoints:
    """Points at random above the array."""
    return ControlPoints(np.random.default_rng(seed).uniform([-0.08, -0.08, 0.15], [0.08, 0.08, 0.3], (M, 3)))


def felt(frames: list[ControlPoints], drives: Any) -> Any:
    pairs = zip(frames, drives, strict=True)
    return np.array([np.abs(pressure(ARRAY, drive, points.positions, precision="single")) for points, drive in pairs])


def program(method: str, frames: int) -> tuple[Any, ...]:
    """The arguments of `updates.solve_batch`, for frames of M points."""
    at = np.stack([cloud(seed).positions for seed in range(frames)]) - TABLES.origin
    return (
        propagation.WaveTables(*TABLES[:4]),
        at.astype(np.float32),
        np.ones((frames, M), np.float32),
        np.full(frames, M, np.int32),
        cold_start(M).astype(np.complex64),
        np.float32(1),
        np.float32(0.03),
        recipe_of(method, options_of(method)),
    )


def solves(device: Any, count: int) -> Iterator[dict[str, Any]]:
    frames, few = [cloud(seed) for seed in range(count)], 2000
    batch = batch_size(M, N)
    for method in ("tikhonov", "wgs"):
        options, drives = options_of(method), np.empty((count, N), np.complex64)
        for workers in (1, 2):
            seconds = median(lambda: solve_frames(ARRAY, frames[:few], method, workers=workers)) / few
            yield {"method": method, "by": f"kernels, {workers} core(s)", "seconds": seconds}
        whole = median(lambda: drive_batches(device, ARRAY, AIR, method, options, frames, drives)) / count
        yield {"method": method, "by": "JAX", "seconds": whole}
        *arguments, recipe = program(method, batch)
        placed = jax.device_put(arguments, device)
        alone = median(lambda: updates.solve_batch(*placed, recipe).block_until_ready()) / batch
        yield {"method": method, "by": "JAX, program alone", "seconds": alone}
        one, other = felt(frames[:200], drives[:200]), felt(frames[:200], solve_frames(ARRAY, frames[:200], method))
        spread, expected = ((p.std(axis=1) / p.mean(axis=1)).mean() for p in (one, other))
        level = one.mean() / other.mean()
        print(f"{method}: mean |p| is {level:.5f} of the kernels'; spread {spread:.4%}, theirs {expected:.4%}")


def fields(device: Any, samples: int) -> Iterator[dict[str, Any]]:
    drive = solve_frames(ARRAY, [cloud(0)])[0].astype(complex)
    side = round(samples ** (1 / 3))
    at = Grid((0, 0, 0.2), np.eye(3), (side, side, side), 1e-3).positions().reshape(-1, 3)
    few = at[:40_000]
    one = median(lambda: pressure(ARRAY, drive, few, precision="single"))
    yield {"by": "kernels, 1 core", "pairs_per_second": len(few) * N / one}
    whole = median(lambda: pressure_at(TABLES, ARRAY, drive, at, device))
    yield {"by": "JAX", "pairs_per_second": len(at) * N / whole}
    block = at[: propagation.PAIRS_AT_A_TIME // N].astype(np.float32)
    placed = jax.device_put((propagation.WaveTables(*TABLES[:4]), drive.astype(np.complex64), block), device)
    alone = median(lambda: propagation._pressure(*placed).block_until_ready())
    yield {"by": "JAX, program alone", "pairs_per_second": len(block) * N / alone}
    exact = pressure(ARRAY, drive, few)
    error = np.abs(pressure_at(TABLES, ARRAY, drive, few, device) - exact).max() / np.abs(exact).max()
    print(f"field: within {error:.1e} of the largest pressure in double precision; 2e-4 is the limit")


def cost(lowered: Any) -> dict[str, float]:
    counted: dict[str, float] = lowered.compile().cost_analysis()
    return counted


def counts() -> Iterator[dict[str, Any]]:
    """Work of a solve and of a pair.

    XLA counts the body of a loop once and a complex product as one operation, so only the bytes without loops are its
    own; operations, and the loops' bytes, are counted by hand: an iteration for the phases reads the Gram matrix; each
    step of wgs reads the transfer matrix once, and twice in each of its gradients.
    """
    transfer, gram = 8 * M * N, 8 * M * M
    for method in ("tikhonov", "wgs"):
        *arguments, recipe = program(method, 256)
        plain = cost(updates.solve_batch.lower(*arguments, recipe._replace(phase_steps=0, steps=0)))
        reads = 1 + recipe.steps * (1 + 2 * recipe.gradients) if recipe.steps else 0
        yield {
            "of": method,
            "bytes": plain["bytes accessed"] / 256 + recipe.phase_steps * gram + reads * transfer,
            "flops": 70 * M * N
            + 8 * M * M * N
            + 8 * M * M * recipe.phase_steps
            + 8 / 3 * M**3
            + 16 * M * (N + M)
            + 8 * M * N * reads,
        }
    one = (propagation.WaveTables(*TABLES[:4]), np.zeros(N, np.complex64), np.zeros((4096, 3), np.float32))
    pair = cost(propagation._pressure.lower(*one))
    yield {"of": "pair", "bytes": pair["bytes accessed"] / 4096 / N, "flops": pair["flops"] / 4096 / N}


def main() -> None:
    arguments = options(__doc__).parse_args()
    device = jax.devices()[0]
    there_is_a_gpu = device.platform != "cpu"
    print(f"JAX {jax.__version__} on {device.device_kind}")
    if not there_is_a_gpu:
        print("There is no GPU: these programs run on the processor, and no target can be judged.")
    results: dict[str, Any] = {"jax": jax.__version__, "device": device.device_kind, "platform": device.platform}

    results["solves"] = list(solves(device, 65_536 if there_is_a_gpu else 4_096))
    print(f"\nSolves of {M} points on {N} transducers, each from scratch")
    for row in results["solves"]:
        rate = 1 / row["seconds"]
        (core,) = (r for r in results["solves"] if r["method"] == row["method"] and "1 core" in r["by"])
        told = f"  {rate / SOLVES:.2f} of the target" if "JAX" in row["by"] and there_is_a_gpu else ""
        print(f"{row['method']:10}{row['by']:22}{rate:>12,.0f}/s{core['seconds'] * rate:>8.2f} × one core{told}")

    results["fields"] = list(fields(device, 2_000_000 if there_is_a_gpu else 125_000))
    print(f"\nFields, points · transducers a second, n = {N}")
    core_rate = results["fields"][0]["pairs_per_second"]
    for row in results["fields"]:
        ratio = row["pairs_per_second"] / core_rate
        told = f"  {ratio / FIELDS:.2f} of the target" if "JAX" in row["by"] and there_is_a_gpu else ""
        print(f"{row['by']:22}{row['pairs_per_second'] / 1e9:>12.2f} · 10⁹/s{ratio:>8.2f} × one core{told}")

    results["counts"] = list(counts())
    print(f"\nWork of each, and its bound at {BYTES / 1e12:g} TB/s and {FLOPS / 1e12:g} TFlop/s")
    for row in results["counts"]:
        bound = min(BYTES / row["bytes"], FLOPS / row["flops"])
        target = core_rate * FIELDS if row["of"] == "pair" else SOLVES
        print(
            f"{row['of']:10}{row['bytes'] / 1e3:>12.3f} kB{row['flops'] / 1e3:>12.3f} kFlop{bound:>18,.0f}/s"
            f"  the target is {target / bound:.0%} of it"
        )
    record(arguments.json, results)


if __name__ == "__main__":
    main()
