"""Broken sorting: the output of each transducer's pulse, and what WIRING says of it (REQ-004, BLK-006)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....emulator.control import requests
from ....emulator.control.execution import Execution
from ....emulator.control.requests import Requests
from ....protocol.blocks import Slot
from ....protocol.board import CHANNELS_PER_PROCESSOR, COLUMNS, PROCESSORS_PER_BOARD, ROWS
from ....protocol.pulses import Pulses
from .patching import Patch, mutant
from .seams import Words, see_words, sort_by

Channels = NDArray[np.int64]
EVEN_BITS = np.uint32(0x55555555)


@mutant("REQ-004", "BLK-006", by=sort_by)
def two_transducers_are_swapped(channels: Channels) -> Channels:
    """Transducers 130 and 151 are exchanged in sorting and read-back, but not in WIRING."""
    channels[[130, 151]] = channels[[151, 130]]
    return channels


@mutant("REQ-004", "BLK-006", by=sort_by)
def processors_of_a_board_are_swapped(channels: Channels) -> Channels:
    """The two processors of board 4 get each other's pulses: its cable is turned, but WIRING is unchanged."""
    processor = channels // CHANNELS_PER_PROCESSOR
    turned = np.where(processor // PROCESSORS_PER_BOARD == 4, processor ^ 1, processor)
    return turned * CHANNELS_PER_PROCESSOR + channels % CHANNELS_PER_PROCESSOR


@mutant("BLK-006", "REQ-004")
def array_is_mirrored(patch: Patch) -> None:
    """Pulses are sorted as if row 0 were the last one: the array is seen from the other side."""
    sort_by(patch, lambda channels: channels.reshape(ROWS, COLUMNS)[::-1].ravel())


@mutant("REQ-004", "PUL-005", by=see_words)
def one_pair_of_outputs_is_swapped(words: Any, start: int, stop: int) -> Words:
    """Bits 6 and 7 of processor 5 play each other's pulses: two tracks of one board are crossed."""
    crossed: Words = words(start, stop)
    port = crossed[:, 5]
    pair = port >> np.uint32(6) & np.uint32(3)
    turned = pair >> np.uint32(1) | (pair & np.uint32(1)) << np.uint32(1)
    crossed[:, 5] = port & ~np.uint32(3 << 6) | turned << np.uint32(6)
    return crossed


@mutant("PUL-005", "BLK-006", by=see_words)
def pairs_are_unpacked_the_wrong_way_round(words: Any, start: int, stop: int) -> Words:
    """The two pulses in each three bytes are exchanged on all ports: the first is read from the high half."""
    ports = words(start, stop)
    swapped: Words = ports >> np.uint32(1) & EVEN_BITS | (ports & EVEN_BITS) << np.uint32(1)
    return swapped


@mutant("BLK-013", "BLK-006", wraps=(Execution, "_store"))
def slots_are_not_sorted(original: Any, self: Any, body: Any) -> None:
    """The pulses of a SLOT go to the outputs unsorted, in array order: only updates are sorted."""
    if isinstance(body, Slot):
        wiring, pulses = self._wiring, body.pulses
        body = Slot(body.number, Pulses(wiring.unsort(pulses.phase), wiring.unsort(pulses.width)))
    original(self, body)


@mutant("REQ-004", wraps=(requests, "encode_wiring"))
def wiring_goes_column_by_column(original: Any, wiring: Any) -> bytes:
    """WIRING lists the channels column by column, as other arrays do; pulses are sorted as before."""
    table = np.frombuffer(original(wiring), "<u2").reshape(ROWS, COLUMNS)
    return table.T.tobytes()


@mutant("REQ-004", wraps=(requests, "encode_wiring"))
def wiring_is_big_endian(original: Any, wiring: Any) -> Any:
    """The channels of WIRING have their high byte first, as in the routes of the chain."""
    return np.frombuffer(original(wiring), "<u2").astype(">u2").tobytes()


@mutant("REQ-007", wraps=(Requests, "_read_back"))
def read_back_is_in_channel_order(original: Any, self: Any) -> Any:
    """PULSES answers the pulses in the processors' order, channel by channel: they are not sorted back."""
    answer, wiring = original(self), self._identification.wiring
    by_channel = Pulses(wiring.sort(answer.pulses.phase), wiring.sort(answer.pulses.width))
    return type(answer)(answer.since_period, answer.read_period, by_channel)
