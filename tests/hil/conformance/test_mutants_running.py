"""Running the suite against mutants: who counts as caught, and that no process is left."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from phasewire.hil.conformance.mutants import running
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.patching import Mutant, Patch
from phasewire.hil.conformance.mutants.running import Fate, MutantResult, MutantWatcher, judged, run_mutants
from phasewire.hil.conformance.reports.mutants import MutantLine, markdown, print_mutants, record

from tests.hil.conformance.reports.test_terminal import console, written


def nothing(_: Patch) -> None:
    pass


def a_mutant(name: str, group: str = "blocks") -> Mutant:
    return Mutant(name, group, ("BLK-003",), f"{name} is broken.", nothing)


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


def judge_by_name(name: str, enough: int | None, out: Path) -> None:
    """Stands for a run; leaves the number of its process in the folder that the environment names."""
    (Path(os.environ[FOLDER]) / name).write_text(f"{os.getpid()} {enough}")
    if name.startswith("slow"):
        time.sleep(60)
    if name.startswith("crash"):
        sys.exit("no such thing")
    out.write_text(a_run("a/one", "a/two") if name.startswith("bad") else a_run())


FOLDER = "PHASEWIRE_TEST_FOLDER"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where each process leaves its number; processes begin anew, and so see the environment as it is."""
    monkeypatch.setenv(FOLDER, str(tmp_path))
    monkeypatch.syspath_prepend(Path(__file__).parents[3])  # where a process finds this file by its name
    monkeypatch.setattr(running, "_context", lambda: multiprocessing.get_context("spawn"))
    return tmp_path


def is_alive(folder: Path, name: str) -> bool:
    try:
        os.kill(int((folder / name).read_text().split()[0]), 0)
    except ProcessLookupError:
        return False
    return True


class Crowd(MutantWatcher):
    """Takes note of who runs; once so many have ended, the time of the others is over, however long that took."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, patient_until: int) -> None:
        self.most = 0
        self.names: list[str] = []
        self._monkeypatch, self._patient_until = monkeypatch, patient_until

    def goes_on(self, mutants: Sequence[str], ended: int, of: int) -> None:
        self.most = max(self.most, len(mutants))

    def ended(self, result: MutantResult) -> None:
        self.names.append(result.mutant.name)
        if len(self.names) == self._patient_until:
            self._monkeypatch.setattr(running, "TIME_OUT_SECONDS", 0.0)


def test_each_mutant_has_a_process_and_results_come_in_order(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["slow-one", "bad-one", "good-one", "crash-one", "bad-two"]
    crowd = Crowd(monkeypatch, patient_until=len(names) - 1)
    results = run_mutants([a_mutant(name) for name in names], 2, crowd, judge=judge_by_name)
    assert [result.mutant.name for result in results] == names
    fates = [result.fate for result in results]
    assert fates == [Fate.HUNG, Fate.CAUGHT, Fate.SURVIVED, Fate.CRASHED, Fate.CAUGHT]
    assert "no such thing" in results[3].why
    assert results[1].cases == ("a/one", "a/two")
    assert crowd.most == 2
    assert sorted(crowd.names) == sorted(names)
    assert not any(is_alive(folder, name) for name in names)
    assert (folder / "good-one").read_text().endswith(" 2")


def test_a_thorough_run_has_no_end_before_its_end(folder: Path) -> None:
    (result,) = run_mutants([a_mutant("bad-one")], 1, MutantWatcher(), thorough=True, judge=judge_by_name)
    assert result.fate is Fate.CAUGHT
    assert (folder / "bad-one").read_text().endswith(" None")


@pytest.mark.slow
def test_real_mutants_are_judged_by_the_real_suite() -> None:
    chosen = [MUTANTS["horizon-is-not-judged"], MUTANTS["last-refusal-is-always-checksum"]]
    results = run_mutants(chosen, 2, MutantWatcher())
    assert [result.fate for result in results] == [Fate.CAUGHT, Fate.CAUGHT], results
    assert any("HORIZON" in case or "first-reason" in case for case in results[0].cases)


def test_ctrl_c_leaves_no_process(folder: Path) -> None:
    class Impatient(MutantWatcher):
        def ended(self, result: MutantResult) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_mutants([a_mutant("slow-one"), a_mutant("bad-one")], 2, Impatient(), judge=judge_by_name)
    assert not is_alive(folder, "bad-one")
    assert not (folder / "slow-one").exists() or not is_alive(folder, "slow-one")


def test_ctrl_c_while_a_process_begins_leaves_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begin = running._Attempt.__init__

    def interrupted(attempt: Any, *arguments: Any) -> None:
        begin(attempt, *arguments)
        while not (folder / "slow-one").exists():
            time.sleep(0.01)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(running._Attempt, "__init__", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_mutants([a_mutant("slow-one")], 1, MutantWatcher(), judge=judge_by_name)
    assert not is_alive(folder, "slow-one")


RESULTS = [
    MutantResult(a_mutant("late", "timing"), Fate.CAUGHT, ("timing/a", "timing/b", "blocks/c"), "", 1.0),
    MutantResult(a_mutant("sly"), Fate.SURVIVED, (), "", 2.0),
    MutantResult(a_mutant("lone"), Fate.ONE_CASE, ("blocks/c",), "", 3.0),
    MutantResult(a_mutant("dead"), Fate.CRASHED, (), "exit code 4: it\nis [gone]", 4.0),
]


def test_the_table_is_sorted_by_group_and_names_who_got_away() -> None:
    out = console(terminal=False, width=200)
    print_mutants(out, RESULTS)
    lines = [line.split() for line in written(out).splitlines() if line.strip()]
    rows = lines[2:6]
    assert rows[0] == ["blocks", "sly", "survived", "0"]
    assert rows[1] == ["lone", "one", "case", "1", "blocks/c"]
    assert rows[3] == ["timing", "late", "caught", "3", "timing/a,", "timing/b,", "…"]
    told = written(out)
    assert "survived  blocks/sly\n    sly is broken.\n" in told
    assert "crashed  blocks/dead: exit code 4: it is [gone]\n" in told
    assert told.splitlines()[-1] == "FAIL: 2 of 4 got away (1 survived, 1 crashed, 1 one case, 1 caught)"


def test_where_all_are_caught_the_last_line_says_so() -> None:
    out = console(terminal=False)
    print_mutants(out, [RESULTS[0], RESULTS[2]])
    assert written(out).splitlines()[-1] == "PASS: none of 2 got away (1 one case, 1 caught)"


def test_the_record_holds_all() -> None:
    found = json.loads(json.dumps(record(RESULTS)))
    assert found["format"] == "phasewire-mutants-1"
    assert found["passed"] is False
    assert found["counts"] == {"survived": 1, "crashed": 1, "hung": 0, "one case": 1, "caught": 1}
    assert [entry["name"] for entry in found["mutants"]] == ["sly", "lone", "dead", "late"]
    assert found["mutants"][3]["cases"] == ["timing/a", "timing/b", "blocks/c"]
    assert [entry["caught"] for entry in found["mutants"]] == [False, True, False, True]
    assert record(RESULTS[:1])["passed"] is True


def test_while_they_run_a_terminal_shows_them_and_everywhere_who_got_away() -> None:
    for terminal in (True, False):
        out = console(terminal=terminal)
        with MutantLine(out) as watcher:
            watcher.goes_on(["late", "sly"], 3, 40)
            for result in RESULTS:
                watcher.ended(result)
        told = written(out)
        assert ("3/40  late, sly" in told) == terminal
        assert "survived  blocks/sly" in told
        assert "timing/late" not in told


def test_the_document_says_who_caught_whom() -> None:
    text = markdown(RESULTS)
    assert "2 of 4 got away (1 survived, 1 crashed, 1 one case, 1 caught)" in text
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("| `")]
    assert rows == [
        ["`sly`", "sly is broken.", "BLK-003", "**survived**"],
        ["`lone`", "lone is broken.", "BLK-003", "`blocks/c` *alone*"],
        ["`dead`", "dead is broken.", "BLK-003", "**crashed**"],
        ["`late`", "late is broken.", "BLK-003", "`timing/a`<br>`timing/b`"],
    ]


def test_the_document_of_mutants_has_all_of_them_and_all_are_caught() -> None:
    text = (Path(__file__).parents[3] / "docs" / "mutants.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE)) == set(MUTANTS)
    assert f"none of {len(MUTANTS)} got away" in text
