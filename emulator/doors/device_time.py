"""An emulated device's time, for a host in the same process that waits by it.

Nothing makes it pass by itself: it stands still between two transfers, unless somebody waits for it to pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ...protocol.board import CORE_HZ
from ..scheduler import Scheduler

__all__ = ["DeviceTime"]


class DeviceTime:
    """A clock and a way to wait, as Python's module `time` is, in seconds of a device.

    Parameters
    ----------
    scheduler : Scheduler
        The device's time.
    pass_until : callable, optional
        Lets time pass until a core cycle, for a door that has something to do meanwhile.
    """

    def __init__(self, scheduler: Scheduler, pass_until: Callable[[int], None] | None = None) -> None:
        self._scheduler = scheduler
        self._pass_until = pass_until or scheduler.run_until

    def monotonic(self) -> float:
        """Seconds since power was first applied."""
        return self._scheduler.now / CORE_HZ

    def sleep(self, seconds: float, /) -> None:
        """Let time pass; raise `ValueError` where it would go back."""
        if seconds < 0:
            raise ValueError(f"{seconds} seconds cannot pass; at least 0")
        self._pass_until(self._scheduler.now + math.ceil(seconds * CORE_HZ))
