"""Numbers that two packages share without importing each other, and rules for all packages."""

from __future__ import annotations

import ast
import doctest
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path
from types import ModuleType

import phasewire as pw
import pytest
from phasewire import Emulator, Medium, Solution, TransducerArray
from phasewire.protocol import board
from phasewire.protocol.codes import SLOTS
from phasewire.solver.methods.options import PHASE_LEVELS
from phasewire.solver.rendering.cycle import MOST_FRAMES

ROOT = Path(__file__).parents[1]
ROOMS = ("protocol", "solver", "host", "emulator", "hil", "feel", "view")


def test_the_solver_s_default_array_is_the_board_s() -> None:
    array = TransducerArray.grid()
    assert len(array) == board.CHANNELS == board.COLUMNS * board.ROWS
    assert array.positions[1, 0] - array.positions[0, 0] == pytest.approx(board.PITCH_M)
    assert (array.positions[:, 0] == array.positions[0, 0]).sum() == board.ROWS


def test_the_solver_s_default_carrier_is_the_board_s() -> None:
    assert Medium().frequency == board.CARRIER_HZ


def test_a_cycle_has_as_many_frames_as_a_device_has_slots() -> None:
    assert MOST_FRAMES == SLOTS


def test_a_polished_drive_has_the_phases_of_a_pulse() -> None:
    assert PHASE_LEVELS == board.HALF_TICKS_PER_PERIOD


def test_the_package_has_its_names_and_subpackages_without_further_imports() -> None:
    code = "import phasewire as p; [getattr(p, name) for name in (*p.__all__, '__version__')]; p.errors.DeviceLostError"
    subprocess.run([sys.executable, "-c", code], timeout=60, check=True)


@pytest.mark.parametrize(
    ("name", "spared"),
    [("solver.ControlPoints", "solver.methods"), ("feel.Skin", "feel.hearing"), ("view.Snapshot", "view.server")],
)
def test_a_name_of_a_room_loads_only_what_it_needs(name: str, spared: str) -> None:
    code = f"import sys, phasewire as p; p.{name}; sys.exit('phasewire.{spared}' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], timeout=60, check=True)


@pytest.mark.parametrize("module", [pw, *(getattr(pw, room) for room in ROOMS)])
def test_dir_lists_public_names_alone(module: ModuleType) -> None:
    for name in dir(module):
        value = getattr(module, name)
        if isinstance(value, ModuleType):
            assert module is pw
            assert name in {*ROOMS, "errors", "units"}
        assert name.isidentifier()
        assert not name.startswith("_")
        assert not isinstance(value, type(annotations))


def test_a_misspelt_name_is_told_from_a_public_one() -> None:
    with pytest.raises(AttributeError, match="module 'phasewire' has no attribute 'slove'") as raised:
        pw.slove  # type: ignore[attr-defined]  # noqa: B018
    assert (raised.value.name, raised.value.obj) == ("slove", pw)  # from which Python suggests "solve"


def test_the_version_is_that_of_the_project() -> None:
    assert pw.__version__ == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


@pytest.mark.parametrize(
    "path",
    [p for room in ROOMS for p in sorted((ROOT / room).rglob("*.py")) if ">>> " in p.read_text("utf-8")],
    ids=str,
)
def test_examples_in_docstrings_run(path: Path) -> None:
    module = import_module(".".join(["phasewire", *path.relative_to(ROOT).with_suffix("").parts]))
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize(
    ("module", "slow"),
    [
        ("commands", ("numba", "matplotlib", "cryptography", "dpkt", "scipy", "numpy", "rich.table", "jax")),
        ("solving", ("numba", "matplotlib", "phasewire.host", "phasewire.protocol", "jax")),
    ],
)
def test_importing_the_package_imports_no_slow_module(module: str, slow: tuple[str, ...]) -> None:
    """Only some users need the slow modules; the list of commands needs none of them."""
    code = f"import sys, phasewire, phasewire.cli.{module}; print([name for name in {slow} if name in sys.modules])"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout.strip() == "[]"


def test_objects_show_themselves_in_one_short_line(sphere_solution: Solution, emulator: Emulator) -> None:
    array, drive, points = sphere_solution.array, sphere_solution.drive, sphere_solution.points
    pair, pulses = pw.two_sided(array, points), pw.Pulses.from_drive(drive)
    box = pw.Grid.along("xyz", (0, 0, 0.2), 0.02, 0.01)
    report = pw.focus_report(array, drive, pw.ControlPoints([[0, 0, 0.2], [0.03, 0, 0.2]], [1, 0]))
    hand, mesh = pw.Hand.flat(), pw.Mesh.cube()
    touch = pw.touch(hand, mesh)
    emulator.run(2)
    made: list[object] = [sphere_solution, array, array.transducer, points, pw.Solver(array), pw.Medium(), box, report]
    made += [pair, pair.gain, pair.split, pair.modulation, pw.TwoSidedSolver(array), *report.foci, *report.nulls]
    made += [pw.sample_plane(array, drive, 0.2), pw.sample_volume(array, drive, box), report.strongest_lobe]
    made += [
        pw.PlanePropagator(array, 0.2),
        pw.Polyline(tuple(map(tuple, points.positions))),
        pw.Star(),
        pw.Star() + points,
    ]
    made += [hand, mesh, mesh.solid, touch, touch.cuts, pulses, pw.Wiring.strips(), pw.Pose.none(), pw.sine(200)]
    made += [pw.Calibration.perfect(320), emulator, emulator.capture(), pw.Toucher(), pw.StreamReport(40)]
    with pw.open_device("emulator:") as device:
        lines = [repr(value) for value in [*made, device]]
    for value, line in zip([*made, device], lines, strict=True):
        assert line.startswith(type(value).__name__ + "("), line
        assert len(line) <= 105, line
        assert "array(" not in line
        assert "\n" not in line
    assert lines[1] == "TransducerArray(320 transducers, 196 × 154 × 0 mm)"
    assert repr(pw.ControlPoints([[0, 0, 0.2]])) == "ControlPoints(1 point, 0 × 0 × 0 mm about (0, 0, 200) mm)"
    assert repr(pw.solve(array, [[0, 0, 0.2]])) == "Solution(wgs, 320 drives for 1 point)"
    assert "(2 points, 2060 × 0 × 0 mm" in repr(pw.ControlPoints([[0.0, 0.0, 0.0], [2.06, 0.0, 0.0]]))
    assert repr(report).startswith("FocusReport(1 focus of ")
    assert repr(mesh) == "Mesh(12 faces, 100 × 100 × 100 mm about (0, 0, 170) mm)"


def test_a_public_class_name_has_one_meaning() -> None:
    homes: dict[str, set[str]] = {}
    for room in (*ROOMS, "base", "cli"):
        for path in (ROOT / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    homes.setdefault(node.name, set()).add(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}


def test_a_constant_of_a_module_has_one_value() -> None:
    """A second one would replace the first wherever it is used, which no type checker reports."""
    twice = []
    for room in (*ROOMS, "cli", "mutants", "tests"):
        for path in (ROOT / room).rglob("*.py"):
            assigned = [node for node in ast.parse(path.read_text("utf-8")).body if isinstance(node, ast.Assign)]
            targets = [node for each in assigned for target in each.targets for node in ast.walk(target)]
            names = [node.id for node in targets if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
            twice += [f"{path.relative_to(ROOT)}: {name}" for name in {*names} if names.count(name) > 1]
    assert twice == []
