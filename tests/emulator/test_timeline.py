"""The picture of an update's way, against the times of chapter BUD."""

from __future__ import annotations

import random

import pytest
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from phasewire import Emulator
from phasewire.emulator.timeline import draw_timeline, way_of_an_update
from phasewire.emulator.trace import Span
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.time_line import one_update

BEGINS = 24_000  # cycles: 60 µs, in period 2


def bars(axes: Axes) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """Where bars begin and end, in µs, by the number beside the lane and the name in the legend."""
    numbers = dict(zip(axes.get_yticks().tolist(), [text.get_text() for text in axes.get_yticklabels()], strict=True))
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for kind in axes.containers:
        for bar in kind.get_children():
            assert isinstance(bar, Rectangle)
            number = numbers[round(bar.get_y() + bar.get_height() / 2, 9)]
            found.setdefault((str(kind.get_label()), number), []).append((bar.get_x(), bar.get_x() + bar.get_width()))
    return found


@pytest.mark.parametrize(("link", "best_us", "boundary_us"), [(FIVE_WIRE, 52.715, 65), (TWO_WIRE, 73.115, 90)])
def test_an_update_takes_the_times_of_the_specification(link: Link, best_us: float, boundary_us: float) -> None:
    """Clause BUD-003; the boundary is the next multiple of 25 µs, less the 60 µs at which the packet began."""
    (axes,) = draw_timeline(one_update(link, BEGINS)).axes
    found = bars(axes)
    assert found["packet", ""][0] == pytest.approx((0, 9.615))
    assert found["sort", ""][0] == pytest.approx((9.615, 27.115))
    assert max(ends for node in range(10) for _, ends in found["rasterise", str(node)]) == pytest.approx(best_us)
    for node in range(10):
        assert len(found["slice", str(node)]) == len(found["commit", str(node)]) == 10 - node
        assert found["plays", str(node)][0] == pytest.approx((boundary_us, boundary_us + 25))


def test_messages_pass_the_links_one_switch_apart() -> None:
    """Clause BUD-002: 1.04 µs for a slice on 5-wire links, 0.1 µs a switch; the last slice is the tenth."""
    (axes,) = draw_timeline(one_update(FIVE_WIRE, BEGINS)).axes
    last_slice = [sorted(bars(axes)["slice", str(link)])[-1] for link in range(10)]
    for link, (begins, ends) in enumerate(last_slice):
        assert begins == pytest.approx(27.115 + 9 * 1.04 + 0.1 * link)
        assert ends - begins == pytest.approx(1.04)


def test_lanes_stand_together_in_order_whatever_the_order_of_spans() -> None:
    spans = one_update(FIVE_WIRE, BEGINS)
    random.Random(1).shuffle(spans)
    figure = draw_timeline(spans)
    (axes,) = figure.axes
    digits = [str(number) for number in range(10)]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["", "", *digits * 4]
    named = {text.get_text(): text.xy[1] for text in axes.texts if hasattr(text, "xy")}
    groups = ["USB", "controller", "link", "mailbox", "processor", "port"]
    assert sorted((name for name in named if name in groups), key=named.__getitem__) == groups


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE])
def test_a_device_handles_an_update_as_the_specification_says(link: Link) -> None:
    """Period 0 begins when the device comes up; enabling it takes no time."""
    assert way_of_an_update(Emulator(link=link)) == sorted(one_update(link, 0))


@pytest.mark.parametrize("spans", [[], [Span(5, 5, "USB", "packet")]])
def test_an_empty_picture_is_refused(spans: list[Span]) -> None:
    with pytest.raises(ValueError, match="without a span that takes time"):
        draw_timeline(spans)
