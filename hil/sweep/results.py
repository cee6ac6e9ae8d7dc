"""The results of a sweep as one Parquet file, whose bytes depend on the designs and the version of phasewire alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import InputFileError
from ...base.extras import needing
from ...base.storage import FilePath, open_plain, replacing
from .design import FIELDS, UNITS
from .files import MOST_ROWS, Sweep
from .journal import RowResult
from .measures import MEASURE_UNITS, MEASURES

__all__ = ["PROBLEM", "Results", "read_results", "write_results"]

FORMAT = "phasewire-sweep-1"
KEY = b"phasewire"
PROBLEM = "problem"
MOST_BYTES = 2**28


class Results(NamedTuple):
    """A table of results."""

    fingerprint: str
    """Of the sweep."""
    columns: dict[str, list[Any]]
    """By name, the values of each row: the fields of the designs, their measures, and ``problem``, which says why there
    are none. None is no value."""

    def __repr__(self) -> str:
        return f"Results({len(self.columns[PROBLEM])} rows, {len(self.problems)} without measures)"

    @property
    def problems(self) -> dict[int, str]:
        """Why rows have no measures, by their numbers."""
        return {row: problem for row, problem in enumerate(self.columns[PROBLEM]) if problem is not None}

    def numbers(self, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """A column of numbers; NaN is no value."""
        return np.array([np.nan if value is None else value for value in self.columns[name]], np.float64)


def write_results(path: FilePath, sweep: Sweep, done: Mapping[int, RowResult], fingerprint: str) -> None:
    """Write the results of all rows to a Parquet file, completely or not at all.

    Raises `MissingExtraError` if pyarrow is not installed, and `OSError` if it cannot be written.
    """
    with needing("scale", "a sweep"):
        import pyarrow
        from pyarrow import parquet

    kinds = {"int": pyarrow.int64(), "float": pyarrow.float64(), "str": pyarrow.string()}
    units = UNITS | MEASURE_UNITS
    results = [done[row] for row in range(len(sweep))]
    columns = sweep.columns()
    columns |= {name: [getattr(result.measures, name, None) for result in results] for name in MEASURES}
    columns[PROBLEM] = [result.problem for result in results]
    fields = [
        pyarrow.field(name, kinds[kind], metadata={"unit": units[name]} if name in units else None)
        for name, kind in (FIELDS | MEASURES | {PROBLEM: "str"}).items()
    ]
    about = json.dumps({"format": FORMAT, "fingerprint": fingerprint})
    table = pyarrow.table(columns, schema=pyarrow.schema(fields, metadata={KEY: about}))
    with replacing(path) as part:
        parquet.write_table(table, part)


def read_results(path: FilePath) -> Results:
    """Read what `write_results` wrote.

    Raises
    ------
    InputFileError
        If it is anything else.
    MissingExtraError
        If pyarrow is not installed.
    OSError
        If it cannot be opened.
    """
    with needing("scale", "a sweep"):
        import pyarrow
        from pyarrow import parquet

    with open_plain(path) as file:
        if (size := file.seek(0, 2)) > MOST_BYTES:
            raise InputFileError(f"{path} has {size} bytes; results of a sweep have at most {MOST_BYTES}")
        file.seek(0)
        try:
            opened = parquet.ParquetFile(file)
            about = json.loads((opened.schema_arrow.metadata or {})[KEY])
            names = opened.schema_arrow.names
            if about["format"] != FORMAT or names != [*FIELDS, *MEASURES, PROBLEM]:
                raise ValueError(f"it has the format {about['format']!r} and the columns {', '.join(names)}")
            if opened.metadata.num_rows > MOST_ROWS:
                raise ValueError(f"it has {opened.metadata.num_rows} rows")
            return Results(str(about["fingerprint"]), opened.read().to_pydict())
        except (pyarrow.ArrowException, OSError, KeyError, TypeError, ValueError) as error:
            raise InputFileError(f"{Path(path)} has no results of a sweep: {error}") from error
