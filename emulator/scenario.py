"""Scenario files: what goes wrong with an emulated device, and when, in TOML.

A scenario lists faults; each names itself, and beside that has the fields of its class in `faults`::

    [[fault]]
    name = "stuck-high"
    processor = 5
    bit = 7
    period = 40000
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from ..base.errors import InputFileError
from ..base.storage import FilePath, read_toml
from .faults import FAULTS, InjectedFault
from .faults.fault import limits

__all__ = ["fault_of", "read_scenario"]

LIST, NAME = "fault", "name"


def read_scenario(path: FilePath) -> tuple[InjectedFault, ...]:
    """The faults that a file lists, for `Emulator.inject`.

    Raises
    ------
    InputFileError
        If the file is no TOML, or an entry no fault; it says which, and what would be right.
    OSError
        If the file cannot be read.
    """
    content = read_toml(path)
    entries = content.pop(LIST, [])
    if content:
        raise InputFileError(
            f"{path}: unknown {next(iter(content))!r}; a scenario holds nothing but [[{LIST}]] entries"
        )
    if not isinstance(entries, list):
        raise InputFileError(f"{path}: {LIST!r} is no list; each fault begins with [[{LIST}]]")
    return tuple(fault_of(f"{path}, fault {number}", entry) for number, entry in enumerate(entries, start=1))


def fault_of(where: str, entry: Mapping[str, Any]) -> InjectedFault:
    """The fault that an entry describes: its name and its fields.

    Raises
    ------
    InputFileError
        If it is no fault; ``where`` says where the entry stands.
    """
    if not isinstance(entry, Mapping):
        raise InputFileError(f"{where}: {entry!r} is no table; each fault begins with [[{LIST}]]")
    if NAME not in entry:
        raise InputFileError(f"{where}: it has no {NAME}; known are {', '.join(FAULTS)}")
    values = dict(entry)
    name = values.pop(NAME)
    kind = FAULTS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise InputFileError(f"{where}: unknown {NAME} {name!r}; known are {', '.join(FAULTS)}")
    allowed = limits(kind)
    for field, value in values.items():
        if field not in allowed:
            raise InputFileError(f"{where}: {name}: unknown {field} = {value!r}; it has {', '.join(allowed)}")
    needed = [field.name for field in fields(kind) if field.default is MISSING]
    for field in needed:
        if field not in values:
            raise InputFileError(f"{where}: {name}: there is no {field}; it must be {allowed[field][0]}")
    try:
        return kind(**values)
    except ValueError as error:
        raise InputFileError(f"{where}: {error}") from error
