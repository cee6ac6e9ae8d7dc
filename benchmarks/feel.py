"""How long the map of what skin feels takes: one second of 320 transducers' waves over a hand of 2000 places.

``make bench`` runs it on one thread; ``python benchmarks/feel.py`` uses all. Waves that change at random in each period
have every frequency; those of a modulation that repeats have few, and the others are skipped. Processor time does not
show what else ran on this machine; wall time does.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from time import perf_counter, process_time

import numpy as np
from bench import machine, options, record
from numpy.typing import NDArray
from phasewire import Hand, TransducerArray
from phasewire.feel.perception import FeltMap, felt_map, radiation_pressures
from phasewire.feel.unfolding import Unfolded

PERIODS = 40_000
RATE = 4000.0
CALLS = 7
GOAL = 1.0


def waves(array: TransducerArray) -> dict[str, NDArray[np.complex64]]:
    """At random, and two fields that alternate 200 times a second."""
    rng = np.random.default_rng(0)
    random = rng.standard_normal((2, PERIODS, len(array)), dtype=np.float32)
    pair = np.exp(2j * np.pi * rng.random((2, len(array)))).astype(np.complex64)
    return {"at random": random[0] + 1j * random[1], "two fields": pair[np.arange(PERIODS) // 100 % 2]}


def timed(call: Callable[[], object]) -> dict[str, float]:
    """Median wall and processor seconds of a call."""
    call()
    walls, processors = [], []
    for _ in range(CALLS):
        begun, begun_here = perf_counter(), process_time()
        call()
        walls.append(perf_counter() - begun)
        processors.append(process_time() - begun_here)
    return {"wall": float(np.median(walls)), "processor": float(np.median(processors))}


def stages(array: TransducerArray, skin: Unfolded, emitted: NDArray[np.complex64]) -> dict[str, dict[str, float]]:
    """The way from waves to a map, and how it divides."""
    pushed = radiation_pressures(array, emitted, skin)

    def whole() -> FeltMap:
        felt = felt_map(radiation_pressures(array, emitted, skin), skin, RATE)
        assert len(felt.intensity) == len(skin.positions)
        return felt

    felt = whole()
    return {
        "radiation pressure": timed(lambda: radiation_pressures(array, emitted, skin)),
        "motion of the skin": timed(lambda: felt_map(pushed, skin, RATE)),
        "in 50 windows": timed(lambda: felt.intensity_over_time(0.02)),
        "waves to map": timed(whole),
    }


def main() -> None:
    arguments = options(__doc__).parse_args()
    array, skin = TransducerArray.grid(), Unfolded.of(Hand.flat((0, 0, 0.2)))
    threads = os.environ.get("OPENBLAS_NUM_THREADS", "all")
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(machine(f"threads: {threads}", load))
    print(f"{skin}; one second, goal {GOAL:g} s\n\n{'':12}{'':22}{'wall s':>8}{'CPU s':>8}")
    found = {}
    for name, emitted in waves(array).items():
        found[name] = stages(array, skin, emitted)
        for stage, each in found[name].items():
            print(f"{name:12}{stage:22}{each['wall']:>8.2f}{each['processor']:>8.2f}")
    record(arguments.json, found)


if __name__ == "__main__":
    main()
