"""Mutants of requests, chain, interfaces, firmware and text: each comes up, is broken, and is undone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.patching import Patch, applied
from phasewire.hil.conformance.running import Options, open_bench

from tests.hil.conformance.mutant_signs import SIGNS

GROUPS = {
    "chain",
    "endpoints",
    "enumeration",
    "requests",
    "console",
    "dfu",
    "long-run",
    "robustness",
    "serial",
    "firmware",
    "power",
    "versions",
}
MINE = {name: mutant for name, mutant in MUTANTS.items() if mutant.group in GROUPS}


@contextmanager
def broken(name: str) -> Iterator[Bench]:
    """A bench with a mutant."""
    with applied(MUTANTS[name]), open_bench(Options(MUTANTS[name].url)) as bench:
        yield bench


class Recorder(Patch):
    """A patch that remembers what stood in the place of what it changed."""

    def __init__(self) -> None:
        super().__init__()
        self.before: dict[tuple[int, str], tuple[Any, str, Any]] = {}

    def replace(self, owner: Any, name: str, value: Any) -> None:
        before = vars(owner)[name]
        super().replace(owner, name, value)
        self.before.setdefault((id(owner), name), (owner, name, before))


@pytest.mark.parametrize("name", MINE)
def test_a_mutant_comes_up_answers_info_and_is_undone(name: str) -> None:
    with open_bench(Options(MINE[name].url)) as sound:
        channels = sound.info.channels
    patch = Recorder()
    MINE[name].apply(patch)
    changed = patch.before.values()
    assert changed
    assert any(vars(owner)[attribute] is not value for owner, attribute, value in changed)
    patch.undo()
    assert all(vars(owner)[attribute] is value for owner, attribute, value in changed)
    with broken(name) as bench:
        assert bench.info.channels == channels
        bench.begin_case("alive")


@pytest.mark.parametrize("name", SIGNS)
def test_a_mutant_shows_itself_where_a_sound_device_does_not(name: str) -> None:
    with broken(name) as bench:
        bench.begin_case("sign")
        assert SIGNS[name](bench)
    with open_bench(Options(MINE[name].url)) as bench:
        bench.begin_case("sign")
        assert not SIGNS[name](bench)
