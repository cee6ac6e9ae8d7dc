"""Many updates at once: arrays of pulses into blocks and back, for streaming (SPEC.md, chapter BLK).

The fast twin of `blocks` for the one kind that streams: same bytes, and the same input refused for the same reason.
"""

from __future__ import annotations

from functools import cache
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from isal.isal_zlib import crc32
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import flag, whole
from .board import CHANNELS, HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS
from .codes import BLOCK_BYTES, CHECKSUM_OFFSET, NOW

__all__ = ["Updates", "pack_updates", "unpack_updates"]


class Updates(NamedTuple):
    """k blocks as they were judged and read. Rows of blocks that were not accepted hold nothing.

    Parameters
    ----------
    reason : (k,) uint8
        `Reason.ACCEPTED` for a valid update, else the first reason that applies; to a block of another kind, whatever
        else may be wrong with it, that is `Reason.KIND`.
    phase, width : (k, 320) uint8
        Pulses in array order, in half ticks and ticks.
    sequence : (k,) uint32
        Numbers of the blocks.
    period : (k,) uint64
        Carrier periods at which they begin to play; `NOW` for as soon as possible.
    restart : (k,) bool
        Whether the numbering begins anew.
    """

    reason: NDArray[np.uint8]
    phase: NDArray[np.uint8]
    width: NDArray[np.uint8]
    sequence: NDArray[np.uint32]
    period: NDArray[np.uint64]
    restart: NDArray[np.bool_]


def pack_updates(
    phase: NDArray[np.uint8],
    width: NDArray[np.uint8],
    sequence: int,
    period: ArrayLike = NOW,
    *,
    restart: bool = False,
    out: NDArray[np.uint8] | None = None,
) -> NDArray[np.uint8]:
    """Pack k updates into k blocks.

    Parameters
    ----------
    phase, width : (k, 320) uint8
        Pulses in array order, in half ticks and ticks.
    sequence : int
        Number of the first block, 32 bits; the others follow it, round the wrap.
    period : (k,) or () uint64
        Carrier periods at which they begin to play; `NOW`, the default, for as soon as possible.
    restart : bool
        Whether the numbering begins anew with the first of them.
    out : (k, 512) uint8, optional
        The array to write them to, contiguous, and apart from `phase` and `width`.

    Returns
    -------
    (k, 512) uint8
        The blocks, one after the other as they travel; `out` if it is given.

    Raises
    ------
    ValueError
        If shapes, types or values are not these; what `out` holds is then worth nothing.
    """
    from . import kernels  # numba takes longer to import than everything else together

    phase, width = np.asarray(phase), np.asarray(width)
    for name, pulses in (("phase", phase), ("width", width)):
        if pulses.dtype != np.uint8 or pulses.ndim != 2 or pulses.shape[1] != CHANNELS:
            raise ValueError(f"{name} must be (k, {CHANNELS}) uint8, not {pulses.shape} {pulses.dtype}")
    count = len(phase)
    if len(width) != count:
        raise ValueError(f"{count} rows of phases but {len(width)} of widths: one of each is needed")
    sequence, restart = whole("sequence number", sequence, 0, 2**32 - 1), flag("restart", restart)
    if out is None:
        out = np.empty((count, BLOCK_BYTES), np.uint8)
    _check_blocks("out", out)
    if not out.flags.writeable:
        raise ValueError("out is read-only")
    if len(out) != count:
        raise ValueError(f"{count} updates do not fit {len(out)} blocks exactly")
    for name, pulses in (("phase", phase), ("width", width)):
        if np.may_share_memory(out, pulses):
            raise ValueError(f"out lies in the same memory as {name}, which would change while it is read")

    largest_phase, largest_width = kernels.pack(phase, width, sequence, _periods(period, count), restart, out)
    if largest_phase >= HALF_TICKS_PER_PERIOD:
        raise _outside("phase", phase, HALF_TICKS_PER_PERIOD - 1)
    if largest_width > MAX_WIDTH_TICKS:
        raise _outside("width", width, MAX_WIDTH_TICKS)
    out.view("<u4")[:, CHECKSUM_OFFSET // 4] = _checksums(out)
    return out


def unpack_updates(blocks: NDArray[np.uint8]) -> Updates:
    """Judge k blocks and read those that are valid updates.

    Parameters
    ----------
    blocks : (k, 512) uint8
        Contiguous.

    Raises
    ------
    ValueError
        If the array is not of this shape and type.
    """
    from . import kernels

    _check_blocks("blocks", blocks)
    count = len(blocks)
    updates = Updates(
        np.empty(count, np.uint8),
        np.empty((count, CHANNELS), np.uint8),
        np.empty((count, CHANNELS), np.uint8),
        np.empty(count, np.uint32),
        np.empty(count, np.uint64),
        np.empty(count, np.bool_),
    )
    kernels.unpack(blocks, _checksums(blocks), _checksum_columns(), *updates)
    return updates


def _check_blocks(name: str, blocks: NDArray[Any]) -> None:
    if not isinstance(blocks, np.ndarray):
        raise ValueError(
            f"{name} must be an array, (k, {BLOCK_BYTES}) uint8, not {type(blocks).__name__}; of k blocks in bytes "
            f"np.frombuffer(blocks, np.uint8).reshape(-1, {BLOCK_BYTES}) makes one"
        )
    if blocks.dtype != np.uint8 or blocks.ndim != 2 or blocks.shape[1] != BLOCK_BYTES or not blocks.flags.c_contiguous:
        raise ValueError(f"{name} must be contiguous (k, {BLOCK_BYTES}) uint8, not {blocks.shape} {blocks.dtype}")


def _periods(period: ArrayLike, count: int) -> NDArray[np.uint64]:
    given = np.asarray(period)
    if given.dtype == np.uint64 and given.shape == (count,):
        return given
    if given.dtype.kind in "iu":
        wrong = given[given < 0].tolist()
    else:  # perhaps a list of small and large numbers, of which NumPy makes floats
        given = np.asarray(period, object)
        wrong = [value for value in given.flat if not _is_period(value)]
    if wrong:
        raise ValueError(f"periods must be whole numbers from 0 to 2**64 - 1, not {wrong[0]!r}")
    if given.shape not in ((), (count,)):
        raise ValueError(f"one period for all or ({count},) of them are needed, not {given.shape}")
    return np.full(count, given.astype(np.uint64))  # an array as those that are given: the kernel is compiled once


def _is_period(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and 0 <= int(value) < 2**64


def _outside(name: str, values: NDArray[np.uint8], limit: int) -> ValueError:
    update, transducer = np.argwhere(values > limit)[0]
    return ValueError(
        f"{name} {values[update, transducer]} of transducer {transducer} of update {update} is above {limit}"
    )


def _checksums(blocks: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """CRC-32 of each block as it stands, (k,)."""
    return np.fromiter(map(crc32, blocks), np.uint32, len(blocks))


@cache
def _checksum_columns() -> NDArray[np.uint32]:
    """What the bytes of a block's checksum add to the CRC-32 over all of it, (4, 256).

    A CRC is linear but for a constant: that of the block with 0 in the checksum's place, which is what the checksum
    must be, is the CRC of the whole block less what these four bytes add.
    """
    block = bytearray(BLOCK_BYTES)
    nothing = crc32(block)
    columns = np.zeros((4, 256), np.uint32)
    for octet in range(4):
        for value in range(256):
            block[CHECKSUM_OFFSET + octet] = value
            columns[octet, value] = crc32(block) ^ nothing
        block[CHECKSUM_OFFSET + octet] = 0
    return columns
