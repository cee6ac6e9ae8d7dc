"""Runs a sweep: what is not done yet is measured, kept in a journal, and in the end written as one file."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from ...base.errors import InputFileError
from ...base.extras import needing
from ...base.storage import FilePath, check_outputs
from .crews import LIBRARIES, PROCESSES, Crew, Task, check_crew, open_crew
from .files import Sweep
from .journal import Journal, journal_path
from .results import read_results, write_results

__all__ = ["SweepRun", "run_sweep"]


class SweepRun(NamedTuple):
    """What a run did."""

    kept: int
    """Rows that an earlier run had measured."""
    measured: int
    """Rows that this one measured."""
    workers: int
    """How many of them at a time."""


def run_sweep(
    sweep: Sweep,
    output: FilePath,
    *,
    on: str = PROCESSES,
    workers: int | None = None,
    on_begin: Callable[[Crew], None] | None = None,
    on_row: Callable[[int, int], None] | None = None,
) -> SweepRun:
    """Measure all designs of a sweep, and write a Parquet file.

    Parameters
    ----------
    sweep : Sweep
        What to measure.
    output : str or Path
        The file to write. Until all rows are done, those that are stand in a journal beside it, ``OUTPUT.unfinished``:
        another run goes on from there. If the output has the results of this sweep already, nothing is measured.
    on, workers
        Who measures, see `open_crew`.
    on_begin : callable, optional
        A function that is called with the crew when it is ready.
    on_row : callable, optional
        A function that is called with the number of rows that are done, and of all.

    Raises
    ------
    ValueError
        If ``on`` or ``workers`` are not possible.
    InputFileError
        If the output is something else, or if there is a journal of another sweep.
    MissingExtraError
        If pyarrow, or Dask if it is used, is not installed.
    ClusterError
        As `open_crew`, or if the cluster is lost.
    OSError
        If the output cannot be written, or another process writes it.
    """
    check_crew(on, workers)
    check_outputs([output])
    with needing("scale", "a sweep"):
        import pyarrow.parquet  # noqa: F401  # before the work, which takes long
    versions = " ".join(f"{name} {version(name)}" for name in LIBRARIES)
    fingerprint, path = sweep.fingerprint(versions), journal_path(Path(output))
    if Path(output).exists():
        if not _holds(output, fingerprint):
            raise InputFileError(
                f"{output} has something else than the results of this sweep; delete it, or name another"
            )
        if not path.exists():
            return SweepRun(len(sweep), 0, 0)
    with Journal(path, fingerprint, len(sweep)) as journal:
        kept, busy = len(journal.done), 0
        tasks = [
            Task(row, design, sweep.points[design.source])
            for row, design in enumerate(sweep.designs)
            if row not in journal.done
        ]
        if tasks:
            with open_crew(on, workers) as crew:
                busy = crew.workers
                if on_begin is not None:
                    on_begin(crew)
                for row, result in crew.measured(tasks):
                    journal.add(row, result)
                    if on_row is not None:
                        on_row(len(journal.done), len(sweep))
        write_results(output, sweep, journal.done, fingerprint)
        journal.remove()
    return SweepRun(kept, len(tasks), busy)


def _holds(output: FilePath, fingerprint: str) -> bool:
    """Whether a file has the results of a sweep."""
    try:
        return read_results(output).fingerprint == fingerprint
    except (InputFileError, OSError):
        return False
