"""How fast blocks are packed, unpacked and judged, beside construct and beside copying the same memory.

``make bench`` runs it after the other benchmarks: one table of medians, all from one run on one thread. Compare rows;
absolute times belong to the machine.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from medians import median
from phasewire.protocol import Block, Pulses, Update, pack, pack_updates, unpack, unpack_updates
from phasewire.protocol.layout.blocks import BLOCK

BATCHES = (1, 8, 64, 256, 1024)


def measure() -> list[dict[str, Any]]:
    """Seconds per update of each way, over batches."""
    rng = np.random.default_rng(1)
    rows = []

    def note(what: str, batch: int, call: Callable[[], object]) -> None:
        rows.append({"what": what, "batch": batch, "seconds": median(call) / batch})

    for k in BATCHES:
        phase = rng.integers(0, 100, (k, 320), dtype=np.uint8)
        width = rng.integers(0, 26, (k, 320), dtype=np.uint8)
        periods = np.arange(k, dtype=np.uint64)
        blocks = pack_updates(phase, width, 1, periods)
        again, copies = np.empty_like(blocks), (np.empty_like(phase), np.empty_like(width))

        def read_pulses(phase: Any = phase, width: Any = width, copies: Any = copies) -> None:
            copies[0][:], copies[1][:] = phase, width

        note("pack", k, lambda: pack_updates(phase, width, 1, periods, out=again))
        note("unpack and judge", k, lambda: unpack_updates(blocks))
        note("CRC-32 alone", k, lambda: list(map(crc32, blocks)))
        note("copying the pulses", k, read_pulses)
        note("copying the blocks", k, lambda: np.copyto(again, blocks))
    block = Block(Update(Pulses(phase[0], width[0]), 1), 1)
    packed = pack(block)
    parsed = BLOCK.parse(packed)
    note("one by one: pack", 1, lambda: pack(block))
    note("one by one: unpack", 1, lambda: unpack(packed))
    note("construct: build", 1, lambda: BLOCK.build(parsed))
    note("construct: parse", 1, lambda: BLOCK.parse(packed))
    return rows


def main() -> None:
    """Measure, print, and write the figures on request."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    arguments = parser.parse_args()
    rows = measure()
    seconds = {(row["what"], row["batch"]): row["seconds"] for row in rows}
    print(f"{'':28}{'batch':>6}{'ns/update':>12}{'updates/s':>14}{'× construct':>13}{'× copying':>11}")
    for row in rows:
        what, batch = row["what"], row["batch"]
        peer = {"pack": "construct: build", "unpack and judge": "construct: parse"}.get(what)
        floor = seconds.get(("copying the pulses", batch), 0) + seconds.get(("copying the blocks", batch), 0)
        ratios = f"{seconds[peer, 1] / row['seconds']:>13.0f}{row['seconds'] / floor:>11.1f}" if peer else ""
        print(f"{what:28}{batch:>6}{row['seconds'] * 1e9:>12.0f}{1 / row['seconds']:>14,.0f}{ratios}")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
