"""Broken stores and sequences: what is kept, what may be overwritten, what plays for how long (BLK-013 to BLK-022)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....emulator import machine
from ....emulator.boards.processor import Processor
from ....emulator.control import controller
from ....emulator.control.stores import Stores
from ....emulator.ports.reel import Reel, Turns
from ....errors import BlockError
from ....protocol.blocks import Modulation, Output, Sequence, Slot
from ....protocol.codes import Action, Memory
from ....protocol.states import Event
from .patching import Patch, mutant
from .seams import misread_bodies

ENDED = -1
PERIODS_PER_MS = 40
MOST_REPEATS = 2**16 - 1
Periods = NDArray[np.int64]


# How it plays


@mutant("BLK-015")
def sequence_plays_once_too_often(patch: Patch) -> None:
    """A sequence with repeats plays one time more: they are counted as repetitions of the first time."""

    def misread(body: Any) -> Any:
        counts = isinstance(body, Sequence) and body.repeats
        return replace(body, repeats=min(body.repeats + 1, MOST_REPEATS)) if counts else body

    misread_bodies(patch, misread)


def _play_turns(patch: Patch, entries: Any) -> None:
    patch.replace(Turns, "entries", entries)


@mutant("BLK-015")
def loop_leaves_out_its_first_entry(patch: Patch) -> None:
    """From the second time on a sequence begins with its second entry: the loop goes back to the place behind it."""

    def entries(self: Turns, since: Periods) -> Periods:
        total, first = int(self.ends[-1]), int(self.ends[0])
        if first == total:
            return np.where((since < total * self.repeats) | (self.repeats == 0), 0, ENDED)
        within = np.where(since < total, since, first + (since - total) % (total - first))
        entry = np.searchsorted(self.ends, within, side="right")
        return np.where((since < total * self.repeats) | (self.repeats == 0), entry, ENDED)

    _play_turns(patch, entries)


@mutant("BLK-015")
def loop_has_a_silent_period(patch: Patch) -> None:
    """Between the last entry and the first a period is silent: the loop is noticed when its time has come."""

    def entries(self: Turns, since: Periods) -> Periods:
        total = int(self.ends[-1])
        turn, within = np.divmod(since, total + 1)
        entry = np.where(within == total, ENDED, np.searchsorted(self.ends, within, side="right"))
        return np.where((turn < self.repeats) | (self.repeats == 0), entry, ENDED)

    _play_turns(patch, entries)


@mutant("BLK-015", "BLK-014")
def last_entry_is_a_period_short(patch: Patch) -> None:
    """The last entry of a sequence plays one period less than it says, if it says more than one."""

    def around(original: Any) -> Any:
        def run(self: Any, period: int, slots: Any, entries: Any, periods: Any, repeats: int) -> None:
            shorter = periods.copy()
            shorter[-1] = max(shorter[-1] - 1, 1)
            original(self, period, slots, entries, shorter, repeats)

        return run

    patch.wrap(Reel, "run", around)


@mutant("BLK-014", "BLK-015")
def periods_of_an_entry_are_counted_in_a_byte(patch: Patch) -> None:
    """An entry of more than 255 periods plays modulo 256: its upper byte gets lost on the processors."""

    def around(original: Any) -> Any:
        def run(self: Any, period: int, slots: Any, entries: Any, periods: Any, repeats: int) -> None:
            cut = np.where(periods % 256, periods % 256, periods)
            original(self, period, slots, entries, cut, repeats)

        return run

    patch.wrap(Reel, "run", around)


@mutant("BLK-013", "BLK-014")
def slot_numbers_have_7_bits(patch: Patch) -> None:
    """An entry of slot 128 or more plays the slot 128 before: the highest bit gets lost on the processors."""

    def around(original: Any) -> Any:
        def load(self: Any, memory: Memory, first: int, data: bytes) -> None:
            if memory is Memory.ENTRIES:
                items = np.frombuffer(data, "<u2").reshape(-1, 2).copy()
                items[:, 0] &= 127
                data = items.tobytes()
            original(self, memory, first, data)

        return load

    patch.wrap(Processor, "load", around)


@mutant("BLK-015")
def sequence_begins_with_the_table(patch: Patch) -> None:
    """A SEQUENCE plays from the first place of the table on, whatever its field `first` says, by which it is judged."""
    misread_bodies(patch, lambda body: replace(body, first=0) if isinstance(body, Sequence) else body)


@mutant("BLK-015", "BLK-014")
def sequence_counts_its_entries_in_a_byte(patch: Patch) -> None:
    """Of a sequence of more than 256 entries those beyond a multiple of 256 play: their number is cut off."""

    def misread(body: Any) -> Any:
        return replace(body, count=(body.count - 1) % 256 + 1) if isinstance(body, Sequence) else body

    misread_bodies(patch, misread)


@mutant("BLK-018", "BLK-015")
def silence_does_not_end_a_sequence(patch: Patch) -> None:
    """A SILENCE while a sequence plays is accepted, and the sequence goes on: it is a table of silence that waits."""

    def around(original: Any) -> Any:
        def carry_out(self: Any, body: Any, door: Any) -> Any:
            runs = self._runs is not None
            change = original(self, body, door)
            if runs and isinstance(body, Output) and body.action is Action.SILENCE:
                change.packed, change.programs, change.effect = None, (), None
            return change

        return carry_out

    patch.wrap(controller.Controller, "_carry_out", around)


# How it ends


def _behind_the_end(patch: Patch, then: Any) -> None:
    """Let something more happen where a sequence has played its last repeat, with the period since which it played."""

    def around(original: Any) -> Any:
        def end(self: Any) -> None:
            since = self._since_period if self._runs is not None else 0
            original(self)
            if since and self._runs is None:
                then(self, since)

        return end

    patch.wrap(controller.Controller, "_end_sequence", around)


@mutant("STA-002", "ACK-006")
def end_of_a_sequence_comes_before_what_follows_at_once(patch: Patch) -> None:
    """A sequence ends, and says so, before a change of the very period in which it ends takes its place."""

    def around(original: Any) -> Any:
        def wake(self: Any, turn: int) -> None:
            if turn == self._turn:
                self._end_sequence()
            original(self, turn)

        return wake

    patch.wrap(controller.Controller, "_wake", around)


@mutant("ACK-006")
def end_of_a_sequence_is_not_said(patch: Patch) -> None:
    """Where a sequence has played its last repeat, no status record comes of the device's own accord."""

    def around(original: Any) -> Any:
        def end(self: Any) -> None:
            vars(self)["_speak"] = lambda *_, **_besides: None
            try:
                original(self)
            finally:
                del vars(self)["_speak"]

        return end

    patch.wrap(controller.Controller, "_end_sequence", around)


@mutant("STA-003", "BLK-015")
def device_is_off_behind_a_sequence(patch: Patch) -> None:
    """Where a sequence has played its last repeat, the outputs are disabled as well as silent."""
    _behind_the_end(patch, lambda self, _: self._happen(Event.DISABLE, self._now))


@mutant("REQ-003")
def since_period_stays_behind_a_sequence(patch: Patch) -> None:
    """STATUS goes on to say since when a sequence played that has ended: it is written at a beginning alone."""
    _behind_the_end(patch, lambda self, since: setattr(self, "_since_period", since))


@mutant("STA-003", "BLK-015")
def device_plays_on_behind_a_sequence(patch: Patch) -> None:
    """Where a sequence has played its last repeat, the outputs are silent and the state stays PLAYING."""

    def stay(original: Any) -> Any:
        def happen(self: Any, event: Event, *arguments: Any, **more: Any) -> None:
            if event is not Event.END or arguments[1:]:  # one with a door is a SILENCE
                original(self, event, *arguments, **more)

        return happen

    patch.wrap(controller.Controller, "_happen", stay)


@mutant("BLK-015", "BLK-012")
def last_repeat_is_held(patch: Patch) -> None:
    """Behind its last repeat a sequence leaves its last entry playing: only the count of turns stops."""

    def entries(self: Turns, since: Periods) -> Periods:
        turn, within = np.divmod(since, self.ends[-1])
        entry = np.searchsorted(self.ends, within, side="right")
        return np.where((turn < self.repeats) | (self.repeats == 0), entry, len(self.ends) - 1)

    _play_turns(patch, entries)


# What is stored, and what is in use


@mutant("BLK-022")
def in_use_is_never_refused(patch: Patch) -> None:
    """Slots, entries and samples that play or will play can be overwritten."""
    patch.wrap(Stores, "check_free", lambda _: lambda _self, _body, _period: None)


@mutant("BLK-022")
def queued_sequence_uses_nothing_yet(patch: Patch) -> None:
    """What a sequence or a modulation plays can be overwritten until it begins: it counts as in use from then on."""
    begins: dict[int, int] = {}

    def plan(original: Any) -> Any:
        def planned(self: Any, *arguments: Any, **more: Any) -> Any:
            change = original(self, *arguments, **more)
            begins[id(self._stores)] = change.period
            return change

        return planned

    def use(original: Any) -> Any:
        def entered(self: Any, body: Any, period: int) -> Any:
            made = original(self, body, period)
            vars(made)["begins"] = begins[id(self)]
            return made

        return entered

    def check(original: Any) -> Any:
        def free(self: Any, body: Any, period: int) -> None:
            uses = self._uses
            self._uses = [use for use in uses if vars(use)["begins"] <= period]
            try:
                original(self, body, period)
            finally:
                self._uses = uses

        return free

    patch.wrap(controller.Controller, "_plan", plan)
    patch.wrap(Stores, "use", use)
    patch.wrap(Stores, "check_free", check)


@mutant("BLK-022")
def slots_in_use_are_not_looked_for(patch: Patch) -> None:
    """The slots of entries that play can be overwritten, the entries cannot: only one table is compared."""

    def around(original: Any) -> Any:
        def check(self: Any, body: Any, period: int) -> None:
            if not isinstance(body, Slot):
                original(self, body, period)

        return check

    patch.wrap(Stores, "check_free", around)


@mutant("BLK-022", "SAF-004")
def uses_outlast_disable_by_a_millisecond(patch: Patch) -> None:
    """What played when the outputs were disabled stays in use for a millisecond after they are silent."""

    def around(original: Any) -> Any:
        def send(self: Any, stops: Any) -> None:
            playing = [use for use in self._stores._uses if use.until is None]
            original(self, stops)
            for use in playing:
                use.until += PERIODS_PER_MS

        return send

    patch.wrap(controller.Controller, "_send_silence", around)


@mutant("BLK-022", "SAF-004")
def uses_survive_disable(patch: Patch) -> None:
    """What played when the outputs were disabled stays in use for ever: nothing ended it."""

    def around(original: Any) -> Any:
        def send(self: Any, stops: Any) -> None:
            uses = [(use, use.until) for use in self._stores._uses]
            original(self, stops)
            for use, until in uses:
                use.until = until

        return send

    patch.wrap(controller.Controller, "_send_silence", around)


@mutant("BLK-021")
def entries_of_empty_slots_play(patch: Patch) -> None:
    """A SEQUENCE is accepted whose entries name slots that were never stored: the entries alone are looked at."""

    def around(original: Any) -> Any:
        def check(self: Any, body: Any) -> None:
            try:
                original(self, body)
            except BlockError:
                entries = None if isinstance(body, Modulation) else self._entries[body.first : body.first + body.count]
                if entries is None or None in entries:
                    raise

        return check

    patch.wrap(Stores, "check_there", around)


@mutant("BLK-021")
def entries_that_were_never_stored_play(patch: Patch) -> None:
    """A SEQUENCE is accepted whose first entry was stored, whatever the others: one look is thought to suffice."""

    def around(original: Any) -> Any:
        def check(self: Any, body: Any) -> None:
            original(self, replace(body, count=1) if isinstance(body, Sequence) else body)

        return check

    patch.wrap(Stores, "check_there", around)


@mutant("BLK-021")
def samples_that_were_never_stored_play(patch: Patch) -> None:
    """A MODULATION over samples that were never stored is accepted: they are 0, which seems as good as any."""

    def around(original: Any) -> Any:
        def check(self: Any, body: Any) -> None:
            if isinstance(body, Sequence):
                original(self, body)

        return check

    patch.wrap(Stores, "check_there", around)


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

    def restart(original: Any) -> Any:
        def keep(self: Any) -> None:
            if self.controller is not None:
                known = {name: getattr(self.controller._stores, name) for name in tables}
                kept[id(self)] = known, [processor._memories[memory] for processor in self.processors]
            original(self)

        return keep

    def come_up(original: Any) -> Any:
        def restore(self: Any, *arguments: Any) -> None:
            original(self, *arguments)
            known, memories = kept.pop(id(self), ({}, []))
            for name, table in known.items():
                setattr(self.controller._stores, name, table)
            for processor, stored in zip(self.processors, memories, strict=False):
                processor._memories[memory] = stored

        return restore

    def power_up(original: Any) -> Any:
        def forget(self: Any) -> None:
            kept.pop(id(self), None)
            original(self)

        return forget

    patch.wrap(machine.Emulator, "restart", restart)
    patch.wrap(machine.Emulator, "_come_up", come_up)
    patch.wrap(machine.Emulator, "power_up", power_up)


@mutant("SAF-004", "BLK-013")
def disable_clears_the_stores(patch: Patch) -> None:
    """After DISABLE nothing is stored any more: it does all that a restart does."""

    def around(original: Any) -> Any:
        def drop(self: Any) -> None:
            original(self)
            self._stores = Stores()

        return drop

    patch.wrap(controller.Controller, "_drop_all", around)


@mutant("BLK-013", "USB-026")
def new_session_clears_the_stores(patch: Patch) -> None:
    """A bus reset and SET_CONFIGURATION empty slots, entries and samples, which should stay."""

    def around(original: Any) -> Any:
        def begin(self: Any, door: Any) -> None:
            original(self, door)
            self._stores = Stores()

        return begin

    patch.wrap(controller.Controller, "new_session", around)


@mutant("BLK-014")
def entries_are_placed_within_a_block(patch: Patch) -> None:
    """Entries beyond place 119 overwrite on the processors what is 120 places before: `first` is taken modulo 120."""

    def around(original: Any) -> Any:
        def load(self: Any, memory: Memory, first: int, data: bytes) -> None:
            original(self, memory, first % 120 if memory is Memory.ENTRIES else first, data)

        return load

    patch.wrap(Processor, "load", around)


@mutant("BLK-016")
def samples_beyond_4080_are_lost(patch: Patch) -> None:
    """The last 16 samples of the buffer are never written: 85 whole loads of 48 end before."""

    def around(original: Any) -> Any:
        def load(self: Any, memory: Memory, first: int, data: bytes) -> None:
            original(self, memory, first, data[: max(4080 - first, 0)] if memory is Memory.SAMPLES else data)

        return load

    patch.wrap(Processor, "load", around)
