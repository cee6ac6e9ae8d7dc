"""All mutants: importing this fills `MUTANTS`."""

from __future__ import annotations

from . import acknowledgements, blocks, flow, modulation, numbering, pulses, safety, sequences, sorting, timing
from .patching import MUTANTS

__all__ = ["MUTANTS"]

GROUPS = (blocks, numbering, acknowledgements, timing, pulses, sorting, flow, sequences, modulation, safety)
