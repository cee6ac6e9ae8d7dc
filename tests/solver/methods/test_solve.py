"""Solutions as a user gets them, from every method and precision."""

from __future__ import annotations

import gc
import itertools
import os
import subprocess
import sys
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from phasewire import (
    Circle,
    ControlPoints,
    Hand,
    Medium,
    Mesh,
    Shape,
    Solver,
    Sphere,
    TransducerArray,
    focus_report,
    pressure,
    solve,
    solve_frames,
    touch,
    two_sided,
)
from phasewire.solver import METHODS, Star
from phasewire.solver.acoustics.propagation import Precision
from phasewire.solver.methods.methods import options_of
from phasewire.solver.methods.solve import engine_for

from tests.strategies import arrays_and_points

METHOD_NAMES = tuple(METHODS)
ANTIPHASE = ControlPoints([[-0.006, 0, 0.2], [0.006, 0, 0.2]])  # apart so far that their fields cancel


def felt(solution: Any) -> np.ndarray:
    return np.abs(pressure(solution.array, solution.drive, solution.points.positions, solution.medium))


@pytest.mark.parametrize("method", METHOD_NAMES)
def test_a_single_point_is_the_time_of_flight_by_hand(array: TransducerArray, method: str) -> None:
    """Every wave arrives with the same phase: the drive's phase is −k·r, to what single precision and steps allow."""
    point = np.array([0.03, 0.01, 0.15])
    drive = solve(array, ControlPoints([point]), method).drive
    arriving = drive * np.exp(1j * Medium().wavenumber * np.linalg.norm(array.positions - point, axis=1))
    step = np.pi / 100 if method == "polish" else 0
    np.testing.assert_allclose(np.angle(arriving * arriving[0].conj()), 0, atol=2 * step + 2e-3)


@pytest.mark.parametrize("method", METHOD_NAMES)
@settings(max_examples=20)
@given(arrays_and_points())
def test_the_level_is_the_least_squares_fit_of_the_field(
    method: str, problem: tuple[TransducerArray, ControlPoints]
) -> None:
    array, points = problem
    wanted = points.amplitudes / 2  # the largest is not 1
    halved = ControlPoints(points.positions, wanted)
    engine = engine_for(array, Medium(), method, options_of(method), "single")
    drive = engine.drive(halved)
    reached = np.abs(pressure(array, drive, points.positions))
    assert engine.level(halved, drive) == pytest.approx(wanted @ reached / (wanted @ wanted), rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("shape", ["sphere", "star"])
def test_the_recommended_method_is_even_and_strong(array: TransducerArray, shape: str) -> None:
    """A spread of at most 0.1 %, at 85 % or more of the strength that the paper's full power has."""
    points = (Sphere() if shape == "sphere" else Star()).sample()
    best, paper = felt(solve(array, points)), felt(solve(array, points, "paper"))
    assert best.std() / best.mean() < 1.01e-3
    assert best.mean() > 0.85 * paper.mean()
    away = np.abs(pressure(array, solve(array, points).drive, [[0.09, 0.09, 0.2], [-0.09, 0.07, 0.2]]))
    assert away.max() < 0.3 * best.min()


@pytest.mark.parametrize(
    "frames", [[np.zeros((4, 3)), np.zeros((9, 3))], np.zeros((2, 4, 2)), np.zeros((4, 3))], ids=["more", "flat", "one"]
)
def test_frames_of_a_motion_have_the_same_points(array: TransducerArray, frames: Any) -> None:
    with pytest.raises(ValueError, match=r"\(k, m, 3\)|must have the shape|three"):
        Solver(array).follow(frames, np.ones(4))


def test_a_motion_in_any_order_of_memory_is_the_same(array: TransducerArray) -> None:
    places = np.random.default_rng(1).uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.2], (3, 4, 3))
    drives = Solver(array).follow(places, np.ones(4))
    np.testing.assert_array_equal(Solver(array).follow(np.asfortranarray(places), np.ones(4)), drives)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_corrections_of_contradicting_points_do_not_end_in_silence(precision: Precision) -> None:
    """One place with four strengths would be most even without any pressure."""
    points, panel = ControlPoints(np.tile([0.01, 0.0, 0.15], (4, 1)), [1, 0.5, 0, 0]), TransducerArray.grid(15, 5)
    plain, corrected = (
        np.abs(pressure(panel, solve(panel, points, precision=precision, steps=steps).drive, points.positions[:1]))
        for steps in (0, 30)
    )
    assert corrected > 0.49 * plain


@pytest.mark.parametrize("method", ["min_norm", "tikhonov", "wgs", "polish"])
def test_nulls_are_deep_and_foci_stay(array: TransducerArray, method: str) -> None:
    positions = [[-0.03, 0, 0.2], [0.03, 0, 0.2], [0, 0.03, 0.2], [0, 0, 0.2]]
    pressures = felt(solve(array, ControlPoints(positions, [1, 0.5, 0, 0]), method))
    assert pressures[1] / pressures[0] == pytest.approx(0.5, abs=0.03)
    depth = {"min_norm": -100, "tikhonov": -30, "wgs": -50, "polish": -30}[method]
    assert 20 * np.log10(pressures[2:].max() / pressures[0]) < depth
    if method == "wgs":
        without = felt(solve(array, ControlPoints(positions[:2], [1, 0.5]), method))
        np.testing.assert_allclose(pressures[:2], without, rtol=0.15)


@pytest.mark.parametrize("method", METHOD_NAMES)
def test_only_the_ratio_of_amplitudes_matters(array: TransducerArray, method: str) -> None:
    positions = [[-0.03, 0, 0.2], [0.03, 0, 0.2]]
    quiet, loud = (solve(array, ControlPoints(positions, [s, s / 2]), method).drive for s in (1e-200, 1e200))
    np.testing.assert_allclose(quiet, loud, atol=1e-6)


def coherences(array: TransducerArray, precision: Any, warm: bool) -> list[float]:
    """How alike the drives of successive frames are, 1 for the same but for a phase, of a star that begins to move."""
    solver, drives = Solver(array, precision=precision), []
    for frame in range(25):
        if not warm:
            solver.forget()
        offset = np.array([max(0, frame - 10) * 2e-4, 0, 0])
        drives.append(solver.solve(ControlPoints(Star().sample().positions + offset)).drive)
    return [
        float(abs(np.vdot(a, b)) / np.linalg.norm(a) / np.linalg.norm(b)) for a, b in itertools.pairwise(drives[10:])
    ]


@pytest.mark.parametrize("precision", ["single", "double"])
def test_successive_frames_stay_coherent(array: TransducerArray, precision: Any) -> None:
    """Steps of 0.2 mm hardly change the drives; fresh starts jump from one solution to another."""
    assert min(coherences(array, precision, warm=True)) > 0.995
    assert min(coherences(array, precision, warm=False)) < 0.9


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("phases", ["unit", "power"])
def test_a_warm_start_does_not_stall_on_a_symmetric_shape(array: TransducerArray, precision: Any, phases: Any) -> None:
    """Two points go apart until antiphase serves them better than the phases of the frames before."""
    solver = Solver(array, "tikhonov", precision=precision, phases=phases, phase_steps=30)
    for half in (0.001, 0.002, 0.003, 0.004, 0.005, 0.006):
        solution = solver.solve(ControlPoints([[-half, 0, 0.2], [half, 0, 0.2]]))
    at = pressure(array, solution.drive, ANTIPHASE.positions)
    assert np.degrees(np.angle(-at[1] / at[0])) == pytest.approx(0, abs=5)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_phases_can_be_bounded_in_time(array: TransducerArray, precision: Any) -> None:
    """No time is no iteration; plenty of time is all of them."""
    points = Star().sample()
    for seconds, steps in ((0.0, 0), (1e5, 20)):
        bounded = solve(array, points, "tikhonov", precision=precision, phase_seconds=seconds).drive
        counted = solve(array, points, "tikhonov", precision=precision, phase_steps=steps).drive
        np.testing.assert_array_equal(bounded, counted)


@pytest.mark.parametrize("method", METHOD_NAMES)
@pytest.mark.parametrize("workers", [1, 3])
def test_many_frames_are_single_ones(method: str, workers: int) -> None:
    """Of different numbers of points, in any number of threads, to the bit."""
    array = TransducerArray.grid(9, 7)
    rng = np.random.default_rng(3)
    frames = [ControlPoints(rng.uniform([-0.03, -0.03, 0.1], [0.03, 0.03, 0.2], (m, 3))) for m in (1, 17, 4, 40, 4)]
    many = solve_frames(array, frames, method, workers=workers)
    for drive, points in zip(many, frames, strict=True):
        assert drive.tobytes() == solve(array, points, method).drive.astype(np.complex64).tobytes()


@pytest.mark.parametrize("wanted", [Circle(), Circle(0.02).moved((0.03, 0, 0)) + Sphere()])
def test_a_shape_is_solved_as_its_points(wanted: Shape, array: TransducerArray) -> None:
    points = wanted.sample()
    expected = solve(array, points).drive
    np.testing.assert_array_equal(solve(array, wanted).drive, expected)
    np.testing.assert_array_equal(solve_frames(array, [wanted])[0], expected.astype(np.complex64))
    np.testing.assert_array_equal(two_sided(array, wanted).drives, two_sided(array, points).drives)
    assert focus_report(array, expected, wanted) == focus_report(array, expected, points)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Hand.flat, r"a Hand has no control points; touch\(hand, mesh\).points has"),
        (Mesh.cube, "a Mesh has no control points"),
        (lambda: touch(Hand.flat(), Mesh.cube()), "a Touch is solved by its points and their identities"),
        (lambda: Circle, r"Circle is a class; Circle\(\) makes one"),
        (lambda: "circle", "control points must be .* numbers"),
    ],
)
def test_what_has_no_control_points_is_refused(make: Callable[[], Any], message: str, array: TransducerArray) -> None:
    wanted = make()
    with pytest.raises(ValueError, match=message):
        solve(array, wanted)
    with pytest.raises(ValueError, match=message):
        two_sided(array, wanted)


def test_a_bad_frame_among_many_is_named(array: TransducerArray) -> None:
    good, behind = ControlPoints([[0, 0, 0.2]]), ControlPoints([[0, 0, 0.2], [0, 0, -0.2]])
    with pytest.raises(ValueError, match=r"frame 2: control point 1 at .* is on the array or behind it"):
        solve_frames(array, [good, good, behind, good], workers=2)
    with pytest.raises(ValueError, match="workers 0 must be a whole number from 1"):
        solve_frames(array, [good], workers=0)


def test_more_points_than_transducers_and_points_at_one_place_warn() -> None:
    small = TransducerArray.grid(2, 1)
    with pytest.warns(UserWarning, match="3 control points are more than the 2 transducers"):
        solve(small, [[0, 0, 0.1], [0.01, 0, 0.1], [0.02, 0, 0.1]])
    with pytest.warns(UserWarning, match=r"control points 0 and 2 are both at \(0, 0, 100\) mm"):
        ControlPoints([[0, 0, 0.1], [0.01, 0, 0.1], [0, 0, 0.1]])


@pytest.mark.parametrize("z", [1e-46, 1e-9, 5e-7])
def test_a_point_in_the_plane_of_the_array_is_refused(array: TransducerArray, z: float) -> None:
    """In single precision its height may be 0, and then nothing sounds there."""
    for point in ([0, 0, z], [0.5, 0, z]):
        with pytest.raises(ValueError, match="is on the array or behind it"):
            solve(array, [point])
    assert np.abs(solve(array, [[0, 0, 1e-5]]).drive).max() == pytest.approx(1, abs=1e-5)


def test_a_calibrated_array_is_solved_with_its_response(array: TransducerArray) -> None:
    """Phases and polarities are compensated; dead elements are left out, so that the others do not rely on them."""
    rng = np.random.default_rng(4)
    response = np.exp(1j * rng.normal(0, 0.3, 320)) * rng.choice([1, -1], 320)
    response[rng.choice(320, 30, replace=False)] = 0
    real = array.calibrated(response)
    points = Star().sample()
    ignorant, knowing = solve(array, points), solve(real, points)
    blind = np.abs(pressure(real, ignorant.drive, points.positions))
    assert felt(knowing).std() / felt(knowing).mean() < 0.01 < blind.std() / blind.mean()
    assert felt(knowing).mean() > 2 * blind.mean()
    assert not knowing.drive[response == 0].any()
    alive = array.calibrated(np.where(response == 0, 0, 1))
    np.testing.assert_allclose(knowing.drive * response, solve(alive, points).drive, atol=2e-3)


def test_too_large_a_problem_is_refused_before_it_fills_the_memory() -> None:
    with pytest.raises(
        ValueError, match="4000 control points with 40000 transducers are too many; at most 4096 points"
    ):
        solve(TransducerArray.grid(200, 200), ControlPoints(np.full((4000, 3), 0.2)))
    with pytest.raises(ValueError, match="4097 control points with 4 transducers are too many"):
        solve(TransducerArray.grid(2, 2), ControlPoints(np.full((4097, 3), 0.2)))


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("method", ["tikhonov", "wgs", "polish"])
def test_repeated_points_without_regularisation_are_refused(
    array: TransducerArray, method: str, precision: Any
) -> None:
    with pytest.raises(ValueError, match="mu 1e-30 is too small for points as close together as these"):
        solve(array, ControlPoints([[0, 0, 0.2]] * 3), method, mu=1e-30, precision=precision)


@pytest.mark.parametrize("method", METHOD_NAMES)
@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ([0, 0, -0.1], "control point 1 at .* is on the array or behind it"),
        ([0, 0, 0], "is on the array or behind it"),
        ([5.15e-3, 5.15e-3, 1e-3], "control point 1 at .* closer to a transducer than 0.0045 m, where its model ends"),
        ([0, 0, 2.5], "control point 1 at .* is out of reach, more than 2 m away; coordinates are in metres"),
    ],
)
def test_unreachable_points_are_named(array: TransducerArray, method: str, bad: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        solve(array, ControlPoints([[0, 0, 0.2], bad]), method)


def test_points_beside_the_array_are_reachable(array: TransducerArray) -> None:
    """The exact check decides if the quick check of the kernel cannot: these points are not refused."""
    bowl = TransducerArray.joined([array, array.placed(np.diag([1.0, -1.0, -1.0]), [0, 0, 0.5])])
    for where in ([0, 0, 0.25], [0.3, 0, 0.02], [0, 0, 1.99]):
        assert np.isfinite(solve(bowl if where[2] < 0.3 else array, ControlPoints([where])).drive).all()


def test_an_unknown_precision_is_named(array: TransducerArray) -> None:
    with pytest.raises(ValueError, match="precision 'half' must be one of double, single"):
        Solver(array, precision="half")  # type: ignore[arg-type]


@pytest.mark.parametrize("method", METHOD_NAMES)
@pytest.mark.parametrize("why", ["dead", "limited"])
def test_points_that_only_silent_transducers_face_are_unreachable(method: str, why: str) -> None:
    up = TransducerArray.grid(4, 4)
    facing = TransducerArray.joined([up, up.placed(np.diag([1.0, -1.0, -1.0]), [0, 0, 0.1])])
    only_down = np.r_[np.zeros(16), np.ones(16)]
    silent = facing.calibrated(only_down) if why == "dead" else facing.calibrated(np.ones(32), only_down)
    with pytest.raises(ValueError, match=r"control point 0 at .* as far as that can sound"):
        solve(silent, ControlPoints([[0, 0, 0.2]]), method)
    assert np.abs(solve(silent, ControlPoints([[0, 0, 0.05]]), method).drive[16:]).max() > 0.9


@pytest.mark.parametrize("method", ["tikhonov", "wgs", "polish"])
@pytest.mark.parametrize("output", ["solved", "phase", "limited"])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_contradicting_points_give_a_valid_drive(method: str, output: str, precision: Any) -> None:
    """A focus and a null at one place, for two transducers: the corrections run into silence."""
    array = TransducerArray.grid(2, 1)
    points = ControlPoints([[0, 0, 0.1], [0, 0, 0.1]], [1, 0])
    drive = solve(array, points, method, output=output, precision=precision).drive
    assert np.isfinite(drive).all()
    assert np.abs(drive).max() == pytest.approx(1, rel=1e-5)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_a_refused_frame_does_not_change_later_ones(array: TransducerArray, precision: Any) -> None:
    good = Star().sample()
    disturbed, undisturbed = (Solver(array, precision=precision) for _ in range(2))
    for solver in (disturbed, undisturbed):
        solver.solve(good)
    for count in (30, 7, 64):
        with pytest.raises(ValueError, match="out of reach"):
            disturbed.solve(np.tile([0.0, 0, 5.0], (count, 1)))
    assert disturbed.solve(good).drive.tobytes() == undisturbed.solve(good).drive.tobytes()


@pytest.mark.parametrize("m", [1, 2, 4, 5, 17, 32])
def test_warm_frames_are_the_double_ones_too(m: int) -> None:
    array, rng = TransducerArray.grid(10, 10), np.random.default_rng(m)
    frames = [rng.uniform([-0.04, -0.04, 0.15], [0.04, 0.04, 0.2], (m, 3))]
    frames += [frames[0] + step * 1e-3 for step in range(1, 6)]
    single, double = (Solver(array, "tikhonov", phase_steps=3, precision=p) for p in ("single", "double"))
    for positions in frames:
        one, other = single.solve(positions).drive, double.solve(positions).drive
        np.testing.assert_allclose(one, other, atol=2e-3)


def test_a_tiny_mu_is_solved_in_double_precision(array: TransducerArray) -> None:
    points = Star().sample()
    for mu in (1e-6, 9e-5):
        single, double = (solve(array, points, "tikhonov", mu=mu, precision=p).drive for p in ("single", "double"))
        np.testing.assert_array_equal(single, double)


def test_an_array_is_forgotten_with_its_last_reference() -> None:
    array = TransducerArray.grid(3, 3)
    pressure(array, np.ones(9), [[0, 0, 0.1]], precision="single")
    solve(array, [[0, 0, 0.1]])
    gone = weakref.ref(array)
    del array
    gc.collect()
    assert gone() is None


SAME_BITS = """
import hashlib, numpy as np
from phasewire import Solver, TransducerArray, pressure, two_sided
from phasewire.solver import Rings, solve_frames
array, points = TransducerArray.grid(), Rings().sample()
many = np.random.default_rng(33).uniform([-0.05, -0.05, 0.12], [0.05, 0.05, 0.22], (33, 3))
drives = [Solver(array, method).solve(points).drive for method in ("tikhonov", "wgs", "polish", "multiplex")]
drives += [Solver(array).solve(many).drive, two_sided(array, many).drives]
drives.append(solve_frames(array, [points])[0])
drives.append(pressure(array, drives[0], points.positions, precision="single"))
print([hashlib.sha256(drive.tobytes()).hexdigest() for drive in drives])
"""


@pytest.mark.slow
def test_compiled_and_cached_kernels_give_the_same_bits(tmp_path: Path) -> None:
    """A process that compiles, and one that loads from the cache, in an empty cache of their own."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run([sys.executable, "-c", SAME_BITS], env=environment, capture_output=True, text=True, timeout=300)
        for _ in range(2)
    ]
    assert [one.stderr for one in said] == ["", ""]
    assert said[0].stdout == said[1].stdout != ""
