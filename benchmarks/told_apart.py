"""A device in this process whose emulator is told apart from its host.

What the emulator does it does in calls of the bus and while time passes, so the processor time of these is its; what
else the process spends is the host's: streaming, session, transport, pyusb.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from time import perf_counter, thread_time
from typing import NamedTuple, ParamSpec, TypeVar

import usb.core
from phasewire import Emulator
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.host.device import Device
from phasewire.host.usb import UsbTransport
from phasewire.protocol.codes import BLOCK_BYTES

__all__ = ["Bus", "ToldApart", "open_told_apart"]

Given = ParamSpec("Given")
Answer = TypeVar("Answer")

HISTORY_PERIODS = 4000  # nobody looks at what the outputs did


class Bus:
    """What the bus has seen.

    Attributes
    ----------
    seconds : float
        Processor time spent on its side of the calls.
    writes : list of (float, float, int)
        For each transfer of blocks: when it was handed over, by the wall clock and in processor time of the thread,
        and how many blocks it had.
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

    def noted(self, write: Callable[Given, Answer]) -> Callable[Given, Answer]:
        """The same call of ``bulk_write``, counted, whose begin is noted."""
        counted = self.counted(write)

        @wraps(write)
        def timed(*args: Given.args, **kwargs: Given.kwargs) -> Answer:
            data = args[3]
            self.writes.append((perf_counter(), thread_time(), len(data) // BLOCK_BYTES))  # type: ignore[arg-type]
            return counted(*args, **kwargs)

        return timed


class ToldApart(NamedTuple):
    """A device, and the bus that it is on."""

    device: Device
    bus: Bus


def open_told_apart() -> ToldApart:
    """Open a fresh emulated device by pyusb."""
    emulator, bus = Emulator(history_periods=HISTORY_PERIODS), Bus()
    backend = EmulatorBackend([emulator])
    transport = UsbTransport(usb.core.find(backend=backend), emulator.serial, backend)
    for owner, name, wrap in (
        (backend, "bulk_write", bus.noted),
        (backend, "bulk_read", bus.counted),
        (backend, "ctrl_transfer", bus.counted),
        (transport.time, "sleep", bus.counted),
    ):
        setattr(owner, name, wrap(getattr(owner, name)))
    return ToldApart(Device(transport), bus)
