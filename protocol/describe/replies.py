"""What a device answers, in words: records, and the data of its requests (SPEC.md, chapters ACK and REQ)."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

from ...base.errors import ReplyError
from ..codes import STATUS_MAGIC, Reason
from ..replies import Ack, ClockReading, Info, ReadBack, Status
from ..versions import Version
from ..wiring import Wiring
from .description import Description, Violation, few, plainly, shortly, sound

__all__ = ["describe_record", "in_words"]

_CHECKSUM_BYTES = 4


def describe_record(data: bytes) -> Description:
    """Describe a record that came on bulk IN: an acknowledgement or a status (chapters ACK and REQ)."""
    if data.startswith(STATUS_MAGIC):
        return _record("status", data, Status.decode, "REQ-003")
    return _record("acknowledgement", data, Ack.decode, "ACK-002")


def _record(kind: str, data: bytes, decode: Callable[[bytes], Ack | Status], clause: str) -> Description:
    try:
        record = decode(data)
    except ReplyError as error:
        finding = Violation("", clause, shortly(error))
        body, end = data[:-_CHECKSUM_BYTES], data[-_CHECKSUM_BYTES:]
        if len(data) in (Ack.BYTES, Status.BYTES) and end != (computed := zlib.crc32(body).to_bytes(4, "little")):
            finding = Violation("CHECKSUM", clause, f"CRC-32 {end[::-1].hex()} should be {computed[::-1].hex()}")
        return Description(kind, few(data), {}, (finding,))
    findings: tuple[Violation, ...] = ()
    if isinstance(record, Ack) and record.reason != Reason.ACCEPTED and record.commit_period:
        text = f"commit_period {record.commit_period} should be 0: the block is refused"
        findings = (Violation("", clause, text),)
    return Description(kind, in_words(record), plainly(record), findings)


def in_words(answer: Any) -> str:
    """What an answer of the device says, in a line."""
    match answer:
        case Ack():
            outcome = f"accepted, period {answer.commit_period}"
            if answer.reason != Reason.ACCEPTED:
                outcome = f"refused, {answer.reason.name}: {answer.reason.text}"
            flags = "".join(f", {flag}" for flag in plainly(answer.flags))
            return (
                f"{answer.sequence} {outcome}{flags}; {answer.state.name} at tick {answer.now}, room for {answer.free}"
            )
        case Status():
            faults = ", ".join(plainly(answer.faults)) or "no faults"
            last = f" (last {answer.last_refusal.name})" if answer.last_refusal else ""
            fired = " has fired" if answer.watchdog_fired else ""
            return (
                f"{answer.state.name} at tick {answer.now} (period {answer.period}), {faults}; "
                f"{answer.accepted} accepted, {answer.refused} refused{last}, {answer.late} late, {answer.lost} lost, "
                f"{answer.missed_commits} commits missed; watchdog of {answer.watchdog_ms} ms{fired}, "
                f"drive limit {answer.drive_limit}, since period {answer.since_period}, room for {answer.free}"
            )
        case Info():
            features = ", ".join(map(str, plainly(answer.features))) or "no features"
            version = Version(*answer.firmware)
            return f"firmware {version}, {answer.boards} boards, {answer.channels} transducers, {features}"
        case ClockReading():
            return f"tick {answer.now}, {answer.sync_pulses} sync pulses, the last in period {answer.sync_period}"
        case ReadBack():
            return f"{sound(answer.pulses)} since period {answer.since_period}"
        case Wiring():
            return f"transducer 0 on channel {answer.channels[0]}, the last on channel {answer.channels[-1]}"
    return ", ".join("fault" if report.faults else "well" for report in answer)
