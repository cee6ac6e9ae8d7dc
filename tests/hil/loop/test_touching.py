"""The verdict on what is felt must be good for what is right, and red for each thing that is broken on purpose."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from phasewire import (
    ControlPoints,
    Device,
    Emulator,
    Hand,
    Mesh,
    Pulses,
    Sphere,
    TransducerArray,
    Wiring,
    touch,
)
from phasewire.hil.loop.touching import TouchRun, as_emitted, run_touch
from phasewire.solver import TwoSided, intensity_component, two_sided

TICK, EARLY, DRIVE, FELT = range(4)


def verdicts(run: TouchRun) -> list[bool]:
    return [check.passed for check in run.checks()]


@pytest.fixture(scope="module")
def intended(array: TransducerArray) -> TwoSided:
    return two_sided(array, Sphere().sample())


def test_what_is_felt_arrives(intended: TwoSided, emulator: Emulator) -> None:
    run = run_touch(intended, emulator)
    assert verdicts(run) == [True] * 4
    points = intended.points.positions
    np.testing.assert_allclose(run.emitted.weights @ run.emitted.drives, intended.drives, atol=0.07)
    felt = intensity_component(intended.first.array, run.emitted, points)
    np.testing.assert_allclose(felt, run.felt(run.rebuilt), rtol=1e-9)
    np.testing.assert_allclose(
        felt, intensity_component(intended.first.array, intended.modulation, points), atol=0.05 * felt.max()
    )


@settings(max_examples=5)
@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.1, 0.4)), min_size=1, max_size=24),
    st.integers(0, 2**32 - 1),
)
def test_any_points_are_felt_over_any_wiring(points: list[tuple[float, float, float]], seed: int) -> None:
    wiring = Wiring(np.random.default_rng(seed).permutation(320))
    with Emulator(wiring=wiring) as emulator:
        assert run_touch(two_sided(TransducerArray.grid(), ControlPoints(points)), emulator).passed


def test_one_board_a_tick_late_is_red(intended: TwoSided) -> None:
    with Emulator(clock_offset_ticks={3: 1}) as emulator:
        run = run_touch(intended, emulator)
    assert run.checks()[TICK].value == 2
    assert not verdicts(run)[DRIVE]


@pytest.mark.parametrize(
    ("steps", "red"),
    [
        ([(1, 100), (0, 100)], [DRIVE]),
        ([(0, 200)], [DRIVE, FELT]),
        ([(0, 50), (1, 50)], [DRIVE, FELT]),
        ([(0, 99), (1, 101)], [DRIVE]),
    ],
    ids=["the halves in the other order", "one half all the time", "twice as fast", "a period late"],
)
def test_other_times_of_the_halves_are_red(
    intended: TwoSided,
    emulator: Emulator,
    monkeypatch: pytest.MonkeyPatch,
    steps: list[tuple[int, int]],
    red: list[int],
) -> None:
    genuine = Device.play
    monkeypatch.setattr(Device, "play", lambda device, _: genuine(device, steps))
    run = run_touch(intended, emulator)
    assert [index for index, good in enumerate(verdicts(run)) if not good] == red


def test_drives_for_another_array_are_refused(emulator: Emulator) -> None:
    with pytest.raises(ValueError, match=r"\(4,\) for a device with 320 transducers"):
        run_touch(two_sided(TransducerArray.grid(2, 2), ControlPoints([[0, 0, 0.2]])), emulator)


def test_pulses_that_were_sent_emit_the_same_as_the_whole_way(intended: TwoSided, emulator: Emulator) -> None:
    wanted = run_touch(intended, emulator).emitted
    emitted = as_emitted([Pulses.from_drive(drive) for drive in intended.drives], 100)
    np.testing.assert_allclose(emitted.drives, wanted.drives, atol=1e-12)
    assert emitted.true_frequency == 200


@st.composite
def meetings(draw: st.DrawFn) -> tuple[Hand, Mesh]:
    """A hand at any height, turned and bent in any way, whose palm meets one of the paper's objects."""
    solid = draw(st.sampled_from([Mesh.cube, Mesh.sphere, Mesh.cone, Mesh.pyramid, Mesh.horizontal_prism]))
    mesh = solid().rotated(draw(st.floats(0, 360)), (0, 0, 1)).moved([draw(st.floats(-0.02, 0.02)), 0, 0])
    centre = [draw(st.floats(-0.04, 0.04)), draw(st.floats(-0.06, 0.02)), draw(st.floats(0.14, 0.2))]
    hand = Hand.flat(centre, draw(st.sampled_from(["left", "right"])), curl=draw(st.floats(0, 0.8)))
    axis = np.array([draw(st.floats(-1, 1)), draw(st.floats(-1, 1)), 1])
    return hand.rotated(draw(st.floats(-30, 30)), axis), mesh


def check_what_is_felt(hand: Hand, mesh: Mesh) -> None:
    points = touch(hand, mesh).points
    assert points is not None
    with Emulator() as emulator:
        run = run_touch(two_sided(TransducerArray.grid(), points), emulator)
    assert verdicts(run) == [True] * 4
    felt, wanted = run.felt(run.rebuilt), run.felt(run.wanted)
    assert np.abs(felt - wanted).max() < 0.1 * wanted.max()  # quantisation adds up by chance, far below its bound
    closest: Any = trimesh.proximity.closest_point_naive
    _, distance, _ = closest(trimesh.Trimesh(mesh.vertices, mesh.faces), points.positions)
    assert distance.max() < 3e-3  # the points lie on the object, or bridge a knuckle from there


@pytest.mark.parametrize("shape", ["cone", "sphere", "pyramid", "horizontal_prism", "vertical_prism", "cube"])
def test_what_a_hand_feels_of_each_object_arrives(shape: str) -> None:
    check_what_is_felt(Hand.flat((0, -0.02, 0.18)), getattr(Mesh, shape)())


@pytest.mark.slow
@settings(max_examples=10)
@given(meetings())
def test_what_any_hand_feels_of_any_object_arrives(meeting: tuple[Hand, Mesh]) -> None:
    assume(touch(*meeting))
    check_what_is_felt(*meeting)
