"""A run whose outputs only a logic analyser sees; an emulator takes the part of a real device."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from phasewire.emulator import Emulator
from phasewire.emulator.ports.export import export
from phasewire.hil.conformance import Result, Run, Verdict, running
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.plugin import Watcher
from phasewire.hil.conformance.running import RunOptions, run_conformance
from phasewire.hil.conformance.sight import sigrok

pytestmark = pytest.mark.slow  # each is a run of the suite

CASES = '''
from __future__ import annotations
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, case
from phasewire.hil.conformance.sight.waveforms import check_play, check_silent, expected_words
from phasewire.protocol.blocks import Update

@case("PUL-004", needs=(Need.CAPTURE,))
def test_what_is_right(bench: Bench) -> None:
    """An update is played as it is written."""
    bench.enable()
    pulses = bench.weak()
    start = bench.must(Update(pulses)).commit_period
    words = expected_words(pulses, bench.wiring)
    bench.judge(start, start + 40, lambda seen: check_play(seen, [(start, words)]))

@case("PUL-004", needs=(Need.CAPTURE,))
def test_what_is_wrong(bench: Bench) -> None:
    """The mark claims silent outputs, and they are not."""
    bench.enable()
    start = bench.must(Update(bench.weak())).commit_period
    bench.judge(start, start + 40, check_silent)
'''
CHOSEN = [0, 1, 40, 170, 171, 319]


class Saves(Watcher):
    """Saves a recording as soon as it is asked for one."""

    def __init__(self, emulator: Emulator, path: Path) -> None:
        self.emulator, self.path = emulator, path
        self.told: list[str] = []
        self.verdicts: list[Verdict] = []

    def ended(self, result: Result) -> None:
        self.verdicts.append(result.verdict)

    def waits(self, what: str) -> None:
        self.told.append(what)
        export(self.emulator.capture(), self.path, CHOSEN)


@pytest.fixture(autouse=True)
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "groups"
    folder.mkdir()
    (folder / "test_seen_later.py").write_text(CASES, encoding="utf-8")
    monkeypatch.setattr(running, "GROUPS", folder)
    sys.modules.pop("test_seen_later", None)
    return folder


def verdicts(run: Run) -> list[Verdict]:
    return [result.verdict for result in run.results]


def test_a_recording_is_judged_after_the_run(emulator: Emulator, tmp_path: Path) -> None:
    path = tmp_path / "later.sr"
    watcher = Saves(emulator, path)
    run = run_conformance(RunOptions(emulator.url, capture=f"sigrok:{path}"), watcher)
    assert verdicts(run) == [Verdict.PASS, Verdict.FAIL]
    assert "first difference is in period" in run.results[1].reason
    assert run.provenance.capture == f"sigrok:{path}"
    (told,) = watcher.told
    assert f"save it as {path}" in told
    assert watcher.verdicts == [Verdict.INCONCLUSIVE] * 2 + verdicts(run)


def test_a_signal_ends_the_judging_of_a_recording(emulator: Emulator, tmp_path: Path) -> None:
    class Interrupts(Saves):
        def began(self, _case: str, _number: int, _of: int) -> None:
            if len(self.verdicts) == 3:
                raise KeyboardInterrupt

    path = tmp_path / "later.sr"
    run = run_conformance(RunOptions(emulator.url, capture=f"sigrok:{path}"), Interrupts(emulator, path))
    assert verdicts(run) == [Verdict.PASS, Verdict.INCONCLUSIVE]
    assert run.results[1].reason == "Ctrl-C ended the run before its outputs were judged"


def test_what_only_the_outputs_show_is_judged_from_the_recording(
    emulator: Emulator, groups: Path, tmp_path: Path
) -> None:
    path = tmp_path / "later.sr"
    cases = CASES.replace('"PUL-004", needs=(Need.CAPTURE,)', '"BLK-005", outputs=("PUL-004",)')
    blind = '@case("BLK-005", outputs=("PUL-004",))\ndef test_blind(bench: Bench) -> None:\n    """It never looks."""\n'
    (groups / "test_seen_later.py").write_text(cases + blind, encoding="utf-8")
    run = run_conformance(RunOptions(emulator.url, capture=f"sigrok:{path}"), Saves(emulator, path))
    assert {result.case.partition("/")[2]: (result.verdict, result.tally) for result in run.results} == {
        "what-is-right": (Verdict.PASS, ""),
        "what-is-right#outputs": (Verdict.PASS, ""),
        "what-is-wrong": (Verdict.PASS, ""),
        "what-is-wrong#outputs": (Verdict.FAIL, "failed 1 of 1"),
        "blind": (Verdict.PASS, ""),
        "blind#outputs": (Verdict.INCONCLUSIVE, ""),
    }


def test_what_no_recording_shows_is_inconclusive(
    emulator: Emulator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sigrok, "RECORDING_SECONDS", 0.2)
    monkeypatch.setattr(sigrok, "LOOK_SECONDS", 0.05)
    path = tmp_path / "never.sr"
    run = run_conformance(RunOptions(emulator.url, capture=f"sigrok:{path}"))
    assert verdicts(run) == [Verdict.INCONCLUSIVE] * 2
    assert "never.sr" in run.results[0].reason


def test_the_recording_of_another_run_is_not_used(
    emulator: Emulator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "old.sr"
    run_conformance(RunOptions(emulator.url, capture=f"sigrok:{path}"), Saves(emulator, path))
    kept = path.read_bytes()

    class SavesOld(Watcher):
        def waits(self, what: str) -> None:
            time.sleep(0.01)
            path.write_bytes(kept)

    run = run_conformance(RunOptions(emulator.url, capture=f"sigrok:{path}"), SavesOld())
    assert verdicts(run) == [Verdict.INCONCLUSIVE] * 2
    assert "was not recorded during this run" in run.results[0].reason


SLOW_HOST = '''
from __future__ import annotations
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, case, expect

@case("SAF-003", needs=(Need.CAPTURE,))
def test_watchdog(bench: Bench) -> None:
    """The case finds the device's own watchdog time."""
    expect("the watchdog", bench.status().watchdog_ms, bench.info.watchdog_ms)
'''


def test_a_slow_host_does_not_end_a_mark(
    emulator: Emulator, groups: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a second passes between a mark's changes, five times the watchdog's own time."""
    (groups / "test_seen_later.py").write_text(SLOW_HOST, encoding="utf-8")
    genuine = Bench.period

    def late(bench: Bench) -> int:
        bench.wait(0.5)
        return genuine(bench)

    monkeypatch.setattr(Bench, "period", late)
    path = tmp_path / "later.sr"
    (result,) = run_conformance(RunOptions(emulator.url, capture=f"sigrok:{path}"), Saves(emulator, path)).results
    assert (result.verdict, result.reason) == (Verdict.PASS, "")
