"""What a serial line carries: frames and text (SPEC.md, chapters SER and CON)."""

from __future__ import annotations

from dataclasses import replace

from ...base.errors import FrameError
from .. import framing
from ..codes import FrameKind
from .blocks import describe_block
from .description import Description, Violation, few, plainly
from .replies import describe_record
from .usb import describe_request

__all__ = ["describe_frame", "describe_text"]


def describe_frame(data: bytes) -> Description:
    """Describe what stands before a zero on a serial line (chapter SER): the frame, or rather what it carries."""
    try:
        frame = framing.decode(data + framing.DELIMITER)
    except FrameError as error:
        return Description("frame", few(data), {}, (Violation("", "SER-006", str(error)),))
    match frame.kind:
        case FrameKind.BLOCK:
            return describe_block(frame.body)
        case FrameKind.RECORD:
            return describe_record(frame.body)
        case FrameKind.REQUEST:
            request = framing.SerialRequest.decode(frame.body)
            described = describe_request(request.setup.encode(), request.data or None)
            return replace(described, fields={"tag": request.tag} | dict(described.fields))
        case FrameKind.REPLY:
            reply = framing.SerialReply.decode(frame.body)
            return Description(
                "reply", f"to request {reply.tag}: {reply.outcome.name}, {few(reply.data)}", plainly(reply)
            )
        case FrameKind.CONSOLE:
            return Description("frame", "back to the console")


def describe_text(data: bytes) -> Description:
    """Describe text of the console (chapter CON)."""
    text = data.decode("latin-1")  # a character stands for one byte, as when it is typed
    return Description("text", ascii(text)[1:-1], {"text": text})
