"""The line that sums a run up, and what it may never promise."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement
from signal import SIGINT, SIGTERM

import pytest
from phasewire.hil.conformance.reports.summary import (
    RunOutcome,
    outcome,
    rolled_up,
    verdict_line,
    why,
)
from phasewire.hil.conformance.verdicts import Result, Run, Verdict

from tests.hil.conformance.hand_made_runs import CLEAN, EVERY, PROVENANCE


def run(*verdicts: Verdict, known: str | None = None, trouble: tuple[str, ...] = ()) -> Run:
    results = (Result(f"a/{number}", ("BLK-003",), "", verdict, known=known) for number, verdict in enumerate(verdicts))
    return Run(PROVENANCE, tuple(results), trouble)


PASS, FAIL, WARN, OPEN, NONE = Verdict


def test_a_failure_says_which_of_its_clauses_are_newer_than_the_first_revision() -> None:
    clauses = ("SER-010/1", "SER-010", "BLK-003", "FWU-020/3")
    told = "SER-010 changed in revision 2; FWU-020 changed in revision 2; FWU-020 changed in revision 3"
    assert why(Result("a/b", clauses, "", FAIL, "it is so")) == f"failed 1 of 1: it is so; {told}"
    assert why(Result("a/b", clauses, "", OPEN, "it is so")) == "it is so"
    assert why(Result("a/b", ("BLK-003",), "", FAIL, "it is so")) == "failed 1 of 1: it is so"


@pytest.mark.parametrize(
    ("found", "line", "came"),
    [
        (EVERY, "FAIL: 2 of 9 cases broke, 1 passed, 1 warned, 1 failed as known, "
         "3 could not be judged here, 1 did not apply", RunOutcome.FAIL),
        (CLEAN, "PASS: nothing broke; the only case that ran passed", RunOutcome.PASS),
        (run(PASS, PASS), "PASS: nothing broke; all 2 cases that ran passed", RunOutcome.PASS),
        (run(PASS, PASS, OPEN), "PASS: nothing broke; 2 cases passed, 1 could not be judged here", RunOutcome.PART),
        (run(PASS, WARN), "PASS: nothing broke; 1 case passed, 1 warned", RunOutcome.PART),
        (run(PASS, NONE), "PASS: nothing broke; 1 case passed, 1 did not apply", RunOutcome.PASS),
        (run(PASS, FAIL), "FAIL: 1 of 2 cases broke, 1 passed", RunOutcome.FAIL),
        (run(FAIL, known="x"), "NOTHING SHOWN: nothing broke, and no case passed, 1 failed as known",
         RunOutcome.PART),
        (run(PASS, known="x"), "FAIL: 1 of 1 case broke", RunOutcome.FAIL),
        (run(OPEN), "NOTHING SHOWN: nothing broke, and no case passed, 1 could not be judged here", RunOutcome.PART),
        (run(NONE), "NOTHING SHOWN: nothing broke, and no case passed, 1 did not apply", RunOutcome.PART),
        (run(), "NOTHING SHOWN: nothing broke, and no case passed", RunOutcome.PART),
        (Run(PROVENANCE, (replace(EVERY.results[1], again=PASS), EVERY.results[0])),
         "FAIL: 1 of 2 cases broke (1 of them failed 1 of 2), 1 passed", RunOutcome.FAIL),
        (replace(EVERY, signal=SIGINT), "INTERRUPTED by Ctrl-C: 2 of 9 cases broke so far, 1 passed, 1 warned, "
         "1 failed as known, 3 could not be judged here, 1 did not apply", RunOutcome.FAIL),
        (replace(run(PASS, OPEN), signal=SIGTERM), "INTERRUPTED by SIGTERM: nothing broke so far, 1 passed, "
         "1 could not be judged here", RunOutcome.FAIL),
        (run(PASS, trouble=("x",)), "FAIL: no case broke, but the run itself is not in order, 1 passed",
         RunOutcome.FAIL),
    ],
)  # fmt: skip
def test_a_run_is_summed_up_in_a_line(found: Run, line: str, came: RunOutcome) -> None:
    assert (verdict_line(found), outcome(found)) == (line, came)


def test_inconclusive_results_are_always_counted_and_never_a_whole_pass() -> None:
    for others in combinations_with_replacement(Verdict, 3):
        for known in (None, "x"):
            found = run(OPEN, *others, known=known)
            assert f"{found.count(OPEN)} could not be judged here" in verdict_line(found)
            assert "conform" not in verdict_line(found)
            assert outcome(found) is not RunOutcome.PASS


def test_the_line_and_the_outcome_agree_with_the_run() -> None:
    for verdicts in combinations_with_replacement(Verdict, 3):
        for known in (None, "x"):
            found = run(*verdicts, known=known)
            assert verdict_line(found).startswith("FAIL") == (not found.passed) == (outcome(found) is RunOutcome.FAIL)


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ([], None),
        ([PASS, FAIL, OPEN], FAIL),
        ([PASS, WARN, OPEN], WARN),
        ([PASS, OPEN, NONE], PASS),
        ([OPEN, NONE], OPEN),
        ([OPEN, OPEN], OPEN),
        ([NONE, PASS], PASS),
        ([NONE], NONE),
    ],
)
def test_a_clause_is_inconclusive_only_if_all_its_cases_are(verdicts: list[Verdict], expected: Verdict | None) -> None:
    assert rolled_up(verdicts) is expected
