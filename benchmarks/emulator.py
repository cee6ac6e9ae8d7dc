"""How fast the emulator is, in seconds of the device's time per second, and how much memory an hour of it takes.

``make bench`` runs it after the other benchmarks, on one thread: medians, all from one run. What a device plays is kept
as segments; *expanded* means that every bit of all ten ports was written out as well, and *drives* that each period of
all transducers was demodulated. Compare rows; absolute times belong to the machine.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable
from itertools import count
from time import perf_counter
from typing import Any

import numpy as np
import usb.core
from bench import median, options, record
from phasewire import Capture, Emulator, Pulses
from phasewire.emulator.cluster import Cluster
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.protocol import Block, Entries, Entry, PlaySequence, Slot, Update, pack, pack_updates
from phasewire.protocol.board import CARRIER_HZ, CHANNELS, TICKS_PER_PERIOD
from phasewire.protocol.codes import BLOCK_BYTES, REQUEST_TYPE_OUT, Reason, Request
from phasewire.protocol.enumeration import ENDPOINT_IN, ENDPOINT_OUT
from phasewire.protocol.replies import Ack, records

BATCH = 256
"""Blocks in one write: as many as the device holds acknowledgements for."""
CHUNK_PERIODS = 1000
"""Expanded at a time: 2 MB of port words."""
WATCHDOG_MS = 60_000
HOUR_SECONDS = 3600
CHAINS, CHAINS_UPDATES = (1, 8, 64), 1024
FROM_MB = 2**20 if sys.platform == "darwin" else 2**10
"""The unit in which `resource` counts memory."""


class Line:
    """A fresh device, enabled, and pyusb's end of the line to it."""

    def __init__(self, emulator: Emulator | None = None) -> None:
        self.emulator = Emulator() if emulator is None else emulator
        self._usb = usb.core.find(backend=EmulatorBackend([self.emulator]))
        self._usb.set_configuration()
        self._usb.ctrl_transfer(REQUEST_TYPE_OUT, Request.WATCHDOG, WATCHDOG_MS, 0)
        self._usb.ctrl_transfer(REQUEST_TYPE_OUT, Request.ENABLE, 0, 0)

    def write(self, blocks: bytes) -> bytes:
        """Write whole blocks at once; their acknowledgements."""
        if self._usb.write(ENDPOINT_OUT, blocks) != len(blocks):
            raise RuntimeError("not all blocks were taken")
        expected, answer = len(blocks) // BLOCK_BYTES * Ack.BYTES, b""
        while len(answer) < expected:
            answer += bytes(self._usb.read(ENDPOINT_IN, expected))
        return answer

    def send(self, *blocks: Block) -> None:
        """Send blocks, which must all be accepted, and let the last of them take effect."""
        acks = [ack for ack in records(self.write(b"".join(map(pack, blocks)))) if isinstance(ack, Ack)]
        if refused := [ack for ack in acks if ack.reason is not Reason.ACCEPTED]:
            raise RuntimeError(f"refused: {refused[0]}")
        self.emulator.run_until(acks[-1].commit_period + 1)


def some_pulses(seed: int) -> Pulses:
    rng = np.random.default_rng(seed)
    return Pulses(rng.integers(0, 100, CHANNELS), rng.integers(0, 26, CHANNELS))


class Fresh:
    """Another field in every carrier period, written over USB in batches.

    Parameters
    ----------
    updates : int
        Played in each call, a multiple of `BATCH`.
    emulator : Emulator, optional
        What plays them; a device of its own by default.
    """

    def __init__(self, updates: int, emulator: Emulator | None = None) -> None:
        self._line = Line(emulator)
        rng = np.random.default_rng(1)
        self._phase = rng.integers(0, 100, (updates, CHANNELS), dtype=np.uint8)
        self._width = rng.integers(0, 26, (updates, CHANNELS), dtype=np.uint8)
        self._numbers = count(0, updates)
        self._line.send(Block(Update(some_pulses(1)), 2**32 - 1, restart=True))
        self.pack()

    def pack(self) -> None:
        """Number the updates of the next call."""
        blocks = pack_updates(self._phase, self._width, next(self._numbers))
        self._batches = [batch.tobytes() for batch in np.split(blocks, len(blocks) // BATCH)]

    def play(self) -> None:
        """Write all batches, and read the acknowledgements of each."""
        for batch in self._batches:
            self._line.write(batch)

    @property
    def capture(self) -> Capture:
        """The recording so far."""
        return self._line.emulator.capture()


def two_sided() -> Line:
    """A device that plays a stored sequence of two fields, 200 Hz, without end."""
    line = Line()
    line.send(
        Block(Slot(0, some_pulses(1)), 0, restart=True),
        Block(Slot(1, some_pulses(2)), 1),
        Block(Entries((Entry(0, 100), Entry(1, 100))), 2),
        Block(PlaySequence(0, 2, unattended=True), 3),
    )
    return line


def steady() -> Line:
    """A device that plays one field."""
    line = Line()
    line.send(Block(Update(some_pulses(1)), 0, restart=True))
    return line


def expand(capture: Capture, first: int, last: int) -> None:
    """Write out the bits of some periods, a stretch at a time."""
    for begin in range(first, last, CHUNK_PERIODS):
        end = min(begin + CHUNK_PERIODS, last)
        capture.bits(begin * TICKS_PER_PERIOD, end * TICKS_PER_PERIOD)


def look(capture: Capture, periods: int) -> dict[str, float]:
    """Seconds that the last so many periods take: as bits, and as drives."""
    last = capture.periods
    return {
        "expand": median(lambda: expand(capture, last - periods, last)),
        "drives": median(lambda: capture.drives(last - periods, last)),
    }


def median_fresh(fresh: Fresh) -> float:
    """Median of the time that playing takes, without packing."""
    fresh.play()
    seconds = []
    for _ in range(5):
        fresh.pack()
        seconds.append(_once(fresh.play))
    return float(np.median(seconds))


def measure(seconds: float) -> list[dict[str, Any]]:
    """Rows of seconds per second of the device's time, over stretches of so many seconds."""
    periods = max(round(seconds * CARRIER_HZ) // BATCH, 1) * BATCH
    fresh = Fresh(periods)
    rows: list[dict[str, Any]] = []

    def note(what: str, play: float, capture: Capture) -> None:
        taken = {"play": play, **look(capture, periods)}
        rows.append({"what": what} | {key: value * CARRIER_HZ / periods for key, value in taken.items()})

    note("fresh field every period, over USB", median_fresh(fresh), fresh.capture)
    for what, line in (("two-sided sequence, 200 Hz", two_sided()), ("steady field", steady())):
        line.emulator.run(periods)
        note(what, median(lambda: line.emulator.run(periods)), line.emulator.capture())
    return rows


def chains(updates: int) -> list[dict[str, float]]:
    """Devices on one sync line that all play a fresh field every period: seconds of one device's time per second."""
    rows = []
    for devices in CHAINS:
        cluster = [Fresh(updates, device) for device in Cluster(devices)]
        seconds = sum(median_fresh(fresh) for fresh in cluster)
        rows.append({"devices": devices, "per_device": devices * updates / CARRIER_HZ / seconds})
    return rows


def hour() -> dict[str, float]:
    """An hour of the looped sequence: seconds that it takes, and by how many MB the process grows at most."""
    line = two_sided()
    expand(line.emulator.capture(), 0, 1)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    def play_and_look() -> None:
        line.emulator.run(HOUR_SECONDS * CARRIER_HZ)
        capture = line.emulator.capture()
        expand(capture, capture.periods - CHUNK_PERIODS, capture.periods)

    seconds = _once(play_and_look)
    return {"seconds": seconds, "growth_mb": (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / FROM_MB}


def _once(call: Callable[[], object]) -> float:
    before = perf_counter()
    call()
    return perf_counter() - before


def main() -> None:
    """Measure, print, and write the figures on request."""
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="of the device's time in one call")
    arguments = parser.parse_args()
    weight = hour()
    rows = measure(arguments.seconds)
    print("Seconds of the device's time per second, one thread")
    print(f"{'':40}{'played':>12}{'and expanded':>14}{'drives of 1 s':>16}")
    for row in rows:
        played, expanded = 1 / row["play"], 1 / (row["play"] + row["expand"])
        print(f"{row['what']:40}{played:>12,.1f}{expanded:>14.1f}{row['drives']:>14.2f} s")
    print(f"An hour of the sequence: {weight['seconds']:.2f} s, and {weight['growth_mb']:.0f} MB more at most")
    several = chains(CHAINS_UPDATES)
    rates = ", ".join(f"{row['per_device']:.1f} with {row['devices']}" for row in several)
    print(f"Chains on one sync line, fresh fields, s/s of each: {rates}")
    figures = {"rows": rows, "hour": weight, "chains": several}
    record(arguments.json, figures)


if __name__ == "__main__":
    main()
