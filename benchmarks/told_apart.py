"""A device, or a rig of some, in this process, with emulators that are told apart from their host.

The emulator works in calls of the bus and while time passes, so the processor time of these is the emulator's. The rest
of the process's time is the host's: streaming, session, transport, pyusb.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from time import perf_counter, thread_time
from typing import ParamSpec, TypeVar
from unittest.mock import patch

from phasewire import DeviceGroup, Emulator, RigDevice, TransducerArray, open_devices
from phasewire.emulator.cluster import Cluster
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.emulator.doors.device_time import DeviceTime
from phasewire.host.streaming.device import Device, open_device
from phasewire.protocol.codes import BLOCK_BYTES

__all__ = ["Bus", "rig_told_apart", "told_apart"]

Given = ParamSpec("Given")
Answer = TypeVar("Answer")

HISTORY_PERIODS = 4000  # no benchmark reads what the outputs did


class Bus:
    """What the bus has seen.

    Attributes
    ----------
    seconds : float
        Processor time spent on its side of the calls.
    writes : list of (float, float, int)
        One entry for each transfer of blocks: when it was handed over, by the wall clock and in processor time of the
        thread, and how many blocks of it were taken.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.writes: list[tuple[float, float, int]] = []

    def forget(self) -> None:
        """Begin anew."""
        self.seconds = 0.0
        self.writes.clear()

    def counted(self, call: Callable[Given, Answer]) -> Callable[Given, Answer]:
        """The same call, whose processor time is counted."""

        @wraps(call)
        def timed(*args: Given.args, **kwargs: Given.kwargs) -> Answer:
            before = thread_time()
            try:
                return call(*args, **kwargs)
            finally:
                self.seconds += thread_time() - before

        return timed

    def noted(self, write: Callable[Given, int]) -> Callable[Given, int]:
        """The same call of ``bulk_write``, counted, whose begin is noted with the blocks that were taken."""
        counted = self.counted(write)

        @wraps(write)
        def timed(*args: Given.args, **kwargs: Given.kwargs) -> int:
            handed = perf_counter(), thread_time()
            taken = counted(*args, **kwargs)
            self.writes.append((*handed, taken // BLOCK_BYTES))
            return taken

        return timed


@contextmanager
def told_apart() -> Iterator[tuple[Device, Bus]]:
    """A fresh emulated device, opened by pyusb, and its bus."""
    with (
        seen_bus() as bus,
        Emulator(history_periods=HISTORY_PERIODS) as emulator,
        open_device(emulator.url) as device,
    ):
        yield device, bus


@contextmanager
def rig_told_apart(count: int) -> Iterator[tuple[DeviceGroup, Bus]]:
    """Emulated devices on one sync line, opened as a rig, and their bus."""
    board = TransducerArray.grid()
    with seen_bus() as bus, Cluster(count, history_periods=HISTORY_PERIODS) as cluster:
        rig = [RigDevice(each.url, board.moved([0, 0, 0.1 * place])) for place, each in enumerate(cluster)]
        with open_devices(rig) as group:
            yield group, bus


@contextmanager
def seen_bus() -> Iterator[Bus]:
    """The bus of all emulated devices of this process, watched."""
    bus = Bus()
    with ExitStack() as stack:
        for owner, name, wrap in (
            (EmulatorBackend, "bulk_write", bus.noted),
            (EmulatorBackend, "bulk_read", bus.counted),
            (EmulatorBackend, "ctrl_transfer", bus.counted),
            (DeviceTime, "sleep", bus.counted),
        ):
            stack.enter_context(patch.object(owner, name, wrap(getattr(owner, name))))
        yield bus
