"""autd3 streaming to its emulator by UDP on loopback. It runs in the environment of ``autd3.txt``.

``autd3_streaming.py`` without a task is that emulator alone: it prints its address, and ends with its input.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count
from time import perf_counter, process_time
from typing import Any

from autd3 import Client, ClientConfig, Duration, Interface, UdpEmulator, UdpOption
from autd3.commands import Pattern, SetSilencer
from autd3.geometry import Autd3, Geometry
from throughput import Entry, Streamed, Task, Way, main

STEPS = 256  # of a phase and of an intensity
AT_ONCE = 32
"""Sends that wait for their acknowledgements; its client lets 7 of them be on their way at a time."""
PATIENCE = Duration.from_secs(1)
"""For acknowledgements; its default of 10 ms would fail on a busy machine."""
END_SECONDS = 5.0

Sender = Callable[["Session", float], Awaitable[int]]


class Session:
    """A client that has fresh patterns."""

    def __init__(self, client: Any, geometry: Any, task: Task) -> None:
        self.client = client
        self._geometry = geometry
        shape = (task.patterns, 1, Autd3.NUM_TRANSDUCERS)
        self._phases = task.random(Autd3.NUM_TRANSDUCERS, STEPS, 1).reshape(shape)
        self._intensities = task.random(Autd3.NUM_TRANSDUCERS, STEPS, 2).reshape(shape)

    def patterns(self, first: int = 0) -> Iterator[Any]:
        """One pattern after the other, from NumPy arrays."""
        phases, intensities = self._geometry.phase_buffer(), self._geometry.intensity_buffer()
        for number in count(first):
            phases.copy_from(self._phases[number % len(self._phases)])
            intensities.copy_from(self._intensities[number % len(self._intensities)])
            yield Pattern(phases, intensities)

    async def arrived(self) -> int:
        """Commands that the device has carried out."""
        return int((await self.client.read_telemetry())[0].processed)


async def send(session: Session, end: float, first: int = 0) -> int:
    """Send one after the other, each when the one before is acknowledged."""
    patterns, sent = session.patterns(first), 0
    while perf_counter() < end:
        await session.client.send(next(patterns))
        sent += 1
    return sent


async def send_streaming(session: Session, end: float) -> int:
    """Send without waiting for any acknowledgement but the last; the client limits the sends that are on their way."""
    patterns, sent = session.patterns(), 0
    while sent == 0 or perf_counter() < end:
        acknowledged = await session.client.send_streaming(next(patterns))
        sent += 1
    await acknowledged
    return sent


async def send_at_once(session: Session, end: float) -> int:
    """Let several tasks send one after the other, each patterns of its own."""
    return sum(await asyncio.gather(*(send(session, end, 8 * task) for task in range(AT_ONCE))))


@contextmanager
def emulator_here() -> Iterator[Any]:
    """An emulator in this process, which runs on threads of its own; its address."""
    emulator = UdpEmulator(1)  # it listens as long as this name is there
    yield emulator.option().iface


@contextmanager
def emulator_apart() -> Iterator[Any]:
    """An emulator in a process of its own; its address."""
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, __file__], stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            yield Interface.Addr(process.stdout.readline().strip())
        finally:
            process.stdin.close()
            try:
                process.wait(END_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()


def be_emulator() -> None:
    """Print an emulator's address, and run it until the input ends."""
    with emulator_here() as listens:
        print(repr(listens).partition('"')[2].partition('"')[0], flush=True)
        sys.stdin.read()


def enter(task: Task) -> Entry:
    """Three ways to send, to an emulator here and to one in a process of its own."""
    geometry = Geometry([Autd3()])

    async def measured(sender: Sender, listens: Any, seconds: float) -> Streamed:
        async with await Client.open(geometry, UdpOption(iface=listens), ClientConfig(ack_timeout=PATIENCE)) as client:
            await client.send(SetSilencer.disable())
            session = Session(client, geometry, task)
            before = await session.arrived()
            begun, used = perf_counter(), process_time()
            sent = await sender(session, begun + seconds)
            passed, used = perf_counter() - begun, process_time() - used
            arrived = await session.arrived() - before - 1  # the question itself is a command
            if arrived != sent:
                raise RuntimeError(f"{sent} patterns were sent, {arrived} carried out")
            return Streamed(sent, passed, used)

    def stream(sender: Sender, emulator: Any, seconds: float) -> Streamed:
        with emulator() as listens:
            return asyncio.run(measured(sender, listens, seconds))

    senders: dict[str, Sender] = {
        "send, one after the other": send,
        "send_streaming, acknowledged at the end": send_streaming,
        f"send by {AT_ONCE} tasks at once": send_at_once,
    }
    return Entry(
        geometry.num_transducers(),
        [
            Way(f"UDP: {name}", emulator is emulator_apart, partial(stream, sender, emulator))
            for emulator in (emulator_apart, emulator_here)
            for name, sender in senders.items()
        ],
        [
            "A pattern is copied from NumPy arrays of phases and intensities into its buffers, encoded and sent; its "
            "emulator stores it and acknowledges, and knows no time. It counts what it carried out: as many as were "
            "sent.",
            "Its client and its emulator have threads of their own, so two cores can be at work.",
        ],
    )


if __name__ == "__main__":
    main(enter) if len(sys.argv) > 1 else be_emulator()
