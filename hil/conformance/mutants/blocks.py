"""Broken judgement of blocks: wrongly accepted and wrongly refused ones (chapters BLK and ACK)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ....base.errors import BlockError
from ....emulator.control import admission, controller
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.execution import Execution
from ....emulator.control.requests import Requests
from ....protocol.blocks import Entries, Output, Samples, Slot, unpack_pulses
from ....protocol.codes import BLOCK_BYTES, CHECKSUM_OFFSET, HEADER_BYTES, SEQUENCE_ENTRIES, Action, Flag, Kind, Reason
from ....protocol.numbering import follows
from ....protocol.replies import ENABLED
from .patching import Patch, mutant
from .seams import forgive, misread_bodies, one_by_one, sealed_block

PULSES = (Kind.UPDATE, Kind.SLOT)
WITHOUT_PAYLOAD = (Kind.SEQUENCE, Kind.MODULATION, Kind.OUTPUT, Kind.CLOCK, Kind.NO_OP)
MAGIC_HIGH, VERSION, KIND, PERIOD, FIRST, COUNT, HOLD, RESERVED_HIGH, FLAGS, ACTION = 1, 2, 3, 8, 16, 18, 20, 25, 26, 27
CONTENTS = (Reason.RATE, Reason.DRIVE, Reason.EMPTY, Reason.IN_USE)
CHECKSUM_AT, ENTRY_BYTES, LAST_KIND = CHECKSUM_OFFSET, 4, max(Kind)


@mutant("BLK-010")
def horizon_is_not_judged(patch: Patch) -> None:
    """Any period is accepted, however far ahead: the comparison was forgotten."""
    patch.replace(admission, "HORIZON_PERIODS", 2**64)
    one_by_one(patch)


@mutant("REQ-003", wraps=(Requests, "status"))
def last_refusal_is_always_checksum(original: Any, self: Any) -> Any:
    """STATUS names CHECKSUM as the last refusal, whatever it was: only the checksum path stores a reason."""
    told = original(self)
    return replace(told, last_refusal=Reason.CHECKSUM if told.last_refusal else Reason.ACCEPTED)


@mutant("REQ-003")
def last_refusal_is_the_first(patch: Patch) -> None:
    """STATUS keeps naming the first refusal since power-up: the reason is stored only if none is stored yet."""

    @patch.around(Controller, "_refuse")
    def remember(original: Any, self: Any, error: Any, what: str) -> None:
        original(self, error, what)
        vars(self._device).setdefault("first_refusal", self._device.last_refusal)

    def tell(original: Any) -> Any:
        return lambda self: replace(
            original(self), last_refusal=vars(self._device).get("first_refusal", Reason.ACCEPTED)
        )

    patch.wrap(Requests, "status", tell)


@mutant("REQ-003", wraps=(Controller, "_refuse"))
def refused_blocks_count_as_accepted(original: Any, self: Any, error: Any, what: str) -> None:
    """The count of accepted blocks includes refused ones: it counts every block that arrives."""
    original(self, error, what)
    self._device.accepted += 1


# The bytes of a block


@mutant("BLK-003", "ACK-003", wraps=(controller, "unpack"))
def checksum_of_a_slot_is_ignored(original: Any, data: bytes) -> Any:
    """A SLOT is stored whatever its checksum: its pulses go to their place before the CRC is known."""
    is_slot = len(data) == BLOCK_BYTES and data[KIND] == Kind.SLOT
    return original(sealed_block(data) if is_slot else data)


@mutant("BLK-003", "ACK-003", wraps=(controller, "unpack"))
def half_of_the_checksum_is_compared(original: Any, data: bytes) -> Any:
    """A block is accepted if the low 16 bits of its checksum are right: the comparison is made in a short integer."""
    sealed = sealed_block(data) if len(data) == BLOCK_BYTES else data
    low_half = slice(CHECKSUM_AT, CHECKSUM_AT + 2)
    return original(sealed if sealed[low_half] == data[low_half] else data)


@mutant("BLK-002", "ACK-003", by=partial(forgive, kinds=range(256)))
def half_of_the_magic_is_compared(block: bytearray) -> None:
    """A block with a wrong second byte is accepted: only the first byte of the magic is compared."""
    block[MAGIC_HIGH] = ord("W")


@mutant("BLK-004", "ACK-003", by=partial(forgive, kinds=range(256)))
def unknown_kinds_do_nothing(block: bytearray) -> None:
    """A block of an unknown kind is accepted and does nothing: the switch over kinds has such a default."""
    if not 0 < block[KIND] <= LAST_KIND:
        block[KIND] = Kind.NO_OP
        block[PERIOD:CHECKSUM_AT] = bytes(CHECKSUM_AT - PERIOD)
        block[HEADER_BYTES:] = bytes(BLOCK_BYTES - HEADER_BYTES)


@mutant("BLK-011", by=partial(forgive, kinds=tuple(Kind)))
def second_reserved_byte_is_not_checked(block: bytearray) -> None:
    """Byte 25 may have any value: the check covers one byte of the reserved field, which has two."""
    block[RESERVED_HIGH] = 0


@mutant("BLK-011", by=partial(forgive, kinds=WITHOUT_PAYLOAD))
def payload_that_is_not_used_is_not_checked(block: bytearray) -> None:
    """Kinds without a payload are accepted with one: only the header is checked."""
    block[HEADER_BYTES:] = bytes(BLOCK_BYTES - HEADER_BYTES)


@mutant("BLK-011", by=partial(forgive, kinds=(Kind.ENTRIES, Kind.SAMPLES)))
def bytes_behind_the_items_are_not_checked(block: bytearray) -> None:
    """ENTRIES and SAMPLES may have any bytes after their items: only the stored part is checked."""
    items = int.from_bytes(block[COUNT : COUNT + 2], "little")
    rest = HEADER_BYTES + items * (ENTRY_BYTES if block[KIND] == Kind.ENTRIES else 1)
    block[rest:] = bytes(max(BLOCK_BYTES - rest, 0))


@mutant("BLK-011", by=partial(forgive, kinds=(Kind.UPDATE,)))
def unattended_is_accepted_in_an_update(block: bytearray) -> None:
    """An UPDATE may have the flag UNATTENDED: one mask of flags serves all kinds."""
    block[FLAGS] &= ~Flag.UNATTENDED


@mutant("BLK-011", by=partial(forgive, kinds=(Kind.MODULATION,)))
def hold_0_is_accepted(block: bytearray) -> None:
    """A MODULATION with a hold of 0 periods is accepted as one with a hold of 1: a loop tests at its end."""
    if not any(block[HOLD : HOLD + 2]):
        block[HOLD] = 1


@mutant("BLK-011", "BLK-018", by=partial(forgive, kinds=(Kind.OUTPUT,)))
def action_0_is_accepted(block: bytearray) -> None:
    """An OUTPUT without an action ends the modulation: actions are counted from 0."""
    if not block[ACTION]:
        block[ACTION] = Action.END_MODULATION


@mutant("BLK-011", "BLK-014", by=partial(forgive, kinds=(Kind.ENTRIES,)))
def entries_may_end_one_behind_the_table(block: bytearray) -> None:
    """ENTRIES may go one place past the table, and the last entry is lost: `first + count` is off by one."""
    first, count = (int.from_bytes(block[at : at + 2], "little") for at in (FIRST, COUNT))
    if first + count == SEQUENCE_ENTRIES + 1 and 2 <= count <= 120:
        block[COUNT : COUNT + 2] = (count - 1).to_bytes(2, "little")
        lost = HEADER_BYTES + (count - 1) * ENTRY_BYTES
        block[lost : lost + ENTRY_BYTES] = bytes(ENTRY_BYTES)


@mutant("BLK-011", "BLK-014")
def full_entries_are_refused(patch: Patch) -> None:
    """ENTRIES with all 120 entries that fit are refused: `<` stands where `<=` should."""
    _refuse_fields(patch, lambda body: isinstance(body, Entries) and len(body.entries) == 120)


@mutant("BLK-011", "BLK-016")
def full_samples_are_refused(patch: Patch) -> None:
    """SAMPLES with all 480 samples that fit are refused: `<` stands where `<=` should."""
    _refuse_fields(patch, lambda body: isinstance(body, Samples) and len(body.samples) == 480)


@mutant("BLK-011", "BLK-013")
def last_slot_is_refused(patch: Patch) -> None:
    """Slot 255 is refused: internally it means "none"."""
    _refuse_fields(patch, lambda body: isinstance(body, Slot) and body.number == 255)


def _refuse_fields(patch: Patch, is_refused: Callable[[Any], bool]) -> None:
    @patch.around(controller, "unpack")
    def unpack(original: Any, data: bytes) -> Any:
        block = original(data)
        if is_refused(block.body):
            raise BlockError("a field is out of its range", Reason.FIELD)
        return block


# Pulses


def _read_pulses_as(patch: Patch, misread: Callable[[int], int]) -> None:
    """Judge and play each 12-bit pulse as another one."""

    def pardon(block: bytearray) -> None:
        for at in range(HEADER_BYTES, BLOCK_BYTES, 3):
            pair = int.from_bytes(block[at : at + 3], "little")
            block[at : at + 3] = (misread(pair & 0xFFF) | misread(pair >> 12) << 12).to_bytes(3, "little")

    forgive(patch, pardon, PULSES)


@mutant("PUL-001", "ACK-003")
def width_26_is_accepted(patch: Patch) -> None:
    """A width of 26 ticks is accepted and plays as 25: the bound is off by one, and the table of edges ends at 25."""
    _read_pulses_as(patch, lambda pulse: pulse - (1 << 7) if pulse >> 7 == 26 else pulse)


@mutant("PUL-001", "ACK-003")
def phase_100_is_accepted(patch: Patch) -> None:
    """A phase of 100 half ticks is accepted as 0: the bound is off by one, and the phase wraps."""
    _read_pulses_as(patch, lambda pulse: pulse - 100 if pulse & 127 == 100 else pulse)


@mutant("PUL-001", "ACK-003")
def phase_of_a_silent_pulse_is_not_checked(patch: Patch) -> None:
    """A pulse of width 0 may have any phase: silent pulses skip all checks."""
    _read_pulses_as(patch, lambda pulse: pulse if pulse >> 7 else 0)


# The order of reasons


@mutant("ACK-003", wraps=(controller, "unpack"))
def pulses_are_judged_before_fields(original: Any, data: bytes) -> Any:
    """A block with a wrong field and a wrong pulse is refused with PULSE: the payload is checked first."""
    try:
        return original(data)
    except BlockError as error:
        if error.reason == Reason.FIELD and data[KIND] in PULSES:
            unpack_pulses(data[HEADER_BYTES:])
        raise


@mutant("ACK-003", wraps=(controller, "unpack"))
def magic_is_judged_before_the_checksum(original: Any, data: bytes) -> Any:
    """A block with a damaged magic is refused with MAGIC: the header is checked before the CRC."""
    if len(data) == BLOCK_BYTES and data[:VERSION] != b"PW":
        raise BlockError("not a block", Reason.MAGIC)
    return original(data)


@mutant("ACK-003")
def state_is_judged_before_contents(patch: Patch) -> None:
    """While the outputs are off an UPDATE with a wrong pulse is refused with DISABLED: its pulses are not checked."""
    judging: list[Any] = []

    @patch.around(Controller, "accept")
    def note(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
        judging[:] = [self]
        original(self, packet, door, *rest)

    @patch.around(controller, "unpack")
    def unpack(original: Any, data: bytes) -> Any:
        try:
            return original(data)
        except BlockError as error:
            if error.reason == Reason.PULSE and data[KIND] == Kind.UPDATE and judging[0]._device.state not in ENABLED:
                raise BlockError("the outputs are not enabled", Reason.DISABLED) from None
            raise


@mutant("ACK-003", wraps=(Admission, "judge"))
def numbers_are_judged_before_the_state(original: Any, self: Any, block: Any, *rest: Any) -> None:
    """A change with an old number is refused with SEQUENCE while the outputs are off: numbers are compared first."""
    last = self._device.last_sequence
    if not block.restart and last is not None and not follows(block.sequence, last):
        raise BlockError("the number does not follow", Reason.SEQUENCE)
    original(self, block, *rest)


@mutant("ACK-003", wraps=(Admission, "_judge_numbers"))
def contents_of_the_stores_are_judged_before_the_drive(original: Any, self: Any, block: Any, arrived: int) -> None:
    """A SLOT that is in use and too strong is refused with IN_USE: use is checked before the drive."""
    if isinstance(block.body, Slot):
        self._dispatch.stores.check_free(block.body, self._dispatch.period)
    original(self, block, arrived)


@mutant("ACK-003", "USB-017", wraps=(controller, "unpack"))
def short_block_is_filled_up(original: Any, data: Any) -> Any:
    """A block that ends early is judged as if zeros followed: they come from the cleared buffer."""
    return original(bytes(data).ljust(BLOCK_BYTES, b"\0"))


# Effects of a refusal, and what must be accepted


@mutant("BLK-008", "BLK-022")
def refused_stores_are_kept(patch: Patch) -> None:
    """A store that is refused with DRIVE or IN_USE is kept all the same: it is written during the judgement."""

    def keep(controller: Any, body: Any) -> None:
        if isinstance(body, Slot | Entries | Samples):
            controller._execution._store(body)

    _when_contents_are_refused(patch, keep)


@mutant("BLK-008")
def refused_change_empties_the_queue(patch: Patch) -> None:
    """A change that is refused for what it would play empties the queue: the error path cleans up too much."""

    def drop(controller: Any, body: Any) -> None:
        if isinstance(body, admission.CHANGES):
            controller._dispatch.agenda.drop_queued(controller._dispatch.now)

    _when_contents_are_refused(patch, drop)


def _when_contents_are_refused(patch: Patch, then: Callable[[Any, Any], None]) -> None:
    """Do something, given the controller and the body, when a block is refused for what it would store or play."""
    judged: list[Any] = []

    @patch.around(Admission, "judge")
    def judge(original: Any, self: Any, block: Any, arrived: int) -> None:
        judged[:] = [block.body]
        original(self, block, arrived)

    @patch.around(Controller, "_refuse")
    def refuse(original: Any, self: Any, error: Any, what: str) -> None:
        original(self, error, what)
        if error.reason in CONTENTS:
            then(self, judged[0])


@mutant("SAF-002", wraps=(Admission, "_judge_state"))
def stores_are_refused_while_disabled(original: Any, self: Any, body: Any) -> None:
    """Stores need enabled outputs: SLOT, ENTRIES and SAMPLES are refused with DISABLED as changes are."""
    original(self, body)
    if isinstance(body, Slot | Entries | Samples) and self._device.state not in ENABLED:
        raise BlockError("the outputs are not enabled", Reason.DISABLED)


@mutant("BLK-018", wraps=(Admission, "_judge_stores"))
def ending_no_modulation_is_refused(original: Any, self: Any, body: Any) -> None:
    """END_MODULATION without a modulation is refused with EMPTY: ending nothing counts as an error."""
    original(self, body)
    ends = isinstance(body, Output) and body.action is Action.END_MODULATION
    if ends and not self._dispatch.agenda.tail.modulated:
        raise BlockError("there is no modulation", Reason.EMPTY)


@mutant("BLK-018", "BLK-007", wraps=(Execution, "carry_out"))
def silence_overtakes_what_is_queued(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A SILENCE as soon as possible drops the queue, which only DISABLE may do: it was meant to be quick."""
    if isinstance(body, Output) and body.action is Action.SILENCE and not body.period:
        self._dispatch.agenda.drop_queued(self._dispatch.now)
    return original(self, body, door)


@mutant("BLK-018", by=misread_bodies)
def disabling_block_only_silences(body: Any) -> Any:
    """An OUTPUT with the action DISABLE leaves the outputs enabled: it takes the path of SILENCE."""
    is_disable = isinstance(body, Output) and body.action is Action.DISABLE
    return Output(Action.SILENCE, body.period) if is_disable else body
