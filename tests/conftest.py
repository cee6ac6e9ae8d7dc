from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import settings
from phasewire import Emulator, Solution, Sphere, TransducerArray, Wiring, solve

# No deadline: the machines that run this are shared, and a slow moment is no failure.
settings.register_profile("phasewire", deadline=None, max_examples=50)
settings.load_profile("phasewire")


@pytest.fixture(scope="session")
def array() -> TransducerArray:
    return TransducerArray.grid()


@pytest.fixture(scope="session")
def sphere_solution(array: TransducerArray) -> Solution:
    return solve(array, Sphere().sample())


@pytest.fixture(scope="session")
def scrambled() -> Wiring:
    """A wiring that shares nothing with the order of the grid."""
    return Wiring(np.random.default_rng(20_14).permutation(320))


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    with Emulator() as plugged_in:
        yield plugged_in
