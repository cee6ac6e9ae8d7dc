"""``phasewire sweep``: its output, its files, and its exit codes."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from phasewire.hil.sweep import crews
from phasewire.hil.sweep.design import Design
from phasewire.hil.sweep.measures import Measures
from phasewire.hil.sweep.results import read_results

from tests.cli.runner import Run


@pytest.fixture
def sweep(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """The command with a quick measure, in a folder with a file of nine rows of which three have no measures."""

    def quick(design: Design, points: object) -> Measures:
        columns, pitch = design.columns, design.pitch_mm
        if pitch == 12:
            raise ValueError("too wide")
        return Measures(100.0 * columns, 90.0, 0.01 * pitch, None, 0, 40.0 + columns)

    monkeypatch.setattr(crews, "measure", quick)
    Path("arrays.toml").write_text(
        'source = "circle:radius=0.03"\n[grid]\ncolumns = [10, 20, 30]\npitch_mm = {from = 8, to = 12, count = 3}\n'
    )
    return partial(phasewire, "sweep", "arrays.toml", "-o", "r.parquet", "--on", "serial")


def test_a_sweep_is_written_and_reported(sweep: Run) -> None:
    outcome = sweep("--json", "-")
    assert outcome.code == 0
    record = json.loads(outcome.out)
    assert record["format"] == "phasewire-sweep-1"
    assert (record["rows"], record["measured"], record["kept"], record["workers"]) == (9, 9, 0, 1)
    assert record["swept"] == ["columns", "pitch_mm"]
    assert record["measures"]["strength_pa"] == {"least": 1000, "median": 2000, "largest": 3000}
    assert record["measures"]["lobe_db"] is None
    assert record["problems"] == dict.fromkeys(("2", "5", "8"), "ValueError: too wide")
    assert record["dashboard"] is None
    assert "row 5 has no measures: ValueError: too wide" in outcome.err
    assert "r.parquet has 9 rows: 9 measured in" in outcome.err
    results = read_results("r.parquet")
    assert results.numbers("strength_pa")[[0, 3, 6]].tolist() == [1000, 2000, 3000]
    assert np.isnan(results.numbers("lobe_db")).all()


@pytest.mark.slow
def test_a_sweep_is_drawn(sweep: Run) -> None:
    outcome = sweep("--plot", "r.png")
    assert "Drawn to r.png" in outcome.err
    assert Path("r.png").stat().st_size > 10_000


def test_a_whole_sweep_is_reported_again_without_measuring(sweep: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    assert sweep().code == 0
    monkeypatch.setattr(crews, "measure", None)
    outcome = sweep()
    assert outcome.code == 0
    assert "r.parquet has 9 rows: 0 measured" in outcome.out
    assert "9 of an earlier run" in outcome.out


def test_an_interrupted_sweep_says_how_to_go_on(sweep: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(design: Design, points: object) -> Measures:
        if design.columns == 20:
            raise KeyboardInterrupt
        return Measures(1.0, 1.0, 0.1, None, 0, 40.0)

    with monkeypatch.context() as patch:
        patch.setattr(crews, "measure", interrupted)
        outcome = sweep()
    assert outcome.code == 130
    assert "The rows that are done are in r.parquet.unfinished; the same command goes on from there." in outcome.err
    assert "r.parquet has 9 rows: 6 measured" in sweep().out
    assert not Path("r.parquet.unfinished").exists()


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (("-o", "r.csv"), 2, "r.csv: the name of a sweep's results ends in .parquet"),
        (("-o", "none/r.parquet"), 2, "there is no folder none"),
        (("--plot", "r.txt"), 2, "a picture's name ends in"),
        (("--on", "gpu"), 2, "a sweep runs on serial, threads, processes or an address"),
        (("--workers", "2"), 2, "2 workers have no effect on serial"),
        (("--on", "tcp://127.0.0.1:1"), 3, "no scheduler of Dask answers at tcp://127.0.0.1:1"),
    ],
)
def test_wrong_use(options: tuple[str, ...], code: int, says: str, sweep: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crews, "CONNECT_SECONDS", 0.3)
    outcome = sweep(*options)
    assert outcome.code == code
    assert says in outcome.err
    assert [path.name for path in Path().iterdir()] == ["arrays.toml"]


def test_one_design_is_not_drawn_and_not_measured_before_that_is_said(sweep: Run) -> None:
    Path("arrays.toml").write_text('source = "circle"\n[grid]\nseed = [1, 2]\n')
    outcome = sweep("--plot", "r.png")
    assert outcome.code == 2
    assert "0 fields differ between designs, seeds aside; 1 to 8 can be drawn" in outcome.err
    assert not Path("r.parquet").exists()
