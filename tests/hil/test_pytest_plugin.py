"""The fixtures for projects that use phasewire, in a project of their own, which loads no file of this repository."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from platformdirs import user_cache_path

pytestmark = pytest.mark.slow  # pytest runs in pytest

pytest_plugins = ["pytester"]
ROOT = Path(__file__).parents[2]
MODULE = "phasewire.hil.pytest_plugin"
KERNELS = os.environ.get("NUMBA_CACHE_DIR") or str(user_cache_path("phasewire") / "kernels")  # pytester moves the home


@pytest.fixture
def project(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> pytest.Pytester:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # an older installation may lack the entry point
    monkeypatch.setenv("NUMBA_CACHE_DIR", KERNELS)
    monkeypatch.delenv("PHASEWIRE_DEVICE", raising=False)
    return pytester


def test_both_fixtures_are_one_device_which_is_silent_and_unplugged_afterwards(project: pytest.Pytester) -> None:
    project.makepyfile(
        """
        import numpy as np
        from phasewire import open_device
        from phasewire.protocol import Pulses

        seen = []

        def test_plays(phasewire_device, phasewire_emulator):
            seen.append(phasewire_emulator)
            ack = phasewire_device.show(Pulses.from_drive(np.ones(320)))
            phasewire_emulator.run_until(ack.commit_period + 1)
            assert phasewire_emulator.capture().drive(ack.commit_period).all()

        def test_is_silent_after(phasewire_emulator):
            (before,) = seen
            assert before.serial != phasewire_emulator.serial
            silent = before.capture().end_tick // 50 + 20
            before.run_until(silent + 1)
            assert not before.capture().drive(silent).any()

        def test_a_device_alone_is_emulated(phasewire_device):
            assert "emulated" in phasewire_device.name
        """
    )
    result = project.runpytest_subprocess("-p", MODULE, "--phasewire-device", "usb:nowhere", "-k", "not alone")
    result.assert_outcomes(passed=2, deselected=1)
    project.runpytest_subprocess("-p", MODULE, "-k", "alone").assert_outcomes(passed=1, deselected=2)


def test_the_example_of_the_guide_passes(project: pytest.Pytester) -> None:
    guide = (ROOT / "docs" / "how-to/testing-your-project.md").read_text(encoding="utf-8")
    project.makepyfile(*re.findall(r"```python\n(.*?)```", guide, re.DOTALL))
    project.runpytest_subprocess("-p", MODULE).assert_outcomes(passed=1)


def test_the_option_wins_over_the_variable_and_a_missing_device_is_an_error(
    project: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    project.makepyfile("def test_it(phasewire_device): pass")
    monkeypatch.setenv("PHASEWIRE_DEVICE", "nowhere:")
    result = project.runpytest_subprocess("-p", MODULE)
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["phasewire_device: no device at 'nowhere:'*"])
    project.runpytest_subprocess("-p", MODULE, "--phasewire-device", "emulator:").assert_outcomes(passed=1)


def test_pytest_loads_nothing_else_of_phasewire_at_its_start() -> None:
    entry = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["pytest11"]
    assert entry == {"phasewire": MODULE}
    code = f"import {MODULE}, sys; print(*(n for n in sys.modules if n.startswith(('phasewire', 'numpy'))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["phasewire", "phasewire.hil", MODULE]
