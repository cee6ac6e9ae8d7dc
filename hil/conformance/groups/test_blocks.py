"""Blocks: their form, acceptance, refusal and reasons (chapters PUL, BLK and ACK)."""

from __future__ import annotations

import zlib
from collections.abc import Collection

import pytest
from phasewire.emulator.faults import HotBoard
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, Risk, case, expect
from phasewire.hil.conformance.sight.waveforms import check_play, expected_words, modulated, only
from phasewire.hil.conformance.tools.examples import example
from phasewire.hil.conformance.tools.forge import FIELDS, forged, seal
from phasewire.hil.conformance.tools.player import Player, in_time
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    SILENT,
    Wrong,
    await_state,
    begin,
    enable,
    far,
    features_of,
    forge,
    heavy,
    known,
    late_phase,
    later,
    let_stores_go,
    packed,
    refuse,
    require,
    some,
    vectors,
)
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Block,
    Body,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
    unpack,
)
from phasewire.protocol.board import CHANNELS
from phasewire.protocol.codes import (
    BLOCK_BYTES,
    ENTRIES_PER_BLOCK,
    HEADER_BYTES,
    MODULATION_SAMPLES,
    PAYLOAD_BYTES,
    SAMPLES_PER_BLOCK,
    SEQUENCE_ENTRIES,
    SLOTS,
    Action,
    Feature,
    Kind,
    Reason,
    Request,
    State,
)

VALID: dict[Kind, Body] = {
    Kind.UPDATE: Update(SILENT),
    Kind.SLOT: Slot(3, SILENT),
    Kind.ENTRIES: Entries((Entry(3, 100), Entry(3, 50)), 10),
    Kind.SEQUENCE: PlaySequence(10, 2),
    Kind.SAMPLES: Samples(b"\x80\xff\x01", 20),
    Kind.MODULATION: AmplitudeModulation(20, 3, 5),
    Kind.OUTPUT: Output(Action.SILENCE),
    Kind.CLOCK: Clock(),
    Kind.NO_OP: NoOp(),
}
"""A valid block of each kind; none of them is audible."""
STORES = Feature.SEQUENCES | Feature.MODULATION
CHANGES = (Kind.UPDATE, Kind.SEQUENCE, Kind.MODULATION, Kind.OUTPUT)

USED = {
    Kind.UPDATE: ("period",),
    Kind.SLOT: ("first",),
    Kind.ENTRIES: ("first", "count"),
    Kind.SEQUENCE: ("period", "first", "count", "repeats"),
    Kind.SAMPLES: ("first", "count"),
    Kind.MODULATION: ("period", "first", "count", "hold"),
    Kind.OUTPUT: ("period", "action"),
    Kind.CLOCK: (),
    Kind.NO_OP: (),
}
"""Which fields each kind uses (clause BLK-011)."""
BY_KIND = ("period", "first", "count", "hold", "repeats", "reserved", "action")
PAYLOAD_USED = {Kind.UPDATE: PAYLOAD_BYTES, Kind.SLOT: PAYLOAD_BYTES, Kind.ENTRIES: 8, Kind.SAMPLES: 3}
"""Bytes of the payload that the block of `VALID` uses; 0 for kinds not listed."""

BEYOND: dict[Kind, list[dict[str, int]]] = {
    Kind.SLOT: [{"first": SLOTS}, {"first": 0x0300}, {"first": 65_535}],
    Kind.ENTRIES: [
        {"first": SEQUENCE_ENTRIES - ENTRIES_PER_BLOCK + 1, "count": ENTRIES_PER_BLOCK},
        {"first": SEQUENCE_ENTRIES - 1, "count": 2},
        {"first": SEQUENCE_ENTRIES, "count": 1},
        {"first": 65_535, "count": 1},
        {"count": 0},
        {"count": ENTRIES_PER_BLOCK + 1},
        {"count": 65_535},
        {"first": 65_535, "count": 65_535},
    ],
    Kind.SEQUENCE: [
        {"first": 1, "count": SEQUENCE_ENTRIES},
        {"first": SEQUENCE_ENTRIES - 1, "count": 2},
        {"first": SEQUENCE_ENTRIES, "count": 1},
        {"first": 65_535, "count": 2},
        {"first": 0, "count": SEQUENCE_ENTRIES + 1},
        {"first": 0, "count": 65_535},
        {"count": 0},
    ],
    Kind.SAMPLES: [
        {"first": MODULATION_SAMPLES - SAMPLES_PER_BLOCK + 1, "count": SAMPLES_PER_BLOCK},
        {"first": MODULATION_SAMPLES - 1, "count": 2},
        {"first": MODULATION_SAMPLES, "count": 1},
        {"first": 65_535, "count": 2},
        {"first": 0, "count": SAMPLES_PER_BLOCK + 1},
        {"first": 0, "count": 65_535},
        {"count": 0},
    ],
    Kind.MODULATION: [
        {"first": 1, "count": MODULATION_SAMPLES},
        {"first": MODULATION_SAMPLES - 1, "count": 2},
        {"first": MODULATION_SAMPLES, "count": 1},
        {"first": 65_535, "count": 2},
        {"first": 0, "count": MODULATION_SAMPLES + 1},
        {"first": 0, "count": 65_535},
        {"count": 0},
        {"hold": 0},
    ],
    Kind.OUTPUT: [{"action": action} for action in (0, 4, 5, 7, 8, 16, 32, 64, 127, 128, 129, 130, 131, 254, 255)],
}
"""Fields out of their range, by kind (clauses BLK-011 and BLK-018)."""

WITHIN: dict[Kind, list[dict[str, int]]] = {
    Kind.UPDATE: [{"period": 0}, {"period": 1}],
    Kind.SLOT: [{"first": 0}, {"first": 255}],
    Kind.ENTRIES: [
        {"first": 0, "count": 1},
        {"first": 0, "count": 120},
        {"first": 904, "count": 120},
        {"first": 1023, "count": 1},
    ],
    Kind.SEQUENCE: [
        {"first": 0, "count": 1024},
        {"first": 1023, "count": 1, "repeats": 65_535},
        {"first": 1, "count": 1023, "repeats": 1},
        {"first": 0, "count": 1},
    ],
    Kind.SAMPLES: [
        {"first": 0, "count": 1},
        {"first": 0, "count": SAMPLES_PER_BLOCK},
        {"first": MODULATION_SAMPLES - SAMPLES_PER_BLOCK, "count": SAMPLES_PER_BLOCK},
        {"first": 4095, "count": 1},
    ],
    Kind.MODULATION: [
        {"first": 0, "count": 4096, "hold": 1},
        {"first": 4095, "count": 1, "hold": 65_535},
        {"first": 1, "count": 4095, "hold": 2},
    ],
    Kind.OUTPUT: [{"action": 1}, {"action": 2}, {"action": 3}],
}
"""Fields at the ends of their ranges, by kind."""

CHECKSUM = 28
"""The offset of the version (clause BLK-002)."""

by_kind = pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.name.lower().replace("_", "-"))


def kinds(table: Collection[Kind]) -> pytest.MarkDecorator:
    """A case for each kind in a table."""
    return pytest.mark.parametrize("kind", list(table), ids=lambda kind: kind.name.lower())


def described(fields: dict[str, int]) -> str:
    """Fields for a message."""
    return ", ".join(f"{name} {value}" for name, value in fields.items())


# Form


@case("BLK-002", "BLK-006", "PUL-005")
def test_the_example_of_the_specification_plays(bench: Bench) -> None:
    """The block that clause BLK-006 prints byte for byte is accepted and plays: all others are built like it."""
    block = example("UPDATE")
    enable(bench)
    (ack,) = bench.send_raw(block)
    expect("the reason", ack.reason, Reason.ACCEPTED)
    expect("whether it is late", ack.late, ack.commit_period > 1000)
    if Feature.READ_BACK in bench.info.features:
        bench.wait_until(ack.commit_period)
        expect("PULSES", bench.ask(Request.PULSES)[16:], block[32:])


@case("BLK-003", "ACK-003")
def test_a_flipped_bit_is_refused(bench: Bench) -> None:
    """A block with one flipped bit is refused with CHECKSUM and has no other effect: damaged pulses must not play."""
    begin(bench)
    payload = [bench.random.randrange(8 * HEADER_BYTES, 8 * BLOCK_BYTES) for _ in range(48)]
    header = [8 * offset + bench.random.randrange(8 * size) for offset, size in FIELDS.values()]
    bits = [*header, *range(8 * CHECKSUM, 8 * CHECKSUM + 32), 8 * HEADER_BYTES, 8 * BLOCK_BYTES - 1, *payload]
    wrong, pulses = [], bench.weak()
    for bit in some(bench, bits):
        block = bytearray(pack(bench.numbered(Update(pulses))))
        block[bit // 8] ^= 1 << bit % 8
        wrong.append(Wrong(f"bit {bit % 8} of byte {bit // 8} flipped", bytes(block), Reason.CHECKSUM))
    refuse(bench, wrong)


@case("BLK-003")
def test_another_checksum_is_refused(bench: Bench) -> None:
    """Checksums that are nearly the CRC-32 of BLK-003 are refused, because their sender is broken."""
    begin(bench)
    block = pack(bench.numbered(Update(bench.weak())))
    right = int.from_bytes(block[CHECKSUM : CHECKSUM + 4], "little")
    checksums = {
        "the bytes of the checksum in reverse order": int.from_bytes(right.to_bytes(4, "little"), "big"),
        "the checksum inverted": right ^ 0xFFFFFFFF,
        "a checksum with only its low half right": right ^ 0xFFFF0000,
        "a checksum with only its high half right": right ^ 0x0000FFFF,
        "the checksum of the block without the four bytes": zlib.crc32(block[:CHECKSUM] + block[CHECKSUM + 4 :]),
        "the checksum of a block with FF in the four bytes": zlib.crc32(
            block[:CHECKSUM] + b"\xff" * 4 + block[CHECKSUM + 4 :]
        ),
        "the checksum of the header alone": zlib.crc32(block[:CHECKSUM] + bytes(4)),
        "the checksum of the payload alone": zlib.crc32(block[32:]),
        "the Adler-32 of zlib": zlib.adler32(block[:CHECKSUM] + bytes(4) + block[CHECKSUM + 4 :]),
        "no checksum": 0,
    }
    wrong = [
        Wrong(what, forged(block, checksum=value), Reason.CHECKSUM) for what, value in some(bench, checksums.items())
    ]
    refuse(bench, wrong)


@case("BLK-002", "ACK-003")
def test_another_magic_is_refused(bench: Bench) -> None:
    """A block that does not begin with "PW" is refused with MAGIC, even if its checksum is right."""
    begin(bench)
    magics = [b"PA", b"PS", b"WP", b"pw", b"P\0", b"\0W", bytes(2), b"\xff\xff", b"PV", b"QW"]
    wrong = [
        Wrong(f"magic {magic.hex()}", forge(bench, NoOp(), magic=int.from_bytes(magic, "little")), Reason.MAGIC)
        for magic in some(bench, magics)
    ]
    refuse(bench, wrong)


@case("BLK-004", "ACK-003")
def test_an_unknown_kind_is_refused(bench: Bench) -> None:
    """Every kind except the nine is refused with KIND, because it has no meaning."""
    begin(bench)
    unknown = [kind for kind in range(256) if not 1 <= kind <= 9]
    wrong = [Wrong(f"kind {kind}", forge(bench, NoOp(), kind=kind), Reason.KIND) for kind in some(bench, unknown)]
    refuse(bench, wrong)


@case("VER-002", "ACK-003")
def test_a_version_that_nobody_speaks_is_refused(bench: Bench) -> None:
    """A block of a version that INFO does not name is refused with VERSION, because its rules are unknown."""
    begin(bench)
    unspoken = [version for version in range(256) if not bench.info.speaks(version)]
    wrong = [
        Wrong(f"version {version}", forge(bench, NoOp(), version=version), Reason.VERSION)
        for version in some(bench, unspoken)
    ]
    refuse(bench, wrong)


# Fields


@case("BLK-011", "BLK-008")
@by_kind
def test_an_unused_field_must_be_zero(bench: Bench, kind: Kind) -> None:
    """A field that the kind does not use is refused with FIELD if any of its bytes is not 0."""
    begin(bench)
    wrong = []
    for name in BY_KIND:
        if name in USED[kind]:
            continue
        size = FIELDS[name][1]
        for value in (1, *(bench.random.randrange(1, 256) << 8 * byte for byte in range(size)), 1 << 8 * size - 1):
            block = forge(bench, VALID[kind], **{name: value})
            wrong.append(Wrong(f"{name} {value} in {kind.name}", block, Reason.FIELD))
    refuse(bench, some(bench, wrong))


@case("BLK-011", "BLK-008")
@kinds([kind for kind in Kind if kind not in (Kind.UPDATE, Kind.SLOT)])
def test_unused_payload_must_be_zero(bench: Bench, kind: Kind) -> None:
    """An unused byte of the payload is refused with FIELD if it is not 0, at any place."""
    begin(bench)
    used = PAYLOAD_USED.get(kind, 0)
    wrong = []
    for place in [used, used + 1, PAYLOAD_BYTES - 1, *(bench.random.randrange(used, PAYLOAD_BYTES) for _ in range(20))]:
        value = bench.random.randrange(1, 256)
        block = bytearray(pack(bench.numbered(VALID[kind])))
        block[32 + place] = value
        wrong.append(Wrong(f"byte {place} of the payload {value} in {kind.name}", seal(bytes(block)), Reason.FIELD))
    refuse(bench, some(bench, wrong))


@case("BLK-011")
@by_kind
def test_flags_that_do_not_belong_are_refused(bench: Bench, kind: Kind) -> None:
    """RESTART is valid in every kind and UNATTENDED only in SEQUENCE; any other flag is refused with FIELD."""
    begin(bench)
    known = 0b11 if kind is Kind.SEQUENCE else 0b01
    flags = [1 << bit for bit in range(8)] + [1 << bit | 1 for bit in range(1, 8)] + [0xFF]
    wrong = [
        Wrong(f"flags {flag:08b} in {kind.name}", forge(bench, VALID[kind], flags=flag), Reason.FIELD)
        for flag in some(bench, [flag for flag in flags if flag & ~known])
    ]
    refuse(bench, wrong)


@case("BLK-011", "NUM-004")
@by_kind
def test_restart_may_be_set_in_every_kind(bench: Bench, kind: Kind) -> None:
    """A block of any kind may have RESTART and is accepted as without it."""
    require(bench, features_of(VALID[kind]))
    begin(bench)
    if kind in (Kind.SEQUENCE, Kind.MODULATION):
        fill_stores(bench)
    (ack,) = bench.send_raw(forge(bench, VALID[kind], flags=1))
    expect(f"the reason for {kind.name} with RESTART", ack.reason, Reason.ACCEPTED)


@case("BLK-011", "BLK-008")
@kinds(BEYOND)
def test_a_field_out_of_its_range_is_refused(bench: Bench, kind: Kind) -> None:
    """A slot, place, count, hold or action out of the kind's range is refused with FIELD, even by one."""
    begin(bench)
    wrong = [
        Wrong(f"{described(fields)} in {kind.name}", forge(bench, VALID[kind], **fields), Reason.FIELD)
        for fields in some(bench, BEYOND[kind])
    ]
    refuse(bench, wrong)


@case("BLK-011")
@kinds(WITHIN)
def test_a_field_at_the_end_of_its_range_is_accepted(bench: Bench, kind: Kind) -> None:
    """The largest and smallest values that the kind allows are accepted, because a host may use the whole range."""
    require(bench, features_of(VALID[kind]))
    begin(bench)
    if kind in (Kind.SEQUENCE, Kind.MODULATION):
        fill_stores(bench)
    for fields in WITHIN[kind]:
        if fields.get("action") == Action.END_MODULATION and Feature.MODULATION not in bench.info.features:
            continue
        full = {Kind.ENTRIES: bytes([3, 0, 1, 0]) * ENTRIES_PER_BLOCK, Kind.SAMPLES: b"\x80" * SAMPLES_PER_BLOCK}
        payload = full.get(kind, b"")
        size = 4 if kind is Kind.ENTRIES else 1
        block = pack(bench.numbered(VALID[kind]))[:HEADER_BYTES].ljust(BLOCK_BYTES, b"\0")
        (ack,) = bench.send_raw(forged(block, payload[: size * fields.get("count", 0)], **fields))
        expect(f"the reason for {kind.name} with {described(fields)}", ack.reason, Reason.ACCEPTED)
        if kind in CHANGES:
            now = ack.now_period
            assert ack.commit_period > now, f"commit_period {ack.commit_period} should be after {now}"
        else:
            expect("commit_period of a block that is no change", ack.commit_period, 0)


def fill_stores(bench: Bench) -> None:
    """Store every entry, each of a silent slot, and every sample."""
    bodies: list[Body] = [
        Slot(3, SILENT),
        *(
            Entries((Entry(3, 1 + first % 7),) * min(ENTRIES_PER_BLOCK, SEQUENCE_ENTRIES - first), first)
            for first in range(0, SEQUENCE_ENTRIES, ENTRIES_PER_BLOCK)
        ),
        *(
            Samples(b"\x80" * min(SAMPLES_PER_BLOCK, MODULATION_SAMPLES - first), first)
            for first in range(0, MODULATION_SAMPLES, SAMPLES_PER_BLOCK)
        ),
    ]
    for body in known(bench, *bodies):
        bench.must(body)


@case("BLK-014", "BLK-011", "BLK-008")
def test_an_entry_that_cannot_be_is_refused(bench: Bench) -> None:
    """An entry with a slot above 255 or with 0 periods is refused with FIELD at any place among valid ones."""
    begin(bench)
    wrong = []
    for place in (0, 1, 59, 118, 119):
        for slot, periods in ((256, 1), (0x0103, 1), (0x8000, 1), (65_535, 65_535), (0, 0), (255, 0)):
            entries = [(number, 1 + number) for number in range(120)]
            entries[place] = (slot, periods)
            payload = b"".join(slot.to_bytes(2, "little") + periods.to_bytes(2, "little") for slot, periods in entries)
            block = forge(bench, VALID[Kind.ENTRIES], payload, first=0, count=120)
            what = f"entry {place} with slot {slot} for {periods} periods"
            wrong.append(Wrong(what, block, Reason.FIELD))
    refuse(bench, some(bench, wrong))


# Pulses


@case("PUL-001", "BLK-008")
@kinds([Kind.UPDATE, Kind.SLOT])
def test_a_reserved_pulse_is_refused(bench: Bench, kind: Kind) -> None:
    """Phases above 99 and widths above 25 are refused with PULSE at any place, even in silent pulses."""
    begin(bench)
    places = [0, 1, 2, 3, CHANNELS - 2, CHANNELS - 1]
    reserved = [(phase, bench.random.choice([0, 1, 2])) for phase in range(100, 128)]
    reserved += [(bench.random.choice([0, 99]), width) for width in range(26, 32)]
    wrong = []
    for number, (phase, width) in enumerate([*reserved, (127, 31), (100, 0), (100, 0), (0, 26), (0, 26)]):
        place = (
            places[number] if number < len(places) else bench.random.choice([*places, bench.random.randrange(CHANNELS)])
        )
        payload = packed([(0, 0)] * place + [(phase, width)])
        block = forge(bench, VALID[kind], payload)
        wrong.append(Wrong(f"pulse {place} with phase {phase} and width {width}", block, Reason.PULSE))
    refuse(bench, some(bench, wrong))


@case("PUL-001", "PUL-002", "PUL-005", "REQ-007", features=Feature.READ_BACK)
def test_every_phase_and_every_width_is_accepted(bench: Bench) -> None:
    """All phases from 0 to 99 and all widths from 0 to 25 are accepted, play at their places, and are read back."""
    begin(bench)
    pulses = [(number % 100, number if number < 26 else 0) for number in range(CHANNELS)]
    bench.random.shuffle(pulses)
    payload = packed(pulses)
    (ack,) = bench.send_raw(forge(bench, VALID[Kind.UPDATE], payload))
    expect("the reason", ack.reason, Reason.ACCEPTED)
    bench.wait_until(ack.commit_period)
    expect("PULSES", bench.ask(Request.PULSES)[16:], payload)


# The order of reasons

REASONS_OF = {
    "update": (Reason.PULSE, Reason.SEQUENCE, Reason.HORIZON, Reason.RATE, Reason.DRIVE),
    "slot": (Reason.PULSE, Reason.SEQUENCE, Reason.DRIVE, Reason.IN_USE),
    "sequence": (Reason.SEQUENCE, Reason.HORIZON, Reason.DRIVE, Reason.EMPTY),
    "modulation": (Reason.SEQUENCE, Reason.HORIZON, Reason.EMPTY),
    "output": (Reason.SEQUENCE, Reason.HORIZON),
}
"""What can be wrong with a block of one kind, beyond what can be wrong with any block."""
BASES: dict[str, Body] = {"update": Update(SILENT), "slot": Slot(0, SILENT), "output": Output(Action.SILENCE)}
ANY = (Reason.CHECKSUM, Reason.MAGIC, Reason.VERSION, Reason.KIND, Reason.FIELD)
LAST_PERIOD = 2**64 - 1
LOW_LIMIT = 1
"""The transducers that may be driven in the cases on the order of reasons; driving two fully gives DRIVE."""
HEAVY_SLOT, EMPTY_SLOT, USED_SLOT, GOOD_SLOT = 0, 1, 2, 3
ENTRY_SLOTS = (HEAVY_SLOT, EMPTY_SLOT, GOOD_SLOT, USED_SLOT)
"""In the entries at the head of the table."""


class Provocation:
    """A device prepared so that one block can break several rules at once, and such blocks."""

    def __init__(self, bench: Bench, enabled: bool) -> None:
        self._bench = bench
        bench.order(Request.WATCHDOG, LONG_MS)
        self._last = bench.must(NoOp()).sequence
        self._named = 0
        stores: list[Body] = [Slot(HEAVY_SLOT, heavy(2)), Slot(USED_SLOT, SILENT), Slot(GOOD_SLOT, SILENT)]
        stores += [Entries(tuple(Entry(slot, 1000) for slot in ENTRY_SLOTS)), Samples(b"\xff", 0)]
        self._must(*stores)
        bench.order(Request.LIMIT, LOW_LIMIT)
        if not enabled:
            return
        bench.enable()
        self._named = far(bench)
        changes = self._must(PlaySequence(3, 1, self._named - 10), Update(SILENT, self._named))
        let_stores_go(bench, changes)

    def _must(self, *bodies: Body) -> int:
        """Send those blocks for which the device has the features; returns their number."""
        sent = known(self._bench, *bodies)
        for body in sent:
            self._last = self._bench.must(body).sequence
        return len(sent)

    def block(self, base: str, reasons: Collection[Reason]) -> bytes:
        """A block of a kind that is wrong in all these ways."""
        body = self._body(base, reasons)
        number = self._last if Reason.SEQUENCE in reasons else (self._last + 1) % 2**32
        data = bytearray(pack(Block(body, number)))
        if Reason.PULSE in reasons:
            data[32] |= 0x7F
        fields = {
            Reason.FIELD: {"reserved": 1},
            Reason.KIND: {"kind": 200},
            Reason.VERSION: {"version": (self._bench.info.newest_version + 1) % 256},
            Reason.MAGIC: {"magic": 0x4150},
        }
        wrong = {name: value for reason in reasons for name, value in fields.get(reason, {}).items()}
        block = bytearray(forged(bytes(data), None, **wrong))
        block[CHECKSUM] ^= Reason.CHECKSUM in reasons
        return bytes(block)

    def _body(self, base: str, reasons: Collection[Reason]) -> Body:
        pulses = heavy(LOW_LIMIT + 1) if Reason.DRIVE in reasons else SILENT
        period = LAST_PERIOD if Reason.HORIZON in reasons else 0
        match base:
            case "update":
                return Update(pulses, self._named + 1 if Reason.RATE in reasons else period)
            case "slot":
                return Slot(USED_SLOT if Reason.IN_USE in reasons else GOOD_SLOT, pulses)
            case "sequence":
                first = 0 if Reason.DRIVE in reasons else 1 if Reason.EMPTY in reasons else 2
                return PlaySequence(first, 1 + ({Reason.DRIVE, Reason.EMPTY} <= {*reasons}), period)
            case "modulation":
                return AmplitudeModulation(4000 if Reason.EMPTY in reasons else 0, 1, 1, period)
        return Output(Action.SILENCE, period)

    def check(self, base: str, reasons: Collection[Reason], state: Collection[Reason]) -> None:
        """Each reason alone, each pair, and each with all later ones: the device must give the first.

        With the reasons of its state every block of this kind is refused now.
        """
        bench, possible = self._bench, sorted(reasons)
        if bench.info.periods_per_update == 1:
            possible = [reason for reason in possible if reason is not Reason.RATE]
        sets = [set[Reason]()] if state else []
        sets += [{one} for one in possible]
        sets += [{one, other} for one in possible for other in possible if one < other]
        sets += [{*possible[at:]} for at in range(len(possible) - 2)]
        together = [chosen for chosen in sets if not {Reason.HORIZON, Reason.RATE} <= chosen]
        wrong = []
        for chosen in some(bench, together, 8):
            what = " and ".join(reason.name for reason in sorted(chosen | {*state}))
            wrong.append(Wrong(f"{base} with {what}", self.block(base, chosen), min(chosen | {*state})))
        refuse(bench, wrong)


@case("ACK-003", "BLK-008", "SAF-006", "BLK-023")
@pytest.mark.parametrize("base", ["update", "slot", "output"])
def test_the_first_reason_is_given_while_enabled(bench: Bench, base: str) -> None:
    """If several things are wrong with a block, its reason is the first in the order of ACK-003."""
    require(bench, features_of(BASES[base]))
    Provocation(bench, enabled=True).check(base, (*ANY, *REASONS_OF[base]), ())


@case("ACK-003", "BLK-008", "SAF-002")
@pytest.mark.parametrize("base", ["update", "output"])
def test_the_first_reason_is_given_while_disabled(bench: Bench, base: str) -> None:
    """The same while the outputs are off: DISABLED comes after what is wrong with the block, and before the rest."""
    reasons = [*ANY, *(reason for reason in REASONS_OF[base] if reason is not Reason.RATE)]
    Provocation(bench, enabled=False).check(base, reasons, (Reason.DISABLED,))


@case("ACK-003", "BLK-021", "BLK-008", allow=(Risk.RESET,), features=STORES)
@pytest.mark.parametrize("enabled", [True, False], ids=["enabled", "disabled"])
@pytest.mark.parametrize("base", ["sequence", "modulation"])
def test_the_first_reason_is_given_for_what_plays_stores(bench: Bench, base: str, enabled: bool) -> None:
    """The same for blocks that play stored data, part of which was never stored or drives too much."""
    bench.restart(lambda: bench.order(Request.RESET))  # nothing is stored then
    state = () if enabled else (Reason.DISABLED,)
    Provocation(bench, enabled).check(base, (*ANY, *REASONS_OF[base]), state)


@case("ACK-003", "SAF-007/1", "BLK-008", needs=(Need.FAULTS,))
@pytest.mark.parametrize("base", ["update", "slot", "output"])
def test_the_first_reason_is_given_with_a_fault(bench: Bench, base: str) -> None:
    """The same while a fault silences the outputs: FAULT comes after what is wrong with the block."""
    require(bench, features_of(BASES[base]))
    provocation = Provocation(bench, enabled=False)
    bench.levers.cause(HotBoard(board=2, celsius=95))
    await_state(bench, State.FAULT)
    reasons = [reason for reason in REASONS_OF[base] if reason not in (Reason.RATE, Reason.IN_USE)]
    provocation.check(base, (*ANY, *reasons), (Reason.FAULT, Reason.DISABLED))
    bench.levers.cause(HotBoard(board=2, celsius=30))
    bench.wait(0.03)


# Golden vectors


@case("ACK-003", "BLK-008")
@pytest.mark.parametrize("enabled", [True, False], ids=["enabled", "disabled"])
def test_the_refused_blocks_of_the_vectors_are_refused(bench: Bench, enabled: bool) -> None:
    """The blocks of vectors.json that every device refuses are refused in any state, with the reason given there."""
    if enabled:
        begin(bench)
    wrong = [
        Wrong(vector["name"], bytes.fromhex(vector["hex"]), Reason[vector["reason"]])
        for vector in vectors("refused_blocks")
        if vector["reason"] != "LENGTH"
    ]
    spoken = range(2, bench.info.newest_version + 1)
    refuse(bench, some(bench, [one for one in wrong if one.block[2] not in spoken or one.reason < Reason.VERSION]))


@case("BLK-002", "BLK-011", "SAF-002", "SAF-006")
def test_the_valid_blocks_of_the_vectors_are_refused_for_their_state_only(bench: Bench) -> None:
    """A device that is off accepts the valid blocks of vectors.json that are no changes, stores within the limit."""
    limit = 1000 * bench.status().drive_limit
    for vector in some(bench, vectors("blocks"), 8):
        block, fields = bytes.fromhex(vector["hex"]), vector["fields"]
        body = unpack(block).body
        drives = body.pulses.total_drive if isinstance(body, Update | Slot) else 0
        if drives > 1000 * bench.drive_limit and Risk.DRIVE not in bench.allowed:
            continue
        bench.must(NoOp(), number=(fields["sequence"] - 1) % 2**32, restart=True)
        (ack,) = bench.send_raw(block)
        missing = features_of(body) & ~bench.info.features
        wanted = Reason.UNSUPPORTED if missing else _reason_while_off(fields, limit)
        expect(f"the reason for {vector['name']}", ack.reason, wanted)
        expect(f"commit_period for {vector['name']}", ack.commit_period if fields["kind"] != "CLOCK" else 0, 0)


def _reason_while_off(fields: dict[str, object], limit: int) -> Reason:
    if fields["kind"] in ("UPDATE", "SEQUENCE", "MODULATION", "OUTPUT"):
        return Reason.DISABLED
    power = {row["width"]: row["power"] for row in vectors("powers") if "width" in row}
    runs = fields["pulses"] if fields["kind"] == "SLOT" else []
    assert isinstance(runs, list)
    return Reason.DRIVE if sum(power[width] * count for _, width, count in runs) > limit else Reason.ACCEPTED


# What a refusal leaves unchanged


@case("BLK-008", "BLK-003", "VER-002", outputs=("BLK-008",), features=STORES)
@pytest.mark.parametrize("plays", ["update", "sequence"])
def test_refused_blocks_leave_what_plays_and_waits(bench: Bench, plays: str) -> None:
    """While a modulated update plays and another waits, refused blocks of all kinds do not change the outputs."""
    begin(bench)
    bench.must(Slot(1, first := bench.weak()))
    bench.must(Entries((Entry(1, 1000),), 5))
    bench.must(Samples(b"\xc0", 7))
    let_stores_go(bench)
    began = bench.must(Update(first) if plays == "update" else PlaySequence(5, 1)).commit_period
    modulated_from = bench.must(AmplitudeModulation(7, 1, 3)).commit_period
    bench.wait_until(modulated_from)
    second = bench.weak()
    waits = bench.must(Update(second, later(bench))).commit_period
    other = bench.weak()
    wrong = [
        Wrong("an UPDATE with another magic", forge(bench, Update(other), magic=0x4150), Reason.MAGIC),
        Wrong("an UPDATE without its checksum", forge(bench, Update(other), checksum=0), Reason.CHECKSUM),
        Wrong("an UPDATE with hold", forge(bench, Update(other), hold=1), Reason.FIELD),
        Wrong("an UPDATE of another version", forge(bench, Update(other), version=0), Reason.VERSION),
        Wrong("an UPDATE beyond the horizon", forge(bench, Update(other, LAST_PERIOD)), Reason.HORIZON),
        Wrong("SILENCE with first", forge(bench, Output(Action.SILENCE), first=1), Reason.FIELD),
        Wrong("DISABLE with payload", forge(bench, Output(Action.DISABLE), b"\1"), Reason.FIELD),
        Wrong("END_MODULATION with repeats", forge(bench, Output(Action.END_MODULATION), repeats=1), Reason.FIELD),
        Wrong("a MODULATION without hold", forge(bench, AmplitudeModulation(7, 1, 1), hold=0), Reason.FIELD),
        Wrong("a SEQUENCE of no entries", forge(bench, PlaySequence(5, 1), count=0), Reason.FIELD),
        Wrong("SAMPLES that play", forge(bench, Samples(b"\0", 7)), Reason.IN_USE),
        Wrong("a SLOT with a phase of 127", forge(bench, Slot(1, SILENT), b"\x7f"), Reason.PULSE),
        Wrong("an UPDATE with a width of 31", forge(bench, Update(other), b"\x80\x0f"), Reason.PULSE),
    ]
    if plays == "sequence":
        wrong.append(Wrong("a SLOT that plays", forge(bench, Slot(1, other)), Reason.IN_USE))
        wrong.append(Wrong("ENTRIES that play", forge(bench, Entries((Entry(2, 1),), 5)), Reason.IN_USE))
    with in_time(bench, waits):
        refuse(bench, some(bench, wrong))
    steps = [
        (began, expected_words(first, bench.wiring)),
        (modulated_from, expected_words(modulated(first, 0xC0), bench.wiring)),
        (waits, expected_words(modulated(second, 0xC0), bench.wiring)),
    ]
    bench.judge(began, waits + 40, lambda seen: check_play(seen, steps))


@case("BLK-008", outputs=("BLK-008", "BLK-013", "BLK-014", "BLK-016"), features=STORES)
def test_refused_stores_leave_what_is_stored(bench: Bench) -> None:
    """A slot, entries and samples play as stored, although refused blocks for the same places came later."""
    bench.order(Request.LIMIT, 2)
    player = Player(bench)
    number = player.send(NoOp()).sequence
    player.send_all([Slot(9, only(9)), Slot(10, only(70, 31, 20)), Entries((Entry(9, 3), Entry(10, 4)), 50)])
    player.send(Samples(b"\xff\x40\x80", 60))
    let_stores_go(bench)
    slot, entries, samples = Slot(9, only(99)), Entries((Entry(10, 9), Entry(9, 9)), 50), Samples(b"\0\0\0", 60)
    wrong = [
        Wrong("a SLOT with a phase of 127 at the end", forge(bench, slot, late_phase(slot.pulses)), Reason.PULSE),
        Wrong("a SLOT without its checksum", forge(bench, slot, checksum=0), Reason.CHECKSUM),
        Wrong("a SLOT with count", forge(bench, slot, count=1), Reason.FIELD),
        Wrong("a SLOT with too much drive", forge(bench, Slot(9, heavy(3))), Reason.DRIVE),
        Wrong("a SLOT with an old number", pack(Block(slot, number)), Reason.SEQUENCE),
        Wrong("ENTRIES of slot 265", forge(bench, entries, bytes([10, 0, 9, 0, 9, 1, 9, 0])), Reason.FIELD),
        Wrong("ENTRIES without their checksum", forge(bench, entries, checksum=0), Reason.CHECKSUM),
        Wrong("ENTRIES with hold", forge(bench, entries, hold=1), Reason.FIELD),
        Wrong("SAMPLES with bytes after the last one", forge(bench, samples, b"\0\0\0\1"), Reason.FIELD),
        Wrong("SAMPLES of another version", forge(bench, samples, version=255), Reason.VERSION),
    ]
    refuse(bench, wrong)
    began = play_stored(player)
    refuse(bench, [Wrong("what plays", forge(bench, body), Reason.IN_USE) for body in (slot, entries, samples)])
    bench.wait_until(player.send(Output(Action.SILENCE)).commit_period)
    player.judge(began, play_stored(player) + 40)


def play_stored(player: Player) -> int:
    """Play the entries and the samples of the case above; returns the period in which both play."""
    player.send(PlaySequence(50, 2))
    began = player.send(AmplitudeModulation(60, 3, 2)).commit_period
    player.bench.wait_until(began)
    let_stores_go(player.bench)
    return began


@case("BLK-003", "BLK-008", "REQ-007", features=Feature.READ_BACK)
def test_a_damaged_update_does_not_play(bench: Bench) -> None:
    """PULSES answers the accepted update, not the later ones with a wrong checksum or a wrong pulse."""
    begin(bench)
    pulses = bench.weak()
    began = bench.must(Update(pulses)).commit_period
    other = bench.weak()
    wrong = [
        Wrong("an UPDATE without its checksum", forge(bench, Update(other), checksum=0), Reason.CHECKSUM),
        Wrong("an UPDATE whose last phase is 127", forge(bench, Update(other), late_phase(other)), Reason.PULSE),
    ]
    refuse(bench, wrong)
    bench.wait_until(began)
    reading = bench.read_back()
    expect("since_period in PULSES", reading.since_period, began)
    assert reading.pulses == pulses, "PULSES answers other pulses than those accepted"
