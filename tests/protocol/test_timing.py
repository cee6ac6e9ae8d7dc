"""The timing model against sums done by hand and the specification's tables."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import pytest
from phasewire.protocol import chain
from phasewire.protocol.chain import Message
from phasewire.protocol.codes import ChannelEnd, Memory
from phasewire.protocol.timing import (
    FIVE_WIRE,
    LINKS,
    MODULATE_CYCLES,
    PROCESSOR_MEMORY,
    PROCESSOR_MEMORY_BYTES,
    RASTERISE_CYCLES,
    TWO_WIRE,
    Budget,
    Link,
    block_loads,
    slices_cycles,
    update_cycles,
)

from tests.specification import codes, table

CYCLES_PER_MICROSECOND = 400


def microseconds(cell: str) -> Fraction:
    return Fraction(cell.removesuffix(" µs"))


@pytest.mark.parametrize(("link", "megabytes_per_second"), [(FIVE_WIRE, 50), (TWO_WIRE, 20)])
def test_links_have_the_hardware_s_rates(link: Link, megabytes_per_second: float) -> None:
    assert CYCLES_PER_MICROSECOND / link.cycles_per_token == megabytes_per_second


@pytest.mark.parametrize(("link", "slices", "update"), [(FIVE_WIRE, 10.4, 13.6), (TWO_WIRE, 26.0, 34.0)])
def test_an_update_takes_the_time_calculated_for_the_hardware(link: Link, slices: float, update: float) -> None:
    assert slices_cycles(link) / CYCLES_PER_MICROSECOND == slices
    assert update_cycles(link) / CYCLES_PER_MICROSECOND == update


def test_message_times_are_the_specification_s() -> None:
    rows = table("table: message times")
    assert [row[1].strip("`") for row in rows] == [end.name for end in ChannelEnd]
    for tokens, name, five, two in rows:
        kind: type[Message] = getattr(chain, name.strip("`").capitalize())
        assert int(tokens) == kind.TOKENS
        assert microseconds(five) == int(tokens) * Fraction("0.02")
        assert microseconds(two) == int(tokens) * Fraction("0.05")


@pytest.mark.parametrize(("link", "column"), [(FIVE_WIRE, 0), (TWO_WIRE, 2)])
def test_the_stages_are_the_specification_s(link: Link, column: int) -> None:
    rows = table("table: stages")
    found = Budget.of(link)
    assert [(row[1].strip("`"), int(row[column])) for row in rows] == [(s.name, s.cycles) for s in found.stages]
    assert all(before.ends == after.begins for before, after in pairwise(found.stages))
    assert found.stages[0].begins == 0


@pytest.mark.parametrize(("link", "best", "worst"), [(FIVE_WIRE, "52.715", "77.7125"), (TWO_WIRE, "73.115", "98.1125")])
def test_the_times_from_first_bit_to_first_tick(link: Link, best: str, worst: str) -> None:
    found = Budget.of(link)
    assert Fraction(found.best_cycles, 400) == Fraction(best)
    assert Fraction(found.worst_cycles, 400) == Fraction(worst)


@pytest.mark.parametrize(
    ("link", "bottleneck", "periods", "rate"), [(FIVE_WIRE, "boundary", 1, 40_000), (TWO_WIRE, "links", 2, 20_000)]
)
def test_only_five_wires_hold_an_update_in_every_period(link: Link, bottleneck: str, periods: int, rate: int) -> None:
    found = Budget.of(link)
    assert (found.bottleneck.name, found.periods_per_update) == (bottleneck, periods)
    assert found.updates_per_second == rate


@pytest.mark.parametrize(
    ("delay", "periods"),
    [
        (6, 1),  # 14 cycles: 9520 for 680 tokens
        (7, 2),  # 15 cycles: 10 200
        (21, 2),  # 29 cycles: 19 720
        (22, 3),  # 30 cycles: 20 400
    ],
)
def test_the_rate_that_holds_is_one_in_whole_periods(delay: int, periods: int) -> None:
    found = Budget.of(Link("5wire", 5, 4, token_delay=delay))
    assert (found.periods_per_update, found.updates_per_second) == (periods, Fraction(40_000, periods))


@pytest.mark.parametrize(("hop", "periods"), [(432, 1), (433, 2)])
def test_a_table_that_waits_must_play_before_the_next_commit(hop: int, periods: int) -> None:
    """160 tokens of 8 cycles, ten hops and 4400 cycles: 10 000 with hops of 432."""
    found = Budget.of(FIVE_WIRE, hop_cycles=hop)
    assert found.stages[-1].updates_per_second == Fraction(40_000, periods)
    assert found.periods_per_update == periods


@pytest.mark.parametrize("baud", [115_200, 921_600, 3_000_000, 12_000_000])
def test_serial_rates_are_the_specification_s(baud: int) -> None:
    (row,) = [row for row in table("table: serial rates") if int(row[0]) == baud]
    found = Budget.of(FIVE_WIRE, baud=baud)
    assert round(found.stages[0].cycles / 400) == int(row[1]) == round(5210 / baud * 1e6)
    assert found.periods_per_update == int(row[2])
    assert found.bottleneck.name == found.stages[0].name == "serial"
    assert 0 <= found.stages[0].cycles - 5210 * 400e6 / baud < 1
    assert found.best_cycles - Budget.of(FIVE_WIRE).best_cycles == found.stages[0].cycles - 3846


def test_block_costs_are_the_specification_s() -> None:
    blocks = {"SLOT": (1, Memory.SLOTS), "ENTRIES": (120, Memory.ENTRIES), "SAMPLES": (480, Memory.SAMPLES)}
    rows = table("table: block costs")
    assert [row[1].strip("`") for row in rows] == list(blocks)
    for loads, name, tokens, *times in rows:
        assert block_loads(*blocks[name.strip("`")]) == int(loads)
        assert int(tokens) == 60 * int(loads)
        assert [microseconds(cell) for cell in times[:2]] == [Fraction(int(tokens), 50), Fraction(int(tokens), 20)]
        periods = [Budget.of(link).periods_for(int(loads)) for link in (FIVE_WIRE, TWO_WIRE)]
        assert [f"{count} periods" for count in periods] == times[2:]
    assert block_loads(1, Memory.SAMPLES) == block_loads(48, Memory.SAMPLES) == 10
    assert block_loads(49, Memory.SAMPLES) == 20


def test_loads_that_fit_beside_updates() -> None:
    """1250 tokens in a period of a 5-wire link, less 680; 1000 in two periods of a 2-wire one: 570 and 320."""
    assert [Budget.of(link).spare_loads for link in (FIVE_WIRE, TWO_WIRE)] == [9, 5]
    full = Budget.of(Link("5wire", 5, 4, token_delay=6))  # 480 cycles are left, a load takes 840
    assert (full.spare_loads, full.periods_for(10)) == (0, None)


def test_the_threads_are_the_specification_s() -> None:
    rows = [(row[1].strip("`"), int(row[0]), int(row[2])) for row in table("table: threads")]
    assert rows == [(f"{t.where}: {t.name}", t.cycles, t.available) for t in Budget.of(FIVE_WIRE).threads]


@pytest.mark.parametrize("link", [*LINKS.values(), Link("slow", 5, 4, 3), Link("slower", 2, 10, 2047, 2047)])
def test_every_thread_keeps_up(link: Link) -> None:
    found = Budget.of(link)
    assert all(0 < threads.cycles <= threads.available for threads in found.threads)
    for where in ("controller", "processor"):
        assert 4 <= sum(threads.threads for threads in found.threads if threads.where == where) <= 8


def test_rasterising_with_modulation_still_fits_a_period() -> None:
    assert RASTERISE_CYCLES + MODULATE_CYCLES == 5424
    assert 160 * 20 + 400 + 5424 < 10_000  # commits on two wires, hops


def test_the_memory_of_a_processor_is_the_specification_s_and_suffices() -> None:
    assert codes("PROCESSOR_MEMORY") == PROCESSOR_MEMORY
    assert sum(PROCESSOR_MEMORY.values()) <= PROCESSOR_MEMORY_BYTES == 64 * 1024


@pytest.mark.parametrize(("begins", "period"), [(0, 3), (8_914, 3), (8_915, 4), (18_914, 4), (10**12, 10**8 + 3)])
def test_an_update_plays_at_the_first_boundary_that_it_reaches(begins: int, period: int) -> None:
    """The way takes 20 086 cycles; period 3 begins at 30 000."""
    assert Budget.of(FIVE_WIRE).first_period(begins) == period


def test_an_error_names_an_impossible_value() -> None:
    for changes, complaint in (
        ({"cycles_per_symbol": 1}, "a symbol in 1 core cycles; 2 to 2047"),
        ({"cycles_per_symbol": 2048}, "a symbol in 2048 core cycles"),
        ({"token_delay": -1}, "wait -1 core cycles"),
        ({"token_delay": 2048}, "wait 2048 core cycles"),
    ):
        with pytest.raises(ValueError, match=complaint):
            Link("5wire", 5, 4, **changes)
    with pytest.raises(ValueError, match="delay by -1 core cycles"):
        Budget.of(FIVE_WIRE, hop_cycles=-1)
    with pytest.raises(ValueError, match="0 baud"):
        Budget.of(FIVE_WIRE, baud=0)
