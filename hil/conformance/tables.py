"""TOML tables written by people, and errors that name the key, its value and what would be right.

It does not know the meaning of the tables.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ...base.errors import InputFileError
from ...base.storage import FilePath, read_toml

__all__ = ["Table", "read_table"]


@dataclass(frozen=True)
class Table:
    """A table of a TOML file, and its place."""

    path: FilePath
    """The file."""
    name: str
    """The table's name; empty for the whole file."""
    values: dict[str, Any]
    """What is in it."""

    def error(self, key: str, problem: str) -> InputFileError:
        """An exception about a key of this table."""
        where = f"{self.path}, [{self.name}]" if self.name else str(self.path)
        value = self.values.get(key)
        shown = key if value is None or isinstance(value, dict) else f"{key} = {value!r}"
        return InputFileError(f"{where}: {shown}: {problem}")

    def check_keys(self, known: Iterable[str]) -> None:
        """Raise `InputFileError` if a key is not among these."""
        names = tuple(known)
        for key in self.values:
            if key not in names:
                raise self.error(key, f"no such key; known are {', '.join(names)}")

    def text(self, key: str) -> str:
        """The text of a key; raises `InputFileError` if it is missing, no text, or empty."""
        value = self.values.get(key)
        if value is None:
            raise self.error(key, "it is missing; it must be text that is not empty")
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, "it must be text that is not empty, in quotes")
        return value.strip()

    def table(self, key: str) -> Table:
        """A table in this one, empty if there is none; raises `InputFileError` if the key is something else."""
        value = self.values.get(key, {})
        name = f"{self.name}.{_written(key)}" if self.name else _written(key)
        if not isinstance(value, dict):
            raise self.error(key, f"it must be a table, which begins with [{name}]")
        return Table(self.path, name, value)


def _written(key: str) -> str:
    """A key in TOML notation."""
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else json.dumps(key, ensure_ascii=False)


def read_table(path: FilePath) -> Table:
    """The whole of a TOML file.

    Raises `InputFileError` if it is no TOML, or not UTF-8, and `OSError` if it cannot be read.
    """
    return Table(path, "", read_toml(path))
