"""What ``devices --rig`` and ``info`` show of a rig: its devices as one array."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from ..host.finding.rigs import look_at_rig
from ..host.streaming.rig import read_rig
from ..solver.geometry import counted
from .console import console_for, error_console, print_list, write_json

__all__ = ["show_rig"]

COLUMNS = ("device", "url", "serial", "transducers", "centre, mm", "looks to", "periods ahead")


def show_rig(path: Path, json_target: str | None) -> None:
    """Show the devices of a rig file, and how their clocks are related; raises the error of a rig that cannot open."""
    members = read_rig(path)
    with warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always")
        devices, common, error = look_at_rig(members)
    out = console_for(json_target)
    table = Table()
    for column in COLUMNS:
        table.add_column(column, min_width=max(map(len, column.split())))
    for each in devices:
        ahead = "" if each.periods_ahead is None else str(each.periods_ahead)
        centre, looks = _triple([1e3 * length for length in each.centre], 1), _triple(each.direction, 2)
        table.add_row(each.name, each.url, each.serial, str(each.transducers), centre, looks, ahead)
    print_list(out, table, "url", "serial")
    for each in devices:
        problem = f"{each.name}: {each.problem}"
        if each.problem and problem != str(error):  # which comes last
            out.print(problem)
    if common is not None:
        for said in odd:
            if str(common) not in str(said.message):  # which comes below
                error_console().print(f"warning: {said.message}", style="yellow")
        count = sum(each.transducers for each in devices)
        out.print(f"{counted(len(devices), 'device')}, {counted(count, 'transducer')}, {common}.")
    write_json(
        json_target,
        {
            "format": "phasewire-rig-1",
            "devices": [each._asdict() for each in devices],
            "sync_line": None if common is None else common.shared,
            "apart_seconds": None if common is None else common.error,
            "drift_ppm": None if common is None else common.drift_ppm,
        },
    )
    if error is not None:
        raise error


def _triple(values: Sequence[float], digits: int) -> str:
    return " ".join(f"{round(value, digits) + 0.0:g}" for value in values)  # without -0.0
