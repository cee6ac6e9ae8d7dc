"""Bugs put into the chain processors' program: they fit its sources, and the conformance suite catches them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from phasewire.firmware.xmos import build
from phasewire.hil.conformance.mutants import processors
from phasewire.hil.conformance.mutants.processors import broken_image, broken_sources, known_mutants, needs_clang
from phasewire.hil.conformance.mutants.texts import TextMutant

MUTANTS = {mutant.name: mutant for mutant in known_mutants()}
LEAST = 20
"""What the firmware was to be shown with."""
QUICK = ("width-0-is-a-whole-period", "damaged-number-is-taken")
"""In assembly, so that no clang is needed."""


@pytest.mark.parametrize("mutant", MUTANTS.values(), ids=list(MUTANTS))
def test_a_bug_fits_its_source(mutant: TextMutant) -> None:
    text = (build.FOLDER / mutant.file).read_text("utf-8")
    assert mutant.broken(text) != text
    assert not mutant.others, "keys that nobody reads"


def test_there_are_bugs_of_every_source() -> None:
    assert len(MUTANTS) >= LEAST
    sources = {path.name for path in build.FOLDER.glob("*.[sc]")}
    assert {mutant.file for mutant in MUTANTS.values()} >= sources


def test_a_bug_in_assembly_is_one_in_the_program(tmp_path: Path) -> None:
    mutant = MUTANTS["ticks-too-short"]
    assert not needs_clang(mutant)
    sound = [source for source in build.kept_sources() if source.name != mutant.file]
    broken = broken_sources(mutant, tmp_path)
    assert [source for source in broken if source.name != mutant.file] == sound
    assert broken_image(broken).program(0) != build.processor_segment(build.FIRST_VERSION)


@pytest.mark.skipif(shutil.which("clang") is None, reason="a bug in C is compiled by clang")
def test_a_bug_in_c_is_one_in_the_program(tmp_path: Path) -> None:
    mutant = MUTANTS["last-slot-is-refused"]
    assert needs_clang(mutant)
    changed = set(broken_sources(mutant, tmp_path)) ^ set(build.kept_sources())
    assert {source.name for source in changed} == {"handle.s"}


@pytest.mark.slow
def test_the_suite_catches_bugs_and_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    assert processors.judge_processors(QUICK) == 0
    said = capsys.readouterr().out
    assert "unbroken: PASS" in said
    assert "2 caught, 0 escaped" in said


@pytest.mark.slow
def test_a_bug_that_its_cases_do_not_see_gets_away(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = MUTANTS["width-0-is-a-whole-period"]._replace(case="", only=("timing/a-clock-block",))
    monkeypatch.setattr(processors, "known_mutants", lambda: [elsewhere])
    assert processors.judge_processors([]) == 1
    assert f"ESCAPED  {elsewhere.name}" in capsys.readouterr().out
