"""Several devices that share one oscillator and one sync line, for arrays bigger than one chain (clause CHN-026).

The first device drives the line, the others listen: each begins its period 0 with a pulse, so that from then on all
change their fields in the same ticks, whatever their counts of periods are. Nothing else joins them. So each keeps its
own time, counted from the moment at which all got power; transfers to one let no time pass for the others, as on buses
of their own, and `Cluster.run_until` brings all to one moment. What it costs grows with the number of devices.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

from ..base.arguments import whole
from ..protocol.board import CYCLES_PER_PERIOD
from .machine import Emulator

__all__ = ["MOST_DEVICES", "Cluster"]

MOST_PERIODS = 2**40
MOST_DEVICES = 64


class Cluster:
    """Emulated devices on one sync line. As a context manager all of them are open.

    Parameters
    ----------
    count : int
        How many, 1 to 64.
    serial : str
        What their serial numbers begin with; a number follows.
    **options
        Options of each `Emulator`.

    Raises
    ------
    ValueError
        If there are none or too many.
    """

    def __init__(self, count: int, *, serial: str = "ARRAY", **options: Any) -> None:
        whole("number of devices", count, 1, MOST_DEVICES)
        driver = Emulator(serial=f"{serial}-00", **options)
        listeners = [
            Emulator(serial=f"{serial}-{number:02d}", sync=driver.sync, **options) for number in range(1, count)
        ]
        self.devices = (driver, *listeners)
        self._plugged = ExitStack()
        self.run_until(max(device.scheduler.now for device in self.devices))

    def __len__(self) -> int:
        return len(self.devices)

    def __iter__(self) -> Iterator[Emulator]:
        return iter(self.devices)

    def __enter__(self) -> Self:
        with ExitStack() as plugged:
            for device in self.devices:
                plugged.enter_context(device)
            self._plugged = plugged.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._plugged.close()

    @property
    def now(self) -> int:
        """Core cycles to which all devices have come."""
        return min(device.scheduler.now for device in self.devices)

    def run_until(self, cycle: int) -> None:
        """Let time pass on every device until a core cycle; none on those that are there already."""
        for device in self.devices:
            device.scheduler.run_until(max(cycle, device.scheduler.now))

    def run(self, periods: int) -> None:
        """Let carrier periods of 25 µs pass on every device, from where the last of them is."""
        periods = whole("periods", periods, 0, MOST_PERIODS)
        self.run_until(max(device.scheduler.now for device in self.devices) + periods * CYCLES_PER_PERIOD)
