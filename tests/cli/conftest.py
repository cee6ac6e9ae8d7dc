from __future__ import annotations

from pathlib import Path

import pytest

from .runner import Run, runner


@pytest.fixture
def phasewire(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the command line in a new folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PHASEWIRE_DEVICE", raising=False)
    return runner(capsys)
