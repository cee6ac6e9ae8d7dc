"""What blocks mean (SPEC.md, chapter BLK)."""

from __future__ import annotations

from ...base.errors import BlockError
from ..blocks import (
    AmplitudeModulation,
    Body,
    Clock,
    Entries,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    header_fields,
    unpack,
)
from ..codes import BLOCK_MAGIC, HEADER_BYTES, NOW, Kind, Reason
from .description import Description, Violation, few, name_of, plainly, sound

__all__ = ["describe_block"]

_TOLD_ANYWAY = ("magic", "version", "kind", "sequence", "checksum")


def describe_block(data: bytes) -> Description:
    """Describe what came on bulk OUT (chapter BLK)."""
    try:
        body, sequence, restart = unpack(data)
    except BlockError as error:
        reason = Reason(error.reason)
        return _refused_block(data, Violation(reason.name, reason.clause, str(error)))
    name = body.KIND.name
    return Description(
        "block",
        f"{name} {sequence}{', numbering anew' if restart else ''}: {_said(body)}",
        {"kind": name, "sequence": sequence, "restart": restart} | plainly(body),
        pulses=getattr(body, "pulses", None),
    )


def _refused_block(data: bytes, finding: Violation) -> Description:
    """What can be read all the same of a block that is refused: its header, if it is one."""
    if not data.startswith(BLOCK_MAGIC) or len(data) < HEADER_BYTES:
        return Description("block", few(data), {}, (finding,))
    fields = header_fields(data)
    told = {name: value for name, value in fields.items() if value and name not in _TOLD_ANYWAY}
    name = name_of(Kind, fields["kind"])
    summary = ", ".join([f"{name} {fields['sequence']}", *(f"{field} {value}" for field, value in told.items())])
    return Description("block", summary, fields | {"kind": name, "magic": BLOCK_MAGIC.decode()}, (finding,))


def _said(body: Body) -> str:
    """What a block's body asks for, in words."""
    match body:
        case Update():
            return f"{sound(body.pulses)} {_when(body.period)}"
        case Slot():
            return f"{sound(body.pulses)} into slot {body.number}"
        case Entries():
            return f"store entries {_range(body.first, len(body.entries))}"
        case PlaySequence():
            times = f"{body.repeats} times" if body.repeats else "until something else follows"
            alone = ", also without the host" if body.unattended else ""
            return f"play entries {_range(body.first, body.count)} {_when(body.period)}, {times}{alone}"
        case Samples():
            return f"store samples {_range(body.first, len(body.samples))}"
        case AmplitudeModulation():
            held = f"{body.hold} periods each"
            return f"modulate with samples {_range(body.first, body.count)} {_when(body.period)}, {held}"
        case Output():
            return f"{body.action.name} {_when(body.period)}"
        case Clock():
            return "tell the time"
        case NoOp():
            return "a sign of life"


def _when(period: int) -> str:
    return "as soon as possible" if period == NOW else f"from period {period} on"


def _range(first: int, count: int) -> str:
    return f"{first} to {first + count - 1}"
