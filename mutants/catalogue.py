"""All mutants: importing this module fills `MUTANTS`."""

from __future__ import annotations

from . import (
    acknowledgements,
    blocks,
    chain,
    combinations,
    console,
    dfu,
    doors,
    endpoints,
    enumeration,
    firmware,
    flow,
    long_run,
    modulation,
    numbering,
    power,
    pulses,
    requests,
    robustness,
    safety,
    sequences,
    serial,
    sorting,
    timing,
    versions,
    ways_out,
    widths,
)
from .patching import MUTANTS

__all__ = ["MUTANTS"]

GROUPS = (
    blocks,
    numbering,
    acknowledgements,
    requests,
    versions,
    timing,
    pulses,
    sorting,
    flow,
    sequences,
    modulation,
    safety,
    ways_out,
    combinations,
    chain,
    enumeration,
    endpoints,
    power,
    doors,
    dfu,
    firmware,
    serial,
    console,
    robustness,
    long_run,
    widths,
)
