"""How fast processors are executed, in seconds per second of the device's time.

``make bench`` runs it on one thread, after the other benchmarks: medians of some runs, after one that compiles and
warms up. *Steady* is a field that plays on, *fresh* a new one in every carrier period. *Modelled* are the same frames
on an emulator whose processors are models that get every message. Times are those of the process, so that a shared
machine matters less.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import process_time

import numpy as np
from numpy.typing import NDArray
from phasewire import Device, Emulator, open_device
from phasewire.protocol.board import CARRIER_HZ, CHANNELS, CORE_HZ, PROCESSORS

RUNS, FRAMES, STEADY_PERIODS = 5, 2000, 4000
RATE = float(CARRIER_HZ)


def frames(count: int) -> NDArray[np.complex64]:
    """Random drives."""
    random = np.random.default_rng(1)
    drives = random.random((count, CHANNELS)) * np.exp(2j * np.pi * random.random((count, CHANNELS)))
    return np.asarray(drives, np.complex64)


def taken(work: Callable[[], None], emulator: Emulator) -> float:
    """Seconds per second of the device's time, the median of some runs."""

    def once() -> float:
        device, begun = emulator.scheduler.now, process_time()
        work()
        emulator.capture()
        return (process_time() - begun) / ((emulator.scheduler.now - device) / CORE_HZ)

    once()
    return median([once() for _ in range(RUNS)])


def stream(device: Device) -> None:
    """A fresh frame in every carrier period."""
    device.stream(frames(FRAMES), RATE)


def of_a_chain() -> None:
    """Ten processors behind the controller."""
    for name, emulator in (("executed", Emulator(firmware="xs1")), ("modelled", Emulator(unfolded=True))):
        with emulator, open_device(emulator.url) as device:
            fresh = taken(lambda: stream(device), emulator)
            device.set_watchdog(10)
            device.show(frames(1)[0])
            steady = taken(lambda: emulator.run(STEADY_PERIODS), emulator)
        print(
            f"ten {name}: steady {steady:.2f} s/s, {PROCESSORS / steady:.1f} times real time for one of them; ", end=""
        )
        print(f"fresh in every period {fresh:.2f} s/s")


if __name__ == "__main__":
    of_a_chain()
