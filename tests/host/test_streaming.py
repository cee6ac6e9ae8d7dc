"""Streams: what the outputs did is what says whether each frame had its period, not what the host counted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from math import floor
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import typeof
from numpy.typing import NDArray
from phasewire import Device, Emulator, Pulses, open_device
from phasewire.base.errors import DeviceError, DeviceLostError, DeviceRefusedError, DeviceStalledError
from phasewire.emulator.faults import (
    BusReset,
    BusSuspended,
    FlippedUsbBit,
    InjectedFault,
    PowerCut,
    StalledEndpoint,
    Unplugged,
)
from phasewire.host.streaming.envelopes import sine
from phasewire.host.streaming.frames import Frames
from phasewire.host.streaming.ledger import Parcel
from phasewire.host.streaming.session import Session
from phasewire.host.streaming.streaming import StreamReport
from phasewire.host.transports.transport import Timekeeper
from phasewire.host.transports.usb import UsbTransport
from phasewire.protocol import kernels
from phasewire.protocol.board import TICK_HZ
from phasewire.protocol.codes import Reason, State, StatusFlag
from phasewire.protocol.quantise import PulseFrames
from phasewire.protocol.replies import Status

from tests.host.bus_line import BusLine

MS = 40
"""Carrier periods."""


def frames(count: int) -> PulseFrames:
    """Frames that differ from their neighbours in every transducer, so that any mix-up shows."""
    rng = np.random.default_rng(count)
    width = rng.integers(1, 9, (count, 320), dtype=np.uint8)
    width[1::2] += 9
    return PulseFrames(rng.integers(0, 50, (count, 320), dtype=np.uint8) * 2 + width % 2, width)


def one_by_one(wanted: PulseFrames) -> Iterator[Pulses]:
    for phase, width in zip(*wanted, strict=True):
        yield Pulses(phase, width)


def played(emulator: Emulator, period: int) -> Pulses:
    """The pulses at the outputs in a period, from their bits; only for widths below 25."""
    capture = emulator.capture()
    bits = capture.bits(50 * period, 50 * period + 50)
    channels = capture.wiring.channels
    levels = (bits[:, channels // 32] >> (channels % 32)) & 1
    width = levels.sum(axis=0)
    rises = (levels == 1) & (np.roll(levels, 1, axis=0) == 0)
    start = rises.argmax(axis=0)
    return Pulses((2 * start + width) % 100, width)


def frame(wanted: PulseFrames, index: int) -> Pulses:
    return Pulses(wanted.phase[index], wanted.width[index])


def silent(emulator: Emulator) -> bool:
    """Whether all outputs are low after six periods (clause SAF-004)."""
    emulator.run(7)
    capture = emulator.capture()
    return not capture.bits(capture.end_tick - 50, capture.end_tick).any()


@pytest.mark.parametrize("rate", [40_000, 20_000, 13_000, 1_000, 130.5, 3])
def test_every_frame_plays_from_its_own_period_on(rate: float) -> None:
    count = max(int(min(rate / 20, 400)), 4)
    wanted = frames(count)
    with Emulator() as emulator, open_device(emulator.url) as device:
        report = device.stream(wanted, rate)
        emulator.run(5)  # the host knows the device's time but for some periods
        begins = [report.first_period + floor(index * 40_000 / rate) for index in range(count + 1)]
        for index, (begin, end) in enumerate(pairwise(begins)):
            assert played(emulator, begin) == frame(wanted, index)
            assert played(emulator, end - 1) == frame(wanted, index)
        status = device.status()
    assert (report.accepted, report.late, report.underruns, report.unanswered) == (count, 0, 0, 0)
    assert (status.accepted, status.late, status.lost) == (count + 1, 0, 0)  # and the one that opened the session
    assert report.last_period == begins[-2]
    assert silent(emulator)


@pytest.mark.parametrize("source", [frames(3), list(one_by_one(frames(3)))], ids=["there", "live"])
def test_nothing_is_compiled_after_the_outputs_are_enabled(monkeypatch: pytest.MonkeyPatch, source: Frames) -> None:
    """The first time on a machine that takes longer than the watchdog waits."""
    met: dict[bool, set[tuple[object, ...]]] = {False: set(), True: set()}
    pack = kernels.pack

    def packs(*arguments: Any) -> Any:
        met[emulator.running.state != State.OFF].add(tuple(map(typeof, arguments)))
        return pack(*arguments)

    monkeypatch.setattr(kernels, "pack", packs)
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.stream(source, 1000)
    assert met[True]
    assert met[True] <= met[False]


def test_a_stream_returns_when_the_last_frame_has_had_its_time() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        report = device.stream(frames(3), 100)
        assert 0 <= device.clock().now // 50 - (report.last_period + 400) < 10


@given(rate=st.floats(1, 40_000), count=st.integers(1, 40), look_ahead=st.floats(0, 0.1))
@settings(max_examples=25, deadline=None)
def test_frames_keep_rate_and_order_at_any_rate_and_look_ahead(rate: float, count: int, look_ahead: float) -> None:
    wanted = frames(count)
    with Emulator() as emulator, open_device(emulator.url) as device:
        report = device.stream(one_by_one(wanted), rate, look_ahead=look_ahead)
    assert (report.sent, report.accepted, report.late) == (count, count, 0)
    if not report.underruns:
        for index in range(count):
            assert played(emulator, report.first_period + floor(index * 40_000 / rate)) == frame(wanted, index)


def test_a_source_that_comes_too_late_moves_the_rest_and_is_counted() -> None:
    wanted = frames(30)

    def halting(device: Device) -> Iterator[Pulses]:
        for index, pulses in enumerate(one_by_one(wanted)):
            if index == 12:
                device.time.sleep(0.03)
            yield pulses

    with Emulator() as emulator, open_device(emulator.url) as device:
        report = device.stream(halting(device), 1000)
        assert (report.underruns, report.late, report.accepted) == (1, 0, 30)
        before, after = report.first_period, report.first_period + report.moved_periods
        for index in range(30):
            assert played(emulator, (before if index < 12 else after) + index * 40) == frame(wanted, index)
        assert played(emulator, after + 12 * 40 - 1) == frame(wanted, 11), "the last frame in time plays on"
    assert 600 < report.moved_periods < 1700


def test_a_source_that_is_silent_for_longer_than_the_watchdog_ends_in_an_error_that_says_so() -> None:
    def stuck(device: Device) -> Iterator[Pulses]:
        yield frame(frames(1), 0)
        device.time.sleep(0.5)
        yield frame(frames(1), 0)

    with Emulator() as emulator, open_device(emulator.url) as device:
        with pytest.raises(DeviceRefusedError, match=r"heard nothing for 0\.1 s; was this program held up\?") as raised:
            device.stream(stuck(device), 100)
        assert raised.value.reason is Reason.DISABLED
        assert silent(emulator)


def test_a_live_source_is_asked_for_a_frame_no_earlier_than_it_is_due() -> None:
    asked = []

    def live(device: Device) -> Iterator[Pulses]:
        for pulses in one_by_one(frames(10)):
            asked.append(device.clock().now / 50)
            yield pulses

    with Emulator() as emulator, open_device(emulator.url) as device:
        report = device.stream(live(device), 200, look_ahead=0.005)
    due = report.first_period + 200 * np.arange(10)
    lead = (due - asked)[1:] / MS
    assert (lead <= 5.0).all()
    assert (lead > 4.5).all()


def test_stop_in_another_thread_ends_a_stream_at_once() -> None:
    reached = threading.Event()

    def endless(device: Device) -> Iterator[Pulses]:
        for index in range(100_000):
            if index == 50:
                reached.set()
            yield frame(frames(2), index % 2)

    with Emulator() as emulator, open_device(emulator.url) as device:

        def stop() -> None:
            assert reached.wait(20)
            device.stop()

        stopping = threading.Thread(target=stop)
        stopping.start()
        with pytest.raises(DeviceRefusedError, match="has turned its outputs off: it was stopped"):
            device.stream(endless(device), 1000)
        stopping.join(20)
        assert silent(emulator)


def test_stop_while_the_first_frame_is_made_is_not_undone_by_the_stream() -> None:
    def source(device: Device) -> Iterator[Pulses]:
        device.stop()
        yield frame(frames(1), 0)

    with Emulator() as emulator, open_device(emulator.url) as device:
        with pytest.raises(DeviceRefusedError, match="it was stopped") as raised:
            device.stream(source(device), 1000)
        assert raised.value.reason is Reason.DISABLED
        assert not device.status().enabled


@pytest.mark.parametrize("index", [380, 391])
def test_an_invalid_frame_ends_a_stream_with_the_outputs_off(index: int) -> None:
    drives = np.full((400, 320), 0.5 + 0j)
    drives[index, 17] = np.nan
    reports: list[StreamReport] = []
    with Emulator() as emulator, open_device(emulator.url) as device:
        with pytest.raises(ValueError, match=f"drive of transducer 17 of frame {index} is"):
            device.stream(drives, 1000, on_progress=reports.append)
        assert reports[-1].sent == reports[-1].accepted <= index
        assert not device.status().enabled
        assert silent(emulator)


@pytest.mark.parametrize("end", [Device.stop, Device.reset])
def test_stop_while_a_lost_device_comes_back_is_not_undone_by_the_stream(
    end: Callable[[Device], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    genuine = UsbTransport.reopen
    threads: list[threading.Thread] = []

    def reopen(transport: UsbTransport, seconds: float) -> None:
        if not threads:
            threads.append(threading.Thread(target=end, args=(device,)))
            threads[0].start()
            deadline = time.monotonic() + 5
            while device._stops is before and time.monotonic() < deadline:  # until it waits for the line
                time.sleep(0.001)
        genuine(transport, seconds)

    with Emulator() as emulator, open_device(emulator.url) as device:
        before = device._stops
        emulator.inject(PowerCut(period=3000, periods=8000))
        monkeypatch.setattr(UsbTransport, "reopen", reopen)
        with pytest.raises(DeviceRefusedError, match="was stopped"):
            device.stream(one_by_one(frames(200)), 1000, reconnect=True)
        threads[0].join(20)
        assert not device.status().enabled
        assert device.stream(one_by_one(frames(3)), 1000).accepted == 3, "what was stopped can begin again"


@pytest.mark.parametrize(
    "fault",
    [
        PowerCut(period=3000, periods=8000),
        Unplugged(period=3000, periods=8000),
        BusSuspended(period=3000, periods=8000),
        BusReset(period=3000),
        StalledEndpoint(period=3000, endpoint=0x81),
    ],
    ids=lambda fault: type(fault).__name__,
)
def test_a_stream_goes_on_with_the_next_frame_when_a_lost_device_comes_back(fault: InjectedFault) -> None:
    wanted = frames(200)
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.set_watchdog(0.05)
        device.modulate(b"\xff", 1)
        emulator.inject(fault)
        report = device.stream(one_by_one(wanted), 1000, reconnect=True)
        status = device.status()
        assert (report.reconnects, report.sent, report.refused) == (1, 200, 0)
        assert report.accepted + report.unanswered == 200
        assert report.unanswered <= 2
        assert status.watchdog_ms == 50
        assert status.flags.name is not None
        assert "MODULATION" in status.flags.name
        assert played(emulator, report.last_period) == frame(wanted, 199)
        assert played(emulator, report.last_period - 100 * 40) == frame(wanted, 99)


@pytest.mark.parametrize("periods", [1, 3000])
@pytest.mark.parametrize("reconnect", [True, False])
def test_a_restart_that_a_serial_line_does_not_tell_is_seen_by_the_device_s_clock(
    periods: int, reconnect: bool
) -> None:
    reports: list[StreamReport] = []
    with Emulator() as emulator:
        emulator.run(100_000)
        with open_device(emulator.url + "?door=serial&baud=3000000") as device:
            emulator.inject(PowerCut(period=emulator.capture().end_tick // 50 + 4000, periods=periods))

            def play() -> None:
                device.stream(one_by_one(frames(60)), 300, reconnect=reconnect, on_progress=reports.append)

            if reconnect:
                play()
                assert (reports[-1].sent, reports[-1].reconnects) == (60, 1)
            else:
                with pytest.raises(DeviceLostError, match="has restarted, with its outputs off and its stores empty"):
                    play()
                assert not device.status().enabled


def test_a_device_that_does_not_come_back_is_given_up_in_time() -> None:
    with Emulator() as emulator:
        device = open_device(emulator.url)
        emulator.inject(Unplugged(period=3000))
        began = device.time.monotonic()
        with pytest.raises(DeviceLostError, match="has not come back in run time mode within 10 s"):
            device.stream(one_by_one(frames(200)), 1000, reconnect=True)
        assert device.time.monotonic() - began < 12
        with pytest.raises(DeviceLostError):
            device.status()


def test_a_device_that_fails_again_and_again_is_not_opened_for_ever() -> None:
    def failing(emulator: Emulator) -> Iterator[Pulses]:
        for pulses in one_by_one(frames(1000)):
            emulator.inject(StalledEndpoint(endpoint=0x01))
            yield pulses

    with Emulator() as emulator, open_device(emulator.url) as device:
        reports: list[StreamReport] = []
        with pytest.raises(DeviceStalledError):
            device.stream(failing(emulator), 1000, reconnect=True, on_progress=reports.append)
        assert reports[-1].reconnects == 1


@pytest.mark.parametrize(
    ("rate", "look_ahead", "message"),
    [
        (0, 0.01, "rate 0 frames/s must be at least 0.001 frames/s and finite"),
        (40_001, 0.01, "at most 40000"),
        (100, -1, "look_ahead -1 s must be from 0 to 10"),
        (100, 11, "look_ahead 11 s"),
    ],
)
def test_rates_and_look_aheads_that_cannot_be_are_refused_before_anything_is_sent(
    rate: float, look_ahead: float, message: str
) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        with pytest.raises(ValueError, match=message):
            device.stream(frames(2), rate, look_ahead=look_ahead)
        assert device.status().accepted == 1


def test_a_chain_or_a_bus_that_is_slower_takes_less() -> None:
    with open_device("emulator:?link=2wire") as device, pytest.raises(ValueError, match="at most 20000"):
        device.stream(frames(2), 20_001)
    with open_device("emulator:?speed=full") as device, pytest.raises(ValueError, match="at most 2375"):
        device.stream(frames(2), 2_400)
    with open_device("emulator:?door=serial") as device, pytest.raises(ValueError, match=r"at most 22\."):
        device.stream(frames(2), 23)


class Skewed:
    """A host's clock that runs fast by so many millionths.

    Parameters
    ----------
    keeper : Timekeeper
        The time of the device.
    ppm : float
        How much faster the host's clock runs.
    """

    def __init__(self, keeper: Timekeeper, ppm: float) -> None:
        self._keeper, self._speed = keeper, 1 + ppm * 1e-6

    def monotonic(self) -> float:
        return self._keeper.monotonic() * self._speed

    def sleep(self, seconds: float, /) -> None:
        self._keeper.sleep(seconds / self._speed)


@pytest.mark.parametrize("ppm", [-300, 300])
def test_frames_keep_their_periods_if_clocks_drift_apart_between_two_of_them(ppm: float) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        line = device._session.line()
        line.time = Skewed(line.time, ppm)  # type: ignore[misc]  # read-only elsewhere
        report = device.stream(one_by_one(frames(4)), 0.1)
    assert (report.late, report.underruns, report.last_period) == (0, 0, report.first_period + 3 * 400_000)
    assert report.least_lead_periods is not None
    assert abs(report.least_lead_periods - 10 * MS) <= 5
    assert report.drift_ppm == pytest.approx(-ppm, abs=1)


def test_a_device_whose_time_is_not_the_hosts_ends_a_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as the time of an emulated device at the pace fast, whose named periods may never come."""
    status = Session.status

    def other_time(session: Session) -> Status:
        told = status(session)
        return replace(told, now=told.now // 50)

    monkeypatch.setattr(Session, "status", other_time)
    with Emulator() as emulator, open_device(emulator.url) as device:
        with pytest.raises(DeviceError, match=r"passes at 0\.02 .*--pace fast"):
            device.stream(frames(4000), 200)
        assert device.clock().now < 6 * TICK_HZ
    assert silent(emulator)


def test_signs_of_life_follow_the_watchdog_s_time() -> None:
    def source(device: Device) -> Iterator[Pulses]:
        for seconds in (60, 0.01, 1):
            device.set_watchdog(seconds)
            yield frame(frames(1), 0)

    with Emulator() as emulator, open_device(emulator.url) as device:
        assert device.stream(source(device), 2).accepted == 3


def test_a_stream_holds_the_line_for_some_milliseconds_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Even if its look-ahead covers more frames than the device's queue holds."""
    held = []
    genuine = Session.post

    def post(session: Session, blocks: NDArray[np.uint8], parcel: Parcel) -> None:
        began = session.time.monotonic()
        genuine(session, blocks, parcel)
        held.append(session.time.monotonic() - began)

    with Emulator() as emulator, open_device(emulator.url) as device:
        monkeypatch.setattr(Session, "post", post)
        report = device.stream(frames(90), 100, look_ahead=1)
    assert (report.accepted, report.late) == (90, 0)
    assert max(held) < 0.006


def test_the_least_lead_is_that_of_the_frame_that_came_last_before_its_time() -> None:
    with open_device("emulator:") as device:
        report = device.stream(frames(120), 1000)
    assert report.least_lead_periods == pytest.approx(5 * MS, abs=8)


def test_damaged_and_refused_frames_of_one_transfer_are_counted_apart() -> None:
    reports: list[StreamReport] = []
    wanted = PulseFrames(np.full((10, 320), 20, np.uint8), np.full((10, 320), 2, np.uint8))
    wanted.width[2] = 25
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.set_drive_limit(100)
        emulator.inject(FlippedUsbBit(endpoint=0x01, byte=300, times=2))
        with pytest.raises(DeviceRefusedError) as refused:
            device.stream(wanted, 20_000, on_progress=reports.append)
    assert refused.value.reason is Reason.DRIVE
    last = reports[-1]
    assert (last.damaged, last.refused, last.accepted + last.unanswered) == (2, 1, last.sent - 3)


def test_a_first_frame_that_takes_long_costs_neither_the_modulation_nor_a_sound_before_it() -> None:
    def slow(device: Device) -> Iterator[Pulses]:
        assert not device.status().enabled
        device.time.sleep(0.5)
        yield from one_by_one(frames(3))

    with Emulator() as emulator, open_device(emulator.url) as device:
        report = device.stream(slow(device), 1000, envelope=sine(200))
        status = device.status()
        assert (report.accepted, report.underruns) == (3, 0)
        assert StatusFlag.MODULATION in status.flags
        assert not emulator.capture().bits(0, 50 * report.first_period).any()


def test_one_stream_at_a_time() -> None:
    def source(device: Device) -> Iterator[Pulses]:
        with pytest.raises(DeviceError, match="plays a stream already"):
            device.stream(frames(2), 100)
        yield from one_by_one(frames(5))

    with open_device("emulator:") as device:
        assert device.stream(source(device), 1000).accepted == 5
        assert device.stream(frames(2), 1000).accepted == 2


@pytest.mark.parametrize("rate", [5, 20])
@pytest.mark.parametrize("ready", [True, False])
def test_on_the_slowest_line_frames_are_sent_early_enough(rate: float, ready: bool) -> None:
    wanted = frames(8)
    with open_device("emulator:?door=serial") as device:
        report = device.stream(wanted if ready else one_by_one(wanted), rate)
        assert device.status().watchdog_ms >= 900
    assert (report.accepted, report.late, report.underruns) == (8, 0, 0)
    assert report.least_lead_periods is not None
    assert report.least_lead_periods >= 5


def test_a_device_that_comes_back_has_the_drive_limit_that_it_had() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.set_drive_limit(200)
        emulator.inject(PowerCut(period=3000, periods=8000))
        report = device.stream(one_by_one(frames(100)), 1000, reconnect=True)
        assert (report.reconnects, device.status().drive_limit) == (1, 200)


def test_a_line_that_carries_blocks_by_itself_plays_a_frame_in_every_period() -> None:
    with Emulator() as emulator, Device(BusLine(emulator)) as device:
        report = device.stream(frames(4000), 40_000)
        assert (report.accepted, report.late, report.underruns, report.holds) == (4000, 0, 0, True)
        assert report.played_rate == 40_000


@pytest.mark.parametrize("rate", [500, 1000, 5000, 10_000])
@pytest.mark.parametrize("begins", [0.05, 0.057, 0.061])
def test_a_short_pause_on_the_way_makes_no_ready_frame_late(rate: int, begins: float) -> None:
    with Emulator() as emulator, Device(line := BusLine(emulator)) as device:
        begun = line.time.monotonic() + begins
        line.pauses = [(begun, begun + 0.018)]
        report = device.stream(frames(rate // 5), rate)
    assert (report.accepted, report.late, report.underruns) == (rate // 5, 0, 0)


def test_frames_go_on_in_their_periods_after_a_pause_on_their_way() -> None:
    """A device that takes frames only at their rate would stay late unless the frames move."""
    wanted = frames(5000)
    with Emulator() as emulator, Device(line := BusLine(emulator)) as device:
        line.pauses = [(line.time.monotonic() + 0.05, line.time.monotonic() + 0.08)]
        report = device.stream(wanted, 40_000)
        emulator.run(5)
        last = report.last_period
        assert [played(emulator, last - back) == frame(wanted, 4999 - back) for back in range(1500)] == [True] * 1500
    assert (report.accepted, report.underruns) == (5000, 1)
    assert 0 < report.late < 1200, "those that were on their way, of 3000 and more that were still to come"
    assert report.last_period - report.first_period == 4999 + report.moved_periods
    assert not report.holds
    assert "the rate does not hold: " in str(report)


def test_a_pause_that_made_frames_of_a_live_source_late_does_no_harm_the_second_time() -> None:
    """The look-ahead is 10 ms at first."""
    with Emulator() as emulator, Device(line := BusLine(emulator)) as device:
        begun = line.time.monotonic()
        line.pauses = [(begun + at, begun + at + 0.014) for at in (0.05, 0.15, 0.25)]
        report = device.stream(one_by_one(frames(400)), 1000)
    assert (report.accepted, report.underruns) == (400, 1)
    assert 0 < report.late < 20
