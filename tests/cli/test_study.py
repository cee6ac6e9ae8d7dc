"""``phasewire study``: its output, its files, and its exit codes."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from phasewire.cli import study as command
from phasewire.hil.study.judging import Confusion
from phasewire.hil.study.pointer import FLAT_SHAPES, Pointer
from phasewire.hil.study.running import PRACTISED, Study
from phasewire.solver.contact.solids import SOLIDS

from tests.cli.runner import Run

TESTED = tuple(shape for shape in SOLIDS if shape != PRACTISED)
PERSONS = np.array([0.7, 0.9])


def confusion(right: int, answers: tuple[str, ...] = TESTED, shapes: tuple[str, ...] = TESTED) -> Confusion:
    """Each shape is recognised so often, of ten times, and else taken for the next one."""
    own = np.eye(len(answers), dtype=np.int64)[: len(shapes)]
    return Confusion(shapes, answers, right * own + (10 - right) * np.roll(own, 1, axis=1), PERSONS)


def made_up(silent: int = 2, pointer: int = 8) -> Study:
    flat = {
        judge: Pointer(*(confusion(right, tuple(FLAT_SHAPES), tuple(FLAT_SHAPES)) for right in (5, pointer)))
        for judge in ("fields", "drawings")
    }
    with_cone = confusion(7, (*TESTED, PRACTISED))
    return Study(confusion(8), with_cone, confusion(silent), confusion(2), flat)


@pytest.fixture
def study(phasewire: Run) -> Run:
    return partial(phasewire, "study")


def test_a_study_is_reported(study: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def run(*arguments: object, **options: object) -> Study:
        asked.append((arguments, options["seconds"]))
        return made_up()

    monkeypatch.setattr(command, "run_study", run)
    outcome = study("--persons", "4", "--trials", "3", "--seed", "9", "--seconds", "1.5", "--json", "study.json")
    assert outcome.code == 0
    assert asked == [((4, 3, 9), 1.5)]
    assert "Right: 80% ± 10%; people in the paper 80%. If the cone may be answered too: 70%." in outcome.out
    assert "Field off: 20%. Shuffled labels: 20%." in outcome.out
    assert "static outline 50%, moving pointer 80%: pointer better than outline; people 51% and 83%" in outcome.out
    assert "Both controls are at chance" in outcome.out
    assert Path("study.png").stat().st_size > 10_000
    record = json.loads(Path("study.json").read_text())
    assert record["format"] == "phasewire-study-1"
    assert record["options"] == {"persons": 4, "trials": 3, "seconds": 1.5, "seed": 9}
    assert record["felt"]["counts"]["cube"] == [2, 0, 0, 0, 8]
    assert record["felt"]["accuracy"] == 0.8
    assert record["flat"]["drawings"]["pointer_minus_outline"] == pytest.approx(0.3)


def test_a_control_above_chance_fails(study: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "run_study", lambda *_, **__: made_up(silent=6))
    outcome = study()
    assert outcome.code == 1
    assert "NOT SOUND: a control is not at chance" in outcome.out


def test_an_ordering_that_does_not_come_out_is_told(study: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "run_study", lambda *_, **__: made_up(pointer=3))
    outcome = study()
    assert outcome.code == 0
    assert outcome.out.count("NOT told apart or reversed") == 2
