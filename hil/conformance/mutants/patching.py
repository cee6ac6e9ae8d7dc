"""Mutants: emulators that are broken in one way each, and how to make one in this process.

A mutant is a function with the decorator `mutant`. Either it replaces one function of the emulator, or it goes to a
seam that the decorator names, or it changes classes and modules of the emulator through a `Patch`.
The emulator does not know about mutants. A change affects every emulator of the process until it is undone, so a run
against a mutant needs a process of its own.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from ..clauses import resolve

__all__ = ["MUTANTS", "Mutant", "Patch", "applied", "mutant"]

EMULATOR = "emulator:"
Replacement = TypeVar("Replacement", bound=Callable[..., Any])


class Patch:
    """Changes that can be undone."""

    def __init__(self) -> None:
        self._before: list[tuple[Any, str, Any]] = []

    def replace(self, owner: Any, name: str, value: Any) -> None:
        """Give an attribute of a class, a module or an object another value.

        Raises
        ------
        AttributeError
            If the owner has no such attribute, so that no mutant misses its target.
        """
        before = inspect.getattr_static(owner, name)
        if name not in vars(owner):
            raise AttributeError(f"{name} is not {owner!r}'s own")
        self._before.append((owner, name, before))
        setattr(owner, name, value)

    def wrap(self, owner: Any, name: str, around: Callable[[Any], Any]) -> None:
        """Wrap a function: ``around`` takes the original and returns the replacement, which may call it.

        For a static or class method the original is the function beneath, for a property its getter.
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
        """Decorate the replacement of a function: it takes the original, then the arguments of a call."""

        def put(replacement: Replacement) -> Replacement:
            self.wrap(owner, name, lambda original: lambda *given, **named: replacement(original, *given, **named))
            return replacement

        return put

    def undo(self) -> None:
        """Undo everything."""
        for owner, name, value in reversed(self._before):
            setattr(owner, name, value)
        self._before.clear()


@dataclass(frozen=True)
class Mutant:
    """One way in which an emulator is broken.

    Parameters
    ----------
    name : str
    group : str
        The file that defines it.
    clauses : tuple of str
        The clauses that it breaks.
    sentence : str
        What it does wrong, and how a firmware author might have made the mistake.
    apply : callable
        Breaks the emulator.
    url : str
        A device that shows it.
    """

    name: str
    group: str
    clauses: tuple[str, ...]
    sentence: str
    apply: Callable[[Patch], None]
    url: str = EMULATOR

    @property
    def names(self) -> tuple[str, ...]:
        """What selects the cases that should catch it: its clauses and its group."""
        return (*self.clauses, self.group)


MUTANTS: dict[str, Mutant] = {}
"""All mutants by name; `catalogue` fills it."""


def mutant(
    *clauses: str,
    wraps: tuple[Any, str] | None = None,
    by: Callable[[Patch, Any], None] | None = None,
    also: Callable[[Patch], None] | None = None,
    each: Mapping[str, str] | None = None,
    url: str = EMULATOR,
) -> Callable[[Replacement], Replacement]:
    """Make a function a mutant. Its name with dashes is the mutant's name, its docstring the sentence.

    Parameters
    ----------
    *clauses : str
        The clauses that it breaks.
    wraps : tuple of an owner and a name, optional
        The function of the emulator that the mutant replaces, as in `Patch.around`.
    by : callable, optional
        Without ``wraps``: the seam that takes a `Patch` and the mutant. Without either, the mutant takes a `Patch`.
    also : callable, optional
        What else the mutant changes, with ``wraps``.
    each : mapping of str to str, optional
        Without ``wraps`` and ``by``: the function is a family of mutants. It takes a `Patch` and one of these names,
        with which the mutant's name ends; the words for it stand for ``{}`` in the sentence.
    url : str
        A device that shows it.

    Raises
    ------
    ValueError
        If a clause is unknown, the docstring is missing, or the name is taken.
    """

    def enter(function: Replacement) -> Replacement:
        stem = function.__name__.replace("_", "-")
        sentence = re.sub(r"\s+", " ", inspect.getdoc(function) or "").strip()
        for clause in clauses:
            resolve(clause)

        def change(member: str, patch: Patch) -> None:
            if wraps is not None:
                patch.around(*wraps)(function)
            elif by is not None:
                by(patch, function)
            else:
                function(patch, *filter(None, [member]))
            if also is not None:
                also(patch)

        group = function.__module__.rpartition(".")[2].replace("_", "-")
        for member, words in ({"": ""} if each is None else each).items():
            name = f"{stem}-{member}".strip("-")
            if not sentence or not clauses or name in MUTANTS:
                raise ValueError(f"mutant {name!r} needs a clause, a sentence and a name of its own")
            told = sentence.replace("{}", words)
            MUTANTS[name] = Mutant(name, group, clauses, told, partial(change, member), url)
        return function

    return enter


@contextmanager
def applied(chosen: Mutant) -> Iterator[None]:
    """Break the emulators of this process while the context lasts."""
    patch = Patch()
    try:
        chosen.apply(patch)
        yield
    finally:
        patch.undo()
