"""The messages of the chain, as the executed processor takes and answers them (chapter CHN)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.firmware.xmos.build import load_processor, processor_segment
from phasewire.protocol.board import CYCLES_PER_MS
from phasewire.protocol.chain import (
    Collect,
    Commit,
    Identity,
    Load,
    Message,
    Number,
    Playing,
    Program,
    Report,
    Slice,
    loads,
)
from phasewire.protocol.codes import ChannelEnd, Fault, Memory

from .harness import CONTROL, END, Bench, tokens_of
from .made import random_slice

LINK_MS = 1000
RNG = np.random.default_rng(7)


def begun() -> Bench:
    bench = Bench()
    bench.begin()
    bench.run_to(3)
    return bench


# Numbering


@pytest.mark.parametrize("number", range(10))
def test_it_takes_its_number_and_routes_by_it(number: int) -> None:
    """CHN-022, CHN-025: each destination leaves by the link that the clause names."""
    bench = Bench(unique_id=0xFEDCBA9876543210)
    identity = bench.take_number(number)
    assert identity == Identity(number, number == 9, (0, 1, 0), 0xFEDCBA9876543210)
    up, down = 0, 1
    for node in [*range(16), 0x00FF, 0x0013, 0xFFFF, 0x0103, 0x8000]:
        if node == number:
            assert bench.switch.route(node) is None
            continue
        bit = (node ^ number).bit_length() - 1
        wanted = down if bit >= 8 else up if bit >= 4 else up if number >> bit & 1 else down
        assert bench.switch.route(node) == wanted, f"node {node:#x}"


def test_without_a_number_everything_goes_up() -> None:
    bench = Bench()
    bench.run(8 * CYCLES_PER_MS)
    assert {bench.switch.route(node) for node in (0, 9, 0xFF, 0x8000)} == {0}


def test_it_says_hello_each_millisecond_until_there_is_credit() -> None:
    """CHN-023, with the link set up as that to the controller."""
    bench = Bench(hello=False)
    bench.run(20 * CYCLES_PER_MS)
    assert 15 <= len(bench.hellos) <= 20
    assert abs(np.diff(bench.hellos) - CYCLES_PER_MS).max() < 1000
    bench.bring(Number(4))
    bench.run(30 * CYCLES_PER_MS)
    assert not bench.sent, "it knows nothing of the link yet"
    bench.answers_hello = True
    bench.run(32 * CYCLES_PER_MS)
    (identity,) = bench.answers()
    assert isinstance(identity, Identity)
    assert not identity.last
    said = len(bench.hellos)
    bench.run(40 * CYCLES_PER_MS)
    assert len(bench.hellos) == said
    settings_mask = 0x403F_FFFF
    assert bench.switch.registers[0x81] & settings_mask == bench.switch.registers[0x80] & settings_mask


@pytest.mark.parametrize("number", [2, 9])
def test_a_processor_with_nothing_behind_it_is_the_last(number: int) -> None:
    """CHN-023: number 9 answers at once, any other 1000 ms after its start."""
    bench = Bench(hello=False)
    bench.bring(Number(number), at=10 * CYCLES_PER_MS)
    if number != 9:
        bench.run((LINK_MS - 1) * CYCLES_PER_MS)
        assert not bench.sent
        bench.run((LINK_MS + 5) * CYCLES_PER_MS)
    else:
        bench.run(10 * CYCLES_PER_MS + 10_000)
    (identity,) = bench.answers()
    assert identity == Identity(number, True, (0, 1, 0), 0x0123456789ABCDEF)


def test_a_message_that_comes_while_it_boots_is_kept() -> None:
    """Channel ends are there before tables are computed."""
    bench = Bench()
    bench.deliver(6, tokens_of(Number(1)), 2000)
    bench.run(5 * CYCLES_PER_MS)
    assert [type(answer) for answer in bench.answers()] == [Identity]


def test_the_version_is_that_of_its_segment() -> None:
    bench = Bench(processor_segment((9, 200, 255)))
    assert bench.take_number(0).firmware == (9, 200, 255)
    bench.sync()
    assert bench.report().firmware == (9, 200, 255)


def test_without_a_number_all_else_is_damaged() -> None:
    bench = Bench()
    bench.run(8 * CYCLES_PER_MS)
    piece = Slice(3, random_slice(RNG))
    messages: list[Message] = [
        piece, Commit.of(5, piece), Load(3, Memory.SLOTS, 0, bytes(48)), Program(3, Memory.ENTRIES, 9, 0, 0),
        Collect(3, ChannelEnd.REPORT),
    ]  # fmt: skip
    for message in messages:
        bench.bring(message)
    bench.run(bench.core.cycle + 10_000)
    assert bench.switch.node == 0xFFFF
    bench.begin()
    report = bench.report()
    assert (report.damaged_messages, report.missed_commits, report.faults) == (len(messages), 0, Fault.CHAIN)


def test_a_second_number_is_damaged() -> None:
    bench = begun()
    bench.bring(Number(4))
    assert (bench.report().damaged_messages, bench.number) == (1, 3)


# Damage


GOOD: dict[str, Message] = {
    "load": Load(3, Memory.ENTRIES, 1012, bytes(range(48))),
    "program": Program(3, Memory.ENTRIES, 2**40, 5, 6, 0, 7),
    "collect": Collect(3, ChannelEnd.REPORT),
}


@pytest.mark.parametrize("name", GOOD)
def test_any_flipped_bit_is_damage(name: str) -> None:
    """CHN-010: each bit of each token of the payload and of the CRC-32."""
    message = GOOD[name]
    bench = begun()
    tokens = tokens_of(message)
    flips = [(place, bit) for place in range(len(tokens) - 1) for bit in range(8)]
    for place, bit in flips:
        wrong = tokens.copy()
        wrong[place] ^= 1 << bit
        bench.deliver(int(message.CHANNEL_END), wrong, 0)
        bench.run(bench.free_at + 200)
    report = bench.report()
    assert report.damaged_messages == len(flips)
    assert not bench.sent
    bench.run_to(bench.period + 1)
    assert not bench.core.memory[entries_at() : entries_at() + 4096].any()


def entries_at() -> int:
    return load_processor().symbols["entries"] - 0x10000


def test_a_message_for_another_node_is_damage() -> None:
    """CHN-010: the receiver's own node is in the CRC-32."""
    bench = begun()
    for message in (
        Load(4, Memory.SLOTS, 0, bytes(48)),
        Program(2, Memory.ENTRIES, 9, 0, 0),
        Collect(7, ChannelEnd.REPORT),
    ):
        bench.bring(message)
    assert bench.report().damaged_messages == 3


LENGTHS = {1: 48, 2: 12, 3: 56, 4: 21, 5: 5, 6: 5}
"""Of the messages to each channel end, without END."""


def any_tokens(channel_end: int) -> st.SearchStrategy[tuple[int, list[int]]]:
    """Tokens for a channel end, often as many as it expects; among them may be a control token other than END."""
    size = LENGTHS.get(channel_end, 9)
    data = st.lists(st.integers(0, 255), min_size=size, max_size=size) | st.lists(st.integers(0, 255), max_size=140)
    controls = st.none() | st.tuples(st.integers(0, size), st.integers(CONTROL | 3, CONTROL | 255))

    def together(tokens: list[int], control: tuple[int, int] | None) -> tuple[int, list[int]]:
        if control is not None:
            tokens = [*tokens[: control[0]], control[1], *tokens[control[0] + 1 :]]
        return channel_end, tokens

    return st.builds(together, data, controls)


@pytest.fixture(scope="module")
def bench() -> Bench:
    return begun()


@settings(max_examples=60, deadline=None)
@given(garbage=st.lists(st.integers(1, 12).flatmap(any_tokens), min_size=1, max_size=8))
def test_any_tokens_are_survived(bench: Bench, garbage: list[tuple[int, list[int]]]) -> None:
    """Messages of any length to any channel end are counted once, and what follows them is taken."""
    before = bench.report()
    wrong = 0
    missed = 0
    for channel_end, tokens in garbage:
        if len(tokens) != LENGTHS.get(channel_end) or max(tokens) >= CONTROL:
            wrong += 1
        elif channel_end in (3, 4, 5, 6):
            wrong += 1  # no CRC-32 is right by chance
        elif channel_end == 2:
            missed += 1
        bench.deliver(channel_end, np.array([*tokens, END]), 0)
        bench.run(bench.free_at + 3000)
    after = bench.report()
    assert after.damaged_messages - before.damaged_messages == wrong
    assert after.missed_commits - before.missed_commits == missed
    assert bench.core.trap is None


def test_control_tokens_amid_a_message_are_damage() -> None:
    """Up to the END; a message whose END got lost runs into the next one."""
    bench = begun()
    piece = tokens_of(Slice(3, random_slice(RNG)))
    for place in (0, 1, 2, 3, 4, 17, 47, 48):
        wrong = piece.copy()
        if place < 48:
            wrong[place] = CONTROL | 5
        else:
            wrong = np.concatenate([piece[:-1], [CONTROL | 5], piece[-1:]])
        bench.deliver(1, wrong, 0)
        bench.run(bench.free_at + 500)
    assert bench.report().damaged_messages == 8
    lost = np.concatenate([piece[:-1], np.frombuffer(Slice(3, bytes(48)).encode()[:-1], np.uint8), [END]])
    bench.deliver(1, lost, 0)
    good = random_slice(RNG)
    bench.run(bench.free_at + 500)
    due = bench.period + 5
    bench.commit(due, good)
    bench.run_to(due + 1)
    report = bench.report()
    assert (report.damaged_messages, report.missed_commits, report.carried_out) == (9, 0, 1)


def test_a_commit_with_a_wrong_checksum_is_missed_and_empties_the_mailbox() -> None:
    """CHN-004, CHN-011."""
    bench = begun()
    piece = Slice(3, random_slice(RNG))
    for bit in range(96):
        commit = Commit.of(bench.period + 4, piece)
        tokens = tokens_of(commit)
        tokens[bit // 8] ^= 1 << bit % 8
        bench.bring(piece)
        bench.deliver(2, tokens, 0)
        bench.run(bench.free_at + 3000)
    bench.bring(Commit.of(bench.period + 4, piece))
    report = bench.report()
    assert (report.missed_commits, report.carried_out, report.damaged_messages) == (97, 0, 0)
    assert report.faults == Fault.CHAIN
    assert bench.report().faults == 0, "it is said once (CHN-016)"


# Stores


def test_loads_fill_the_memories_and_nothing_else() -> None:
    """CHN-012, with every slot, entry and sample."""
    bench = begun()
    symbols = load_processor().symbols
    expected = {}
    for memory, name, size in (
        (Memory.SLOTS, "slots", 12288),
        (Memory.ENTRIES, "entries", 4096),
        (Memory.SAMPLES, "samples", 4096),
    ):
        data = RNG.integers(0, 256, size).astype(np.uint8).tobytes()
        expected[name] = data
        for load in loads(3, memory, 0, data):
            bench.bring(load)
            bench.run(bench.free_at + 300)
    bench.run(bench.core.cycle + 10_000)
    for name, data in expected.items():
        at = symbols[name] - 0x10000
        assert bench.core.memory[at : at + len(data)].tobytes() == data, name
    for first, count in ((1, 1), (5, 47), (4090, 6), (2, 2)):
        data = RNG.integers(0, 256, count).astype(np.uint8).tobytes()
        bench.bring(Load(3, Memory.SAMPLES, first, data))
        expected["samples"] = expected["samples"][:first] + data + expected["samples"][first + count :]
    bench.run(bench.free_at + 10_000)
    at = symbols["samples"] - 0x10000
    assert bench.core.memory[at : at + 4096].tobytes() == expected["samples"]
    assert bench.report().faults == 0


# Questions


def test_an_answer_says_what_has_begun() -> None:
    """CHN-016: PLAYING and the count of commits change at the boundary, not when it is decided."""
    bench = begun()
    packed = random_slice(RNG)
    bench.commit(9, packed)
    before = Playing(3, 0, bytes(48))
    bench.run_to(8, 4000)
    assert bench.playing(bench.boundary(9) - 2400) == before
    for asked in (3000, 700, 300):
        bench = begun()
        bench.commit(9, packed)
        bench.run_to(8, 4000)
        bench.bring(Collect(3, ChannelEnd.REPORT), bench.boundary(9) - asked)
        bench.run_to(9, 1000)
        (report,) = bench.answers()
        assert isinstance(report, Report)
        assert report.carried_out == 0, f"{asked} cycles before the boundary"
    assert bench.playing(bench.boundary(9) + 100) == Playing(3, 9, packed)
    assert bench.report().carried_out == 1


def test_counts_are_told_after_a_long_silence_of_the_timer() -> None:
    """The timer's 32 bits wrap every 43 s: what began long ago has begun."""
    bench = begun()
    packed = random_slice(RNG)
    bench.commit(bench.period + 4, packed)
    began = bench.period + 4
    bench.run_to(began + 5)
    told = load_processor().symbols["told"] - 0x10000
    at = int.from_bytes(bench.core.memory[told + 32 : told + 36].tobytes(), "little")
    bench.core.memory[told + 32 : told + 36] = np.frombuffer(((at + 2**31 + 5) % 2**32).to_bytes(4, "little"), np.uint8)
    assert bench.playing() == Playing(3, began, packed)


def test_answers_leave_as_fast_as_the_fastest_link() -> None:
    """CHN-020 the other way: a route is not held longer than its tokens take."""
    bench = begun()
    for what, tokens in ((ChannelEnd.REPORT, 25), (ChannelEnd.PLAYING, 62)):
        bench.bring(Collect(3, what))
        bench.run(bench.free_at + CYCLES_PER_MS // 2)
        sent, _ = bench.sent.pop()
        assert len(sent.tokens) == tokens
        assert sent.ends - sent.begins <= 8 * tokens + 64


def test_an_answer_that_cannot_leave_stops_nothing_else() -> None:
    """CHN-018, CHN-020: commits play and silence comes while the link to the controller is stuck."""
    bench = begun()
    bench.core.link_cycles_per_token = 10**9
    bench.bring(Collect(3, ChannelEnd.PLAYING))
    packed = random_slice(RNG)
    bench.run_to(10)
    bench.commit(14, packed)
    for number in range(10):
        bench.bring(Load(3, Memory.SLOTS, number, packed))
    bench.run_to(16)
    assert bench.words(14, 15).any()
    assert bench.core.held_up == 0
    bench.run_to(2100)
    assert not bench.words(2050, 2100).any(), "it is alone"
