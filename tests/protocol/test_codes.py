from __future__ import annotations

import re
from pathlib import Path

import pytest
from phasewire.protocol import Kind, Reason, Request

SPEC = (Path(__file__).parents[2] / "protocol" / "SPEC.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("codes", [Kind, Reason, Request])
def test_the_tables_of_the_specification_are_these_codes(codes: type[Kind] | type[Reason] | type[Request]) -> None:
    section = SPEC.split(f"<!-- table: {codes.__name__} -->")[1].split("\n\n", 2)[1]
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", section, re.MULTILINE)
    assert [(int(value), name) for value, name in rows] == [(code.value, code.name) for code in codes]


def test_clause_identifiers_are_unique() -> None:
    clauses = re.findall(r"^\*\*([A-Z]{3}-\d{3})\*\*", SPEC, re.MULTILINE)
    assert len(clauses) == len(set(clauses)) > 30


def test_code_cites_only_clauses_that_exist() -> None:
    clauses = set(re.findall(r"^\*\*([A-Z]{3}-\d{3})\*\*", SPEC, re.MULTILINE))
    root = Path(__file__).parents[2]
    cited = {
        clause
        for room in ("protocol", "emulator", "host", "hil")
        for file in (root / room).glob("*.py")
        for clause in re.findall(r"clause ([A-Z]{3}-\d{3})", file.read_text(encoding="utf-8"))
    }
    assert cited
    assert cited <= clauses


def test_every_reason_has_words() -> None:
    assert all(reason.text for reason in Reason)
