"""The clauses that are read from SPEC.md, against its literal words and a plain count of them."""

from __future__ import annotations

import re

import pytest
from phasewire.hil.conformance.clauses import Clause, Requirement, clauses, read_clauses, requirements, resolve

from tests import specification

BODY = " ".join(specification.SPEC[specification.SPEC.index("\n## TIM") :].split())
"""SPEC.md after its preamble, which defines MUST, on one line."""


def spans() -> dict[str, tuple[int, int]]:
    """Where each requirement stands in the text."""
    found = {}
    for each in requirements().values():
        assert BODY.count(each.sentence) == 1, each
        start = BODY.index(each.sentence)
        found[each.identifier] = start, start + len(each.sentence)
    return found


def one(text: str) -> Clause:
    """The only clause of a chapter ABC."""
    (clause,) = read_clauses(f"# Title\n\n## ABC: letters\n\n{text}\n")
    return clause


def test_every_clause_is_read_in_the_order_of_the_text() -> None:
    assert list(clauses()) == specification.clauses()
    assert [clause.identifier for clause in clauses().values()] == list(clauses())


def test_every_must_stands_in_exactly_one_requirement() -> None:
    for must in re.finditer(r"\bMUST\b", BODY):
        holders = [name for name, (start, end) in spans().items() if start <= must.start() < end]
        assert len(holders) == 1, BODY[must.start() - 80 : must.end() + 80]


def test_a_requirement_stands_in_its_clause() -> None:
    for name, (start, end) in spans().items():
        before = re.findall(r"\*\*([A-Z]{3}-\d{3})\*\*", BODY[:end])
        assert before[-1] == name.partition("/")[0]
        assert "**" not in BODY[start:end]


def test_every_sentence_that_says_should_and_not_must_is_a_recommendation() -> None:
    recommended = [sentence for clause in clauses().values() for sentence in clause.recommendations]
    required = " ".join(each.sentence for each in requirements().values())
    assert " ".join(recommended).count("SHOULD") + required.count("SHOULD") == BODY.count("SHOULD")
    assert clauses()["NUM-004"].recommendations == ("A host SHOULD set RESTART in the first block of a session.",)
    assert clauses()["ACK-005"].recommendations == ()  # its SHOULD shares a sentence with a MUST


def test_chapters_have_their_titles() -> None:
    named = re.findall(r"^## ([A-Z]{3}): (.+)$", specification.SPEC, re.MULTILINE)
    assert list(dict.fromkeys((clause.chapter, clause.title) for clause in clauses().values())) == named
    assert clauses()["BLK-003"].chapter == "BLK"


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("BLK-005/3", "BLK-005 has BLK-005/1, BLK-005/2"),
        ("BLK-003/1", "BLK-003 says MUST in one sentence and is named BLK-003"),
        ("BLK-012/1", "BLK-012 says MUST in none and is named BLK-012"),
        ("blk-003", "did you mean BLK-003"),
        ("BLK-03", "BLK-003"),
        ("pulses", "they are named as BLK-003, or BLK-005/1"),
        ("", "they are named as BLK-003, or BLK-005/1"),
    ],
)
def test_the_error_for_an_unknown_name_lists_known_ones(name: str, hint: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(name)}: SPEC.md has no such clause or requirement; .*{hint}"):
        resolve(name)


def test_a_sentence_ends_with_its_full_stop() -> None:
    clause = one(
        "**ABC-001** It MUST wait, e.g. for 2.5 ms of USB 2.0 (i.e. long); then\nit MUST go: at once.\n"
        "`so` it says. (It MAY not.) It SHOULD\nrest.\n\nIt MUST come back:"
    )
    assert clause.sentences == (
        "It MUST wait, e.g. for 2.5 ms of USB 2.0 (i.e. long); then it MUST go: at once.",
        "`so` it says.",
        "(It MAY not.)",
        "It SHOULD rest.",
        "It MUST come back:",
    )
    assert clause.requirements == (
        Requirement("ABC-001/1", clause.sentences[0]),
        Requirement("ABC-001/2", clause.sentences[4]),
    )
    assert clause.recommendations == ("It SHOULD rest.",)
    assert clause.others == clause.sentences[1:4]
    assert clause.text == " ".join(clause.sentences)


def test_examples_diagrams_and_tables_are_no_sentences_but_cells_that_say_must() -> None:
    clause = one(
        "**ABC-001** The rows:\n\n<!-- table: Rows -->\n\n| a | b |\n|---|---|\n| 1 | quiet. Still |\n"
        "| 2 | a host MUST ignore it |\n\n```hex MUST\n00 # MUST\n```\n\n```mermaid\nA --> B : MUST\n```\n\nThe end."
    )
    assert clause.sentences == ("The rows:", "a host MUST ignore it", "The end.")
    assert clause.requirements == (Requirement("ABC-001", "a host MUST ignore it"),)


def test_a_clause_ends_with_the_next_one_or_a_heading() -> None:
    text = (
        "## ABC: letters\n\n**ABC-001** One.\n\n**ABC-002** Two.\n\n"
        "### Part\n\nMUST not count.\n\n## DEF: more\n\nNor it."
    )
    assert [(clause.identifier, clause.sentences) for clause in read_clauses(text)] == [
        ("ABC-001", ("One.",)),
        ("ABC-002", ("Two.",)),
    ]


@pytest.mark.parametrize("text", ["**DEF-001** One.", "## ABC: letters\n\n**DEF-001** One."])
def test_a_clause_of_another_chapter_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"DEF-001 stands in chapter (none|ABC); it belongs in DEF"):
        list(read_clauses(text))
