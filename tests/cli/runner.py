"""The command line in this process, as tests of commands use it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest
from phasewire.__main__ import main

__all__ = ["Outcome", "Run", "runner"]


class Outcome(NamedTuple):
    """What came of a command."""

    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


def runner(captured: pytest.CaptureFixture[str]) -> Run:
    """What runs a command and catches what it says."""

    def run(*arguments: str) -> Outcome:
        with pytest.raises(SystemExit) as exited:
            main(arguments)
        return Outcome(int(exited.value.code or 0), *captured.readouterr())

    return run
