"""The journal of a sweep: the results of the rows that are done, in a file beside the output until all are.

A first line names the sweep, then comes a line of JSON for each row, in the order in which they ended. Python writes
floats so that they are read back bit for bit. A kill can only leave a last line that is not whole, which is dropped.
"""

from __future__ import annotations

import json
import math
import os
import stat
from contextlib import ExitStack
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any, NamedTuple, Self

from ...base.errors import InputFileError
from ...base.storage import claimed
from .measures import MEASURES, Measures

__all__ = ["Journal", "RowResult", "journal_path"]

FORMAT = "phasewire-sweep-journal-1"
SYNC_SECONDS = 1.0
"""A power cut costs the rows of so many seconds, a kill none."""


class RowResult(NamedTuple):
    """The result of a row: its measures, or why there are none."""

    measures: Measures | None
    problem: str | None = None


def journal_path(output: Path) -> Path:
    """The journal of an output."""
    return output.with_name(f"{output.name}.unfinished")


class Journal:
    """Open, and locked against a second sweep to the same output, until it is closed; without rows it does not stay.

    It is of a sweep with a fingerprint and so many rows. Raises `InputFileError` if it is of another sweep, or is no
    journal, and `OSError` if another sweep writes it, it cannot be opened, or the disk is full.
    """

    done: dict[int, RowResult]
    """Results by the number of the row."""

    def __init__(self, path: Path, fingerprint: str, rows: int) -> None:
        self.path, self.done, self._synced = path, {}, monotonic()
        self._file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NONBLOCK", 0), 0o666), "r+b")
        self._claim = ExitStack()
        try:
            if not stat.S_ISREG(os.fstat(self._file.fileno()).st_mode):
                raise InputFileError(f"{path} must be a plain file: it keeps the rows of a sweep that are done")
            self._claim.enter_context(claimed(path))
            self._read({"format": FORMAT, "fingerprint": fingerprint, "rows": rows})
        except BaseException:
            self._claim.close()
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._claim:
            if not self.done:
                self.remove()
            try:
                self._file.close()
            except OSError:  # of a full disk, which an earlier error names
                if kind is None:
                    raise

    def add(self, row: int, result: RowResult) -> None:
        """Keep the result of a row."""
        self.done[row] = result
        measures = None if result.measures is None else list(vars(result.measures).values())
        self._write([row, measures, result.problem])
        if monotonic() - self._synced > SYNC_SECONDS:
            os.fsync(self._file.fileno())
            self._synced = monotonic()

    def remove(self) -> None:
        """Delete it, when its results are elsewhere."""
        self.path.unlink()

    def _read(self, header: dict[str, Any]) -> None:
        first = self._file.readline(2**12)
        whole = len(first)
        if _line(header).startswith(first) and not first.endswith(b"\n"):  # new, or killed before it was whole
            self._file.seek(0)
            self._file.truncate()
            self._write(header)
            return
        if _parsed(first) != header:
            raise InputFileError(
                f"{self.path} is not of this sweep: rows or points were changed, or phasewire was; delete it, or name "
                "another output"
            )
        for line in self._file:
            if not line.endswith(b"\n"):  # a kill cut it
                break
            if (entry := _entry(_parsed(line), header["rows"])) is not None:  # a damaged row is measured again
                row, self.done[row] = entry
            whole += len(line)
        self._file.seek(whole)
        self._file.truncate()

    def _write(self, value: object) -> None:
        try:
            self._file.write(_line(value))
            self._file.flush()
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from error


def _line(value: object) -> bytes:
    return json.dumps(value).encode() + b"\n"


def _parsed(line: bytes) -> object:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return None


def _entry(value: Any, rows: int) -> tuple[int, RowResult] | None:
    """The row and the result in a line; None if it is no such line."""
    match value:
        case [int(row), None, str(problem)] if 0 <= row < rows and _is_text(problem):
            return row, RowResult(None, problem)
        case [int(row), [*numbers], None] if 0 <= row < rows and len(numbers) == len(MEASURES):
            if all(_is_of_kind(number, kind) for number, kind in zip(numbers, MEASURES.values(), strict=True)):
                return row, RowResult(Measures(*numbers))
    return None


def _is_text(problem: str) -> bool:
    return problem.encode(errors="ignore").decode() == problem


def _is_of_kind(number: object, kind: str) -> bool:
    if kind == "int":
        return type(number) is int and abs(number) < 2**63
    return number is None or (type(number) is float and not math.isnan(number))
