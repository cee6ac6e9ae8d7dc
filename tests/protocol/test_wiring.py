from __future__ import annotations

import numpy as np
import pytest
from phasewire.protocol import Pin, Wiring


@pytest.mark.parametrize(
    ("row", "column", "output"),
    [
        (0, 0, Pin(0, 0, 0)),
        (0, 3, Pin(0, 0, 3)),
        (1, 0, Pin(0, 0, 7)),  # back and forth: the second row runs backwards
        (1, 3, Pin(0, 0, 4)),
        (0, 4, Pin(1, 0, 0)),  # the next strip is the next board
        (8, 0, Pin(0, 1, 0)),  # the upper half is the second processor
        (15, 19, Pin(4, 1, 28)),
    ],
)
def test_strips_by_hand(row: int, column: int, output: Pin) -> None:
    assert Wiring.strips().pin(row * 20 + column) == output


def test_sort_and_unsort_follow_the_table(scrambled: Wiring) -> None:
    by_transducer = np.arange(320)
    by_channel = scrambled.sort(by_transducer)
    for transducer in (0, 1, 77, 319):
        board, processor, bit = scrambled.pin(transducer)
        assert by_channel[(board * 2 + processor) * 32 + bit] == transducer
    np.testing.assert_array_equal(scrambled.unsort(by_channel), by_transducer)


@pytest.mark.parametrize("channels", [np.zeros(320, int), np.arange(319), np.arange(1, 321)])
def test_a_table_that_is_not_one_to_one_is_refused(channels: np.ndarray) -> None:
    with pytest.raises(ValueError, match="each of the channels 0 to 319 exactly once"):
        Wiring(channels)
