"""What tests of mutants share: a bench on a sound or a broken emulator, what plays there, and how the two differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.patching import applied
from phasewire.hil.conformance.running import Options, open_bench
from phasewire.protocol.pulses import Pulses

Scenario = Callable[[Bench], Any]
Difference = tuple[str, Scenario, Any, Any]
"""A mutant's name, what is done, what a sound device shows of it, and what the mutant does."""
FULL = Pulses(np.zeros(320, int), np.full(320, 25))
WEAK = Pulses(np.full(320, 30), np.full(320, 2))
SHIFTED = Pulses(np.full(320, 60), np.full(320, 2))


@contextmanager
def bench_of(url: str) -> Iterator[Bench]:
    with open_bench(Options(url)) as bench:
        bench.begin_case("scenario")
        yield bench


def check_difference(name: str, scenario: Scenario, sound: Any, broken: Any) -> None:
    mutant = MUTANTS[name]
    with bench_of(mutant.url) as bench:
        shown = scenario(bench)
        assert shown == sound, f"a sound device should show {sound!r}, not {shown!r}"
    with applied(mutant), bench_of(mutant.url) as bench:
        shown = scenario(bench)
        assert shown == broken, f"{name} should show {broken!r}, not {shown!r}"


def high(begin: int, width: int) -> str:
    """A period of an output that is high from a tick on, round the end."""
    return "".join(".#"[(tick - begin) % 50 < width] for tick in range(50))


def levels(bench: Bench, period: int, transducer: int = 0) -> str:
    """A period of an output, as it is seen."""
    assert bench.sight is not None
    bench.wait_until(period + 1)
    channel = int(bench.wiring.channels[transducer])
    return bench.sight.seen(period, period + 1).excerpt(period, channel).split(": ")[1]
