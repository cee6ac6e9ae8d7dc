"""What the controller knows of the stores: what was stored, what it would play, and what is in use (chapter BLK)."""

from __future__ import annotations

from dataclasses import dataclass

from ...base.errors import BlockError
from ...protocol.blocks import AmplitudeModulation, Entries, PlaySequence, Samples, Slot
from ...protocol.codes import MODULATION_SAMPLES, SEQUENCE_ENTRIES, SLOTS, Reason

__all__ = ["Store", "Stores", "Use"]

Store = Slot | Entries | Samples


@dataclass(eq=False)
class Use:
    """What an accepted sequence or modulation plays, until something else has taken its place."""

    slots: frozenset[int]
    entries: range
    samples: range
    until: int | None = None
    """Period at which it has ended; None while nothing ends it."""

    def ends(self, period: int) -> None:
        """Something ends it at a period, if nothing has before."""
        self.until = period if self.until is None else min(self.until, period)


class Stores:
    """Slots, entries and samples, as far as the controller must know them to judge a block."""

    def __init__(self) -> None:
        self._powers: list[int | None] = [None] * SLOTS
        self._entries: list[tuple[int, int] | None] = [None] * SEQUENCE_ENTRIES
        self._samples = bytearray(MODULATION_SAMPLES)
        self._uses: list[Use] = []

    def keep(self, body: Store) -> None:
        """Take what was accepted."""
        match body:
            case Slot():
                self._powers[body.number] = body.pulses.total_drive
            case Entries():
                self._entries[body.first : body.first + len(body.entries)] = [
                    (entry.slot, entry.periods) for entry in body.entries
                ]
            case Samples():
                self._samples[body.first : body.first + len(body.samples)] = b"\1" * len(body.samples)

    def check_free(self, body: Store, period: int) -> None:
        """Refuse to overwrite what plays or will play in a period or later (clause BLK-022)."""
        self._drop_ended(period)
        match body:
            case Slot():
                taken = any(body.number in use.slots for use in self._uses)
            case Entries():
                places = range(body.first, body.first + len(body.entries))
                taken = any(_overlap(places, use.entries) for use in self._uses)
            case Samples():
                places = range(body.first, body.first + len(body.samples))
                taken = any(_overlap(places, use.samples) for use in self._uses)
        if taken:
            raise BlockError(f"{body.KIND.name} would overwrite what plays or is queued", Reason.IN_USE)

    def check_power(self, body: PlaySequence, limit: int) -> None:
        """Refuse a sequence that would play a slot above a total drive, in thousandths (clause SAF-006)."""
        entries = self._entries[body.first : body.first + body.count]
        for slot in {entry[0] for entry in entries if entry is not None}:
            power = self._powers[slot]
            if power is not None and power > limit:
                told = Reason.DRIVE.with_values(drive=power / 1000, limit=limit // 1000)
                raise BlockError(f"slot {slot}: {told}", Reason.DRIVE)

    def check_there(self, body: PlaySequence | AmplitudeModulation) -> None:
        """Refuse to play what was never stored (clause BLK-021)."""
        places = range(body.first, body.first + body.count)
        if isinstance(body, AmplitudeModulation):
            if not all(self._samples[place] for place in places):
                raise BlockError("a sample of the modulation was never stored", Reason.EMPTY)
            return
        for place in places:
            entry = self._entries[place]
            if entry is None or self._powers[entry[0]] is None:
                missing = f"entry {place}" if entry is None else f"slot {entry[0]}"
                raise BlockError(f"{missing} was never stored", Reason.EMPTY)

    def duration(self, body: PlaySequence) -> int | None:
        """Periods that a sequence plays, None for without end."""
        entries = self._entries[body.first : body.first + body.count]
        return body.repeats * sum(entry[1] for entry in entries if entry is not None) or None

    def use(self, body: PlaySequence | AmplitudeModulation, period: int) -> Use:
        """From now on, in a period, what this plays is in use."""
        self._drop_ended(period)
        places, none = range(body.first, body.first + body.count), range(0)
        if isinstance(body, AmplitudeModulation):
            use = Use(frozenset(), none, places)
        else:
            entries = self._entries[body.first : body.first + body.count]
            use = Use(frozenset(entry[0] for entry in entries if entry is not None), places, none)
        self._uses.append(use)
        return use

    def _drop_ended(self, period: int) -> None:
        self._uses = [use for use in self._uses if use.until is None or period < use.until]

    def end(self, period: int, *, sequences: bool, modulations: bool) -> None:
        """Everything of these sorts that is in use ends at a period."""
        for use in self._uses:
            if (sequences and use.entries) or (modulations and use.samples):
                use.ends(period)


def _overlap(one: range, other: range) -> bool:
    return max(one.start, other.start) < min(one.stop, other.stop)
