"""How soon a hand's pose is on its way to the device, a thousand times a second, and whether memory stays flat.

``python benchmarks/touch.py`` takes a minute; ``--minutes 10`` is the soak. A hand sweeps through the paper's cube and
through a sphere of 81 920 faces; the loop is the whole one, with pyusb; only the bus is a null bus, which takes each
block and acknowledges it at once, by the wall clock. So the host's part alone is measured.

The latency is from the time stamp of a hand to the moment at which pyusb hands to the bus the block that lets its field
play. Time stamps are those at which frames are due, so that the latency includes how late the computer wakes up.
Processor time begins when the frame is handed to the loop, and does not count what other programs took.

Other ways of rendering follow, on the cube: the same, and the part of lines and device, by the clock of an emulated
device, which stands still while the host works: from the time stamp to the first carrier period of a pose.
"""

from __future__ import annotations

import struct
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any
from unittest.mock import patch

import trimesh
from bench import options, record
from phasewire import Emulator, Mesh, TransducerArray, open_device
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.host.hands.frames import HandFrame
from phasewire.host.hands.placing import PlacedHands
from phasewire.host.hands.sources import open_hands
from phasewire.host.streaming.device import Device
from phasewire.host.touching.latency import Latencies
from phasewire.host.touching.loop import TouchLoop, TouchMoment
from phasewire.protocol.board import CARRIER_HZ, TICK_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import AckFlag, Kind, Reason, Request, State
from phasewire.protocol.replies import Ack, Status
from phasewire.solver.contact.touch import Toucher

RATE = 1000
WARM_UP_SECONDS = 2.0
EFFECT_PERIODS = 4
"""After which an update for as soon as possible begins."""
PAGE_BYTES = 4096
SQUARE = "two-sided:envelope=square"
WAYS = (SQUARE, "am", "two-sided", "lm", "stm")
LINES = {"USB": "", "UART, 3 Mbaud": "?door=serial&baud=3000000", "UART, 115 200 baud": "?door=serial&baud=115200"}
PLAYING = (Kind.UPDATE, Kind.SEQUENCE)
GOALS = {"median_seconds": 0.5e-3, "p99_seconds": 1e-3}


class NullBus:
    """The stand-in for the bus under pyusb: it plays nothing and answers at once.

    Attributes
    ----------
    latency, processor : Latencies
        The latencies of the first block after each frame that plays something, from the frame to here.
    """

    def __init__(self, status: Status) -> None:
        self._status, self._origin = status, perf_counter()
        self._answer = b""
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self.latency, self.processor = Latencies(), Latencies()
        self.begun: tuple[float, float] | None = None
        self.blocks = 0

    def _tick(self) -> int:
        return self._status.now + int((perf_counter() - self._origin) * TICK_HZ)

    def write(self, _handle: Any, _endpoint: int, _interface: int, data: Any, _timeout: int) -> int:
        """Take a block."""
        if self.begun is not None and data[3] in PLAYING:
            stamp, processor = self.begun
            self.begun = None
            self.latency.add(time.monotonic() - stamp)
            self.processor.add(thread_time() - processor)
        self.blocks += 1
        sequence, period = struct.unpack_from("<IQ", bytes(data[:16]), 4)
        tick = self._tick()
        begins = max(period, tick // TICKS_PER_PERIOD + EFFECT_PERIODS)
        ack = Ack(Reason.ACCEPTED, sequence, begins, tick, AckFlag(0), self._status.free, State.PLAYING)
        self._answer = ack.encode()
        return len(data)

    def read(self, _handle: Any, _endpoint: int, _interface: int, buffer: Any, _timeout: int) -> int:
        """Give the acknowledgement."""
        buffer[: len(self._answer)] = array("B", self._answer)
        return len(self._answer)

    def control(
        self, _handle: Any, _kind: int, request: int, _value: int, _index: int, data: Any, _timeout: int
    ) -> int:
        """Answer what the loop asks: the status, with the time."""
        if request == Request.STATUS:
            answer = Status(**{**vars(self._status), "now": self._tick()}).encode()
            data[: len(answer)] = array("B", answer)
            return len(answer)
        return len(data) if data is not None else 0


class Timed(PlacedHands):
    """A source that tells the bus when each frame was due and was handed over."""

    bus: NullBus

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The next frame."""
        frame = super().next_frame(timeout)
        self.bus.begun = None if frame is None else (frame.time, thread_time())
        return frame


@contextmanager
def null_bus() -> Iterator[tuple[Device, NullBus]]:
    """A device whose transport is pyusb over a null bus."""
    with ExitStack() as stack:
        device = stack.enter_context(open_device(stack.enter_context(Emulator()).url))
        bus = NullBus(device.status())
        with ExitStack() as patched:
            for name, call in (("bulk_write", bus.write), ("bulk_read", bus.read), ("ctrl_transfer", bus.control)):
                patched.enter_context(patch.object(EmulatorBackend, name, lambda _self, *rest, do=call: do(*rest)))
            patched.enter_context(patch.object(device._session._line, "time", time))
            yield device, bus


def resident_bytes() -> int:
    """Resident memory of this process."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE_BYTES


def swept(name: str, mesh: Mesh, method: str, seconds: float, render: str = SQUARE) -> dict[str, Any]:
    """Let a hand sweep through an object for so many seconds; what came of it."""
    with null_bus() as (device, bus), Timed(open_hands(f"gesture:sweep?rate={RATE}", time)) as source:
        source.bus = bus
        memory: list[tuple[float, int]] = []
        begun = perf_counter()

        def look(_report: object) -> None:
            if not memory and perf_counter() - begun < WARM_UP_SECONDS:
                return
            if not memory:
                bus.forget()
            if not memory or perf_counter() - memory[-1][0] > max(seconds / 20, 1):
                memory.append((perf_counter(), resident_bytes()))

        loop = TouchLoop(device, source, [mesh], Toucher(), TransducerArray.grid(), method=method, render=render)
        report = loop.run(WARM_UP_SECONDS + seconds, look)
        memory.append((perf_counter(), resident_bytes()))
        return {
            "object": name,
            "faces": len(mesh.faces),
            "method": method,
            "render": render,
            "seconds": seconds,
            "latency": asdict(bus.latency.summary),
            "processor": asdict(bus.processor.summary),
            "blocks": bus.blocks,
            "growth_bytes": memory[-1][1] - memory[0][1],
            "report": report.record(),
        }


def line_and_device(render: str, line: str, seconds: float = 2.0) -> dict[str, Any]:
    """Seconds from time stamps to the first periods of their poses, by an emulated device's clock."""
    passed, begins = Latencies(), [0]
    with Emulator() as emulator, open_device(emulator.url + line) as device:

        def noted(call: Callable[..., Ack]) -> Callable[..., Ack]:
            def noting(*arguments: Any, **options: Any) -> Ack:
                ack = call(*arguments, **options)
                begins.append(ack.commit_period)
                return ack

            return noting

        def look(moment: TouchMoment) -> None:
            if moment.cycle is not None:
                passed.add(begins[-1] / CARRIER_HZ - moment.time)

        hands = PlacedHands(open_hands("gesture:approach?rate=100&seconds=2", device.time))
        loop = TouchLoop(device, hands, [Mesh.cube()], Toucher(), TransducerArray.grid(), render=render, on_moment=look)
        with patch.object(device, "show", noted(device.show)), patch.object(device, "play", noted(device.play)):
            loop.run(seconds)
    return asdict(passed.summary)


def objects() -> dict[str, Mesh]:
    """What is touched."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.05)
    return {"cube": Mesh.cube(), "fine sphere": Mesh.of(ball.vertices, ball.faces).moved((0, 0, 0.17))}


def main() -> None:
    """Measure, print, and write the figures on request."""
    parser = options(__doc__)
    parser.add_argument("--minutes", type=float, default=0.1, help="for each object")
    parser.add_argument("--method", default="wgs")
    arguments = parser.parse_args()
    print(f"From a hand to its block at the bus, {RATE:,} hands a second, {arguments.method}, in ms")
    print(f"{'':36}{'median':>8}{'99 %':>8}{'worst':>8}{'touching':>10}{'dropped':>9}{'slipped':>9}{'memory':>10}")
    rows = []
    for name, mesh in objects().items():
        row = swept(name, mesh, arguments.method, arguments.minutes * 60)
        rows.append(row)
        report = row["report"]
        for what, key in ((f"{name}, {row['faces']} faces", "latency"), ("  processor time", "processor")):
            figures = "".join(
                f"{row[key][each] * 1e3:>8.3f}" for each in ("median_seconds", "p99_seconds", "worst_seconds")
            )
            rest = f"{report['touching']:>10}{report['dropped']:>9}{report['slipped']:>9}"
            growth = f"{row['growth_bytes'] / 2**20:>+8.1f} MB"
            print(f"{what:36}{figures}" + (rest + growth if key == "latency" else ""))
        met = all(row["processor"][each] < goal for each, goal in GOALS.items())
        print(f"  {'meets' if met else 'MISSES'} 0.5 ms median and 1 ms at 99 %, in processor time")
    print("\nIn each way: host alone, then lines and device alone, median and 99 % in ms")
    print(f"{'':28}{'host':>16}{'its processor':>16}" + "".join(f"{line:>22}" for line in LINES))
    for way in WAYS:
        row = swept("cube", Mesh.cube(), arguments.method, arguments.minutes * 60, way)
        row["lines"] = {name: line_and_device(way, line) for name, line in LINES.items()}
        rows.append(row)
        shown = [row["latency"], row["processor"], *row["lines"].values()]
        widths = (16, 16, *[22] * len(LINES))
        texts = [f"{each['median_seconds'] * 1e3:.2f} {each['p99_seconds'] * 1e3:.2f}" for each in shown]
        print(f"{way:28}" + "".join(f"{text:>{width}}" for text, width in zip(texts, widths, strict=True)))
    record(arguments.json, rows)


if __name__ == "__main__":
    main()
