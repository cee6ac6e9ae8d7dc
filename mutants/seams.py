"""Where emulators are broken by more than one mutant: blocks on their way in, records on their way out, what plays.

Each function here opens one such place through a `Patch`, on all ways that a block or a record can take, and what is
wrong there is the mutant's own.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..emulator.control import controller
from ..emulator.interfaces.serial_line import SerialLine
from ..emulator.interfaces.usb_functions import ArrayFunction
from ..emulator.ports import capture, raster
from ..protocol.blocks import Body, pulse_words
from ..protocol.blocks import checksum as block_checksum
from ..protocol.board import CHANNELS_PER_PROCESSOR, HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS, TICKS_PER_PERIOD
from ..protocol.codes import BLOCK_BYTES, CHECKSUM_OFFSET
from ..protocol.wiring import Wiring
from .patching import Patch

__all__ = [
    "Levels",
    "Words",
    "forgive",
    "is_high",
    "mangle_acks",
    "misread_bodies",
    "one_by_one",
    "rasterise",
    "sealed_block",
    "sealed_record",
    "see_words",
    "sort_by",
    "spread",
]

CHECKSUM = slice(CHECKSUM_OFFSET, CHECKSUM_OFFSET + 4)
KIND = 3
RECORD_CHECKSUM = 28


def one_by_one(patch: Patch) -> None:
    """Let no updates be taken together, so that what breaks a single one breaks all."""
    patch.replace(controller.Controller, "stream", lambda _self, _packets, began, _deadline, _door: (0, began))


# Blocks on their way in


def sealed_block(block: bytes | bytearray) -> bytes:
    """A block with the checksum that belongs to it."""
    sealed = bytearray(block)
    sealed[CHECKSUM] = block_checksum(bytes(block)).to_bytes(4, "little")
    return bytes(sealed)


def forgive(patch: Patch, pardon: Callable[[bytearray], None], kinds: Collection[int]) -> None:
    """Judge undamaged blocks of some kinds as if something in them were other than it is; what pulses are read alike.

    Updates that are taken together fall back to one by one where one is not as it should be.
    """

    @patch.around(controller, "unpack")
    def unpack(original: Any, data: bytes) -> Any:
        if len(data) == BLOCK_BYTES and data[KIND] in kinds and data == sealed_block(data):
            pardoned = bytearray(data)
            pardon(pardoned)
            data = sealed_block(pardoned)
        return original(data)


def misread_bodies(patch: Patch, misread: Callable[[Any], Body]) -> None:
    """Carry out accepted blocks, which are no updates, as if they had asked for something else."""

    def around(original: Any) -> Any:
        return lambda self, body, door: original(self, misread(body), door)

    patch.wrap(controller.Controller, "_carry_out", around)


# Records on their way out


def sealed_record(record: bytes | bytearray) -> bytes:
    """An acknowledgement with the checksum that belongs to it."""
    body = bytes(record[:RECORD_CHECKSUM])
    return body + zlib.crc32(body).to_bytes(4, "little")


def mangle_acks(patch: Patch, mangle: Callable[[bytearray], bytes | bytearray]) -> None:
    """Send other acknowledgements than should be, on every line."""

    def around(original: Any) -> Any:
        return lambda self, record: original(self, bytes(mangle(bytearray(record))))

    for door in (ArrayFunction, SerialLine):
        patch.wrap(door, "acknowledge", around)


# What plays

Words = NDArray[np.uint32]
Levels = Callable[[Any, Any, Any, Any], Any]
"""Whether an output is high: of a pulse's phase, the width that it plays, the width before modulation, and the tick."""


def is_high(phase: Any, width: Any, _unmodulated: Any, tick: Any) -> Any:
    """As it should be (clause PUL-004)."""
    return (tick - ((phase - width) >> 1)) % TICKS_PER_PERIOD < width


def rasterise(patch: Patch, levels: Levels) -> None:
    """Let all ports rasterise in another way; read-back and everything before the ports is as it was."""
    patterns = spread(levels)

    def expand(slices: Any, rows: Any, samples: Any, widths: Any, words: Words) -> None:
        words[:] = patterns(slices, rows, samples, widths)

    patch.replace(raster, "expand", expand)


def spread(levels: Levels) -> Callable[[Any, Any, Any, Any], Words]:
    """A rasteriser: what `raster.expand` gets of slices, rows, samples and widths, it gives as words."""
    widths_count = MAX_WIDTH_TICKS + 1
    grid = np.ogrid[:HALF_TICKS_PER_PERIOD, :widths_count, :widths_count, :TICKS_PER_PERIOD]
    shape = (HALF_TICKS_PER_PERIOD, widths_count, widths_count, TICKS_PER_PERIOD)
    patterns = np.broadcast_to(np.asarray(levels(*grid), bool), shape)
    bits = np.arange(CHANNELS_PER_PROCESSOR, dtype=np.uint32)[:, None]

    def expanded(slices: Any, rows: Any, samples: Any, widths: Any) -> Words:
        words = np.empty((rows.shape[1] * TICKS_PER_PERIOD, len(slices)), np.uint32)
        for port, packed in enumerate(slices):
            distinct, which = np.unique(np.stack([rows[port], samples[port]]), axis=1, return_inverse=True)
            pulses = pulse_words(packed[distinct[0]])
            phase, unmodulated = pulses & 127, pulses >> 7
            width = widths[distinct[1][:, None], unmodulated]
            table = (patterns[phase, width, unmodulated].astype(np.uint32) << bits).sum(axis=1, dtype=np.uint32)
            words[:, port] = table[which.ravel()].reshape(-1)
        return words

    return expanded


def see_words(patch: Patch, change: Callable[[Callable[[int, int], Words], int, int], Words]) -> None:
    """Let all outputs do something else; it is given what they should do from one tick to another, and which ticks."""

    @patch.around(capture.Capture, "_words")
    def words(original: Any, self: Any, start: int, stop: int) -> Words:
        return change(lambda first, last: original(self, first, last), start, stop)


def sort_by(patch: Patch, change: Callable[[NDArray[np.int64]], NDArray[np.int64]]) -> None:
    """Sort pulses, and what is read back, by another table of channels than WIRING tells."""
    told: dict[int, Wiring] = {}

    @patch.around(controller.Controller, "__init__")
    def begin(
        original: Any, self: Any, scheduler: Any, time: Any, chain: Any, identities: Any, known: Any, **rest: Any
    ) -> None:
        table = Wiring(change(known.wiring.channels.copy()))
        told[id(table)] = known.wiring
        original(self, scheduler, time, chain, identities, known._replace(wiring=table), **rest)

    def tell(original: Any) -> Any:
        return lambda wiring: original(told[id(wiring)])

    patch.wrap(controller, "encode_wiring", tell)
