"""A broken chain: messages, supervision of the processors, and the handling of faults (chapters CHN and SAF)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ....emulator import machine
from ....emulator.boards import processor
from ....emulator.boards.sync import SyncLine
from ....emulator.control import admission, known_faults
from ....emulator.control.chain import Chain
from ....emulator.control.known_faults import KnownFaults
from ....emulator.control.supervisor import Supervisor
from ....protocol.chain import MEMORIES, ROUTE, Commit, Load
from ....protocol.codes import Fault
from ....protocol.states import StateEvent
from .patching import Patch, mutant

Processor = processor.Processor
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
    """A processor skips a commit and plays on, as it must, but neither counts nor reports the miss."""
    return self._log(f"misses {what}")


@mutant("CHN-011", "CHN-004")
def damaged_slices_are_played(patch: Patch) -> None:
    """A commit plays any slice in the mailbox: the checksum is never computed."""
    patch.replace(Commit, "guards", lambda *_: True)


@mutant("CHN-012", "CHN-010", wraps=(Processor, "receive"))
def damaged_loads_are_stored(original: Any, self: Any, tokens: bytes) -> Any:
    """A load with a wrong CRC-32 is counted as damaged and stored all the same: the check comes after the copy."""
    damaged = self.damaged_messages
    answer = original(self, tokens)
    if self.damaged_messages > damaged and len(tokens) == Load.TOKENS:
        memory, first, count, items = Load.PAYLOAD.unpack_from(tokens, ROUTE.size)
        layout = MEMORIES.get(memory)
        if layout is not None and first + count <= layout.items:
            self.load(memory, first, items[: count * layout.item_bytes])
    return answer


# Supervision of the processors


@mutant("CHN-017", wraps=(Supervisor, "_ask"))
def silent_processors_are_not_noticed(original: Any, self: Any, number: int) -> None:
    """A processor that answers no question is asked again and again and never given up: misses are not counted."""
    self._unanswered[number] = 0
    original(self, number)


@mutant("CHN-021", "CHN-017")
def broken_chain_is_not_noticed(patch: Patch) -> None:
    """If a processor is dead the controller waits for ever for room on the first link: the time-out is missing."""
    patch.replace(Chain, "_break", lambda *_: None)


@mutant("CHN-018", "SAF-007")
def lone_processors_play_on(patch: Patch) -> None:
    """A processor that is not asked any more goes on playing: it has no time-out of its own."""
    patch.replace(Processor, "_check_hearing", lambda *_: None)


@mutant("CHN-030", "SAF-004")
def missed_silence_is_not_sent_again(patch: Patch) -> None:
    """A processor that misses the commit of the silence keeps playing: the miss is counted, but has no other effect."""
    patch.replace(KnownFaults, "_heed_miss", lambda *_: None)


@mutant("CHN-027", "SAF-008")
def sync_may_be_off_by_100_ticks(patch: Patch) -> None:
    """SYNC appears only when the sync pulse is off by two periods: the tolerance was widened for debugging."""
    patch.replace(processor, "SYNC_TOLERANCE_TICKS", 100)


@mutant("CHN-027", "SAF-008", wraps=(Processor, "feel_pulse"))
def missing_sync_pulses_are_not_noticed(original: Any, self: Any, tick: Any) -> Any:
    """A sync line without pulses raises no fault: each pulse is judged when it comes, and a missing one never comes."""
    return original(self, tick) if self.sync_connected else None


@mutant("CHN-026", "TIM-002")
def a_listener_begins_by_itself(patch: Patch) -> None:
    """A device that listens on a sync line begins period 0 as soon as its chain is complete, and waits for no pulse."""
    patch.replace(SyncLine, "next_pulse", lambda _self, cycle: cycle)


@mutant("CHN-026", "TIM-002")
def a_lone_listener_does_not_wait(patch: Patch) -> None:
    """A device that listens on a sync line without pulses begins at once, with SYNC: it looks at the line once."""
    patch.replace(machine, "SYNC_WAIT_CYCLES", 0)


# Faults


@mutant("SAF-008", "REQ-011", wraps=(Supervisor, "_heed"))
def faults_go_with_their_cause(original: Any, self: Any, report: Any) -> None:
    """A fault and the state OFF vanish as soon as the reports show no cause: faults are not latched."""
    original(self, report)
    self._on_fault.__self__.clear()


@mutant("REQ-011", "SAF-007", wraps=(KnownFaults, "clear"))
def clear_faults_clears_what_persists(_: Any, self: Any) -> None:
    """CLEAR_FAULTS clears every fault, and the state, until the next report: it does not check the causes."""
    cleared, self._device.faults = self._device.faults, NO_FAULTS
    self.supervisor.forget(cleared)
    self._machine.happen(StateEvent.CLEAR, self._dispatch.now)
    if cleared:
        self._machine.send_status()


@mutant("REQ-011", "SAF-008", wraps=(KnownFaults, "clear"))
def supply_of_the_last_board_is_cleared_while_it_persists(original: Any, self: Any) -> None:
    """CLEAR_FAULTS clears a SUPPLY that persists on the last board alone: the loop ends one board too soon."""
    reports = self.supervisor._reports
    self.supervisor._reports = [*reports[:-2], *(replace(report, faults=0) for report in reports[-2:])]
    original(self)
    self.supervisor._reports = reports


@mutant("SAF-008")
def overrun_is_never_said(patch: Patch) -> None:
    """A processor that is too slow to rasterise does not report it."""
    patch.replace(Processor, "_overrun", lambda *_: None)


@mutant("ACK-006", "SAF-008", wraps=(KnownFaults, "appear"))
def faults_are_told_only_when_asked_for(original: Any, self: Any, fault: Fault, what: str) -> None:
    """A new fault sends no unsolicited status record."""
    doors, self._machine._doors = self._machine._doors, []
    original(self, fault, what)
    self._machine._doors = doors


@mutant("SAF-007")
def processors_wait_for_the_controller_to_silence_them(patch: Patch) -> None:
    """A processor with a fault of its own plays on until the controller learns of it, up to 10 ms later."""

    @patch.around(Processor, "_raise")
    def enter(_: Any, self: Any, fault: Fault, what: str) -> None:
        self.faults |= fault
        self._log(what)

    patch.replace(Processor, "_silenced", property(lambda _: False))


@mutant("SAF-007", "STA-003")
def faults_leave_the_state_as_it_is(patch: Patch) -> None:
    """A silencing fault is reported and silences its own processor, but the device plays on and is not in FAULT."""
    for module in (admission, known_faults):
        patch.replace(module, "SILENCING_FAULTS", NO_FAULTS)


@mutant("SAF-008")
def supply_of_24_volts_is_no_fault(patch: Patch) -> None:
    """The supply may have up to 24 V: the limit is that of the regulator."""
    patch.replace(processor, "SUPPLY_RANGE_MV", range(12_000, 24_001))


@mutant("SAF-008")
def supply_of_17_volts_is_a_fault(patch: Patch) -> None:
    """The supply fault appears above 16 V instead of 18 V: resistors of another tolerance were assumed."""
    patch.replace(processor, "SUPPLY_RANGE_MV", range(12_000, 16_001))


@mutant("SAF-008")
def boards_may_be_hotter(patch: Patch) -> None:
    """TEMPERATURE appears only above 95 °C."""
    patch.replace(processor, "TEMPERATURE_LIMIT_C", 95)
