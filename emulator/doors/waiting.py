"""A wait for any number of files that ends at a moment exact to some tens of microseconds.

A device's queue is empty after 0.8 ms. epoll and poll end their waits at whole milliseconds, and select refuses file
number 1024 and all above. A selector of epoll is itself a file with one small number: select waits for that one.
"""

from __future__ import annotations

import select
import selectors
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

__all__ = ["PreciseSelector"]

if sys.platform == "linux" or TYPE_CHECKING:

    class PreciseSelector(selectors.EpollSelector):
        """A selector for any number of files whose waits are exact."""

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            """Wait for files, at most so many seconds; returns those that are ready, as `selectors` says."""
            if timeout is not None and timeout > 0:
                with suppress(ValueError):  # this program had a thousand open files before
                    select.select([self], [], [], timeout)
                    timeout = 0
            return super().select(timeout)

else:
    PreciseSelector = selectors.DefaultSelector  # kqueue is exact; Windows has nothing but select
