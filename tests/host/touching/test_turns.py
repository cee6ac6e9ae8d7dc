"""Two fields in turn: what the outputs did says whose turn it was, period by period."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Device, Emulator, open_device
from phasewire.base.errors import DeviceRefusedError
from phasewire.host.touching.fields import PulseCycle
from phasewire.host.touching.turns import Alternation, StoredTurns, StreamedTurns, _rotated, turns_for
from phasewire.protocol.quantise import PulseFrames
from phasewire.solver.rendering.ways import Halves

WIDTHS = 4, 16
"""Of the two fields, which tell them apart; a pose adds its number to them."""
WATCHDOG = 0.05


def fields(pose: int = 0, half: int = 100) -> PulseCycle:
    width = np.repeat(np.array(WIDTHS, np.uint8)[:, None] + np.uint8(pose % 8), 320, axis=1)
    return PulseCycle(PulseFrames(width % 2, width), half)


def halves(frequency: float = 200) -> Halves:
    return Halves(frequency, "square")


def numbered(pose: int, count: int, hold: int, envelope: float = 0.0) -> PulseCycle:
    """A cycle whose fields tell their number by the width of transducer 0, and their pose by that of transducer 1."""
    width = np.zeros((count, 320), np.uint8)
    width[:, 0], width[:, 1] = np.arange(count) + 1, pose % 20 + 1
    return PulseCycle(PulseFrames(width % 2, width), hold, envelope)


def played(emulator: Emulator, begin: int, end: int, transducer: int = 0) -> NDArray[np.int64]:
    """The width of a transducer's pulse in each period from one to before another."""
    capture = emulator.capture()
    bits = capture.bits(50 * begin, 50 * end)
    channel = int(capture.wiring.channels[transducer])
    levels = (bits[:, channel // 32] >> (channel % 32)) & 1
    return np.asarray(levels.reshape(-1, 50).sum(axis=1), np.int64)


def kept(device: Device, turns: StreamedTurns | StoredTurns, seconds: float) -> None:
    """Let time pass, and do what is due."""
    end = device.time.monotonic() + seconds
    while (now := device.time.monotonic()) < end:
        if now >= turns.due:
            turns.keep()
        else:
            device.time.sleep(min(turns.due, end) - now)


def whose(begin: int, end: int, half: int) -> NDArray[np.int64]:
    """The turn, 0 or 1, of each period by the paper's modulation."""
    return np.asarray(np.arange(begin, end) // half % 2)


@pytest.mark.parametrize(("frequency", "half"), [(200.0, 100), (40.0, 500), (160.3, 125), (400.0, 50)])
def test_the_turns_follow_the_devices_count_of_periods(frequency: float, half: int) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = turns_for(device, halves(frequency), WATCHDOG)
        assert isinstance(turns, StreamedTurns)
        turns.show(fields(half=half))
        first = device.status().period + 10
        kept(device, turns, 0.06)
        last = device.status().period - 10
        assert (turns.late, turns.slipped) == (0, 0)
    assert turns.alternation is not None
    assert turns.alternation.frequency == 20_000 / half
    np.testing.assert_array_equal(played(emulator, first, last), np.array(WIDTHS)[whose(first, last, half)])


@given(st.lists(st.floats(1e-4, 4e-3), min_size=5, max_size=30))
@settings(max_examples=20, deadline=None)
def test_poses_at_any_moment_play_soon_and_never_out_of_turn(gaps: list[float]) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = turns_for(device, halves(), WATCHDOG)
        turns.show(fields())
        first = device.status().period + 10
        shown = []
        for pose, gap in enumerate(gaps, start=1):
            kept(device, turns, gap)
            before = device.clock().now / 50
            assert turns.show(fields(pose))
            shown.append((before, pose))
        kept(device, turns, 0.005)
        last = device.status().period - 10
        assert (turns.late, turns.slipped) == (0, 0)
    widths = played(emulator, first, last)
    turn = (widths >= WIDTHS[1]).astype(int)
    np.testing.assert_array_equal(turn, whose(first, last, 100))
    poses = widths - np.array(WIDTHS)[turn]
    newest = -1
    for period, found in zip(range(first, last), poses, strict=True):
        there = [pose for before, pose in shown if before + 40 <= period]  # within a millisecond
        newest = max(newest, there[-1] if there else 0)
        assert found in [pose % 8 for pose in range(newest, len(gaps) + 1)]


def test_a_host_that_is_held_up_comes_back_in_phase_and_counts_it() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = turns_for(device, halves(), WATCHDOG)
        turns.show(fields())
        kept(device, turns, 0.01)
        device.time.sleep(0.0121)
        back = device.status().period + 10
        kept(device, turns, 0.02)
        last = device.status().period - 10
        assert turns.slipped in (4, 5)
    np.testing.assert_array_equal(played(emulator, back, last), np.array(WIDTHS)[whose(back, last, 100)])


def test_silence_is_kept_alive_and_ends_with_the_next_pose() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.set_watchdog(WATCHDOG)
        turns = turns_for(device, halves(), WATCHDOG)
        turns.show(fields())
        kept(device, turns, 0.01)
        turns.silence()
        quiet = device.status().period + 7
        kept(device, turns, 0.2)
        assert device.status().enabled, "there were signs of life"
        silent = played(emulator, quiet, device.status().period - 1)
        turns.show(fields())
        again = device.status().period + 10
        kept(device, turns, 0.01)
        last = device.status().period - 10
        assert turns.slipped == 0
    assert not silent.any()
    np.testing.assert_array_equal(played(emulator, again, last), np.array(WIDTHS)[whose(again, last, 100)])


@pytest.mark.parametrize("baud", [115_200, 921_600])
def test_a_slow_line_leaves_the_turns_to_the_device_in_the_same_phase(baud: int) -> None:
    with Emulator() as emulator, open_device(f"{emulator.url}?door=serial&baud={baud}") as device:
        watchdog = 20 / device.most_updates_per_second
        device.set_watchdog(watchdog)
        turns = turns_for(device, halves(), watchdog)
        assert isinstance(turns, StoredTurns)
        for pose in range(5):
            turns.show(fields(pose))
            ready = device.status().period + 600 + round(4 * 40_000 / device.most_updates_per_second)
            kept(device, turns, (ready + 400 - device.status().period) / 40_000)
            last = device.status().period - 10
            np.testing.assert_array_equal(
                played(emulator, ready, last), np.array(WIDTHS)[whose(ready, last, 100)] + pose
            )
        turns.silence()
        assert not played(emulator, device.status().period + 7, device.status().period + 8).any()


def test_a_line_with_little_room_keeps_the_turns_and_skips_poses_between() -> None:
    with Emulator() as emulator, open_device(f"{emulator.url}?door=serial&baud=3000000") as device:
        turns = turns_for(device, halves(), WATCHDOG)
        assert isinstance(turns, StreamedTurns)
        turns.show(fields())
        kept(device, turns, 0.006)
        first = device.status().period + 10
        sent = []
        for pose in range(1, 40):
            sent.append(turns.show(fields(pose)))
            kept(device, turns, 0.001)
        last = device.status().period - 10
        assert turns.slipped == 0
    assert not all(sent)
    turn = (played(emulator, first, last) >= WIDTHS[1]).astype(int)
    np.testing.assert_array_equal(turn, whose(first, last, 100))


CYCLES = [(24, 17), (24, 57), (8, 100), (2, 100), (9, 1)]
"""Fields, and carrier periods of each."""


@pytest.mark.parametrize(("count", "hold"), CYCLES)
def test_cycles_are_played_in_order_and_keep_their_phase_over_poses(count: int, hold: int) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = StoredTurns(device, 1, WATCHDOG)
        turns.show(numbered(0, count, hold))
        first, shown = device.status().period + 40, []
        for pose in range(1, 60):  # the table of entries is full after some forty of 24 fields
            kept(device, turns, 0.001 + 0.00013 * (pose % 7))
            assert turns.show(numbered(pose, count, hold))
            shown.append((device.status().period, pose))
        kept(device, turns, 0.005)
        last = device.status().period - 10
        assert turns.late == 0
        assert turns.alternation == Alternation(hold, 0, count)
    np.testing.assert_array_equal(played(emulator, first, last), np.arange(first, last) // hold % count + 1)
    poses = played(emulator, first, last, 1) - 1
    for now, pose in shown:
        assert pose % 20 == poses[now + 40 - first], "each plays within a millisecond of its last block"


@given(st.lists(st.tuples(st.integers(2, 24), st.integers(1, 60)), min_size=2, max_size=8))
@settings(max_examples=25, deadline=None)
def test_a_cycle_of_another_length_begins_where_the_share_of_the_cycle_is_the_same(
    cycles: list[tuple[int, int]],
) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = StoredTurns(device, 1, WATCHDOG)
        shown = []
        for pose, (count, hold) in enumerate(cycles):
            turns.show(numbered(pose, count, hold))
            shown.append(device.status().period)
            kept(device, turns, 0.004)
        first = shown[0] + 40
        last = device.status().period - 10
        assert turns.late == 0
    fields, poses = (played(emulator, first, last, transducer) - 1 for transducer in (0, 1))
    assert set(poses) == set(range(len(cycles)))
    for pose, (count, hold) in enumerate(cycles):
        mine = np.flatnonzero(poses == pose)
        assert (np.diff(mine) == 1).all()
        own = fields[mine]
        changes = np.flatnonzero(np.diff(own)) + 1
        np.testing.assert_array_equal(own[changes], (own[changes - 1] + 1) % count)
        assert (np.diff(changes) == hold).all()
        if pose > 0:
            before = cycles[pose - 1][0]
            share = own[0] / count - fields[mine[0] - 1] / before
            assert abs((share + 0.5) % 1 - 0.5) <= 1 / count + 1 / before


@given(st.lists(st.integers(0, 9), min_size=1, max_size=5), st.sampled_from([1, 3, 65_535, 140_000]), st.data())
@settings(deadline=None)
def test_the_steps_of_a_cycle_that_is_partly_over(slots: list[int], hold: int, data: st.DataObject) -> None:
    passed = data.draw(st.integers(0, len(slots) * hold - 1))
    steps = list(_rotated(slots, hold, passed))
    assert all(1 <= periods <= 65_535 for _, periods in steps)
    expanded = np.repeat([slot for slot, _ in steps], [periods for _, periods in steps])
    np.testing.assert_array_equal(expanded, np.roll(np.repeat(slots, hold), -passed))


def test_the_device_modulates_a_cycle_that_has_an_envelope_and_no_other() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.set_watchdog(WATCHDOG)
        turns = StoredTurns(device, 1, WATCHDOG)
        spans = []
        for envelope in (200.0, 200.0, 0.0, 100.0):
            turns.show(numbered(19, 8, 10, envelope))
            first = device.status().period + 40
            kept(device, turns, 0.02)
            spans.append((first, device.status().period - 10))
        turns.silence()
        kept(device, turns, 0.01)
        turns.show(numbered(19, 8, 10, 100.0))
        first = device.status().period + 40
        kept(device, turns, 0.02)
        spans.append((first, device.status().period - 10))
    for span, frequency in zip(spans, (200, 200, 0, 100, 100), strict=True):
        widths = played(emulator, *span, 1)
        if not frequency:
            assert (widths == 20).all()
            continue
        period = 40_000 // frequency
        np.testing.assert_array_equal(widths[period:], widths[:-period])
        assert (widths.min(), widths.max()) == (0, 20)
        assert len(widths) > period
        assert (np.abs(np.fft.rfft(widths[:period] - widths[:period].mean())).argmax()) == 1


def test_a_stop_while_fields_are_stored_is_not_undone(monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = Device.store
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = StoredTurns(device, 1, WATCHDOG)
        turns.show(numbered(0, 8, 100))
        kept(device, turns, 0.01)

        def store(self: Device, slot: int, frame: Any) -> Any:
            if slot % 24 == 3:
                device.stop()
            return genuine(self, slot, frame)

        monkeypatch.setattr(Device, "store", store)
        stopped = device.status().period
        with pytest.raises(DeviceRefusedError, match="it was stopped"):
            turns.show(numbered(1, 8, 100))
        assert not device.status().enabled
        emulator.run(200)
    assert not played(emulator, stopped + 60, stopped + 190).any()
