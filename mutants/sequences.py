"""Broken stores and sequences: what is kept, what may be overwritten, what plays for how long (BLK-013 to BLK-022)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..emulator import machine
from ..emulator.boards.processor import Processor
from ..emulator.control import controller
from ..emulator.control.stores import Stores
from ..emulator.ports.reel import Reel, Turns
from ..errors import BlockError
from ..protocol.blocks import Modulation, Output, Sequence, Slot
from ..protocol.codes import Action, Memory
from ..protocol.states import Event
from .patching import Patch, mutant
from .seams import misread_bodies

ENDED = -1
PERIODS_PER_MS = 40
MOST_REPEATS = 2**16 - 1
Periods = NDArray[np.int64]


# How it plays


@mutant("BLK-015", by=misread_bodies)
def sequence_plays_once_too_often(body: Any) -> Any:
    """A sequence with repeats plays one time more: they are counted as repetitions of the first time."""
    counts = isinstance(body, Sequence) and body.repeats
    return replace(body, repeats=min(body.repeats + 1, MOST_REPEATS)) if counts else body


def _play_turns(patch: Patch, entries: Any) -> None:
    patch.replace(Turns, "entries", entries)


@mutant("BLK-015", by=_play_turns)
def loop_leaves_out_its_first_entry(self: Turns, since: Periods) -> Periods:
    """From the second time on a sequence begins with its second entry: the loop goes back to the place behind it."""
    total, first = int(self.ends[-1]), int(self.ends[0])
    if first == total:
        return np.where((since < total * self.repeats) | (self.repeats == 0), 0, ENDED)
    within = np.where(since < total, since, first + (since - total) % (total - first))
    entry = np.searchsorted(self.ends, within, side="right")
    return np.where((since < total * self.repeats) | (self.repeats == 0), entry, ENDED)


@mutant("BLK-015", by=_play_turns)
def loop_has_a_silent_period(self: Turns, since: Periods) -> Periods:
    """Between the last entry and the first a period is silent: the loop is noticed when its time has come."""
    total = int(self.ends[-1])
    turn, within = np.divmod(since, total + 1)
    entry = np.where(within == total, ENDED, np.searchsorted(self.ends, within, side="right"))
    return np.where((turn < self.repeats) | (self.repeats == 0), entry, ENDED)


@mutant("BLK-015", "BLK-014", wraps=(Reel, "run"))
def last_entry_is_a_period_short(
    original: Any, self: Any, period: int, slots: Any, entries: Any, periods: Any, repeats: int
) -> None:
    """The last entry of a sequence plays one period less than it says, if it says more than one."""
    shorter = periods.copy()
    shorter[-1] = max(shorter[-1] - 1, 1)
    original(self, period, slots, entries, shorter, repeats)


@mutant("BLK-014", "BLK-015", wraps=(Reel, "run"))
def periods_of_an_entry_are_counted_in_a_byte(
    original: Any, self: Any, period: int, slots: Any, entries: Any, periods: Any, repeats: int
) -> None:
    """An entry of more than 255 periods plays modulo 256: its upper byte gets lost on the processors."""
    cut = np.where(periods % 256, periods % 256, periods)
    original(self, period, slots, entries, cut, repeats)


@mutant("BLK-013", "BLK-014", wraps=(Processor, "load"))
def slot_numbers_have_7_bits(original: Any, self: Any, memory: Memory, first: int, data: bytes) -> None:
    """An entry of slot 128 or more plays the slot 128 before: the highest bit gets lost on the processors."""
    if memory is Memory.ENTRIES:
        items = np.frombuffer(data, "<u2").reshape(-1, 2).copy()
        items[:, 0] &= 127
        data = items.tobytes()
    original(self, memory, first, data)


@mutant("BLK-015")
def sequence_begins_with_the_table(patch: Patch) -> None:
    """A SEQUENCE plays from the first place of the table on, whatever its field `first` says, by which it is judged."""
    misread_bodies(patch, lambda body: replace(body, first=0) if isinstance(body, Sequence) else body)


@mutant("BLK-015", "BLK-014", by=misread_bodies)
def sequence_counts_its_entries_in_a_byte(body: Any) -> Any:
    """Of a sequence of more than 256 entries those beyond a multiple of 256 play: their number is cut off."""
    return replace(body, count=(body.count - 1) % 256 + 1) if isinstance(body, Sequence) else body


@mutant("BLK-018", "BLK-015", wraps=(controller.Controller, "_carry_out"))
def silence_does_not_end_a_sequence(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A SILENCE while a sequence plays is accepted, and the sequence goes on: it is a table of silence that waits."""
    runs = self._runs is not None
    change = original(self, body, door)
    if runs and isinstance(body, Output) and body.action is Action.SILENCE:
        change.packed, change.programs, change.effect = None, (), None
    return change


# How it ends


def _behind_the_end(patch: Patch, then: Any) -> None:
    """Let something more happen where a sequence has played its last repeat, with the period since which it played."""

    @patch.around(controller.Controller, "_end_sequence")
    def end(original: Any, self: Any) -> None:
        since = self._since_period if self._runs is not None else 0
        original(self)
        if since and self._runs is None:
            then(self, since)


@mutant("STA-002", "ACK-006", wraps=(controller.Controller, "_wake"))
def end_of_a_sequence_comes_before_what_follows_at_once(original: Any, self: Any, turn: int) -> None:
    """A sequence ends, and says so, before a change of the very period in which it ends takes its place."""
    if turn == self._turn:
        self._end_sequence()
    original(self, turn)


@mutant("ACK-006", wraps=(controller.Controller, "_end_sequence"))
def end_of_a_sequence_is_not_said(original: Any, self: Any) -> None:
    """Where a sequence has played its last repeat, no status record comes of the device's own accord."""
    vars(self)["_speak"] = lambda *_, **_besides: None
    try:
        original(self)
    finally:
        del vars(self)["_speak"]


@mutant("STA-003", "BLK-015")
def device_is_off_behind_a_sequence(patch: Patch) -> None:
    """Where a sequence has played its last repeat, the outputs are disabled as well as silent."""
    _behind_the_end(patch, lambda self, _: self._happen(Event.DISABLE, self._now))


@mutant("REQ-003")
def since_period_stays_behind_a_sequence(patch: Patch) -> None:
    """STATUS goes on to say since when a sequence played that has ended: it is written at a beginning alone."""
    _behind_the_end(patch, lambda self, since: setattr(self, "_since_period", since))


@mutant("STA-003", "BLK-015", wraps=(controller.Controller, "_happen"))
def device_plays_on_behind_a_sequence(original: Any, self: Any, event: Event, *arguments: Any, **more: Any) -> None:
    """Where a sequence has played its last repeat, the outputs are silent and the state stays PLAYING."""
    if event is not Event.END or arguments[1:]:  # one with a door is a SILENCE
        original(self, event, *arguments, **more)


@mutant("BLK-015", "BLK-012", by=_play_turns)
def last_repeat_is_held(self: Turns, since: Periods) -> Periods:
    """Behind its last repeat a sequence leaves its last entry playing: only the count of turns stops."""
    turn, within = np.divmod(since, self.ends[-1])
    entry = np.searchsorted(self.ends, within, side="right")
    return np.where((turn < self.repeats) | (self.repeats == 0), entry, len(self.ends) - 1)


# What is stored, and what is in use


@mutant("BLK-022")
def in_use_is_never_refused(patch: Patch) -> None:
    """Slots, entries and samples that play or will play can be overwritten."""
    patch.wrap(Stores, "check_free", lambda _: lambda _self, _body, _period: None)


@mutant("BLK-022")
def queued_sequence_uses_nothing_yet(patch: Patch) -> None:
    """What a sequence or a modulation plays can be overwritten until it begins: it counts as in use from then on."""
    begins: dict[int, int] = {}

    @patch.around(controller.Controller, "_plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        change = original(self, *arguments, **more)
        begins[id(self._stores)] = change.period
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
    """The slots of entries that play can be overwritten, the entries cannot: only one table is compared."""
    if not isinstance(body, Slot):
        original(self, body, period)


@mutant("BLK-022", "SAF-004", wraps=(controller.Controller, "_send_silence"))
def uses_outlast_disable_by_a_millisecond(original: Any, self: Any, stops: Any) -> None:
    """What played when the outputs were disabled stays in use for a millisecond after they are silent."""
    playing = [use for use in self._stores._uses if use.until is None]
    original(self, stops)
    for use in playing:
        use.until += PERIODS_PER_MS


@mutant("BLK-022", "SAF-004", wraps=(controller.Controller, "_send_silence"))
def uses_survive_disable(original: Any, self: Any, stops: Any) -> None:
    """What played when the outputs were disabled stays in use for ever: nothing ended it."""
    uses = [(use, use.until) for use in self._stores._uses]
    original(self, stops)
    for use, until in uses:
        use.until = until


@mutant("BLK-021", wraps=(Stores, "check_there"))
def entries_of_empty_slots_play(original: Any, self: Any, body: Any) -> None:
    """A SEQUENCE is accepted whose entries name slots that were never stored: the entries alone are looked at."""
    try:
        original(self, body)
    except BlockError:
        entries = None if isinstance(body, Modulation) else self._entries[body.first : body.first + body.count]
        if entries is None or None in entries:
            raise


@mutant("BLK-021", wraps=(Stores, "check_there"))
def entries_that_were_never_stored_play(original: Any, self: Any, body: Any) -> None:
    """A SEQUENCE is accepted whose first entry was stored, whatever the others: one look is thought to suffice."""
    original(self, replace(body, count=1) if isinstance(body, Sequence) else body)


@mutant("BLK-021", wraps=(Stores, "check_there"))
def samples_that_were_never_stored_play(original: Any, self: Any, body: Any) -> None:
    """A MODULATION over samples that were never stored is accepted: they are 0, which seems as good as any."""
    if isinstance(body, Sequence):
        original(self, body)


@mutant("BLK-013", "REQ-013")
def slots_survive_reset(patch: Patch) -> None:
    """After RESET slots hold what they held before: their memory is not cleared, nor the table of what is there."""
    _keep_over_restart(patch, Memory.SLOTS, ("_powers",))


@mutant("BLK-016", "REQ-013")
def samples_survive_reset(patch: Patch) -> None:
    """After RESET samples are what they were before: their memory is not cleared, nor the table of what is there."""
    _keep_over_restart(patch, Memory.SAMPLES, ("_samples",))


def _keep_over_restart(patch: Patch, memory: Memory, tables: tuple[str, ...]) -> None:
    kept: dict[int, tuple[dict[str, Any], list[bytearray]]] = {}

    @patch.around(machine.Emulator, "restart")
    def restart(original: Any, self: Any) -> None:
        if self.controller is not None:
            known = {name: getattr(self.controller._stores, name) for name in tables}
            kept[id(self)] = known, [processor._memories[memory] for processor in self.processors]
        original(self)

    @patch.around(machine.Emulator, "_come_up")
    def come_up(original: Any, self: Any, *arguments: Any) -> None:
        original(self, *arguments)
        known, memories = kept.pop(id(self), ({}, []))
        for name, table in known.items():
            setattr(self.controller._stores, name, table)
        for processor, stored in zip(self.processors, memories, strict=False):
            processor._memories[memory] = stored

    @patch.around(machine.Emulator, "power_up")
    def power_up(original: Any, self: Any) -> None:
        kept.pop(id(self), None)
        original(self)


@mutant("SAF-004", "BLK-013", wraps=(controller.Controller, "_drop_all"))
def disable_clears_the_stores(original: Any, self: Any) -> None:
    """After DISABLE nothing is stored any more: it does all that a restart does."""
    original(self)
    self._stores = Stores()


@mutant("BLK-013", "USB-026", wraps=(controller.Controller, "new_session"))
def new_session_clears_the_stores(original: Any, self: Any, door: Any) -> None:
    """A bus reset and SET_CONFIGURATION empty slots, entries and samples, which should stay."""
    original(self, door)
    self._stores = Stores()


@mutant("BLK-014", wraps=(Processor, "load"))
def entries_are_placed_within_a_block(original: Any, self: Any, memory: Memory, first: int, data: bytes) -> None:
    """Entries beyond place 119 overwrite on the processors what is 120 places before: `first` is taken modulo 120."""
    original(self, memory, first % 120 if memory is Memory.ENTRIES else first, data)


@mutant("BLK-016", wraps=(Processor, "load"))
def samples_beyond_4080_are_lost(original: Any, self: Any, memory: Memory, first: int, data: bytes) -> None:
    """The last 16 samples of the buffer are never written: 85 whole loads of 48 end before."""
    original(self, memory, first, data[: max(4080 - first, 0)] if memory is Memory.SAMPLES else data)
