"""Loads all modules that judging a mutant needs, cases included, once; the judging processes are forks of this one."""

from __future__ import annotations

from ..running import catalogue
from .catalogue import MUTANTS

__all__ = ["CASES", "MUTANTS"]

CASES = catalogue()
