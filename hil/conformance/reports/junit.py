"""A run as JUnit XML, as CI systems read it.

Each group is a suite and each case a test. A case that could not be judged, does not apply, or fails as known is
skipped with the reason. JUnit has no warning: such a case passes, and its output says so. A failure has its decisive
evidence and some before it; the output of every case has all of it. Trouble of the run itself is an error in a suite of
its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from xml.etree.ElementTree import Element, indent, tostring

from ..verdicts import Provenance, Result, Run
from .markup import element
from .summary import (
    MOST_EVIDENCE,
    Standing,
    abridged,
    advice,
    groups,
    left_out,
    provenance_rows,
    said,
    standing,
    trail,
    verdict_line,
    why,
)

__all__ = ["junit"]

NAME = "phasewire conformance"
FAILED = (Standing.FAIL, Standing.UNEXPECTED_PASS)
SKIPPED = (Standing.INCONCLUSIVE, Standing.NOT_APPLICABLE, Standing.KNOWN_FAILURE)


def junit(run: Run) -> str:
    """The whole document."""
    suites = [_suite(group, results, run.provenance) for group, results in groups(run).items()]
    interrupted = (f"interrupted by {run.interrupted_by}",) if run.interrupted_by else ()
    if run.trouble or interrupted:
        suites.append(_trouble((*interrupted, *run.trouble)))
    totals = {key: str(sum(int(suite.attrib[key]) for suite in suites)) for key in _numbers(0, 0, 0, 0)}
    whole = element("testsuites", *suites, name=f"{NAME}: {verdict_line(run)}", time=_seconds(run.results), **totals)
    indent(whole)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(whole, encoding="unicode") + "\n"


def _suite(group: str, results: Sequence[Result], provenance: Provenance) -> Element:
    kinds = [standing(result) for result in results]
    failures, skipped = (sum(kind in of for kind in kinds) for of in (FAILED, SKIPPED))
    return element(
        "testsuite",
        _properties(provenance_rows(provenance)),
        *map(_case, results),
        name=group,
        **_numbers(len(results), failures, 0, skipped),
        time=_seconds(results),
        timestamp=provenance.began,
    )


def _case(result: Result) -> Element:
    kind = standing(result)
    about = [("verdict", result.verdict.value), *(("clause", clause) for clause in result.clauses)]
    parts = [_properties(about)]
    if kind is Standing.FAIL:
        parts.append(element("failure", "\n".join(_failure(result)), message=why(result), type=kind.value))
    elif kind is Standing.UNEXPECTED_PASS:
        message = f"expected to fail, and did not: {result.known}"
        parts.append(element("failure", result.sentence, message=message, type=kind.value))
    elif kind is Standing.KNOWN_FAILURE:
        parts.append(element("skipped", message=f"{kind.value}: {result.known}; {why(result)}"))
    elif kind in SKIPPED:
        parts.append(element("skipped", message=f"{kind.value}: {result.reason}"))
    output = [result.sentence, *([why(result)] if result.is_partial else []), *map(said, result.evidence)]
    if kind is Standing.WARN:
        output.insert(0, f"{kind.value}: {result.reason}")
    parts.append(element("system-out", "\n".join(output)))
    _, _, name = result.case.partition("/")
    return element("testcase", *parts, classname=result.group, name=name, time=_seconds([result]))


def _failure(result: Result) -> Iterator[str]:
    """A failure in lines: what was wrong, by which clauses, the decisive evidence, and what came before it."""
    shows = f"shows {', '.join(result.clauses)}"
    yield from filter(None, (why(result), shows, result.sentence, advice(result)))
    *before, last = [said(abridged(item)) for item in trail(result)[-MOST_EVIDENCE:]] or [""]
    if last:
        yield f"Last before the failure:\n{last}"
    if before:
        yield "Before that, in order:\n" + "\n".join(before)
    if note := left_out(result, len(before) + bool(last)):
        yield note


def _trouble(troubles: Sequence[str]) -> Element:
    cases = (
        element("testcase", element("error", message=text, type="trouble"), classname="run", name=text, time="0.000")
        for text in troubles
    )
    return element("testsuite", *cases, name="run", **_numbers(len(troubles), 0, len(troubles), 0), time="0.000")


def _properties(rows: Iterable[tuple[str, str]]) -> Element:
    return element("properties", *(element("property", name=name, value=value) for name, value in rows))


def _numbers(tests: int, failures: int, errors: int, skipped: int) -> dict[str, str]:
    return {"tests": str(tests), "failures": str(failures), "errors": str(errors), "skipped": str(skipped)}


def _seconds(results: Iterable[Result]) -> str:
    return f"{sum(result.seconds for result in results):.3f}"
