"""What a device answers: records on bulk IN, and the data of control requests (SPEC.md, chapters ACK and REQ)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from construct import Construct, ConstructError
from isal.isal_zlib import crc32
from numpy.typing import NDArray

from ..base.arguments import whole
from ..base.errors import BlockError, ReplyError
from .blocks import pack_pulses, unpack_pulses
from .board import CHANNELS, PROCESSORS, TICKS_PER_PERIOD
from .codes import (
    ACK_MAGIC,
    PAYLOAD_BYTES,
    PROTOCOL_VERSION,
    RECORD_BYTES,
    STATUS_MAGIC,
    AckFlag,
    Bank,
    Fault,
    Feature,
    Reason,
    Request,
    State,
    StatusFlag,
)
from .layout import build
from .layout.replies import ACK, CLOCK, INFO, PROCESSOR_REPORTS, READ_BACK, STATUS, WIRING
from .pulses import Pulses
from .wiring import Wiring

__all__ = [
    "ACKS",
    "ANSWER_BYTES",
    "WIRING_BYTES",
    "Ack",
    "ClockReading",
    "Info",
    "ProcessorReport",
    "ReadBack",
    "Status",
    "decode_acks",
    "decode_reports",
    "decode_wiring",
    "encode_acks",
    "encode_reports",
    "encode_wiring",
    "records",
]

WIRING_BYTES = 2 * CHANNELS
ENABLED = (State.READY, State.PLAYING, State.UNATTENDED)


def _parse(layout: Construct, data: bytes, what: str, size: int) -> Any:
    if len(data) != size:
        raise ReplyError(f"{what} has {size} bytes, not {len(data)}")
    try:
        return layout.parse(data)
    except ConstructError as error:
        raise ReplyError(f"{what} {data.hex()} breaks its layout: {error}") from error


def _sealed(layout: Construct, magic: bytes, record: Status) -> bytes:
    body = vars(record) | {"magic": magic, "version": PROTOCOL_VERSION, "reserved": None}
    return build(layout, {"body": {"value": body}}, record)


_READ_BACK = struct.Struct("<QQ")

_ACK_FIELDS: dict[str, tuple[str, frozenset[int] | None]] = {
    "magic": ("2s", None),
    "version": ("B", frozenset({PROTOCOL_VERSION})),
    "reason": ("B", frozenset(Reason)),
    "sequence": ("I", None),
    "commit_period": ("Q", None),
    "now": ("Q", None),
    "flags": ("B", frozenset(range(sum(AckFlag) + 1))),
    "free": ("B", None),
    "state": ("B", frozenset(State)),
    "reserved": ("B", frozenset({0})),
}
"""The layout of an acknowledgement but for its checksum, and the values of fields that may not have any (ACK-002)."""
_ACK = struct.Struct("<" + "".join(format for format, _ in _ACK_FIELDS.values()))
_ACK_VALUES = {name: values for name, (_, values) in _ACK_FIELDS.items() if values is not None}
_ACK_MOST = {
    name: 2 ** (8 * struct.calcsize(_ACK_FIELDS[name][0])) - 1
    for name in ("sequence", "commit_period", "now", "flags", "free")
}
ACKS = np.dtype([(name, "S2" if format == "2s" else f"<{format}") for name, (format, _) in _ACK_FIELDS.items()])


def encode_acks(
    sequence: NDArray[Any],
    commit_period: NDArray[Any],
    now: NDArray[Any],
    flags: NDArray[Any],
    free: NDArray[Any],
    state: NDArray[Any],
) -> list[bytes]:
    """Encode the acknowledgements of k accepted blocks, whose fields are right, from (k,) integers; see `Ack`."""
    bodies = np.zeros(len(sequence), ACKS)
    bodies["magic"], bodies["version"] = ACK_MAGIC, PROTOCOL_VERSION
    bodies["sequence"], bodies["commit_period"], bodies["now"] = sequence, commit_period, now
    bodies["flags"], bodies["free"], bodies["state"] = flags, free, state
    data, size = bodies.tobytes(), ACKS.itemsize
    rows = [data[at : at + size] for at in range(0, len(data), size)]
    return [row + zlib.crc32(row).to_bytes(4, "little") for row in rows]


_ACK_RECORDS = np.dtype([("ack", ACKS), ("checksum", "<u4")])
_SEALED_CRC = 0x2144DF1C  # CRC-32 of whatever ends with its own CRC-32


def _possible_octets() -> NDArray[np.bool_]:
    """Which values each octet of an acknowledgement may have by itself, (32 · 256,) (clause ACK-002)."""
    possible = np.ones((RECORD_BYTES, 256), np.bool_)
    octets: dict[int, Iterable[int]] = {at: [octet] for at, octet in enumerate(ACK_MAGIC)}
    assert ACKS.fields is not None  # of a plain type
    octets |= {ACKS.fields[name][1]: values for name, values in _ACK_VALUES.items()}
    for at, values in octets.items():
        possible[at] = np.isin(np.arange(256), list(values))
    return possible.reshape(-1)


_POSSIBLE_OCTETS = _possible_octets()
_OCTET_ROWS = 256 * np.arange(RECORD_BYTES)


def _is_ack(record: bytes | bytearray | memoryview) -> bool:
    """Whether 32 bytes are a sound acknowledgement."""
    magic, version, reason, _, _, _, flags, _, state, reserved = _ACK.unpack_from(record)
    return (
        crc32(record) == _SEALED_CRC
        and magic == ACK_MAGIC
        and version == PROTOCOL_VERSION
        and reason in _ACK_VALUES["reason"]
        and flags in _ACK_VALUES["flags"]
        and state in _ACK_VALUES["state"]
        and not reserved
    )


def decode_acks(packets: bytes | bytearray | memoryview) -> NDArray[np.void]:
    """Decode bytes from bulk IN that are only acknowledgements: the fast twin of `records`.

    Parameters
    ----------
    packets : bytes
        k acknowledgements, one after the other. They are not copied.

    Returns
    -------
    (k,) structured
        Fields ``reason``, ``sequence``, ``commit_period``, ``now``, ``flags``, ``free`` and ``state``, integers as in
        `Ack`, and ``magic``, ``version`` and ``reserved``, which are what they must be.

    Raises
    ------
    ReplyError
        If a record of another kind, such as a status, is among them, or one is truncated or breaks the layout.
    """
    if len(packets) == RECORD_BYTES and _is_ack(packets):  # the usual one is not worth arrays
        return np.frombuffer(packets, _ACK_RECORDS)["ack"]
    if len(packets) % RECORD_BYTES:
        raise ReplyError(f"{len(packets)} bytes are no whole number of acknowledgements of {RECORD_BYTES} bytes")
    octets = np.frombuffer(packets, np.uint8).reshape(-1, RECORD_BYTES)
    sound = _POSSIBLE_OCTETS[_OCTET_ROWS + octets].all(axis=1)
    sound &= np.fromiter(map(crc32, octets), np.uint32, len(octets)) == _SEALED_CRC
    if not sound.all():
        Ack.decode(octets[np.argmin(sound)].tobytes())  # says what is wrong with it
    return np.frombuffer(packets, _ACK_RECORDS)["ack"]


@dataclass(frozen=True)
class Ack:
    """The answer to one block (chapter ACK).

    Parameters
    ----------
    reason : Reason
        `Reason.ACCEPTED`, or why the block was refused.
    sequence : int
        Sequence number of the block, as far as it was received.
    commit_period : int
        Carrier period at which the block takes effect; for a clock block that of the last pulse on the sync line; else
        0.
    now : int
        Tick at which the block had arrived.
    flags : AckFlag
        Whether it asked for a period that could no longer be met, and whether blocks before it are missing.
    free : int
        Changes that the device can still queue.
    state : State
        What the device is doing.
    """

    reason: Reason
    sequence: int
    commit_period: int
    now: int
    flags: AckFlag
    free: int
    state: State

    BYTES: ClassVar = RECORD_BYTES

    @property
    def now_period(self) -> int:
        """Carrier period in which the block had arrived."""
        return self.now // TICKS_PER_PERIOD

    @property
    def late(self) -> bool:
        """Whether the block asked for a period that could no longer be met."""
        return AckFlag.LATE in self.flags

    def encode(self) -> bytes:
        """Encode as 32 bytes; raise `ValueError` if a field does not fit."""
        for name in ("reason", "state"):
            if getattr(self, name) not in _ACK_VALUES[name]:
                raise ValueError(f"{name} {getattr(self, name)} is none of {sorted(map(int, _ACK_VALUES[name]))}")
        for name, most in _ACK_MOST.items():
            whole(name, getattr(self, name), 0, most)
        body = _ACK.pack(
            ACK_MAGIC,
            PROTOCOL_VERSION,
            self.reason,
            self.sequence,
            self.commit_period,
            self.now,
            self.flags,
            self.free,
            self.state,
            0,
        )
        return body + zlib.crc32(body).to_bytes(4, "little")

    @classmethod
    def of(cls, row: np.void) -> Ack:
        """One row of `decode_acks` as a value."""
        _, _, reason, sequence, commit_period, now, flags, free, state, _ = _ACK.unpack(row.tobytes())
        return cls(Reason(reason), sequence, commit_period, now, AckFlag(flags), free, State(state))

    @classmethod
    def decode(cls, data: bytes) -> Ack:
        """Decode 32 bytes; raise `ReplyError` if they break the layout."""
        body = _parse(ACK, data, "an acknowledgement", cls.BYTES).body.value
        return cls(
            Reason(body.reason),
            body.sequence,
            body.commit_period,
            body.now,
            AckFlag(body.flags),
            body.free,
            State(body.state),
        )


@dataclass(frozen=True)
class Status:
    """What a device is doing (clause REQ-003).

    Parameters
    ----------
    state : State
        The state of the device.
    faults : Fault
        What is wrong with it.
    last_refusal : Reason
        Why the last refused block was refused; `Reason.ACCEPTED` if none was.
    flags : StatusFlag
        Whether the watchdog has fired, and what plays.
    now : int
        Tick since power-up.
    since_period : int
        Carrier period at which what plays began, 0 if nothing plays.
    accepted, refused, late, lost : int
        Blocks since power-up; lost are those whose sequence numbers were left out.
    missed_commits, damaged_messages : int
        What went wrong on the chain since power-up, summed over the ten processors.
    free : int
        Changes that the device can still queue.
    temperature_c : int
        Temperature of the hottest board, °C.
    watchdog_ms : int
        The time without a sign of life after which the outputs go off, ms.
    drive_limit : int
        Most power that a block may ask for, in fully driven transducers.
    dropped_frames : int
        Frames on a serial line that were damaged or came too soon.
    """

    state: State
    faults: Fault
    last_refusal: Reason
    flags: StatusFlag
    now: int
    since_period: int
    accepted: int
    refused: int
    late: int
    lost: int
    missed_commits: int
    damaged_messages: int
    free: int
    temperature_c: int
    watchdog_ms: int
    drive_limit: int
    dropped_frames: int

    BYTES: ClassVar = 2 * RECORD_BYTES

    @property
    def enabled(self) -> bool:
        """Whether updates are let through."""
        return self.state in ENABLED

    @property
    def watchdog_fired(self) -> bool:
        """Whether the watchdog has silenced the outputs since they were last enabled."""
        return StatusFlag.WATCHDOG_FIRED in self.flags

    @property
    def period(self) -> int:
        """Carrier period since power-up."""
        return self.now // TICKS_PER_PERIOD

    def encode(self) -> bytes:
        """Encode as 64 bytes; raise `ValueError` if a field does not fit."""
        return _sealed(STATUS, STATUS_MAGIC, self)

    @classmethod
    def decode(cls, data: bytes) -> Status:
        """Decode 64 bytes; raise `ReplyError` if they break the layout."""
        fields = dict(_parse(STATUS, data, "a status", cls.BYTES).body.value)
        for name in ("_io", "magic", "version", "reserved"):
            del fields[name]
        codes = {"state": State, "faults": Fault, "last_refusal": Reason, "flags": StatusFlag}
        return cls(**fields | {name: code(fields[name]) for name, code in codes.items()})


def records(packets: bytes) -> list[Ack | Status]:
    """Split what came on bulk IN into its records (clause ACK-005).

    Raises
    ------
    ReplyError
        If a record is neither an acknowledgement nor a status, is cut off, or breaks its layout.
    """
    found: list[Ack | Status] = []
    at = 0
    while at < len(packets):
        record: type[Ack | Status] = Status if packets[at : at + 2] == STATUS_MAGIC else Ack
        found.append(record.decode(packets[at : at + record.BYTES]))
        at += record.BYTES
    return found


@dataclass(frozen=True)
class Info:
    """What a device is (clause REQ-002).

    Parameters
    ----------
    oldest_version, newest_version : int
        Versions of the protocol that it speaks.
    hardware : int
        Kind of boards.
    firmware : (int, int, int)
        Version of the firmware that runs.
    boards, processors_per_board : int
    unique_id : bytes
        Eight bytes that no other device has.
    carrier_hz : int
    features : Feature
        What it can do besides updates; unknown bits are kept.
    channels, columns, rows : int
        Transducers, and the grid that they form.
    pitch_um : int
        Distance of neighbours, in µm.
    ticks_per_period, max_width_ticks : int
    link_wires, cycles_per_symbol : int
        Set-up of the links of the chain.
    queue_blocks, queue_records : int
        How many changes and how many records on bulk IN it can hold.
    periods_per_update : int
        Carrier periods that the chain needs for an update.
    slots, sequence_entries, modulation_samples : int
        Room for what is stored.
    drive_limit : int
        Most power that it allows, in fully driven transducers.
    watchdog_ms : int
        Watchdog time at power-up, in ms.
    later : bytes
        16 bytes of later versions, which this one ignores.
    """

    oldest_version: int
    newest_version: int
    hardware: int
    firmware: tuple[int, int, int]
    boards: int
    unique_id: bytes
    carrier_hz: int
    features: Feature
    channels: int
    columns: int
    rows: int
    pitch_um: int
    processors_per_board: int
    ticks_per_period: int
    max_width_ticks: int
    link_wires: int
    cycles_per_symbol: int
    queue_blocks: int
    periods_per_update: int
    queue_records: int
    slots: int
    sequence_entries: int
    modulation_samples: int
    drive_limit: int
    watchdog_ms: int
    later: bytes = bytes(16)

    BYTES: ClassVar = 64

    @property
    def pitch(self) -> float:
        """Distance of neighbouring transducers, in m."""
        return self.pitch_um / 1e6

    @property
    def watchdog(self) -> float:
        """Watchdog time at power-up, in s."""
        return self.watchdog_ms / 1e3

    @property
    def max_updates_per_second(self) -> float:
        """Rate at which the chain can take updates."""
        return self.carrier_hz / self.periods_per_update

    def speaks(self, version: int) -> bool:
        """Whether it speaks a version of the protocol (clause VER-006)."""
        return self.oldest_version <= version <= self.newest_version

    def encode(self) -> bytes:
        """Encode as 64 bytes; raise `ValueError` if a field does not fit."""
        return build(INFO, asdict(self), self)

    @classmethod
    def decode(cls, data: bytes) -> Info:
        """Decode 64 bytes; raise `ReplyError` if they break the layout."""
        fields = dict(_parse(INFO, data, "an information record", cls.BYTES))
        del fields["_io"]
        return cls(**fields | {"firmware": tuple(fields["firmware"]), "features": Feature(fields["features"])})


@dataclass(frozen=True)
class ClockReading:
    """A device's time (clause REQ-006).

    Parameters
    ----------
    now : int
        Tick since power-up.
    sync_period : int
        Carrier period that began with the last pulse on the sync line.
    sync_pulses : int
        Pulses on the sync line since power-up.
    """

    now: int
    sync_period: int
    sync_pulses: int

    BYTES: ClassVar = 24

    def encode(self) -> bytes:
        """Encode as 24 bytes; raise `ValueError` if a field does not fit."""
        return build(CLOCK, vars(self) | {"reserved": None}, self)

    @classmethod
    def decode(cls, data: bytes) -> ClockReading:
        """Decode 24 bytes; raise `ReplyError` if they break the layout."""
        fields = _parse(CLOCK, data, "a clock reading", cls.BYTES)
        return cls(fields.now, fields.sync_period, fields.sync_pulses)


@dataclass(frozen=True)
class ReadBack:
    """The pulses that a device plays, read back from its processors (clause REQ-007).

    Parameters
    ----------
    since_period : int
        Carrier period at which they began to play; 0 if nothing plays, `MIXED` if not all began together.
    read_period : int
        Carrier period in which they were read.
    pulses : Pulses
        320 pulses in array order, before any modulation.
    """

    since_period: int
    read_period: int
    pulses: Pulses

    BYTES: ClassVar = 16 + PAYLOAD_BYTES
    MIXED: ClassVar = 2**64 - 1

    @property
    def mixed(self) -> bool:
        """Whether the processors differed in the period, so that these are pulses of more than one frame."""
        return self.since_period == self.MIXED

    def encode(self) -> bytes:
        """Encode as 496 bytes; raise `ValueError` if a field does not fit."""
        if len(self.pulses) != CHANNELS:
            raise ValueError(f"a reading has {CHANNELS} pulses, not {len(self.pulses)}")
        heads = [
            whole(name, getattr(self, name), 0, 2**64 - 1).to_bytes(8, "little")
            for name in ("since_period", "read_period")
        ]
        return b"".join([*heads, pack_pulses(self.pulses)])

    @classmethod
    def decode(cls, data: bytes) -> ReadBack:
        """Decode 496 bytes; raise `ReplyError` if they break the layout."""
        try:
            if len(data) == cls.BYTES:
                since_period, read_period = _READ_BACK.unpack_from(data)
                return cls(since_period, read_period, unpack_pulses(data[_READ_BACK.size :]))
        except BlockError:
            pass
        _parse(READ_BACK, data, "a reading of pulses", cls.BYTES)  # says what is wrong
        raise AssertionError("the layout accepts what its twin refuses")


@dataclass(frozen=True)
class ProcessorReport:
    """How one processor fares (clause REQ-008).

    Parameters
    ----------
    faults : Fault
    temperature_c : int
        Temperature of its board, °C.
    bank : Bank or None
        The bank where its firmware came from; None if no processor is there.
    missed_commits, damaged_messages : int
        Since power-up.
    firmware : (int, int, int)
        Version that runs.
    """

    faults: Fault
    temperature_c: int
    bank: Bank | None
    missed_commits: int
    damaged_messages: int
    firmware: tuple[int, int, int]

    BYTES: ClassVar = 16


def encode_reports(reports: Sequence[ProcessorReport]) -> bytes:
    """Encode the reports of the ten processors as the answer to PROCESSORS, 160 bytes."""
    fields = [asdict(report) | {"bank": report.bank or 0, "reserved": None} for report in reports]
    return build(PROCESSOR_REPORTS, {"reports": fields}, f"{len(reports)} reports")


def decode_reports(data: bytes) -> list[ProcessorReport]:
    """Decode the answer to PROCESSORS; raise `ReplyError` if it breaks the layout."""
    parsed = _parse(PROCESSOR_REPORTS, data, "the reports of the processors", PROCESSORS * ProcessorReport.BYTES)
    return [
        ProcessorReport(
            Fault(fields.faults),
            fields.temperature_c,
            Bank(fields.bank) if fields.bank else None,
            fields.missed_commits,
            fields.damaged_messages,
            tuple(fields.firmware),
        )
        for fields in parsed.reports
    ]


def encode_wiring(wiring: Wiring) -> bytes:
    """Encode a wiring table as the answer to the WIRING request, 640 bytes."""
    return bytes(WIRING.build({"channels": wiring.channels.tolist()}))


def decode_wiring(data: bytes) -> Wiring:
    """Decode the answer to the WIRING request.

    Raises
    ------
    ReplyError
        If it breaks the layout or is no one-to-one table.
    """
    channels = np.array(_parse(WIRING, data, "a wiring table", WIRING_BYTES).channels)
    try:
        return Wiring(channels)
    except ValueError as error:
        raise ReplyError(str(error)) from error


ANSWER_BYTES: Mapping[Request, int] = MappingProxyType(
    {
        Request.INFO: Info.BYTES,
        Request.STATUS: Status.BYTES,
        Request.WIRING: WIRING_BYTES,
        Request.CLOCK: ClockReading.BYTES,
        Request.PULSES: ReadBack.BYTES,
        Request.PROCESSORS: PROCESSORS * ProcessorReport.BYTES,
    }
)
"""Size of the answer to each request that has one (chapter REQ)."""
