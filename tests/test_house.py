"""Numbers that two rooms must know without knowing each other."""

from __future__ import annotations

import pytest
from phasewire import Medium, TransducerArray
from phasewire.protocol import board


def test_the_solver_s_default_array_is_the_board_s() -> None:
    array = TransducerArray.grid()
    assert len(array) == board.CHANNELS == board.COLUMNS * board.ROWS
    assert array.positions[1, 0] - array.positions[0, 0] == pytest.approx(board.PITCH_M)
    assert (array.positions[:, 0] == array.positions[0, 0]).sum() == board.ROWS


def test_the_solver_s_default_carrier_is_the_board_s() -> None:
    assert Medium().frequency == board.CARRIER_HZ
