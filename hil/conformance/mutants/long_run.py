"""Defects that appear after a while: counters, numbers, clocks and leaks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ....emulator.boards.processor import Processor
from ....emulator.control import batches
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.device_state import DeviceState
from ....emulator.control.dispatch import Dispatch
from ....emulator.control.requests import Requests
from ....emulator.doors.device_time import DeviceTime
from ....protocol.board import CORE_HZ
from ....protocol.chain import Report
from .patching import Patch, mutant
from .robustness import leak_a_place, leak_places

FAST = 1.002
LOW_HALF = 0xFFFF
BYTE = 2**8
COUNTERS = ("accepted", "refused", "late", "lost", "dropped_frames", "missed_commits", "damaged_messages")


def _count_in(name: str, bits: int) -> Callable[[Patch], None]:
    """A mutant whose STATUS has a counter of so many bits."""

    def narrow(patch: Patch) -> None:
        @patch.around(Requests, "status")
        def status(original: Any, self: Any) -> Any:
            found = original(self)
            return replace(found, **{name: getattr(found, name) % 2**bits})

    narrow.__name__ = f"{name}_has_{bits}_bits"
    narrow.__doc__ = f"The count {name} of STATUS has {bits} bits and begins anew after {2**bits - 1}."
    return narrow


for _bits, _names in ((8, COUNTERS), (16, COUNTERS[:2])):
    for _name in _names:
        mutant("REQ-003")(_count_in(_name, _bits))


@mutant("REQ-008", "REQ-003", wraps=(Processor, "_answer"))
def processors_count_in_8_bits(original: Any, self: Any, wanted: Any) -> Any:
    """A processor counts missed commits and damaged messages in a byte each, which begins anew after 255."""
    answer = original(self, wanted)
    if not isinstance(answer, Report):
        return answer
    missed, damaged = answer.missed_commits % BYTE, answer.damaged_messages % BYTE
    return replace(answer, missed_commits=missed, damaged_messages=damaged)


@mutant("NUM-001", "NUM-003")
def numbers_count_on_in_16_bits(patch: Patch) -> None:
    """Only the low 16 bits of the last block's number count up, so that every 65 536th block shows a gap."""

    def kept(before: int | None, number: int) -> int:
        return number if before is None else before & ~LOW_HALF | number & LOW_HALF

    @patch.around(DeviceState, "count")
    def of_count(original: Any, self: Any, block: Any) -> Any:
        before = None if block.restart else self.last_sequence
        gap = original(self, block)
        self.last_sequence = kept(before, self.last_sequence)
        return gap

    def of_take(_: Any) -> Any:
        return lambda _self, _packets, began, *_rest: (0, began)

    patch.wrap(Controller, "take", of_take)


@mutant("TIM-001")
def clock_is_2000_ppm_fast(patch: Patch) -> None:
    """The whole device runs 2000 ppm fast: its oscillator has lost the crystal."""

    def monotonic(self: Any) -> float:
        return float(self._scheduler.now / CORE_HZ / FAST)

    def sleep(self: Any, seconds: float, /) -> None:
        self._pass_until(self._scheduler.now + math.ceil(seconds * CORE_HZ * FAST))

    patch.replace(DeviceTime, "monotonic", monotonic)
    patch.replace(DeviceTime, "sleep", sleep)


@mutant("BLK-024", "NUM-004", wraps=(Admission, "judge"), also=leak_places)
def restart_takes_a_place_for_ever(original: Any, self: Any, block: Any, arrived: int) -> None:
    """Each block with the flag RESTART costs the queue a place: the old state is not freed."""
    original(self, block, arrived)
    if block.restart:
        leak_a_place(self._dispatch)


@mutant("TIM-002")
def ticks_wrap_at_32_bits(patch: Patch) -> None:
    """The tick in acknowledgements, STATUS and CLOCK wraps after 36 minutes: the upper half is left out."""

    def of_acks(original: Any) -> Any:
        return lambda sequence, period, now, *rest: original(sequence, period, now % 2**32, *rest)

    patch.wrap(Dispatch, "now_tick", lambda original: lambda self: original(self) % 2**32)
    patch.wrap(batches, "encode_acks", of_acks)
