"""What streaming costs the host, and how soon a live frame is on its way.

``make bench`` runs it after the other benchmarks, against an emulated device in this process: the emulator's own time
is told apart. First 40 000 fresh frames a second from arrays, one for each carrier period: the host's share of a core;
also to four devices that play as one.
Then frames that are solved live, 32 points each, a thousand a second by the wall clock: the time from the moment at
which the points are there to that at which their block is handed to the bus.

At last streams over loopback TCP to an emulated device in a process of its own, which keeps the wall clock's time: 10 s
at each of three rates, the frames that came late, and what a block costs either process.

The share of other programs is measured beside it: after each frame a loop spins for about as long, and the distribution
of its wall time shows what the same core makes of any work of that length. Processor time
does not count what others took.
"""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from time import perf_counter, process_time, thread_time
from typing import Any

import numpy as np
from bench import options, record
from numpy.typing import NDArray
from phasewire import Solver, TransducerArray
from phasewire.protocol import PulseFrames
from phasewire.protocol.board import CARRIER_HZ, CHANNELS
from phasewire.solver import Solution
from told_apart import rig_told_apart, told_apart

sys.path.append(str(Path(__file__).resolve().parent / "peers"))
from usbip_line import by_usbip

ROUNDS = 3
POINTS = 32
METHODS = ("tikhonov", "wgs")
LIVE_RATE = 1000
WARM_UP_FRAMES = 400
SPIN_SECONDS = 150e-6
STEP_METRES = 1e-4
"""By which each point moves from frame to frame: 0.1 m/s at a thousand frames a second."""
GOAL_SECONDS = 1e-3
"""In which 999 of 1000 frames should be on their way."""
AFAR_RATES = (1_000, 10_000, CARRIER_HZ)
AFAR_WATCHDOG_SECONDS = 2.0
"""The watchdog's 0.1 s may pass while this busy machine compiles."""
QUANTILES = {"median": 0.5, "90 %": 0.9, "99 %": 0.99, "99.9 %": 0.999, "worst": 1.0}


def fresh_pulses(count: int, channels: int = CHANNELS) -> PulseFrames:
    """Frames of pulses at random."""
    rng = np.random.default_rng(1)
    return PulseFrames(
        rng.integers(0, 100, (count, channels), dtype=np.uint8), rng.integers(0, 26, (count, channels), dtype=np.uint8)
    )


def fresh_drives(count: int, channels: int = CHANNELS) -> NDArray[np.complex128]:
    """Frames of drives at random, (count, channels)."""
    rng = np.random.default_rng(1)
    magnitude, angle = rng.random((2, count, channels))
    return np.asarray(magnitude * np.exp(2j * np.pi * angle))


RIG = 4
SOURCES: dict[str, tuple[Callable[[int, int], Any], int]] = {
    "pulses, (k, 320)": (fresh_pulses, 1),
    "complex drives, (k, 320)": (fresh_drives, 1),
    f"{RIG} devices: pulses": (fresh_pulses, RIG),
    f"{RIG} devices: drives": (fresh_drives, RIG),
}


def streamed(source: Any, warm_up: Any, length: float, devices: int) -> dict[str, Any]:
    """Stream an array once; seconds of wall and processor time, host's and emulator's, per second of the stream."""
    opened: Any = told_apart() if devices == 1 else rig_told_apart(devices)
    with opened as (device, bus):
        device.stream(warm_up, CARRIER_HZ)
        bus.forget()
        wall, processor = perf_counter(), process_time()
        report = device.stream(source, CARRIER_HZ)
        wall, processor = perf_counter() - wall, process_time() - processor
    return {
        "wall": wall / length,
        "host": (processor - bus.seconds) / length,
        "emulator": bus.seconds / length,
        "transfers": len(bus.writes) / length,
        "report": asdict(report),
    }


def from_arrays(seconds: float) -> list[dict[str, Any]]:
    """Each kind of array at the full rate, for so many seconds of the device's time: the median of a few rounds."""
    frames = round(seconds * CARRIER_HZ)
    rows = []
    for what, (make, devices) in SOURCES.items():
        source, warm_up = (make(count, devices * CHANNELS) for count in (frames, WARM_UP_FRAMES))
        rounds = [streamed(source, warm_up, frames / CARRIER_HZ, devices) for _ in range(ROUNDS)]
        middle = sorted(rounds, key=lambda each: each["host"])[len(rounds) // 2]
        rows.append({"what": what, **middle, "hosts": [each["host"] for each in rounds]})
    return rows


def spin(turns: int) -> None:
    """Do nothing, for about as long each time."""
    for _ in range(turns):
        pass


def spin_turns() -> int:
    """How many turns take `SPIN_SECONDS` on a quiet machine."""
    turns, fastest = 1000, float("inf")
    for _ in range(100):
        begun = perf_counter()
        spin(turns)
        fastest = min(fastest, perf_counter() - begun)
    return round(turns * SPIN_SECONDS / fastest)


@contextmanager
def collections() -> Iterator[list[float]]:
    """The pauses of the garbage collector in a block of code, in seconds of processor time."""
    pauses: list[float] = []
    begun = 0.0

    def note(phase: str, _: dict[str, int]) -> None:
        nonlocal begun
        if phase == "start":
            begun = thread_time()
        else:
            pauses.append(thread_time() - begun)

    gc.callbacks.append(note)
    try:
        yield pauses
    finally:
        gc.callbacks.remove(note)


def wait_spinning(seconds: float) -> None:
    """Keep the core busy for so long."""
    end = perf_counter() + seconds
    while perf_counter() < end:
        pass


WAITS = {"sleeping": lambda seconds: time.sleep(max(seconds, 0)), "spinning": wait_spinning}


class Live:
    """Frames that are solved when they are wanted, and the moments at which their points were there.

    Parameters
    ----------
    method : str
        Method of the solver.
    wait : callable
        Lets so many seconds pass by the wall clock.
    frames : int
    """

    def __init__(self, method: str, wait: Callable[[float], object], frames: int) -> None:
        rng = np.random.default_rng(1)
        self._solver = Solver(TransducerArray.grid(), method)
        self._points = rng.uniform([-0.08, -0.08, 0.15], [0.08, 0.08, 0.3], (POINTS, 3))
        heading = rng.normal(size=(POINTS, 3))
        self._step = STEP_METRES * heading / np.linalg.norm(heading, axis=1, keepdims=True)
        self._wait, self._turns = wait, spin_turns()
        self.begins = np.zeros((frames, 2))
        self.floor = np.zeros((frames, 2))

    def frames(self) -> Iterator[Solution]:
        """One frame after the other, each at its time by the wall clock, or at once if that has passed."""
        due = perf_counter()
        for number in range(len(self.begins)):
            self.floor[number] = _passed(self._turns)
            self._wait(due - perf_counter())
            due = max(due + 1 / LIVE_RATE, perf_counter())
            way = 1 if number // LIVE_RATE % 2 == 0 else -1  # there and back, a second each
            points = self._points + way * (number % LIVE_RATE) * self._step
            self.begins[number] = perf_counter(), thread_time()
            yield self._solver.solve(points)


def _passed(turns: int) -> tuple[float, float]:
    wall, processor = perf_counter(), thread_time()
    spin(turns)
    return perf_counter() - wall, thread_time() - processor


def quantiles(seconds: NDArray[np.float64]) -> dict[str, float]:
    """The distribution in a few numbers."""
    return dict(zip(QUANTILES, np.quantile(seconds, list(QUANTILES.values())).tolist(), strict=True))


def live(method: str, wait: str, seconds: float) -> dict[str, Any]:
    """Stream frames that are solved live for so many seconds; the distribution of their latencies."""
    frames = round(seconds * LIVE_RATE)
    source = Live(method, WAITS[wait], WARM_UP_FRAMES + frames)
    with told_apart() as (device, bus), collections() as pauses:
        bus.forget()
        report = device.stream(source.frames(), LIVE_RATE)
    handed = np.repeat([moments for *moments, _ in bus.writes], [blocks for *_, blocks in bus.writes], axis=0)
    latency = (handed - source.begins)[WARM_UP_FRAMES:]
    floor = source.floor[WARM_UP_FRAMES:]
    return {
        "method": method,
        "wait": wait,
        "frames": frames,
        "latency": quantiles(latency[:, 0]),
        "processor": quantiles(latency[:, 1]),
        "floor": quantiles(floor[:, 0]),
        "floor_processor": quantiles(floor[:, 1]),
        "over": int((latency[:, 0] > GOAL_SECONDS).sum()),
        "over_by_itself": int((latency[:, 1] > GOAL_SECONDS).sum()),
        "floor_over": int((floor[:, 0] > GOAL_SECONDS).sum()),
        "collections": len(pauses),
        "longest_collection": max(pauses, default=0.0),
        "report": asdict(report),
    }


def processor_seconds(process: int) -> float:
    """Processor time of another process."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def from_afar(seconds: float) -> list[dict[str, Any]]:
    """Stream at each rate for so long to a device in another process."""
    rows = []
    with by_usbip() as (device, process):
        device.set_watchdog(AFAR_WATCHDOG_SECONDS)
        device.stream(fresh_pulses(WARM_UP_FRAMES), LIVE_RATE)
        for rate in AFAR_RATES:
            frames = fresh_pulses(round(rate * seconds))
            host, server = process_time(), processor_seconds(process)
            report = device.stream(frames, rate)
            host, server = process_time() - host, processor_seconds(process) - server
            costs = {"host": host / report.sent, "server": server / report.sent}
            rows.append({"rate": rate, "seconds": seconds, **costs, "report": asdict(report)})
    return rows


def stolen() -> NDArray[np.float64]:
    """Processor time of this machine: in all, and what its hypervisor gave to others; zeros if that is unknown."""
    try:
        first = Path("/proc/stat").read_text(encoding="ascii").partition("\n")[0]
    except OSError:
        return np.zeros(2)
    spent = np.array(first.split()[1:9], float)
    return np.array([spent.sum(), spent[7]])


def print_arrays(rows: list[dict[str, Any]]) -> None:
    print(f"{CARRIER_HZ:,} fresh frames a second from an array, per second of the stream; median of {ROUNDS} rounds")
    print(f"{'':28}{'host, cores':>14}{'(all)':>16}{'emulator, s':>14}{'wall, s':>10}{'late':>7}{'underruns':>11}")
    for row in rows:
        spread = f"{min(row['hosts']):.3f} - {max(row['hosts']):.3f}"
        report = row["report"]
        print(
            f"{row['what']:28}{row['host']:>14.3f}{spread:>16}{row['emulator']:>14.2f}{row['wall']:>10.2f}"
            f"{report['late']:>7}{report['underruns']:>11}"
        )


def print_live(rows: list[dict[str, Any]]) -> None:
    print(f"\nFrom {POINTS} points to their block on the bus, {LIVE_RATE:,} frames a second, in ms")
    print(f"{'':40}" + "".join(f"{name:>10}" for name in QUANTILES))
    for row in rows:
        for what, key in (
            (f"{row['method']}, {row['wait']} between frames", "latency"),
            ("  processor time", "processor"),
            ("  a loop that spins", "floor"),
            ("  processor time of that", "floor_processor"),
        ):
            print(f"{what:40}" + "".join(f"{seconds * 1e3:>10.3f}" for seconds in row[key].values()))
        report = row["report"]
        print(
            f"  {row['frames']:,} frames: {row['over']} took over 1 ms, {row['over_by_itself']} in processor time, and "
            f"{row['floor_over']} of the loops; {row['collections']} garbage collections, the longest "
            f"{row['longest_collection'] * 1e3:.2f} ms; {report['late']} late, {report['underruns']} underruns"
        )


def print_afar(rows: list[dict[str, Any]]) -> None:
    print("\nOver loopback TCP, by USB/IP, to a device in another process")
    print(f"{'':16}{'s':>6}{'frames':>10}{'late':>8}{'underruns':>11}{'host, µs/block':>16}{'server, µs/block':>18}")
    for row in rows:
        report = row["report"]
        print(
            f"{row['rate']:>14,}/s{row['seconds']:>6g}{report['accepted']:>10,}{report['late']:>8,}"
            f"{report['underruns']:>11,}{row['host'] * 1e6:>16.1f}{row['server'] * 1e6:>18.1f}"
        )


def main() -> None:
    """Measure, print, and write the figures on request."""
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="of the device's time, from each array")
    parser.add_argument(
        "--live", type=float, default=60.0, help="seconds with each method of the solver, for each way to wait"
    )
    parser.add_argument("--afar", type=float, default=10.0, help="seconds at each rate over loopback TCP")
    arguments = parser.parse_args()
    before = stolen()
    arrays = from_arrays(arguments.seconds)
    print_arrays(arrays)
    lively = [live(method, wait, arguments.live) for method in METHODS for wait in WAITS]
    print_live(lively)
    afar = from_afar(arguments.afar)
    print_afar(afar)
    total, steal = stolen() - before
    share = steal / total if total else 0.0
    print(f"\nThe hypervisor gave {share:.1%} of this machine's time to others.")
    figures = {"arrays": arrays, "live": lively, "afar": afar, "stolen": share}
    record(arguments.json, figures)


if __name__ == "__main__":
    main()
