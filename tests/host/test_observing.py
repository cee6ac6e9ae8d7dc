"""An observing host changes nothing, not even the numbering of blocks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from phasewire import Device, Emulator, Pulses, open_device
from phasewire.host import Calibration
from phasewire.host.transports.opening import open_transport
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


def test_reading_back_over_the_serial_line_does_not_disturb_a_stream_over_usb() -> None:
    def source(device: Device) -> Iterator[Pulses]:
        for index in range(60):
            if index == 30:
                with open_device(f"emulator:{emulator.serial}?door=serial&baud=3000000", observe=True) as looking:
                    assert looking.status().state is State.PLAYING
            yield FULL

    with Emulator() as emulator, open_device(emulator.url) as device:
        report = device.stream(source(device), 200)
        status = device.status()
    assert (report.accepted, status.lost, status.accepted) == (60, 0, 61)


def test_a_calibration_of_another_size_is_refused_before_anything_is_stopped() -> None:
    with Emulator() as emulator:
        with open_device(emulator.url) as device:
            device.store(0, FULL)
            device.play([(0, 100)], unattended=True)
            device.close()
        transport = open_transport(emulator.url)
        with pytest.raises(ValueError, match="calibration is for 16 transducers, the device has 320"):
            Device(transport, calibration=Calibration.perfect(16))
        assert emulator.running.status().state is State.UNATTENDED
