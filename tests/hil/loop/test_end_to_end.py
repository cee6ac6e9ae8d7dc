"""The verdict must be good for what is right, and red for each thing that is broken on purpose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire import ControlPoints, Emulator, Pulses, Solution, TransducerArray, Wiring, pressure, solve
from phasewire.hil import EndToEnd, run_end_to_end
from phasewire.hil.loop.end_to_end import nearest_emission

from tests.oracles import quantisation_bound

PROCESSORS, EARLY, DRIVE, PRESSURE = range(4)


def verdicts(run: EndToEnd) -> list[bool]:
    return [check.passed for check in run.checks()]


@settings(max_examples=15)
@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.1, 0.4)), min_size=1, max_size=32),
    st.integers(0, 2**32 - 1),
)
def test_any_points_arrive_over_any_wiring(points: list[tuple[float, float, float]], seed: int) -> None:
    wiring = Wiring(np.random.default_rng(seed).permutation(320))
    with Emulator(wiring=wiring) as emulator:
        assert run_end_to_end(solve(TransducerArray.grid(), ControlPoints(points)), emulator).passed


def test_a_swapped_pair_in_the_wiring_table_is_red(sphere_solution: Solution) -> None:
    true = Wiring.strips()
    swapped = true.channels.copy()
    swapped[[100, 101]] = swapped[[101, 100]]
    with Emulator(wiring=true, table=Wiring(swapped)) as emulator:
        run = run_end_to_end(sphere_solution, emulator)
    assert not run.passed
    assert not verdicts(run)[DRIVE]
    wrong = np.flatnonzero(np.abs(run.rebuilt - run.nearest) > 1e-9)
    assert wrong.tolist() == [100, 101]


def test_a_flipped_sign_of_phase_is_red(
    sphere_solution: Solution, emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    genuine = Pulses.from_drive
    monkeypatch.setattr(Pulses, "from_drive", lambda drive: genuine(np.conj(drive)))
    run = run_end_to_end(sphere_solution, emulator)
    assert not run.passed
    assert [verdicts(run)[check] for check in (PROCESSORS, EARLY, DRIVE, PRESSURE)] == [True, True, False, False]


def test_outputs_that_sound_too_early_are_red(sphere_solution: Solution, emulator: Emulator) -> None:
    run = run_end_to_end(sphere_solution, emulator)
    early = replace(run, ack=replace(run.ack, commit_period=run.ack.commit_period + 1))
    assert verdicts(early)[:2] == [False, False]


def test_a_solution_for_another_array_is_refused(emulator: Emulator) -> None:
    with pytest.raises(ValueError, match="4 pulses for a device with 320 transducers"):
        run_end_to_end(solve(TransducerArray.grid(2, 2), ControlPoints([[0, 0, 0.2]])), emulator)


@given(st.floats(0, 1), st.floats(-4, 4))
def test_what_quantisation_explains_is_within_its_closed_bound(magnitude: float, angle: float) -> None:
    drive = np.array([magnitude * np.exp(1j * angle)])
    assert np.abs(nearest_emission(drive) - drive)[0] <= quantisation_bound(magnitude)


def test_the_smallest_error_in_one_drive_is_red(sphere_solution: Solution, emulator: Emulator) -> None:
    run = run_end_to_end(sphere_solution, emulator)
    worse = run.rebuilt + 1e-6 * (np.arange(320) == 5) * (run.rebuilt - sphere_solution.drive) / np.abs(
        run.rebuilt - sphere_solution.drive
    )
    run.__dict__["rebuilt"] = worse
    assert verdicts(run) == [True, True, False, True]


def test_phase_errors_are_in_degrees(sphere_solution: Solution, emulator: Emulator) -> None:
    run = run_end_to_end(sphere_solution, emulator)
    run.__dict__["rebuilt"] = sphere_solution.drive * np.exp(1j * np.radians(30))
    assert run.differences()[1]["rebuilt"] == pytest.approx(30)


def test_the_emulator_and_the_judge_demodulate_alike(sphere_solution: Solution, emulator: Emulator) -> None:
    run = run_end_to_end(sphere_solution, emulator)
    np.testing.assert_allclose(run.rebuilt, run.capture.drive(run.capture.periods - 1), atol=1e-12)


def test_the_field_is_that_of_the_drive_as_emitted(sphere_solution: Solution) -> None:
    with Emulator(clock_offset_ticks={2: 9}) as emulator:
        run = run_end_to_end(sphere_solution, emulator)
    plane = run.field(0.2)
    samples = [(0, 0), (100, 140), (60, 60)]
    at = [[plane.x[column], plane.y[row], 0.2] for row, column in samples]
    emitted = pressure(sphere_solution.array, run.rebuilt, at)
    np.testing.assert_allclose(
        [plane.pressure[sample] for sample in samples], emitted, atol=1e-5 * np.abs(emitted).max()
    )
    assert np.abs(emitted - pressure(sphere_solution.array, sphere_solution.drive, at)).max() > 1
