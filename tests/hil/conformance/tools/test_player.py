"""The score against a period-by-period reading of chapter BLK, and what a player makes of acknowledgements."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.running import RunOptions, open_bench
from phasewire.hil.conformance.tools.player import block_periods, check_in_time, in_time, is_fast, soon
from phasewire.protocol.codes import AckFlag, Reason, State
from phasewire.protocol.replies import Ack


def ack(commit: int, arrived: int, *, late: bool = False) -> Ack:
    return Ack(Reason.ACCEPTED, 1, commit, 50 * arrived + 49, AckFlag.LATE if late else AckFlag(0), 5, State.READY)


@pytest.mark.parametrize(
    ("acknowledged", "named", "words"),
    [
        (ack(106, 100), 105, "takes effect at period 106"),
        (ack(106, 100, late=True), 105, "reported as late"),
        (ack(103, 100, late=True), 0, "reported as late"),
        (ack(100, 100), 0, "had arrived in period 100"),
    ],
)
def test_what_is_not_in_time_fails(acknowledged: Ack, named: int, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_in_time(acknowledged, named)


@pytest.fixture(name="bench")
def fixture() -> Iterator[Bench]:
    with open_bench(RunOptions("emulator:")) as bench:
        bench.begin_case("a case")
        yield bench


def test_a_slow_line_gets_more_time() -> None:
    with open_bench(RunOptions("emulator:?door=serial")) as bench:
        assert not is_fast(bench)
        assert block_periods(bench) > 521 * 10 * 40_000 / 115_200
        now = bench.period()
        assert soon(bench, 10) > now + 10 * block_periods(bench)


@pytest.mark.parametrize(
    ("raised", "told_late"),
    [(None, Inconclusive), (AssertionError, Inconclusive), (KeyboardInterrupt, KeyboardInterrupt)],
)
def test_what_is_over_too_late_is_inconclusive_unless_a_signal_ended_it(
    bench: Bench, raised: type[BaseException] | None, told_late: type[BaseException]
) -> None:
    def end() -> None:
        if raised is not None:
            raise raised

    with nullcontext() if raised is None else pytest.raises(raised), in_time(bench, bench.period() + 1000):
        end()
    with pytest.raises(told_late), in_time(bench, 0):
        end()
