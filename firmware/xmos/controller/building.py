"""Compile the C of the kernels into ``generated/``, which is committed, so that nothing else needs a compiler.

``python -m phasewire.firmware.xmos.controller.building`` does it.
"""

from __future__ import annotations

from pathlib import Path

from ..kept import KeptAssembly

__all__ = ["SOURCES"]

FOLDER = Path(__file__).parent
GENERATED = FOLDER / "generated"
REFERENCE = FOLDER.parents[1] / "core"

OPTIONS = ("-ffreestanding", "-fno-strict-aliasing")

SOURCES = tuple(
    KeptAssembly(path, GENERATED, (FOLDER, REFERENCE), OPTIONS)
    for path in (
        *(FOLDER / f"{name}.c" for name in ("judge", "plan", "prepare")),
        *(
            REFERENCE / f"{name}.c"
            for name in ("ack", "blk", "blk_plan", "blk_stores", "chn", "num", "pul", "sta", "sums")
        ),
    )
)
"""All that is compiled: what is written here, and the reference device's functions as they are."""


if __name__ == "__main__":
    for each in SOURCES:
        each.keep()
