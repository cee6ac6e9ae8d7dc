"""A run whose outputs only a logic analyser sees, played by an emulator of which no more is known than of a device."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from phasewire.emulator import Emulator
from phasewire.emulator.ports.export import export
from phasewire.hil.conformance import Run, Verdict, running
from phasewire.hil.conformance.plugin import Watcher
from phasewire.hil.conformance.running import Options, run_conformance

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
    """The outputs are said to be silent, and are not."""
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

    def waits(self, what: str) -> None:
        self.told.append(what)
        export(self.emulator.capture(), self.path, CHOSEN)


@pytest.fixture(autouse=True)
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "groups"
    folder.mkdir()
    (folder / "test_seen_later.py").write_text(CASES, encoding="utf-8")
    monkeypatch.setattr(running, "GROUPS", folder)


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    with Emulator() as device:
        yield device


def verdicts(run: Run) -> list[Verdict]:
    return [result.verdict for result in run.results]


def test_a_recording_is_judged_after_the_run(emulator: Emulator, tmp_path: Path) -> None:
    path = tmp_path / "later.sr"
    watcher = Saves(emulator, path)
    run = run_conformance(Options(emulator.url, capture=f"sigrok:{path}"), watcher)
    assert verdicts(run) == [Verdict.PASS, Verdict.FAIL]
    assert "first difference is in period" in run.results[1].reason
    assert run.provenance.capture == f"sigrok:{path}"
    (told,) = watcher.told
    assert f"save it as {path}" in told


def test_what_no_recording_shows_is_inconclusive(
    emulator: Emulator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "RECORDING_SECONDS", 0.2)
    monkeypatch.setattr(running, "LOOK_SECONDS", 0.05)
    path = tmp_path / "never.sr"
    run = run_conformance(Options(emulator.url, capture=f"sigrok:{path}"))
    assert verdicts(run) == [Verdict.INCONCLUSIVE] * 2
    assert "never.sr" in run.results[0].reason


def test_the_recording_of_another_run_is_none_of_this(
    emulator: Emulator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "old.sr"
    run_conformance(Options(emulator.url, capture=f"sigrok:{path}"), Saves(emulator, path))
    kept = path.read_bytes()

    class SavesOld(Watcher):
        def waits(self, what: str) -> None:
            time.sleep(0.01)
            path.write_bytes(kept)

    run = run_conformance(Options(emulator.url, capture=f"sigrok:{path}"), SavesOld())
    assert verdicts(run) == [Verdict.INCONCLUSIVE] * 2
    assert "was not recorded during this run" in run.results[0].reason
