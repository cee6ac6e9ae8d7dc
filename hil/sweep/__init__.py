"""Sweeps: many designs of an array measured, on all cores or on a Dask cluster, and resumable after a kill.

A file (`files`) becomes a `Sweep` of checked designs (`design`). Crews (`crews`) measure them (`measures`), a
`Journal` keeps what is done (`journal`), and the end is one Parquet file (`results`), whose bytes depend on the designs
alone: not on the crew, and not on kills. `running` does it all; `picture` draws it.
"""

from __future__ import annotations

from .design import Design
from .files import Sweep, read_sweep
from .measures import Measures, measure
from .results import read_results
from .running import run_sweep

__all__ = ["Design", "Measures", "Sweep", "measure", "read_results", "read_sweep", "run_sweep"]


def __dir__() -> list[str]:
    return __all__
