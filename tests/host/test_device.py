"""Everything that a device can be asked for, judged by what its outputs do."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from threading import Thread
from typing import Any

import numpy as np
import pytest
from phasewire import Circle, Emulator, Medium, Pulses, TransducerArray, Wiring, open_device, sine, solve
from phasewire.base.errors import (
    DeviceError,
    DeviceLostError,
    DeviceRefusedError,
    DeviceStalledError,
    DeviceTimeoutError,
)
from phasewire.emulator import faults
from phasewire.emulator.doors.backend import Port
from phasewire.host.streaming.calibration import Calibration
from phasewire.host.streaming.device import Device
from phasewire.protocol import Ack, Info, Reason
from phasewire.protocol.codes import Fault, Feature

from tests.from_spec import modulated_width

FULL = Pulses(np.full(320, 25), np.full(320, 25))
HALF = Pulses(np.full(320, 25), np.full(320, 9))
MIXED = Pulses(np.arange(320) % 100, np.arange(320) % 26)


def wide(width: int) -> Pulses:
    return Pulses(np.full(320, 25), np.full(320, width))


def widths(emulator: Emulator, first: int, count: int) -> list[int]:
    """How wide the pulses of transducer 77 are, in successive periods."""
    emulator.run_until(max(first + count + 1, emulator.capture().periods))
    strengths = np.abs(emulator.capture().drives(first, first + count, np.complex128)[:, 77])
    return [int(width) for width in np.rint(50 / np.pi * np.arcsin(np.minimum(strengths, 1)))]


def sounding(emulator: Emulator) -> int:
    """Transducers that sound in the last period, in which what was sent has taken effect."""
    emulator.run(6)
    capture = emulator.capture()
    return int((np.abs(capture.drive(capture.periods - 1)) > 0).sum())


# One frame


def test_what_is_shown_is_emitted(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        ack = device.show(MIXED)
        emulator.run_until(ack.commit_period + 2)
        drive = emulator.capture().drive(ack.commit_period)
    assert np.abs(drive) == pytest.approx(np.sin(np.pi * MIXED.width / 50), abs=1e-6)
    on = MIXED.width > 0
    assert np.exp(1j * np.angle(drive[on])) == pytest.approx(np.exp(2j * np.pi * MIXED.phase[on] / 100), abs=1e-6)


def test_a_solution_for_another_array_is_warned_of_once(emulator: Emulator) -> None:
    turned = solve(TransducerArray.grid(16, 20), Circle(), medium=Medium(frequency=25_000))
    with open_device(emulator.url) as device:
        with pytest.warns(UserWarning, match="made for something else") as warned:
            device.show(turned)
        device.store(0, turned)
        device.show(solve(TransducerArray.grid(), Circle()))
    assert [str(each.message).partition(": ")[2] for each in warned] == [
        "the device has 20 × 16 transducers, 10.3 mm apart",
        "the device's carrier has 40000 Hz, not 25000 Hz",
    ]


def test_a_calibration_of_another_array_is_refused(emulator: Emulator) -> None:
    with pytest.raises(ValueError, match="the calibration is for 12 transducers, the device has 320"):
        open_device(emulator.url, calibration=Calibration.perfect(12))
    assert not Port.of(emulator.usb).claims


# Stored frames


def test_steps_that_need_the_whole_store_are_refused_while_others_play(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.store(0, wide(5))
        begins = device.play([(0, 1)] * 1024).commit_period
        with pytest.raises(DeviceRefusedError) as refused:
            device.play([(0, 1)] * 1024)
        assert refused.value.reason is Reason.IN_USE
        assert widths(emulator, begins, 1100) == [5] * 1100
        device.stop()
        emulator.run(7)
        begins = device.play([(0, 1)] * 1024).commit_period
        assert widths(emulator, begins, 10) == [5] * 10


# Modulation


def test_a_modulation_goes_round_and_ends(emulator: Emulator) -> None:
    """Clause PUL-006."""
    with open_device(emulator.url) as device:
        device.show(FULL)
        begins = device.modulate([0, 255, 128], 2).commit_period
        once = [modulated_width(25, sample) for sample in (0, 0, 255, 255, 128, 128)]
        assert widths(emulator, begins - 1, 13) == [25, *once, *once]
        ends = device.end_modulation().commit_period
        assert widths(emulator, ends, 6) == [25] * 6


@pytest.mark.parametrize(
    ("samples", "hold"),
    [([], 1), ([256], 1), ([-1], 1), (bytes(4097), 1), ([1], 0), ([1], 2**16), (sine(200), 1), (None, sine(9))],
    ids=str,
)
def test_samples_out_of_range_send_nothing(emulator: Emulator, samples: Any, hold: int) -> None:
    with open_device(emulator.url) as device:
        before = device.status().accepted
        with pytest.raises(ValueError, match=r"sample|as in modulate\(\*sine\(200\)\)"):
            device.modulate(samples, hold)
        assert (device.status().accepted, device.status().enabled) == (before, False)


# Its description


def test_the_wiring_table_can_be_read(scrambled: Wiring) -> None:
    with Emulator(table=scrambled) as emulator, open_device(emulator.url) as device:
        assert device.wiring().channels.tolist() == scrambled.channels.tolist()


# Switches and limits


def test_the_watchdog_s_time(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.set_watchdog(0.02)
        device.show(FULL)
        emulator.run(790)
        assert sounding(emulator) == 320
        device.set_watchdog(0.02)  # no sign of life by itself
        emulator.run(20)
        assert sounding(emulator) == 0
        device.set_watchdog(0.029)  # times 1000 this is a little less than 29
        assert device.status().watchdog_ms == 29
        for seconds in (0.009, 61):
            with pytest.raises(ValueError, match=r"seconds .* s must be from 0\.01 to 60 s"):
                device.set_watchdog(seconds)


def test_what_plays_is_kept_playing(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.show(FULL)
        begun = device.time.monotonic()
        for wrong in (float("nan"), -1, None, 10**400):
            with pytest.raises(ValueError, match=r"seconds .* must be"):
                device.keep_playing(wrong)  # type: ignore[arg-type]  # on purpose
        device.keep_playing(0.5)
        assert device.time.monotonic() - begun == pytest.approx(0.5, abs=0.01)
        assert sounding(emulator) == 320
        emulator.run(5000)
        with pytest.raises(DeviceRefusedError, match=r"heard nothing for 0\.1 s"):
            device.keep_playing(0.5)


def test_a_fault_is_named_and_cleared(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.show(FULL)
        emulator.inject(faults.HotBoard(board=1, celsius=95, periods=2000))
        device.time.sleep(0.02)
        with pytest.raises(DeviceRefusedError, match=r"silenced by a fault \(TEMPERATURE\)") as refused:
            device.show(FULL)
        assert refused.value.reason is Reason.FAULT
        with pytest.raises(
            DeviceStalledError, match=r"does not enable its outputs in FAULT: a fault has silenced it \(TEMPERATURE\)"
        ):
            device.enable()
        assert sounding(emulator) == 0
        assert device.clear_faults().faults == Fault.TEMPERATURE  # its cause is not gone
        device.time.sleep(0.1)
        assert device.clear_faults().faults == Fault(0)
        device.show(FULL)
        assert sounding(emulator) == 320


# Features that it lacks


@pytest.mark.parametrize(
    ("lacks", "use"),
    [
        (Feature.SEQUENCES, lambda device: device.store(0, FULL)),
        (Feature.SEQUENCES, lambda device: device.play([(0, 1)])),
        (Feature.UNATTENDED, lambda device: device.play([(0, 1)], unattended=True)),
        (Feature.MODULATION, lambda device: device.modulate([1], 1)),
        (Feature.MODULATION, lambda device: device.end_modulation()),
        (Feature.READ_BACK, lambda device: device.read_back()),
    ],
)
def test_a_missing_feature_is_an_error_and_not_sent(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, lacks: Feature, use: Callable[[Device], object]
) -> None:
    genuine = Info.encode
    monkeypatch.setattr(
        Info, "encode", lambda self: genuine(dataclasses.replace(self, features=self.features & ~lacks))
    )
    with open_device(emulator.url) as device:
        before = device.status().accepted
        with pytest.raises(DeviceError, match=f"lacks the feature {lacks.name}; `phasewire info` lists"):
            use(device)
        assert (device.status().accepted, device.status().enabled) == (before, False)
        device.show(FULL)
        assert sounding(emulator) == 320


# The end


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, RuntimeError, DeviceTimeoutError])
def test_the_outputs_are_off_however_the_session_ends(emulator: Emulator, error: type[BaseException] | None) -> None:
    def session() -> None:
        with open_device(emulator.url) as device:
            device.show(FULL)
            assert sounding(emulator) == 320
            if error:
                raise error("in the middle")

    if error:
        with pytest.raises(error, match="in the middle"):
            session()
    else:
        session()
    assert sounding(emulator) == 0
    assert not Port.of(emulator.usb).claims


def test_leaving_a_lost_device_is_an_error() -> None:
    with Emulator(serial="SHORT-LIVED") as emulator:
        device = open_device(emulator.url)
    with pytest.raises(DeviceLostError, match="the device is gone; plug it in again"):
        device.show(FULL)
    with pytest.raises(DeviceLostError), device:
        pass


def test_an_error_within_the_session_is_not_hidden_by_a_lost_device() -> None:
    def session() -> None:
        emulator = Emulator(serial="PULLED")
        with emulator:
            device = open_device(emulator.url)
        with device:
            raise RuntimeError("the first thing that went wrong")

    with pytest.raises(RuntimeError, match="the first thing"):
        session()


# Full stores are used from their beginning again


@pytest.mark.parametrize("count", [130, 512])
def test_sequences_that_follow_each_other_at_once_find_room(emulator: Emulator, count: int) -> None:
    with open_device(emulator.url) as device:
        device.store(0, HALF)
        for _ in range(20):
            device.play([(0, 3)] * count)
        assert device.status().refused == 0


@pytest.mark.parametrize("count", [255, 2048])
def test_modulations_that_follow_each_other_at_once_find_room(emulator: Emulator, count: int) -> None:
    with open_device(emulator.url) as device:
        for _ in range(40):
            device.modulate(bytes(count), 1)
        assert device.status().refused == 0


def test_what_fills_a_store_can_follow_a_stop_at_once(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.store(0, HALF)
        for _ in range(3):
            device.play([(0, 3)] * device.info.sequence_entries)
            device.modulate(bytes(device.info.modulation_samples), 1)
            emulator.run(10)
            device.stop()
        assert device.status().refused == 0


# Threads


def test_threads_share_a_device(emulator: Emulator) -> None:
    """Each gets its own answers, whatever the others do meanwhile; no block is lost, refused or out of turn."""
    turns = 25
    acks: list[Ack] = []
    wrong: list[BaseException] = []

    def often(use: Callable[[], object]) -> Callable[[], None]:
        def run() -> None:
            try:
                for _ in range(turns):
                    use()
            except BaseException as error:  # whatever it is, the test is to see it
                wrong.append(error)

        return run

    with open_device(emulator.url) as device:
        begun = device.status()
        device.store(0, HALF)

        def clocked() -> None:
            before, reading, after = device.clock().now, device.clock().now, device.clock().now
            assert before < reading < after

        # Steps and samples are few enough to fit beside each other: all may be queued at once.
        uses = [
            lambda: acks.append(device.show(MIXED)),
            lambda: acks.append(device.show(HALF)),
            lambda: acks.append(device.play([(0, 3)] * 40)),
            lambda: acks.append(device.modulate(bytes(range(160)), 1)),
            device.stop,
            device.status,
            clocked,
            lambda: device.wiring().channels,
        ]
        threads = [Thread(target=often(use)) for use in uses]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(timeout=60)
            assert not thread.is_alive()
        assert wrong == []
        assert len(acks) == 4 * turns
        assert len({ack.sequence for ack in acks}) == 4 * turns
        assert {ack.reason for ack in acks} == {Reason.ACCEPTED}
        ended = device.status()
        blocks = turns * (1 + 1 + 2 + 2) + 1
        assert (ended.accepted - begun.accepted, ended.refused, ended.lost) == (blocks, 0, 0)
        device.stop()
        device.show(FULL)
        assert sounding(emulator) == 320
