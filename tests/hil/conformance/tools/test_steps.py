"""Steps of cases: what they build is what SPEC.md prints, and a refusal that changes something fails the case."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.running import Options, open_bench
from phasewire.hil.conformance.tools.steps import (
    Wrong,
    begin,
    check_same,
    cut,
    forge,
    packed,
    raw_records,
    refuse,
    some,
)
from phasewire.protocol.blocks import NoOp
from phasewire.protocol.codes import Reason


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench(Options("emulator:")) as bench:
        bench.begin_case("a case")
        yield bench


def test_pulses_are_packed_as_the_specification_shows() -> None:
    """The example of clause PUL-005, and the second half of the last three bytes."""
    assert packed([(99, 25), (1, 2)])[:4].hex(" ") == "e3 1c 10 00"
    assert packed([(0, 0)] * 319 + [(127, 31)])[-3:].hex(" ") == "00 f0 ff"


def test_records_are_cut_by_their_magic() -> None:
    acknowledgement, status = b"PA".ljust(32, b"\1"), b"PS".ljust(64, b"\2")
    assert cut(acknowledgement + status + acknowledgement) == [acknowledgement, status, acknowledgement]
    assert cut(status[:40]) == [status[:40]]


def test_each_block_has_its_raw_record(bench: Bench) -> None:
    blocks = [forge(bench, NoOp()) for _ in range(40)]
    assert [record[4:8] for record in raw_records(bench, blocks)] == [block[4:8] for block in blocks]


def test_all_go_over_usb(bench: Bench) -> None:
    assert some(bench, range(100)) == list(range(100))


def test_a_refusal_for_its_reason_passes(bench: Bench) -> None:
    begin(bench)
    refuse(bench, [Wrong("kind 10", forge(bench, NoOp(), kind=10), Reason.KIND)] * 3)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": 10}, "the reason for a block is KIND, should be FIELD"),
        ({}, "the reason for a block is ACCEPTED, should be FIELD"),
    ],
)
def test_another_outcome_fails(bench: Bench, fields: dict[str, int], message: str) -> None:
    begin(bench)
    with pytest.raises(AssertionError, match=message):
        refuse(bench, [Wrong("a block", forge(bench, NoOp(), **fields), Reason.FIELD)])


def test_a_status_that_changed_fails_unless_it_was_said(bench: Bench) -> None:
    before = bench.status()
    bench.must(NoOp())
    after = bench.status()
    check_same(before, after, accepted=before.accepted + 1)
    with pytest.raises(AssertionError, match="accepted in STATUS is 1, should be 0"):
        check_same(before, after)
