"""Numbers that are too narrow: truncated sums, products, differences and counts (SPEC.md, many chapters)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ....base.errors import BlockError
from ....emulator.control import agenda
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.device_state import DeviceState
from ....emulator.control.dispatch import Dispatch
from ....emulator.control.execution import Execution
from ....emulator.control.known_faults import KnownFaults
from ....emulator.control.requests import Requests
from ....emulator.control.state_machine import StateMachine
from ....emulator.control.stores import Stores
from ....emulator.control.watchdog import Watchdog
from ....emulator.firmware.dfu import DfuMode
from ....emulator.ports.history import PortSequence
from ....protocol import firmware
from ....protocol.blocks import AmplitudeModulation, PlaySequence, Slot, Update
from ....protocol.board import CYCLES_PER_MS, CYCLES_PER_PERIOD, CYCLES_PER_TICK, TICKS_PER_PERIOD, WATCHDOG_MS
from ....protocol.codes import DFU_TRANSFER_BYTES, HORIZON_PERIODS, DfuStatus, Reason
from .dfu import DOWNLOAD, UPLOAD, handle
from .patching import Patch, mutant
from .seams import allow_drive, one_by_one

BYTE, HALF_WORD, WORD = 2**8, 2**16, 2**32
AN_ENTRIES_BLOCK, A_SAMPLES_BLOCK = 120, 480
NEVER = 2**62


def signed(value: int, modulus: int) -> int:
    """The signed number that is left after truncation to so many values."""
    return (value + modulus // 2) % modulus - modulus // 2


# The watchdog


def _wait_instead(patch: Patch, cycles: Callable[[int], int]) -> None:
    """Let the watchdog wait for another number of core cycles, given its milliseconds."""
    patch.wrap(Watchdog, "_due", lambda _: lambda self: self._fed + cycles(self.milliseconds))


@mutant("SAF-003", "REQ-009")
def watchdog_time_is_32_bits_of_cycles(patch: Patch) -> None:
    """A watchdog time beyond 10.7 s fires early: the core cycles are multiplied in 32 bits."""
    _wait_instead(patch, lambda ms: ms * CYCLES_PER_MS % WORD)


@mutant("SAF-003", "REQ-009")
def watchdog_time_is_24_bits_of_ticks(patch: Patch) -> None:
    """A watchdog time beyond 8.4 s fires early: the timer counts ticks in 24 bits."""
    _wait_instead(patch, lambda ms: ms * CYCLES_PER_MS // CYCLES_PER_TICK % 2**24 * CYCLES_PER_TICK)


@mutant("SAF-003", "REQ-009")
def watchdog_time_is_a_signed_short(patch: Patch) -> None:
    """A watchdog time beyond 32 767 ms fires at once: the milliseconds are a signed number of 16 bits."""
    _wait_instead(patch, lambda ms: max(signed(ms, HALF_WORD), 0) * CYCLES_PER_MS)


@mutant("SAF-003", "REQ-009")
def watchdog_beyond_32_bits_of_cycles_never_fires(patch: Patch) -> None:
    """A watchdog time beyond 10.7 s never fires: the cycles since the last sign of life wrap before."""
    _wait_instead(patch, lambda ms: ms * CYCLES_PER_MS if ms * CYCLES_PER_MS < WORD else NEVER)


@mutant("SAF-003")
def watchdog_fires_where_32_bits_of_ticks_wrap(patch: Patch) -> None:
    """The watchdog fires at once if its end lies after the next wrap of the 32-bit tick with which it is compared."""

    @patch.around(Controller, "__init__")
    def of_init(original: Any, self: Any, *arguments: Any, **more: Any) -> None:
        original(self, *arguments, **more)
        vars(self._machine.watchdog)["origin"] = self.time.origin

    @patch.around(Watchdog, "_due")
    def of_due(original: Any, self: Any) -> int:
        ends: int = original(self)
        origin = vars(self).get("origin", 0)
        laps = [(cycle - origin) // CYCLES_PER_TICK // WORD for cycle in (self._fed, ends)]
        return ends if laps[0] == laps[1] else self._fed


@mutant("SAF-003", "TIM-002")
def watchdog_fires_31_bits_of_ticks_after_enable(patch: Patch) -> None:
    """What is enabled for 18 minutes is silenced although it is fed: signs of life are counted from ENABLE on."""

    @patch.around(Watchdog, "watch")
    def watch(original: Any, self: Any, since: int) -> None:
        vars(self)["since"] = since
        original(self, since)

    @patch.around(Watchdog, "_due")
    def due(original: Any, self: Any) -> Any:
        return min(original(self), vars(self)["since"] + 2**31 * CYCLES_PER_TICK)


# The sync line


@mutant("BLK-019", "CHN-026")
def sync_period_of_a_clock_block_is_32_bits(patch: Patch) -> None:
    """The acknowledgement of a CLOCK names the period of the last pulse in 32 bits, which wrap after 30 hours."""

    @patch.around(Controller, "_ack")
    def ack(original: Any, self: Any, arrived: int, *rest: Any) -> Any:
        found = original(self, arrived, *rest)
        is_clock = found.commit_period and found.commit_period <= found.now_period
        return replace(found, commit_period=found.commit_period % WORD) if is_clock else found


# Total drives


def _judge_drive(patch: Patch, kind: Any, cut: Callable[[int], int]) -> None:
    """Truncate the drive of one kind of block before it is compared."""
    allow_drive(patch, kind, lambda pulses, limit: cut(pulses.total_drive) <= 1000 * limit)
    one_by_one(patch)


@mutant("SAF-006")
def drive_of_a_slot_is_summed_up_in_16_bits(patch: Patch) -> None:
    """A SLOT of 91.8 transducers passes a limit of 40: its thousandths are summed in 16 bits."""
    _judge_drive(patch, Slot, lambda total: total % HALF_WORD)


@mutant("SAF-006")
def drive_of_an_update_is_summed_up_in_16_bits(patch: Patch) -> None:
    """An UPDATE of 91.8 transducers passes a limit of 40: its thousandths are summed in 16 bits."""
    _judge_drive(patch, Update, lambda total: total % HALF_WORD)


@mutant("SAF-006")
def drive_is_a_signed_short(patch: Patch) -> None:
    """A total drive of 33 to 65 transducers passes any limit: its thousandths become a negative number of 16 bits."""
    _judge_drive(patch, Update | Slot, lambda total: signed(total, HALF_WORD))


@mutant("SAF-006", wraps=(Stores, "keep"))
def drive_of_a_stored_slot_is_a_short(original: Any, self: Any, body: Any) -> None:
    """A SEQUENCE plays a slot of 65.6 transducers under a lowered limit: slots store their thousandths in 16 bits."""
    original(self, body)
    if isinstance(body, Slot):
        self._powers[body.number] %= HALF_WORD


@mutant("SAF-006", "REQ-010", wraps=(Admission, "_judge_stores"), also=one_by_one)
def limit_is_a_short_of_thousandths(original: Any, self: Any, body: Any) -> None:
    """With a limit of 66 transducers almost every drive is refused: its thousandths are kept in 16 bits."""
    if isinstance(body, Update | Slot) and body.pulses.total_drive > 1000 * self._device.drive_limit % HALF_WORD:
        raise BlockError("above the limit", Reason.DRIVE)
    original(self, body)


# Sequences


def _last(patch: Patch, cut: Callable[[int], int]) -> None:
    """Change the duration of sequences in the controller's eyes, given the true number of periods."""

    @patch.around(Stores, "duration")
    def duration(original: Any, self: Any, body: Any) -> int | None:
        periods = original(self, body)
        return None if periods is None else max(cut(periods), 1)


@mutant("BLK-015", "STA-003")
def duration_is_32_bits(patch: Patch) -> None:
    """A sequence of 131 072 periods ends at once if it repeats 32 768 times: the product is taken in 32 bits."""
    _last(patch, lambda periods: periods % WORD)


@mutant("BLK-015", "STA-003")
def duration_is_a_signed_word(patch: Patch) -> None:
    """A sequence of 2³¹ periods or more ends at once: its duration becomes negative."""
    _last(patch, lambda periods: signed(periods, WORD))


@mutant("BLK-015", "STA-003")
def duration_is_32_bits_of_ticks(patch: Patch) -> None:
    """A sequence that lasts longer than 36 minutes ends early: its duration is counted in 32 bits of ticks."""
    _last(patch, lambda periods: periods * TICKS_PER_PERIOD % WORD // TICKS_PER_PERIOD)


@mutant("BLK-015", "STA-003")
def duration_is_32_bits_of_cycles(patch: Patch) -> None:
    """A sequence that lasts longer than 10.7 s ends early: its duration is counted in 32 bits of core cycles."""
    _last(patch, lambda periods: periods * CYCLES_PER_PERIOD % WORD // CYCLES_PER_PERIOD)


@mutant("BLK-015", "STA-003", wraps=(Stores, "duration"))
def length_of_a_sequence_is_a_short(_: Any, self: Any, body: Any) -> int | None:
    """A sequence whose entries last 65 537 periods together ends after one: they are summed in 16 bits."""
    entries = self._entries[body.first : body.first + body.count]
    return body.repeats * max(sum(periods for _slot, periods in entries) % HALF_WORD, 1) or None


@mutant("BLK-022", wraps=(Execution, "carry_out"))
def slots_are_free_after_32_bits_of_periods(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A slot of a sequence of 2³² periods or longer can be overwritten: the end is stored in 32 bits."""
    change = original(self, body, door)
    duration = self._dispatch.stores.duration(body) if isinstance(body, PlaySequence) else None
    if duration is not None:
        self._dispatch.stores._uses[-1].until = change.period + duration % WORD
    return change


@mutant("CHN-015", "BLK-015", "REQ-007")
def place_in_a_sequence_is_a_short(patch: Patch) -> None:
    """After 65 536 periods a sequence jumps: processors count its periods in 16 bits."""
    patch.wrap(PortSequence, "entries", lambda original: lambda self, since: original(self, since % HALF_WORD))


# Checks of what is stored


def _look_at_the_first(patch: Patch, check: str, kind: Any, most: int) -> None:
    """Let a check of what plays cover only so many places."""

    @patch.around(Stores, check)
    def checked(original: Any, self: Any, body: Any, *rest: Any) -> Any:
        first = replace(body, count=min(body.count, most)) if isinstance(body, kind) else body
        return original(self, first, *rest)


@mutant("BLK-021")
def what_is_missing_from_entry_120_on_is_played(patch: Patch) -> None:
    """A SEQUENCE is accepted that lacks an entry from its 121st on: the check covers as many as a block holds."""
    _look_at_the_first(patch, "check_there", PlaySequence, AN_ENTRIES_BLOCK)


@mutant("BLK-021")
def what_is_missing_from_sample_480_on_is_played(patch: Patch) -> None:
    """A MODULATION is accepted that lacks a sample from its 481st on: the check covers as many as a block holds."""
    _look_at_the_first(patch, "check_there", AmplitudeModulation, A_SAMPLES_BLOCK)


@mutant("SAF-006", "BLK-021")
def drive_from_entry_256_on_is_not_judged(patch: Patch) -> None:
    """A SEQUENCE is accepted although the slot of its 257th entry is above the limit: the check counts in a byte."""
    _look_at_the_first(patch, "check_power", PlaySequence, BYTE)


@mutant("BLK-022", wraps=(Stores, "use"))
def slots_from_entry_120_on_are_free(original: Any, self: Any, body: Any, period: int) -> Any:
    """The slot of the 121st entry of a playing sequence can be overwritten: the check covers the first 120."""
    made = original(self, body, period)
    if isinstance(body, PlaySequence):
        entries = self._entries[body.first : body.first + min(body.count, AN_ENTRIES_BLOCK)]
        made.slots = frozenset(slot for slot, _ in entries)
    return made


@mutant("BLK-022", wraps=(Stores, "use"))
def samples_from_480_on_are_free(original: Any, self: Any, body: Any, period: int) -> Any:
    """The 481st sample of a modulation can be overwritten while it plays: the check covers the first 480."""
    made = original(self, body, period)
    made.samples = made.samples[:A_SAMPLES_BLOCK]
    return made


# Periods


def _due_in_32_bits(patch: Patch, cycles: int) -> None:
    """Begin a change as soon as a signed 32-bit difference, in units of so many core cycles, says that it is due."""

    @patch.around(agenda.Agenda, "due")
    def due(original: Any, self: Any, now: int) -> Any:
        first = self._changes[0] if self._changes else None
        if isinstance(first, agenda.Change):
            left = self._time.boundary(first.period) // cycles - now // cycles
            if signed(left, WORD) <= 0 < left:
                first.period = self._time.period(now)
                near = first.tail._replace(period=first.period, table=min(first.tail.table, first.period))
                self.tail = near if self.tail is first.tail else self.tail
                first.tail = near
        return original(self, now)

    one_by_one(patch)


@mutant("BLK-005")
def queue_waits_in_32_bits_of_periods(patch: Patch) -> None:
    """A change for a period 2³¹ ahead begins at once: the queue compares signed 32-bit differences of periods."""
    _due_in_32_bits(patch, CYCLES_PER_PERIOD)


@mutant("BLK-005")
def queue_waits_in_32_bits_of_ticks(patch: Patch) -> None:
    """A change 18 minutes ahead begins at once: the queue compares signed 32-bit differences of ticks."""
    _due_in_32_bits(patch, CYCLES_PER_TICK)


@mutant("BLK-005")
def queue_waits_in_32_bits_of_cycles(patch: Patch) -> None:
    """A change 5.4 s ahead begins at once: the queue compares signed 32-bit differences of core cycles."""
    _due_in_32_bits(patch, 1)


def _judge_horizon(patch: Patch, is_beyond: Callable[[Any, int, int], bool]) -> None:
    """Change the judgement of the horizon, given the admission, the named period, and that of the arrival."""

    @patch.around(Admission, "judge")
    def judge(original: Any, self: Any, block: Any, arrived: int) -> None:
        period = getattr(block.body, "period", 0)
        beyond = is_beyond(self, period, arrived)
        pardoned = period > arrived + HORIZON_PERIODS and not beyond
        original(self, block, period if pardoned else arrived)
        if beyond:
            raise BlockError("too far ahead", Reason.HORIZON)

    one_by_one(patch)


@mutant("BLK-010")
def horizon_counts_from_what_is_queued(patch: Patch) -> None:
    """A change 2³² periods after the last queued one is accepted: the horizon counts from the end of the queue."""
    _judge_horizon(
        patch,
        lambda self, period, arrived: period > max(self._dispatch.agenda.tail.period, arrived) + HORIZON_PERIODS,
    )


@mutant("BLK-010", by=_judge_horizon)
def horizon_is_judged_in_64_bits_of_ticks(_: Any, period: int, arrived: int) -> bool:
    """A period near 2⁶⁴ / 50 is accepted: the horizon is compared in ticks, and the product wraps."""
    return period * TICKS_PER_PERIOD % 2**64 > (arrived + HORIZON_PERIODS) * TICKS_PER_PERIOD


@mutant("BLK-023", wraps=(Admission, "_judge_stores"), also=one_by_one, url="emulator:?link=2wire")
def rate_is_judged_in_16_bits(original: Any, self: Any, body: Any) -> None:
    """An update 65 537 periods after another is refused with RATE: their distance is counted in 16 bits."""
    original(self, body)
    if isinstance(body, Update) and body.period and self._device.last_named is not None:
        apart = (body.period - self._device.last_named) % HALF_WORD
        if body.period > self._device.last_named and 0 < apart < self._dispatch.periods_per_update:
            raise BlockError("too close", Reason.RATE)


@mutant("BLK-005", wraps=(Dispatch, "plan"), also=one_by_one)
def late_is_a_signed_difference_of_32_bits(original: Any, self: Any, requested: int, *rest: Any, **more: Any) -> Any:
    """After 15 hours a change for period 1 counts as a future one, and waits for 15 more."""
    now = self.period
    ahead = signed(requested - now, WORD)
    return original(self, now + ahead if 0 < requested < now and ahead > 0 else requested, *rest, **more)


# STATUS


def _name_wished_period(patch: Patch, begin: str) -> None:
    """Let STATUS report the requested period of a change that begins late."""
    wished: dict[tuple[int, int], int] = {}

    @patch.around(Dispatch, "plan")
    def of_plan(original: Any, self: Any, requested: int, *rest: Any, **more: Any) -> Any:
        change = original(self, requested, *rest, **more)
        wished[id(self), change.period] = requested or change.period
        return change

    @patch.around(Execution, begin)
    def of_begin(original: Any, self: Any, *arguments: Any) -> None:
        original(self, *arguments)
        self._device.since_period = wished.pop((id(self._dispatch), arguments[-1]), self._device.since_period)

    one_by_one(patch)


@mutant("REQ-003")
def status_names_the_period_that_a_late_update_wished(patch: Patch) -> None:
    """After a late UPDATE STATUS reports the requested period as its start, not the actual one."""
    _name_wished_period(patch, "begin_update")


@mutant("REQ-003")
def status_names_the_period_that_a_late_sequence_wished(patch: Patch) -> None:
    """After a late SEQUENCE STATUS reports the requested period as its start, not the actual one."""
    _name_wished_period(patch, "_begin_sequence")


def _forget(patch: Patch, owner: Any, when: str, **values: Any) -> None:
    """Overwrite some attributes of the device after a method."""

    @patch.around(owner, when)
    def forgetful(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        done = original(self, *arguments, **more)
        for name, value in values.items():
            setattr(self if owner is DeviceState else self._device, name, value)
        return done


@mutant("REQ-003")
def enable_forgets_the_last_refusal(patch: Patch) -> None:
    """ENABLE resets the last refusal in STATUS to 0, as a new start."""
    _forget(patch, Requests, "_enable", last_refusal=Reason.ACCEPTED)


@mutant("REQ-003")
def accepted_block_forgets_the_last_refusal(patch: Patch) -> None:
    """An accepted block resets the last refusal in STATUS to 0: the result of every block is stored there."""
    _forget(patch, DeviceState, "count", last_refusal=Reason.ACCEPTED)
    one_by_one(patch)


@mutant("REQ-003", "REQ-011")
def clear_faults_clears_the_counters(patch: Patch) -> None:
    """CLEAR_FAULTS resets the counts of refused, late and lost blocks: they count as errors, too."""
    _forget(patch, KnownFaults, "clear", refused=0, late=0, lost=0)


@mutant("REQ-003", "USB-026")
def new_session_clears_the_counters(patch: Patch) -> None:
    """A bus reset and SET_CONFIGURATION reset the counters of STATUS, which should count from power-up."""
    _forget(patch, StateMachine, "new_session", accepted=0, refused=0, late=0, lost=0)


@mutant("REQ-003", "SAF-004")
def disable_clears_the_counters(patch: Patch) -> None:
    """If the outputs are disabled, the next session resets the counts of late and lost blocks."""
    _forget(patch, StateMachine, "_drop_all", late=0, lost=0)


@mutant("REQ-009", "SAF-003", wraps=(StateMachine, "_watchdog_fires"))
def watchdog_forgets_its_time_when_it_fires(original: Any, self: Any) -> None:
    """After the watchdog has fired, its time is that of INFO again."""
    original(self)
    self.watchdog.set_time(WATCHDOG_MS)


# Firmware


@mutant("DFU-009", by=partial(handle, request=DOWNLOAD))
def block_numbers_have_8_bits(original: Any, self: Any, setup: Any, data: bytes) -> Any:
    """Block 256 of a download is refused: after block 255 the device expects block 0."""
    if setup.value >= BYTE and data:
        self._refuse(DfuStatus.ADDRESS)
    return original(self, setup, data)


@mutant("DFU-009", "DFU-011")
def block_256_is_written_over_block_0(patch: Patch) -> None:
    """Block 256 is written to the place of block 0: the address follows from the low 8 bits of its number."""
    patch.wrap(DfuMode, "_write", lambda original: lambda self, number, data: original(self, number % BYTE, data))


@mutant("DFU-014", by=partial(handle, request=UPLOAD))
def block_256_of_an_upload_is_block_0(original: Any, self: Any, setup: Any, data: bytes) -> Any:
    """Block 256 of an upload holds the bytes of block 0: the address follows from the low 8 bits of its number."""
    block = original(self, setup, data)
    at = setup.value % BYTE * DFU_TRANSFER_BYTES
    return self._upload[at : at + len(block)] if setup.value >= BYTE else block


def _count_generations(patch: Patch, following: Callable[[int], int]) -> None:
    patch.replace(firmware, "successor", following)


@mutant("FWU-017", "FWU-019")
def generation_stays_at_its_largest(patch: Patch) -> None:
    """Generation FFFFFFFF is followed by FFFFFFFF, so that an upgrade to bank B does not boot: the number saturates."""
    _count_generations(patch, lambda generation: min(generation + 1, WORD - 1))


@mutant("FWU-017", "FWU-019")
def generation_is_a_short(patch: Patch) -> None:
    """Generation 65 535 is followed by 0, so that the upgrade does not boot: generations are counted in 16 bits."""
    _count_generations(patch, lambda generation: (generation + 1) % HALF_WORD)


@mutant("FWU-019", "FWU-017")
def generations_are_compared_without_wrap(patch: Patch) -> None:
    """Generation 0 counts as older than FFFFFFFF, so that the upgrade does not boot: they are compared unwrapped."""
    patch.replace(firmware, "follows", lambda generation, other: generation > other)
