"""Running the suite against mutants: what counts as caught."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from phasewire.hil.conformance.cases import Case
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.running import CRASH, Fate, MutantWatcher, judged, recorded, run_mutants
from phasewire.hil.conformance.plugin import verdict_of


def a_run(*broken: str, trouble: Sequence[str] = ()) -> str:
    return json.dumps({"cases": broken, "trouble": list(trouble)})


@pytest.mark.parametrize(
    ("code", "out", "fate", "cases"),
    [
        (0, a_run(), Fate.SURVIVED, ()),
        (0, a_run("a/two"), Fate.ONE_CASE, ("a/two",)),
        (0, a_run("a/one", "b/three"), Fate.CAUGHT, ("a/one", "b/three")),
        (0, a_run("a/one", trouble=["a case cannot be collected"]), Fate.CRASHED, ("a/one",)),
        (0, "", Fate.CRASHED, ()),
        (1, "", Fate.CRASHED, ()),
        (1, a_run("a/one"), Fate.CRASHED, ()),
        (-9, a_run("a/one"), Fate.CRASHED, ()),
        (None, a_run("a/one"), Fate.HUNG, ()),
    ],
)
def test_only_a_case_that_breaks_in_a_run_that_comes_to_its_end_is_a_catch(
    code: int | None, out: str, fate: Fate, cases: tuple[str, ...]
) -> None:
    found = judged(code, out, "something\nat last\n")
    assert (found.fate, found.cases) == (fate, cases)
    assert fate.is_catch == (fate in (Fate.ONE_CASE, Fate.CAUGHT))
    if code != 0:
        assert "at last" in found.why


@pytest.mark.parametrize(
    ("error", "crash"),
    [
        (TypeError("it takes 1 argument but 4 were given"), True),
        (AttributeError("it has no such attribute"), True),
        (AssertionError("TypeError is no word of the answer"), False),
        (ValueError("the answer cannot be read"), False),
    ],
)
def test_a_mutant_that_names_what_the_emulator_lacks_is_told_from_one_that_breaks_a_case(
    error: Exception, crash: bool
) -> None:
    _, reason = verdict_of(error, Case(("SAF-001",), "A sentence."))
    assert bool(CRASH.search(reason)) == crash


def test_the_document_says_for_each_mutant_what_caught_it() -> None:
    assert {name: 1 <= len(cases) <= 2 for name, cases in recorded().items()} == dict.fromkeys(MUTANTS, True)


@pytest.mark.slow
def test_real_mutants_are_judged_by_the_real_suite() -> None:
    chosen = [MUTANTS["horizon-is-not-judged"], MUTANTS["last-refusal-is-always-checksum"]]
    results = run_mutants(chosen, 2, MutantWatcher())
    assert [result.fate for result in results] == [Fate.CAUGHT, Fate.CAUGHT], results
    assert any("HORIZON" in case or "first-reason" in case for case in results[0].cases)


def test_the_document_of_mutants_has_all_of_them_and_all_are_caught() -> None:
    text = (Path(__file__).parents[4] / "docs" / "reference/mutants.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `([^`]+)` \| (.*) \| [A-Z]+-\d[^|]* \| [^|]*\|$", text, re.MULTILINE))
    assert rows == {name: mutant.sentence.replace("|", "∣") for name, mutant in MUTANTS.items()}
    assert f"none of {len(MUTANTS)} got away" in text
