"""An observing host changes nothing, not even the numbering of blocks."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire import Emulator, Pulses, open_device
from phasewire.protocol.codes import State

FULL = Pulses(np.full(320, 25), np.full(320, 25))


@pytest.mark.parametrize("door", ["", "?door=serial"])
def test_observing_changes_neither_outputs_nor_counters(door: str) -> None:
    with Emulator() as emulator:
        with open_device(emulator.url) as device:
            device.store(0, FULL)
            device.play([(0, 100)], unattended=True)
            emulator.run(10)
            before = emulator.running.status()
            device.close()
        with open_device(emulator.url + door, observe=True) as looking:
            assert looking.status().state is State.UNATTENDED
            assert looking.read_back().pulses == FULL
        after = emulator.running.status()
    assert (after.state, after.since_period, after.accepted, after.lost) == (
        State.UNATTENDED,
        before.since_period,
        before.accepted,
        before.lost,
    )
