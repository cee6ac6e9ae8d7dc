"""A run as a JSON record for programs: its format is ``phasewire-conformance-1``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from ..matrix import Matrix
from ..verdicts import Result, Run, Verdict
from .summary import Standing, outcome, rolled_up, standing, verdict_line

__all__ = ["FORMAT", "record"]

FORMAT = "phasewire-conformance-1"


def record(run: Run, matrix: Matrix) -> dict[str, Any]:
    """All of a run as JSON; the order of the keys is always the same.

    Returns
    -------
    dict
        ``outcome`` is ``fail``, ``pass``, or ``part`` if nothing broke but not all was shown; an interrupted run is
        ``fail``. ``counts`` has each verdict, and in addition what was expected. A row of the matrix has the
        verdict of its cases together (`rolled_up`); null if none of them ran.
    """
    verdicts = {result.case: result.verdict for result in run.results}
    standings = [standing(result) for result in run.results]
    expected = (Standing.KNOWN_FAILURE, Standing.UNEXPECTED_PASS)
    return {
        "format": FORMAT,
        "outcome": outcome(run).value,
        "passed": run.passed,
        "summary": verdict_line(run),
        "interrupted by": run.interrupted_by or None,
        "provenance": asdict(run.provenance),
        "counts": {verdict.value: run.count(verdict) for verdict in Verdict}
        | {kind.value: standings.count(kind) for kind in expected}
        | {"partial pass": sum(result.is_partial for result in run.results)},
        "trouble": list(run.trouble),
        "results": [_result(result) for result in run.results],
        "matrix": _matrix(matrix, verdicts),
    }


def _result(result: Result) -> dict[str, Any]:
    return {
        "case": result.case,
        "group": result.group,
        "clauses": list(result.clauses),
        "sentence": result.sentence,
        "verdict": result.verdict.value,
        "standing": standing(result).value,
        "breaks": result.breaks,
        "reason": result.reason,
        "tally": result.tally,
        "changed": list(result.changed),
        "again": result.again,
        "fresh": result.fresh,
        "run again": result.run_again or None,
        "tried": None if result.tried is None else dict(zip(("values", "of"), result.tried, strict=True)),
        "known": result.known,
        "seconds": result.seconds,
        "evidence": [asdict(item) for item in result.evidence],
    }


def _matrix(matrix: Matrix, verdicts: Mapping[str, Verdict]) -> dict[str, Any]:
    """The matrix's own record, with the results of the cases in each row."""
    found = matrix.record()
    for chapter in found["chapters"]:
        for clause in chapter["clauses"]:
            for row in clause["rows"]:
                row["verdict"] = rolled_up(verdicts[case] for case in row["cases"] if case in verdicts)
    return found
