"""Broken modulations: which width a sample leaves, which sample a period has, and what ends it (PUL-006, BLK-017)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..emulator.control import controller
from ..emulator.ports import capture
from ..emulator.ports.reel import FULL, UNMODULATED, Reel, Segments
from ..protocol.blocks import Output
from ..protocol.board import MAX_WIDTH_TICKS, TICKS_PER_PERIOD
from ..protocol.codes import Action
from .patching import Patch, mutant
from .seams import misread_bodies, rasterise

Widths = NDArray[np.float64]


def _widths(patch: Patch, formula: Any) -> None:
    """Give pulses other widths under a modulation; one that has none is left as it is."""
    sample, width = np.ogrid[: FULL + 1, : MAX_WIDTH_TICKS + 1]
    table = np.asarray(formula(sample, width)).astype(np.uint8)
    table[FULL] = np.arange(MAX_WIDTH_TICKS + 1)
    patch.replace(capture, "_widths", lambda: table)


def _exact(sample: Any, width: Any) -> Any:
    """The width in ticks that has s/255 of the amplitude (clause PUL-006), not rounded."""
    sine = np.minimum(sample / FULL * np.sin(np.pi * width / TICKS_PER_PERIOD), 1.0)
    return TICKS_PER_PERIOD / np.pi * np.arcsin(sine)


# Which width


@mutant("PUL-006")
def widths_are_truncated(patch: Patch) -> None:
    """A modulated width is cut off to whole ticks, not rounded to the nearest."""
    _widths(patch, lambda sample, width: np.floor(_exact(sample, width) + 1e-9))


@mutant("PUL-006")
def widths_are_linear(patch: Patch) -> None:
    """A modulated width is s/255 of the width, as if the amplitude were proportional to it."""
    _widths(patch, lambda sample, width: np.floor(sample * width / FULL + 0.5))


@mutant("PUL-006")
def widths_follow_the_widest(patch: Patch) -> None:
    """A modulated width is that of the widest pulse in proportion: one table over the samples serves all widths."""
    _widths(patch, lambda sample, width: np.floor(_exact(sample, MAX_WIDTH_TICKS) * width / MAX_WIDTH_TICKS + 0.5))


@mutant("PUL-006")
def sample_0_is_not_silent(patch: Patch) -> None:
    """A pulse keeps one tick at least under every sample: a width of 0 was to be avoided."""
    _widths(patch, lambda sample, width: np.maximum(np.floor(_exact(sample, width) + 0.5), width > 0))


@mutant("PUL-006")
def one_modulated_width_is_off(patch: Patch) -> None:
    """A pulse of 17 ticks under sample 200 gets a tick too few: single precision is rounded on the way."""
    _widths(patch, lambda sample, width: np.floor(_exact(sample, width) + 0.5) - ((sample == 200) & (width == 17)))


@mutant("PUL-006", "BLK-017")
def sample_255_is_not_full(patch: Patch) -> None:
    """Sample 255 narrows a pulse as 254 does: it is divided by 256."""
    _modulate_with(patch, lambda samples, hold: (samples.replace(b"\xff", b"\xfe"), hold))


@mutant("PUL-006", by=rasterise)
def modulation_keeps_the_leading_edge(phase: Any, width: Any, unmodulated: Any, tick: Any) -> Any:
    """A modulated pulse ends sooner and begins where it did: its phase moves with its width."""
    return (tick - ((phase - unmodulated) >> 1)) % TICKS_PER_PERIOD < width


# Which sample


def _modulate_with(patch: Patch, change: Any) -> None:
    """Let modulations have other samples and another hold."""

    @patch.around(Reel, "modulate")
    def modulate(original: Any, self: Any, period: int, samples: bytes, hold: int) -> None:
        original(self, period, *(change(samples, hold) if samples else (samples, hold)))


@mutant("BLK-017")
def samples_hold_a_period_longer(patch: Patch) -> None:
    """Each sample holds for one period more than it should: the count goes down to 0, and 0 counts too."""
    _modulate_with(patch, lambda samples, hold: (samples, hold + 1))


@mutant("BLK-017")
def hold_is_a_byte(patch: Patch) -> None:
    """Samples that hold for more than 255 periods hold for that modulo 256: the upper byte gets lost."""
    _modulate_with(patch, lambda samples, hold: (samples, hold % 256 or hold))


@mutant("BLK-017")
def loop_repeats_its_last_sample(patch: Patch) -> None:
    """The last sample holds twice as long before the loop begins again: the end is noticed a step late."""
    _modulate_with(patch, lambda samples, hold: (samples + samples[-1:], hold))


@mutant("BLK-017")
def loop_leaves_out_its_last_sample(patch: Patch) -> None:
    """A loop of several samples begins again before the last of them."""
    _modulate_with(patch, lambda samples, hold: (samples[:-1] or samples, hold))


def _at_each_update(patch: Patch, overlay: Any) -> None:
    """Let another modulation begin wherever an update does, if there is one."""

    @patch.around(Reel, "play")
    def play(original: Any, self: Any, periods: Any, slices: Any) -> None:
        original(self, periods, slices)
        if self._overlays:
            self._overlays += [(period, overlay(self._overlays[-1][1])) for period in periods.tolist()]


@mutant("BLK-017", "BLK-012")
def modulation_begins_again_at_each_update(patch: Patch) -> None:
    """An UPDATE sets the modulation back to its first sample: both share one counter of periods."""
    _at_each_update(patch, lambda overlay: overlay)


@mutant("BLK-012", "BLK-017")
def update_ends_the_modulation(patch: Patch) -> None:
    """An UPDATE plays unmodulated, though STATUS still names the modulation: its table is made without a sample."""
    _at_each_update(patch, lambda _: UNMODULATED)


@mutant("BLK-017", "BLK-012", wraps=(Segments, "rows"))
def sequences_are_not_modulated(original: Any, self: Segments, first: int, last: int) -> Any:
    """A modulation lies over updates alone: the tables of a sequence were made beforehand."""
    refs, samples = original(self, first, last)
    segment = np.searchsorted(self.starts, np.arange(first, last), side="right") - 1
    samples[self.refs[segment] < 0] = FULL
    return refs, samples


@mutant("BLK-017", "TIM-003", wraps=(capture.Capture, "_rows"))
def half_of_the_processors_are_a_sample_ahead(original: Any, self: Any, first: int, last: int) -> Any:
    """Each sample begins a period early on every second processor: the second of a board makes its tables ahead."""
    rows, samples = original(self, first, last)
    ahead = original(self, first + 1, last + 1)[1]
    samples[1::2] = ahead[1::2]
    return rows, samples


# What ends it


def _read_outputs_as(patch: Patch, action: Action, other: Action) -> None:
    def misread(body: Any) -> Any:
        return Output(other, body.period) if isinstance(body, Output) and body.action is action else body

    misread_bodies(patch, misread)


@mutant("BLK-018")
def end_of_the_modulation_silences(patch: Patch) -> None:
    """END_MODULATION silences what plays, too: it goes the way of SILENCE."""
    _read_outputs_as(patch, Action.END_MODULATION, Action.SILENCE)


@mutant("BLK-018", wraps=(controller.Controller, "_carry_out"))
def silence_leaves_the_modulation(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A SILENCE ends what plays and no modulation, which lies over the next update again."""
    if not (isinstance(body, Output) and body.action is Action.SILENCE):
        return original(self, body, door)
    tail, self._agenda.tail = self._agenda.tail, self._agenda.tail._replace(modulated=False)
    change = original(self, body, door)
    self._agenda.tail = change.tail = change.tail._replace(modulated=tail.modulated)
    return change


@mutant("SAF-004", "BLK-017")
def modulation_survives_disable(patch: Patch) -> None:
    """DISABLE leaves the modulation on the processors, where it lies over what plays next: only pulses are silenced."""
    patch.wrap(controller.Controller, "_send_silence", lambda original: lambda self, _: original(self, ()))


@mutant("REQ-003")
def modulation_is_not_in_the_status(patch: Patch) -> None:
    """STATUS never has the flag MODULATION."""
    patch.wrap(controller.Controller, "_begin_modulation", lambda _: lambda _self, _period: None)
