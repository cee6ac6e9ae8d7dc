"""Two things at once go wrong: what is queued or plays, and what ends, replaces or disables it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from ..emulator.control import controller
from ..emulator.interfaces.usb_device import UsbDevice
from ..emulator.interfaces.usb_functions import ArrayFunction
from ..errors import BlockError
from ..protocol.blocks import Block, Entries, Output, Samples, Slot, Update
from ..protocol.board import CYCLES_PER_PERIOD, PROCESSORS
from ..protocol.chain import SLICE_BYTES
from ..protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Action, Reason, Request, State
from ..protocol.states import Event
from .patching import Patch, mutant
from .seams import one_by_one

SLOW_PERIODS = 4
REPEATED_PERIODS = 20
SILENCE = bytes(PROCESSORS * SLICE_BYTES)


def _on(patch: Patch, events: tuple[Event, ...], method: str, instead: Callable[..., None]) -> None:
    """While the controller follows some events, let a method of it, or of a part of it, be another."""

    @patch.around(controller.Controller, "_happen")
    def happen(original: Any, self: Any, event: Event, *arguments: Any, **more: Any) -> None:
        owner, _, name = method.rpartition(".")
        part = getattr(self, owner) if owner else self
        if event in events:
            vars(part)[name] = instead
        try:
            original(self, event, *arguments, **more)
        finally:
            vars(part).pop(name, None)


def _nothing(*_: Any, **__: Any) -> None:
    pass


# What is queued, and what disables


@mutant("BLK-018", "STA-001", "SAF-004", wraps=(controller.Controller, "_plan"), also=one_by_one)
def a_change_close_behind_a_disabling_block_plays(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
    """An UPDATE for the period after an OUTPUT that disables is on the chain by then, and plays on in OFF."""
    disabled_from, self._disabled_from = self._disabled_from, None
    change = original(self, *arguments, **more)
    self._disabled_from = disabled_from
    return change


@mutant("BLK-018", "STA-003", wraps=(controller.Controller, "_disable_as_planned"))
def a_disabling_block_leaves_the_queue(original: Any, self: Any, door: Any, period: int) -> None:
    """What was accepted after an OUTPUT that disables stays in the queue and never plays: only the request drops it."""
    before = self._agenda.recent.copy()
    original(self, door, period)
    self._agenda.recent[:] = before


@mutant("SAF-003", "SAF-004", "STA-003")
def the_watchdog_leaves_the_queue(patch: Patch) -> None:
    """When the watchdog fires the outputs fall silent, and what is queued plays in its time: only DISABLE drops it."""
    _on(patch, (Event.WATCHDOG,), "_agenda.drop_queued", _nothing)
    one_by_one(patch)


@mutant("STA-003", "USB-003", "SAF-004")
def a_bus_reset_leaves_the_queue(patch: Patch) -> None:
    """SET_CONFIGURATION silences the outputs, and what is queued plays in its time: only DISABLE drops it."""
    _on(patch, (Event.BUS_RESET, Event.SUSPEND), "_agenda.drop_queued", _nothing)
    one_by_one(patch)


@mutant("SAF-007", "SAF-004", "STA-003")
def a_fault_leaves_the_queue(patch: Patch) -> None:
    """A silencing fault silences the outputs, and what is queued plays in its time: only DISABLE drops it."""
    _on(patch, (Event.FAULT,), "_agenda.drop_queued", _nothing)
    one_by_one(patch)


def _haunt(patch: Patch, action: Action) -> None:
    """Let an OUTPUT that is queued take effect in its time, though the outputs were disabled before."""

    @patch.around(controller.Controller, "_carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        change = original(self, body, door)
        if isinstance(body, Output) and body.action is action:
            effect = change.effect
            self._scheduler.at(self.time.boundary(change.period), partial(take_effect, self, change, effect))
        return change

    def take_effect(self: Any, change: Any, effect: Any) -> None:
        self.settle()
        if change.effect is None or change not in self._agenda._changes:  # dropped, or over
            effect(change.period)


@mutant("SAF-004", "BLK-018")
def a_queued_disable_outlives_disable(patch: Patch) -> None:
    """An OUTPUT that disables is remembered beside the queue: after DISABLE and ENABLE it ends what plays then."""
    _haunt(patch, Action.DISABLE)


@mutant("SAF-004", "BLK-018")
def a_queued_silence_outlives_disable(patch: Patch) -> None:
    """An OUTPUT that silences is remembered beside the queue: after DISABLE and ENABLE it ends what plays then."""
    _haunt(patch, Action.SILENCE)


@mutant("SAF-004", "BLK-018")
def a_queued_end_of_modulation_outlives_disable(patch: Patch) -> None:
    """A queued END_MODULATION is remembered beside the queue: after DISABLE and ENABLE it ends another modulation."""
    _haunt(patch, Action.END_MODULATION)


@mutant("BLK-018", "STA-003", wraps=(controller.Controller, "_carry_out"))
def a_second_disabling_block_puts_off_the_first(original: Any, self: Any, body: Any, door: Any) -> Any:
    """Of two OUTPUTs that disable only the later one does: there is one variable for the period."""
    if isinstance(body, Output) and body.action is Action.DISABLE:
        for change in self._agenda:
            if getattr(getattr(change.effect, "func", None), "__name__", "") == "_disable_as_planned":
                change.effect = None
    return original(self, body, door)


@mutant("BLK-022", "SAF-003")
def stores_stay_in_use_after_the_watchdog(patch: Patch) -> None:
    """What was to play when the watchdog fired is IN_USE for ever: only DISABLE frees it."""
    _on(patch, (Event.WATCHDOG, Event.BUS_RESET, Event.FAULT, Event.SUSPEND), "_stores.end", _nothing)


# Silence, and what the chain is busy with


@mutant("SAF-004", wraps=(controller.Controller, "_send_silence"))
def silence_waits_for_stores(original: Any, self: Any, stops: Any) -> None:
    """On DISABLE silence goes onto the chain after the stores that wait, up to 40 periods later: there is one queue."""
    leaves = self._loading.leaves
    if self._loading:
        self._loading.leaves = self._agenda.loads_gone(self._now, len(self._loading))
    original(self, stops)
    self._loading.leaves = leaves


@mutant("SAF-004", "STA-003")
def silence_is_sent_twice(patch: Patch) -> None:
    """Some periods after DISABLE silence is sent once more, to be sure, though the outputs may be enabled again."""

    @patch.around(controller.Controller, "_send_silence")
    def send(original: Any, self: Any, stops: Any) -> None:
        original(self, stops)
        self._scheduler.at(self._now + REPEATED_PERIODS * CYCLES_PER_PERIOD, lambda: again(self))

    def again(self: Any) -> None:
        self.settle()
        self._dispatch(self._agenda.add(self._now, 0, SILENCE, (), None, folded=self._chain.folded, asked=False))


@mutant("SAF-007", "SAF-004", "STA-003", wraps=(controller.Controller, "_happen"))
def a_fault_while_unattended_silences_one_board(
    original: Any, self: Any, event: Event, *arguments: Any, **more: Any
) -> None:
    """While a sequence plays unattended a fault silences the board that has it and no other: nobody is told."""
    if event is Event.FAULT and self._state is State.UNATTENDED:
        vars(self)["_send_silence"] = _nothing
    original(self, event, *arguments, **more)
    vars(self).pop("_send_silence", None)


@mutant("SAF-004", "BLK-013", wraps=(controller.Controller, "_drop_all"))
def disable_drops_the_stores_that_wait(original: Any, self: Any) -> None:
    """Stores that wait for the chain are lost when the outputs are disabled: there is one queue, and it is emptied."""
    self._loading.drop()
    original(self)


# What plays, and what comes after it


@mutant("STA-003", "BLK-012", "BLK-015")
def a_replaced_sequence_still_ends(patch: Patch) -> None:
    """A sequence that something else replaced ends all the same in its time, and what plays then with it."""

    @patch.around(controller.Controller, "_begin_sequence")
    def begin(original: Any, self: Any, run: Any, door: Any, period: int) -> None:
        original(self, run, door, period)
        ends = self._runs.ends
        if ends is not None:
            self._scheduler.at(self.time.boundary(ends), lambda: end(self))

    def end(self: Any) -> None:
        self.settle()
        self._end_sequence()
        if self._state in (State.PLAYING, State.UNATTENDED):
            self._runs, self._since_period = None, 0
            self._happen(Event.END, self._now)
            self._speak()


@mutant("STA-003", "BLK-012")
def a_sequence_that_is_disabled_still_ends(patch: Patch) -> None:
    """A sequence that DISABLE ended still ends in its time, and with it what plays after the next ENABLE."""

    @patch.around(controller.Controller, "_drop_all")
    def drop(original: Any, self: Any) -> None:
        run = self._runs
        original(self)
        if run is not None and run.ends is not None:
            self._scheduler.at(self.time.boundary(run.ends), lambda: end(self))

    def end(self: Any) -> None:
        self.settle()
        if self._state in (State.PLAYING, State.UNATTENDED):
            self._runs, self._since_period = None, 0
            self._happen(Event.END, self._now)
            self._speak()


@mutant("STA-003", "BLK-012", wraps=(controller.Controller, "_begin_update"))
def the_last_repeat_ends_what_begins_with_it(original: Any, self: Any, door: Any, period: int) -> None:
    """An UPDATE for the very period in which a sequence ends is ended with it: the end is looked at last."""
    run = self._runs
    original(self, door, period)
    if run is not None and run.ends == period:
        self._since_period = 0
        self._happen(Event.END, self._now)


@mutant("BLK-005", wraps=(controller.Controller, "_carry_out"))
def an_update_waits_while_a_sequence_plays(original: Any, self: Any, body: Any, door: Any) -> Any:
    """While a sequence plays an UPDATE for the fifth period is late: the table of entries is walked first."""
    add = self._agenda.add
    if isinstance(body, Update) and self._runs is not None:
        late = SLOW_PERIODS * CYCLES_PER_PERIOD
        vars(self._agenda)["add"] = lambda ready, *rest, **more: add(ready + late, *rest, **more)
    try:
        return original(self, body, door)
    finally:
        vars(self._agenda).pop("add", None)


# What starts the watchdog and what feeds it


@mutant("SAF-005", "SAF-003")
def a_modulation_wakes_the_watchdog(patch: Patch) -> None:
    """A modulation that begins over an unattended sequence starts the watchdog: a change has taken effect."""

    def around(original: Any) -> Any:
        def begin(self: Any, period: int) -> None:
            original(self, period)
            if self._state is State.UNATTENDED:
                self._watchdog.watch(self._now)

        return begin

    patch.wrap(controller.Controller, "_begin_modulation", around)
    patch.wrap(controller.Controller, "_end_modulation", around)


@mutant("SAF-005", "SAF-003", wraps=(controller.Controller, "_carry_out"))
def a_block_wakes_the_watchdog(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A block that is accepted while a sequence plays unattended starts the watchdog: to feed it is to arm it."""
    if self._state is State.UNATTENDED:
        self._watchdog.watch(self._now)
    return original(self, body, door)


@mutant("SAF-005", "REQ-009", wraps=(controller.Controller, "request"))
def a_new_time_wakes_the_watchdog(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
    """WATCHDOG starts the watchdog also while a sequence plays unattended: to set the timer is to run it."""
    answer = original(self, setup, data, door)
    if setup.request == Request.WATCHDOG and self._state is State.UNATTENDED:
        self._watchdog.watch(self._now)
    return answer


@mutant("SAF-005", "STA-004", wraps=(controller.Controller, "_begin_sequence"))
def an_unattended_sequence_that_follows_another_is_watched(
    original: Any, self: Any, run: Any, door: Any, period: int
) -> None:
    """An unattended sequence that replaces another starts the watchdog: what ends wakes it, and nothing rests it."""
    again = self._state is State.UNATTENDED and run.unattended
    original(self, run, door, period)
    if again:
        self._watchdog.watch(self._now)


@mutant("SAF-003", wraps=(controller.Controller, "settle"))
def what_takes_effect_feeds_the_watchdog(original: Any, self: Any) -> None:
    """A change that takes effect is a sign of life: the watchdog is fed where the state is set."""
    before = len(self._agenda)
    original(self)
    if len(self._agenda) < before:
        self._watchdog.feed()


def _feed_where_refused(patch: Patch, feeds: Callable[[Block, Reason], bool]) -> None:
    """Let some refused blocks be signs of life."""

    @patch.around(controller.Controller, "_judge")
    def judge(original: Any, self: Any, block: Block, arrived: int) -> None:
        try:
            original(self, block, arrived)
        except BlockError as error:
            if feeds(block, Reason(error.reason)):
                self._watchdog.feed()
            raise


@mutant("SAF-003", "NUM-004")
def refused_blocks_that_begin_the_numbering_feed_the_watchdog(patch: Patch) -> None:
    """A block with RESTART that is refused for its contents is a sign of life: a host has just begun."""
    contents = (Reason.DRIVE, Reason.EMPTY, Reason.IN_USE)
    _feed_where_refused(patch, lambda block, reason: block.restart and reason in contents)


@mutant("SAF-003", "SAF-005")
def refused_unattended_sequences_feed_the_watchdog(patch: Patch) -> None:
    """A SEQUENCE with UNATTENDED is a sign of life, also where it is refused: the watchdog is seen to by its flag."""
    _feed_where_refused(patch, lambda block, _: getattr(block.body, "unattended", False))


@mutant("SAF-003", "SAF-006")
def refused_stores_feed_the_watchdog(patch: Patch) -> None:
    """A store is a sign of life as soon as its bytes are sound, also where it is refused with DRIVE or IN_USE."""
    _feed_where_refused(patch, lambda block, _: isinstance(block.body, Slot | Entries | Samples))


@mutant("SAF-003", "REQ-001", wraps=(controller.Controller, "request"))
def stalled_requests_feed_the_watchdog(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
    """STATUS and ENABLE with a value or an index that they do not take are signs of life: they feed it first."""
    if setup.request in (Request.STATUS, Request.ENABLE):
        self._watchdog.feed()
    return original(self, setup, data, door)


@mutant("SAF-003", "USB-014", wraps=(UsbDevice, "control"))
def every_control_transfer_feeds_the_watchdog(original: Any, self: Any, setup: Any, data: bytes = b"") -> bytes:
    """On USB each SETUP packet is a sign of life, of standard and class requests too: its interrupt feeds it."""
    function = self._functions.get(0)
    if isinstance(function, ArrayFunction) and setup.request_type not in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
        behind: Any = function._controller
        behind._watchdog.feed()
    return bytes(original(self, setup, data))


# What is on the chain when the outputs are disabled


@mutant("SAF-004", "STA-001")
def silence_is_not_sent_while_nothing_plays(patch: Patch) -> None:
    """DISABLE in READY sends no silence, for nothing plays: an update that is on the chain begins and plays on."""

    @patch.around(controller.Controller, "_happen")
    def happen(original: Any, self: Any, *arguments: Any, **more: Any) -> None:
        self.mutant_was_ready = self._state is State.READY
        original(self, *arguments, **more)
        self.mutant_was_ready = False

    @patch.around(controller.Controller, "_send_silence")
    def send_nothing(original: Any, self: Any, stops: Any) -> None:
        if getattr(self, "mutant_was_ready", False) and not stops:
            self._stores.end(self.time.period(self._now) + 1, sequences=True, modulations=True)
        else:
            original(self, stops)


@mutant("SAF-004")
def modulation_on_the_chain_outlives_disable(patch: Patch) -> None:
    """DISABLE stops what modulates: a modulation that is on the chain and has not begun is in the next session."""

    @patch.around(controller.Controller, "_drop_all")
    def drop_all(original: Any, self: Any) -> None:
        self.mutant_modulates = self._modulation_plays
        original(self)

    @patch.around(controller.Controller, "_send_silence")
    def stop_what_modulates(original: Any, self: Any, stops: Any) -> None:
        modulates, self.mutant_modulates = getattr(self, "mutant_modulates", None), None
        original(self, () if modulates is False else stops)


# Buses that come and go


@mutant("STA-006", wraps=(ArrayFunction, "unplug"), url="emulator:?door=serial")
def an_unplugged_device_still_belongs_to_its_bus(original: Any, self: Any) -> None:
    """After its cable was pulled a device that no bus has configured again is suspended with the bus all the same."""
    adopted = self._adopted
    original(self)
    self._adopted = adopted


# What takes effect in the period in which a sequence ends


@mutant("STA-002", wraps=(controller.Controller, "_begin_modulation"))
def a_modulation_takes_the_place_of_the_end(original: Any, self: Any, period: int) -> None:
    """A MODULATION in the period in which a sequence ends swallows the END: the state stays PLAYING."""
    original(self, period)
    if self._runs is not None and self._runs.ends == period:
        self._runs = None
