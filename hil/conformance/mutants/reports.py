"""Results of the mutants: progress while they run, a table, and a JSON record."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from ..reports.markup import legible
from ..reports.terminal import StatusLine
from .running import Fate, MutantResult, MutantWatcher

__all__ = ["FORMAT", "MutantLine", "markdown", "print_mutants", "record"]

FORMAT = "phasewire-mutants-1"
STYLES = {
    Fate.SURVIVED: "bold red",
    Fate.CRASHED: "bold red",
    Fate.HUNG: "bold red",
    Fate.ONE_CASE: "yellow",
    Fate.CAUGHT: "green",
}
MOST_CASES = 2
"""How many cases the table names for a mutant; the record has all."""


class MutantLine(StatusLine, MutantWatcher):
    """Prints progress: on a terminal the mutants that run, and everywhere those that were not caught."""

    def goes_on(self, mutants: Sequence[str], ended: int, of: int) -> None:
        """These mutants run now, and ``ended`` of all have ended."""
        self._show(", ".join(mutants), ended, of)

    def ended(self, result: MutantResult) -> None:
        """A mutant has ended."""
        if not result.fate.is_catch:
            self._keep(_headed(result))


def print_mutants(out: Console, results: Sequence[MutantResult]) -> None:
    """Print the results of all mutants, group by group, and a summary."""
    out.print(_table(results))
    missed = [result for result in results if not result.fate.is_catch]
    for result in missed:
        out.print(_headed(result))
        out.print(Text(f"    {result.mutant.sentence}"))
    style = STYLES[Fate.SURVIVED if missed else Fate.CAUGHT]
    out.print(Text(f"{'FAIL' if missed else 'PASS'}: {_verdict(results)}", style))


def _headed(result: MutantResult) -> Text:
    """The fate of a mutant, its name, and the reason."""
    why = f": {legible(' '.join(result.why.split()))}" if result.why else ""
    name = f"{result.mutant.group}/{result.mutant.name}"
    return Text.assemble((result.fate.value, STYLES[result.fate]), "  ", (name, "bold"), why)


def _table(results: Sequence[MutantResult]) -> Table:
    """A row for each mutant, sorted by their groups."""
    number = Column("cases", justify="right", no_wrap=True)
    table = Table("group", "mutant", "came to", number, "which", box=box.SIMPLE_HEAD, pad_edge=False)
    for group, members in _by_group(results).items():
        for index, result in enumerate(members):
            first, rest = result.cases[:MOST_CASES], result.cases[MOST_CASES:]
            table.add_row(
                "" if index else group,
                result.mutant.name,
                Text(result.fate.value, STYLES[result.fate]),
                str(len(result.cases)),
                legible(", ".join(chain(first, ["…"] if rest else []))),
                end_section=result is members[-1],
            )
    return table


def _by_group(results: Sequence[MutantResult]) -> dict[str, list[MutantResult]]:
    groups = sorted({result.mutant.group for result in results})
    return {group: [result for result in results if result.mutant.group == group] for group in groups}


def _counts(results: Sequence[MutantResult]) -> dict[str, int]:
    fates = [result.fate for result in results]
    return {fate.value: fates.count(fate) for fate in Fate}


def markdown(results: Sequence[MutantResult]) -> str:
    """The mutants as a document: for each group a table of the mistakes and the first cases that caught them."""
    lines = [
        "# Mutants",
        "",
        "Emulators that are broken in one way each, and the cases of the conformance suite that caught them:",
        f"{_verdict(results)}. Cases that show a mutant's clauses and those of its group are",
        "tried first, and others only if none of these has caught it; *alone* marks the only one of these that has.",
        "`phasewire conformance --mutants --table FILE` writes this file, `--mutant NAME` shows the report of one.",
        "The next run begins with the cases that this file names: without the file it searches anew.",
    ]
    for group, members in _by_group(results).items():
        lines += ["", f"## {group}", "", "| mutant | what it does wrong | clauses | caught by |", "|---|---|---|---|"]
        lines += [_row(result) for result in members]
    return "\n".join(lines) + "\n"


def _row(result: MutantResult) -> str:
    named = [f"`{case}`" for case in result.cases[:MOST_CASES]]
    alone = " *alone*" if result.fate is Fate.ONE_CASE else ""
    caught = "<br>".join(named) + alone if result.fate.is_catch else f"**{result.fate}**"
    mutant = result.mutant
    return f"| `{mutant.name}` | {mutant.sentence.replace('|', '∣')} | {', '.join(mutant.clauses)} | {caught} |"


def _verdict(results: Sequence[MutantResult]) -> str:
    """How many there are, and how many got away."""
    missed = sum(not result.fate.is_catch for result in results)
    counts = ", ".join(f"{count} {fate}" for fate, count in _counts(results).items() if count)
    return f"{missed or 'none'} of {len(results)} got away ({counts})"


def record(results: Sequence[MutantResult]) -> dict[str, Any]:
    """All results as JSON; the order of the keys is always the same."""
    return {
        "format": FORMAT,
        "passed": all(result.fate.is_catch for result in results),
        "counts": _counts(results),
        "mutants": [_entry(result) for members in _by_group(results).values() for result in members],
    }


def _entry(result: MutantResult) -> dict[str, Any]:
    return {
        "name": result.mutant.name,
        "group": result.mutant.group,
        "clauses": list(result.mutant.clauses),
        "url": result.mutant.url,
        "sentence": result.mutant.sentence,
        "fate": result.fate.value,
        "caught": result.fate.is_catch,
        "cases": list(result.cases),
        "why": result.why,
        "seconds": result.seconds,
    }
