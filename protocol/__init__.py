"""What travels between host, controller and processors, byte for byte.

This room holds the specification (SPEC.md) and its implementation: the board's numbers, pulses and their relation to
drives, the wiring table; blocks, records and control requests; descriptors, serial frames and the console; the chain's
messages and times; firmware images and DFU. `layout` has the normative bytes, `describe` says what bytes mean, and
`vectors` makes the golden vectors. It does no I/O, keeps no time and knows no physics; host and emulator both stand on
it and meet nowhere else.
"""

from __future__ import annotations

from .blocks import (
    AmplitudeModulation,
    Block,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
    unpack,
)
from .codes import NOW, Action, Fault, Kind, Reason, Request, State
from .pulses import Pulses
from .quantise import PulseFrames, quantise
from .replies import Ack, Info, Status
from .updates import pack_updates, unpack_updates
from .wiring import Pin, Wiring

__all__ = [
    "NOW",
    "Ack",
    "Action",
    "AmplitudeModulation",
    "Block",
    "Clock",
    "Entries",
    "Entry",
    "Fault",
    "Info",
    "Kind",
    "NoOp",
    "Output",
    "Pin",
    "PlaySequence",
    "PulseFrames",
    "Pulses",
    "Reason",
    "Request",
    "Samples",
    "Slot",
    "State",
    "Status",
    "Update",
    "Wiring",
    "pack",
    "pack_updates",
    "quantise",
    "unpack",
    "unpack_updates",
]


def __dir__() -> list[str]:
    return __all__
