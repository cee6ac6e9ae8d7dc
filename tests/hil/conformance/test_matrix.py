"""The matrix of clauses and cases: which case shows which clause, what is missing, and contradictions."""

from __future__ import annotations

import json

import pytest
from phasewire.hil.conformance.clauses import clauses, requirements
from phasewire.hil.conformance.matrix import Claim, Level, Matrix, MatrixRow
from phasewire.hil.conformance.unobserved import REASONS
from rich.console import Console

FLIPPED = Claim("blocks/flipped[update]", ("BLK-003", "BLK-005/2"), "A flipped bit is refused.")
WHOLE = Claim("blocks/late", ("BLK-005", "BLK-012"), "A late change plays.")


def rows(matrix: Matrix, clause: str) -> tuple[MatrixRow, ...]:
    (found,) = (
        each.rows for chapter in matrix.chapters for each in chapter.clauses if each.clause.identifier == clause
    )
    return found


def test_a_case_stands_where_it_is_named_for() -> None:
    matrix = Matrix.of([FLIPPED, WHOLE])
    (checksum,) = rows(matrix, "BLK-003")
    assert (checksum.level, checksum.cases, checksum.reason) == (Level.MUST, ("blocks/flipped[update]",), None)
    first, second, others = rows(matrix, "BLK-005")
    assert (first.name, first.cases) == ("BLK-005/1", ())
    assert (second.name, second.cases) == ("BLK-005/2", ("blocks/flipped[update]",))
    assert (others.name, others.level, others.cases) == ("BLK-005", Level.NONE, ("blocks/late",))
    assert 'Period 0 stands for "as soon as possible" and is never late.' in others.sentence
    assert "MUST" not in others.sentence
    (update,) = rows(matrix, "BLK-012")
    assert (update.level, update.cases) == (Level.NONE, ("blocks/late",))


def test_recommendations_have_rows_of_their_own() -> None:
    (idle,) = rows(Matrix.of([Claim("serial/idle", ("SER-005",), "A zero comes first.")]), "SER-005")
    assert (idle.name, idle.level, idle.cases) == ("SER-005", Level.SHOULD, ("serial/idle",))
    assert idle.sentence.startswith("A sender that begins after a pause SHOULD send a zero first")
    must, should = rows(Matrix.of([Claim("numbers/any", ("NUM-004",), "Any number.")]), "NUM-004")
    assert (must.level, must.cases) == (Level.MUST, ("numbers/any",))
    assert (should.level, should.cases) == (Level.SHOULD, ())


def test_what_has_neither_case_nor_reason_is_missing() -> None:
    assert {row.name for row in Matrix.of(()).missing()} == set(requirements()) - set(REASONS)
    assert {row.name for row in Matrix.of([FLIPPED], {}).missing()} == set(requirements()) - {"BLK-003", "BLK-005/2"}
    assert Matrix.of([Claim("all/of-it", tuple(requirements()), "All.")], {}).missing() == ()


def test_a_clause_of_several_musts_does_not_cover_them() -> None:
    missing = {row.name for row in Matrix.of([WHOLE]).missing()}
    assert {"BLK-005/1", "BLK-005/2"} <= missing


def test_a_reason_for_what_a_case_shows_is_needless() -> None:
    matrix = Matrix.of([FLIPPED], {"BLK-005/2": "Nobody looks.", "BLK-009": "Nobody waits."})
    assert [row.name for row in matrix.needless()] == ["BLK-005/2"]
    assert [row.reason for row in matrix.needless()] == ["Nobody looks."]
    assert not Matrix.of([FLIPPED]).needless()


def test_an_unknown_name_is_refused_with_its_case() -> None:
    with pytest.raises(ValueError, match=r"^blocks/odd: BLK-005/3: .* BLK-005 has BLK-005/1, BLK-005/2$"):
        Matrix.of([Claim("blocks/odd", ("BLK-005/3",), "Odd.")])


@pytest.mark.parametrize("name", ["BLK-005", "BLK-999"])
def test_a_reason_for_no_requirement_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"reasons for {name}: only requirements"):
        Matrix.of((), {name: "Because."})


def test_its_record_is_json_and_whole() -> None:
    matrix = Matrix.of([FLIPPED, WHOLE])
    record = json.loads(json.dumps(matrix.record()))
    assert record["counts"] == matrix.counts()
    assert record["cases"] == {FLIPPED.case: FLIPPED.sentence, WHOLE.case: WHOLE.sentence}
    first = record["chapters"][0]
    assert (first["name"], first["title"]) == ("TIM", "time")
    written = {clause["name"]: clause["rows"] for chapter in record["chapters"] for clause in chapter["clauses"]}
    assert list(written) == list(clauses())
    assert written["BLK-003"] == [
        {
            "name": "BLK-003",
            "level": "MUST",
            "sentence": "A block whose checksum is wrong MUST have no effect besides its refusal.",
            "cases": ["blocks/flipped[update]"],
            "reason": None,
        }
    ]
    assert written["USB-022"][0]["reason"] == REASONS["USB-022"]


def test_its_table_shows_cases_reasons_and_gaps() -> None:
    console = Console(width=300)
    with console.capture() as captured:
        console.print(Matrix.of([FLIPPED, WHOLE], {"BLK-005/2": "Nobody looks.", "BLK-009": "Nobody waits."}).table())
    lines = [line.split() for line in captured.get().splitlines()]
    assert ["BLK", "blocks"] in lines
    assert ["BLK-003", "MUST", "blocks/flipped[update]"] in lines
    assert ["a", "reason", "that", "it", "does", "not", "need:", "Nobody", "looks."] in lines
    assert ["BLK-009", "MUST", "Nobody", "waits."] in lines
    assert ["BLK-010", "MUST", "neither", "a", "case", "nor", "a", "reason"] in lines
    assert ["BLK-012", "blocks/late"] in lines
    assert ["BLK-013"] in lines
