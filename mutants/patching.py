"""Mutants: emulators that are broken in one way each, and how one is made in this process.

A mutant is a function with the decorator `mutant`: either what stands in place of one function of the emulator or goes
to a seam, which the decorator names, or what changes classes and modules of the emulator through a `Patch`.
The emulator knows nothing of it. What is changed holds for every emulator of the process until it is undone, so that a
run against a mutant belongs into a process of its own.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from ..hil.conformance.clauses import resolve

__all__ = ["MUTANTS", "Mutant", "Patch", "applied", "mutant"]

EMULATOR = "emulator:"
Replacement = TypeVar("Replacement", bound=Callable[..., Any])


class Patch:
    """Changes that can be taken back."""

    def __init__(self) -> None:
        self._before: list[tuple[Any, str, Any]] = []

    def replace(self, owner: Any, name: str, value: Any) -> None:
        """Give an attribute of a class, a module or an object another value.

        Raises
        ------
        AttributeError
            Where it is not there, so that no mutant misses what it is to break.
        """
        before = inspect.getattr_static(owner, name)
        if name not in vars(owner):
            raise AttributeError(f"{name} is not {owner!r}'s own")
        self._before.append((owner, name, before))
        setattr(owner, name, value)

    def wrap(self, owner: Any, name: str, around: Callable[[Any], Any]) -> None:
        """Put something in the place of a function, which may call it; ``around`` takes the function and gives that.

        Of a static or class method it takes the function beneath, and of a property its getter.
        """
        before = inspect.getattr_static(owner, name)
        match before:
            case staticmethod() | classmethod():
                self.replace(owner, name, type(before)(around(before.__func__)))
            case property():
                self.replace(owner, name, property(around(before.fget), before.fset))
            case _:
                self.replace(owner, name, around(before))

    def around(self, owner: Any, name: str) -> Callable[[Replacement], Replacement]:
        """Decorate what stands in place of a function: it takes that function, then the arguments of a call."""

        def put(replacement: Replacement) -> Replacement:
            self.wrap(owner, name, lambda original: lambda *given, **named: replacement(original, *given, **named))
            return replacement

        return put

    def undo(self) -> None:
        """Take everything back."""
        for owner, name, value in reversed(self._before):
            setattr(owner, name, value)
        self._before.clear()


@dataclass(frozen=True)
class Mutant:
    """A way to be broken.

    Parameters
    ----------
    name : str
    group : str
        The file that it stands in.
    clauses : tuple of str
        That it breaks.
    sentence : str
        What it does wrong, and how a firmware author might come to it.
    apply : callable
        Breaks the emulator.
    url : str
        Of a device that shows it.
    """

    name: str
    group: str
    clauses: tuple[str, ...]
    sentence: str
    apply: Callable[[Patch], None]
    url: str = EMULATOR

    @property
    def names(self) -> tuple[str, ...]:
        """By which the cases are known that should catch it: its clauses, and its group."""
        return (*self.clauses, self.group)


MUTANTS: dict[str, Mutant] = {}
"""All mutants by name; `catalogue` fills it."""


def mutant(
    *clauses: str,
    wraps: tuple[Any, str] | None = None,
    by: Callable[[Patch, Any], None] | None = None,
    also: Callable[[Patch], None] | None = None,
    url: str = EMULATOR,
) -> Callable[[Replacement], Replacement]:
    """Make a function a mutant, with its name in dashes and its docstring as the sentence.

    Parameters
    ----------
    *clauses : str
        That it breaks.
    wraps : tuple of an owner and a name, optional
        The function of the emulator that the mutant replaces, as `Patch.around` says.
    by : callable, optional
        Without ``wraps``: the seam that takes a `Patch` and the mutant. Without either the mutant takes a `Patch`.
    also : callable, optional
        With ``wraps``: what else the mutant changes.
    url : str
        Of a device that shows it.

    Raises
    ------
    ValueError
        If a clause is unknown, there is no docstring, or there is one of this name.
    """

    def enter(function: Replacement) -> Replacement:
        name = function.__name__.replace("_", "-")
        sentence = re.sub(r"\s+", " ", inspect.getdoc(function) or "").strip()
        if not sentence or not clauses or name in MUTANTS:
            raise ValueError(f"mutant {name!r} needs a clause, a sentence and a name of its own")
        for clause in clauses:
            resolve(clause)

        def change(patch: Patch) -> None:
            if wraps is not None:
                patch.around(*wraps)(function)
            elif by is not None:
                by(patch, function)
            else:
                function(patch)
            if also is not None:
                also(patch)

        group = function.__module__.rpartition(".")[2].replace("_", "-")
        MUTANTS[name] = Mutant(name, group, clauses, sentence, change, url)
        return function

    return enter


@contextmanager
def applied(chosen: Mutant) -> Iterator[None]:
    """Break the emulators of this process as long as the context lasts."""
    patch = Patch()
    try:
        chosen.apply(patch)
        yield
    finally:
        patch.undo()
