"""Which case shows what of SPEC.md, and what no case shows.

A `Matrix` has chapters, a chapter clauses, a clause rows; a row is a requirement, or the rest of the clause, with the
cases that show it or the reason why none can. It learns of cases by `Claim` and runs none.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import groupby
from operator import attrgetter
from typing import Any

from rich.table import Column, Table
from rich.text import Text

from .clauses import Clause, clauses, requirements, resolve
from .unobserved import REASONS

__all__ = ["Chapter", "Claim", "ClauseRows", "Level", "Matrix", "MatrixRow"]


@dataclass(frozen=True)
class Claim:
    """What a case claims to show."""

    case: str
    """``group/name-of-the-case``, with ``[parameter]`` if it has some."""
    clauses: tuple[str, ...]
    """Such as ``BLK-003`` or, of several MUSTs in a clause, ``BLK-005/1``."""
    sentence: str
    """What it does and why."""


class Level(StrEnum):
    """The strength of a requirement."""

    MUST = "MUST"
    SHOULD = "SHOULD"
    NONE = "none"
    """It describes something that shows in a device all the same."""


@dataclass(frozen=True)
class MatrixRow:
    """A requirement, or the rest of a clause."""

    name: str
    """That of the requirement, or else of the clause: ``BLK-005/1``, ``BLK-012``."""
    sentence: str
    """In the words of SPEC.md; empty if the clause is only a table."""
    level: Level
    cases: tuple[str, ...]
    """The cases that name it, in the order of the claims."""
    reason: str | None = None
    """For a requirement: why no case can show it."""


@dataclass(frozen=True)
class ClauseRows:
    """A clause and its rows: its requirements first, then the rest."""

    clause: Clause
    rows: tuple[MatrixRow, ...]


@dataclass(frozen=True)
class Chapter:
    """A chapter of SPEC.md: ``BLK``, ``blocks``, and its clauses."""

    name: str
    title: str
    clauses: tuple[ClauseRows, ...]


@dataclass(frozen=True)
class Matrix:
    """Clauses, requirements and cases."""

    chapters: tuple[Chapter, ...]
    """All of SPEC.md, in the order of the text."""
    claims: tuple[Claim, ...]
    """All cases, as they were given."""

    @classmethod
    def of(cls, claims: Iterable[Claim], reasons: Mapping[str, str] = REASONS) -> Matrix:
        """The matrix of some cases, with reasons for the requirements that no case can show.

        Raises `ValueError` if a case names what SPEC.md does not have, or a reason is given for something that is no
        requirement.
        """
        claims = tuple(claims)
        cases: dict[str, list[str]] = defaultdict(list)
        for claim in claims:
            for name in dict.fromkeys(claim.clauses):
                try:
                    cases[resolve(name).identifier].append(claim.case)
                except ValueError as error:
                    raise ValueError(f"{claim.case}: {error}") from None
        if unknown := [name for name in reasons if name not in requirements()]:
            raise ValueError(f"reasons for {', '.join(unknown)}: only requirements have reasons, such as BLK-003")
        shown = {name: tuple(names) for name, names in cases.items()}
        chapters = (
            Chapter(
                name, title, tuple(ClauseRows(clause, tuple(_rows(clause, shown, reasons))) for clause in of_chapter)
            )
            for (name, title), of_chapter in groupby(clauses().values(), attrgetter("chapter", "title"))
        )
        return cls(tuple(chapters), claims)

    def shown(self) -> Matrix:
        """The rows that have cases."""

        def kept(clauses: Iterable[ClauseRows]) -> Iterator[ClauseRows]:
            for clause in clauses:
                if rows := tuple(row for row in clause.rows if row.cases):
                    yield replace(clause, rows=rows)

        chapters = (replace(chapter, clauses=tuple(kept(chapter.clauses))) for chapter in self.chapters)
        return Matrix(tuple(chapter for chapter in chapters if chapter.clauses), self.claims)

    def rows(self) -> Iterator[MatrixRow]:
        """All rows, in the order of the text."""
        return (row for chapter in self.chapters for clause in chapter.clauses for row in clause.rows)

    def requirements(self) -> tuple[MatrixRow, ...]:
        """The rows of requirements."""
        return tuple(row for row in self.rows() if row.level is Level.MUST)

    def missing(self) -> tuple[MatrixRow, ...]:
        """Requirements that have neither a case nor a reason."""
        return tuple(row for row in self.requirements() if not row.cases and row.reason is None)

    def needless(self) -> tuple[MatrixRow, ...]:
        """Requirements that have both: what a case shows needs no reason."""
        return tuple(row for row in self.requirements() if row.cases and row.reason is not None)

    def counts(self) -> dict[str, int]:
        """The counts of each kind."""
        found = self.requirements()
        return {
            "clauses": sum(len(chapter.clauses) for chapter in self.chapters),
            "requirements": len(found),
            "with_a_case": sum(bool(row.cases) for row in found),
            "with_a_reason": sum(row.reason is not None for row in found),
            "missing": len(self.missing()),
            "needless": len(self.needless()),
            "cases": len(self.claims),
        }

    def record(self) -> dict[str, Any]:
        """All of it as JSON."""
        return {
            "counts": self.counts(),
            "cases": {claim.case: claim.sentence for claim in self.claims},
            "chapters": [
                {
                    "name": chapter.name,
                    "title": chapter.title,
                    "clauses": [
                        {
                            "name": clause.clause.identifier,
                            "rows": [
                                {
                                    "name": row.name,
                                    "level": row.level.value,
                                    "sentence": row.sentence,
                                    "cases": list(row.cases),
                                    "reason": row.reason,
                                }
                                for row in clause.rows
                            ],
                        }
                        for clause in chapter.clauses
                    ],
                }
                for chapter in self.chapters
            ],
        }

    def table(self) -> Table:
        """All of it, for people: a line for each row, with its cases, its reason, or what is missing."""
        table = Table("clause", "level", Column("cases, or why there is none", overflow="fold"), box=None)
        for chapter in self.chapters:
            table.add_row(Text(chapter.name, "bold"), "", Text(chapter.title, "bold"))
            for clause in chapter.clauses:
                for row in clause.rows:
                    table.add_row(row.name, "" if row.level is Level.NONE else row.level.value, _shown_by(row))
        return table


def _shown_by(row: MatrixRow) -> Text:
    """The cases of a row, its reason, or what is missing."""
    cases = "\n".join(row.cases)
    if row.cases and row.reason is not None:
        return Text(f"{cases}\na reason that it does not need: {row.reason}", "red")
    if row.level is Level.MUST and not row.cases:
        return Text("neither a case nor a reason", "red") if row.reason is None else Text(row.reason, "dim")
    return Text(cases)


def _rows(clause: Clause, shown: Mapping[str, tuple[str, ...]], reasons: Mapping[str, str]) -> Iterator[MatrixRow]:
    """The rows of a clause: its requirements, its recommendations and, if cases name the clause, the rest."""
    # The clause's own name is that of its requirement if it has one, except one that no case can show.
    alone = len(clause.requirements) == 1 and clause.identifier not in reasons
    cases = () if alone else shown.get(clause.identifier, ())
    for each in clause.requirements:
        name = each.identifier
        by_name = () if name == clause.identifier and not alone else shown.get(name, ())
        yield MatrixRow(name, each.sentence, Level.MUST, by_name, reasons.get(name))
    for sentence in clause.recommendations:
        yield MatrixRow(clause.identifier, sentence, Level.SHOULD, cases)
    if not clause.recommendations and (cases or not clause.requirements):
        yield MatrixRow(clause.identifier, " ".join(clause.others), Level.NONE, cases)
