"""What the live page costs: the loop that plays beside it, processor time, planes, and memory.

``python benchmarks/view.py`` takes a minute. A process of its own stands for the browser: it takes frames in and
answers each, and draws nothing, so that only what phasewire does is measured. The loop of touch is that of `touch`,
1000 hands a second over a null bus, with the page and without it in turn. ``--hours 1`` lets a loop run for so much of
an emulated device's time with a page open, and tells how the memory grows.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter, process_time, thread_time
from typing import Any

import numpy as np
from bench import median
from phasewire import Emulator, Hand, Mesh, Sphere, TransducerArray, open_device, solve
from phasewire.host.hands.placing import PlacedHands
from phasewire.host.hands.sources import open_hands
from phasewire.host.touching.loop import TouchLoop
from phasewire.protocol.codes import Request
from phasewire.protocol.replies import ANSWER_BYTES
from phasewire.solver.contact.touch import Toucher
from phasewire.view import Emitter, Snapshot, View
from phasewire.view.painting import Painter
from phasewire.view.past import HISTORY_PERIODS
from phasewire.view.settings import Settings
from phasewire.view.tap import Tap, emitter_of
from touch import RATE, NullBus, Timed, null_bus, resident_bytes

ARRAY = TransducerArray.grid()
SECONDS, ROUNDS = 5.0, 4
OFFERED = 40

PAGE = """
import sys
from websockets.sync.client import connect
host, token = sys.argv[1].removeprefix("http://").split("/#")
frames = 0
with connect(f"ws://{host}/ws?token={token}", origin=f"http://{host}", max_size=None, proxy=None) as socket:
    for message in socket:
        if b'"kind":"frame"' in message[:40]:
            socket.send("ack")
            frames += 1
print(frames)
"""


@contextmanager
def page(view: View) -> Iterator[subprocess.Popen[str]]:
    """A page in another process."""
    process = subprocess.Popen([sys.executable, "-c", PAGE, view.url], stdout=subprocess.PIPE, text=True)
    try:
        assert view.server.seen.wait(30)
        yield process
    finally:
        process.kill()
        process.wait()


def planes() -> None:
    """The field plane of a new drive, by itself."""
    drives = np.stack([solve(ARRAY, Sphere().sample()).drive] * 2)
    for name, settings in (("horizontal", Settings()), ("upright", Settings(xy=False, xz=True))):
        painter = Painter(Emitter(ARRAY))
        for count in (1, 2):
            seconds = median(lambda: painter.paint(Snapshot(drives[:count]), settings))
            print(f"{name} plane, {count} field{'s' * (count > 1)}: {seconds * 1e3:.2f} ms")


def share() -> None:
    """Processor time of the view beside that of the fields, at so many snapshots a second."""
    painter_seconds = [0.0]
    paint = Painter.paint

    def timed(*arguments: Any) -> Any:
        before = thread_time()
        try:
            return paint(*arguments)
        finally:
            painter_seconds[0] += thread_time() - before

    Painter.paint = timed  # type: ignore[method-assign, assignment]
    solution = solve(ARRAY, Sphere().sample())
    with View(ARRAY) as view, page(view):
        hand, cube = Hand.flat(), Mesh.cube()
        begun, processor, number = perf_counter(), process_time(), 0
        painter_seconds[0] = 0.0
        published = 0
        real = view.server.publish

        def count(frame: bytes) -> None:
            nonlocal published
            published += 1
            real(frame)

        view.server.publish = count  # type: ignore[method-assign]
        while (passed := perf_counter() - begun) < SECONDS:
            points = np.column_stack([solution.points.positions, solution.points.amplitudes])
            drives = np.stack([solution.drive, solution.drive]) * np.exp(1j * number)
            view.show(
                Snapshot(
                    drives,
                    round(passed * 40_000),
                    hands=[hand.moved((0, 0, 1e-4 * number % 0.01))],
                    objects=[cube],
                    points=points,
                )
            )
            number += 1
            time.sleep(max(0.0, begun + number / OFFERED - perf_counter()))
        used = process_time() - processor
    Painter.paint = paint  # type: ignore[method-assign]
    fields = painter_seconds[0]
    own, share_of_fields = (100 * each / passed for each in (used - fields, fields))
    print(f"{published / passed:.1f} frames/s of {OFFERED} offered: {own:.1f} % of a core, and", end=" ")
    print(f"{share_of_fields:.1f} % for the fields of a plane")


class Answering(NullBus):
    """A null bus that also answers what a tap asks."""

    answers: dict[int, bytes]

    def control(self, *arguments: Any) -> int:
        """Answer a request."""
        _, _, request, _, _, data, _ = arguments
        answer = self.answers.get(request)
        if answer is None:
            return super().control(*arguments)
        data[: len(answer)] = type(data)("B", answer)
        return len(answer)


def loop(*, watched: bool) -> dict[str, float]:
    """Latencies of the loop of touch, with a page or without."""
    with null_bus() as (device, bus), Timed(open_hands(f"gesture:sweep?rate={RATE}", time)) as source:
        source.bus = bus
        watching: list[Tap] = []
        made: list[TouchLoop] = []

        def on_moment(moment: Any) -> None:
            for tap in watching:
                tap.take_moment(moment, made[0])

        made.append(TouchLoop(device, source, [Mesh.cube()], Toucher(), ARRAY, on_moment=on_moment))
        if not watched:
            made[0].run(SECONDS)
        else:
            with View(Emitter(ARRAY)) as view, page(view):
                view.warm_up()
                with Tap(device, view) as tap:
                    watching.append(tap)
                    made[0].run(SECONDS)
        latency, processor = bus.latency.summary, bus.processor.summary
        return {
            "median": latency.median_seconds * 1e3,
            "99 %": latency.p99_seconds * 1e3,
            "processor median": processor.median_seconds * 1e3,
            "processor 99 %": processor.p99_seconds * 1e3,
        }


def answers() -> dict[int, bytes]:
    """What a device answers to a tap."""
    with Emulator() as emulator, open_device(emulator.url) as device:
        line = device._session._line
        return {
            int(request): bytes(line.query(request, ANSWER_BYTES[request]))
            for request in (Request.PULSES, Request.PROCESSORS)
        }


def latencies() -> None:
    """With the page and without it in turn, and the ratio of the medians over the rounds."""
    Answering.answers = answers()
    import touch

    touch.NullBus = Answering  # type: ignore[misc]
    rows: dict[bool, list[dict[str, float]]] = {True: [], False: []}
    for _ in range(ROUNDS):
        for watched in (False, True):
            rows[watched].append(loop(watched=watched))
    print(f"{'loop of touch, ms':24}{'alone':>10}{'with page':>12}{'ratio':>8}")
    for name in rows[True][0]:
        alone, beside = (statistics.median(row[name] for row in rows[watched]) for watched in (False, True))
        print(f"{name:24}{alone:>10.3f}{beside:>12.3f}{beside / alone:>8.2f}")


def soak(hours: float) -> None:
    """An emulated device's hours with a page open, as fast as this computer allows."""
    with (
        Emulator(history_periods=HISTORY_PERIODS) as emulator,
        open_device(emulator.url) as device,
        View(emitter_of(device, ARRAY), settings=Settings(watched=(0, 5))) as view,
        page(view),
        Tap(device, view, emulator) as tap,
    ):
        made: list[TouchLoop] = []
        source = PlacedHands(open_hands("gesture:sweep?rate=120", device.time))
        memory: list[tuple[float, int]] = []

        def look(report: Any) -> None:
            if report.seconds > (len(memory) + 1) * hours * 3600 / 20:
                memory.append((report.seconds, resident_bytes()))
                print(f"{report.seconds / 60:6.1f} min {memory[-1][1] / 2**20:8.1f} MB", flush=True)

        def on_moment(moment: Any) -> None:
            tap.take_moment(moment, made[0])

        made.append(TouchLoop(device, source, [Mesh.cube()], Toucher(), ARRAY, on_moment=on_moment))
        made[0].run(hours * 3600, look)
        print(f"growth since the first {memory[0][0] / 60:.0f} min: {(memory[-1][1] - memory[0][1]) / 2**20:+.1f} MB")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=0, help="of an emulated device's time, for the memory alone")
    arguments = parser.parse_args()
    if arguments.hours:
        soak(arguments.hours)
        return
    planes()
    share()
    latencies()


if __name__ == "__main__":
    main()
