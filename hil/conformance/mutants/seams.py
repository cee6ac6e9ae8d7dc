"""Seams that several mutants use: blocks on their way in, records on their way out, and the outputs.

Each function opens one such seam through a `Patch`, on all paths of a block or a record. The mutant supplies the
defect.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....emulator.control import controller, requests
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.execution import Execution
from ....emulator.control.state_machine import StateMachine
from ....emulator.interfaces.serial_line import SerialLine
from ....emulator.interfaces.usb_functions import ArrayFunction
from ....emulator.ports import capture, raster
from ....protocol.blocks import Body, pulse_words
from ....protocol.blocks import checksum as block_checksum
from ....protocol.board import (
    CHANNELS,
    CHANNELS_PER_PROCESSOR,
    HALF_TICKS_PER_PERIOD,
    MAX_WIDTH_TICKS,
    TICKS_PER_PERIOD,
)
from ....protocol.codes import BLOCK_BYTES, CHECKSUM_OFFSET
from ....protocol.pulses import Pulses
from ....protocol.wiring import Wiring
from .patching import Patch

__all__ = [
    "Levels",
    "Words",
    "allow_drive",
    "forgive",
    "is_high",
    "mangle_acks",
    "misread_bodies",
    "one_by_one",
    "rasterise",
    "reach_the_watchdog",
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
    """Judge updates one by one instead of in batches, so that a mutant that breaks one breaks all."""
    patch.replace(Controller, "take", lambda _self, _packets, began, _deadline, _door: (0, began))


# Blocks on their way in


def allow_drive(patch: Patch, kinds: Any, allowed: Callable[[Pulses, int], bool]) -> None:
    """Let no total drive of some kinds be too much whose pulses are allowed under the limit, in transducers."""

    @patch.around(Admission, "_judge_numbers")
    def judge(original: Any, self: Any, block: Any, arrived: int) -> None:
        limit = self._device.drive_limit
        if isinstance(block.body, kinds) and allowed(block.body.pulses, limit):
            self._device.drive_limit = 2 * CHANNELS
        try:
            original(self, block, arrived)
        finally:
            self._device.drive_limit = limit


def sealed_block(block: bytes | bytearray) -> bytes:
    """A block with a matching checksum."""
    sealed = bytearray(block)
    sealed[CHECKSUM] = block_checksum(bytes(block)).to_bytes(4, "little")
    return bytes(sealed)


def forgive(patch: Patch, pardon: Callable[[bytearray], None], kinds: Collection[int]) -> None:
    """Judge some kinds of undamaged blocks as if their bytes were others; their pulses are read from those bytes too.

    A batch of updates falls back to one by one if the change affects one of them.
    """

    @patch.around(controller, "unpack")
    def unpack(original: Any, data: bytes) -> Any:
        if len(data) == BLOCK_BYTES and data[KIND] in kinds and data == sealed_block(data):
            pardoned = bytearray(data)
            pardon(pardoned)
            data = sealed_block(pardoned)
        return original(data)


def misread_bodies(patch: Patch, misread: Callable[[Any], Body]) -> None:
    """Carry out accepted blocks other than updates as if they had asked for something else."""

    def around(original: Any) -> Any:
        return lambda self, body, door: original(self, misread(body), door)

    patch.wrap(Execution, "carry_out", around)


# Records on their way out


def sealed_record(record: bytes | bytearray) -> bytes:
    """An acknowledgement with a matching checksum."""
    body = bytes(record[:RECORD_CHECKSUM])
    return body + zlib.crc32(body).to_bytes(4, "little")


def mangle_acks(patch: Patch, mangle: Callable[[bytearray], bytes | bytearray]) -> None:
    """Send changed acknowledgements on every line."""

    def around(original: Any) -> Any:
        return lambda self, record: original(self, bytes(mangle(bytearray(record))))

    for door in (ArrayFunction, SerialLine):
        patch.wrap(door, "acknowledge", around)


# What happens besides


def reach_the_watchdog(patch: Patch) -> None:
    """Let `Dispatch` reach the watchdog, as its own ``watchdog``."""

    @patch.around(StateMachine, "__init__")
    def begin(original: Any, self: Any, device: Any, dispatch: Any, **rest: Any) -> None:
        original(self, device, dispatch, **rest)
        vars(dispatch)["watchdog"] = self.watchdog


# Outputs

Words = NDArray[np.uint32]
Levels = Callable[[Any, Any, Any, Any], Any]
"""Whether an output is high, given a pulse's phase, its played width, its unmodulated width, and the tick."""


def is_high(phase: Any, width: Any, _unmodulated: Any, tick: Any) -> Any:
    """The right answer (clause PUL-004)."""
    return (tick - ((phase - width) >> 1)) % TICKS_PER_PERIOD < width


def rasterise(patch: Patch, levels: Levels) -> None:
    """Change the rasteriser of all ports; read-back and everything before the ports stay unchanged."""
    patterns = spread(levels)

    def expand(slices: Any, rows: Any, samples: Any, widths: Any, words: Words) -> None:
        words[:] = patterns(slices, rows, samples, widths)

    patch.replace(raster, "expand", expand)


def spread(levels: Levels) -> Callable[[Any, Any, Any, Any], Words]:
    """A rasteriser like `raster.expand`: it writes slices, rows, samples and widths to words."""
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
    """Change all outputs: the function gets the right words for a range of ticks, and the range."""

    @patch.around(capture.Capture, "_words")
    def words(original: Any, self: Any, start: int, stop: int) -> Words:
        return change(lambda first, last: original(self, first, last), start, stop)


def sort_by(patch: Patch, change: Callable[[NDArray[np.int64]], NDArray[np.int64]]) -> None:
    """Sort pulses, and read them back, by another table of channels than WIRING reports."""
    told: dict[int, Wiring] = {}

    @patch.around(Controller, "__init__")
    def begin(
        original: Any, self: Any, scheduler: Any, time: Any, chain: Any, identities: Any, known: Any, **rest: Any
    ) -> None:
        table = Wiring(change(known.wiring.channels.copy()))
        told[id(table)] = known.wiring
        original(self, scheduler, time, chain, identities, known._replace(wiring=table), **rest)

    def tell(original: Any) -> Any:
        return lambda wiring: original(told[id(wiring)])

    patch.wrap(requests, "encode_wiring", tell)
