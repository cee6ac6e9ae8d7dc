"""Methods of other packages, by the entry-point group."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import ControlPoints, TransducerArray, solve
from phasewire.solver.methods import methods
from phasewire.solver.methods.methods import GROUP, Method, Methods, Problem, options_of

POINTS = ControlPoints([[-0.02, 0, 0.2], [0.02, 0, 0.2]])


def _first_alone(problem: Problem) -> NDArray[np.complex128]:
    return problem.limited(problem.transfer[0].conj())


FIRST = Method("the first point alone", "phase", ("gamma",), _first_alone)
NOT_A_METHOD = "text"


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> Methods:
    """The registry on a computer on which another package has methods."""
    there = {"first": "FIRST", "text": "NOT_A_METHOD", "gone": "MISSING", "wgs": "FIRST"}
    entries = [EntryPoint(name, f"{__name__}:{value}", GROUP) for name, value in there.items()]
    monkeypatch.setattr(methods, "entry_points", lambda group: [entry for entry in entries if entry.group == group])
    monkeypatch.setattr(EntryPoint, "load", lambda entry: globals()[entry.attr] if entry.attr in globals() else _gone())
    found = Methods()
    for module in ("methods", "reference_engine", "solve"):
        monkeypatch.setattr(f"phasewire.solver.methods.{module}.METHODS", found)
    return found


def _gone() -> None:
    raise AttributeError("there is none")


def test_a_method_of_another_package_solves(known: Methods) -> None:
    array = TransducerArray.grid()
    assert list(known)[-3:] == ["first", "text", "gone"]
    assert len(known) == len(list(known))
    assert options_of("first", {"gamma": 0.5}).output == "phase"
    expected = solve(array, ControlPoints(POINTS.positions[:1]), "multiplex", precision="double")
    np.testing.assert_allclose(solve(array, POINTS, "first").drive, expected.drive, atol=1e-12)


def test_a_name_of_this_package_stays_its_own(known: Methods) -> None:
    assert known["wgs"].options[-1] == "steps"


@pytest.mark.parametrize(
    ("name", "message"), [("text", "must be a Method, not 'text'"), ("gone", "cannot be loaded: there is none")]
)
def test_what_is_no_method_is_named(known: Methods, name: str, message: str) -> None:
    with pytest.raises(ValueError, match=f"method '{name}' of the entry point .* {message}"):
        solve(TransducerArray.grid(), POINTS, name)
