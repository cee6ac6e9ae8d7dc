"""Broken stores and sequences: contents, protection and durations (BLK-013 to BLK-022)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....base.errors import BlockError
from ....emulator import machine
from ....emulator.boards.processor import Processor
from ....emulator.control.dispatch import Dispatch
from ....emulator.control.execution import Execution
from ....emulator.control.state_machine import StateMachine
from ....emulator.control.stores import Stores
from ....emulator.ports.history import History, PortSequence
from ....protocol.blocks import AmplitudeModulation, Output, PlaySequence, Slot
from ....protocol.codes import Action, Memory
from ....protocol.states import StateEvent
from .patching import Patch, mutant
from .seams import misread_bodies

ENDED = -1
PERIODS_PER_MS = 40
MOST_REPEATS = 2**16 - 1
Periods = NDArray[np.int64]


# Playing


@mutant("BLK-015", by=misread_bodies)
def sequence_plays_once_too_often(body: Any) -> Any:
    """A sequence with repeats plays once too often: the first pass is not counted."""
    counts = isinstance(body, PlaySequence) and body.repeats
    return replace(body, repeats=min(body.repeats + 1, MOST_REPEATS)) if counts else body


def _play_turns(patch: Patch, entries: Any) -> None:
    patch.replace(PortSequence, "entries", entries)


@mutant("BLK-015", by=_play_turns)
def loop_leaves_out_its_first_entry(self: PortSequence, since: Periods) -> Periods:
    """From the second pass on a sequence begins with its second entry: the loop returns to the wrong place."""
    total, first = int(self.ends[-1]), int(self.ends[0])
    if first == total:
        return np.where((since < total * self.repeats) | (self.repeats == 0), 0, ENDED)
    within = np.where(since < total, since, first + (since - total) % (total - first))
    entry = np.searchsorted(self.ends, within, side="right")
    return np.where((since < total * self.repeats) | (self.repeats == 0), entry, ENDED)


@mutant("BLK-015", by=_play_turns)
def loop_has_a_silent_period(self: PortSequence, since: Periods) -> Periods:
    """Between the last entry and the first a period is silent: the loop starts over too late."""
    total = int(self.ends[-1])
    turn, within = np.divmod(since, total + 1)
    entry = np.where(within == total, ENDED, np.searchsorted(self.ends, within, side="right"))
    return np.where((turn < self.repeats) | (self.repeats == 0), entry, ENDED)


@mutant("BLK-015", "BLK-014", wraps=(History, "run"))
def last_entry_is_a_period_short(
    original: Any, self: Any, period: int, slots: Any, entries: Any, periods: Any, repeats: int
) -> None:
    """The last entry of a sequence plays one period less than it says, unless it says one."""
    shorter = periods.copy()
    shorter[-1] = max(shorter[-1] - 1, 1)
    original(self, period, slots, entries, shorter, repeats)


@mutant("BLK-014", "BLK-015", wraps=(History, "run"))
def periods_of_an_entry_are_counted_in_a_byte(
    original: Any, self: Any, period: int, slots: Any, entries: Any, periods: Any, repeats: int
) -> None:
    """An entry of more than 255 periods plays modulo 256: the processors lose its upper byte."""
    cut = np.where(periods % 256, periods % 256, periods)
    original(self, period, slots, entries, cut, repeats)


@mutant("BLK-013", "BLK-014", wraps=(Processor, "load"))
def slot_numbers_have_7_bits(original: Any, self: Any, memory: Memory, first: int, data: bytes) -> None:
    """An entry of slot 128 or above plays the slot 128 below: the processors lose the highest bit."""
    if memory is Memory.ENTRIES:
        items = np.frombuffer(data, "<u2").reshape(-1, 2).copy()
        items[:, 0] &= 127
        data = items.tobytes()
    original(self, memory, first, data)


@mutant("BLK-015")
def sequence_begins_with_the_table(patch: Patch) -> None:
    """A SEQUENCE plays from the table's first place, whatever its field `first`, although the judgement uses it."""
    misread_bodies(patch, lambda body: replace(body, first=0) if isinstance(body, PlaySequence) else body)


@mutant("BLK-015", "BLK-014", by=misread_bodies)
def sequence_counts_its_entries_in_a_byte(body: Any) -> Any:
    """A sequence of more than 256 entries plays their number modulo 256: the count is truncated."""
    return replace(body, count=(body.count - 1) % 256 + 1) if isinstance(body, PlaySequence) else body


@mutant("BLK-018", "BLK-015", wraps=(Execution, "carry_out"))
def silence_does_not_end_a_sequence(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A SILENCE during a sequence is accepted but has no effect: its table waits behind the sequence."""
    runs = self._device.runs is not None
    change = original(self, body, door)
    if runs and isinstance(body, Output) and body.action is Action.SILENCE:
        change.packed, change.programs, change.effect = None, (), None
    return change


# Ending


def _after_the_end(patch: Patch, then: Any) -> None:
    """Add an effect to the end of a sequence after its last repeat; it gets the period since which it played."""

    @patch.around(Execution, "end_sequence")
    def end(original: Any, self: Any) -> None:
        since = self._device.since_period if self._device.runs is not None else 0
        original(self)
        if since and self._device.runs is None:
            then(self, since)


@mutant("STA-002", "ACK-006", wraps=(Dispatch, "_wake"))
def end_of_a_sequence_comes_before_what_follows_at_once(original: Any, self: Any, turn: int) -> None:
    """A sequence ends, and says so, before a change for the very period of its end takes its place."""
    if turn == self._turn:
        self._on_wake()
    original(self, turn)


@mutant("ACK-006", wraps=(Execution, "end_sequence"))
def end_of_a_sequence_is_not_said(original: Any, self: Any) -> None:
    """The end of a sequence after its last repeat sends no unsolicited status record."""
    vars(self._machine)["send_status"] = lambda *_, **_except: None
    try:
        original(self)
    finally:
        del vars(self._machine)["send_status"]


@mutant("STA-003", "BLK-015")
def device_is_off_behind_a_sequence(patch: Patch) -> None:
    """The end of a sequence after its last repeat disables the outputs instead of only silencing them."""
    _after_the_end(patch, lambda self, _: self._machine.happen(StateEvent.DISABLE, self._dispatch.now))


@mutant("REQ-003")
def since_period_stays_behind_a_sequence(patch: Patch) -> None:
    """STATUS goes on to say since when a sequence played that has ended: it is written at a beginning alone."""
    _after_the_end(patch, lambda self, since: setattr(self._device, "since_period", since))


@mutant("STA-003", "BLK-015", wraps=(StateMachine, "happen"))
def device_plays_on_behind_a_sequence(
    original: Any, self: Any, event: StateEvent, *arguments: Any, **more: Any
) -> None:
    """After the last repeat of a sequence the outputs are silent, but the state stays PLAYING."""
    if event is not StateEvent.END or arguments[1:]:  # one with a door is a SILENCE
        original(self, event, *arguments, **more)


@mutant("BLK-015", "BLK-012", by=_play_turns)
def last_repeat_is_held(self: PortSequence, since: Periods) -> Periods:
    """After its last repeat a sequence leaves its last entry playing: only the count of passes stops."""
    turn, within = np.divmod(since, self.ends[-1])
    entry = np.searchsorted(self.ends, within, side="right")
    return np.where((turn < self.repeats) | (self.repeats == 0), entry, len(self.ends) - 1)


# What is stored and what is in use


@mutant("BLK-022")
def in_use_is_never_refused(patch: Patch) -> None:
    """Slots, entries and samples that play, or are queued to play, can be overwritten."""
    patch.wrap(Stores, "check_free", lambda _: lambda _self, _body, _period: None)


@mutant("BLK-022")
def queued_sequence_uses_nothing_yet(patch: Patch) -> None:
    """What a queued sequence or modulation will play can be overwritten: it counts as in use only once it plays."""
    begins: dict[int, int] = {}

    @patch.around(Dispatch, "plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        change = original(self, *arguments, **more)
        begins[id(self.stores)] = change.period
        return change

    def use(original: Any) -> Any:
        def entered(self: Any, body: Any, period: int) -> Any:
            made = original(self, body, period)
            vars(made)["begins"] = begins[id(self)]
            return made

        return entered

    @patch.around(Stores, "check_free")
    def check(original: Any, self: Any, body: Any, period: int) -> None:
        uses = self._uses
        self._uses = [use for use in uses if vars(use)["begins"] <= period]
        try:
            original(self, body, period)
        finally:
            self._uses = uses

    patch.wrap(Stores, "use", use)


@mutant("BLK-022", wraps=(Stores, "check_free"))
def slots_in_use_are_not_looked_for(original: Any, self: Any, body: Any, period: int) -> None:
    """The slots of playing entries can be overwritten, the entries cannot: only one table is compared."""
    if not isinstance(body, Slot):
        original(self, body, period)


@mutant("BLK-022", "SAF-004", wraps=(Dispatch, "send_silence"))
def uses_outlast_disable_by_a_millisecond(original: Any, self: Any, stops: Any) -> None:
    """What played when the outputs were disabled stays in use for a millisecond after they fall silent."""
    playing = [use for use in self.stores._uses if use.until is None]
    original(self, stops)
    for use in playing:
        use.until += PERIODS_PER_MS


@mutant("BLK-022", "SAF-004", wraps=(Dispatch, "send_silence"))
def uses_survive_disable(original: Any, self: Any, stops: Any) -> None:
    """What played when the outputs were disabled stays in use for ever: the end is not recorded."""
    uses = [(use, use.until) for use in self.stores._uses]
    original(self, stops)
    for use, until in uses:
        use.until = until


@mutant("BLK-021", wraps=(Stores, "check_there"))
def entries_of_empty_slots_play(original: Any, self: Any, body: Any) -> None:
    """A SEQUENCE is accepted although its entries name slots that were never stored: only the entries are checked."""
    try:
        original(self, body)
    except BlockError:
        entries = None if isinstance(body, AmplitudeModulation) else self._entries[body.first : body.first + body.count]
        if entries is None or None in entries:
            raise


@mutant("BLK-021", wraps=(Stores, "check_there"))
def entries_that_were_never_stored_play(original: Any, self: Any, body: Any) -> None:
    """A SEQUENCE is accepted if its first entry was stored: the others are not checked."""
    original(self, replace(body, count=1) if isinstance(body, PlaySequence) else body)


@mutant("BLK-021", wraps=(Stores, "check_there"))
def samples_that_were_never_stored_play(original: Any, self: Any, body: Any) -> None:
    """A MODULATION over samples that were never stored is accepted: they are read as 0."""
    if isinstance(body, PlaySequence):
        original(self, body)


@mutant("BLK-013", "REQ-013")
def slots_survive_reset(patch: Patch) -> None:
    """After RESET slots keep their contents: neither their memory nor the table of stored slots is cleared."""
    _keep_over_restart(patch, Memory.SLOTS, ("_powers",))


@mutant("BLK-016", "REQ-013")
def samples_survive_reset(patch: Patch) -> None:
    """After RESET samples keep their values: neither their memory nor the table of stored samples is cleared."""
    _keep_over_restart(patch, Memory.SAMPLES, ("_samples",))


def _keep_over_restart(patch: Patch, memory: Memory, tables: tuple[str, ...]) -> None:
    kept: dict[int, tuple[dict[str, Any], list[bytearray]]] = {}

    @patch.around(machine.Emulator, "restart")
    def restart(original: Any, self: Any) -> None:
        if self.controller is not None:
            known = {name: getattr(self.controller._dispatch.stores, name) for name in tables}
            kept[id(self)] = known, [processor._memories[memory] for processor in self.processors]
        original(self)

    @patch.around(machine.Emulator, "_come_up")
    def come_up(original: Any, self: Any, *arguments: Any) -> None:
        original(self, *arguments)
        known, memories = kept.pop(id(self), ({}, []))
        for name, table in known.items():
            setattr(self.controller._dispatch.stores, name, table)
        for processor, stored in zip(self.processors, memories, strict=False):
            processor._memories[memory] = stored

    @patch.around(machine.Emulator, "power_up")
    def power_up(original: Any, self: Any) -> None:
        kept.pop(id(self), None)
        original(self)


@mutant("SAF-004", "BLK-013", wraps=(StateMachine, "_drop_all"))
def disable_clears_the_stores(original: Any, self: Any) -> None:
    """After DISABLE nothing is stored any more: it acts like a restart."""
    original(self)
    self._dispatch.stores = Stores()


@mutant("BLK-013", "USB-026", wraps=(StateMachine, "new_session"))
def new_session_clears_the_stores(original: Any, self: Any, door: Any) -> None:
    """A bus reset and SET_CONFIGURATION clear slots, entries and samples, which should stay."""
    original(self, door)
    self._dispatch.stores = Stores()


@mutant("BLK-014", wraps=(Processor, "load"))
def entries_are_placed_within_a_block(original: Any, self: Any, memory: Memory, first: int, data: bytes) -> None:
    """Entries from place 120 on overwrite those 120 places before on the processors: `first` is taken modulo 120."""
    original(self, memory, first % 120 if memory is Memory.ENTRIES else first, data)


@mutant("BLK-016", wraps=(Processor, "load"))
def samples_beyond_4080_are_lost(original: Any, self: Any, memory: Memory, first: int, data: bytes) -> None:
    """The last 16 samples of the buffer are never written: 85 whole loads of 48 end before them."""
    original(self, memory, first, data[: max(4080 - first, 0)] if memory is Memory.SAMPLES else data)
