"""What messages of the chain mean (SPEC.md, chapter CHN)."""

from __future__ import annotations

from ...base.errors import ChainError
from .. import chain
from .description import Description, Violation, few, plainly

__all__ = ["describe_message"]


def describe_message(tokens: bytes) -> Description:
    """Describe a message between controller and processors, END as the byte of its code (chapter CHN)."""
    try:
        message = chain.decode(tokens)
    except ChainError as error:
        return Description("message", few(tokens), {}, (Violation("", error.clause, str(error)),))
    name, fields = message.CHANNEL_END.name, plainly(message)
    told = [
        f"{field} {few(value) if isinstance(value, bytes) else fields[field]}" for field, value in vars(message).items()
    ]
    return Description("message", f"{name}: {', '.join(told)}", {"name": name, "node": message.node} | fields)
