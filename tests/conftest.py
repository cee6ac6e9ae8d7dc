from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from phasewire import Emulator, Solution, Sphere, TransducerArray, Wiring, solve

# No deadline: the machines that run this are shared, and a slow moment is no failure.
settings.register_profile("phasewire", deadline=None, max_examples=30)
# A gate gives the same code the same verdict; run by hand, the tests draw fresh examples each time.
settings.register_profile("gate", settings.get_profile("phasewire"), derandomize=True)
settings.load_profile("gate" if os.environ.get("CI") else "phasewire")

# A shell ignores Ctrl-C in its background, and nohup a closed terminal; programs that tests start would inherit that.
for number in (signal.SIGINT, signal.SIGHUP):
    if signal.getsignal(number) == signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def _cache_of_its_own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Tests neither read nor write the user's tables of transducers and file of defaults; kernels are shared."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("PHASEWIRE_CACHE", str(folder))
        patch.setenv("PHASEWIRE_CONFIG", os.devnull)
        yield folder


@pytest.fixture(scope="session")
def array() -> TransducerArray:
    return TransducerArray.grid()


@pytest.fixture(scope="session")
def sphere_solution(array: TransducerArray) -> Solution:
    return solve(array, Sphere().sample())


@pytest.fixture(scope="session")
def scrambled() -> Wiring:
    """A wiring whose order is independent of the grid's."""
    return Wiring(np.random.default_rng(20_14).permutation(320))


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    with Emulator() as plugged_in:
        yield plugged_in
