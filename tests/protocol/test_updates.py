"""The compiled way for many updates, against the readable way for one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from phasewire.protocol import Block, Pulses, Reason, Update, pack, pack_updates, unpack_updates

from tests.from_spec import seal_block
from tests.strategies import update

PERIODS = st.just(0) | st.integers(2**64 - 3, 2**64 - 1) | st.integers(0, 2**64 - 1)
SEQUENCES = st.integers(2**32 - 3, 2**32 - 1) | st.integers(0, 2**32 - 1)

PHASES = hnp.arrays(np.uint8, st.tuples(st.integers(0, 9), st.just(320)), elements=st.integers(0, 99))
JUNK = np.random.default_rng(5)


def as_rows(data: list[bytes]) -> np.ndarray:
    return np.frombuffer(b"".join(data), np.uint8).reshape(-1, 512)


def assert_the_same_one_by_one(
    phase: np.ndarray, width: np.ndarray, first: int, periods: np.ndarray, restart: bool
) -> None:
    """Blocks packed at once are those packed one by one, and are unpacked to the same values."""
    k = len(phase)
    packed = pack_updates(phase, width, first, periods, restart=restart)
    assert packed.shape == (k, 512)
    for n in range(k):
        body = Update(Pulses(phase[n], width[n]), int(periods[n]))
        assert packed[n].tobytes() == pack(Block(body, (first + n) % 2**32, restart and n == 0))
    updates = unpack_updates(packed)
    assert not updates.reason.any()
    assert np.array_equal(updates.phase, phase)
    assert np.array_equal(updates.width, width)
    assert np.array_equal(updates.period, periods)
    assert updates.sequence.tolist() == [(first + n) % 2**32 for n in range(k)]
    assert updates.restart.tolist() == [restart and n == 0 for n in range(k)]


@given(PHASES, st.integers(0, 2**32 - 1), SEQUENCES, st.data(), st.booleans())
def test_the_same_blocks_as_one_by_one(
    phase: np.ndarray, seed: int, first: int, data: st.DataObject, restart: bool
) -> None:
    k = len(phase)
    width = np.random.default_rng(seed).integers(0, 26, (k, 320), dtype=np.uint8)
    periods = np.array(data.draw(st.lists(PERIODS, min_size=k, max_size=k)), np.uint64)
    assert_the_same_one_by_one(phase, width, first, periods, restart)


def test_a_long_batch_is_the_same_blocks_across_the_wrap() -> None:
    phase = JUNK.integers(0, 100, (600, 320), dtype=np.uint8)
    width = JUNK.integers(0, 26, (600, 320), dtype=np.uint8)
    periods = JUNK.integers(0, 2**64, 600, dtype=np.uint64)
    assert_the_same_one_by_one(phase, width, 2**32 - 300, periods, restart=False)


@pytest.mark.parametrize(("name", "wrong"), [("phase", 100), ("phase", 127), ("width", 26), ("width", 31)])
def test_a_reserved_pulse_is_refused_in_every_place(name: str, wrong: int) -> None:
    blocks = []
    for transducer in range(320):
        words = np.zeros(320, np.uint32)
        words[transducer] = wrong if name == "phase" else wrong << 7
        pairs = (words[0::2] | words[1::2] << 12).astype("<u4")
        payload = pairs.view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
        blocks.append(seal_block(update(Pulses.silent(320), 1)[:32] + payload))
    assert (unpack_updates(as_rows(blocks)).reason == Reason.PULSE).all()


@pytest.mark.parametrize("periods", [[1, 2**64 - 1], [np.uint64(2**64 - 1), 0], [2**63, np.int8(5)], []])
def test_periods_may_come_as_a_list(periods: list[int]) -> None:
    silent = np.zeros((len(periods), 320), np.uint8)
    assert unpack_updates(pack_updates(silent, silent, 0, periods)).period.tolist() == periods


def test_blocks_are_written_to_a_given_array() -> None:
    silent = np.zeros((2, 320), np.uint8)
    room = np.full((4, 512), 0xAA, np.uint8)
    assert pack_updates(silent, silent, 0, out=room[1:3]).base is room
    assert (room[[0, 3]] == 0xAA).all()
    assert np.array_equal(room[1:3], pack_updates(silent, silent, 0))


def test_rows_may_have_any_memory_layout() -> None:
    phase = JUNK.integers(0, 100, (6, 640), dtype=np.uint8)[::2, ::2]
    width = np.asfortranarray(JUNK.integers(0, 26, (3, 320), dtype=np.uint8))
    expected = pack_updates(np.ascontiguousarray(phase), np.ascontiguousarray(width), 0)
    assert np.array_equal(pack_updates(phase, width, 0), expected)


GOOD = np.zeros((2, 320), np.uint8)
BAD_PHASE, BAD_WIDTH = GOOD.copy(), GOOD.copy()
BAD_PHASE[1, 7], BAD_WIDTH[1, 319] = 100, 26


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((BAD_PHASE, GOOD, 0), "phase 100 of transducer 7 of update 1 is above 99"),
        ((GOOD, BAD_WIDTH, 0), "width 26 of transducer 319 of update 1 is above 25"),
        ((GOOD[:, :319], GOOD, 0), r"phase must be \(k, 320\) uint8, not \(2, 319\) uint8"),
        ((GOOD, GOOD.astype(int), 0), r"width must be \(k, 320\) uint8, not \(2, 320\) int64"),
        ((GOOD[0], GOOD, 0), "phase must be"),
        (([[0] * 320], GOOD, 0), r"phase must be \(k, 320\) uint8, not \(1, 320\) int64"),
        ((GOOD, GOOD[:1], 0), "2 rows of phases but 1 of widths"),
        ((GOOD, GOOD, 2**32), "sequence number 4294967296 must be a whole number"),
        ((GOOD, GOOD, -1), "sequence number -1"),
        ((GOOD, GOOD, 0, -1), r"periods must be whole numbers from 0 to 2\*\*64 - 1, not -1"),
        ((GOOD, GOOD, 0, np.array([3, -2])), "not -2"),
        ((GOOD, GOOD, 0, [1.0, 2.0]), "not 1.0"),
        ((GOOD, GOOD, 0, np.array([1.0, 2.0])), "not 1.0"),
        ((GOOD, GOOD, 0, [2, 2**64]), "not 18446744073709551616"),
        ((GOOD, GOOD, 0, [2**63, -1]), "not -1"),
        ((GOOD, GOOD, 0, True), "not True"),
        ((GOOD, GOOD, 0, None), "not None"),
        ((GOOD, GOOD, 0, [1, 2, 3]), r"\(2,\) of them are needed, not \(3,\)"),
    ],
)
def test_an_error_names_a_value_that_cannot_travel(arguments: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pack_updates(*arguments)


@pytest.mark.parametrize(
    ("out", "message"),
    [
        (np.empty((3, 512), np.uint8), "2 updates do not fit 3 blocks"),
        (np.empty((2, 511), np.uint8), "out must be contiguous"),
        (np.empty((2, 512)), "not .* float64"),
        (np.empty((2, 1024), np.uint8)[:, ::2], "contiguous"),
    ],
)
def test_an_error_names_an_array_that_does_not_fit(out: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pack_updates(GOOD, GOOD, 0, out=out)


@pytest.mark.parametrize("name", ["phase", "width"])
def test_an_output_that_overlaps_an_input_is_refused(name: str) -> None:
    room = np.zeros((2, 512), np.uint8)
    pulses: dict[str, Any] = {"phase": GOOD, "width": GOOD} | {name: room[:, 100:420]}
    with pytest.raises(ValueError, match=f"out lies in the same memory as {name}"):
        pack_updates(**pulses, sequence=0, out=room)


def test_a_read_only_output_is_refused() -> None:
    room = np.empty((2, 512), np.uint8)
    room.setflags(write=False)
    with pytest.raises(ValueError, match="out is read-only"):
        pack_updates(GOOD, GOOD, 0, out=room)


@pytest.mark.parametrize(
    "blocks",
    [
        np.zeros(512, np.uint8),
        np.zeros((1, 511), np.uint8),
        np.zeros((1, 512)),
        [bytes(512)],
        bytes(512),
        "text",
        None,
    ],
)
def test_an_error_names_bytes_that_are_no_blocks(blocks: Any) -> None:
    with pytest.raises(ValueError, match=r"blocks must be (contiguous|an array,) \(k, 512\) uint8"):
        unpack_updates(blocks)


def test_received_blocks_are_read_without_a_copy() -> None:
    """A read-only buffer, as bytes from a transfer are."""
    received = pack_updates(GOOD, GOOD, 9).tobytes()
    assert unpack_updates(np.frombuffer(received, np.uint8).reshape(-1, 512)).sequence.tolist() == [9, 10]
