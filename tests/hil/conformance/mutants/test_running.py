"""Running the suite against mutants: what counts as caught."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.running import Fate, MutantWatcher, judged, run_mutants


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
