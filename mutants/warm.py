"""Loaded once by the process of which those that judge mutants are copies: all that they need, the cases included."""

from __future__ import annotations

from ..hil.conformance.running import catalogue
from .catalogue import MUTANTS

__all__ = ["CASES", "MUTANTS"]

CASES = catalogue()
