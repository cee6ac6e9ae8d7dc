from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from phasewire import Hand, Mesh
from phasewire.emulator.trace import Span
from phasewire.hil.loop.touch_latency import STAGES, TouchLatency, draw_touch_latency, measure_touch_latency
from phasewire.protocol.timing import FIVE_WIRE, PACKET_CYCLES, Budget
from phasewire.solver.contact.touch import Toucher


@pytest.fixture(scope="module")
def latency() -> TouchLatency:
    return measure_touch_latency([Hand.flat((0, -0.02, 0.19))], [Mesh.cube()], Toucher(), poses=5)


def test_the_device_takes_what_the_budget_says(latency: TouchLatency) -> None:
    budget = Budget.of(FIVE_WIRE)
    assert budget.best_cycles <= latency.first_tick * 400e6 <= budget.worst_cycles
    packet = next(row for row in latency.rows() if row.where == "USB")
    assert (packet.ends - packet.begins) * 400e6 == pytest.approx(PACKET_CYCLES, abs=2)


def test_the_record_is_json_with_the_parts_of_the_total(latency: TouchLatency) -> None:
    record = json.loads(json.dumps(latency.record(), allow_nan=False))
    assert list(record["stages"]) == list(STAGES)
    assert record["total"]["worst_s"] <= sum(stage["worst_s"] for stage in record["stages"].values()) + 1e-3
    assert record["total"]["median_s"] > record["first_tick_s"]


def test_the_picture_has_a_bar_for_each_stage_in_microseconds() -> None:
    host = np.array([[100e-6, 200e-6, 30e-6, 70e-6]])
    kinds = ("packet", "sort", "slice 0", "commit 0", "rasterise", "waits", "plays")
    device = tuple(Span(4000 * i, 4000 * (i + 1), "lane", kind) for i, kind in enumerate(kinds))
    figure = draw_touch_latency(TouchLatency(host, device, 7))
    assert isinstance(figure, Figure)
    (axes,) = figure.axes
    bars = [(bar.get_x(), bar.get_width()) for bar in axes.patches if isinstance(bar, Rectangle)]
    np.testing.assert_allclose(
        bars, [(0, 100), (100, 200), (300, 30), (330, 70), (400, 10), (410, 10), (420, 20), (440, 10), (450, 10)]
    )
    assert "0.46 ms median" in figure.get_suptitle()


def test_hands_that_touch_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="no hand touches an object"):
        measure_touch_latency([Hand.flat((0, 0, 0.5))], [Mesh.cube()], Toucher(), poses=1)
