from __future__ import annotations

import re
from enum import IntEnum, IntFlag
from pathlib import Path

import pytest
from phasewire.protocol.codes import (
    PROTOCOL_REVISION,
    PROTOCOL_VERSION,
    AckFlag,
    Action,
    Bank,
    ChannelEnd,
    ConsoleCode,
    DescriptorType,
    DfuRequest,
    DfuState,
    DfuStatus,
    Feature,
    Flag,
    FrameKind,
    Hardware,
    ImageReason,
    Kind,
    Memory,
    Outcome,
    Reason,
    Request,
    StandardRequest,
    State,
    StatusFlag,
    Target,
)

from tests.specification import SPEC, clauses, codes, table

ROOT = Path(__file__).parents[2]


CODES: list[type[IntEnum] | type[IntFlag]] = [
    *(Kind, Action, Reason, Request, State, Flag, AckFlag, StatusFlag, Feature, ChannelEnd, Memory, FrameKind, Outcome),
    *(
        ConsoleCode,
        Hardware,
        Target,
        Bank,
        ImageReason,
        DfuRequest,
        DfuState,
        DfuStatus,
        DescriptorType,
        StandardRequest,
    ),
]


@pytest.mark.parametrize("code", CODES)
def test_the_tables_of_the_specification_are_these_codes(code: type[IntEnum] | type[IntFlag]) -> None:
    assert codes(code.__name__) == {str(member.name): member.value for member in code}


def test_clause_identifiers_are_unique() -> None:
    assert len(clauses()) == len(set(clauses())) > 100


def test_code_and_tests_cite_only_clauses_that_exist() -> None:
    cited = {
        clause
        for room in ("protocol", "emulator", "host", "hil", "tests")
        for file in (ROOT / room).rglob("*.py")
        for clause in re.findall(r"clauses? ([A-Z]{3}-\d{3})", file.read_text(encoding="utf-8"))
    }
    assert len(cited) > 50
    assert cited <= set(clauses())


def test_the_table_of_revisions_ends_with_this_one() -> None:
    rows = table("table: revisions")
    numbers, dates = [int(row[0]) for row in rows], [row[1] for row in rows]
    assert sorted(set(numbers)) == list(range(1, PROTOCOL_REVISION + 1))
    assert numbers == sorted(numbers)
    assert dates == sorted(dates)
    assert len({(row[0], row[1]) for row in rows}) == PROTOCOL_REVISION
    assert {row[2] for row in rows[1:]} <= set(clauses())
    assert f"This is revision {PROTOCOL_REVISION}; VER-009" in SPEC
    assert f"This text is *revision* {PROTOCOL_REVISION} of version {PROTOCOL_VERSION}." in SPEC


def test_reasons_name_the_clause_that_is_broken() -> None:
    listed = {row[1].strip("`"): row[2] for row in table("table: Reason")}
    assert listed == {reason.name: reason.clause for reason in Reason}
    assert {reason.clause for reason in Reason} <= set(clauses())
