"""Cycles of the controller's kernels, executed instruction by instruction: the numbers of BUD-003 and BUD-008.

``python benchmarks/xs1_controller.py`` prints them; they are the same on every machine. Each pair is the count if
instructions are fetched without delay, and that under the pessimistic rule.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

from phasewire.firmware.xmos.controller import CASES, FUNCTIONS, SPLITS, Fetch, call, expected, pass_blocks
from phasewire.protocol.board import CORE_HZ, CYCLES_PER_PERIOD

FETCHES: tuple[Fetch, ...] = ("off", "pessimistic")
STEADY = 6  # updates, one in every period


def by_case() -> list[dict[str, Any]]:
    """Sorting of each case by three threads, with and without a fifth thread that never pauses."""
    return [
        {
            "case": case.name,
            "reason": expected(case).reason.name,
            "four threads": [pass_blocks([case], fetch=fetch)[0].sorted_cycles for fetch in FETCHES],
            "five threads": [pass_blocks([case], fetch=fetch, busy=True)[0].sorted_cycles for fetch in FETCHES],
        }
        for case in CASES
    ]


def by_threads() -> list[dict[str, Any]]:
    """Sorting by 1 to 4 threads, and updates in every period."""
    case, rows = CASES[2], []
    for threads, split in SPLITS.items():
        row: dict[str, Any] = {"threads": threads}
        for name, busy in (("sender pauses", False), ("sender busy", True)):
            row[name] = [pass_blocks([case], split=split, fetch=fetch, busy=busy)[0].sorted_cycles for fetch in FETCHES]
        row["updates/s"] = CORE_HZ // row["sender busy"][1]
        if threads > 1:
            passed = [
                pass_blocks([case] * STEADY, split=split, fetch=fetch, interval=CYCLES_PER_PERIOD) for fetch in FETCHES
            ]
            row["40 000/s"] = [max(passage.sorted_cycles for passage in passages) for passages in passed]
        rows.append(row)
    return rows


def by_function() -> list[dict[str, Any]]:
    """The reference device's functions as compiled, in one of five threads."""
    rows = []
    for name, what in FUNCTIONS.items():
        calls = [call(name, CASES[2], fetch=fetch) for fetch in FETCHES]
        rows.append(
            {
                "function": name,
                "what": what,
                "instructions": calls[0].instructions,
                "cycles": [one.cycles for one in calls],
            }
        )
    return rows


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON")
    tables = {"by case": by_case(), "by threads": by_threads(), "by function": by_function()}
    if parser.parse_args().json:
        print(json.dumps(tables, indent=1))
        return
    for name, rows in tables.items():
        print(f"\n{name}")
        print(" | ".join(rows[-1]))
        for row in rows:
            print(
                " | ".join(
                    " to ".join(map(str, cell)) if isinstance(cell, list) else str(cell) for cell in row.values()
                )
            )


if __name__ == "__main__":
    main()
