"""What the tap takes from the bits: each of some fields in turn, and the moments that were played completely."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire import Emulator, Pulses, open_device
from phasewire.host.touching.turns import Alternation
from phasewire.view.tap import _fields, _plays


@pytest.mark.parametrize(("count", "hold"), [(2, 100), (5, 7), (24, 17)])
def test_fields_in_turn_are_shown_in_their_order(count: int, hold: int) -> None:
    frames = [Pulses(np.full(320, number % 2), np.full(320, number + 1)) for number in range(count)]
    with Emulator() as emulator, open_device(emulator.url) as device:
        for slot, frame in enumerate(frames):
            device.store(slot, frame)
        begins = device.play([(slot, hold) for slot in range(count)]).commit_period
        for periods in (3, 7, 8, 31):
            device.time.sleep(periods / 40_000 + count * hold / 40_000)
            capture = emulator.capture()
            shown = _fields(_plays(capture, capture.periods - 1, Alternation(hold, begins, count)), count)
            np.testing.assert_allclose(shown, [frame.to_drive() for frame in frames], atol=1e-6)
