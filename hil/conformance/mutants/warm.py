"""Loads all that judging a mutant needs, once; the judging processes are forks of this one."""

from __future__ import annotations

import gc

from ....emulator.doors.warming import load_kernels
from ..running import RunOptions, catalogue, run_conformance
from .catalogue import MUTANTS

__all__ = ["CASES", "MUTANTS"]

CASES = frozenset(case.identifier for case in catalogue())
EACH_KERNEL = (
    "acknowledgements/changes-of-all-kinds-can-be-late",
    "blocks/refused-blocks-leave-what-plays-and-waits",
    "chain/reading-back-tells-that-a-processor-missed-an-update",
    "chain/a-board-whose-clock-is-off-is-silenced[15]",
)
"""Cases that need the kernels that no stream needs."""

load_kernels()
run_conformance(RunOptions("emulator:", only=EACH_KERNEL, groups=("acknowledgements", "blocks", "chain"), again=False))
gc.freeze()  # pytest collects garbage at the end of each run: without what is here, which would be copied, too
