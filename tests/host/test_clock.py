"""The estimate of a device's clock, against clocks that are known: offset, drift, and readings that took their time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.host.streaming.clock import READINGS, DeviceClock, Reading

TICK_HZ = 2_000_000
PERIOD = 25e-6


def reading(offset: float, drift_ppm: float, begins: float, takes: float, where: float) -> Reading:
    """The answer of a device that is asked at a moment, and reads its clock after a fraction of the time."""
    at = begins + where * takes
    return Reading(begins, begins + takes, int((at * (1 + drift_ppm * 1e-6) + offset) * TICK_HZ))


def error(clock: DeviceClock, offset: float, drift_ppm: float, moment: float) -> float:
    """The error of the estimate at a moment, in seconds."""
    return clock.period_at(moment) * PERIOD - (moment * (1 + drift_ppm * 1e-6) + offset)


def test_one_reading_by_hand() -> None:
    """Asked at 10 s, answered 2 ms later: the device stood at tick 5 000 000, which is period 100 000, at 10.001 s."""
    clock = DeviceClock()
    clock.add(Reading(10.0, 10.002, 5_000_000))
    assert clock.period_at(10.001) == pytest.approx(100_000)
    assert clock.period_at(11.001) == pytest.approx(140_000)
    assert clock.moment_of(100_040) == pytest.approx(10.002)
    assert clock.drift_ppm == 0
    assert clock.uncertainty == pytest.approx(1e-3)


def test_two_readings_by_hand() -> None:
    """2 s apart the device counted 4 000 200 ticks: it is 50 ppm fast."""
    clock = DeviceClock()
    clock.add(Reading(0.0, 0.001, 1000))
    clock.add(Reading(2.0, 2.001, 4_001_200))
    assert clock.drift_ppm == pytest.approx(50)
    assert clock.period_at(3.0005) == pytest.approx((4_001_200 + 2_000_100) / 50)


def test_a_drift_is_believed_after_a_second() -> None:
    clock = DeviceClock()
    clock.add(reading(0, 80, 0.0, 1e-4, 0.5))
    clock.add(reading(0, 80, 0.9, 1e-4, 0.5))
    assert clock.drift_ppm == 0
    clock.add(reading(0, 80, 1.1, 1e-4, 0.5))
    assert clock.drift_ppm == pytest.approx(80, abs=2)


def test_a_quick_reading_outweighs_slow_ones() -> None:
    """The slow ones look at the device's clock at the end of their 20 ms, the quick one takes 0.1 ms."""
    clock = DeviceClock()
    for n in range(10):
        clock.add(reading(5, 0, 0.05 * n, 0.02, 1.0))
    assert abs(error(clock, 5, 0, 0.5)) > 9e-3
    clock.add(reading(5, 0, 0.5, 1e-4, 0.5))
    assert abs(error(clock, 5, 0, 0.5)) < 2e-5


def test_only_the_last_readings_count() -> None:
    """A restarted device begins at 0. After 64 readings an old estimate is as good as a new one."""
    clock = DeviceClock()
    clock.add(reading(1000, 0, 0.0, 1e-3, 0.5))
    for n in range(READINGS):
        clock.add(reading(0, 0, 1 + 0.1 * n, 1e-3, 0.5))
    assert abs(error(clock, 0, 0, 8.0)) < 1e-6
    fresh = DeviceClock()
    fresh.add(reading(0, 0, 9.0, 1e-3, 0.5))
    assert abs(error(fresh, 0, 0, 9.0)) < 1e-6


def test_a_device_that_has_been_on_for_years_is_known_as_closely() -> None:
    clock = DeviceClock()
    for n in range(20):
        clock.add(reading(3e8, 20, 1e6 + 0.1 * n, 1e-3, 0.5))
    assert clock.drift_ppm == pytest.approx(20, abs=1)
    assert abs(error(clock, 3e8, 20, 1e6 + 2)) < 1e-6


@settings(max_examples=200)
@given(
    offset=st.floats(0, 1e6),
    drift_ppm=st.floats(-100, 100),
    least=st.sampled_from([20e-6, 125e-6, 1e-3, 20e-3]),
    tail=st.sampled_from([0.0, 1.0, 10.0]),
    where=st.sampled_from(["any", "before", "after", "one side, then the other"]),
    every=st.sampled_from([0.001, 0.05, 0.25, 1.0]),
    count=st.integers(1, 150),
    seed=st.integers(0, 2**32),
)
def test_it_is_wrong_by_no_more_than_it_says(
    offset: float, drift_ppm: float, least: float, tail: float, where: str, every: float, count: int, seed: int
) -> None:
    """At the last reading, for any delays of the answers and any moment in them at which the device reads its clock.

    Besides that there is what it drifts within a reading, and while the drift is not believed, in at most a second.
    """
    rng = np.random.default_rng(seed)
    clock, moment = DeviceClock(), float(rng.uniform(0, 1e5))
    begun = moment
    for n in range(count):
        takes = least * (1 + float(rng.exponential(tail)) if tail else 1)
        side = {"any": float(rng.random()), "before": 0.0, "after": 1.0}.get(where, float(n > count // 2))
        clock.add(reading(offset, drift_ppm, moment, takes, side))
        last = moment + takes / 2
        moment += takes + every
        believed = clock.drift_ppm != 0
        drifted = 0 if believed else 100e-6 * min(last - begun, 1.0)
        assert abs(error(clock, offset, drift_ppm, last)) <= 1.001 * clock.uncertainty + drifted + 1e-6
        moments = [clock.period_at(last + ahead) for ahead in (0, 1e-5, 1e-3, 1, 100)]
        assert moments == sorted(moments)
        assert clock.moment_of(clock.period_at(last)) == pytest.approx(last, abs=1e-6)


@pytest.mark.parametrize("drift_ppm", [-100, -3, 0, 100])
@pytest.mark.parametrize("takes", [150e-6, 1e-3])
def test_after_a_minute_frames_land_on_their_period(drift_ppm: float, takes: float) -> None:
    """With a reading each quarter of a second that takes a frame of USB: a tenth of that, and of the drift 1 ppm."""
    rng = np.random.default_rng(7)
    clock = DeviceClock()
    for n in range(240):
        clock.add(reading(3.0, drift_ppm, 0.25 * n, takes * (1 + float(rng.exponential(0.2))), float(rng.random())))
    assert abs(error(clock, 3.0, drift_ppm, 60.0)) < takes / 4
    assert clock.drift_ppm == pytest.approx(drift_ppm, abs=1e6 * takes / 16)


@pytest.mark.parametrize("pauses", [{20}, {4}, {39}, {20, 21, 22}, {8, 20, 32}])
def test_a_device_that_is_held_up_at_a_few_readings_and_catches_up_does_not_mislead(pauses: set[int]) -> None:
    """By 8 ms, such as an emulated one on a busy computer: frames would be late until the estimate recovers."""
    rng = np.random.default_rng(3)
    clock = DeviceClock()
    for n in range(40):
        taken = reading(3.0, 50, 0.25 * n, 1e-3, float(rng.random()))
        clock.add(taken._replace(tick=taken.tick - 16_000 * (n in pauses)))
        if n >= 3:
            assert abs(error(clock, 3.0, 50, 0.25 * n + 5e-4)) < 2e-3
    assert abs(error(clock, 3.0, 50, 10.0)) < 1e-3
    assert clock.drift_ppm == pytest.approx(50, abs=100)


def test_a_device_that_is_slow_all_the_time_is_believed() -> None:
    clock = DeviceClock()
    for n in range(40):
        clock.add(reading(3.0, -200_000, 0.25 * n, 1e-3, 0.5))
    assert clock.drift_ppm == pytest.approx(-200_000, abs=100)
