"""The requirements of SPEC.md: its clauses, and the sentences of each that say MUST.

Cases, and the reasons for missing ones, name clauses and requirements by the identifiers made here; this module knows
neither.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from types import MappingProxyType

from ... import protocol

__all__ = ["Clause", "Requirement", "changes", "clauses", "read_clauses", "requirements", "resolve", "revisions"]

CHAPTER = re.compile(r"^## ([A-Z]{3}): (.+)$")
CLAUSE = re.compile(r"^\*\*([A-Z]{3}-\d{3})\*\* ")
REVISED = re.compile(r"^\| (\d+) \| \d{4}-\d{2}-\d{2} \| ([A-Z]{3}-\d{3}) \|", re.MULTILINE)
SENTENCE_END = re.compile(r"(?<!e\.g)(?<!i\.e)(\.[)”\"]?)\s+")


@dataclass(frozen=True)
class Requirement:
    """A sentence that says MUST."""

    identifier: str
    """``BLK-003`` if it is the only one of its clause, ``BLK-005/1``, ``BLK-005/2``, … if it is one of several."""
    sentence: str
    """In the words of SPEC.md, on one line."""


@dataclass(frozen=True)
class Clause:
    """A clause of SPEC.md."""

    identifier: str
    """Such as ``BLK-003``."""
    chapter: str
    """Such as ``BLK``."""
    title: str
    """Of the chapter, such as ``blocks``."""
    sentences: tuple[str, ...]
    """Its sentences, in the order of the text, a line each: its prose, and the cells of its tables that say MUST. Other
    cells, examples and diagrams are left out."""
    requirements: tuple[Requirement, ...]
    """Those of the sentences that say MUST."""

    @property
    def text(self) -> str:
        """All sentences, on one line."""
        return " ".join(self.sentences)

    @property
    def recommendations(self) -> tuple[str, ...]:
        """The sentences that say SHOULD, and not MUST."""
        return tuple(text for text in self.others if "SHOULD" in text)

    @property
    def others(self) -> tuple[str, ...]:
        """The sentences that do not say MUST."""
        return tuple(text for text in self.sentences if "MUST" not in text)


@cache
def clauses() -> Mapping[str, Clause]:
    """All clauses of SPEC.md by their identifiers, in the order of the text."""
    return MappingProxyType({clause.identifier: clause for clause in read_clauses(_specification())})


@cache
def revisions() -> Mapping[str, tuple[int, ...]]:
    """The revisions in which clauses bound a device more than before, by the table of VER-009."""
    found: dict[str, tuple[int, ...]] = {}
    for revision, clause in REVISED.findall(_specification()):
        found[clause] = (*found.get(clause, ()), int(revision))
    return MappingProxyType(found)


def changes(names: Iterable[str], after: int = 1) -> tuple[str, ...]:
    """What was changed in some clauses after a revision, such as ``SER-011 changed in revision 2``."""
    whole = dict.fromkeys(name.partition("/")[0] for name in names)
    return tuple(
        f"{clause} changed in revision {revision}"
        for clause in whole
        for revision in revisions().get(clause, ())
        if revision > after
    )


def _specification() -> str:
    return files(protocol).joinpath("SPEC.md").read_text(encoding="utf-8")


@cache
def requirements() -> Mapping[str, Requirement]:
    """All requirements of SPEC.md by their identifiers, in the order of the text."""
    return MappingProxyType({each.identifier: each for clause in clauses().values() for each in clause.requirements})


def resolve(name: str) -> Clause | Requirement:
    """The requirement of a name such as ``BLK-005/2``, or else the clause, which has several requirements or none.

    Raises `ValueError` if there is no such clause, or no such requirement in it.
    """
    found = requirements().get(name) or clauses().get(name)
    if found is None:
        raise ValueError(f"{name}: SPEC.md has no such clause or requirement; {_what_there_is(name)}")
    return found


def _what_there_is(name: str) -> str:
    """Suggestions for an unknown name."""
    if (clause := clauses().get(name.partition("/")[0])) is not None:
        names = [each.identifier for each in clause.requirements]
        if len(names) > 1:
            return f"{clause.identifier} has {', '.join(names)}"
        return (
            f"{clause.identifier} says MUST in {'one sentence' if names else 'none'} and is named {clause.identifier}"
        )
    near = get_close_matches(name.upper(), {**clauses(), **requirements()}, n=3)
    return f"did you mean {' or '.join(near)}?" if near else "they are named as BLK-003, or BLK-005/1"


def read_clauses(text: str) -> Iterator[Clause]:
    """The clauses of a text that is written like SPEC.md.

    Raises `ValueError` if a clause stands under no chapter's heading, or under that of another chapter.
    """
    chapter, title = "", ""
    identifier: str | None = None
    paragraphs: list[str] = []
    for paragraph in _paragraphs(text):
        begins = CLAUSE.match(paragraph)
        heading = paragraph.startswith("#")
        if identifier is not None and (begins or heading):
            yield _clause(identifier, chapter, title, paragraphs)
            identifier = None
        if (found := CHAPTER.match(paragraph)) is not None:
            chapter, title = found.groups()
        if begins is not None:
            identifier, paragraphs = begins[1], [paragraph[begins.end() :]]
            if not identifier.startswith(f"{chapter}-"):
                raise ValueError(f"{identifier} stands in chapter {chapter or 'none'}; it belongs in {identifier[:3]}")
        elif identifier is not None:
            paragraphs.append(paragraph)
    if identifier is not None:
        yield _clause(identifier, chapter, title, paragraphs)


def _paragraphs(text: str) -> Iterator[str]:
    """Paragraphs, headings and tables, without fenced blocks and comments."""
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    prose = re.sub(r"^<!--.*?-->$", "", prose, flags=re.MULTILINE)
    yield from (part.strip() for part in re.split(r"\n\s*\n", prose) if part.strip())


def _clause(identifier: str, chapter: str, title: str, paragraphs: list[str]) -> Clause:
    """A clause from its paragraphs."""
    sentences = tuple(sentence for paragraph in paragraphs for sentence in _sentences(paragraph))
    musts = [sentence for sentence in sentences if "MUST" in sentence]
    names = [identifier] if len(musts) == 1 else [f"{identifier}/{number}" for number in range(1, len(musts) + 1)]
    return Clause(identifier, chapter, title, sentences, tuple(map(Requirement, names, musts)))


def _sentences(paragraph: str) -> Iterator[str]:
    """The sentences of a paragraph; for a table the cells that say MUST."""
    if paragraph.startswith("|"):
        cells = (cell.strip() for line in paragraph.splitlines() for cell in line.strip("| ").split(" | "))
        yield from (cell for cell in cells if "MUST" in cell)
    else:
        line = " ".join(paragraph.split())
        yield from (part for part in SENTENCE_END.sub(r"\1\n", line).split("\n") if part)
