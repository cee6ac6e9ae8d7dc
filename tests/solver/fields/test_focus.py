from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from phasewire import ControlPoints, Medium, TransducerArray, pressure, solve
from phasewire.solver.acoustics.propagation import transfer_matrix
from phasewire.solver.fields import focus as module
from phasewire.solver.fields.focus import GHOST, FocusReport, focus_report
from phasewire.solver.fields.grid import Grid

AIR = Medium()
ARRAY = TransducerArray.grid(10, 10)


def lone(array: TransducerArray, at: tuple[float, float, float]) -> np.ndarray:
    """The drive that focuses on one point, every transducer at full drive."""
    return np.asarray(np.exp(-1j * np.angle(transfer_matrix(array, [at])[0])))


def look(drive: np.ndarray, points: ControlPoints, array: TransducerArray = ARRAY) -> FocusReport:
    """A report from a coarse plane, for speed."""
    grid = Grid.along("xy", points.positions.mean(axis=0), 0.16, 2.1e-3)
    return focus_report(array, drive, points, grid=grid)


def test_a_square_array_s_focus_is_as_wide_as_the_sinc() -> None:
    """Far away, |p| ∝ sinc(x·L/(λz)) with L = n·pitch, which is 1/2 at x = 0.60335·λz/L."""
    array, z = TransducerArray.grid(16, 8, 5e-3), 0.6
    report = look(lone(array, (0, 0, z)), ControlPoints([[0, 0, z]]), array)
    along_x, along_y, _ = report.foci[0].width
    assert along_x == pytest.approx(2 * 0.60335 * AIR.wavelength * z / (16 * 5e-3), rel=0.02)
    assert along_y == pytest.approx(2 * 0.60335 * AIR.wavelength * z / (8 * 5e-3), rel=0.02)


def test_along_the_beam_a_focus_is_as_long_as_the_pressure_says() -> None:
    at = (0.0, 0.0, 0.12)
    drive = lone(ARRAY, at)
    width = look(drive, ControlPoints([at])).foci[0].width[2]
    z = np.linspace(0.02, 0.5, 4801)
    magnitude = np.abs(pressure(ARRAY, drive, np.stack([0 * z, 0 * z, z], axis=1)))
    at_focus = np.abs(pressure(ARRAY, drive, [at]))[0]
    above = z[magnitude >= at_focus / 2]
    assert width == pytest.approx(above.max() - above.min(), abs=2e-4)


def test_a_lone_focus_is_at_its_point_without_ghosts() -> None:
    at = (0.01, -0.02, 0.15)
    report = look(lone(ARRAY, at), ControlPoints([at]))
    (focus,) = report.foci
    assert focus.pressure == pytest.approx(np.abs(pressure(ARRAY, lone(ARRAY, at), [at]))[0], rel=1e-4)
    assert focus.pressure <= focus.peak < 1.02 * focus.pressure
    assert np.hypot(*focus.offset[:2]) < 1.5e-3
    assert focus.offset[2] == 0
    assert (report.missing, report.ghosts, report.nulls, report.spread) == ((), (), (), 0)


def test_an_unwanted_focus_is_a_ghost() -> None:
    wanted, unwanted = (-0.03, 0.0, 0.15), (0.03, 0.01, 0.15)
    report = look(0.5 * lone(ARRAY, wanted) + 0.35 * lone(ARRAY, unwanted), ControlPoints([wanted]))
    assert len(report.ghosts) == 1
    ghost = report.ghosts[0]
    assert ghost == report.strongest_lobe
    np.testing.assert_allclose(ghost.position, unwanted, atol=1.5e-3)
    assert ghost.pressure == pytest.approx(0.7 * report.mean, rel=0.1)
    assert ghost.level == pytest.approx(20 * np.log10(ghost.pressure / report.mean))
    weaker = look(0.5 * lone(ARRAY, wanted) + 0.175 * lone(ARRAY, unwanted), ControlPoints([wanted]))
    assert weaker.ghosts == ()
    assert weaker.strongest_lobe is not None
    assert weaker.strongest_lobe.pressure < GHOST * weaker.mean


def test_a_point_without_pressure_is_missing() -> None:
    points = ControlPoints([[-0.04, 0, 0.15], [0.04, 0, 0.15], [0, 0.05, 0.15]])
    drive = (lone(ARRAY, (-0.04, 0, 0.15)) + lone(ARRAY, (0.04, 0, 0.15))) / 2
    report = look(drive, points)
    assert [focus.index for focus in report.missing] == [2]
    assert report.spread > 0.3


def test_a_point_that_should_be_weak_is_not_missing() -> None:
    points = ControlPoints([[-0.03, 0, 0.15], [0.03, 0, 0.15]], [1, 0.2])
    report = look(solve(ARRAY, points).drive, points)
    assert report.foci[1].pressure < 0.5 * report.mean
    assert report.missing == ()
    assert report.spread < 0.05


def test_nulls_have_a_depth() -> None:
    at, quiet = (0.0, 0.0, 0.15), (0.03, 0.0, 0.15)
    drive = lone(ARRAY, at)
    report = look(drive, ControlPoints([quiet, at], [0, 1]))
    loud, low = np.abs(pressure(ARRAY, drive, [at, quiet]))
    assert [focus.index for focus in report.foci] == [1]
    (null,) = report.nulls
    assert (null.index, null.position) == (0, quiet)
    assert null.level == pytest.approx(20 * np.log10(low / loud), abs=0.05)


def test_the_slope_of_a_focus_outside_the_grid_is_no_lobe() -> None:
    drive = (lone(ARRAY, (0, 0, 0.15)) + lone(ARRAY, (0.045, 0, 0.15))) / 2
    grid = Grid.along("xy", (0, 0, 0.15), 0.08, 2e-3)  # ends 5 mm before the second focus
    assert focus_report(ARRAY, drive, ControlPoints([[0, 0, 0.15]]), grid=grid).ghosts == ()


def test_silence_has_no_foci_but_a_report() -> None:
    points = ControlPoints([[0, 0, 0.15], [0.02, 0, 0.15], [0, 0.02, 0.15]], [1, 1, 0])
    report = look(np.zeros(100), points)
    assert len(report.missing) == 2
    assert report.strongest_lobe is None
    json.dumps(report.record(), allow_nan=False)


def test_points_at_different_heights_are_looked_at_in_a_box() -> None:
    points, array = ControlPoints([[-0.02, 0, 0.06], [0.02, 0, 0.09]]), TransducerArray.grid(4, 4)
    report = focus_report(array, lone(array, (-0.02, 0, 0.06)), points)
    # The points (40 mm along x, 30 mm along z) and the array (31 mm along y) and 20 mm on each side, in whole steps.
    assert report.searched.startswith("a box of 79 × 69 × 69 mm around (0.0, 0.0, 75.0) mm")


def test_by_default_array_and_points_are_searched() -> None:
    array = TransducerArray.grid(4, 3)
    report = focus_report(array, lone(array, (0.05, 0, 0.1)), ControlPoints([[0.05, 0, 0.1]]))
    # The array reaches from −15.45 to 15.45 mm along x, the point lies at 50 mm; 20 mm are added on both sides.
    assert report.searched.startswith("a plane of 103 × 58 mm around (17.3, 0.0, 100.0) mm, every 1.72 mm")


def test_the_record_is_json_and_the_summary_says_it() -> None:
    points = ControlPoints([[-0.03, 0, 0.15], [0.03, 0, 0.15], [0, 0.03, 0.15]], [1, 1, 0])
    report = look(0.5 * lone(ARRAY, (-0.03, 0, 0.15)) + 0.35 * lone(ARRAY, (0, -0.04, 0.15)), points)
    record = json.loads(json.dumps(report.record(), allow_nan=False))
    assert record["missing"] == [1]
    assert record["ghosts"][0]["pressure"] == report.ghosts[0].pressure
    assert record["foci"][0]["width"] == list(report.foci[0].width)
    summary = report.summary()
    for words in ("2 foci:", "missing: 1\n", f"ghosts: {len(report.ghosts)} (", "1 null:"):
        assert words in summary


def test_widths_that_do_not_end_are_none() -> None:
    array = TransducerArray.grid(2, 1)
    report = look(np.ones(2), ControlPoints([[0, 0, 0.012]]), array)
    assert report.foci[0].width[1] is None
    assert "y unknown" in report.summary()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"grid": Grid.along("xy", (0, 0, 0.15), 0.1, 3e-3)}, "a step of 0.003 m misses lobes; at most a quarter"),
        ({"points": ControlPoints([[0, 0, -0.1]])}, "control point 0 at .* is on the array or behind it"),
        ({"drive": np.ones(3)}, r"drive has the shape \(3,\)"),
    ],
)
def test_impossible_reports_are_named(arguments: dict[str, Any], message: str) -> None:
    plain: dict[str, Any] = {"array": ARRAY, "drive": np.ones(100), "points": ControlPoints([[0, 0, 0.15]])}
    with pytest.raises(ValueError, match=message):
        focus_report(**(plain | arguments))


def test_points_far_apart_in_height_are_searched_slab_by_slab(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ghost at any place is found only once with any slabs."""
    monkeypatch.setattr(module, "SEARCH_MARGIN", 0.005)
    small = TransducerArray.grid(6, 6)
    points = ControlPoints([[0, 0, 0.06], [0.004, 0, 0.11]])
    drive = lone(small, (-0.02, 0.0, 0.085))  # strong between the points
    whole = focus_report(small, drive, points)
    monkeypatch.setattr(module, "MAX_SAMPLES", 15_000)
    assert len(module._surroundings(small, points, AIR)) > 2
    parts = focus_report(small, drive, points)
    assert whole.ghosts
    assert len(parts.ghosts) == len(whole.ghosts)
    for one, other in zip(parts.ghosts, whole.ghosts, strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=1e-4)
    assert parts.searched == whole.searched
    monkeypatch.setattr(module, "MAX_SEARCHED", 1000)
    with pytest.raises(ValueError, match="at most 1000 are searched: give a grid"):
        focus_report(small, drive, points)
