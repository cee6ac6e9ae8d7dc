"""How fast drives become pulses and blocks, and answers are read, beside construct and beside copying the same memory.

``make bench`` runs it after the other benchmarks: one table of medians, all from one run on one thread. Compare rows;
absolute times belong to the machine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from bench import median, options, record
from isal.isal_zlib import crc32
from phasewire.protocol import Ack, Block, Pulses, State, Update, pack, pack_updates, quantise, unpack, unpack_updates
from phasewire.protocol.layout.blocks import BLOCK
from phasewire.protocol.replies import decode_acks, encode_acks

BATCHES = (1, 8, 64, 256, 1024)


def acks_of(k: int) -> list[bytes]:
    """The acknowledgements of k updates."""
    numbers, zeros = np.arange(k), np.zeros(k, int)
    return encode_acks(numbers, 50 + numbers, 2500 * numbers, zeros, zeros + 7, zeros + State.PLAYING)


def measure() -> list[dict[str, Any]]:
    """Seconds per update of each way, over batches."""
    rng = np.random.default_rng(1)
    rows = []

    def discs(k: int) -> Any:
        """Drives all over the unit disc, (k, 320)."""
        return (np.sqrt(rng.random((k, 320))) * np.exp(2j * np.pi * rng.random((k, 320)))).astype(np.complex64)

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

        drives, acks = discs(k), b"".join(acks_of(k))
        note("quantise", k, lambda: quantise(drives))
        note("decode acknowledgements", k, lambda: decode_acks(acks))
        note("pack", k, lambda: pack_updates(phase, width, 1, periods, out=again))
        note("unpack and judge", k, lambda: unpack_updates(blocks))
        note("CRC-32 alone", k, lambda: list(map(crc32, blocks)))
        note("copying the pulses", k, read_pulses)
        note("copying the blocks", k, lambda: np.copyto(again, blocks))
    block = Block(Update(Pulses(phase[0], width[0]), 1), 1)
    packed = pack(block)
    parsed = BLOCK.parse(packed)
    note("one by one: Pulses.from_drive", 1, lambda: Pulses.from_drive(drives[0]))
    note("one by one: Ack.decode", 1, lambda: Ack.decode(acks[: Ack.BYTES]))
    note("one by one: pack", 1, lambda: pack(block))
    note("one by one: unpack", 1, lambda: unpack(packed))
    note("construct: build", 1, lambda: BLOCK.build(parsed))
    note("construct: parse", 1, lambda: BLOCK.parse(packed))
    return rows


def main() -> None:
    """Measure, print, and write the figures on request."""
    arguments = options(__doc__).parse_args()
    rows = measure()
    seconds = {(row["what"], row["batch"]): row["seconds"] for row in rows}
    print(f"{'':32}{'batch':>6}{'ns/update':>12}{'updates/s':>14}{'× construct':>13}{'× copying':>11}")
    for row in rows:
        what, batch = row["what"], row["batch"]
        peer = {"pack": "construct: build", "unpack and judge": "construct: parse"}.get(what)
        floor = seconds.get(("copying the pulses", batch), 0) + seconds.get(("copying the blocks", batch), 0)
        ratios = f"{seconds[peer, 1] / row['seconds']:>13.0f}{row['seconds'] / floor:>11.1f}" if peer else ""
        print(f"{what:32}{batch:>6}{row['seconds'] * 1e9:>12.0f}{1 / row['seconds']:>14,.0f}{ratios}")
    record(arguments.json, rows)


if __name__ == "__main__":
    main()
