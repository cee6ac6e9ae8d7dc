"""What every report says of a run: the standing of each result, their counts, and the summary line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from enum import StrEnum

from ..verdicts import Evidence, Provenance, Result, Run, Verdict

__all__ = [
    "RunOutcome",
    "Standing",
    "abridged",
    "advice",
    "by_reason",
    "groups",
    "left_out",
    "outcome",
    "provenance_rows",
    "rolled_up",
    "said",
    "standing",
    "trail",
    "verdict_line",
    "why",
]


MOST_EVIDENCE, MOST_CHARACTERS = 8, 400
"""Pieces of evidence, and characters of each, in a report that is read line by line; JSON holds all."""
DECODED_CHARACTERS = 95
"""The same of bytes whose meaning is told: 32 of them, a record or the header of a block."""
ONCE_OF_TWICE = "failed 1 of 2"
_NUMBER = re.compile(r"\d[\d.,]*")


class Standing(StrEnum):
    """The standing of a result in view of what was expected; in the order of reports."""

    FAIL = "fail"
    UNEXPECTED_PASS = "unexpected pass"
    WARN = "warn"
    KNOWN_FAILURE = "known failure"
    INCONCLUSIVE = "inconclusive"
    NOT_APPLICABLE = "not applicable"
    PASS = "pass"


class RunOutcome(StrEnum):
    """The outcome of a run as a whole."""

    FAIL = "fail"
    """Something broke."""
    PART = "part"
    """Nothing broke, but not everything was shown."""
    PASS = "pass"
    """Everything was shown."""


def standing(result: Result) -> Standing:
    """The standing of a result."""
    if result.known is not None and result.verdict is Verdict.FAIL:
        return Standing.KNOWN_FAILURE
    if result.known is not None and result.breaks:
        return Standing.UNEXPECTED_PASS
    return Standing(result.verdict.value)


def outcome(run: Run) -> RunOutcome:
    """The outcome of a run; one with an inconclusive result, or without a pass, is no whole pass."""
    if not run.passed:
        return RunOutcome.FAIL
    clean = {Standing.PASS, Standing.NOT_APPLICABLE}
    whole = run.count(Verdict.PASS) and all(standing(result) in clean for result in run.results)
    return RunOutcome.PASS if whole else RunOutcome.PART


def verdict_line(run: Run) -> str:
    """A run in one line; it claims no more than was seen."""
    standings = [standing(result) for result in run.results]
    passed, of = standings.count(Standing.PASS), len(standings)
    broken = sum(result.breaks for result in run.results)
    also = [f"{passed} passed"] if passed else []
    once = sum(result.breaks and result.tally == ONCE_OF_TWICE for result in run.results)
    often = f" ({once} of them {ONCE_OF_TWICE})" if once else ""
    if run.interrupted_by:
        so_far = f"{broken} of {_cases(of)} broke{often}" if broken else "nothing broke"
        said = [f"INTERRUPTED by {run.interrupted_by}: {so_far} so far", *also]
    elif broken:
        said = [f"FAIL: {broken} of {_cases(of)} broke{often}", *also]
    elif run.trouble:
        said = ["FAIL: no case broke, but the run itself is not in order", *also]
    elif not passed:
        said = ["NOTHING SHOWN: nothing broke, and no case passed"]
    elif passed == of:
        said = [f"PASS: nothing broke; {'the only case' if of == 1 else f'all {_cases(of)}'} that ran passed"]
    else:
        said = [f"PASS: nothing broke; {_cases(passed)} passed"]
    others = (
        (Standing.WARN, "warned"),
        (Standing.KNOWN_FAILURE, "failed as known"),
        (Standing.INCONCLUSIVE, "could not be judged here"),
        (Standing.NOT_APPLICABLE, "did not apply"),
    )
    said += [f"{standings.count(kind)} {words}" for kind, words in others if kind in standings]
    if partial := sum(result.is_partial for result in run.results):
        said.append(f"{partial} {'pass' if partial == 1 else 'passes'} tried only a part")
    return ", ".join(said)


def _cases(number: int) -> str:
    return "1 case" if number == 1 else f"{number} cases"


def why(result: Result) -> str:
    """The reason of a case's verdict; for a failure how often and what is newer, for some passes what was tried."""
    part = "only {} of {} values were tried, for the line is slow".format(*result.tried) if result.tried else ""
    told = ": ".join(filter(None, (result.tally, result.reason or part)))
    return "; ".join(filter(None, (told, *result.changed)))


def advice(result: Result) -> str:
    """How to see a failure again; empty for any other result."""
    if not result.run_again:
        return ""
    if result.fresh and result.again is Verdict.FAIL:
        told = "it failed again after a restart"
    elif result.fresh:
        told = "it did not fail after a restart, so it may need what ran before it"
    else:
        told = "the device was not restarted in between, so it may need what ran before it"
    return f"Run again with {result.run_again}: {told}"


def trail(result: Result) -> tuple[Evidence, ...]:
    """The evidence up to the failure, with the decisive piece last; clean-up is left out."""
    return tuple(item for item in result.evidence if not item.after)


def left_out(result: Result, shown: int) -> str:
    """A note of the evidence that a report leaves out, if it shows so many pieces of the trail; empty if it is none."""
    before = len(trail(result)) - shown
    after = len(result.evidence) - len(trail(result))
    parts = [f"{before} before these" if shown else str(before)] * (before > 0) + [f"{after} after the end"] * (
        after > 0
    )
    return f"… and {' and '.join(parts)}, in --json" if parts else ""


def said(item: Evidence) -> str:
    """A piece of evidence in lines: first what its bytes mean, then the bytes."""
    if not item.meaning:
        return f"{item.label}: {item.text}"
    is_named = item.label in item.meaning.partition(":")[0]  # as a block, or CLOCK in the answer to that request
    label = "" if is_named else f"{item.label}:" + ("\n" if "\n" in item.meaning else " ")
    return f"{label}{item.meaning}\n    {item.text}"


def abridged(item: Evidence, most: int = MOST_CHARACTERS, most_decoded: int = DECODED_CHARACTERS) -> Evidence:
    """A piece of evidence; a long text is cut, with a note of its length, and sooner if its meaning is told."""
    text = _cut(item.text, most_decoded if item.meaning else most)
    return replace(item, text=text, meaning=_cut(item.meaning, most))


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[:most]}… ({len(text)} characters)"


def groups(run: Run) -> dict[str, list[Result]]:
    """The results of each group, in the order of the run."""
    found: dict[str, list[Result]] = {}
    for result in run.results:
        found.setdefault(result.group, []).append(result)
    return found


def by_reason(results: Iterable[Result]) -> dict[str, list[Result]]:
    """Results by reason, the most frequent first; reasons that differ only in numbers are one."""
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(_NUMBER.sub("", result.reason), []).append(result)
    largest = sorted(found.values(), key=len, reverse=True)
    return {_in_common(members): members for members in largest}


def _in_common(results: Sequence[Result]) -> str:
    """A reason for all of them: the first one's, with a note if the numbers of others differ."""
    first = results[0].reason
    return first if all(result.reason == first for result in results) else f"{first} (others: other numbers)"


def rolled_up(verdicts: Iterable[Verdict]) -> Verdict | None:
    """The verdict of a clause from those of its cases; None if there is none.

    It fails if one case fails. Otherwise it warns if one warns, passes if one passes, and is inconclusive only if no
    case that applies could be judged.
    """
    found = set(verdicts)
    order = (Verdict.FAIL, Verdict.WARN, Verdict.PASS, Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE)
    return next((verdict for verdict in order if verdict in found), None)


def provenance_rows(provenance: Provenance) -> Iterator[tuple[str, str]]:
    """Who tested what, when, and with what: names and values, in order."""
    yield from provenance.device.items()
    yield "suite", f"phasewire {provenance.suite}"
    yield "specification", provenance.specification
    yield "began", provenance.began
    yield "took", f"{provenance.seconds:.1f} s"
    yield "profile", provenance.profile
    yield "capture", provenance.capture
    yield "levers", ", ".join(provenance.levers) or "none"
    yield "allowed", ", ".join(provenance.allowed) or "nothing"
    yield "seed", str(provenance.seed)
    yield "computer", _computer(provenance)


def _computer(provenance: Provenance) -> str:
    """The computer that ran the suite, and its load."""
    cores = f"{provenance.cores} {'core' if provenance.cores == 1 else 'cores'}"
    if provenance.load is None:
        return cores
    began, ended = provenance.load
    return f"{cores}, load average {began:g} at the beginning and {ended:g} at the end"
