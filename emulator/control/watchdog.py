"""The watchdog: it fires if the host gives no sign of life for the watchdog time (clause SAF-003)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ...protocol.board import CYCLES_PER_MS, WATCHDOG_MS
from ..scheduler import Scheduler

__all__ = ["Watchdog"]


class Watchdog:
    """Watches, or rests."""

    def __init__(self, scheduler: Scheduler, settle: Callable[[], None], on_fire: Callable[[], None]) -> None:
        self._scheduler = scheduler
        self._settle = settle
        self._on_fire = on_fire
        self.milliseconds = WATCHDOG_MS
        self._fed = scheduler.now
        self._watching = False
        self._armed = 0  # the last time that it was set; earlier ones count no more

    def feed(self) -> None:
        """Restart the time: a sign of life has arrived.

        Called for each accepted block (`execution`, `batches`), for STATUS and for ENABLE while enabled (`requests`);
        never for a refused block.
        """
        self._fed = self._scheduler.now

    def watch(self, since: int) -> None:
        """Begin to watch, with the time counted from a core cycle instead of from the last sign of life."""
        self._fed = since
        self._watching = True
        self._arm()

    def rest(self) -> None:
        """Watch no more."""
        self._watching = False

    def set_time(self, milliseconds: int) -> None:
        """Choose how long the host may be silent, from its last sign of life on (clause REQ-009)."""
        self.milliseconds = milliseconds
        if self._watching:
            self._arm()

    @property
    def _due(self) -> int:
        return self._fed + self.milliseconds * CYCLES_PER_MS

    def _arm(self) -> None:
        self._armed += 1
        self._scheduler.at(max(self._scheduler.now, self._due), partial(self._check, self._armed))

    def _check(self, armed: int) -> None:
        self._settle()
        if armed != self._armed or not self._watching:
            return
        if self._scheduler.now < self._due:
            self._arm()
        else:
            self._on_fire()
