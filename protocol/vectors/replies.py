"""Vectors of what a device answers, and of its states (SPEC.md, chapters ACK, REQ and STA)."""

from __future__ import annotations

import zlib
from dataclasses import replace

from ..board import CHANNELS, PROCESSORS, TICKS_PER_PERIOD, WATCHDOG_MS
from ..codes import AckFlag, Bank, Fault, Feature, Reason, State, StatusFlag
from ..plain import plain
from ..replies import (
    Ack,
    ClockReading,
    Info,
    ProcessorReport,
    ReadBack,
    Status,
    encode_reports,
    encode_wiring,
)
from ..states import TRANSITIONS
from ..wiring import Wiring
from .blocks import MIXED, SILENT
from .cases import Section, section, vector

__all__ = [
    "ACK",
    "INFO",
    "RECORDS",
    "REPORTS",
    "STATUS",
    "answers",
    "packets",
    "records",
    "refused_answers",
    "refused_packets",
    "refused_records",
    "transitions",
]

U32_MAX, U64_MAX = 2**32 - 1, 2**64 - 1

ACK = Ack(Reason.ACCEPTED, 7, 1000, 20_000, AckFlag(0), 7, State.READY)
REFUSAL = Ack(Reason.SEQUENCE, 7, 0, 20_000, AckFlag(0), 8, State.PLAYING)
STATUS = Status(
    state=State.READY,
    faults=Fault(0),
    last_refusal=Reason.ACCEPTED,
    flags=StatusFlag(0),
    now=20_000,
    since_period=0,
    accepted=7,
    refused=0,
    late=0,
    lost=0,
    missed_commits=0,
    damaged_messages=0,
    free=8,
    temperature_c=31,
    watchdog_ms=WATCHDOG_MS,
    drive_limit=CHANNELS,
    dropped_frames=0,
)
INFO = Info(
    oldest_version=1,
    newest_version=1,
    hardware=1,
    firmware=(1, 2, 3),
    boards=5,
    unique_id=bytes.fromhex("efcdab8967452301"),
    carrier_hz=40_000,
    features=Feature(0b111_1111),
    channels=CHANNELS,
    columns=20,
    rows=16,
    pitch_um=10_300,
    processors_per_board=2,
    ticks_per_period=TICKS_PER_PERIOD,
    max_width_ticks=25,
    link_wires=5,
    cycles_per_symbol=2,
    queue_blocks=8,
    periods_per_update=1,
    queue_records=32,
    slots=256,
    sequence_entries=1024,
    modulation_samples=4096,
    drive_limit=CHANNELS,
    watchdog_ms=WATCHDOG_MS,
)
REPORT = ProcessorReport(Fault(0), 31, Bank.A, 0, 0, (1, 2, 3))
WORST = ProcessorReport(Fault(0b111_1111), -128, Bank.FACTORY, U32_MAX, U32_MAX, (99, 9, 9))
MISSING = ProcessorReport(Fault.PROCESSOR, 0, None, 0, 0, (0, 0, 0))
REPORTS: dict[str, tuple[str, list[ProcessorReport]]] = {
    "processors": ("all well", [REPORT] * PROCESSORS),
    "processors-last": (
        "all is wrong with the last one, which runs the factory's firmware",
        [REPORT] * 9 + [WORST],
    ),
    "processors-missing": ("the last one is not there", [REPORT] * 9 + [MISSING]),
}

RECORDS: dict[str, tuple[str, Ack | Status]] = {
    "ack-specification": ("the example of ACK-002", ACK),
    "ack-late-gap": (
        "a change too late, behind two lost ones, takes the last place in the queue",
        replace(ACK, flags=AckFlag.LATE | AckFlag.GAP, free=0, state=State.PLAYING),
    ),
    "ack-largest": (
        "the largest values",
        Ack(Reason.ACCEPTED, U32_MAX, U64_MAX, U64_MAX, AckFlag(0), 255, State.READY),
    ),
    **{
        f"ack-{reason.name}": (f"refused: {reason.text}", replace(REFUSAL, reason=reason))
        for reason in Reason
        if reason
    },
    **{
        f"ack-in-{state.name}": (f"a NO_OP in state {state.name}", replace(ACK, commit_period=0, state=state))
        for state in State
    },
    "status-at-rest": ("nothing has gone wrong and nothing plays", STATUS),
    "status-playing": (
        "a modulated sequence plays; one refusal",
        replace(
            STATUS,
            state=State.UNATTENDED,
            flags=StatusFlag.SEQUENCE | StatusFlag.MODULATION,
            since_period=1000,
            last_refusal=Reason.IN_USE,
            refused=1,
        ),
    ),
    "status-watchdog": (
        "the watchdog has fired",
        replace(STATUS, state=State.OFF, flags=StatusFlag.WATCHDOG_FIRED),
    ),
    "status-faults": (
        "every fault at once, and the coldest board there can be",
        replace(STATUS, state=State.FAULT, faults=Fault(0b111_1111), temperature_c=-128),
    ),
    "status-largest": (
        "the largest values",
        Status(
            *(State.DFU, Fault(0), Reason.IN_USE, StatusFlag(0b111), U64_MAX, U64_MAX),
            *(U32_MAX, U32_MAX, U32_MAX, U32_MAX, U32_MAX, U32_MAX, 255, 127, 65535, 65535, U32_MAX),
        ),
    ),
}


def records() -> Section:
    """Acknowledgements and status records."""
    return section(
        "Acknowledgements (ACK-002) and status records (REQ-003), which share bulk IN and the RECORD frame.",
        (
            vector(name, shows, hex=record.encode(), record=type(record).__name__.upper(), fields=record)
            for name, (shows, record) in RECORDS.items()
        ),
    )


def _changed(record: Ack | Status, offset: int, *octets: int) -> bytes:
    """A record with other bytes at an offset and the checksum that belongs to them."""
    data = bytearray(record.encode()[:-4])
    data[offset : offset + len(octets)] = bytes(octets)
    return bytes(data) + zlib.crc32(data).to_bytes(4, "little")


def refused_records() -> Section:
    """Records that a host does not believe."""
    ack, status = ACK.encode(), STATUS.encode()
    refusals = {
        "ack-short": ("one byte is missing", "ACK-002", ack[:-1]),
        "ack-checksum": ("a bit of the number is flipped", "ACK-002", bytes([*ack[:4], ack[4] ^ 1, *ack[5:]])),
        "ack-magic": ("the magic of a block", "ACK-002", _changed(ACK, 0, *b"PW")),
        "ack-version": ("a version that nobody spoke", "VER-002", _changed(ACK, 2, 2)),
        "ack-reason": ("a reason that does not exist", "ACK-003", _changed(ACK, 3, 17)),
        "ack-flags": ("a flag that does not exist", "ACK-004", _changed(ACK, 24, 4)),
        "ack-state": ("a state that does not exist", "STA-001", _changed(ACK, 26, 7)),
        "ack-reserved": ("a reserved byte is not 0", "ACK-002", _changed(ACK, 27, 1)),
        "status-short": ("only the first half", "REQ-003", status[:32]),
        "status-checksum": (
            "a bit of the tick is flipped",
            "REQ-003",
            bytes([*status[:8], status[8] ^ 1, *status[9:]]),
        ),
        "status-version": ("another version", "REQ-003", _changed(STATUS, 2, 0)),
        "status-state": ("a state that does not exist", "STA-001", _changed(STATUS, 3, 7)),
        "status-faults": ("a fault that does not exist", "SAF-008", _changed(STATUS, 4, 0x80)),
        "status-refusal": ("a reason that does not exist", "ACK-003", _changed(STATUS, 6, 17)),
        "status-flags": ("a flag that does not exist", "REQ-003", _changed(STATUS, 7, 8)),
        "status-reserved": ("a reserved byte is not 0", "REQ-003", _changed(STATUS, 59, 1)),
    }
    return section(
        "Bytes that are no record of this version: a host drops them.",
        (vector(f"refused-{name}", shows, hex=data, clause=clause) for name, (shows, clause, data) in refusals.items()),
    )


def packets() -> Section:
    """What may come in one packet on bulk IN."""
    cases: dict[str, tuple[str, list[str]]] = {
        "empty": ("an empty packet carries nothing", []),
        "one-ack": ("one acknowledgement, which did not wait for more", ["ack-specification"]),
        "one-status": ("a status record, sent unasked", ["status-faults"]),
        "mixed": ("acknowledgements first, then the status", ["ack-specification", "ack-SEQUENCE", "status-watchdog"]),
        "full": ("as many acknowledgements as fit 512 bytes", ["ack-specification"] * 16),
        "full-with-status": ("14 acknowledgements and a status", [*["ack-late-gap"] * 14, "status-playing"]),
    }
    return section(
        "Packets on bulk IN (ACK-005, USB-019), and the names of the records in them.",
        (
            vector(f"packet-{name}", shows, hex=b"".join(RECORDS[record][1].encode() for record in held), records=held)
            for name, (shows, held) in cases.items()
        ),
    )


def refused_packets() -> Section:
    """What cannot be in one packet on bulk IN."""
    ack, status = ACK.encode(), STATUS.encode()
    refusals = {
        "cut-ack": ("the second acknowledgement is cut off", ack + ack[:16]),
        "cut-status": ("a status cut off after 32 bytes, at which an acknowledgement would end", ack + status[:32]),
        "nothing-known": ("zeros after an acknowledgement", ack + bytes(32)),
    }
    return section(
        "Packets on bulk IN that do not hold whole records.",
        (
            vector(f"refused-packet-{name}", shows, hex=data, clause="ACK-005")
            for name, (shows, data) in refusals.items()
        ),
    )


def answers() -> Section:
    """What control requests answer, besides STATUS, which is a record."""
    later = replace(
        INFO,
        newest_version=3,
        features=Feature(0x8001),
        link_wires=2,
        periods_per_update=2,
        slots=0,
        sequence_entries=0,
        modulation_samples=0,
        later=bytes(range(16)),
    )
    clocks = {
        "clock-reading": ("400 periods after power-up, before a second pulse", ClockReading(20_000, 0, 1)),
        "clock-reading-largest": ("the largest values", ClockReading(U64_MAX, U64_MAX, U32_MAX)),
    }
    readings = {
        "pulses-silent": ("nothing has played yet", ReadBack(0, 400, SILENT)),
        "pulses-mixed": ("pulses of every kind", ReadBack(1000, 2**40, MIXED)),
    }
    reversed_order = Wiring(list(range(CHANNELS))[::-1])
    wirings = {
        "wiring-strips": ("each board under a strip of four columns, to and fro", Wiring.strips()),
        "wiring-reversed": ("transducer 0 hangs on the last channel", reversed_order),
    }
    infos = {
        "info": ("five-wire links and every feature", INFO),
        "info-later": (
            "a device of a later version: unknown features and the last 16 bytes are no reason to refuse it",
            later,
        ),
    }
    return section(
        "Data that control requests answer (REQ); STATUS answers a status record. Unknown features appear as one "
        "number after the names of the known ones.",
        [
            *(vector(n, shows, request="INFO", hex=v.encode(), fields=v) for n, (shows, v) in infos.items()),
            *(vector(n, shows, request="CLOCK", hex=v.encode(), fields=v) for n, (shows, v) in clocks.items()),
            *(vector(n, shows, request="PULSES", hex=v.encode(), fields=v) for n, (shows, v) in readings.items()),
            *(
                vector(n, shows, request="PROCESSORS", hex=encode_reports(v), fields={"reports": v})
                for n, (shows, v) in REPORTS.items()
            ),
            *(
                vector(n, shows, request="WIRING", hex=encode_wiring(v), fields={"channels": v.channels.tolist()})
                for n, (shows, v) in wirings.items()
            ),
        ],
    )


def _with(data: bytes, offset: int, *octets: int) -> bytes:
    return data[:offset] + bytes(octets) + data[offset + len(octets) :]


def refused_answers() -> Section:
    """Answers that a host does not believe."""
    info, clock = INFO.encode(), ClockReading(20_000, 0, 1).encode()
    pulses, reports, wiring = (
        ReadBack(0, 400, SILENT).encode(),
        encode_reports([REPORT] * PROCESSORS),
        encode_wiring(Wiring.strips()),
    )
    refusals = {
        "info-short": ("INFO", "one byte is missing", "REQ-002", info[:-1]),
        "info-wires": ("INFO", "links of three wires", "REQ-002", _with(info, 31, 3)),
        "clock-long": ("CLOCK", "one byte more", "REQ-006", clock + bytes(1)),
        "clock-reserved": ("CLOCK", "a reserved byte is not 0", "REQ-006", _with(clock, 20, 1)),
        "pulses-phase": ("PULSES", "phase 100", "PUL-001", _with(pulses, 16, 100)),
        "pulses-short": ("PULSES", "the last pulse is missing", "REQ-007", pulses[:-3]),
        "processors-nine": ("PROCESSORS", "nine reports", "REQ-008", reports[:-16]),
        "processors-fault": ("PROCESSORS", "a fault that does not exist", "SAF-008", _with(reports, 0, 0x80)),
        "processors-bank": ("PROCESSORS", "firmware from bank 4", "FWU-016", _with(reports, 3, 4)),
        "processors-reserved": ("PROCESSORS", "a reserved byte is not 0", "REQ-008", _with(reports, 15, 1)),
        "wiring-twice": ("WIRING", "two transducers on one channel", "REQ-004", wiring[:2] + wiring[:2] + wiring[4:]),
        "wiring-beyond": ("WIRING", "channel 320", "REQ-004", _with(wiring, 0, 0x40, 1)),
        "wiring-short": ("WIRING", "319 channels", "REQ-004", wiring[:-2]),
    }
    return section(
        "Data that no request answers: a host refuses them.",
        (
            vector(f"refused-{name}", shows, request=request, hex=data, clause=clause)
            for name, (request, shows, clause, data) in refusals.items()
        ),
    )


def transitions() -> Section:
    """The device's states."""
    return section(
        "The state that follows (STA-003), for every state and every event of STA-002.",
        (plain({"state": state, "event": event, "next": after}) for (state, event), after in TRANSITIONS.items()),
    )
