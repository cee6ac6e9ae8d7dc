"""The four ways: spectra of the intensity as theory has them, and which way is chosen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Circle, ControlPoints, Polyline, Rings, Star, TransducerArray, two_sided
from phasewire.protocol.quantise import quantise
from phasewire.solver import transfer_matrix
from phasewire.solver.rendering.cycle import MOST_FRAMES, Cycle, timing
from phasewire.solver.rendering.outline import Outline
from phasewire.solver.rendering.renderer import Renderer, render
from phasewire.solver.rendering.ways import Amplitude, Halves, Lateral, Spatiotemporal, chosen, parse_way, way_help

ARRAY = TransducerArray.grid()
POINT = ControlPoints([[0, 0, 0.2]])
RING = Circle(radius=0.02)
ANYWHERE = np.array([[0.1, -0.5, 0.45], [0.03, 0.02, 0.2], [-0.2, 0.1, 0.3], [0, 0.02, 0.2]])


def intensity(cycle: Cycle, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """|p|² in every frame, (k, m), as if the transducers followed at once."""
    return np.asarray(np.abs(cycle.drives @ transfer_matrix(ARRAY, at).T) ** 2)


def harmonics(course: NDArray[np.float64]) -> NDArray[np.float64]:
    """Amplitudes of a course's harmonics relative to its mean, (k // 2 + 1, m); 0 is the mean."""
    found = np.abs(np.fft.rfft(course, axis=0)) / len(course)
    return np.asarray(found / found[0] * np.where(np.arange(len(found)) == 0, 1, 2)[:, None])


@pytest.mark.parametrize(("way", "hertz"), [("am", 200), ("am:frequency=100", 100)])
def test_a_swelling_amplitude_makes_one_tone_everywhere(way: str, hertz: float) -> None:
    cycle = render(ARRAY, RING, way)
    assert 2 * cycle.frequency == hertz
    found = harmonics(intensity(cycle, ANYWHERE))
    assert found[2] == pytest.approx(1, abs=1e-3)  # of a cycle of two periods of the modulation
    assert np.delete(found, [0, 2], axis=0).max() < 1e-4


@pytest.mark.parametrize("way", ["am:envelope=square", "two-sided:envelope=square"])
def test_a_square_envelope_has_the_odd_harmonics_of_a_square_wave(way: str) -> None:
    cycle = render(ARRAY, RING, way)
    assert (len(cycle), cycle.periods, cycle.frequency) == (2, 200, 200)
    course = np.repeat(intensity(cycle, RING.sample().positions[:1]), cycle.hold, axis=0)
    found = harmonics(course)[:, 0]
    n = np.arange(1, 20, 2)
    assert found[n] / found[1] == pytest.approx(np.sin(np.pi / 200) / np.sin(n * np.pi / 200), rel=1e-4)
    assert found[2:20:2] == pytest.approx(0, abs=1e-4)


def test_two_sided_with_a_square_envelope_is_the_paper_s() -> None:
    frames, steps = render(ARRAY, RING, "two-sided:envelope=square").slots()
    wanted, same = two_sided(ARRAY, RING).modulation.slots()
    assert steps == same
    assert frames == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize("way", ["two-sided", "lm", "stm", "stm:foci=3"])
def test_a_steady_way_plays_pulses_of_one_width(way: str) -> None:
    """Neither the power of the array nor the duty of an output changes; only whole ticks of phase do."""
    cycle = render(ARRAY, Star(), way)
    assert np.abs(cycle.drives) == pytest.approx(1, abs=1e-5)
    pulses = quantise(cycle.drives)
    assert (pulses.width == 25).all()
    assert (pulses.phase % 2 == 1).all()


def test_lateral_modulation_keeps_its_strength_and_moves_across_its_line() -> None:
    line = ControlPoints([[-0.04, 0, 0.2], [0, 0, 0.2], [0.04, 0, 0.2]])
    cycle = render(ARRAY, line, Lateral(frequency=50, reach=0.003))
    assert cycle.frequency == 50
    places = np.stack([np.zeros(241), np.linspace(-0.006, 0.006, 241), np.full(241, 0.2)], axis=1)
    field = intensity(cycle, places)
    strongest = places[field.argmax(axis=1), 1]
    assert strongest == pytest.approx(0.003 * np.sin(2 * np.pi * (np.arange(200) + 0.5) / 200), abs=2e-4)
    assert np.ptp(field.max(axis=1)) < 0.05 * field.max()
    middle = harmonics(field[:, [120]])[:, 0]
    assert middle[2] > 20 * middle[1]  # the focus passes the middle twice in each period


def test_a_drawn_ring_is_passed_once_a_round() -> None:
    ring = Circle(radius=0.03)
    cycle = render(ARRAY, ring, Spatiotemporal(speed=7))
    assert cycle.frequency == pytest.approx(7 / (2 * np.pi * 0.03), rel=0.01)
    course = intensity(cycle, ring.sample().positions)
    assert (np.diff(np.sign(course - course.max(axis=0) / 2), axis=0) > 0).sum(axis=0).max() == 1
    order = course.argmax(axis=0)
    assert (np.diff(np.roll(order, -int(order.argmin()))) > 0).all()
    two = render(ARRAY, ring, Spatiotemporal(speed=7, foci=2))
    assert np.median(course.max(axis=0)) > 1.5 * np.median(intensity(two, ring.sample().positions).max(axis=0))


def test_a_slow_pointer_rests_at_corners_under_an_envelope() -> None:
    cycle = render(ARRAY, RING, "stm:speed=0.2,modulation=200")
    assert cycle.envelope == 200
    power = (np.abs(cycle.expanded(400)) ** 2).sum(axis=1)
    assert np.abs(np.fft.rfft(power))[1:].argmax() + 1 == 2  # 200 Hz in 10 ms


@given(st.floats(0.01, 1000), st.integers(2, MOST_FRAMES))
def test_a_cycle_has_the_frequency_that_whole_periods_allow(frequency: float, most: int) -> None:
    frames, hold = timing(frequency, most)
    assert 1 <= frames <= most
    assert abs(frames * hold - 40_000 / frequency) <= hold


@pytest.mark.parametrize(
    ("what", "way"),
    [(POINT, Lateral()), (RING, Spatiotemporal()), (Circle(radius=0.05), Halves()), (RING + Star(), Halves())],
)
def test_auto_chooses_by_its_rule(what: ControlPoints | Circle, way: object) -> None:
    assert chosen(Outline.of(what)) == way
    renderer = Renderer(ARRAY, "auto")
    assert renderer.way_for(Outline.of(what)) == way


def test_a_point_has_no_line_to_draw() -> None:
    assert (render(ARRAY, POINT, "stm").drives == render(ARRAY, POINT, "lm").drives).all()


def test_ways_are_read_from_text() -> None:
    assert parse_way("auto") is None
    assert parse_way("am:frequency=100,envelope=square") == Amplitude(100, "square")
    assert parse_way("stm:speed=5,foci=2") == Spatiotemporal(5, 2)
    for name in ("am:", "two-sided:", "lm:", "stm:"):
        assert name in way_help()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vibrate", "unknown way of rendering 'vibrate'; known are auto, am, two-sided, lm, stm"),
        ("am:speed=3", "am has no parameter 'speed'; it has envelope, frequency"),
        ("am:frequency=0", r"am frequency 0\.0 Hz must be from 0.01 to 1000 Hz"),
        ("am:envelope=saw", "am envelope 'saw' must be one of sine, square"),
        ("lm:reach=1", r"lm reach 1\.0 m must be from 0.0001 to 0.05 m"),
        ("stm:foci=0", "stm foci 0 must be a whole number from 1 to 16$"),
        ("stm:speed=nan", "stm speed nan m/s must be from 0.01 to 50 m/s"),
        ("stm:pause=x", "stm pause 'x' is not a number of seconds"),
    ],
)
def test_a_wrong_way_is_refused_with_what_is_right(text: str, words: str) -> None:
    with pytest.raises(ValueError, match="^" + words.replace("(", r"\(")):
        parse_way(text)


@pytest.mark.parametrize(
    ("what", "way"), [(Rings(), "stm"), (Polyline(((-0.03, 0, 0.2), (0.03, 0, 0.2))), "stm:foci=3")]
)
def test_phases_are_led_over_where_a_focus_jumps(what: Circle, way: str) -> None:
    drives = render(ARRAY, what, way).drives
    turned = np.abs(np.angle(drives * np.roll(drives, 1, axis=0).conj())).mean(axis=1)
    assert turned.max() < 0.35  # of a jump it would be π/2
