"""Reasons why there is no case: for requirements only, and for what the specification's own words bear out."""

from __future__ import annotations

import re

import pytest
from phasewire.hil.conformance.clauses import clauses, requirements
from phasewire.hil.conformance.unobserved import REASONS

HOSTS = "It binds hosts, not devices."


def test_only_requirements_have_reasons_and_each_is_a_sentence() -> None:
    assert set(REASONS) <= set(requirements())
    assert all(reason.endswith(".") and " " in reason for reason in REASONS.values())


@pytest.mark.parametrize("name", [name for name, reason in REASONS.items() if reason == HOSTS])
def test_a_clause_that_binds_hosts_demands_nothing_of_a_device(name: str) -> None:
    assert re.search(r"\bhosts?\b", clauses()[name.partition("/")[0]].text)
    assert not re.search(
        r"\b(device|controller|processor|loader)s? MUST\b", requirements()[name].sentence, re.IGNORECASE
    )


def test_what_asks_hosts_alone_has_that_for_a_reason() -> None:
    of_hosts = {
        name for name, each in requirements().items() if re.search(r"\bhosts? MUST\b", each.sentence, re.IGNORECASE)
    }
    with_a_half_for_the_device = {"DFU-009", "VER-005"}
    assert with_a_half_for_the_device <= of_hosts
    assert {name for name in of_hosts if REASONS.get(name) != HOSTS} == with_a_half_for_the_device
    assert not with_a_half_for_the_device & set(REASONS)


@pytest.mark.parametrize(
    "name",
    ["TIM-003", "CHN-004/2", "CHN-018", "CHN-021/1", "CHN-024", "SAF-007/2", "FWU-018/1", "FWU-020/1", "FWU-022/1"],
)
def test_what_shows_in_outputs_or_answers_has_no_reason(name: str) -> None:
    assert name in requirements()
    assert name not in REASONS
