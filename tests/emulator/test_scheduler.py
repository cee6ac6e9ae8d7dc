from __future__ import annotations

from functools import partial

import pytest
from phasewire.emulator.scheduler import Scheduler


def test_actions_run_in_order_of_time_then_of_scheduling() -> None:
    scheduler = Scheduler()
    seen: list[tuple[int, str]] = []

    def note(name: str) -> None:
        seen.append((scheduler.now, name))

    for time, name in ((5, "b"), (3, "a"), (5, "c")):
        scheduler.at(time, partial(note, name))
    scheduler.run_until(4)
    assert (seen, scheduler.now) == ([(3, "a")], 4)
    scheduler.run_until(5)
    assert seen == [(3, "a"), (5, "b"), (5, "c")]


def test_the_past_is_closed() -> None:
    scheduler = Scheduler()
    scheduler.run_until(10)
    with pytest.raises(ValueError, match="cycle 9 is in the past; it is cycle 10"):
        scheduler.at(9, lambda: None)
