"""``phasewire conformance``: the options of a run, its reports, and its errors."""

from __future__ import annotations

import json
import pkgutil
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import pytest
from phasewire.emulator.control import admission
from phasewire.hil.conformance.cases import Risk
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.patching import Mutant
from phasewire.hil.conformance.mutants.running import Fate, MutantResult, MutantWatcher
from phasewire.hil.conformance.plugin import Watcher
from phasewire.hil.conformance.profile import Profile
from phasewire.hil.conformance.running import RunOptions
from phasewire.hil.conformance.verdicts import Run, Verdict

from tests.cli.runner import Run as Phasewire
from tests.hil.conformance.hand_made_runs import CLEAN, EVERY

pytestmark = pytest.mark.slow  # each is a run of the suite


@pytest.fixture
def phasewire(phasewire: Phasewire) -> Phasewire:
    return partial(phasewire, "conformance")


class Suite:
    """Stands in for the suite: it notes the options and returns a given run."""

    def __init__(self) -> None:
        self.run = CLEAN
        self.asked: list[RunOptions] = []
        self.look: Callable[[RunOptions], None] = lambda _: None

    def __call__(
        self, options: RunOptions, watcher: Watcher | None = None, judged: Callable[[], object] = lambda: None
    ) -> Run:
        self.asked.append(options)
        self.look(options)
        assert watcher is not None
        for number, result in enumerate(self.run.results, start=1):
            watcher.began(result.case, number, len(self.run.results))
            watcher.ended(result)
        return self.run


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch) -> Suite:
    stand_in = Suite()
    monkeypatch.setattr("phasewire.hil.conformance.running.run_conformance", stand_in)
    return stand_in


def test_all_options_reach_the_suite(phasewire: Phasewire, suite: Suite, tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_text('name = "mine"\n[not-applicable]\nserial = "none is fitted"\n')
    (tmp_path / "known.toml").write_text('["blocks/a"]\nreason = "revision C"\n')
    outcome = phasewire(
        *("--device", "usb:", "--capture", "sigrok:run.sr", "--allow", "reset", "--allow", "drive"),
        *("--levers", "command:power=relay {}", "--levers", "hub:1"),
        *("--door", "serial:///dev/ttyUSB0", "--door", "socket://bench:1"),
        *(
            "--profile",
            "device.toml",
            "--known-failures",
            "known.toml",
            "--only",
            "BLK",
            "--only",
            "safety/",
            "--seed",
            "9",
        ),
    )
    assert (outcome.code, outcome.err) == (0, "1/1  blocks: 1 pass\n")
    assert suite.asked == [
        RunOptions(
            "usb:",
            "sigrok:run.sr",
            ("command:power=relay {}", "hub:1"),
            frozenset({Risk.RESET, Risk.DRIVE}),
            Profile("mine", {"serial": "none is fitted"}),
            {"blocks/a": "revision C"},
            ("BLK", "safety/"),
            9,
            doors=("serial:///dev/ttyUSB0", "socket://bench:1"),
        )
    ]


@pytest.mark.parametrize(
    ("verdict", "words"), [(Verdict.INCONCLUSIVE, "1 could not be judged"), (Verdict.WARN, "1 warned")]
)
def test_strict_fails_only_for_inconclusive_cases_and_warnings(
    phasewire: Phasewire, suite: Suite, verdict: Verdict, words: str
) -> None:
    assert phasewire("--strict").code == 0
    suite.run = replace(CLEAN, results=(*CLEAN.results, replace(CLEAN.results[0], verdict=verdict, reason="so")))
    assert phasewire().code == 0
    outcome = phasewire("--strict", "--json", "c.json")
    assert outcome.code == 1
    assert f"--strict: {words}\n" in outcome.out
    assert outcome.out.splitlines()[-1].startswith("FAIL: no case broke, but the run itself is not in order")
    assert json.loads(Path("c.json").read_text())["trouble"] == [f"--strict: {words}"]


@pytest.mark.parametrize("verdict", [None, Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE, Verdict.WARN])
def test_a_run_without_a_pass_fails(phasewire: Phasewire, suite: Suite, verdict: Verdict | None) -> None:
    results = (replace(CLEAN.results[0], verdict=verdict, reason="so"),) if verdict else ()
    suite.run = replace(CLEAN, results=results)
    outcome = phasewire()
    assert (outcome.code, outcome.out.splitlines()[-1][:13]) == (1, "NOTHING SHOWN")
    assert "no case passed, so this run shows nothing about the device" in outcome.err


def test_reports_are_written_whether_it_passes_or_not(phasewire: Phasewire, suite: Suite) -> None:
    suite.run = EVERY
    assert phasewire("--html", "c.html", "--junit", "c.xml", "--json", "c.json").code == 1
    assert Path("c.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert ElementTree.parse("c.xml").getroot().get("failures") == "2"
    found = json.loads(Path("c.json").read_text())
    assert (found["format"], len(found["results"])) == ("phasewire-conformance-1", 9)
    assert {chapter["name"] for chapter in found["matrix"]["chapters"]} >= {"TIM", "BLK", "VER"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a disk that is always full")
@pytest.mark.parametrize(("run", "code"), [(CLEAN, 2), (EVERY, 1)])
@pytest.mark.parametrize("full", ["--html", "--junit", "--json"])
def test_a_full_disk_loses_neither_the_verdict_nor_the_other_reports(
    phasewire: Phasewire, suite: Suite, run: Run, code: int, full: str
) -> None:
    suite.run = run
    files = {"--html": "c.html", "--junit": "c.xml", "--json": "c.json"} | {full: "/dev/full"}
    outcome = phasewire(*(part for option in files.items() for part in option))
    assert outcome.code == code
    assert outcome.out.splitlines()[-1].startswith("FAIL" if code == 1 else "PASS")
    assert outcome.err.splitlines()[-1] == "phasewire: /dev/full: No space left on device"
    assert {path.name for path in Path().iterdir()} == set(files.values()) - {"/dev/full"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_writes_all_its_reports(phasewire: Phasewire, suite: Suite, number: int) -> None:
    suite.run = replace(CLEAN, signal=number)
    outcome = phasewire("--html", "c.html", "--junit", "c.xml", "--json", "c.json")
    assert outcome.code == 128 + number
    name = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}[signal.Signals(number)]
    said = f"INTERRUPTED by {name}: nothing broke so far, 1 passed"
    assert outcome.out.splitlines()[-1] == said
    assert said in Path("c.html").read_text(encoding="utf-8")
    assert said in Path("c.xml").read_text(encoding="utf-8")
    assert json.loads(Path("c.json").read_text())["interrupted by"] == name


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(
    "place", ["hil.conformance.bench.Bench.leave_off", "cli.conformance.page", "cli.conformance.junit"]
)
def test_a_signal_after_all_is_judged_waits_for_the_reports(
    phasewire: Phasewire, monkeypatch: pytest.MonkeyPatch, place: str, number: int, code: int
) -> None:
    owner, _, name = f"phasewire.{place}".rpartition(".")
    genuine = getattr(pkgutil.resolve_name(owner), name)

    def interrupted(*arguments: object) -> object:
        signal.raise_signal(number)
        return genuine(*arguments)

    monkeypatch.setattr(f"{owner}.{name}", interrupted)
    outcome = phasewire("--only", "VER-001", "--html", "c.html", "--junit", "c.xml", "--json", "c.json")
    assert outcome.code == code
    assert outcome.out.splitlines()[-1].startswith("PASS: nothing broke")
    assert json.loads(Path("c.json").read_text())["interrupted by"] is None
    assert {path.name for path in Path().iterdir()} == {"c.html", "c.xml", "c.json"}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--html", "nowhere/c.html"), "there is no folder nowhere"),
        (("--html", "c.html", "--junit", "c.html"), "c.html cannot be written: it is to be written twice"),
        (("--json", "p.toml", "--profile", "p.toml"), "p.toml cannot be written: it is also what is read"),
        (("--junit", "run.sr", "--capture", "sigrok:run.sr"), "run.sr cannot be written: it is also what is read"),
        (("--allow", "everything"), "'flash', 'reset', 'drive'"),
        (("--seed", "-1"), "--seed"),
        (("--profile", "p.toml"), "p.toml: colour = 'red': no such key; known are name"),
        (("--known-failures", "p.toml"), "p.toml: colour = 'red': it names no case"),
        (
            ("--mutant", "horizon-is-judged"),
            "there is no mutant 'horizon-is-judged'; the nearest are horizon-is-not-judged, ",
        ),
        (("--mutant", "nonsense"), "there is no mutant 'nonsense'; docs/reference/mutants.md lists all"),
        (("--only", "ACK-004", "--only", "safty"), "no case begins with 'safty'; --list names all"),
        (("--list", "--only", "safty"), "no case begins with 'safty'; --list names all"),
        (("--mutant", "horizon-is-not-judged", "--device", "usb:"), "--mutant brings a device of its own"),
        (("--mutants", "--device", "usb:"), "--mutants brings devices of its own"),
        (
            ("--mutants", "--mutant", "horizon-is-not-judged"),
            "--mutants brings devices of its own",
        ),
        (("--mutants", "--jobs", "0"), "--jobs"),
        (("--mutants", "--json", "nowhere/m.json"), "there is no folder nowhere"),
        (("--jobs", "2"), "--jobs goes with --mutants"),
        (("--profile", "absent.toml"), "absent.toml: No such file"),
        (
            ("--list", "--html", "c.html", "--junit", "c.xml"),
            "--list runs nothing, of which --html and --junit could tell",
        ),
    ],
)
def test_wrong_use_is_reported_before_the_run(
    phasewire: Phasewire, suite: Suite, tmp_path: Path, arguments: tuple[str, ...], complaint: str
) -> None:
    (tmp_path / "p.toml").write_text('colour = "red"\n')
    outcome = phasewire(*arguments)
    assert outcome.code == 2
    assert complaint in " ".join(outcome.err.replace("│", " ").split())
    assert suite.asked == []


def test_the_list_of_some_cases_has_these_alone(phasewire: Phasewire) -> None:
    outcome = phasewire("--list", "--only", "safety/the-watchdog-starts-with", "--json", "list.json")
    record = json.loads(Path("list.json").read_text())
    assert list(record["cases"]) == ["safety/the-watchdog-starts-with-enable"]
    rows = [row for chapter in record["chapters"] for clause in chapter["clauses"] for row in clause["rows"]]
    assert [row["cases"] for row in rows] == [list(record["cases"])] * len(rows)
    assert {row["name"] for row in rows} == {"SAF-003", "STA-003"}
    assert outcome.out.count("safety/") == len(rows)


@pytest.mark.parametrize("arguments", [("--mutants",), ("--mutant", "horizon-is-not-judged")])
def test_an_installed_package_names_the_place_of_the_mutants(
    phasewire: Phasewire, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.setattr("phasewire.cli.conformance.find_spec", lambda _: None)
    outcome = phasewire(*arguments)
    assert outcome.code == 2
    assert "they stand in its repository, in the folder mutants" in " ".join(outcome.err.split())


def test_reports_of_a_mutant_name_it(phasewire: Phasewire, suite: Suite) -> None:
    horizons = []

    def look(options: RunOptions) -> None:
        horizons.append(vars(admission)["HORIZON_PERIODS"])

    suite.look = look
    before = vars(admission)["HORIZON_PERIODS"]
    outcome = phasewire("--mutant", "horizon-is-not-judged", "--json", "-")
    assert outcome.code == 0
    assert suite.asked[0].url == "emulator:"
    assert horizons != [before] == [vars(admission)["HORIZON_PERIODS"]]
    mutant = json.loads(outcome.out)["provenance"]["device"]["mutant"]
    assert mutant.startswith("horizon-is-not-judged: Any period is accepted")
    assert "fresh" not in outcome.err


@pytest.mark.parametrize(("fate", "code"), [(Fate.CAUGHT, 0), (Fate.ONE_CASE, 0), (Fate.SURVIVED, 1), (Fate.HUNG, 1)])
def test_a_surviving_mutant_is_exit_code_1(
    phasewire: Phasewire, monkeypatch: pytest.MonkeyPatch, fate: Fate, code: int
) -> None:
    asked: list[tuple[list[str], int]] = []

    def stand_in(chosen: list[Mutant], jobs: int, watcher: MutantWatcher, *, thorough: bool) -> list[MutantResult]:
        assert not thorough
        asked.append(([mutant.name for mutant in chosen], jobs))
        results = [MutantResult(mutant, fate if not index else Fate.CAUGHT, (), "", 0) for index, mutant in chosen_of]
        for result in results:
            watcher.ended(result)
        return results

    chosen_of = list(enumerate(MUTANTS.values()))
    monkeypatch.setattr("phasewire.hil.conformance.mutants.running.run_mutants", stand_in)
    outcome = phasewire("--mutants", "--jobs", "3", "--json", "-")
    assert outcome.code == code
    assert asked == [(list(MUTANTS), 3)]
    found = json.loads(outcome.out)
    assert (found["format"], len(found["mutants"])) == ("phasewire-mutants-1", len(MUTANTS))
    assert f"of {len(MUTANTS)} got away" in outcome.err
