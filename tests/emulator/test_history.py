"""A port's history against a list with one entry for each period."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.ports.history import History, Segments

PERIODS = 60
GAPS = st.integers(1, 7)  # eight of them stay within the periods


def pulses(number: int) -> bytes:
    return number.to_bytes(4, "little") * 12


OPERATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("play"), GAPS, st.integers(1, 99)),
        st.tuples(st.just("silence"), GAPS),
        st.tuples(
            st.just("run"),
            GAPS,
            st.lists(st.tuples(st.integers(1, 99), st.integers(1, 5)), min_size=1, max_size=4),
            st.integers(0, 3),
        ),
        st.tuples(st.just("modulate"), GAPS, st.binary(max_size=4), st.integers(1, 3)),
    ),
    max_size=8,
)


def carried_out(operations: list[Any]) -> tuple[History, list[int], list[int]]:
    """The history, and for each period the number that it plays and the sample over it."""
    history, numbers, samples, period = History(), [0] * PERIODS, [255] * PERIODS, 0
    for operation in operations:
        period += operation[1]
        match operation:
            case "play", _, number:
                history.play(np.array([period]), np.frombuffer(pulses(number), np.uint8)[None])
                numbers[period:] = [number] * (PERIODS - period)
            case "silence", _:
                history.silence(period)
                numbers[period:] = [0] * (PERIODS - period)
            case "run", _, entries, repeats:
                slots = sorted({slot for slot, _ in entries})
                history.run(
                    period,
                    [pulses(slot) for slot in slots],
                    np.array([slots.index(slot) for slot, _ in entries]),
                    np.array([count for _, count in entries]),
                    repeats,
                )
                once = [slot for slot, count in entries for _ in range(count)]
                played = once * (repeats or PERIODS) + [0] * PERIODS
                numbers[period:] = played[: PERIODS - period]
            case "modulate", _, values, hold:
                history.modulate(period, values, hold)
                held = [value for value in values for _ in range(hold)] * PERIODS or [255] * PERIODS
                samples[period:] = held[: PERIODS - period]
    return history, numbers, samples


def read(segments: Segments, first: int) -> tuple[list[int], list[int]]:
    rows, samples = segments.rows(first, PERIODS)
    return [int.from_bytes(segments.slices[row][:4].tobytes(), "little") for row in rows], samples.tolist()


@given(OPERATIONS)
def test_every_period_plays_what_was_set_last(operations: list[Any]) -> None:
    history, numbers, samples = carried_out(operations)
    assert read(history.segments(), 0) == (numbers, samples)


@given(OPERATIONS, st.integers(0, PERIODS - 1))
def test_forgetting_the_past_does_not_change_the_rest(operations: list[Any], period: int) -> None:
    history, numbers, samples = carried_out(operations)
    before = history.segments()
    history.forget(period)
    assert read(history.segments(), period) == (numbers[period:], samples[period:])
    assert read(before, 0) == (numbers, samples)
    assert len(history.segments().starts) <= len(before.starts)


@given(OPERATIONS, st.integers(0, PERIODS - 1))
def test_segment_and_beginning_of_what_plays_in_a_period(operations: list[Any], period: int) -> None:
    history, numbers, _ = carried_out(operations)
    since, packed = history.segments().at(period)
    assert packed == pulses(numbers[period])
    assert 0 <= since <= period
    assert len(set(numbers[since : period + 1])) == 1


def test_a_history_grows_with_blocks_not_with_time() -> None:
    """An hour of a looped sequence is one segment more."""
    history = History()
    history.run(5, [pulses(1), pulses(2)], np.array([0, 1]), np.array([100, 100]), 0)
    assert len(history.segments().starts) == 2
    assert [
        int.from_bytes(history.segments().at(period)[1][:4], "little") for period in (144_000_005, 144_000_105)
    ] == [
        1,
        2,
    ]
