"""A run on a terminal: first the current case, then all results.

If the output is no terminal, nothing is erased.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Self

from rich import box
from rich.console import Console
from rich.control import Control
from rich.padding import Padding
from rich.segment import ControlType
from rich.table import Column, Table
from rich.text import Text

from ..plugin import Watcher
from ..verdicts import Result, Run, Verdict
from .markup import legible
from .summary import (
    MOST_EVIDENCE,
    RunOutcome,
    Standing,
    abridged,
    advice,
    by_reason,
    groups,
    left_out,
    outcome,
    provenance_rows,
    said,
    standing,
    trail,
    verdict_line,
    why,
)

__all__ = ["LiveLine", "StatusLine", "print_run"]

INDENT = 4
STYLES = {
    Standing.FAIL: "bold red",
    Standing.UNEXPECTED_PASS: "bold red",
    Standing.WARN: "yellow",
    Standing.KNOWN_FAILURE: "magenta",
    Standing.INCONCLUSIVE: "cyan",
    Standing.NOT_APPLICABLE: "dim",
    Standing.PASS: "green",
}
OUTCOME_STYLES = {RunOutcome.FAIL: "bold red", RunOutcome.PART: "bold yellow", RunOutcome.PASS: "bold green"}


class StatusLine:
    """A status line on a terminal, between lines that stay.

    It is a context manager, at the end of which the line is erased. Without a terminal there is none.
    """

    def __init__(self, console: Console) -> None:
        self._console = console

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._erase()

    def _show(self, text: str, number: int, of: int) -> None:
        """Show the current activity, and its number of how many."""
        if not self._console.is_terminal:
            return
        self._erase()
        line = Text(f"{number:{len(str(of))}}/{of}  {legible(text)}")
        line.truncate(self._console.width - 1, overflow="ellipsis")
        self._console.print(line, end="")

    def _keep(self, line: Text) -> None:
        """Print a line that stays."""
        self._erase()
        self._console.print(line)

    def _erase(self) -> None:
        self._console.control(Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2)))


class LiveLine(StatusLine, Watcher):
    """Prints progress: failures, on a terminal the current case, elsewhere the groups that are done."""

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._group: list[Result] = []
        self._done = self._of = 0

    def began(self, case: str, number: int, of: int) -> None:
        """A case begins: its number, from 1, and how many there are."""
        if self._group and case.partition("/")[0] != self._group[0].group:
            self._tell_group()
        if number == 1:
            self._done = 0  # the recording is judged after the run, and counted from 1 again
        self._of = of
        self._show(case, number, of)

    def ended(self, result: Result) -> None:
        """A case has come to a verdict."""
        self._erase()
        self._done += 1
        self._group.append(result)
        if result.breaks:
            reason = " ".join(legible(why(result)).split())
            self._keep(_headed(result).append(f": {reason}" if reason else ""))

    def waits(self, what: str) -> None:
        """Somebody must do something before the run can go on."""
        if self._group:
            self._tell_group()
        self._keep(Text(f"Now: {legible(what)}", "bold"))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, traceback)
        if self._group:
            self._tell_group()

    def _tell_group(self) -> None:
        """If the output is no terminal: the results of a group, and how many cases are done."""
        verdicts = [result.verdict for result in self._group]
        counts = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in Verdict if verdict in verdicts)
        if not self._console.is_terminal:
            self._keep(Text(f"{self._done:{len(str(self._of))}}/{self._of}  {legible(self._group[0].group)}: {counts}"))
        self._group = []


def print_run(out: Console, run: Run) -> None:
    """Print the results of a run: counts for each group, what needs attention, where it comes from, and the verdict."""
    told = {kind: [result for result in run.results if standing(result) is kind] for kind in Standing}
    out.print(_table(run))
    for kind in (Standing.FAIL, Standing.UNEXPECTED_PASS, Standing.WARN):
        for result in told[kind]:
            _print_whole(out, result)
    for kind, heading in (
        (Standing.INCONCLUSIVE, "Could not be judged here:"),
        (Standing.NOT_APPLICABLE, "Did not apply:"),
    ):
        _print_reasons(out, heading, told[kind])
    if told[Standing.KNOWN_FAILURE]:
        out.print("\nFailed as known:")
        for result in told[Standing.KNOWN_FAILURE]:
            _print_indented(out, Text(f"{legible(result.case)}: {legible(result.known or '')} ({result.tally})"))
    if run.trouble:
        out.print("\nTrouble of the run itself:", style="bold red")
        for trouble in run.trouble:
            _print_indented(out, Text(legible(trouble)))
    _print_provenance(out, run)
    out.print(Text(f"\n{verdict_line(run)}", OUTCOME_STYLES[outcome(run)]))


def _headed(result: Result) -> Text:
    """The standing of a case, and its name."""
    kind = standing(result)
    return Text.assemble((kind.value, STYLES[kind]), "  ", (legible(result.case), "bold"))


def _table(run: Run) -> Table:
    """How many came to which verdict, in each group and in all."""
    numbers = (Column(verdict.value, justify="right", no_wrap=True) for verdict in Verdict)
    table = Table("group", *numbers, box=box.SIMPLE_HEAD, pad_edge=False)
    for group, results in groups(run).items():
        table.add_row(legible(group), *_counts(results))
    table.add_section()
    table.add_row("all", *_counts(run.results), style="bold")
    return table


def _counts(results: Sequence[Result]) -> list[Text]:
    verdicts = [result.verdict for result in results]
    counts = [(verdict, verdicts.count(verdict)) for verdict in Verdict]
    return [Text(str(count), STYLES[Standing(verdict.value)] if count else "dim") for verdict, count in counts]


def _print_whole(out: Console, result: Result) -> None:
    """Everything in a result that its repair needs."""
    out.print()
    out.print(_headed(result))
    _print_indented(out, Text(legible(result.sentence)))
    if standing(result) is Standing.UNEXPECTED_PASS:
        _print_indented(out, Text(f"It was expected to fail, and did not: {legible(result.known or '')}", "bold"))
    if result.reason:
        _print_indented(out, Text(legible(why(result)), "bold"))
    if again := advice(result):
        _print_indented(out, Text(legible(again)))
    _print_indented(out, Text(f"shows {', '.join(map(legible, result.clauses))}", "dim"))
    shown = trail(result)[-MOST_EVIDENCE:]
    if note := left_out(result, len(shown)):
        _print_indented(out, Text(note, "dim"))
    for item in map(abridged, shown):
        told = Text(legible(said(item)))
        if told.plain.startswith(label := legible(item.label)):
            told.stylize("cyan", 0, len(label))
        if item.meaning:
            told.stylize("dim", len(told) - len(legible(item.text)))
        _print_indented(out, told)


def _print_reasons(out: Console, heading: str, results: Iterable[Result]) -> None:
    """How many cases have each reason."""
    found = by_reason(results)
    if found:
        out.print(f"\n{heading}")
    for reason, cases in found.items():
        _print_indented(out, Text(f"{len(cases)} {'case' if len(cases) == 1 else 'cases'}: {legible(reason)}"))


def _print_provenance(out: Console, run: Run) -> None:
    """The device in one line; who tested it, when and with what in another."""
    rows = [legible(f"{name} {text}") for name, text in provenance_rows(run.provenance)]
    of_device = len(run.provenance.device)
    out.print(Text(f"\n{', '.join(rows[:of_device])}\n{', '.join(rows[of_device:])}", "dim"))


def _print_indented(out: Console, text: Text) -> None:
    """A paragraph: wrapped on a terminal; elsewhere on one line, so that it can be searched."""
    if out.is_terminal:
        out.print(Padding.indent(text, INDENT), soft_wrap=False)
        return
    for line in text.split("\n"):
        out.print(Text(INDENT * " ").append_text(line))
