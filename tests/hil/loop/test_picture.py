from __future__ import annotations

import numpy as np
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from phasewire import Emulator, Solution
from phasewire.emulator.ports.capture import DRAWN_OUTPUTS
from phasewire.hil import run_end_to_end
from phasewire.hil.loop.picture import draw_waves


def test_the_array_is_drawn_in_millimetres_and_degrees(sphere_solution: Solution) -> None:
    axes = Figure().subplots()
    sphere_solution.plot(axes)
    (dots,) = axes.collections
    assert isinstance(dots, PathCollection)
    np.testing.assert_allclose(np.asarray(dots.get_offsets()), sphere_solution.array.positions[:, :2] * 1000)
    np.testing.assert_allclose(np.asarray(dots.get_array()), np.degrees(np.angle(sphere_solution.drive)))
    assert dots.get_sizes().argmax() == np.abs(sphere_solution.drive).argmax()


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
