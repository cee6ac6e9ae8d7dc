"""Several devices as one: what all their outputs did, by the time that they share, says whether they play together."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import repeat
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import (
    Calibration,
    Device,
    DeviceGroup,
    Emulator,
    Pulses,
    RigDevice,
    TransducerArray,
    open_devices,
    solve,
)
from phasewire.base.errors import DeviceError, DeviceLostError, DeviceNotFoundError, DeviceRefusedError
from phasewire.emulator.boards.sync import SyncLine
from phasewire.emulator.cluster import Cluster
from phasewire.emulator.faults import LostSync, PowerCut, Unplugged
from phasewire.host.streaming.clock import DeviceClock, Reading
from phasewire.host.streaming.common_clock import CommonClock
from phasewire.host.streaming.cycles import play_cycle
from phasewire.host.streaming.envelopes import sine
from phasewire.host.streaming.frames import Frame
from phasewire.host.streaming.session import Session
from phasewire.protocol.board import CORE_HZ, CYCLES_PER_PERIOD, TICK_HZ
from phasewire.protocol.codes import NOW, Reason, State
from phasewire.protocol.quantise import PulseFrames
from phasewire.protocol.replies import ClockReading
from phasewire.solver import Cycle

BOARD = TransducerArray.grid()
FULL = Pulses(np.full(640, 25), np.full(640, 25))


class OffLine(SyncLine):
    """A sync line that reaches a listener so many core cycles too late."""

    def __init__(self, line: SyncLine, late: int) -> None:
        super().__init__()
        self._line, self._late = line, late

    def next_pulse(self, cycle: int) -> int | None:
        pulse = self._line.next_pulse(cycle - self._late)
        return None if pulse is None else pulse + self._late


def members(emulators: list[Emulator]) -> list[RigDevice]:
    return [
        RigDevice(emulator.url, BOARD.moved([0.3 * place, 0, 0]), name=f"D{place}")
        for place, emulator in enumerate(emulators)
    ]


@contextmanager
def together(count: int = 2, *, restarted: int = 0) -> Iterator[tuple[DeviceGroup, list[Emulator]]]:
    """Devices on one sync line; the last ones have restarted, so that their counts are behind."""
    with Cluster(count, serial="G") as cluster:
        emulators = list(cluster)
        for again in emulators[count - restarted :]:
            cluster.run(5000)
            again.restart()
            again.run_until_started()
        cluster.run(10)
        with open_devices(members(emulators)) as group:
            yield group, emulators


@contextmanager
def apart(late: int) -> Iterator[tuple[DeviceGroup, list[Emulator]]]:
    """Two devices, of which the second begins its periods so many core cycles later."""
    driver = Emulator(serial="A-0")
    other = Emulator(serial="A-1", sync=OffLine(driver.sync, late))
    with driver, other, open_devices(members([driver, other])) as group:
        yield group, [driver, other]


def frames(count: int, devices: int = 2) -> PulseFrames:
    """Frames that differ from their neighbours in every transducer."""
    rng = np.random.default_rng(count)
    width = rng.integers(1, 9, (count, 320 * devices), dtype=np.uint8)
    width[1::2] += 9
    return PulseFrames(rng.integers(0, 50, width.shape, dtype=np.uint8) * 2 + width % 2, width)


def one_by_one(wanted: PulseFrames) -> Iterator[Pulses]:
    return (Pulses(phase, width) for phase, width in zip(*wanted, strict=True))


def silent(emulators: list[Emulator]) -> bool:
    """Whether all outputs are low after six periods, of devices that have power."""
    captures = []
    for emulator in emulators:
        if emulator.controller is not None:
            emulator.run(7)
            captures.append(emulator.capture())
    return not any(capture.bits(capture.end_tick - 50, capture.end_tick).any() for capture in captures)


def moments(emulators: list[Emulator]) -> list[list[int]]:
    """Core cycles, of the time of all, at which each device's outputs changed, by its first processor."""
    return [[each.running.time.origin + 200 * tick for tick in each.capture().latches[0] if tick] for each in emulators]


# One clock


@pytest.mark.parametrize("restarted", [0, 2])
def test_a_frame_begins_on_all_devices_in_the_same_tick(restarted: int) -> None:
    with together(4, restarted=restarted) as (group, emulators):
        ack = group.show(Pulses(np.full(1280, 25), np.full(1280, 25)))
        later = group.show(Pulses(np.full(1280, 24), np.full(1280, 24)), period=ack.commit_period + 2000)
        for emulator, offset in zip(emulators, group.common.offsets, strict=True):
            emulator.run_until(later.commit_period + offset + 2)
        seen = moments(emulators)
        assert group.common.shared
        assert group.common.error == 0
        assert {offset % 4096 for offset in group.common.offsets} == {0}
        assert len(set(group.common.offsets)) == 1 + restarted
        assert all(each == seen[0] for each in seen)
        assert seen[0][-1] - seen[0][-2] == 2000 * CYCLES_PER_PERIOD
        assert not ack.late
        assert not later.late


def test_devices_without_a_line_are_estimated_and_a_warning_says_what_that_means() -> None:
    with ExitStack() as stack:
        with pytest.warns(UserWarning, match=r"clocks estimated to 1\d\d µs; .* no coherent focus, .* is 25 µs"):
            group, emulators = stack.enter_context(apart(1234 * CYCLES_PER_PERIOD + 3777))
        assert not group.common.shared
        group.show(FULL)
        group.time.sleep(0.05)
        first, second = moments(emulators)
        assert abs(first[-1] - second[-1]) / CORE_HZ < group.common.error
        report = group.stream(frames(40), 1000)
        assert report.apart == group.common.error
        assert "devices up to" in str(report)
        first, second = moments(emulators)
        assert len(first) == len(second)
        assert np.abs(np.subtract(first, second)).max() / CORE_HZ < group.common.error


def test_clocks_that_drift_apart_are_followed_and_their_drift_is_told() -> None:
    """Two clocks of 30 ppm difference, read for three seconds without an error."""
    clocks = [DeviceClock(), DeviceClock()]
    common = CommonClock(["one", "other"], [ClockReading(0, 0, 1), ClockReading(0, 0, 1)])
    for step in range(100):
        moment = step * 0.05
        for clock, rate, ahead in zip(clocks, (1, 1 + 30e-6), (0, 100_025), strict=True):
            clock.add(Reading(moment - 5e-6, moment + 5e-6, round(moment * rate * TICK_HZ) + ahead))
        if step == 0:
            assert not common.meet(clocks, moment)
        common.follow(clocks, moment)
        truth = 100_025 / 50 + moment * 30e-6 * 40_000
        assert abs(common.offsets[1] - truth) <= common.error * 40_000
    assert abs(common.offsets[1] - truth) < 1
    assert common.drift_ppm == pytest.approx(30, abs=2)


@given(
    counts=st.tuples(st.integers(0, 2**30), st.integers(0, 2**30)),
    bases=st.tuples(st.integers(0, 4095), st.integers(0, 4095)),
    early=st.floats(0, 1),
    width=st.floats(1e-5, 4e-4),
    off=st.integers(-2047, 2047),
)
def test_a_line_is_found_if_and_only_if_pulses_coincide(
    counts: tuple[int, int], bases: tuple[int, int], early: float, width: float, off: int
) -> None:
    """Pulses of the second device come `off` periods late; readings are uncertain by up to 0.2 ms."""
    clocks, readings = [DeviceClock(), DeviceClock()], []
    for clock, count, base, late in zip(clocks, counts, bases, (0, off), strict=True):
        pulse = base + 4096 * (count + (3000 - late) // 4096)
        tick = (base + 4096 * count + 3000 - late) * 50
        clock.add(Reading(10 - width * early, 10 + width * (1 - early), tick))
        readings.append(ClockReading(tick, pulse, 1))
    common = CommonClock(["one", "other"], readings)
    found = common.meet(clocks, 10.0)
    unsure = width * 40_000
    if abs(off) > 2 * unsure + 1:
        assert not found
    if off == 0:
        assert found
        assert common.offsets == [0, (counts[1] - counts[0]) * 4096 + bases[1] - bases[0]]


def test_a_device_whose_pulses_no_longer_come_shares_no_line() -> None:
    clocks = [DeviceClock(), DeviceClock()]
    for clock in clocks:
        clock.add(Reading(0, 1e-5, 50 * 10_000))
    readings = [ClockReading(50 * 10_000, 8192, 3), ClockReading(50 * 10_000, 4096, 2)]
    assert not CommonClock(["one", "other"], readings).meet(clocks, 0.0)


def test_a_clock_that_leaves_the_line_is_named() -> None:
    clocks = [DeviceClock(), DeviceClock()]
    common = CommonClock(["one", "other"], [ClockReading(0, 0, 1), ClockReading(0, 0, 1)])

    def read(moment: float, gone: int) -> None:
        for clock, ahead in zip(clocks, (0, gone), strict=True):
            clock.add(Reading(moment - 5e-6, moment + 5e-6, round(moment * TICK_HZ) + ahead))

    read(0, 0)
    assert common.meet(clocks, 0)
    for step in range(1, 8):  # an emulated device on a busy computer may only be delayed
        read(step * 0.25, 50 * 2000)
        common.follow(clocks, step * 0.25)
    read(2.25, 50 * 2000)
    with pytest.raises(DeviceError, match=r"other has lost the common clock: its periods are now .*; check the sync"):
        common.follow(clocks, 2.25)


def test_a_lost_sync_line_is_a_fault_of_the_device_and_silences_all() -> None:
    with together() as (group, emulators):
        group.show(FULL)
        emulators[1].inject(LostSync())
        with pytest.raises(DeviceRefusedError, match=r"D1: .* is silenced by a fault \(SYNC\)"):
            group.keep_playing(2)
        assert silent(emulators)


def test_emulated_devices_and_real_ones_have_different_times(monkeypatch: pytest.MonkeyPatch) -> None:
    with Emulator(serial="M-0") as one, Emulator(serial="M-1") as other:
        monkeypatch.setattr(
            Device, "time", property(lambda device: time if device.serial == one.serial else device._session.time)
        )
        with pytest.raises(DeviceError, match="emulated devices of this process have a time of their own"):
            open_devices(members([one, other]))


def test_devices_on_lines_of_any_kind_begin_together() -> None:
    with Cluster(2, serial="K") as cluster:
        doors = ("", "?door=serial&baud=3000000")
        rig = [
            RigDevice(each.url + door, BOARD.moved([0, 0, 0.1 * len(door)]))
            for each, door in zip(cluster, doors, strict=True)
        ]
        with open_devices(rig) as group:
            assert group.common.shared
            group.show(FULL)
            group.time.sleep(0.05)
            first, second = moments(list(cluster))
    assert first == second


# Frames


def test_each_device_gets_its_part_by_its_channels_and_its_calibration() -> None:
    rng = np.random.default_rng(3)
    kept = rng.permutation(320)[:50]
    gains = Calibration(rng.uniform(0.5, 1, 320), rng.uniform(-90, 90, 320), np.ones(320), np.zeros(320))
    drive = rng.uniform(0, 0.5, 370) * np.exp(2j * np.pi * rng.random(370))
    with Cluster(2, serial="C") as (one, other):
        few = TransducerArray(BOARD.positions[kept] + [0.4, 0, 0], BOARD.normals[kept])
        rig = [RigDevice(one.url, calibration=gains), RigDevice(other.url, few, channels=kept)]
        with open_devices(rig) as group:
            group.show(drive)
            group.time.sleep(0.02)
            first, second = (device.read_back().pulses for device in group.devices)
    assert first == Pulses.from_drive(gains.apply(drive[:320]))
    there = Pulses.from_drive(drive[320:])
    assert Pulses(second.phase[kept], second.width[kept]) == there
    assert not np.delete(second.width, kept).any()


REFUSED = {
    "pulses": (Pulses(np.zeros(320, int), np.zeros(320, int)), "320 pulses for a device with 640 transducers"),
    "drive": (np.zeros(320), r"a drive of the shape \(320,\) for a device with 640"),
    "beyond": (np.full(640, 1.5), r"1\.5"),
}


@pytest.mark.parametrize(("frame", "message"), REFUSED.values(), ids=REFUSED)
def test_a_frame_that_does_not_fit_is_refused_before_anything_is_sent(frame: Frame, message: str) -> None:
    with together() as (group, _):
        before = [status.accepted for status in group.status()]
        with pytest.raises(ValueError, match=message):
            group.show(frame)
        with pytest.raises(ValueError, match="frame 0"):
            group.stream([frame], 100)
        assert [status.accepted for status in group.status()] == before


def test_a_device_with_other_transducers_is_refused_and_none_is_left_open() -> None:
    few = TransducerArray.grid(2, 2)
    with Emulator(serial="N-0") as one, Emulator(serial="N-1") as other:
        for wrong, message in (
            (RigDevice(other.url, few, name="few"), "few has 320 transducers, not 4; channels says which"),
            (RigDevice(other.url, few, channels=[0, 1, 2, 320]), "has the channels 0 to 319, and no 320"),
        ):
            with pytest.raises(ValueError, match=message):
                open_devices([RigDevice(one.url, BOARD.moved([0, 0, 1])), wrong])
        with pytest.warns(UserWarning, match=r"few has 20 × 16 .* not at the places that the rig says"):
            open_devices([RigDevice(other.url, few, name="few", channels=[0, 1, 2, 3])]).close()
        with pytest.raises(DeviceNotFoundError, match="gone: "):
            open_devices([RigDevice(one.url), RigDevice("emulator:GONE", BOARD.moved([0, 0, 1]), name="gone")])
        with open_devices(members([one, other])):
            pass


def test_a_solution_for_another_array_is_warned_of() -> None:
    with together() as (group, _), pytest.warns(UserWarning, match="the transducers of the rig are at other places"):
        group.show(solve(group.array.moved([0, 0, 0.001]), [[0, 0, 0.1]]))


# Streams


@pytest.mark.parametrize(("rate", "live"), [(40_000, False), (13_000, False), (1000, True)])
def test_each_frame_of_a_stream_plays_on_all_devices_in_its_period(rate: float, live: bool) -> None:
    count = 60
    wanted = frames(count, 3)
    with together(3, restarted=1) as (group, emulators):
        report = group.stream(one_by_one(wanted) if live else wanted, rate)
        group.time.sleep(0.001)
        assert (report.accepted, report.late, report.underruns, report.apart) == (count, 0, 0, 0)
        begins = [report.first_period + int(np.floor(index * 40_000 / rate)) for index in range(count)]
        for place, (emulator, offset) in enumerate(zip(emulators, group.common.offsets, strict=True)):
            first = begins[0] + offset
            played = emulator.capture().drives(first, begins[-1] + offset + 1)
            for index, begin in enumerate(begins):
                part = slice(320 * place, 320 * place + 320)
                expected = Pulses(wanted.phase[index, part], wanted.width[index, part]).to_drive()
                np.testing.assert_allclose(played[begin - begins[0]], expected, atol=1e-6)
        assert silent(emulators) is False
    assert silent(emulators)


def test_a_source_that_comes_too_late_moves_all_devices_alike() -> None:
    with together() as (group, emulators):

        def halting() -> Iterator[Pulses]:
            for index, pulses in enumerate(one_by_one(frames(30))):
                if index == 12:
                    group.time.sleep(0.03)
                yield pulses

        report = group.stream(halting(), 1000)
        assert (report.underruns, report.late, report.accepted) == (1, 0, 30)
        group.time.sleep(0.001)
        first, second = moments(emulators)
        assert first == second


def test_a_modulation_begins_on_all_devices_in_the_same_period_and_before_the_frames() -> None:
    with together() as (group, emulators):
        report = group.stream(repeat(FULL, 40), 1000, envelope=sine(200))
        assert report.late == 0
        first, second = (each.capture().drives(report.first_period, report.first_period + 800) for each in emulators)
        assert np.ptp(np.abs(first[:, 0])) > 0.9
        np.testing.assert_array_equal(first, second)


def test_a_stop_between_two_devices_leaves_none_on(monkeypatch: pytest.MonkeyPatch) -> None:
    with together() as (group, emulators):
        first, show = group.devices[0], group.devices[0].show
        stopping = threading.Thread(target=group.stop)

        def stopped_meanwhile(*frame: Any) -> Any:
            ack = show(*frame)
            stopping.start()
            while group._stops == 0:
                time.sleep(0.001)
            return ack

        monkeypatch.setattr(first, "show", stopped_meanwhile)
        with pytest.raises(DeviceRefusedError, match=r"^D1: .* the rig was stopped"):
            group.show(FULL)
        stopping.join()
        assert silent(emulators)
        assert [device.status().state for device in group.devices] == [State.OFF, State.OFF]


def test_a_modulated_stream_begins_after_the_watchdogs_have_fired() -> None:
    with together() as (group, _):
        group.show(FULL)
        group.time.sleep(1)
        assert group.stream(repeat(FULL, 40), 1000, envelope=sine(200)).accepted == 40


def test_a_cycle_plays_from_the_memories_of_all_devices_in_step() -> None:
    rng = np.random.default_rng(1)
    drives = np.exp(2j * np.pi * rng.random((3, 640))).astype(np.complex64)
    with together(restarted=1) as (group, emulators):
        played = play_cycle(group, Cycle(drives, 7))
        group.keep_playing(0.2)
        begin = played.ack.commit_period
        for place, (emulator, offset) in enumerate(zip(emulators, group.common.offsets, strict=True)):
            seen = emulator.capture().drives(begin + offset, begin + offset + 2000)
            for period in range(0, 2000, 7):
                expected = Pulses.from_drive(drives[period // 7 % 3, 320 * place :][:320]).to_drive()
                np.testing.assert_allclose(seen[period], expected, atol=1e-6)


@pytest.mark.parametrize("fault", [Unplugged, PowerCut])
def test_a_lost_device_stops_all(fault: type[Unplugged | PowerCut]) -> None:
    full = Pulses(np.full(960, 25), np.full(960, 25))
    with ExitStack() as stack:
        group, emulators = stack.enter_context(together(3))
        emulators[1].inject(fault(period=emulators[1].capture().periods + 2000))
        with pytest.raises(DeviceLostError, match=r"^D1: ") as raised:
            group.stream(repeat(full), 1000)
        assert str(raised.value).count("D1: ") == 1
        assert silent([emulators[0], emulators[2]])
        assert [group.devices[place].status().state for place in (0, 2)] == [State.OFF, State.OFF]
        group.close()


def test_a_refused_frame_stops_all() -> None:
    with together() as (group, emulators):
        group.devices[1].set_drive_limit(10)
        for play in (lambda: group.show(FULL), lambda: group.stream(repeat(FULL, 50), 1000)):
            with pytest.raises(DeviceRefusedError, match="D1: ") as raised:
                play()
            assert raised.value.reason is Reason.DRIVE
            assert silent(emulators)
            assert [status.state for status in group.status()] == [State.OFF, State.OFF]


def test_a_signal_s_handler_may_stop_all_in_the_middle_of_a_transfer(monkeypatch: pytest.MonkeyPatch) -> None:
    with together() as (group, emulators):
        session, post = group.devices[1]._session, Session.post

        def interrupted(self: Session, *arguments: Any) -> None:
            if self is session and len(emulators[0].capture().latches[0]) > 5:
                signal.raise_signal(signal.SIGUSR1)
            post(self, *arguments)

        monkeypatch.setattr(Session, "post", interrupted)
        before = signal.signal(signal.SIGUSR1, lambda *_: group.stop())
        try:
            with pytest.raises(DeviceRefusedError, match=r"^D\d: .*it was stopped"):
                group.stream(repeat(FULL), 1000)
            assert silent(emulators)
        finally:
            signal.signal(signal.SIGUSR1, before)


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_the_outputs_of_all_are_off_after_any_end(error: type[BaseException]) -> None:
    def broken() -> Iterator[Pulses]:
        yield from repeat(FULL, 20)
        raise error

    with ExitStack() as stack:
        group, emulators = stack.enter_context(together())
        with pytest.raises(error):
            group.stream(broken(), 1000)
        assert silent(emulators)
        group.show(FULL)
        group.time.sleep(0.03)
        assert not silent(emulators)
        group.__exit__(None, None, None)
        assert silent(emulators)


def test_a_device_that_begins_late_makes_all_begin_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """As when the computer is held up between two devices."""
    with together() as (group, emulators):
        monkeypatch.setattr(DeviceGroup, "_lead", lambda _: 200)
        held_up, show = [True], group.devices[1].show

        def late(frame: Frame, period: int = NOW) -> object:
            if held_up.pop() if held_up else False:
                emulators[1].run(300)
            return show(frame, period)

        monkeypatch.setattr(group.devices[1], "show", late)
        group.show(FULL)
        group.time.sleep(0.05)
        first, second = moments(emulators)
        assert first[-1] == second[-1]
        monkeypatch.setattr(group.devices[1], "show", lambda frame, period: show(frame, period - 3000))
        with pytest.raises(DeviceError, match=r"did not begin together: one was \d+ periods late"):
            group.show(FULL)
        assert silent(emulators)
