"""How much quieter the quiet ways are, from the bits of an emulated device, at the ears of a person who sits at it."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from phasewire import Capture, Circle, Cycle, Emulator, TransducerArray, open_device, render
from phasewire.feel.exposure import seated
from phasewire.feel.hearing import audible
from phasewire.hil import Playback
from phasewire.hil.emission import emitted_waves
from phasewire.host.playing.cycles import play_cycle
from phasewire.solver import Completion, quieted

ARRAY = TransducerArray.grid()
SHAPE = Circle(radius=0.03)
SETTLED, PERIODS = 400, 4000


class Heard(NamedTuple):
    """A-weighted levels of both parts at the loudest place in dB, and the force's change at 200 Hz, relative."""

    linear: float
    demodulated: float
    force: float

    def level(self, force: float) -> float:
        """The level at another force: one part grows as the drive, the other as its square, like the force."""
        up = 10 * np.log10(force / self.force)
        return float(10 * np.log10(10 ** ((self.linear + up) / 10) + 10 ** ((self.demodulated + 2 * up) / 10)))


@cache
def heard(name: str) -> Heard:
    """What a way emits, after it has been repeated for 10 ms."""
    cycle = render(ARRAY, SHAPE, "two-sided:envelope=square" if name == "autd3" else name)
    played = quieted(cycle, Completion()) if name == "autd3" else cycle
    bits, first = repeated(played)
    emitted = emitted_waves(bits, ARRAY, first, first + PERIODS)
    sound = audible(ARRAY, emitted.waves, emitted.pulses, seated(ARRAY))
    force = Playback(bits, ARRAY).intensity_component(SHAPE, 200.0, first, first + PERIODS).mean()
    linear, demodulated = (float(sound.weighted(part).max()) for part in ("linear", "demodulated"))
    return Heard(linear, demodulated, float(force))


def repeated(cycle: Cycle) -> tuple[Capture, int]:
    """The outputs of a device that repeats a cycle, and the period from which on it has settled."""
    emulator = Emulator()
    with emulator, open_device(emulator.url) as device:
        device.set_watchdog(2.0)
        ack = play_cycle(device, cycle).ack
        emulator.run_until(ack.commit_period + SETTLED + PERIODS)
    return emulator.capture(), ack.commit_period + SETTLED


def test_quiet_halves_are_20_db_below_switched_ones_at_the_same_force() -> None:
    quiet = heard("two-sided")
    assert heard("two-sided:envelope=square").level(quiet.force) - quiet.level(quiet.force) >= 20


def test_quiet_halves_are_6_db_below_autd3_s_silencer_at_the_same_force() -> None:
    quiet = heard("two-sided")
    assert heard("autd3").level(quiet.force) - quiet.level(quiet.force) >= 6


def test_quiet_halves_are_as_strong_as_switched_ones() -> None:
    assert heard("two-sided").force == pytest.approx(heard("two-sided:envelope=square").force, rel=0.15)
