"""The controller's kernels, executed instruction by instruction: check, CRC-32, sort and send a block of 320 pulses.

No firmware of a controller exists. These kernels are the part of it that BUD-003 and BUD-008 give times of. `kernels`
executes and measures them; `building` compiles those of the reference device.
"""

from .kernels import CASES, FUNCTIONS, SPLITS, Call, Case, Fetch, Passage, Split, call, expected, pass_blocks

__all__ = [
    "CASES",
    "FUNCTIONS",
    "SPLITS",
    "Call",
    "Case",
    "Fetch",
    "Passage",
    "Split",
    "call",
    "expected",
    "pass_blocks",
]
