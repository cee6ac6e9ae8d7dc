"""Blocks as the normative definition builds and judges them."""

from __future__ import annotations

from typing import Any

from construct import ConstructError, StreamError, TerminatedError
from phasewire.protocol import (
    AmplitudeModulation,
    Block,
    Entries,
    Output,
    PlaySequence,
    Pulses,
    Reason,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.layout.blocks import BLOCK


def by_construct(block: Block) -> bytes:
    """The block as the normative definition builds it."""
    body, sequence, restart = block
    fields: dict[str, Any] = {"flags": int(restart)}
    if isinstance(body, Update | Slot):
        fields["pulses"] = pairs(body.pulses)
    if isinstance(body, Update | Output):
        fields["period"] = body.period
    if isinstance(body, Slot):
        fields["first"] = body.number
    if isinstance(body, Output):
        fields["action"] = int(body.action)
    if isinstance(body, Entries):
        listed = [{"slot": entry.slot, "periods": entry.periods} for entry in body.entries]
        fields |= {"first": body.first, "count": len(listed), "entries": listed}
    if isinstance(body, Samples):
        fields |= {"first": body.first, "count": len(body.samples), "samples": body.samples}
    if isinstance(body, PlaySequence):
        fields |= {"first": body.first, "count": body.count, "period": body.period, "repeats": body.repeats}
        fields["flags"] += 2 * body.unattended
    if isinstance(body, AmplitudeModulation):
        fields |= {"first": body.first, "count": body.count, "period": body.period, "hold": body.hold}
    return bytes(BLOCK.build({"block": {"kind": int(body.KIND), "sequence": sequence, "body": fields}}))


def pairs(made: Pulses) -> list[dict[str, int]]:
    """Pulses as the normative definition takes them."""
    phase, width = made.phase.tolist(), made.width.tolist()
    return [
        {"even_phase": phase[i], "even_width": width[i], "odd_phase": phase[i + 1], "odd_width": width[i + 1]}
        for i in range(0, len(phase), 2)
    ]


def reason_by_construct(data: bytes) -> Reason:
    """Why the normative definition refuses bytes: the field at which it stops."""
    try:
        BLOCK.parse(data)
    except TerminatedError:
        return Reason.LENGTH
    except StreamError as error:
        return Reason.LENGTH if error.path == "(parsing) -> block" else Reason.FIELD
    except ConstructError as error:
        path = (error.path or "").split(" -> ")
        for name in ("checksum", "magic", "version", "kind", "pulses"):
            if name in path:
                return Reason.PULSE if name == "pulses" else Reason[name.upper()]
        return Reason.FIELD
    return Reason.ACCEPTED
