"""Commands that ask a device one thing or tell it one, and what they say where it is not the one that was meant."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from phasewire import Emulator, Pulses, open_device
from phasewire.__main__ import main
from phasewire.emulator import faults


class Outcome(NamedTuple):
    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


@pytest.fixture
def phasewire(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the command line in a new folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PHASEWIRE_DEVICE", raising=False)

    def run(*arguments: str) -> Outcome:
        with pytest.raises(SystemExit) as exited:
            main(arguments)
        captured = capsys.readouterr()
        return Outcome(int(exited.value.code or 0), captured.out, captured.err)

    return run


def pulses(width: int) -> Pulses:
    return Pulses(np.zeros(320, int), np.full(320, width))


def test_what_did_not_begin_together_is_read_back_as_such(phasewire: Run, emulator: Emulator) -> None:
    """REQ-007: where a processor has missed a commit."""
    device = open_device(emulator.url)
    device.show(pulses(1))
    emulator.run(10)
    emulator.inject(faults.LostToken(message="slice", processor=3))
    device.show(pulses(2))
    emulator.run(10)
    device.close()
    outcome = phasewire("read-back", "--device", emulator.url, "--json", "-")
    record = json.loads(outcome.out)
    assert (record["since_period"], record["mixed"]) == (None, True)
    assert "did not begin together" in outcome.err
    assert str(2**64 - 1) not in outcome.out + outcome.err
