"""Execution: what an accepted block does at once, and what its change means when it takes effect.

It turns a block into what `Dispatch` plans or stores, sorted by the wiring, and tells the state machine when something
plays or ends. It judges nothing: whoever calls it has asked `Admission`.
"""

from __future__ import annotations

from functools import partial

from ...protocol.blocks import (
    AmplitudeModulation,
    Body,
    Entries,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack_entries,
    pack_pulses,
)
from ...protocol.board import PROCESSORS
from ...protocol.chain import SLICE_BYTES, Program, loads
from ...protocol.codes import Action, Memory
from ...protocol.pulses import Pulses
from ...protocol.states import StateEvent
from ...protocol.wiring import Wiring
from ..door import Door
from .agenda import Change
from .device_state import DeviceState, SequenceRun
from .dispatch import SILENCE, STOP_MODULATION, Dispatch
from .state_machine import StateMachine
from .stores import Store

__all__ = ["Execution"]

PLACES = range(PROCESSORS)


class Execution:
    """Carries out blocks."""

    def __init__(self, device: DeviceState, dispatch: Dispatch, machine: StateMachine, wiring: Wiring) -> None:
        self._device = device
        self._dispatch = dispatch
        self._machine = machine
        self._wiring = wiring

    def carry_out(self, body: Body, door: Door) -> Change | None:
        """Do what a block that came by a door and was judged asks for; the change that it plans."""
        device, dispatch = self._device, self._dispatch
        self._machine.watchdog.feed()
        device.accepted += 1
        match body:
            case Update():
                device.last_named = body.period or device.last_named
                begin = partial(self.begin_update, door)
                return dispatch.plan(body.period, self._sorted(body.pulses), (), begin, sequences=True, is_update=True)
            case PlaySequence():
                duration = dispatch.stores.duration(body)
                start = Program(0, Memory.ENTRIES, 0, body.first, body.count, repeats=body.repeats)
                begin_run = partial(self._begin_sequence, SequenceRun(duration, body.unattended), door)
                change = dispatch.plan(body.period, None, (start,), begin_run, sequences=True)
                use = dispatch.stores.use(body, dispatch.period)
                if duration is not None:
                    use.ends(change.period + duration)
                return change
            case AmplitudeModulation():
                start = Program(0, Memory.SAMPLES, 0, body.first, body.count, hold=body.hold)
                change = dispatch.plan(body.period, None, (start,), self._begin_modulation, modulations=True)
                dispatch.stores.use(body, dispatch.period)
                return change
            case Output(action=Action.END_MODULATION):
                return dispatch.plan(body.period, None, (STOP_MODULATION,), self._end_modulation, modulations=True)
            case Output():
                disables = body.action is Action.DISABLE
                effect = partial(self._disable_as_planned if disables else self._fall_silent, door)
                stops = (STOP_MODULATION,) if dispatch.agenda.tail.modulated else ()
                change = dispatch.plan(body.period, SILENCE, stops, effect, sequences=True, modulations=True)
                if disables and dispatch.disabled_from is None:
                    dispatch.disabled_from = change.period
                return change
            case Slot() | Entries() | Samples():
                self._store(body)
        return None

    def _sorted(self, pulses: Pulses) -> bytes:
        return pack_pulses(Pulses(self._wiring.sort(pulses.phase), self._wiring.sort(pulses.width)))

    def _store(self, body: Store) -> None:
        """Keep what a store brings, and let it go to the processors between changes."""
        self._dispatch.stores.keep(body)
        match body:
            case Slot():
                packed = self._sorted(body.pulses)
                pieces = [(Memory.SLOTS, body.number, packed[place * SLICE_BYTES :][:SLICE_BYTES]) for place in PLACES]
            case Entries():
                pieces = [(Memory.ENTRIES, body.first, pack_entries(body.entries))] * PROCESSORS
            case Samples():
                pieces = [(Memory.SAMPLES, body.first, body.samples)] * PROCESSORS
        to_all = [
            load
            for place, (memory, first, data) in zip(PLACES, pieces, strict=True)
            for load in loads(place, memory, first, data)
        ]
        self._dispatch.store(to_all)

    # What takes effect

    def begin_update(self, door: Door, period: int) -> None:
        """An update that came by a door takes effect."""
        self._device.runs = None
        self._device.since_period = period
        self._machine.happen(StateEvent.PLAY, self._dispatch.time.boundary(period), door)

    def _begin_sequence(self, run: SequenceRun, door: Door, period: int) -> None:
        self._device.runs = run.begun(period)
        self._device.since_period = period
        event = StateEvent.PLAY_UNATTENDED if run.unattended else StateEvent.PLAY
        self._machine.happen(event, self._dispatch.time.boundary(period), door)
        self._dispatch.plan_to_wake()

    def end_sequence(self) -> None:
        """When a sequence has played its last repeat, fall silent, as the processors do by themselves."""
        run = self._device.runs
        if run is not None and run.ends is not None and self._dispatch.now >= self._dispatch.time.boundary(run.ends):
            self._device.runs = None
            self._device.since_period = 0
            self._machine.happen(StateEvent.END, self._dispatch.now)
            self._machine.send_status()

    def _begin_modulation(self, _: int) -> None:
        self._device.modulation_plays = True

    def _end_modulation(self, _: int) -> None:
        self._device.modulation_plays = False

    def _fall_silent(self, door: Door, period: int) -> None:
        self._device.play_nothing()
        self._machine.happen(StateEvent.END, self._dispatch.time.boundary(period), door)

    def _disable_as_planned(self, door: Door, period: int) -> None:
        self._dispatch.stores.end(period, sequences=True, modulations=True)
        self._machine.happen(StateEvent.DISABLE, self._dispatch.time.boundary(period), door, silent=True)
