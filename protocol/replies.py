"""What a device answers: acknowledgements on bulk IN, information and status on request."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from construct import Construct, ConstructError

from ..errors import ReplyError
from .board import CHANNELS
from .codes import ACK_MAGIC, PROTOCOL_VERSION, Reason
from .layout.replies import ACK, INFO, STATUS, WIRING
from .wiring import Wiring

__all__ = ["WIRING_BYTES", "Ack", "Info", "Status", "decode_wiring", "encode_wiring"]

WIRING_BYTES = 2 * CHANNELS


def _parse(layout: Construct, data: bytes, what: str, size: int) -> Any:
    if len(data) != size:
        raise ReplyError(f"{what} has {size} bytes, not {len(data)}")
    try:
        return layout.parse(data)
    except ConstructError as error:
        raise ReplyError(f"{what} {data.hex()} breaks its layout: {error}") from error


@dataclass(frozen=True)
class Ack:
    """The answer to one block (SPEC.md, chapter ACK).

    Parameters
    ----------
    reason : Reason
        `Reason.ACCEPTED`, or why the block was refused.
    sequence : int
        Sequence number of the block, or what there is of it.
    commit_period : int
        Carrier period at which the update begins to play; 0 if it was refused.
    now_period : int
        Carrier period in which the block was judged.
    late : bool
        Whether the block asked for a period that could no longer be met.
    free : int
        Blocks that the device can still queue.
    """

    reason: Reason
    sequence: int
    commit_period: int
    now_period: int
    late: bool
    free: int

    BYTES = 32

    def encode(self) -> bytes:
        """Encode as 32 bytes."""
        body = asdict(self) | {"magic": ACK_MAGIC, "version": PROTOCOL_VERSION, "reserved": None}
        return bytes(ACK.build({"body": {"value": body}}))

    @classmethod
    def decode(cls, data: bytes) -> Ack:
        """Decode 32 bytes; raise `ReplyError` where they break the layout."""
        body = _parse(ACK, data, "an acknowledgement", cls.BYTES).body.value
        return cls(
            Reason(body.reason),
            body.sequence,
            body.commit_period,
            body.now_period,
            bool(body.late),
            body.free,
        )


@dataclass(frozen=True)
class Status:
    """What a device is doing (SPEC.md, clause REQ-003).

    Parameters
    ----------
    enabled : bool
        Whether the outputs are enabled.
    watchdog_fired : bool
        Whether the watchdog has silenced the outputs since they were last enabled.
    last_refusal : Reason
        Why the last refused block was refused; `Reason.ACCEPTED` if none was.
    period : int
        Current carrier period since power-up.
    accepted, refused, late : int
        Blocks since power-up.
    missed_commits : int
        Commits that a processor could not carry out, summed over the ten processors.
    """

    enabled: bool
    watchdog_fired: bool
    last_refusal: Reason
    period: int
    accepted: int
    refused: int
    late: int
    missed_commits: int

    BYTES = 28

    def encode(self) -> bytes:
        """Encode as 28 bytes."""
        return bytes(STATUS.build(asdict(self) | {"reserved": None}))

    @classmethod
    def decode(cls, data: bytes) -> Status:
        """Decode 28 bytes; raise `ReplyError` where they break the layout."""
        fields = _parse(STATUS, data, "a status", cls.BYTES)
        return cls(
            bool(fields.enabled),
            bool(fields.watchdog_fired),
            Reason(fields.last_refusal),
            fields.period,
            fields.accepted,
            fields.refused,
            fields.late,
            fields.missed_commits,
        )


@dataclass(frozen=True)
class Info:
    """What a device is (SPEC.md, clause REQ-002). Lengths in metres, times in seconds, rates per second."""

    protocol_version: int
    firmware: tuple[int, int, int]
    channels: int
    columns: int
    rows: int
    pitch: float
    boards: int
    processors_per_board: int
    ticks_per_period: int
    max_width_ticks: int
    link_wires: int
    queue_blocks: int
    carrier_hz: int
    max_updates_per_second: int
    watchdog: float

    BYTES = 32

    def encode(self) -> bytes:
        """Encode as 32 bytes."""
        fields = asdict(self) | {
            "pitch_um": round(self.pitch * 1e6),
            "watchdog_ms": round(self.watchdog * 1e3),
            "reserved": None,
        }
        return bytes(INFO.build(fields))

    @classmethod
    def decode(cls, data: bytes) -> Info:
        """Decode 32 bytes; raise `ReplyError` where they break the layout."""
        fields = dict(_parse(INFO, data, "an information record", cls.BYTES))
        del fields["_io"], fields["reserved"]
        major, minor, patch = fields.pop("firmware")
        return cls(
            firmware=(major, minor, patch),
            pitch=fields.pop("pitch_um") / 1e6,
            watchdog=fields.pop("watchdog_ms") / 1e3,
            **fields,
        )


def encode_wiring(wiring: Wiring) -> bytes:
    """Encode a wiring table as the answer to the WIRING request, 640 bytes."""
    return bytes(WIRING.build({"channels": wiring.channels.tolist()}))


def decode_wiring(data: bytes) -> Wiring:
    """Decode the answer to the WIRING request; raise `ValueError` where it is no one-to-one table."""
    return Wiring(np.array(_parse(WIRING, data, "a wiring table", WIRING_BYTES).channels))
