"""What bytes of the protocol mean, for people: what they are, what they say, and which clause they break.

Each function takes bytes and gives a `Description`; none of them refuses anything. What breaks the specification is in
the findings, beside what could be read all the same. Each module here is for one part of the specification.
"""

from __future__ import annotations

from .blocks import describe_block
from .chain import describe_message
from .description import Description, Violation
from .firmware import describe_image
from .replies import describe_record
from .serial import describe_frame, describe_text
from .usb import describe_request

__all__ = [
    "Description",
    "Violation",
    "describe_block",
    "describe_frame",
    "describe_image",
    "describe_message",
    "describe_record",
    "describe_request",
    "describe_text",
]
