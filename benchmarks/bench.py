"""What the benchmark scripts beside it share: the clock, the options and the record of what was measured."""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

__all__ = ["machine", "median", "options", "record"]

PATIENCE = 0.4  # seconds for one median


def median(call: Callable[[], object]) -> float:
    """Median time of a call in seconds."""
    call()
    times: list[float] = []
    end = perf_counter() + PATIENCE
    while perf_counter() < end or len(times) < 3:
        before = perf_counter()
        call()
        times.append(perf_counter() - before)
    return statistics.median(times)


def options(doc: str | None) -> argparse.ArgumentParser:
    """A script's parser, with --json."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write every number to FILE")
    return parser


def machine(*more: str) -> str:
    """What the numbers were measured on."""
    python = f"Python {platform.python_version()}"
    return ", ".join((platform.machine(), f"{os.cpu_count()} cores", python, f"NumPy {np.__version__}", *more))


def record(path: Path | None, figures: Any) -> None:
    """Write the numbers, if a file was named."""
    if path is not None:
        path.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
