"""All mutants: importing this fills `MUTANTS`."""

from __future__ import annotations

from . import blocks
from .patching import MUTANTS

__all__ = ["MUTANTS"]

GROUPS = (blocks,)
