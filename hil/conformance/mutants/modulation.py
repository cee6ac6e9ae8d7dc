"""Broken modulations: the width that a sample gives, the sample of a period, and the end (PUL-006, BLK-017)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....emulator.control.dispatch import Dispatch
from ....emulator.control.execution import Execution
from ....emulator.ports import capture
from ....emulator.ports.history import FULL, UNMODULATED, History, Segments
from ....protocol.blocks import Output
from ....protocol.board import MAX_WIDTH_TICKS, TICKS_PER_PERIOD
from ....protocol.codes import Action
from .patching import Patch, mutant
from .seams import misread_bodies, rasterise

Widths = NDArray[np.float64]


def _widths(patch: Patch, formula: Any) -> None:
    """Change the widths of modulated pulses; pulses without a modulation stay as they are."""
    sample, width = np.ogrid[: FULL + 1, : MAX_WIDTH_TICKS + 1]
    table = np.asarray(formula(sample, width)).astype(np.uint8)
    table[FULL] = np.arange(MAX_WIDTH_TICKS + 1)
    patch.replace(capture, "_widths", lambda: table)


def _exact(sample: Any, width: Any) -> Any:
    """The unrounded width in ticks of s/255 of the amplitude (clause PUL-006)."""
    sine = np.minimum(sample / FULL * np.sin(np.pi * width / TICKS_PER_PERIOD), 1.0)
    return TICKS_PER_PERIOD / np.pi * np.arcsin(sine)


# Which width


@mutant("PUL-006")
def widths_are_truncated(patch: Patch) -> None:
    """A modulated width is truncated to whole ticks instead of rounded."""
    _widths(patch, lambda sample, width: np.floor(_exact(sample, width) + 1e-9))


@mutant("PUL-006")
def widths_are_linear(patch: Patch) -> None:
    """A modulated width is s/255 of the width, as if the amplitude were proportional to the width."""
    _widths(patch, lambda sample, width: np.floor(sample * width / FULL + 0.5))


@mutant("PUL-006")
def widths_follow_the_widest(patch: Patch) -> None:
    """A modulated width is computed from the widest pulse in proportion: one table of samples serves all widths."""
    _widths(patch, lambda sample, width: np.floor(_exact(sample, MAX_WIDTH_TICKS) * width / MAX_WIDTH_TICKS + 0.5))


@mutant("PUL-006")
def sample_0_is_not_silent(patch: Patch) -> None:
    """A pulse keeps at least one tick under every sample: the author wanted no width of 0."""
    _widths(patch, lambda sample, width: np.maximum(np.floor(_exact(sample, width) + 0.5), width > 0))


@mutant("PUL-006")
def one_modulated_width_is_off(patch: Patch) -> None:
    """A pulse of 17 ticks under sample 200 gets one tick too few: single precision rounds on the way."""
    _widths(patch, lambda sample, width: np.floor(_exact(sample, width) + 0.5) - ((sample == 200) & (width == 17)))


@mutant("PUL-006", "BLK-017")
def sample_255_is_not_full(patch: Patch) -> None:
    """Sample 255 narrows a pulse as 254 does: the division is by 256."""
    _modulate_with(patch, lambda samples, hold: (samples.replace(b"\xff", b"\xfe"), hold))


@mutant("PUL-006", by=rasterise)
def modulation_keeps_the_leading_edge(phase: Any, width: Any, unmodulated: Any, tick: Any) -> Any:
    """A modulated pulse keeps its beginning and ends sooner: its phase moves with its width."""
    return (tick - ((phase - unmodulated) >> 1)) % TICKS_PER_PERIOD < width


# Which sample


def _modulate_with(patch: Patch, change: Any) -> None:
    """Give modulations other samples and another hold."""

    @patch.around(History, "modulate")
    def modulate(original: Any, self: Any, period: int, samples: bytes, hold: int) -> None:
        original(self, period, *(change(samples, hold) if samples else (samples, hold)))


@mutant("BLK-017")
def samples_hold_a_period_longer(patch: Patch) -> None:
    """Each sample holds for one period too many: the counter goes down to 0, and 0 counts too."""
    _modulate_with(patch, lambda samples, hold: (samples, hold + 1))


@mutant("BLK-017")
def hold_is_a_byte(patch: Patch) -> None:
    """Holds of more than 255 periods are taken modulo 256: the upper byte gets lost."""
    _modulate_with(patch, lambda samples, hold: (samples, hold % 256 or hold))


@mutant("BLK-017")
def loop_repeats_its_last_sample(patch: Patch) -> None:
    """The last sample holds twice as long before the loop begins again: the end is noticed a step late."""
    _modulate_with(patch, lambda samples, hold: (samples + samples[-1:], hold))


@mutant("BLK-017")
def loop_leaves_out_its_last_sample(patch: Patch) -> None:
    """A loop of several samples skips the last one."""
    _modulate_with(patch, lambda samples, hold: (samples[:-1] or samples, hold))


def _at_each_update(patch: Patch, overlay: Any) -> None:
    """Begin a running modulation again whenever an update begins."""

    @patch.around(History, "play")
    def play(original: Any, self: Any, periods: Any, slices: Any) -> None:
        original(self, periods, slices)
        if self._overlays:
            self._overlays += [(period, overlay(self._overlays[-1][1])) for period in periods.tolist()]


@mutant("BLK-017", "BLK-012")
def modulation_begins_again_at_each_update(patch: Patch) -> None:
    """An UPDATE restarts the modulation at its first sample: both share one period counter."""
    _at_each_update(patch, lambda overlay: overlay)


@mutant("BLK-012", "BLK-017")
def update_ends_the_modulation(patch: Patch) -> None:
    """An UPDATE plays unmodulated, although STATUS still names the modulation: its table is built without a sample."""
    _at_each_update(patch, lambda _: UNMODULATED)


@mutant("BLK-017", "BLK-012", wraps=(Segments, "rows"))
def sequences_are_not_modulated(original: Any, self: Segments, first: int, last: int) -> Any:
    """A modulation affects only updates: the tables of a sequence were built beforehand."""
    refs, samples = original(self, first, last)
    segment = np.searchsorted(self.starts, np.arange(first, last), side="right") - 1
    samples[self.refs[segment] < 0] = FULL
    return refs, samples


@mutant("BLK-017", "TIM-003", wraps=(capture.Capture, "_rows"))
def half_of_the_processors_are_a_sample_ahead(original: Any, self: Any, first: int, last: int) -> Any:
    """Each sample begins a period early on every second processor: it builds its tables ahead."""
    rows, samples = original(self, first, last)
    ahead = original(self, first + 1, last + 1)[1]
    samples[1::2] = ahead[1::2]
    return rows, samples


# Endings


def _read_outputs_as(patch: Patch, action: Action, other: Action) -> None:
    def misread(body: Any) -> Any:
        return Output(other, body.period) if isinstance(body, Output) and body.action is action else body

    misread_bodies(patch, misread)


@mutant("BLK-018")
def end_of_the_modulation_silences(patch: Patch) -> None:
    """END_MODULATION also silences what plays: it takes the path of SILENCE."""
    _read_outputs_as(patch, Action.END_MODULATION, Action.SILENCE)


@mutant("BLK-018", wraps=(Execution, "carry_out"))
def silence_leaves_the_modulation(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A SILENCE ends what plays but not the modulation, which then affects the next update."""
    if not (isinstance(body, Output) and body.action is Action.SILENCE):
        return original(self, body, door)
    tail, self._dispatch.agenda.tail = self._dispatch.agenda.tail, self._dispatch.agenda.tail._replace(modulated=False)
    change = original(self, body, door)
    self._dispatch.agenda.tail = change.tail = change.tail._replace(modulated=tail.modulated)
    return change


@mutant("SAF-004", "BLK-017")
def modulation_survives_disable(patch: Patch) -> None:
    """DISABLE leaves the modulation on the processors, which affects what plays next: only pulses are silenced."""
    patch.wrap(Dispatch, "send_silence", lambda original: lambda self, _: original(self, ()))


@mutant("REQ-003")
def modulation_is_not_in_the_status(patch: Patch) -> None:
    """STATUS never has the flag MODULATION."""
    patch.wrap(Execution, "_begin_modulation", lambda _: lambda _self, _period: None)
