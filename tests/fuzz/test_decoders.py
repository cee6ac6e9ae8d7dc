"""The checks of `make fuzz`, on each decoder's seeds, on bytes near them and on some others."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz.decoders import GROUPS, seeds
from tests.fuzz.readers import READERS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("group", GROUPS)
def test_the_seeds(group: str) -> None:
    assert len(seeds(group)) > 20
    for seed in seeds(group):
        GROUPS[group](seed)


@pytest.mark.parametrize("group", GROUPS)
@given(data=st.data())
def test_bytes_near_the_seeds(group: str, data: st.DataObject) -> None:
    seed = bytearray(data.draw(st.sampled_from(seeds(group))))
    begin = data.draw(st.integers(0, len(seed)))
    end = data.draw(st.integers(begin, min(begin + 4, len(seed))))
    seed[begin:end] = data.draw(st.binary(max_size=8))
    GROUPS[group](bytes(seed))


@pytest.mark.parametrize("group", sorted(GROUPS.keys() - READERS.keys()))  # readers refuse such bytes at once
@given(data=st.binary(max_size=600))
def test_other_bytes(group: str, data: bytes) -> None:
    GROUPS[group](data)


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["0"], ["nonsense"], []])
def test_an_error_names_an_unknown_group(arguments: list[str]) -> None:
    pytest.importorskip("atheris", reason="make fuzz installs atheris if it has a wheel")
    command = [sys.executable, "-m", "tests.fuzz", *arguments]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 1
    assert "is neither a number of seconds, at least 1, nor a group: blocks, replies" in ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS)
def test_the_fuzzer_runs(group: str) -> None:
    """Two seconds of each; `make fuzz` takes more."""
    pytest.importorskip("atheris", reason="make fuzz installs atheris if it has a wheel")
    command = [sys.executable, "-m", "tests.fuzz", group, "-max_total_time=2", "-runs=2000"]
    ended = subprocess.run(
        command, cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, timeout=120, check=False
    )
    assert ended.returncode == 0, ended.stderr[-4000:]
