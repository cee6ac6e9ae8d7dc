"""The paper's figures again. The numbers are recomputed here by themselves, from drives and pressures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from phasewire import ControlPoints, TransducerArray, pressure, solve
from phasewire.base.pictures import save_figure
from phasewire.cli.reproduce import figure_6_claims, figure_7_claims, range_claims
from phasewire.solver.reproduction import pictures
from phasewire.solver.reproduction.figures import (
    AtHeight,
    Rendering,
    Timing,
    reproduce_figure_4,
    reproduce_figure_6,
    reproduce_figure_7,
    reproduce_range,
)
from phasewire.solver.shapes.shapes import Star


@pytest.fixture(scope="module")
def panels() -> list[Rendering]:
    return reproduce_figure_6()


def test_figure_6_has_a_row_per_technique_and_a_column_per_shape(panels: list[Rendering]) -> None:
    assert [panel.technique + panel.shape for panel in panels] == [
        technique + shape for technique in ("A", "B", "C", "ours") for shape in "1234"
    ]
    assert [len(panel.points) for panel in panels[:4]] == [32, 30, 32, 21]


def test_its_numbers_are_those_of_the_pressures(panels: list[Rendering], array: TransducerArray) -> None:
    star = panels[5]
    points = Star().sample()
    drive = solve(array, points, "min_norm", output="phase", phases="power").drive
    np.testing.assert_allclose(np.abs(drive), 1)
    felt = np.abs(pressure(array, drive, points.positions))
    record = star.record()
    assert record["mean_pa"] == pytest.approx(felt.mean(), rel=1e-4)
    assert record["min_over_mean"] == pytest.approx(felt.min() / felt.mean(), rel=1e-4)
    assert record["deviation_over_mean"] == pytest.approx(felt.std() / felt.mean(), rel=1e-3)
    row, column = 40, 77
    at = [[star.field.x[column], star.field.y[row], 0.2]]
    exact = pressure(array, drive, at)[0]
    assert star.field.pressure[row, column] == pytest.approx(exact, abs=1e-4 * np.abs(star.field.pressure).max())


def test_the_claims_follow_from_the_numbers(panels: list[Rendering]) -> None:
    first, second, third = figure_6_claims(panels)
    assert "secondary maxima: reproduced" in first
    assert "0 ghosts" in third
    exchanged = {"C": "ours", "ours": "C"}
    twisted = [Rendering(exchanged.get(p.technique, p.technique), p.shape, p.points, p.field, p.report) for p in panels]
    assert "regular than B: reproduced" in figure_6_claims(twisted)[1]
    assert ("regular than B: NOT reproduced" in second) == (
        np.mean([p.report.spread for p in panels[8:12]]) >= 0.95 * np.mean([p.report.spread for p in panels[4:8]])
    )


def test_figure_7_times_every_technique_at_every_count() -> None:
    timings = reproduce_figure_7((1, 4), TransducerArray.grid(4, 4))
    assert {timing.technique for timing in timings} == {
        *("multiplex", "min_norm", "tikhonov", "wgs", "paper"),
        *("tikhonov two-sided", "wgs two-sided"),
    }
    assert all(0 < timing.seconds < 5 for timing in timings)
    assert {timing.points for timing in timings} == {1, 4}


def test_figure_7_s_claims_follow_from_the_times() -> None:
    times = {"paper": 2.0, "min_norm": 1.0, "tikhonov": 0.1, "wgs": 0.2}
    timings = [Timing(name, count, seconds * count) for name, seconds in times.items() for count in (32, 64)]
    slower = [Timing("wgs two-sided", 32, 2.2 * 0.2 * 32), Timing("wgs two-sided", 64, 1.9 * 0.2 * 64)]
    claims = figure_7_claims(timings + slower)
    assert "costs more than none: reproduced" in claims[0]
    assert "2.0 times at 64 points" in claims[0]
    assert "twice as long, less so for many points: reproduced (2.2 times at 32, 1.9 times at 64" in claims[1]
    faster = [Timing("wgs two-sided", 32, 8.0 * 32), Timing("wgs two-sided", 64, 9.0 * 64)]
    assert "twice as long, less so for many points: NOT reproduced" in figure_7_claims(timings + faster)[1]


def test_the_range_is_that_of_a_single_focus(array: TransducerArray) -> None:
    """Strength by hand: all waves in step at full drive. Width: that of a square aperture's sinc, to 15 per cent."""
    (at,) = reproduce_range((0.3,))
    by_hand = np.abs(pressure(array, solve(array, ControlPoints([[0, 0, 0.3]]), "multiplex").drive, [[0, 0, 0.3]]))[0]
    assert at.focus == pytest.approx(by_hand, rel=1e-3)
    assert at.width is not None
    assert at.width == pytest.approx(1.207 * 0.00858 * 0.3 / 0.206, rel=0.15)
    assert at.depth is not None
    assert at.depth > 5 * at.width


def test_the_range_s_claims_follow_from_the_numbers() -> None:
    def found(focus: float) -> list[AtHeight]:
        heights = np.linspace(0.05, 0.6, 12)
        return [AtHeight(h, 1000 / h if h > 0.2 else focus, 0.01, None, 100, -6) for h in heights.tolist()]

    quiet, loud = range_claims(found(10)), range_claims(found(1e6))
    assert "reciprocal of distance: reproduced (exponent -1.00" in quiet[0]
    assert "50 cm: reproduced for strength, which is largest at 25.0 cm (4000 Pa)" in quiet[1]
    assert "50 cm: NOT reproduced for strength, which is largest at 5.0 cm" in loud[1]


def test_figure_4_is_a_square_in_two_halves(array: TransducerArray) -> None:
    what = reproduce_figure_4()
    assert 1.6 < what.result.gain.mean < 2.3
    assert np.abs(what.points.positions[:, :2]).max() == pytest.approx(0.05, abs=1e-4)
    left, right = what.halves
    west = left.x < -0.02
    assert np.abs(left.pressure)[:, west].max() > 3 * np.abs(right.pressure)[:, west].max()
    row, column = 20, 20
    at = [[left.x[column], left.y[row], 0.2]]
    on, off = (abs(pressure(array, drive, at)[0]) ** 2 for drive in what.result.modulation.slots()[0])
    strongest = np.abs(what.two_sided.pressure).max()
    assert abs(what.two_sided.pressure[row, column]) == pytest.approx(
        np.sqrt(2 / np.pi * abs(on - off)), abs=1e-3 * strongest
    )


def test_the_pictures_are_drawn(panels: list[Rendering], tmp_path: Path) -> None:
    heights = [AtHeight(h, 1 / h, 0.01 if h < 0.3 else None, None, 1, -3) for h in (0.1, 0.2, 0.4)]
    figures = {
        "6": pictures.draw_figure_6(panels),
        "6oil": pictures.draw_figure_6(panels, "oil"),
        "7": pictures.draw_figure_7([Timing("wgs", 1, 1e-5), Timing("wgs", 2, 2e-5)], "nothing"),
        "range": pictures.draw_range(heights),
        "4": pictures.draw_figure_4(reproduce_figure_4()),
    }
    assert figures["6"].axes[0].get_title() == "1  two rings"
    assert len(figures["6"].axes) == 17
    for name, figure in figures.items():
        save_figure(figure, tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
