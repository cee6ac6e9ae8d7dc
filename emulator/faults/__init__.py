"""What can go wrong with an emulated device: faults by name, place and period.

Each is a small value that says what happens, where, from which period on, and for how long or how often.
docs/reference/faults.md lists what the device reports then and what its outputs do. `Emulator.inject` lets them
happen; nothing here decides what comes of it. Whatever is broken stays broken over RESET and power-up, as hardware
does.

Places are counted as SPEC.md counts them: boards from 0, processors and the links that lead to them along the chain
from 0, bits of a port and of a byte from 0, transducers in array order.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from .boards import (
    ClockError,
    DeadBoard,
    DeadProcessor,
    HotBoard,
    LostSync,
    OpenTransducer,
    SlowProcessor,
    StuckHigh,
    StuckLow,
    WrongSupply,
)
from .fault import InjectedFault
from .messages import DoubledToken, FlippedBit, LostToken, SlowLink
from .power import FailingPage, FailingSector, PowerCut, PowerCutInWrite, StuckFlashBit, WriteProtectedFlash
from .usb import BusReset, BusSuspended, FlippedUsbBit, SilentHost, StalledEndpoint, Unplugged

__all__ = [
    "FAULTS",
    "BusReset",
    "BusSuspended",
    "ClockError",
    "DeadBoard",
    "DeadProcessor",
    "DoubledToken",
    "FailingPage",
    "FailingSector",
    "FlippedBit",
    "FlippedUsbBit",
    "HotBoard",
    "InjectedFault",
    "LostSync",
    "LostToken",
    "OpenTransducer",
    "PowerCut",
    "PowerCutInWrite",
    "SilentHost",
    "SlowLink",
    "SlowProcessor",
    "StalledEndpoint",
    "StuckFlashBit",
    "StuckHigh",
    "StuckLow",
    "Unplugged",
    "WriteProtectedFlash",
    "WrongSupply",
]

FAULTS: Mapping[str, type[InjectedFault]] = MappingProxyType(
    {
        kind.name(): kind
        for kind in (
            LostToken,
            DoubledToken,
            FlippedBit,
            SlowLink,
            DeadProcessor,
            DeadBoard,
            StuckHigh,
            StuckLow,
            OpenTransducer,
            ClockError,
            LostSync,
            HotBoard,
            WrongSupply,
            SlowProcessor,
            FlippedUsbBit,
            StalledEndpoint,
            Unplugged,
            BusReset,
            BusSuspended,
            SilentHost,
            PowerCut,
            PowerCutInWrite,
            WriteProtectedFlash,
            FailingSector,
            FailingPage,
            StuckFlashBit,
        )
    }
)
"""All of them, by name."""
