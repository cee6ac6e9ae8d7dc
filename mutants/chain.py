"""A broken chain: messages, the watch over the processors, and what becomes of faults (chapters CHN and SAF)."""

from __future__ import annotations

from typing import Any

from ..emulator.boards import processor
from ..emulator.control import controller
from ..emulator.control.chain import Chain
from ..emulator.control.supervisor import Supervisor
from ..protocol.chain import MEMORIES, ROUTE, Commit, Load
from ..protocol.codes import Fault
from ..protocol.states import Event
from .patching import Patch, mutant

Controller, Processor = controller.Controller, processor.Processor
NO_FAULTS = Fault(0)


# Messages


@mutant("CHN-010", "REQ-003", wraps=(Processor, "receive"))
def damaged_messages_are_not_counted(original: Any, self: Any, tokens: bytes) -> Any:
    """A damaged message is dropped and raises CHAIN, but is not counted."""
    before = self.damaged_messages
    answer = original(self, tokens)
    self.damaged_messages = before
    return answer


@mutant("CHN-004", "CHN-016", wraps=(Processor, "_miss"))
def missed_commits_are_kept_quiet(_: Any, self: Any, what: Any) -> Any:
    """A processor plays on after a commit that it had to leave, and neither counts it nor says so."""
    return self._log(f"misses {what}")


@mutant("CHN-011", "CHN-004")
def damaged_slices_are_played(patch: Patch) -> None:
    """A commit plays whatever slice is in the mailbox: nobody computes its checksum."""
    patch.replace(Commit, "guards", lambda *_: True)


@mutant("CHN-012", "CHN-010", wraps=(Processor, "receive"))
def damaged_loads_are_stored(original: Any, self: Any, tokens: bytes) -> Any:
    """A load whose CRC-32 is wrong is stored and counted as damaged all the same: it is checked afterwards."""
    damaged = self.damaged_messages
    answer = original(self, tokens)
    if self.damaged_messages > damaged and len(tokens) == Load.TOKENS:
        memory, first, count, items = Load.PAYLOAD.unpack_from(tokens, ROUTE.size)
        layout = MEMORIES.get(memory)
        if layout is not None and first + count <= layout.items:
            self.load(memory, first, items[: count * layout.item_bytes])
    return answer


# The watch over the processors


@mutant("CHN-017", wraps=(Supervisor, "_ask"))
def silent_processors_are_not_noticed(original: Any, self: Any, number: int) -> None:
    """A processor that answers no question is asked again and again, and never given up: nothing counts the misses."""
    self._unanswered[number] = 0
    original(self, number)


@mutant("CHN-021", "CHN-017")
def broken_chain_is_not_noticed(patch: Patch) -> None:
    """The controller waits for ever for room on the first link where a processor is dead: the time-out is missing."""
    patch.replace(Chain, "_break", lambda *_: None)


@mutant("CHN-018", "SAF-007")
def lone_processors_play_on(patch: Patch) -> None:
    """A processor that nobody asks anything any more goes on playing: it has no time-out of its own."""
    patch.replace(Processor, "_check_hearing", lambda *_: None)


@mutant("CHN-030", "SAF-004")
def missed_silence_is_not_sent_again(patch: Patch) -> None:
    """A processor that missed the commit of the silence is left playing: a miss is counted and no more."""
    patch.replace(Controller, "_heed_miss", lambda *_: None)


@mutant("CHN-027", "SAF-008")
def sync_may_be_off_by_100_ticks(patch: Patch) -> None:
    """The sync pulse may be two periods off before SYNC is said: the tolerance was widened while debugging."""
    patch.replace(processor, "SYNC_TOLERANCE_TICKS", 100)


@mutant("CHN-027", "SAF-008", wraps=(Processor, "feel_pulse"))
def missing_sync_pulses_are_not_noticed(original: Any, self: Any, tick: Any) -> Any:
    """A sync line without pulses is no fault: pulses are judged when they come, and none comes."""
    return original(self, tick) if self.sync_connected else None


# Faults


@mutant("SAF-008", "REQ-011", wraps=(Supervisor, "_heed"))
def faults_go_with_their_cause(original: Any, self: Any, report: Any) -> None:
    """A fault is gone, and the state OFF, as soon as the reports say that its cause is: nothing latches it."""
    original(self, report)
    self._on_fault.__self__._clear_faults()


@mutant("REQ-011", "SAF-007", wraps=(Controller, "_clear_faults"))
def clear_faults_clears_what_persists(_: Any, self: Any) -> None:
    """CLEAR_FAULTS clears every fault until the next report, and the state with it: it does not look at the causes."""
    cleared, self.faults = self.faults, NO_FAULTS
    self._supervisor.forget(cleared)
    self._happen(Event.CLEAR, self._now)
    if cleared:
        self._speak()


@mutant("SAF-008")
def overrun_is_never_said(patch: Patch) -> None:
    """A processor that is too slow to rasterise says nothing of it."""
    patch.replace(Processor, "_overrun", lambda *_: None)


@mutant("ACK-006", "SAF-008", wraps=(Controller, "raise_fault"))
def faults_are_told_only_when_asked_for(original: Any, self: Any, fault: Fault, what: str) -> None:
    """No status record comes of the device's own accord when a fault appears."""
    doors, self._doors = self._doors, []
    original(self, fault, what)
    self._doors = doors


@mutant("SAF-007")
def processors_wait_for_the_controller_to_silence_them(patch: Patch) -> None:
    """A processor with a fault of its own plays on until the controller has learnt of it, up to 10 ms later."""

    @patch.around(Processor, "_raise")
    def enter(_: Any, self: Any, fault: Fault, what: str) -> None:
        self.faults |= fault
        self._log(what)

    patch.replace(Processor, "_silenced", property(lambda _: False))


@mutant("SAF-007", "STA-003")
def faults_leave_the_state_as_it_is(patch: Patch) -> None:
    """A silencing fault is reported and the processor silences itself, but the device is not in FAULT and goes on."""
    patch.replace(controller, "SILENCING_FAULTS", NO_FAULTS)


@mutant("SAF-008")
def supply_of_24_volts_is_no_fault(patch: Patch) -> None:
    """The supply may have 24 V: its upper limit is that of the regulator."""
    patch.replace(processor, "SUPPLY_RANGE_MV", range(12_000, 24_001))


@mutant("SAF-008")
def supply_of_17_volts_is_a_fault(patch: Patch) -> None:
    """The supply is called wrong above 16 V, though it may have 18: resistors of another tolerance were assumed."""
    patch.replace(processor, "SUPPLY_RANGE_MV", range(12_000, 16_001))


@mutant("SAF-008")
def boards_may_be_hotter(patch: Patch) -> None:
    """TEMPERATURE appears above 95 °C only."""
    patch.replace(processor, "TEMPERATURE_LIMIT_C", 95)
