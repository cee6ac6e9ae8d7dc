"""Broken stores: slots, entries and samples that are loaded while something plays (chapter BLK)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ....base.errors import BlockError
from ....emulator.boards.processor import Processor
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.dispatch import Dispatch
from ....emulator.ports.history import SILENT
from ....protocol.blocks import pack_pulses, unpack_pulses
from ....protocol.board import PROCESSORS
from ....protocol.codes import Memory
from ..sight.waveforms import modulated
from .patching import Patch, mutant

LAST_PLACES = 8
WRONG_PLACE = 6
STORES = (Memory.SLOTS, Memory.ENTRIES, Memory.SAMPLES)


def _while(what: str, *memories: Memory) -> Callable[[Patch, Any], None]:
    """Change what reaches these memories of a processor while an update, a sequence, a modulation, or both play.

    The mutant gets the processor, the first item and the data, and returns what is stored where.
    """

    def plays(processor: Any) -> bool:
        is_modulated, runs = bool(processor._modulated), bool(processor.history.runs)
        update = not runs and bool(processor.history.segments().refs[-1] != SILENT)
        return {"update": update, "sequence": runs, "modulation": is_modulated, "both": runs and is_modulated}[what]

    def by(patch: Patch, change: Callable[[Any, int, bytes], tuple[int, bytes]]) -> None:
        @patch.around(Processor, "load")
        def load(original: Any, self: Any, memory: Memory, first: int, data: bytes) -> None:
            original(
                self, memory, *(change(self, first, data) if memory in memories and plays(self) else (first, data))
            )

    return by


@mutant("BLK-013", by=_while("update", Memory.SLOTS))
def slots_are_lost_while_an_update_plays(_: Any, first: int, __: bytes) -> tuple[int, bytes]:
    """A slot that is stored while an update plays is lost: both use the mailbox."""
    return first, b""


@mutant("BLK-013", by=_while("sequence", Memory.SLOTS))
def slots_are_lost_while_a_sequence_plays(_: Any, first: int, __: bytes) -> tuple[int, bytes]:
    """A slot that is stored while a sequence plays is lost: its memory is locked as a whole."""
    return first, b""


@mutant("BLK-014", by=_while("modulation", Memory.ENTRIES))
def entries_are_lost_while_a_modulation_plays(_: Any, first: int, __: bytes) -> tuple[int, bytes]:
    """Entries that are stored while a modulation plays are lost: the thread that takes loads makes its tables."""
    return first, b""


@mutant("BLK-016", by=_while("sequence", Memory.SAMPLES))
def samples_are_lost_while_a_sequence_plays(_: Any, first: int, __: bytes) -> tuple[int, bytes]:
    """Samples that are stored while a sequence plays are lost: the thread that takes loads steps through it."""
    return first, b""


@mutant("BLK-013", "BLK-014", "BLK-016", by=_while("both", *STORES))
def the_last_processors_lose_stores_under_both(self: Any, first: int, data: bytes) -> tuple[int, bytes]:
    """Under a modulated sequence nothing is stored on the last two processors, which are the slowest to be reached."""
    return first, b"" if self.place >= LAST_PLACES else data


@mutant("BLK-013", "PUL-006", by=_while("modulation", Memory.SLOTS))
def a_slot_is_scaled_by_the_modulation_of_that_moment(self: Any, first: int, data: bytes) -> tuple[int, bytes]:
    """A slot that is stored while a modulation plays has the widths of its sample: it passes the look-up of widths."""
    period = self._period
    sample = int(self.history.segments().rows(period, period + 1)[1][0])
    return first, pack_pulses(modulated(unpack_pulses(data), sample))


@mutant("BLK-013", "BLK-014", by=_while("sequence", Memory.SLOTS, Memory.ENTRIES))
def one_processor_stores_beside_the_place_under_a_sequence(self: Any, first: int, data: bytes) -> tuple[int, bytes]:
    """While a sequence plays one processor stores slots and entries one place further: its pointer has moved on."""
    return first + (self.place == WRONG_PLACE), data


@mutant("BLK-014", "BLK-016", wraps=(Dispatch, "store"))
def only_a_first_load_of_a_block_goes_while_something_plays(original: Any, self: Any, loads: Any) -> None:
    """Of a block of entries or samples each processor gets one load while something plays: the rest makes way."""
    original(self, loads[:: len(loads) // PROCESSORS] if self._device.since_period else loads)


@mutant("BLK-007", "BLK-017", by=_while("both", Memory.SAMPLES))
def samples_under_both_begin_the_modulation_anew(self: Any, first: int, data: bytes) -> tuple[int, bytes]:
    """Samples that are stored under a modulated sequence let the modulation begin again: its place is set back."""
    start, overlay = self.history._overlays[-1]
    if start < self._period:
        self.history._overlays.append((self._period + 1, overlay))
    return first, data


# What is in use


@mutant("BLK-008", "BLK-022", each={"entries": "ENTRIES", "samples": "SAMPLES"})
def the_controller_keeps_refused(patch: Patch, kind: str) -> None:
    """{} that are refused with IN_USE stay in the controller's own table, by which it judges what plays."""

    @patch.around(Admission, "_judge_stores")
    def judge(original: Any, self: Any, body: Any) -> None:
        try:
            original(self, body)
        except BlockError:
            if type(body).__name__.lower() == kind:
                self._dispatch.stores.keep(body)
            raise


@mutant("BLK-022", "CON-008", wraps=(Controller, "test_transducer"))
def a_test_leaves_the_slots_of_what_it_ended_in_use(original: Any, self: Any, transducer: int, door: Any) -> None:
    """The console's test ends a sequence, and its slots stay in use until DISABLE."""
    vars(self._dispatch.stores)["end"] = lambda *_, **__: None
    try:
        original(self, transducer, door)
    finally:
        del vars(self._dispatch.stores)["end"]


@mutant("BLK-022", wraps=(Dispatch, "plan"))
def places_are_free_from_the_period_that_was_named(
    original: Any, self: Any, requested: int, *rest: Any, **ends: Any
) -> Any:
    """What a change for as soon as possible ends is free at once, and not when the change takes effect."""
    change = original(self, requested, *rest, **ends)
    sorts = {sort: ends.get(sort, False) for sort in ("sequences", "modulations")}
    self.stores.end(min(max(requested, self.period), change.period), **sorts)
    return change
