from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from phasewire import ControlPoints, Emulator, Solution, sample_plane
from phasewire.emulator.ports.capture import DRAWN_OUTPUTS
from phasewire.hil import run_end_to_end
from phasewire.hil.loop.picture import draw_waves, save_end_to_end_picture


def test_the_array_is_drawn_in_millimetres_and_degrees(sphere_solution: Solution) -> None:
    axes = Figure().subplots()
    sphere_solution.plot(axes)
    (dots,) = axes.collections
    assert isinstance(dots, PathCollection)
    np.testing.assert_allclose(np.asarray(dots.get_offsets()), sphere_solution.array.positions[:, :2] * 1000)
    np.testing.assert_allclose(np.asarray(dots.get_array()), np.degrees(np.angle(sphere_solution.drive)))
    assert dots.get_sizes().argmax() == np.abs(sphere_solution.drive).argmax()


def test_the_field_is_drawn_in_pascals_with_the_points_of_its_plane(sphere_solution: Solution) -> None:
    plane = sample_plane(sphere_solution.array, sphere_solution.drive, 0.2, extent=0.1, step=0.01)
    points = ControlPoints([[0.01, 0.02, 0.2], [0.01, 0.02, 0.3]])
    axes = Figure().subplots()
    plane.plot(axes, points=points)
    (image,) = axes.images
    np.testing.assert_allclose(np.asarray(image.get_array()), np.abs(plane.pressure))
    assert image.get_extent() == pytest.approx((-55, 55, -55, 55))
    (drawn,) = axes.lines
    np.testing.assert_allclose(np.asarray(drawn.get_xydata()), [[10, 20]])


def test_the_waves_are_the_captured_bits_in_microseconds(sphere_solution: Solution, emulator: Emulator) -> None:
    run = run_end_to_end(sphere_solution, emulator)
    axes = Figure().subplots()
    draw_waves(axes, run)
    assert len(axes.patches) == DRAWN_OUTPUTS
    first = run.ack.commit_period * 50
    topmost = axes.patches[0]
    assert isinstance(topmost, StepPatch)
    values, edges, _ = topmost.get_data()
    assert (edges[0], edges[50], edges[-1]) == (-25, 0, 50)
    np.testing.assert_array_equal(values > values.min(), run.capture.channels(first - 50, first + 100)[:, 0] == 1)
    assert (axes.get_ylabel(), axes.get_yticklabels()[0].get_text()) == ("board, processor, bit", "0, 0, 0")
    assert axes.get_yticklabels()[-1].get_text() == "4, 1, 31"


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_pictures_are_written_in_the_format_of_their_name(
    sphere_solution: Solution, emulator: Emulator, tmp_path: Path, suffix: str, magic: bytes
) -> None:
    run = run_end_to_end(sphere_solution, emulator)
    plane = sample_plane(sphere_solution.array, run.rebuilt, 0.2, step=0.01)
    path = tmp_path / f"p{suffix}"
    save_end_to_end_picture(path, run, plane, "headline")
    assert path.read_bytes().startswith(magic)
