"""How many of its values a case tries: by the measured speed of the line, and never without saying so."""

from __future__ import annotations

from dataclasses import replace

import pytest
from phasewire.hil.conformance.reports.junit import junit
from phasewire.hil.conformance.reports.page import page
from phasewire.hil.conformance.reports.records import record
from phasewire.hil.conformance.reports.summary import verdict_line
from phasewire.hil.conformance.running import RunOptions, open_bench, run_conformance
from phasewire.hil.conformance.tools.steps import some
from phasewire.hil.conformance.verdicts import Verdict

from tests.hil.conformance.hand_made_runs import CLEAN, MATRIX

pytestmark = pytest.mark.slow  # each is a run of the suite

KINDS = ("blocks/an-unknown-kind-is-refused",)


@pytest.mark.parametrize(
    ("url", "tried"),
    [("emulator:", None), ("emulator:?door=serial&baud=1000000", None), ("emulator:?door=serial", 247)],
)
def test_the_measured_speed_of_the_line_decides(url: str, tried: int | None) -> None:
    """A fast serial line tries all kinds of blocks, a slow one as many as its time allows."""
    (result,) = run_conformance(RunOptions(url, only=KINDS, groups=("blocks",))).results
    assert result.verdict is Verdict.PASS
    assert (result.tried and result.tried[1]) == tried
    assert result.tried is None or 20 < result.tried[0] < 60


def test_the_extremes_are_always_tried_and_the_time_is_that_of_the_case() -> None:
    with open_bench(RunOptions("emulator:")) as bench:
        bench.begin_case("a")
        bench.block_seconds = 0.1
        first, second = some(bench, range(100), 4), some(bench, range(100), 4)
        assert (len(first), first[0], first[-1]) == (20, 0, 99)
        assert (len(second), second[0], second[-1]) == (4, 0, 99)
        assert bench.tried == [24, 200]
        bench.begin_case("a")
        assert some(bench, range(100), 4) == first


def test_every_report_says_that_a_pass_tried_only_a_part() -> None:
    run = replace(
        CLEAN, results=(replace(CLEAN.results[0], tried=(6, 247)), replace(CLEAN.results[0], case="blocks/b"))
    )
    assert verdict_line(run).endswith(", 1 pass tried only a part")
    said = "only 6 of 247 values were tried, for the line is slow"
    assert said in junit(run)
    assert said in page(run, MATRIX)
    told = record(run, MATRIX)
    assert [result["tried"] for result in told["results"]] == [{"values": 6, "of": 247}, None]
    assert told["counts"]["partial pass"] == 1
