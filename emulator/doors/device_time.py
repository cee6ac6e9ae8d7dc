"""An emulated device's time, for a host in the same process that waits by it.

It does not pass by itself: between two transfers it stands still, unless a caller waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ...protocol.board import CORE_HZ
from ..scheduler import Scheduler

__all__ = ["DeviceTime"]


class DeviceTime:
    """A clock and a way to wait, like Python's module `time`, in seconds of a device.

    Parameters
    ----------
    scheduler : Scheduler
        The device's time.
    pass_until : callable, optional
        What lets time pass until a core cycle, for a door with other work meanwhile.
    """

    def __init__(self, scheduler: Scheduler, pass_until: Callable[[int], None] | None = None) -> None:
        self._scheduler = scheduler
        self._pass_until = pass_until or scheduler.run_until

    def monotonic(self) -> float:
        """Seconds since power was first applied."""
        return self._scheduler.now / CORE_HZ

    def sleep(self, seconds: float, /) -> None:
        """Let time pass; raises `ValueError` if it would go back."""
        if seconds < 0:
            raise ValueError(f"{seconds} seconds cannot pass; at least 0")
        self._pass_until(self._scheduler.now + math.ceil(seconds * CORE_HZ))
