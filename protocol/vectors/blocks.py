"""Vectors of pulses, blocks and their numbers (SPEC.md, chapters PUL, BLK and NUM)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..blocks import (
    AmplitudeModulation,
    Block,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    checksum,
    pack,
    pack_pulses,
)
from ..board import CHANNELS
from ..codes import BLOCK_BYTES, CHECKSUM_OFFSET, MODULATION_SAMPLES, SAMPLES_PER_BLOCK, Action, Reason
from ..numbering import follows, missing
from ..pulses import MODULATED_WIDTH, POWER, Pulses
from .cases import Section, section, vector

__all__ = ["MIXED", "SILENT", "block_numbers", "blocks", "modulated_widths", "powers", "pulse_pairs", "refused_blocks"]

LAST_PERIOD = 2**64 - 1
LAST_NUMBER = 2**32 - 1

SILENT = Pulses.silent(CHANNELS)
FULL = Pulses(np.zeros(CHANNELS, int), np.full(CHANNELS, 25))
MIXED = Pulses(7 * np.arange(CHANNELS) % 100, np.arange(CHANNELS) % 26)
TWO = Pulses([99, 1] + [0] * (CHANNELS - 2), [25, 2] + [0] * (CHANNELS - 2))


def pulse_pairs() -> Section:
    """Two pulses in three bytes."""
    pairs = {
        "specification": ("the example of PUL-005", (99, 25), (1, 2)),
        "silent": ("both silent", (0, 0), (0, 0)),
        "silent-with-phase": ("a phase means nothing at width 0, but is kept", (99, 0), (50, 0)),
        "largest": ("the largest values of both", (99, 25), (99, 25)),
        "low-half": ("only the first pulse: low byte, and the low half of the middle one", (85, 21), (0, 0)),
        "high-half": ("only the second pulse: the high half of the middle byte, and the last", (0, 0), (85, 21)),
        "round-the-end": ("both begin late in the period and end in the next", (1, 25), (0, 2)),
        "odd-and-even": ("phase and width of different parity: half a tick early", (50, 25), (51, 24)),
    }
    return section(
        "Two pulses in three bytes (PUL-005), here one by one: [phase in half ticks, width in ticks], and the tick at "
        "which each begins (PUL-004).",
        (
            vector(f"pair-{name}", shows, hex=pack_pulses(pulses), pulses=both, begins=pulses.start.tolist())
            for name, (shows, *both) in pairs.items()
            for pulses in [Pulses(*zip(*both, strict=True))]
        ),
    )


def modulated_widths() -> Section:
    """The table of PUL-006."""
    return section(
        "Under a modulation sample a pulse keeps its phase and gets another width (PUL-006): widths[w] is what width w "
        "becomes, for w from 0 to 25.",
        ({"sample": sample, "widths": widths.tolist()} for sample, widths in enumerate(MODULATED_WIDTH)),
    )


def powers() -> Section:
    """The table of SAF-006."""
    return section(
        "Power of a pulse in thousandths of that of the widest (SAF-006); the total drive is the sum over 320.",
        [
            *({"width": width, "power": int(power)} for width, power in enumerate(POWER)),
            vector("drive-full", "320 pulses of 25 ticks", pulses=FULL, total_drive=FULL.total_drive),
            vector("drive-mixed", "widths of every kind", pulses=MIXED, total_drive=MIXED.total_drive),
        ],
    )


BLOCKS: dict[str, tuple[str, Block]] = {
    "update-specification": ("the example of BLK-006", Block(Update(TWO, 1000), 7, restart=True)),
    "update-silence-now": ("all silent, as soon as possible", Block(Update(SILENT), 1)),
    "update-full-last": (
        "all at full width, in the last period there is, under the last number",
        Block(Update(FULL, LAST_PERIOD), LAST_NUMBER),
    ),
    "update-mixed": (
        "transducer n has phase 7n mod 100 and width n mod 26: order, packing and every value",
        Block(Update(MIXED, 0x0102030405060708), 0x11223344),
    ),
    "update-wrapped": ("number 0, which follows 2^32 - 1", Block(Update(TWO, 2**32), 0)),
    "slot-first": ("slot 0", Block(Slot(0, FULL), 2)),
    "slot-last": ("slot 255, and the numbering begins anew", Block(Slot(255, MIXED), 0x80000000, restart=True)),
    "entries-two": ("two steps at the head of the table", Block(Entries((Entry(0, 100), Entry(1, 100))), 3)),
    "entries-last": (
        "one step, in the last place, with the largest values",
        Block(Entries((Entry(255, 65535),), 1023), 4),
    ),
    "entries-full": (
        "120 steps, as many as a block holds, up to the end of the table",
        Block(Entries(tuple(Entry(n, 1 + n) for n in range(120)), 904), 5),
    ),
    "sequence-two": ("the two steps above, from period 1000 on, three times", Block(PlaySequence(0, 2, 1000, 3), 6)),
    "sequence-all": ("the whole table, as soon as possible, without end", Block(PlaySequence(0, 1024), 7)),
    "sequence-last": (
        "the last step, in the last period, as often as can be said",
        Block(PlaySequence(1023, 1, LAST_PERIOD, 65535), 8),
    ),
    "sequence-unattended": ("may go on without its host", Block(PlaySequence(0, 2, 1000, unattended=True), 9)),
    "sequence-both-flags": (
        "both flags at once",
        Block(PlaySequence(0, 2, 0, 1, unattended=True), 10, restart=True),
    ),
    "samples-three": ("three amplitudes", Block(Samples(bytes([0, 128, 255]), 0x0304), 11)),
    "samples-last": ("one amplitude in the last place; it may be 0", Block(Samples(bytes(1), 4095), 12)),
    "samples-full": (
        "480 amplitudes, as many as a block holds, up to the end of the buffer",
        Block(Samples(bytes(n % 256 for n in range(SAMPLES_PER_BLOCK)), MODULATION_SAMPLES - SAMPLES_PER_BLOCK), 13),
    ),
    "modulation-three": (
        "the three amplitudes above, for 40 periods each",
        Block(AmplitudeModulation(0x0304, 3, 40, 1000), 14),
    ),
    "modulation-all": (
        "the whole buffer, one period each, as soon as possible",
        Block(AmplitudeModulation(0, 4096, 1), 15),
    ),
    "modulation-last": (
        "the last amplitude, in the last period, held as long as can be said",
        Block(AmplitudeModulation(4095, 1, 65535, LAST_PERIOD), 16),
    ),
    "output-end-modulation": ("the modulation ends", Block(Output(Action.END_MODULATION, 1000), 17)),
    "output-silence": ("what plays ends, as soon as possible", Block(Output(Action.SILENCE), 18)),
    "output-disable": ("the outputs are disabled, in the last period", Block(Output(Action.DISABLE, LAST_PERIOD), 19)),
    "clock": ("asks for the time", Block(Clock(), 20)),
    "no-op": ("a sign of life", Block(NoOp(), 21)),
    "no-op-restart": ("how a host should begin a session: nothing but a new numbering", Block(NoOp(), 0, restart=True)),
}


def _fields(block: Block) -> dict[str, Any]:
    """What a block says, under the names of its fields; fields that its kind does not use are left out."""
    body = dict(vars(block.body))
    flags = ["RESTART"] * block.restart + ["UNATTENDED"] * body.pop("unattended", False)
    if isinstance(block.body, Slot):
        body["first"] = body.pop("number")
    for items in {"entries", "samples"} & set(body):
        body["count"] = len(body[items])
    return {"kind": block.body.KIND, "sequence": block.sequence, "flags": flags} | body


def blocks() -> Section:
    """Blocks that are valid, as far as that depends on nothing else."""
    return section(
        "Blocks that are valid in themselves (BLK). Fields have the names of BLK-002; those that are not named are 0. "
        "entries are [slot, periods].",
        (
            vector(name, shows, hex=pack(block), fields=_fields(block), reason=Reason.ACCEPTED)
            for name, (shows, block) in BLOCKS.items()
        ),
    )


def _changed(name: str, *changes: tuple[int, bytes]) -> bytes:
    """One of `BLOCKS` with other bytes at some offsets and the checksum that belongs to them."""
    data = bytearray(pack(BLOCKS[name][1]))
    for offset, octets in changes:
        data[offset : offset + len(octets)] = octets
    data[CHECKSUM_OFFSET : CHECKSUM_OFFSET + 4] = checksum(bytes(data)).to_bytes(4, "little")
    return bytes(data)


def _flipped(name: str, offset: int) -> bytes:
    data = bytearray(pack(BLOCKS[name][1]))
    data[offset] ^= 1
    return bytes(data)


MAGIC, VERSION, KIND, PERIOD, FIRST, COUNT, HOLD, REPEATS, RESERVED, FLAGS, ACTION, PAYLOAD, LAST = (
    *(0, 2, 3, 8, 16, 18, 20, 22, 24, 26, 27, 32, 511),
)
PULSE = {"phase-100": 100, "phase-127": 127, "width-26": 26 << 7, "width-31": 31 << 7}


def _u16(offset: int, value: int) -> tuple[int, bytes]:
    return offset, value.to_bytes(2, "little")


def _refusals() -> Iterator[tuple[str, str, Reason, str, bytes]]:
    """Name, what it shows, reason, clause that is broken, bytes."""
    update = pack(BLOCKS["update-specification"][1])
    for name, shows, data in (
        ("empty", "nothing at all", b""),
        ("seven", "too short even for a number: the acknowledgement repeats the three bytes of it", update[:7]),
        ("511", "one byte is missing", update[:-1]),
        ("513", "a valid block and one byte more", update + bytes(1)),
    ):
        yield f"length-{name}", shows, Reason.LENGTH, "BLK-001", data

    big_endian = update[:28] + update[31:27:-1] + update[32:]
    for name, shows, data in (
        ("payload", "the last bit of the payload is flipped", _flipped("update-mixed", LAST)),
        ("header", "a bit of the period is flipped", _flipped("update-mixed", PERIOD)),
        ("stated", "a bit of the checksum is flipped", _flipped("update-mixed", CHECKSUM_OFFSET)),
        ("big-endian", "the right checksum with its high byte first", big_endian),
        (
            "before-magic",
            "another magic under a wrong checksum: the checksum is judged first",
            _flipped("clock", MAGIC),
        ),
        ("zeros", "512 zeros", bytes(BLOCK_BYTES)),
    ):
        yield f"checksum-{name}", shows, Reason.CHECKSUM, "BLK-003", data

    other_magic, other_version = (MAGIC, b"PA"), (VERSION, bytes([2]))
    yield "magic-ack", "the magic of an acknowledgement", Reason.MAGIC, "BLK-002", _changed("clock", other_magic)
    yield (
        *("magic-before-version", "the magic is judged before the version", Reason.MAGIC, "BLK-002"),
        _changed("clock", other_magic, other_version),
    )
    for version in (0, 2, 255):
        data = _changed("clock", (VERSION, bytes([version])))
        yield f"version-{version}", f"version {version}", Reason.VERSION, "VER-002", data
    yield (
        *("version-before-kind", "the version is judged before the kind", Reason.VERSION, "VER-002"),
        _changed("clock", other_version, (KIND, bytes([0]))),
    )
    for kind in (0, 10, 255):
        yield f"kind-{kind}", f"kind {kind}", Reason.KIND, "BLK-004", _changed("clock", (KIND, bytes([kind])))

    for name, shows, clause, base, change in (
        ("period-in-slot", "a SLOT has no period", "BLK-011", "slot-last", _u16(PERIOD, 1)),
        ("period-in-clock", "a CLOCK has no period", "BLK-011", "clock", (PERIOD + 7, b"\x80")),
        ("first-in-update", "an UPDATE has no first", "BLK-011", "update-full-last", _u16(FIRST, 1)),
        ("count-in-slot", "a SLOT has no count", "BLK-011", "slot-last", _u16(COUNT, 1)),
        ("hold-in-sequence", "a SEQUENCE has no hold", "BLK-011", "sequence-two", _u16(HOLD, 1)),
        ("repeats-in-modulation", "a MODULATION has no repeats", "BLK-011", "modulation-three", _u16(REPEATS, 1)),
        ("reserved", "reserved bytes are 0", "BLK-002", "no-op", _u16(RESERVED, 0x0100)),
        ("action-in-update", "an UPDATE has no action", "BLK-011", "update-full-last", (ACTION, b"\x01")),
        ("unattended-update", "UNATTENDED in an UPDATE", "BLK-011", "update-full-last", (FLAGS, b"\x02")),
        ("unattended-modulation", "UNATTENDED in a MODULATION", "BLK-011", "modulation-three", (FLAGS, b"\x02")),
        ("flag-4", "a flag that does not exist", "BLK-011", "sequence-two", (FLAGS, b"\x04")),
        ("flag-128", "another, beside RESTART", "BLK-011", "no-op-restart", (FLAGS, b"\x81")),
        ("payload-of-clock", "a CLOCK has no payload", "BLK-011", "clock", (LAST, b"\x01")),
        ("payload-of-output", "an OUTPUT has no payload", "BLK-011", "output-silence", (PAYLOAD, b"\x01")),
        ("slot-256", "there are 256 slots", "BLK-013", "slot-last", _u16(FIRST, 256)),
        ("entries-none", "no entries at all", "BLK-011", "entries-last", _u16(COUNT, 0)),
        ("entries-121", "more than a block holds", "BLK-011", "entries-two", _u16(COUNT, 121)),
        (
            "entries-beyond",
            "120 entries from place 905 on: one lies after the table",
            "BLK-014",
            "entries-full",
            _u16(FIRST, 905),
        ),
        ("entries-behind", "a byte after the two entries", "BLK-011", "entries-two", (PAYLOAD + 8, b"\x01")),
        ("entry-slot-256", "an entry with slot 256", "BLK-014", "entries-two", _u16(PAYLOAD, 256)),
        ("entry-no-periods", "an entry that plays for no period", "BLK-014", "entries-two", _u16(PAYLOAD + 2, 0)),
        ("sequence-none", "no entries to play", "BLK-011", "sequence-two", _u16(COUNT, 0)),
        ("sequence-1025", "more than the table has", "BLK-011", "sequence-two", _u16(COUNT, 1025)),
        ("sequence-beyond", "1024 entries from place 1 on", "BLK-011", "sequence-all", _u16(FIRST, 1)),
        ("samples-none", "no samples at all", "BLK-011", "samples-last", _u16(COUNT, 0)),
        ("samples-481", "more than a block holds", "BLK-011", "samples-three", _u16(COUNT, SAMPLES_PER_BLOCK + 1)),
        ("samples-beyond", "two samples from place 4095 on", "BLK-016", "samples-last", _u16(COUNT, 2)),
        ("samples-behind", "a byte after the three samples", "BLK-011", "samples-three", (PAYLOAD + 3, b"\x01")),
        ("modulation-none", "no samples to play", "BLK-011", "modulation-three", _u16(COUNT, 0)),
        ("modulation-4097", "more than the buffer has", "BLK-011", "modulation-all", _u16(COUNT, 4097)),
        ("modulation-no-hold", "samples that hold for no period", "BLK-011", "modulation-three", _u16(HOLD, 0)),
        ("action-0", "an OUTPUT that does nothing", "BLK-018", "output-silence", (ACTION, b"\x00")),
        ("action-4", "an action that does not exist", "BLK-018", "output-silence", (ACTION, b"\x04")),
    ):
        yield f"field-{name}", shows, Reason.FIELD, clause, _changed(base, change)
    yield (
        *("field-before-pulse", "a field is judged before the pulses", Reason.FIELD, "BLK-013"),
        _changed("slot-first", _u16(FIRST, 256), _u16(PAYLOAD, PULSE["phase-100"])),
    )

    for name, word in PULSE.items():
        shows = f"the first pulse has {name.replace('-', ' ')}"
        yield f"pulse-{name}", shows, Reason.PULSE, "PUL-001", _changed("update-silence-now", _u16(PAYLOAD, word))
    last = (LAST - 1, (PULSE["width-26"] << 4).to_bytes(2, "little"))
    yield "pulse-last", "the last of 320 pulses", Reason.PULSE, "PUL-001", _changed("update-silence-now", last)
    in_slot = _u16(PAYLOAD, PULSE["phase-100"])
    yield "pulse-in-slot", "a silent pulse of a SLOT", Reason.PULSE, "PUL-001", _changed("slot-first", in_slot)


def refused_blocks() -> Section:
    """Blocks that every device refuses."""
    return section(
        "Blocks that every device refuses, whatever its state, with the reason of ACK-003 and its number. If the "
        "checksum is not what is wrong it is right.",
        (
            vector(f"refused-{name}", shows, hex=data, reason=reason, code=reason.value, clause=clause)
            for name, shows, reason, clause, data in _refusals()
        ),
    )


NUMBERS = {
    "next": (7, 8),
    "same": (7, 7),
    "before": (8, 7),
    "one-missing": (7, 9),
    "wrapped": (LAST_NUMBER, 0),
    "wrapped-back": (0, LAST_NUMBER),
    "wrapped-three-missing": (LAST_NUMBER - 1, 2),
    "farthest": (0, 2**31 - 1),
    "opposite": (0, 2**31),
    "opposite-back": (2**31, 0),
    "just-behind": (0, 2**31 + 1),
    "farthest-wrapped": (0x8000_0001, 0),
}


def block_numbers() -> Section:
    """What becomes of a number after another."""
    return section(
        "Number of a block after that of the last accepted one (NUM-002, NUM-003): whether it follows, and how many "
        "were left out, which the acknowledgement flags with GAP if it is not 0.",
        (
            vector(
                f"number-{name}",
                f"{number} after {last}",
                last=last,
                number=number,
                follows=follows(number, last),
                missing=missing(number, last) if follows(number, last) else None,
            )
            for name, (last, number) in NUMBERS.items()
        ),
    )
