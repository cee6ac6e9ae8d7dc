"""Some seconds of `make soak`."""

from __future__ import annotations

import pytest

from tests.soak import Episode


@pytest.mark.slow
@pytest.mark.parametrize("on_chain", [False, True], ids=["line", "chain"])
def test_frames_stay_in_order_and_every_loss_is_counted(on_chain: bool) -> None:
    tally = Episode(2, 20.0, on_chain=on_chain).run()
    assert tally.faults.total() >= 2
    assert tally.shown > 500
