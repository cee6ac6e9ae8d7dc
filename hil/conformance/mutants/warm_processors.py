"""Loads what `warm` does and what executes the processors' program; see there."""

from __future__ import annotations

import gc

from ..running import RunOptions, run_conformance
from .warm import CASES, MUTANTS

__all__ = ["CASES", "MUTANTS"]

run_conformance(RunOptions("emulator:?firmware=xs1", only=("pulses/width-0",), groups=("pulses",), again=False))
gc.freeze()
