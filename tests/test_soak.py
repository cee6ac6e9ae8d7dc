"""Some seconds of what `make soak` does for hours."""

from __future__ import annotations

import pytest

from tests.soak import Episode


@pytest.mark.slow
@pytest.mark.parametrize("on_chain", [False, True], ids=["line", "chain"])
def test_nothing_is_shown_out_of_order_and_nothing_lost_without_being_counted(on_chain: bool) -> None:
    tally = Episode(2, 20.0, on_chain=on_chain).run()
    assert tally.faults.total() >= 2
    assert tally.shown > 500
