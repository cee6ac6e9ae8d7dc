"""The controller's kernels compute what the protocol says, by hand and as compiled, in the cycles of BUD-003."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.base.errors import BlockError
from phasewire.firmware.xmos.controller import CASES, SPLITS, Case, Fetch, call, expected, pass_blocks
from phasewire.firmware.xmos.controller.building import FOLDER, REFERENCE, SOURCES
from phasewire.firmware.xmos.kept import KeptAssembly
from phasewire.firmware.xs1.clang import find_clang
from phasewire.protocol import Pulses
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Block,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    checksum,
    pack,
    unpack,
)
from phasewire.protocol.board import CYCLES_PER_PERIOD
from phasewire.protocol.codes import Action, Reason
from phasewire.protocol.pulses import POWER
from phasewire.protocol.wiring import Wiring

SORT_BOUND = 7000
"""Cycles from the hand-over of a block to ten slices: three threads sort, five run, fetches delay."""

FETCHES: tuple[Fetch, ...] = ("off", "pessimistic")
ACCEPTED = [case for case in CASES if expected(case).messages]
QUICK = settings(max_examples=25, deadline=None)

numbers = st.integers(0, 2**32 - 1)


def drawn(seed: int) -> tuple[Wiring, Pulses]:
    """Any wiring, and any pulses."""
    rng = np.random.default_rng(seed)
    return Wiring(rng.permutation(320)), Pulses(rng.integers(0, 100, 320), rng.integers(0, 26, 320))


def pressed(block: bytes, at: int, value: int) -> bytes:
    """A block with another byte, and the checksum that belongs to it."""
    changed = bytearray(block)
    changed[at] = value
    if not 28 <= at < 32:
        changed[28:32] = checksum(bytes(changed)).to_bytes(4, "little")
    return bytes(changed)


def bodies(seed: int) -> list[bytes]:
    """A valid block of each kind."""
    rng = np.random.default_rng(seed)
    _, pulses = drawn(seed)
    count = int(rng.integers(1, 121))
    entries = tuple(Entry(int(rng.integers(256)), int(rng.integers(1, 65536))) for _ in range(count))
    samples = rng.integers(0, 256, int(rng.integers(1, 481)), dtype=np.uint8).tobytes()
    made = (
        Update(pulses, int(rng.integers(2**40))), Slot(int(rng.integers(256)), pulses), Entries(entries, 1024 - count),
        PlaySequence(0, int(rng.integers(1, 1025))), Samples(samples, 4096 - len(samples)),
        AmplitudeModulation(0, int(rng.integers(1, 4097)), 7), Output(Action.SILENCE), Clock(), NoOp(),
    )  # fmt: skip
    return [pack(Block(body, seed, restart=bool(seed % 2))) for body in made]


def judged(block: bytes) -> Reason:
    """The reason that the protocol's own function refuses a block for."""
    try:
        unpack(block)
    except BlockError as error:
        return Reason(error.reason)
    return Reason.ACCEPTED


@pytest.mark.parametrize("fetch", FETCHES)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_block_is_checked_sorted_and_sent(case: Case, fetch: Fetch) -> None:
    (passage,) = pass_blocks([case], fetch=fetch, period=2**33 + 5)
    right = expected(case, period=2**33 + 5)
    assert passage.reason is right.reason
    assert passage.messages == right.messages
    if case.block[3] <= 2 and right.reason is not Reason.PULSE:
        assert (passage.power, passage.slices) == (right.power, right.slices)


@pytest.mark.parametrize("threads", SPLITS)
def test_any_number_of_threads_sorts_alike(threads: int) -> None:
    wiring, pulses = drawn(threads)
    case = Case("", wiring, pack(Block(Update(pulses), 1)))
    (passage,) = pass_blocks([case], split=SPLITS[threads])
    right = expected(case)
    assert (passage.reason, passage.power, passage.slices) == (right.reason, right.power, right.slices)


@given(numbers, st.integers(0, 319), st.integers(0, 4095))
@QUICK
def test_any_pulses_under_any_wiring_are_sorted_and_one_that_is_reserved_is_found(
    seed: int, place: int, code: int
) -> None:
    wiring, pulses = drawn(seed)
    block = bytearray(pack(Block(Update(pulses), 1)))
    at = 32 + place // 2 * 3
    pair = int.from_bytes(block[at : at + 3], "little") & ~(0xFFF << 12 * (place % 2))
    block[at : at + 3] = (pair | code << 12 * (place % 2)).to_bytes(3, "little")
    case = Case("", wiring, pressed(bytes(block), 0, block[0]))
    (passage,) = pass_blocks([case])
    right = expected(case)
    assert (passage.reason, passage.messages) == (right.reason, right.messages)
    if code >> 7 <= 25 and code & 127 <= 99:
        assert (passage.power, passage.slices) == (right.power, right.slices)
    else:
        assert passage.reason is Reason.PULSE


@given(numbers, st.integers(0, 8), st.one_of(st.integers(0, 31), st.integers(0, 511)), st.integers(0, 255))
@settings(max_examples=60, deadline=None)
def test_a_block_of_any_kind_with_another_byte_is_refused_for_the_same_reason(
    seed: int, kind: int, at: int, value: int
) -> None:
    block = pressed(bodies(seed)[kind], at, value)
    (passage,) = pass_blocks([Case("", Wiring.strips(), block)])
    assert passage.reason is judged(block)


@given(numbers)
@QUICK
def test_the_total_drive_is_refused_above_its_limit_and_no_earlier(seed: int) -> None:
    wiring, pulses = drawn(seed)
    block, power = pack(Block(Update(pulses), 1)), int(POWER[pulses.width].sum())
    at, above = pass_blocks([Case("", wiring, block, power), Case("", wiring, block, power - 1)])
    assert (at.reason, above.reason) == (Reason.ACCEPTED, Reason.DRIVE)


# Cycles


def test_five_threads_that_never_pause_sort_within_the_bound_however_instructions_are_fetched() -> None:
    for fetch in FETCHES:
        cycles = {pass_blocks([case], fetch=fetch, busy=True)[0].sorted_cycles for case in ACCEPTED}
        assert len(cycles) == 1  # whatever the pulses and the wiring
        assert cycles.pop() <= SORT_BOUND


def test_every_case_is_judged_within_the_bound() -> None:
    for case in CASES:
        assert pass_blocks([case], fetch="pessimistic", busy=True)[0].sorted_cycles <= SORT_BOUND


@pytest.mark.parametrize("fetch", FETCHES)
def test_40_000_updates_a_second_pass_for_ever_on_five_wires(fetch: Fetch) -> None:
    wiring, _ = drawn(0)
    cases = [Case("", wiring, pack(Block(Update(drawn(seed)[1]), seed))) for seed in range(12)]
    passages = pass_blocks(cases, fetch=fetch, interval=CYCLES_PER_PERIOD)
    assert [passage.messages for passage in passages] == [expected(case).messages for case in cases]
    late = [passage.sent_cycles for passage in passages]
    assert max(late[6:]) <= max(late[:6])  # nothing piles up
    assert max(passage.sorted_cycles for passage in passages) <= SORT_BOUND


@pytest.mark.parametrize(("threads", "periods"), [(1, 2), (2, 1), (3, 1), (4, 1)])
def test_two_sorting_threads_are_enough_for_an_update_in_every_period(threads: int, periods: int) -> None:
    (passage,) = pass_blocks([CASES[0]], split=SPLITS[threads], fetch="pessimistic", busy=True)
    assert -(-passage.sorted_cycles // CYCLES_PER_PERIOD) == periods


def test_the_reference_in_one_thread_is_too_slow_for_that() -> None:
    whole = call("plan", CASES[2])
    assert whole.record[:4] == b"PA\x01\x00"
    assert 11 * CYCLES_PER_PERIOD < whole.cycles < 12 * CYCLES_PER_PERIOD


def test_the_plan_alone_takes_less_than_the_time_of_a_period() -> None:
    spent = call("plan", CASES[2], stand_ins=True, fetch="pessimistic").functions
    beside = ("pw_block_check", "fields_get", "items_valid", "others_valid", "payload_valid", "pw_crc32", "memcpy")
    assert sum(count for name, count in spent.items() if name not in beside) <= 1300


# What is compiled


@given(numbers)
@settings(max_examples=3, deadline=None)
def test_the_reference_s_functions_are_executed_as_the_host_s_compiler_has_them(
    library: ctypes.CDLL, seed: int
) -> None:
    wiring, pulses = drawn(seed)
    case = Case("", wiring, pack(Block(Update(pulses), 1)))
    right = expected(case)
    payload = case.block[32:]
    channels = wiring.channels.astype(np.uint16)
    slices = ctypes.create_string_buffer(480)
    library.pw_pulses_sort(payload, channels.ctypes.data_as(ctypes.c_void_p), slices)
    assert slices.raw == right.slices == call("pw_pulses_sort", case).slices
    assert library.pw_pulses_power(payload, 320) == right.power == call("pw_pulses_power", case).result
    assert library.pw_pulses_valid(payload, 320) & 0xFF == 1 == call("pw_pulses_valid", case).result
    crc = zlib.crc32(case.block)
    assert library.pw_crc32(0, case.block, ctypes.c_size_t(512)) & 0xFFFFFFFF == crc == call("pw_crc32", case).result
    piece = right.slices[:48]
    commit = zlib.crc32((1000).to_bytes(8, "little"), zlib.crc32(piece))
    assert library.pw_commit_checksum(piece, ctypes.c_uint64(1000)) & 0xFFFFFFFF == commit
    assert call("pw_commit_checksum", case, slices=piece).result == commit
    assert call("pw_block_check", case).result == Reason.ACCEPTED


@given(numbers, st.integers(0, 8), st.one_of(st.integers(0, 31), st.integers(0, 511)), st.integers(0, 255))
@settings(max_examples=400, deadline=None)
def test_the_judge_by_words_is_the_reference_s_by_bytes(
    library: ctypes.CDLL, seed: int, kind: int, at: int, value: int
) -> None:
    block = pressed(bodies(seed % 50)[kind], at, value)
    words = np.frombuffer(block, np.uint32).copy()
    reason = library.judge(words.ctypes.data_as(ctypes.c_void_p), ctypes.c_uint32(checksum(block)))
    room = ctypes.create_string_buffer(128)
    whole = library.pw_block_check(block, ctypes.c_size_t(512), room)
    assert whole == judged(block)
    assert reason == (0 if whole == Reason.PULSE else whole)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The same C for this machine."""
    if not shutil.which("gcc"):
        pytest.skip("no C compiler")
    path = tmp_path_factory.mktemp("kernels") / "kernels.so"
    sources = [*(REFERENCE / f"{name}.c" for name in ("blk", "chn", "pul", "sums")), FOLDER / "judge.c"]
    subprocess.run(["gcc", "-O2", "-shared", "-fPIC", f"-I{REFERENCE}", "-o", path, *sources], check=True, timeout=60)
    return ctypes.CDLL(str(path))


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.source.name)
def test_the_committed_assembly_is_of_the_c_beside_it(source: KeptAssembly) -> None:
    assert not source.stale, "run: python -m phasewire.firmware.xmos.controller.building"


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.source.name)
def test_the_same_compiler_makes_the_committed_assembly_again(source: KeptAssembly) -> None:
    if not find_clang():
        pytest.skip("no clang with the target xcore")
    text, again = source.read().text, source.compiled().text
    maker, now = (next(line for line in one.splitlines() if ".ident" in line) for one in (text, again))
    if maker != now:
        pytest.skip(f"another compiler: {now.strip()}")
    assert again == text


def test_each_generated_file_has_its_source() -> None:
    kept = {path.name for path in (Path(FOLDER) / "generated").iterdir()}
    assert kept == {source.path.name for source in SOURCES}
