"""Broken combinations: what is queued or plays meets what ends, replaces or disables it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from operator import attrgetter
from typing import Any

from ....base.errors import BlockError
from ....emulator.control.admission import Admission
from ....emulator.control.dispatch import Dispatch
from ....emulator.control.execution import Execution
from ....emulator.control.requests import Requests
from ....emulator.control.state_machine import StateMachine
from ....emulator.interfaces.usb_device import UsbDevice
from ....emulator.interfaces.usb_functions import ArrayFunction
from ....protocol.blocks import Block, Entries, Output, Samples, Slot, Update
from ....protocol.board import CYCLES_PER_PERIOD, PROCESSORS
from ....protocol.chain import SLICE_BYTES
from ....protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Action, Reason, Request, State
from ....protocol.states import StateEvent
from .patching import Patch, mutant
from .seams import one_by_one, reach_the_watchdog

SLOW_PERIODS = 4
REPEATED_PERIODS = 20
SILENCE = bytes(PROCESSORS * SLICE_BYTES)


def _on(patch: Patch, events: tuple[StateEvent, ...], method: str, instead: Callable[..., None]) -> None:
    """Replace a method of a part that the state machine knows, while it handles some events."""

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, *arguments: Any, **more: Any) -> None:
        owner, _, name = method.rpartition(".")
        part = attrgetter(owner)(self)
        if event in events:
            vars(part)[name] = instead
        try:
            original(self, event, *arguments, **more)
        finally:
            vars(part).pop(name, None)


def _nothing(*_: Any, **__: Any) -> None:
    pass


# What is queued, and what disables


@mutant("BLK-018", "STA-001", "SAF-004", wraps=(Dispatch, "plan"), also=one_by_one)
def a_change_close_behind_a_disabling_block_plays(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
    """An UPDATE for the period after a disabling OUTPUT is on the chain already, and plays on in OFF."""
    disabled_from, self.disabled_from = self.disabled_from, None
    change = original(self, *arguments, **more)
    self.disabled_from = disabled_from
    return change


@mutant("BLK-018", "STA-003", wraps=(Execution, "_disable_as_planned"))
def a_disabling_block_leaves_the_queue(original: Any, self: Any, door: Any, period: int) -> None:
    """Changes accepted after a disabling OUTPUT stay queued and never play: only the request DISABLE drops them."""
    before = self._dispatch.agenda.recent.copy()
    original(self, door, period)
    self._dispatch.agenda.recent[:] = before


@mutant("SAF-003", "SAF-004", "STA-003")
def the_watchdog_leaves_the_queue(patch: Patch) -> None:
    """When the watchdog fires the outputs fall silent, but queued changes still play: only DISABLE drops them."""
    _on(patch, (StateEvent.WATCHDOG,), "_dispatch.agenda.drop_queued", _nothing)
    one_by_one(patch)


@mutant("STA-003", "USB-003", "SAF-004")
def a_bus_reset_leaves_the_queue(patch: Patch) -> None:
    """SET_CONFIGURATION silences the outputs, but queued changes still play: only DISABLE drops them."""
    _on(patch, (StateEvent.BUS_RESET, StateEvent.SUSPEND), "_dispatch.agenda.drop_queued", _nothing)
    one_by_one(patch)


@mutant("SAF-007", "SAF-004", "STA-003")
def a_fault_leaves_the_queue(patch: Patch) -> None:
    """A silencing fault silences the outputs, but queued changes still play: only DISABLE drops them."""
    _on(patch, (StateEvent.FAULT,), "_dispatch.agenda.drop_queued", _nothing)
    one_by_one(patch)


def _haunt(patch: Patch, action: Action) -> None:
    """Let a queued OUTPUT take effect in its time, although the outputs were disabled before."""

    @patch.around(Execution, "carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        change = original(self, body, door)
        if isinstance(body, Output) and body.action is action:
            effect = change.effect
            self._dispatch.scheduler.at(
                self._dispatch.time.boundary(change.period), partial(take_effect, self, change, effect)
            )
        return change

    def take_effect(self: Any, change: Any, effect: Any) -> None:
        self._dispatch.settle()
        if change.effect is None or change not in self._dispatch.agenda._changes:  # dropped, or over
            effect(change.period)


@mutant("SAF-004", "BLK-018")
def a_queued_disable_outlives_disable(patch: Patch) -> None:
    """A disabling OUTPUT is stored beside the queue: after DISABLE and ENABLE it ends what plays then."""
    _haunt(patch, Action.DISABLE)


@mutant("SAF-004", "BLK-018")
def a_queued_silence_outlives_disable(patch: Patch) -> None:
    """A silencing OUTPUT is stored beside the queue: after DISABLE and ENABLE it ends what plays then."""
    _haunt(patch, Action.SILENCE)


@mutant("SAF-004", "BLK-018")
def a_queued_end_of_modulation_outlives_disable(patch: Patch) -> None:
    """A queued END_MODULATION is stored beside the queue: after DISABLE and ENABLE it ends another modulation."""
    _haunt(patch, Action.END_MODULATION)


@mutant("BLK-018", "STA-003", wraps=(Execution, "carry_out"))
def a_second_disabling_block_puts_off_the_first(original: Any, self: Any, body: Any, door: Any) -> Any:
    """Of two disabling OUTPUTs only the later one works: one variable holds the period."""
    if isinstance(body, Output) and body.action is Action.DISABLE:
        for change in self._dispatch.agenda:
            if getattr(getattr(change.effect, "func", None), "__name__", "") == "_disable_as_planned":
                change.effect = None
    return original(self, body, door)


@mutant("BLK-022", "SAF-003")
def stores_stay_in_use_after_the_watchdog(patch: Patch) -> None:
    """What was queued when the watchdog fired is IN_USE for ever: only DISABLE frees it."""
    _on(
        patch,
        (StateEvent.WATCHDOG, StateEvent.BUS_RESET, StateEvent.FAULT, StateEvent.SUSPEND),
        "_dispatch.stores.end",
        _nothing,
    )


# Silence, and what the chain is busy with


@mutant("SAF-004", wraps=(Dispatch, "send_silence"))
def silence_waits_for_stores(original: Any, self: Any, stops: Any) -> None:
    """After DISABLE the silence waits behind stores on the chain, up to 40 periods: there is one queue."""
    leaves = self.loading.leaves
    if self.loading:
        self.loading.leaves = self.agenda.loads_gone(self.now, len(self.loading))
    original(self, stops)
    self.loading.leaves = leaves


@mutant("SAF-004", "STA-003")
def silence_is_sent_twice(patch: Patch) -> None:
    """Some periods after DISABLE the silence is sent again, to be sure, even if the outputs are enabled by then."""

    @patch.around(Dispatch, "send_silence")
    def send(original: Any, self: Any, stops: Any) -> None:
        original(self, stops)
        self.scheduler.at(self.now + REPEATED_PERIODS * CYCLES_PER_PERIOD, lambda: again(self))

    def again(self: Any) -> None:
        self.settle()
        self._schedule(self.agenda.add(self.now, 0, SILENCE, (), None, folded=self.chain.folded, asked=False))


@mutant("SAF-007", "SAF-004", "STA-003", wraps=(StateMachine, "happen"))
def a_fault_while_unattended_silences_one_board(
    original: Any, self: Any, event: StateEvent, *arguments: Any, **more: Any
) -> None:
    """A fault during an unattended sequence silences only the board that has it: the others are not told."""
    if event is StateEvent.FAULT and self._device.state is State.UNATTENDED:
        vars(self._dispatch)["send_silence"] = _nothing
    original(self, event, *arguments, **more)
    vars(self._dispatch).pop("send_silence", None)


@mutant("SAF-004", "BLK-013", wraps=(StateMachine, "_drop_all"))
def disable_drops_the_stores_that_wait(original: Any, self: Any) -> None:
    """Stores that wait for the chain are lost when the outputs are disabled: the only queue is emptied."""
    self._dispatch.loading.drop()
    original(self)


# What plays, and what comes after it


@mutant("STA-003", "BLK-012", "BLK-015")
def a_replaced_sequence_still_ends(patch: Patch) -> None:
    """A replaced sequence still ends in its time, and ends what plays then."""

    @patch.around(Execution, "_begin_sequence")
    def begin(original: Any, self: Any, run: Any, door: Any, period: int) -> None:
        original(self, run, door, period)
        ends = self._device.runs.ends
        if ends is not None:
            self._dispatch.scheduler.at(self._dispatch.time.boundary(ends), lambda: end(self))

    def end(self: Any) -> None:
        self._dispatch.settle()
        self.end_sequence()
        if self._device.state in (State.PLAYING, State.UNATTENDED):
            self._device.runs, self._device.since_period = None, 0
            self._machine.happen(StateEvent.END, self._dispatch.now)
            self._machine.send_status()


@mutant("STA-003", "BLK-012")
def a_sequence_that_is_disabled_still_ends(patch: Patch) -> None:
    """A sequence that DISABLE ended still ends in its time, and ends what plays after the next ENABLE."""

    @patch.around(StateMachine, "_drop_all")
    def drop(original: Any, self: Any) -> None:
        run = self._device.runs
        original(self)
        if run is not None and run.ends is not None:
            self._dispatch.scheduler.at(self._dispatch.time.boundary(run.ends), lambda: end(self))

    def end(self: Any) -> None:
        self._dispatch.settle()
        if self._device.state in (State.PLAYING, State.UNATTENDED):
            self._device.runs, self._device.since_period = None, 0
            self.happen(StateEvent.END, self._dispatch.now)
            self.send_status()


@mutant("STA-003", "BLK-012", wraps=(Execution, "begin_update"))
def the_last_repeat_ends_what_begins_with_it(original: Any, self: Any, door: Any, period: int) -> None:
    """An UPDATE for the very period in which a sequence ends is ended too: the end is handled last."""
    run = self._device.runs
    original(self, door, period)
    if run is not None and run.ends == period:
        self._device.since_period = 0
        self._machine.happen(StateEvent.END, self._dispatch.now)


@mutant("BLK-005", wraps=(Execution, "carry_out"))
def an_update_waits_while_a_sequence_plays(original: Any, self: Any, body: Any, door: Any) -> Any:
    """While a sequence plays an UPDATE four periods ahead is late: the table of entries is walked first."""
    add = self._dispatch.agenda.add
    if isinstance(body, Update) and self._device.runs is not None:
        late = SLOW_PERIODS * CYCLES_PER_PERIOD
        vars(self._dispatch.agenda)["add"] = lambda ready, *rest, **more: add(ready + late, *rest, **more)
    try:
        return original(self, body, door)
    finally:
        vars(self._dispatch.agenda).pop("add", None)


# What starts the watchdog and what feeds it


@mutant("SAF-005", "SAF-003")
def a_modulation_wakes_the_watchdog(patch: Patch) -> None:
    """A modulation that begins over an unattended sequence starts the watchdog: any change does."""

    def around(original: Any) -> Any:
        def begin(self: Any, period: int) -> None:
            original(self, period)
            if self._device.state is State.UNATTENDED:
                self._machine.watchdog.watch(self._dispatch.now)

        return begin

    patch.wrap(Execution, "_begin_modulation", around)
    patch.wrap(Execution, "_end_modulation", around)


@mutant("SAF-005", "SAF-003", wraps=(Execution, "carry_out"))
def a_block_wakes_the_watchdog(original: Any, self: Any, body: Any, door: Any) -> Any:
    """An accepted block starts the watchdog while a sequence plays unattended: feeding it also arms it."""
    if self._device.state is State.UNATTENDED:
        self._machine.watchdog.watch(self._dispatch.now)
    return original(self, body, door)


@mutant("SAF-005", "REQ-009", wraps=(Requests, "request"))
def a_new_time_wakes_the_watchdog(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
    """WATCHDOG starts the watchdog even while a sequence plays unattended: setting the timer also runs it."""
    answer = original(self, setup, data, door)
    if setup.request == Request.WATCHDOG and self._device.state is State.UNATTENDED:
        self._machine.watchdog.watch(self._dispatch.now)
    return answer


@mutant("SAF-005", "STA-004", wraps=(Execution, "_begin_sequence"))
def an_unattended_sequence_that_follows_another_is_watched(
    original: Any, self: Any, run: Any, door: Any, period: int
) -> None:
    """An unattended sequence that replaces another starts the watchdog: the end of the first one starts it."""
    again = self._device.state is State.UNATTENDED and run.unattended
    original(self, run, door, period)
    if again:
        self._machine.watchdog.watch(self._dispatch.now)


@mutant("SAF-003", wraps=(Dispatch, "settle"), also=reach_the_watchdog)
def what_takes_effect_feeds_the_watchdog(original: Any, self: Any) -> None:
    """A change that takes effect is a sign of life: the code that sets the state feeds the watchdog."""
    before = len(self.agenda)
    original(self)
    if len(self.agenda) < before:
        vars(self)["watchdog"].feed()


def _feed_when_refused(patch: Patch, feeds: Callable[[Block, Reason], bool]) -> None:
    """Let some refused blocks count as signs of life."""
    reach_the_watchdog(patch)

    @patch.around(Admission, "judge")
    def judge(original: Any, self: Any, block: Block, arrived: int) -> None:
        try:
            original(self, block, arrived)
        except BlockError as error:
            if feeds(block, Reason(error.reason)):
                vars(self._dispatch)["watchdog"].feed()
            raise


@mutant("SAF-003", "NUM-004")
def refused_blocks_that_begin_the_numbering_feed_the_watchdog(patch: Patch) -> None:
    """A block with RESTART that is refused for its contents is a sign of life: it shows that a host has begun."""
    contents = (Reason.DRIVE, Reason.EMPTY, Reason.IN_USE)
    _feed_when_refused(patch, lambda block, reason: block.restart and reason in contents)


@mutant("SAF-003", "SAF-005")
def refused_unattended_sequences_feed_the_watchdog(patch: Patch) -> None:
    """A SEQUENCE with UNATTENDED is a sign of life even if refused: its flag is handled before the judgement."""
    _feed_when_refused(patch, lambda block, _: getattr(block.body, "unattended", False))


@mutant("SAF-003", "SAF-006")
def refused_stores_feed_the_watchdog(patch: Patch) -> None:
    """A store with sound bytes is a sign of life even if it is refused with DRIVE or IN_USE."""
    _feed_when_refused(patch, lambda block, _: isinstance(block.body, Slot | Entries | Samples))


@mutant("SAF-003", "REQ-001", wraps=(Requests, "request"))
def stalled_requests_feed_the_watchdog(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
    """STATUS and ENABLE with a wrong value or index are signs of life: they feed the watchdog before the check."""
    if setup.request in (Request.STATUS, Request.ENABLE):
        self._machine.watchdog.feed()
    return original(self, setup, data, door)


@mutant("SAF-003", "USB-014", wraps=(UsbDevice, "control"))
def every_control_transfer_feeds_the_watchdog(original: Any, self: Any, setup: Any, data: bytes = b"") -> bytes:
    """On USB each SETUP packet is a sign of life, even for standard and class requests: its interrupt feeds it."""
    function = self._functions.get(0)
    if isinstance(function, ArrayFunction) and setup.request_type not in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
        controller: Any = function._controller
        controller._machine.watchdog.feed()
    return bytes(original(self, setup, data))


# What is on the chain when the outputs are disabled


@mutant("SAF-004", "STA-001")
def silence_is_not_sent_while_nothing_plays(patch: Patch) -> None:
    """DISABLE in READY sends no silence, because nothing plays: an update that is on the chain begins and plays on."""

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, *arguments: Any, **more: Any) -> None:
        self._dispatch.mutant_was_ready = self._device.state is State.READY
        original(self, *arguments, **more)
        self._dispatch.mutant_was_ready = False

    @patch.around(Dispatch, "send_silence")
    def send_nothing(original: Any, self: Any, stops: Any) -> None:
        if getattr(self, "mutant_was_ready", False) and not stops:
            self.stores.end(self.period + 1, sequences=True, modulations=True)
        else:
            original(self, stops)


@mutant("SAF-004")
def modulation_on_the_chain_outlives_disable(patch: Patch) -> None:
    """DISABLE stops only what modulates: a modulation that is on the chain and has not begun survives it."""

    @patch.around(StateMachine, "_drop_all")
    def drop_all(original: Any, self: Any) -> None:
        self._dispatch.mutant_modulates = self._device.modulation_plays
        original(self)

    @patch.around(Dispatch, "send_silence")
    def stop_what_modulates(original: Any, self: Any, stops: Any) -> None:
        modulates, self.mutant_modulates = getattr(self, "mutant_modulates", None), None
        original(self, () if modulates is False else stops)


# Buses that come and go


@mutant("STA-006", wraps=(ArrayFunction, "unplug"), url="emulator:?door=serial")
def an_unplugged_device_still_belongs_to_its_bus(original: Any, self: Any) -> None:
    """After its cable was pulled an unconfigured device is suspended with the bus all the same."""
    adopted = self._adopted
    original(self)
    self._adopted = adopted


# What takes effect in the period in which a sequence ends


@mutant("STA-002", wraps=(Execution, "_begin_modulation"))
def a_modulation_takes_the_place_of_the_end(original: Any, self: Any, period: int) -> None:
    """A MODULATION in the period in which a sequence ends hides the END: the state stays PLAYING."""
    original(self, period)
    if self._device.runs is not None and self._device.runs.ends == period:
        self._device.runs = None
