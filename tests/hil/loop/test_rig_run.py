"""Devices around a point, solved and judged as one array: what is right passes, and what is off is noticed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import ControlPoints, DeviceGroup, Emulator, Pulses, RigDevice, TransducerArray, open_devices, pressure
from phasewire import solve as solve_for
from phasewire.emulator.cluster import Cluster
from phasewire.hil import RigRun, run_rig
from phasewire.host.streaming.calibration import Calibration
from phasewire.solver.geometry import rotation_matrix

from tests.host.test_group import OffLine

FOCUS = np.array([0.02, -0.01, 0.3])
TICKS, DRIVE, PRESSURE = range(3)
PERIOD = 10_000


def around(count: int) -> list[TransducerArray]:
    """Boards on a circle of 0.3 m about the focus, in an upright plane, that look at it; no two at the same height."""
    boards = []
    for place in range(count):
        turn = rotation_matrix(360 * place / count + 17, (0, 1, 0))
        boards.append(TransducerArray.grid().placed(turn, FOCUS + turn @ [0, 0.003 * place, -0.3]))
    return boards


def rig_of(emulators: list[Emulator], boards: list[TransducerArray]) -> list[RigDevice]:
    return [RigDevice(each.url, board) for each, board in zip(emulators, boards, strict=True)]


@contextmanager
def opened(count: int) -> Iterator[tuple[DeviceGroup, list[Emulator]]]:
    with Cluster(count, serial="R") as cluster, open_devices(rig_of(list(cluster), around(count))) as group:
        yield group, list(cluster)


def failed(run: RigRun) -> list[int]:
    return [place for place, check in enumerate(run.checks()) if not check.passed]


def strongest_near(array: TransducerArray, drive: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Where the field is strongest, of places a millimetre apart within 4 mm of the focus."""
    steps = np.arange(-4, 5) * 1e-3
    places = FOCUS + np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(places[np.abs(pressure(array, drive, places)).argmax()])


@pytest.mark.parametrize("count", [2, 4, 8])
def test_devices_around_a_point_make_the_focus_of_one_array(count: int) -> None:
    with opened(count) as (group, emulators):
        solution = solve_for(group.array, ControlPoints([FOCUS]))
        run = run_rig(solution, group, emulators)
    one_array = Pulses.from_drive(solution.drive).to_drive()
    assert run.passed
    np.testing.assert_allclose(run.rebuilt, one_array, atol=1e-12)
    np.testing.assert_allclose(strongest_near(run.built, run.rebuilt), FOCUS, atol=1e-9)
    # Of drives of unit magnitude the most that can add up at a point is the sum of the magnitudes.
    most = sum(abs(pressure(group.array, drive, [FOCUS])[0]) for drive in np.eye(len(group.array))[::40])
    alone = solution.drive[::40]
    reached = np.abs(pressure(TransducerArray(group.array.positions[::40], group.array.normals[::40]), alone, [FOCUS]))
    assert reached[0] == pytest.approx(most, rel=1e-3)
    assert run.shares[0] == pytest.approx(1, abs=0.01)


def test_a_rig_with_calibrations_is_not_judged() -> None:
    with Cluster(1, serial="R") as cluster:
        member = RigDevice(cluster.devices[0].url, calibration=Calibration.perfect(320))
        with open_devices([member]) as group, pytest.raises(ValueError, match="open it without them"):
            run_rig(solve_for(group.array, [FOCUS]), group, list(cluster))


@pytest.mark.parametrize("direction", [(0, 0, -1), (0, 0, 1)])
def test_a_device_a_millimetre_off_is_noticed(direction: tuple[int, int, int]) -> None:
    """A millimetre to the focus turns its part of the pressure by 42°."""
    with opened(4) as (group, emulators):
        boards = [member.array for member in group.members]
        axis = FOCUS - boards[2].centre
        boards[2] = boards[2].moved(1e-3 * direction[2] * axis / np.linalg.norm(axis))
        solution = solve_for(group.array, ControlPoints([FOCUS]))
        run = run_rig(solution, group, emulators, TransducerArray.joined(boards))
    assert failed(run) == [PRESSURE]
    turned = np.exp(2j * np.pi * 1e-3 / solution.medium.wavelength)
    assert run.shares[0] == pytest.approx(abs(3 + turned) / 4, abs=0.01)


def test_a_device_a_period_late_is_noticed() -> None:
    """The host cannot see a quarter of its own uncertainty, but the judge sees the ticks."""
    with ExitStack() as stack:
        driver = stack.enter_context(Emulator(serial="L-0"))
        late = stack.enter_context(Emulator(serial="L-1", sync=OffLine(driver.sync, PERIOD)))
        group = stack.enter_context(open_devices(rig_of([driver, late], around(2))))
        run = run_rig(solve_for(group.array, ControlPoints([FOCUS])), group, [driver, late])
    assert failed(run) == [TICKS]
    assert run.begins[1] - run.begins[0] == PERIOD


def test_a_device_with_other_pulses_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(2) as (group, emulators):
        show = group.devices[1].show
        monkeypatch.setattr(
            group.devices[1], "show", lambda pulses, period: show(Pulses(99 - pulses.phase, pulses.width), period)
        )
        run = run_rig(solve_for(group.array, ControlPoints([FOCUS])), group, emulators)
    assert failed(run) == [DRIVE, PRESSURE]
    assert np.flatnonzero(np.abs(run.rebuilt - Pulses.from_drive(run.solution.drive).to_drive()) > 1e-9).min() >= 320


def test_a_part_of_the_channels_is_judged_by_itself() -> None:
    kept = np.arange(300, 20, -2)
    board = TransducerArray.grid()
    few = TransducerArray(board.positions[kept], board.normals[kept])
    with Cluster(2, serial="P") as (one, other):
        rig = [RigDevice(one.url), RigDevice(other.url, few.moved([0, 0.3, 0]), channels=kept)]
        with open_devices(rig) as group:
            run = run_rig(solve_for(group.array, ControlPoints([FOCUS])), group, [one, other])
    assert run.passed
