"""How much quieter the quiet ways are, from the bits of an emulated device, at the ears of a person who sits at it."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Capture, Circle, ControlPoints, Cycle, Emulator, TransducerArray, open_device, render
from phasewire.feel.exposure import exposure_at, exposure_limit, seated
from phasewire.feel.hearing import audible
from phasewire.hil import Playback
from phasewire.hil.sound.emission import emitted_waves
from phasewire.host.streaming.cycles import play_cycle
from phasewire.host.streaming.limiting import Limit
from phasewire.solver import Completion, quieted

ARRAY = TransducerArray.grid()
SHAPE = Circle(radius=0.03)
SETTLED, PERIODS = 400, 4000


class Heard(NamedTuple):
    """A-weighted levels of both parts at each ear in dB, and the force's change at 200 Hz, relative."""

    linear: NDArray[np.float64]
    demodulated: NDArray[np.float64]
    force: float

    def level(self, force: float) -> float:
        """The level at the louder ear at another force: one part grows as the drive, the other as the force itself."""
        up = 10 * np.log10(force / self.force)
        powers = 10 ** ((self.linear + up) / 10) + 10 ** ((self.demodulated + 2 * up) / 10)
        return float(10 * np.log10(powers.max()))


@cache
def heard(name: str) -> Heard:
    """What a way emits, after it has been repeated for 10 ms."""
    cycle = render(ARRAY, SHAPE, "two-sided:envelope=square" if name == "autd3" else name)
    played = quieted(cycle, Completion()) if name == "autd3" else cycle
    bits, first = repeated(played)
    emitted = emitted_waves(bits, ARRAY, first, first + PERIODS)
    sound = audible(ARRAY, emitted.waves, emitted.pulses, seated(ARRAY)[:2])
    force = Playback(bits, ARRAY).intensity_component(SHAPE, 200.0, first, first + PERIODS).mean()
    return Heard(sound.weighted("linear"), sound.weighted("demodulated"), float(force))


def repeated(cycle: Cycle, limit: Limit | None = None) -> tuple[Capture, int]:
    """The outputs of a device that repeats a cycle, and the period from which on it has settled."""
    emulator = Emulator()
    with emulator, open_device(emulator.url) as device:
        device.set_watchdog(2.0)
        ack = play_cycle(device, cycle, limit=limit).ack
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


@pytest.mark.parametrize("way", ["two-sided:envelope=square", "two-sided", "am", "lm", "stm"])
@pytest.mark.parametrize("limit_db", [128.0, 120.0])
def test_a_limit_of_exposure_is_kept_by_what_is_emitted(way: str, limit_db: float) -> None:
    """Also while one drive follows another, and in spite of the rounding to pulses."""
    bits, first = repeated(render(ARRAY, SHAPE, way), exposure_limit(ARRAY, None, limit_db))
    emitted = emitted_waves(bits, ARRAY, first, first + PERIODS)
    loudest = exposure_at(ARRAY, emitted.waves).greatest_db.max()
    assert limit_db - 7 < loudest <= limit_db  # pulses of three ticks and of two are 3.5 dB apart


@pytest.mark.parametrize("way", ["two-sided:envelope=square", "two-sided", "stm:foci=2"])
def test_nulls_at_the_listeners_hide_no_transition(way: str) -> None:
    """In the steady state nothing arrives there; while drives change much does."""
    points = ControlPoints([*SHAPE.sample().positions, *seated(ARRAY)], [1.0] * len(SHAPE.sample()) + [0.0] * 3)
    bits, first = repeated(render(ARRAY, points, way), exposure_limit(ARRAY, None, 120.0))
    emitted = emitted_waves(bits, ARRAY, first - SETTLED - 10, first + PERIODS)
    assert exposure_at(ARRAY, emitted.waves).greatest_db.max() <= 120.0
