"""Arguments of a wrong type: each error says what was given and what would be right."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import phasewire as pw
import pytest
from matplotlib import pyplot

pw_: Any = pw  # whose types are what is wrong here
ARRAY, SHAPE = pw.TransducerArray.grid(4, 3), pw.Circle(0.01, 0.1)


@cache
def solution() -> pw.Solution:
    return pw.solve(ARRAY, SHAPE)


@cache
def field() -> pw.PlaneField:
    return pw.sample_plane(ARRAY, solution().drive, 0.1, 0.04, 2e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pw_.solve(None, SHAPE), r"array is None; it must be a TransducerArray, such as TransducerArray\.grid"),
        (lambda: pw_.solve(SHAPE, ARRAY), r"array is Circle\(.*; it must be a TransducerArray"),
        (lambda: pw_.solve_frames(None, [SHAPE]), "array is None"),
        (lambda: pw_.two_sided(SHAPE, ARRAY), "array is Circle"),
        (lambda: pw_.pressure(solution().drive, ARRAY, SHAPE), "array is array"),
        (lambda: pw_.sample_plane(solution().drive, ARRAY, 0.2), "array is array"),
        (lambda: pw_.focus_report(None, solution().drive, SHAPE), "array is None"),
        (lambda: pw_.PlanePropagator("a", 0.2), "array is 'a'"),
        (lambda: pw_.solve(ARRAY, ARRAY), "a TransducerArray has no control points; it is the first argument"),
        (lambda: pw_.solve(ARRAY, "circle:x=0.01"), r"not 'circle:x=0\.01'; parse_shape\('circle:x=0\.01'\) makes"),
        (lambda: pw_.solve(ARRAY, [SHAPE, pw.Star()]), r"are one if they are added, as in Circle\(\) \+ Star\(\)"),
        (lambda: pw_.solve(ARRAY, [0, 0, 0.2]), r"write \[\[0\.0, 0\.0, 0\.2\]\] for one control point"),
        (lambda: pw_.solve(ARRAY, SHAPE, medium="air"), "medium is 'air'; it must be a Medium, such as Medium"),
        (lambda: pw_.pressure(ARRAY, solution().drive, SHAPE, 25), "medium is 25"),
        (lambda: pw_.sample_plane(ARRAY, solution().drive, "0.2"), "height '0.2' must be a number of m"),
        (lambda: pw_.Grid.along("xy", (0, 0, 0.2), "0.2", 1e-3), "'0.2'|they are text"),
        (lambda: pw_.Circle(radius="2cm"), "circle radius '2cm' must be a number of m"),
        (lambda: pw_.Circle().sample("1mm"), "spacing '1mm'"),
        (lambda: SHAPE.rotated(90, axis="x"), r"axis 'x' must be three finite numbers, .* \(1, 0, 0\) for x"),
        (lambda: pw_.TransducerArray.grid(pitch="1cm"), "pitch '1cm'"),
        (
            lambda: pw_.save_solution(solution(), "s.npz"),
            r"'s\.npz'; it must be a Solution, as in save_solution\(path, s",
        ),
        (lambda: pw_.save_field(field(), "f.npz"), r"it must be a Field, as in save_field\(path, field\)"),
        (lambda: pw_.save_vti(field(), "f.vti"), r"it must be a Field, as in save_vti\(path, field\)"),
        (
            lambda: pw_.save_field_picture(field(), "f.png"),
            r"it must be a Field, as in save_field_picture\(path, field",
        ),
        (lambda: pw_.compare_fields([field()]), 'fields is .*; it must be a Mapping, such as {"wgs": field}'),
        (lambda: field().plot(points="circle"), "numbers, not 'circle'; parse_shape"),
        (lambda: field().plot(quantity="taste"), "known are pressure, intensity, radiation, oil"),
    ],
)
def test_a_wrong_type_is_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
    assert pyplot.get_fignums() == []  # no figure is left
