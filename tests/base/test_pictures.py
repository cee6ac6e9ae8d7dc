"""Every picture that the project makes, judged as it is printed. A new picture is a line of `PICTURES`."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot, rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from phasewire import (
    Capture,
    Circle,
    ControlPoints,
    Emulator,
    Grid,
    Hand,
    Mesh,
    Outline,
    PlaneField,
    TransducerArray,
    compare_fields,
    focus_report,
    render,
    sample_plane,
    sample_volume,
    solve,
    touch,
)
from phasewire.base.pictures import COLUMN, LANDSCAPE, SKIN, new_figure, printed, save_figure
from phasewire.cli.budget import draw_budget
from phasewire.emulator.timeline import draw_timeline, way_of_an_update
from phasewire.feel.drawing import draw_intensity
from phasewire.feel.pictures import save_felt_picture
from phasewire.feel.unfolding import Unfolded
from phasewire.hil.loop.end_to_end import run_end_to_end
from phasewire.hil.loop.picture import save_end_to_end_picture
from phasewire.hil.loop.sensing import Sensation, sense, skin_over
from phasewire.hil.loop.sensing_picture import save_sensation_picture
from phasewire.hil.loop.touch_latency import draw_touch_latency, measure_touch_latency
from phasewire.hil.loop.touch_picture import save_touch_picture
from phasewire.hil.study.picture import draw_study
from phasewire.hil.sweep.design import FIELDS
from phasewire.hil.sweep.measures import MEASURES
from phasewire.hil.sweep.picture import draw_sweep
from phasewire.hil.sweep.results import Results
from phasewire.protocol.timing import LINKS, Budget
from phasewire.solver import two_sided
from phasewire.solver.contact.touch import Toucher
from phasewire.solver.fields.drawing import OIL
from phasewire.solver.fields.quantities import QUANTITIES
from phasewire.solver.pictures.picture import save_field_picture
from phasewire.solver.reproduction.figures import (
    Timing,
    reproduce_figure_4,
    reproduce_figure_6,
    reproduce_range,
)
from phasewire.solver.reproduction.pictures import draw_figure_4, draw_figure_6, draw_figure_7, draw_range
from phasewire.solver.shapes.shapes import Star

from tests.cli.test_study import made_up
from tests.pictures import faults_of

ROOT = Path(__file__).parents[2]
PNG, PALETTE = b"\x89PNG\r\n\x1a\n", 3
FILE = Path("picture.png")
ARRAY = TransducerArray.grid()
HAND, CUBE = Hand.flat((0, -0.02, 0.19)), Mesh.cube()


def field(quantity: str) -> None:
    points = Star().sample()
    save_field_picture(FILE, sample_plane(ARRAY, solve(ARRAY, points).drive, 0.2), points, quantity)


def star(method: str) -> PlaneField:
    return sample_plane(ARRAY, solve(ARRAY, Star(), method).drive, 0.2)


def volume() -> Axes:
    box = Grid.along("xyz", (0, 0, 0.2), 0.1, 5e-3)
    return sample_volume(ARRAY, solve(ARRAY, Star()).drive, box).plot(points=Star())


def played() -> Capture:
    with Emulator() as emulator:
        return run_end_to_end(solve(ARRAY, [[0.02, 0, 0.2]]), emulator).capture


def subplots(*draw: Callable[[Axes], object]) -> Figure:
    """As a notebook makes them, without a layout engine."""
    figure, grid = pyplot.subplots(1, len(draw), figsize=(9, 4))
    for axes, onto in zip(grid, draw, strict=True):
        onto(axes)
    return figure


def demo() -> None:
    with Emulator() as emulator:
        run = run_end_to_end(solve(ARRAY, ControlPoints([[0.02, 0, 0.2]])), emulator)
    headline = "phasewire demo: a sphere of 10 cm on a palm at 20 cm. PASS: the rebuilt drive is the intended one"
    save_end_to_end_picture(FILE, run, sample_plane(ARRAY, run.rebuilt, 0.2), headline)


def touched() -> None:
    felt = touch(HAND, CUBE)
    assert felt.points is not None
    source = "the bits that emulated boards play for the pulses that were sent"
    save_touch_picture(FILE, [HAND], [CUBE], felt, two_sided(ARRAY, felt.points).modulation, ARRAY, source)


@cache
def sensed(name: str) -> Sensation:
    outline = Outline.of(Circle(radius=0.02))
    return sense(render(ARRAY, outline, name), skin_over(outline))


def felt(ways: int) -> None:
    """By no way the felt map alone, by some how they compare."""
    if ways == 0:
        save_felt_picture(FILE, sensed("stm").felt, "A circle of 4 cm, as emulated boards emit it")
    else:
        found = {name: sensed(name) for name in ("two-sided:envelope=square", "am", "lm", "stm")[:ways]}
        save_sensation_picture(FILE, found, "circle:radius=0.02: felt and heard, by the bits of emulated boards")


def swept() -> Figure:
    """Every field with a number and two texts, as many as can be drawn; a row has a problem."""
    rows = 4 * 200
    columns: dict[str, list[object]] = {name: [None] * rows for name in FIELDS}
    for number, name in enumerate(("columns", "pitch_mm", "tolerance_mm", "temperature_c", "phase_error_deg", "seed")):
        columns[name] = [row // (number + 1) % (3 + number) for row in range(rows)]
    columns["quantisation"] = [("none", "pulses", "4")[row % 3] for row in range(rows)]
    columns["method"] = [("wgs", "min_norm", "multiplex", "tikhonov")[row % 4] for row in range(rows)]
    rng = np.random.default_rng(0)
    columns |= {name: (1000 * rng.random(rows)).tolist() for name in MEASURES}
    columns["problem"] = [None] * (rows - 1) + ["LinAlgError: Singular matrix"]
    columns["strength_pa"][-1] = None
    return draw_sweep(Results("", columns), "A sweep of made-up numbers")


def figure_7() -> Figure:
    names = ("multiplex", "min_norm", "tikhonov", "tikhonov two-sided", "wgs", "wgs two-sided", "paper")
    times = [Timing(name, 2**n, 1e-5 * (1 + at) * 2**n) for at, name in enumerate(names) for n in range(10)]
    return draw_figure_7(times, "x86_64, 2 cores")


PICTURES: dict[str, tuple[Callable[[], object], float]] = {
    **{quantity: (partial(field, quantity), COLUMN) for quantity in (*QUANTITIES, OIL)},
    **{f"budget {name}": (partial(draw_budget, Budget.of(link)), COLUMN) for name, link in LINKS.items()},
    "array": (lambda: ARRAY.plot(), COLUMN),
    "capture": (lambda: played().plot(), COLUMN),
    "comparison": (lambda: compare_fields({name: star(name) for name in ("wgs", "tikhonov")})[0], LANDSCAPE),
    "demo": (demo, LANDSCAPE),
    "foci": (lambda: focus_report(ARRAY, solve(ARRAY, Star()).drive, Star()).plot(), COLUMN),
    "halves": (lambda: two_sided(ARRAY, Star()).plot(), COLUMN),
    "plane": (lambda: star("wgs").plot(), COLUMN),
    "points": (lambda: (Star().sample() + ControlPoints([[0, 0, 0.2]], 0.5)).plot(), COLUMN),
    "solution": (lambda: solve(ARRAY, Star()).plot(), COLUMN),
    "spectrum": (lambda: played().plot_spectrum(), COLUMN),
    "volume": (volume, COLUMN),
    "subplots": (lambda: subplots(solve(ARRAY, Star()).plot, star("wgs").plot), LANDSCAPE),
    "subplots of a capture": (lambda: subplots(star("wgs").plot, played().plot), LANDSCAPE),
    "felt": (lambda: felt(0), LANDSCAPE),
    **{f"felt, ways: {ways}": (partial(felt, ways), LANDSCAPE) for ways in (1, 2, 3, 4)},
    "figure 4": (lambda: draw_figure_4(reproduce_figure_4()), COLUMN),
    "figure 6": (lambda: draw_figure_6(reproduce_figure_6()), COLUMN),
    "figure 6, oil": (lambda: draw_figure_6(reproduce_figure_6(), OIL), COLUMN),
    "figure 7": (figure_7, COLUMN),
    "range": (lambda: draw_range(reproduce_range()), COLUMN),
    **{
        name: (partial(runpy.run_path, str(ROOT / "examples" / f"{name}.py")), width)
        for name, width in (("ring_up", COLUMN), ("button_panel", LANDSCAPE), ("mesh_in_hand", LANDSCAPE))
    },
    "sweep": (swept, LANDSCAPE),
    "study": (lambda: draw_study(made_up()), COLUMN),
    "timeline": (lambda: draw_timeline(way_of_an_update(Emulator()), "One update"), LANDSCAPE),
    "touch": (touched, LANDSCAPE),
    "touch latency": (lambda: draw_touch_latency(measure_touch_latency([HAND], [CUBE], Toucher(), poses=5)), COLUMN),
}
"""What makes each picture, and the width of its paper: a function that returns a figure or axes, or saves a figure."""


@pytest.mark.slow
@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_can_be_read(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    saved: list[Figure] = []

    def save(figure: Figure, *_: object, **__: object) -> None:
        saved.append(figure)

    monkeypatch.setattr(Figure, "savefig", save)
    make, width = PICTURES[name]
    made = make()
    pyplot.close("all")
    figure = made.figure if isinstance(made, Axes) else made if isinstance(made, Figure) else saved[0]
    assert isinstance(figure, Figure)
    assert faults_of(figure, width) == []


def test_a_notebook_shows_a_picture_without_pyplot() -> None:
    for shown in (ARRAY, Star(), star("wgs")):
        assert (shown._repr_png_() or b"").startswith(PNG)
    assert pyplot.get_fignums() == []


def test_what_is_plotted_lands_on_the_axes_that_are_given() -> None:
    axes = Figure().subplots()
    assert ARRAY.plot(axes) is axes
    assert pyplot.get_fignums() == []
    ARRAY.plot()
    assert len(pyplot.get_fignums()) == 1
    pyplot.close("all")


@pytest.mark.parametrize(
    "draw",
    [
        lambda: ARRAY.plot,
        lambda: solve(ARRAY, Star()).plot,
        lambda: Star().plot,
        lambda: two_sided(ARRAY, Star()).plot,
        lambda: focus_report(ARRAY, solve(ARRAY, Star()).drive, Star()).plot,
        lambda: star("wgs").plot,
        lambda: played().plot,
        lambda: played().plot_spectrum,
    ],
)
def test_a_title_and_options_of_matplotlib_are_taken(draw: Callable[[], Callable[..., Axes]]) -> None:
    axes = draw()(Figure().subplots(), title="Mine", alpha=0.25)
    assert axes.get_title() == "Mine"
    assert 0.25 in [each.get_alpha() for each in axes.get_children()]


def test_halves_and_facing_panels_are_told_apart() -> None:
    legend = two_sided(ARRAY, Star()).plot(Figure().subplots()).get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["first half", "second half"]
    facing = TransducerArray.joined([ARRAY, ARRAY.rotated(180, (1, 0, 0)).moved((0, 0, 0.3))])
    axes = facing.plot(Figure().subplots())
    assert axes.get_xlabel() == "x / mm (larger dots look down)"
    assert [len(np.asarray(dots.get_offsets())) for dots in axes.collections] == [320, 320]


def test_fields_are_compared_on_one_scale() -> None:
    fields = {name: star(name) for name in ("wgs", "tikhonov")}
    left, right = compare_fields(fields)
    pyplot.close("all")
    loudest = max(np.abs(field.pressure).max() for field in fields.values())
    assert left.images[0].get_clim() == right.images[0].get_clim() == pytest.approx((0, loudest))
    assert (left.get_title(), right.get_title()) == ("wgs", "tikhonov")


def test_threads_that_draw_leave_the_user_s_settings_alone(tmp_path: Path) -> None:
    settings: Any = rcParams
    before, seen, points = dict(settings), list[dict[str, object]](), Star().sample()

    def draw(number: int) -> None:
        figure = new_figure(1, 1)
        figure.subplots().set_title("Title")
        save_figure(figure, tmp_path / f"{number}.png")
        points._repr_png_()

    with ThreadPoolExecutor(8) as pool:
        drawn = [pool.submit(draw, number) for number in range(8)]
        while wait(drawn, timeout=0.02).not_done:
            seen.append(dict(settings))
    assert [each.result() for each in drawn] == [None] * 8
    assert dict(settings) == before
    assert all(each == before for each in seen)


@pytest.mark.parametrize("settings", [{}, {"font.size": 20.0, "axes.titlesize": 30.0, "figure.titlesize": "small"}])
def test_text_has_its_size_on_paper_whatever_the_user_s_settings_are(settings: Any) -> None:
    with rc_context(settings):
        figure = new_figure(2)
        axes = figure.subplots()
        axes.plot([0, 1], label="line")
        axes.set(title="Title", xlabel="x / mm")
        axes.tick_params("y", labelsize="small")
        legend, headline = axes.legend(fontsize="small"), figure.suptitle("Headline")
        printed(printed(figure)).draw_without_rendering()
    texts = (
        axes.title,
        axes.xaxis.label,
        *axes.get_xticklabels(),
        *axes.get_yticklabels(),
        *legend.get_texts(),
        headline,
    )
    usual, small = [8.5] * (2 + len(axes.get_xticklabels())), [8.5 * 0.833] * (len(axes.get_yticklabels()) + 1)
    assert [each.get_fontsize() for each in texts] == pytest.approx([*usual, *small, 8.5 * 1.2])


def test_a_felt_map_shows_what_is_felt_from_the_threshold_on() -> None:
    skin = Unfolded.of(Hand.flat())
    intensity = np.linspace(0.5, 8, len(skin.positions))
    axes = Figure().subplots()
    image = draw_intensity(axes, skin, intensity)
    shown = np.asarray(image.get_array())
    np.testing.assert_array_equal(shown[skin.mask], intensity)
    assert np.isfinite(shown).all()
    assert image.get_clim() == (1, 8)
    unfelt, felt = (to_hex(tuple(colour)) for colour in image.to_rgba(np.array([0.99, 1.01])))
    assert unfelt == SKIN != felt
    assert axes.get_legend_handles_labels()[1] == ["skin, laid out", "threshold: felt inside"]


def test_the_judge_finds_faults() -> None:
    figure = Figure(figsize=(7, 4))
    axes = figure.subplots()
    axes.set_title("a title that is far too long for its figure " * 5)
    axes.text(0.5, 0.5, "one")
    axes.text(0.5, 0.5, "other", fontsize=5)
    image = axes.imshow(np.arange(9).reshape(3, 3), cmap="inferno")
    image.set_cmap(image.get_cmap().resampled(8))
    figure.colorbar(image, label="loudness")
    axes.imshow([[0, 1]], cmap="gray")
    found = "; ".join(faults_of(figure))
    for fault in (
        "' is cut",
        "'other': 4.2 pt",
        "'one' overlaps 'other'",
        "no unit",
        "few colours",
        "gray have no bar",
    ):
        assert fault in found
    figure.set_size_inches(14, 8)
    assert "'one': 4.3 pt" in "; ".join(faults_of(figure))


def test_no_committed_picture_is_reduced_to_a_palette() -> None:
    """PNG, chapter 11.2.1: the colour type is byte 25."""
    pictures = [path.read_bytes() for path in (ROOT / "docs").glob("**/*.png")]
    assert len(pictures) > 5
    assert all(picture.startswith(PNG) and picture[25] != PALETTE for picture in pictures)
