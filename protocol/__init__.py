"""What travels between host, controller and processors, byte for byte.

This room holds the specification (SPEC.md) and its implementation: the board's numbers, pulses and their relation to
drives, blocks, acknowledgements, control requests, descriptors, the wiring table and the chain's own messages. It does
no I/O, keeps no time and knows no physics; host and emulator both stand on it and meet nowhere else.
"""

from __future__ import annotations

from .blocks import Update, pack, unpack
from .codes import Kind, Reason, Request
from .pulses import Pulses
from .replies import Ack, Info, Status
from .wiring import Output, Wiring

__all__ = [
    "Ack",
    "Info",
    "Kind",
    "Output",
    "Pulses",
    "Reason",
    "Request",
    "Status",
    "Update",
    "Wiring",
    "pack",
    "unpack",
]
