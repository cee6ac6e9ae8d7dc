"""Two fields in turn: what the outputs did says whose turn it was, period by period."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Device, Emulator, open_device
from phasewire.host.touching.turns import StoredTurns, StreamedTurns, turns_for
from phasewire.protocol.quantise import PulseFrames

WIDTHS = 4, 16
"""Of the two fields, which tell them apart; a pose adds its number to them."""
WATCHDOG = 0.05


def fields(pose: int = 0) -> PulseFrames:
    width = np.repeat(np.array(WIDTHS, np.uint8)[:, None] + np.uint8(pose % 8), 320, axis=1)
    return PulseFrames(width % 2, width)


def played(emulator: Emulator, begin: int, end: int) -> NDArray[np.int64]:
    """The width of a transducer's pulse in each period from one to before another."""
    capture = emulator.capture()
    bits = capture.bits(50 * begin, 50 * end)
    channel = int(capture.wiring.channels[0])
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
        turns = turns_for(device, frequency, WATCHDOG)
        assert isinstance(turns, StreamedTurns)
        turns.show(fields())
        first = device.status().period + 10
        kept(device, turns, 0.06)
        last = device.status().period - 10
        assert (turns.late, turns.slipped) == (0, 0)
    assert turns.frequency == 20_000 / half
    np.testing.assert_array_equal(played(emulator, first, last), np.array(WIDTHS)[whose(first, last, half)])


@given(st.lists(st.floats(1e-4, 4e-3), min_size=5, max_size=30))
@settings(max_examples=20, deadline=None)
def test_poses_at_any_moment_play_soon_and_never_out_of_turn(gaps: list[float]) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = turns_for(device, 200, WATCHDOG)
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
        turns = turns_for(device, 200, WATCHDOG)
        turns.show(fields())
        kept(device, turns, 0.01)
        device.time.sleep(0.0121)
        back = device.status().period + 10
        kept(device, turns, 0.02)
        last = device.status().period - 10
        assert turns.slipped in (4, 5)
    np.testing.assert_array_equal(played(emulator, back, last), np.array(WIDTHS)[whose(back, last, 100)])


def test_a_clock_that_is_corrected_backwards_at_a_boundary_does_not_swap_the_fields(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        turns = turns_for(device, 200, WATCHDOG)
        assert isinstance(turns, StreamedTurns)
        turns.show(fields())
        kept(device, turns, 0.01)
        device.time.sleep(max(turns.due - device.time.monotonic(), 0.0))
        turns.keep()  # the next turn is on its way
        first = turns._sent * 100
        early = first - turns._guard - 1
        monkeypatch.setattr(turns, "_now", lambda: early)
        turns.show(fields(1))
        monkeypatch.undo()
        kept(device, turns, 0.01)
        last = device.status().period - 10
    turn = (played(emulator, first, last) >= WIDTHS[1]).astype(int)
    np.testing.assert_array_equal(turn, whose(first, last, 100))


def test_silence_is_kept_alive_and_ends_with_the_next_pose() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.set_watchdog(WATCHDOG)
        turns = turns_for(device, 200, WATCHDOG)
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
        turns = turns_for(device, 200, watchdog)
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
        turns = turns_for(device, 200, WATCHDOG)
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


@pytest.mark.parametrize("frequency", [0.0, -200.0, float("nan"), float("inf"), 0.1, 41_000.0])
def test_a_frequency_out_of_range_is_refused(frequency: float) -> None:
    with (
        Emulator() as emulator,
        open_device(emulator.url) as device,
        pytest.raises(ValueError, match="must lie between"),
    ):
        turns_for(device, frequency, WATCHDOG)
