"""What one port plays, kept as segments of whole periods and expanded only when somebody looks.

A segment begins at a period and lasts until the next one begins: pulses, or a sequence of slots. Modulations lie over
them in segments of their own. Memory grows with what was sent, not with time: an hour of a looped sequence is one
segment. Periods are those of the port's own clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...protocol.chain import SLICE_BYTES
from ...protocol.codes import AMPLITUDES

__all__ = ["FULL", "SILENT", "History", "Segments"]

FULL = AMPLITUDES - 1
"""The modulation sample that leaves pulses as they are."""
BEFORE_ALL = -(2**62)
SILENT = 0
"""Row of the silent pulses, which every history begins with."""


MORE = 4
"""Of what is kept, times: as much comes before the next time that something is forgotten (`Emulator`)."""


class Rows:
    """An array that grows at its end; what was read of it stays as it is."""

    def __init__(self, width: tuple[int, ...], dtype: Any, room: int = 16) -> None:
        self._rows: NDArray[Any] = np.empty((room, *width), dtype)
        self.size = 0

    @classmethod
    def of(cls, rows: NDArray[Any]) -> Rows:
        """Begin with some, with room for three times as many more."""
        grown = cls(rows.shape[1:], rows.dtype, MORE * len(rows))
        grown.extend(rows)
        return grown

    def extend(self, rows: Any) -> int:
        """Append rows; the index of the first."""
        first, self.size = self.size, self.size + len(rows)
        if self.size > len(self._rows):
            grown = np.empty((max(self.size, 2 * len(self._rows)), *self._rows.shape[1:]), self._rows.dtype)
            grown[:first] = self._rows[:first]
            self._rows = grown
        self._rows[first : self.size] = rows
        return first

    def view(self) -> NDArray[Any]:
        """All rows, not to be written to."""
        view = self._rows[: self.size]
        view.setflags(write=False)
        return view


class PortSequence(NamedTuple):
    """A sequence that plays."""

    ends: NDArray[np.int64]
    """Periods from its beginning to the end of each entry, (e,)."""
    rows: NDArray[np.int64]
    """Row of the pulses of each entry, (e,)."""
    repeats: int
    """Times that it is played, 0 for without end."""

    def entries(self, since: NDArray[np.int64]) -> NDArray[np.int64]:
        """The entry that plays so many periods after the beginning, -1 if it has ended."""
        turn, within = np.divmod(since, self.ends[-1])
        entry = np.searchsorted(self.ends, within, side="right")
        return np.where((turn < self.repeats) | (self.repeats == 0), entry, -1)


class Overlay(NamedTuple):
    """A modulation."""

    samples: NDArray[np.uint8]
    """Amplitudes, (s,)."""
    hold: int
    """Periods that each of them lasts."""


UNMODULATED = Overlay(np.array([FULL], np.uint8), 1)


class Segments(NamedTuple):
    """A history as it was at some moment."""

    starts: NDArray[np.int64]
    """Period at which each segment begins, (s,), ascending, the first before all time; of several in one period the
    last counts."""
    refs: NDArray[np.int64]
    """What plays in it, (s,): a row of `slices`, or if negative -1 - the place in `sequences`."""
    slices: NDArray[np.uint8]
    """Packed pulses, (r, 48)."""
    sequences: tuple[PortSequence, ...]
    overlay_starts: tuple[int, ...]
    overlays: tuple[Overlay, ...]

    def rows(self, first: int, last: int) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """What each of the periods from `first` up to, not including, `last` plays.

        Returns
        -------
        rows : (n,) int64
            Row of `slices`.
        samples : (n,) uint8
            The modulation sample over it.
        """
        periods = np.arange(first, last, dtype=np.int64)
        segment = np.searchsorted(self.starts, periods, side="right") - 1
        refs = self.refs[segment]
        if (running := np.flatnonzero(refs < 0)).size:
            for ref in np.unique(refs[running]):
                here = running[refs[running] == ref]
                sequence = self.sequences[-1 - ref]
                entry = sequence.entries(periods[here] - self.starts[segment[here]])
                refs[here] = np.where(entry < 0, SILENT, sequence.rows[entry])
        samples = np.full(periods.size, FULL, np.uint8)
        if self.overlays:
            overlay = np.searchsorted(np.array(self.overlay_starts), periods, side="right") - 1
            for number in np.unique(overlay[overlay >= 0]):
                here, (values, hold) = overlay == number, self.overlays[number]
                step = (periods[here] - self.overlay_starts[number]) // hold
                samples[here] = values[step % values.size]
        return refs, samples

    def at(self, period: int) -> tuple[int, bytes]:
        """Since when the pulses of a period play, and these, 48 bytes packed; of a sequence those of the entry."""
        segment = int(np.searchsorted(self.starts, period, side="right")) - 1
        since, row = int(self.starts[segment]), int(self.refs[segment])
        if since == BEFORE_ALL:
            return 0, bytes(SLICE_BYTES)
        if row < 0:
            sequence = self.sequences[-1 - row]
            elapsed = period - since
            entry = int(sequence.entries(np.array([elapsed]))[0])
            if entry < 0:
                return since + int(sequence.ends[-1]) * sequence.repeats, bytes(SLICE_BYTES)
            begins = int(sequence.ends[entry - 1]) if entry else 0
            since, row = period - elapsed % int(sequence.ends[-1]) + begins, int(sequence.rows[entry])
        return since, self.slices[row].tobytes()


class History:
    """What a port plays, as it comes to be known."""

    def __init__(self) -> None:
        self._starts = Rows.of(np.array([BEFORE_ALL], np.int64))
        self._refs = Rows.of(np.array([SILENT], np.int64))
        self._slices = Rows((SLICE_BYTES,), np.uint8)
        self._slices.extend(np.zeros((1, SLICE_BYTES), np.uint8))
        self._sequences: list[PortSequence] = []
        self._overlays: list[tuple[int, Overlay]] = []

    def play(self, periods: NDArray[np.int64], slices: NDArray[np.uint8]) -> None:
        """Play pulses, (n, 48) packed, each from its period on, (n,)."""
        first = self._slices.extend(slices)
        self._starts.extend(periods)
        self._refs.extend(np.arange(first, first + len(periods)))

    def silence(self, period: int) -> None:
        """Play nothing from a period on."""
        self._starts.extend([period])
        self._refs.extend([SILENT])

    def run(
        self, period: int, slots: Sequence[bytes], entries: NDArray[np.int64], periods: NDArray[np.int64], repeats: int
    ) -> None:
        """Play a sequence from a period on.

        Parameters
        ----------
        period : int
        slots : sequence of bytes
            Packed pulses, 48 bytes each.
        entries : (e,) int
            The place in these of what each entry plays.
        periods : (e,) int
            The duration of each entry, in periods.
        repeats : int
            Times that all of it is played, 0 for without end.
        """
        first = self._slices.extend([np.frombuffer(slot, np.uint8) for slot in slots])
        self._starts.extend([period])
        self._refs.extend([-1 - len(self._sequences)])
        self._sequences.append(PortSequence(np.cumsum(periods), first + entries, repeats))

    def modulate(self, period: int, samples: bytes, hold: int) -> None:
        """Let amplitudes lie over what plays from a period on; none of them end that."""
        values = np.frombuffer(samples, np.uint8)
        self._overlays.append((period, Overlay(values, hold) if samples else UNMODULATED))

    @property
    def runs(self) -> bool:
        """Whether the last segment is a sequence."""
        return bool(self._refs.view()[-1] < 0)

    def segments(self) -> Segments:
        """All of it, as it is now."""
        return Segments(
            self._starts.view(),
            self._refs.view(),
            self._slices.view(),
            tuple(self._sequences),
            tuple(start for start, _ in self._overlays),
            tuple(overlay for _, overlay in self._overlays),
        )

    def forget(self, period: int) -> None:
        """Drop what had ended when a period began; what was read of it before stays."""
        current = sum(start <= period for start, _ in self._overlays) - 1
        self._overlays = self._overlays[max(current, 0) :]
        stale = int(np.searchsorted(self._starts.view(), period, side="right")) - 1
        if stale <= 0:
            return
        starts, refs, slices = self._starts.view()[stale:], self._refs.view()[stale:], self._slices.view()
        sequences = [self._sequences[-1 - ref] for ref in refs[refs < 0]]
        used = np.concatenate([refs[refs > SILENT], *(each.rows for each in sequences)])
        dropped = int(used.min(initial=self._slices.size)) - 1  # rows are in the order of the segments
        self._sequences = [each._replace(rows=each.rows - dropped) for each in sequences]
        renamed = np.where(refs > SILENT, refs - dropped, refs)
        renamed[refs < 0] = -1 - np.arange(len(sequences))
        kept = Rows((SLICE_BYTES,), np.uint8, MORE * (self._slices.size - dropped))
        kept.extend(slices[:1])
        kept.extend(slices[dropped + 1 :])
        self._starts, self._refs, self._slices = Rows.of(starts), Rows.of(renamed), kept
