"""The command line in this process, as tests of commands use it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest
from phasewire.__main__ import main

__all__ = ["Outcome", "Run", "runner"]


class Outcome(NamedTuple):
    """The result of a command."""

    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


def runner(captured: pytest.CaptureFixture[str]) -> Run:
    """A function that runs a command and captures its output."""

    def run(*arguments: str) -> Outcome:
        with pytest.raises(SystemExit) as exited:
            main(arguments)
        return Outcome(int(exited.value.code or 0), *captured.readouterr())

    return run
