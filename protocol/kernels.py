"""Compiled loops of `quantise` and `updates`: drives into pulses, pulses into blocks and back.

They see plain arrays and check only what they say.

numba compiles them at their first call and keeps the result on disk.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.arguments import MAGNITUDE_TOLERANCE
from ..base.compiling import kernel
from .board import CHANNELS, HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS, TICKS_PER_PERIOD
from .codes import (
    BLOCK_MAGIC,
    CHECKSUM_OFFSET,
    HEADER_BYTES,
    PROTOCOL_VERSION,
    Flag,
    Kind,
    Reason,
)

U8, U32, U64 = np.uint8, np.uint32, np.uint64

MAGIC_LOW, MAGIC_HIGH = BLOCK_MAGIC
ALL_PHASES = HALF_TICKS_PER_PERIOD - 1
SEQUENCE_OFFSET, PERIOD_OFFSET, FLAGS_OFFSET = 4, 8, 26
UPDATE, RESTART = int(Kind.UPDATE), int(Flag.RESTART)
VERSION_REASON, MAGIC_REASON, CHECKSUM_REASON = int(Reason.VERSION), int(Reason.MAGIC), int(Reason.CHECKSUM)
KIND_REASON, FIELD_REASON, PULSE_REASON = int(Reason.KIND), int(Reason.FIELD), int(Reason.PULSE)

ONE, HALF_TURN, TURN = U32(1), U32(HALF_TICKS_PER_PERIOD // 2), U32(HALF_TICKS_PER_PERIOD)
QUARTER = U32(HALF_TICKS_PER_PERIOD // 4)
TINY = 1e-300  # so that nothing is divided by 0
SUSPECT = (1 + MAGNITUDE_TOLERANCE) ** 2 * (1 - 1e-12)  # squared magnitude from which a drive must be looked at

_ANGLES = np.pi / TICKS_PER_PERIOD * np.arange(MAX_WIDTH_TICKS + 1)  # of phases in half ticks, and of widths in ticks
COSINES, SINES = np.cos(_ANGLES), np.sin(_ANGLES)


def _stairs(edges: Any, buckets: int) -> tuple[Any, Any]:
    """A quick way to the last of some rising edges, 0 the first, that is not above a number from 0 to 1.

    The step at the number's bucket is that edge or the one before it: no bucket has two edges in it. The second array
    has the edge after each step.
    """
    steps = np.searchsorted(edges, np.arange(buckets + 1) / buckets, "right") - 1
    return steps.astype(np.uint32), np.append(edges[1:], np.inf)


SLOPE_BUCKETS, WIDTH_BUCKETS = 64.0, 256.0
SLOPE_STEPS, NEXT_SLOPE = _stairs(np.tan(_ANGLES[: MAX_WIDTH_TICKS // 2 + 1]), 64)
WIDTH_STEPS, NEXT_MIDDLE = _stairs(SINES[:-1] * COSINES[1], 256)


@kernel
def _at_most_1(value: float) -> float:
    """The value, or 1 if it is more or not a number."""
    return value if value < 1.0 else 1.0


@kernel
def _nearest_width(reach: float, phase: Any) -> Any:
    """Width of the exact pulse of a phase that is nearest to a drive which reaches so far in its direction.

    Those widths are all even or all odd, as the phase is. The middle between the magnitudes of w - 1 and w + 1 ticks is
    sin(πw/50)·cos(π/50).
    """
    step = WIDTH_STEPS[U32(_at_most_1(reach) * WIDTH_BUCKETS)]
    step += U32(reach >= NEXT_MIDDLE[step])
    return step + ((step ^ phase) & ONE)


@kernel
def _remoteness(width: Any, reach: float) -> Any:
    """Squared distance from the drive to a pulse in whose direction it reaches so far, less the drive's own square."""
    magnitude = SINES[width]
    return magnitude * (magnitude - 2 * reach)


@kernel
def quantise(drives: Any, phase: Any, width: Any) -> int:
    """Find the nearest exact pulses of k frames.

    Without branches, so that a compiler can work on several transducers at once. The plane's axes are mirrors of the
    exact pulses, so a drive is taken to the first quadrant and its pulse back. There the nearest pulse has one of the
    two phases on either side of the drive, in whole half ticks; which two, the drive's slope tells.

    Parameters
    ----------
    drives : (k, n) complex64 or complex128
    phase, width : (k, n) uint8
        The result, written here.

    Returns
    -------
    int
        How many drives are, or may be, not finite or too large; the pulses of those that are are worth nothing.
    """
    suspects = 0
    for row in range(drives.shape[0]):
        for column in range(drives.shape[1]):
            drive = drives[row, column]
            real, imaginary = np.float64(drive.real), np.float64(drive.imag)
            across, up = abs(real), abs(imaginary)
            suspects += not across * across + up * up <= SUSPECT
            steep = up > across
            short, long = min(across, up), max(across, up)
            slope = short / max(long, TINY)
            step = SLOPE_STEPS[U32(_at_most_1(slope) * SLOPE_BUCKETS)]
            step += U32(slope >= NEXT_SLOPE[step])
            after = step + ONE
            first_reach = long * COSINES[step] + short * SINES[step]
            second_reach = long * COSINES[after] + short * SINES[after]
            first_phase = QUARTER - step if steep else step
            second_phase = QUARTER - after if steep else after
            first_width = _nearest_width(first_reach, first_phase)
            second_width = _nearest_width(second_reach, second_phase)
            second = _remoteness(second_width, second_reach) < _remoteness(first_width, first_reach)
            chosen_phase = second_phase if second else first_phase
            chosen_width = second_width if second else first_width
            chosen_phase = HALF_TURN - chosen_phase if real < 0 else chosen_phase
            chosen_phase = TURN - chosen_phase if imaginary < 0 else chosen_phase
            unturned = (chosen_width == U32(0)) | (chosen_phase == TURN)
            phase[row, column] = U8(U32(0) if unturned else chosen_phase)
            width[row, column] = U8(chosen_width)
    return suspects


@kernel
def pack(phase: Any, width: Any, sequence: int, periods: Any, restart: bool, blocks: Any) -> tuple[Any, Any]:
    """Write all of k updates but their checksums, which are left 0.

    Parameters
    ----------
    phase, width : (k, 320) uint8
    sequence : int
        Number of the first; the others follow it, round the wrap.
    periods : (k,) uint64
    restart : bool
        Whether the numbering begins anew with the first.
    blocks : (k, 512) uint8
        The result, written here.

    Returns
    -------
    (uint8, uint8)
        Largest phase and width met; if one is too large, the blocks are worth nothing.
    """
    largest_phase, largest_width = U8(0), U8(0)
    for row in range(phase.shape[0]):
        block = blocks[row]
        block[:HEADER_BYTES] = 0
        block[0], block[1], block[2], block[3] = MAGIC_LOW, MAGIC_HIGH, PROTOCOL_VERSION, UPDATE
        number = U32(sequence + row)
        for octet in range(4):
            block[SEQUENCE_OFFSET + octet] = U8(number >> U32(8 * octet))
        period = periods[row]
        for octet in range(8):
            block[PERIOD_OFFSET + octet] = U8(period >> U64(8 * octet))
        for pair in range(CHANNELS // 2):
            even_phase, odd_phase = phase[row, 2 * pair], phase[row, 2 * pair + 1]
            even_width, odd_width = width[row, 2 * pair], width[row, 2 * pair + 1]
            largest_phase = max(largest_phase, even_phase, odd_phase)
            largest_width = max(largest_width, even_width, odd_width)
            even = U32(even_phase) | U32(even_width) << U32(7)
            odd = U32(odd_phase) | U32(odd_width) << U32(7)
            both = even | odd << U32(12)
            at = HEADER_BYTES + 3 * pair
            block[at], block[at + 1], block[at + 2] = U8(both), U8(both >> U32(8)), U8(both >> U32(16))
    if restart and blocks.shape[0]:
        blocks[0, FLAGS_OFFSET] = RESTART
    return largest_phase, largest_width


@kernel
def unpack(
    blocks: Any,
    checksums: Any,
    columns: Any,
    reasons: Any,
    phase: Any,
    width: Any,
    sequences: Any,
    periods: Any,
    restarts: Any,
) -> None:
    """Judge k blocks and read those that are valid updates.

    Parameters
    ----------
    blocks : (k, 512) uint8
    checksums : (k,) uint32
        CRC-32 of each whole block, its own checksum included.
    columns : (4, 256) uint32
        What the four bytes of a checksum contribute to that.
    reasons : (k,) uint8
    phase, width : (k, 320) uint8
    sequences : (k,) uint32
    periods : (k,) uint64
    restarts : (k,) bool
        Outputs; all but `reasons` only if a block is a valid update.
    """
    for row in range(blocks.shape[0]):
        block = blocks[row]
        reasons[row] = 0
        stated, contributed = U32(0), U32(0)
        for octet in range(4):
            value = block[CHECKSUM_OFFSET + octet]
            stated |= U32(value) << U32(8 * octet)
            contributed ^= columns[octet, value]
        if checksums[row] ^ contributed != stated:
            reasons[row] = CHECKSUM_REASON
            continue
        if block[0] != MAGIC_LOW or block[1] != MAGIC_HIGH:
            reasons[row] = MAGIC_REASON
            continue
        if block[2] != PROTOCOL_VERSION:
            reasons[row] = VERSION_REASON
            continue
        if block[3] != UPDATE:
            reasons[row] = KIND_REASON
            continue
        unused = block[FLAGS_OFFSET] & U8(~RESTART & 0xFF)
        for at in range(PERIOD_OFFSET + 8, CHECKSUM_OFFSET):
            if at != FLAGS_OFFSET:
                unused |= block[at]
        if unused:
            reasons[row] = FIELD_REASON
            continue
        largest_phase, largest_width = U8(0), U8(0)
        for pair in range(CHANNELS // 2):
            at = HEADER_BYTES + 3 * pair
            first, middle, last = block[at], block[at + 1], block[at + 2]
            even_phase, odd_phase = first & U8(0x7F), middle >> U8(4) | (last & U8(0x07)) << U8(4)
            even_width, odd_width = first >> U8(7) | (middle & U8(0x0F)) << U8(1), last >> U8(3)
            largest_phase = max(largest_phase, even_phase, odd_phase)
            largest_width = max(largest_width, even_width, odd_width)
            phase[row, 2 * pair], phase[row, 2 * pair + 1] = even_phase, odd_phase
            width[row, 2 * pair], width[row, 2 * pair + 1] = even_width, odd_width
        if largest_phase > ALL_PHASES or largest_width > MAX_WIDTH_TICKS:
            reasons[row] = PULSE_REASON
            continue
        number, period = U32(0), U64(0)
        for octet in range(4):
            number |= U32(block[SEQUENCE_OFFSET + octet]) << U32(8 * octet)
        for octet in range(8):
            period |= U64(block[PERIOD_OFFSET + octet]) << U64(8 * octet)
        sequences[row], periods[row] = number, period
        restarts[row] = block[FLAGS_OFFSET] == RESTART
