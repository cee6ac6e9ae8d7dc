"""Every way to stop silences every way to play: what is emitted dies away with the ring-down of the resonance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest
from phasewire import Circle, Device, Emulator, PhasewireError, Pulses, TransducerArray, open_device, render
from phasewire.base.errors import DeviceLostError
from phasewire.hil.sound.emission import emitted_waves
from phasewire.host.streaming.cycles import play_cycle
from phasewire.host.streaming.envelopes import sine
from phasewire.protocol.board import CARRIER_HZ, WATCHDOG_MS
from phasewire.protocol.codes import SILENT_PERIODS

TEN_TIME_CONSTANTS = 120  # periods: 10 · 0.3 ms
WATCHDOG = WATCHDOG_MS * CARRIER_HZ // 1000 + 1  # periods (clause SAF-003)

Action = Callable[[], object]


def full(phase: int) -> Pulses:
    return Pulses(np.full(320, phase % 100), np.full(320, 25))


def field(device: Device, then: Action) -> None:
    device.show(full(7))
    device.keep_playing(0.01)
    then()


def sequence(device: Device, then: Action) -> None:
    for slot in range(200):
        device.store(slot, full(slot))
    device.play([(slot, 1) for slot in range(200)])
    device.keep_playing(0.0112)  # into the middle of its third turn
    then()


def modulated(device: Device, then: Action) -> None:
    device.show(full(7))
    device.modulate(*sine(200))
    device.keep_playing(0.0112)
    then()


def rendered(device: Device, then: Action) -> None:
    play_cycle(device, render(TransducerArray.grid(), Circle(radius=0.02), "stm:speed=5,modulation=200"))
    device.keep_playing(0.0112)
    then()


def stream(device: Device, then: Action) -> None:
    def source() -> Iterator[Pulses]:
        for index in range(60):
            if index == 40:
                then()
            yield full(index)

    with suppress(PhasewireError):  # it ends with what stopped it
        device.stream(source(), 2000, envelope=sine(200))


def stop(_: Emulator, device: Device) -> None:
    device.stop()


def silence(emulator: Emulator, device: Device) -> None:
    emulator.run_until(device.silence().commit_period)


def leave(_: Emulator, device: Device) -> None:
    device.__exit__(None, None, None)


def unplug(emulator: Emulator, _: Device) -> None:
    emulator.usb.unplug()


def fall_silent(emulator: Emulator, _: Device) -> None:
    emulator.run(WATCHDOG)


@pytest.mark.parametrize("end", [stop, silence, leave, unplug, fall_silent])
@pytest.mark.parametrize("play", [field, sequence, modulated, rendered, stream])
def test_what_is_emitted_dies_away(
    array: TransducerArray,
    emulator: Emulator,
    play: Callable[[Device, Action], None],
    end: Callable[[Emulator, Device], None],
) -> None:
    stopped: list[int] = []
    with suppress(DeviceLostError), open_device(emulator.url) as device:

        def then() -> None:
            emulator.run(1)
            assert np.abs(emitted_waves(emulator.capture(), array, *last_of(emulator)).waves).max() > 0.5
            end(emulator, device)
            stopped.append(emulator.capture().periods)
            emulator.run(2 * TEN_TIME_CONSTANTS)

        play(device, then)
    emitted = emitted_waves(emulator.capture(), array, stopped[0], stopped[0] + 2 * TEN_TIME_CONSTANTS)
    assert not emitted.duty[SILENT_PERIODS:].any()
    high = np.flatnonzero(emitted.duty.any(axis=1))
    since = int(high[-1]) + 1 if high.size else 0
    assert np.abs(emitted.waves[since + TEN_TIME_CONSTANTS :]).max() < 1e-3


def last_of(emulator: Emulator) -> tuple[int, int]:
    """The last 20 periods that have passed: a modulation may be silent in one."""
    periods = emulator.capture().periods
    return periods - 20, periods
