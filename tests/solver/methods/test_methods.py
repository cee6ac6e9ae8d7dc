"""Methods of other packages, by the entry-point group."""

from __future__ import annotations

import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import ControlPoints, TransducerArray, solve
from phasewire.cli.solving import method_help
from phasewire.solver.acoustics.propagation import transfer_matrix
from phasewire.solver.methods import methods
from phasewire.solver.methods.methods import GROUP, Method, Methods, Problem, options_of

POINTS = ControlPoints([[-0.02, 0, 0.2], [0.02, 0, 0.2]])


def _first_alone(problem: Problem) -> NDArray[np.complex128]:
    return problem.limited(problem.transfer[0].conj())


FIRST = Method("the first point alone", "phase", ("gamma",), _first_alone)
NOT_A_METHOD = "text"
HERE = {"first": "FIRST", "text": "NOT_A_METHOD", "gone": "MISSING", "wgs": "FIRST"}
GUIDE = Path(__file__).parents[3] / "docs/explanation/solver.md"
MODULES = {
    "mypackage": re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)[0],
    "unknown_option": "from phasewire.solver import Method\nFOUND = Method('text', 'phase', ('sharpness',), len)",
    "raises": "raise RuntimeError('no licence')",
}


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Methods:
    """The registry on a computer with methods of other packages."""
    for module, text in MODULES.items():
        (tmp_path / f"{module}.py").write_text(text, encoding="utf-8")
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    there = {name: f"{__name__}:{value}" for name, value in HERE.items()} | {
        "matched": "mypackage:MATCHED",
        "sharp": "unknown_option:FOUND",
        "broken": "raises:FOUND",
    }
    entries = {GROUP: {name: EntryPoint(name, value, GROUP) for name, value in there.items()}}
    monkeypatch.setattr(methods, "entries", entries.__getitem__)
    found = Methods()
    for module in ("solver.methods.methods", "solver.methods.reference_engine", "solver.methods.solve", "cli.solving"):
        monkeypatch.setattr(f"phasewire.{module}.METHODS", found)
    return found


def test_a_method_of_another_package_solves(known: Methods) -> None:
    array = TransducerArray.grid()
    assert list(known)[-6:] == ["first", "text", "gone", "matched", "sharp", "broken"]
    assert len(known) == len(list(known))
    assert options_of("first", {"gamma": 0.5}).output == "phase"
    expected = solve(array, ControlPoints(POINTS.positions[:1]), "multiplex", precision="double")
    np.testing.assert_allclose(solve(array, POINTS, "first").drive, expected.drive, atol=1e-12)


def test_the_example_of_the_guide_is_the_conjugate_of_the_sum(known: Methods) -> None:
    array = TransducerArray.grid()
    total = transfer_matrix(array, POINTS.positions).sum(axis=0)
    drive = solve(array, POINTS, "matched").drive
    np.testing.assert_allclose(drive, total.conj() / np.abs(total).max(), atol=1e-12)


def test_a_name_of_this_package_stays_its_own(known: Methods) -> None:
    assert known["wgs"].options[-1] == "steps"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("text", "must be a Method, not 'text'"),
        ("gone", "cannot be loaded: .* has no attribute 'MISSING'"),
        ("sharp", "cannot be loaded: a method has no option 'sharpness'; Options has gamma, .*"),
        ("broken", "cannot be loaded: no licence"),
    ],
)
def test_invalid_methods_are_named(known: Methods, name: str, message: str) -> None:
    """By `solve` with any options, and in the command line's help among all other methods."""
    expected = f"method '{name}' of the entry point .* {message}"
    with pytest.raises(ValueError, match=expected):
        solve(TransducerArray.grid(), POINTS, name, sharpness=1)
    heads = [line for line in method_help().splitlines() if not line.startswith(" ")]
    assert [head.partition(":")[0] for head in heads] == list(known)
    assert re.fullmatch(f"{name}: {expected}", heads[list(known).index(name)])
