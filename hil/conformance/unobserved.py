"""Requirements that no case can show, and why: what a black box at the end of a line gives away to nobody.

Seen from outside are all that travels over USB and serial lines, all outputs tick by tick, and what power, cable, bus
and the faults of `emulator.faults` bring about. What has a consequence there belongs into a case and not into here.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["REASONS"]

_BY_REASON: Mapping[str, tuple[str, ...]] = {
    "It binds hosts, not devices.": (
        "REQ-002",
        "USB-005",
        "USB-017/2",
        "SER-009/2",
        "SER-011/2",
        "FWU-013/2",
        "FWU-014",
        "VER-006",
    ),
    "It binds the software that builds, shows or sends images, not the device.": ("FWU-012/2",),
    "It asks for currents and for the voltage of a pull-up, which neither the data on the lines nor the outputs tell; "
    "an ammeter and a voltmeter do.": ("USB-022",),
    "It fixes bytes of a message between controller and processors that carry nothing: where both agree on other ones, "
    "the outputs and all answers are the same.": ("CHN-012/1", "CHN-014/1"),
    "A processor's answer is seen in the controller's own only, which bears no time at which it was sent, and the "
    "controller is free to pass it on when it likes.": ("CHN-016",),
    "Which way a switch sends a message is seen on the links alone; that every processor is reached, other routes "
    "would bring about as well.": ("CHN-025/1", "CHN-025/2"),
    "A flash that is busy for 10 s is none of the faults that a bench can cause: one that fails says so at once, and "
    "every other one is done in time.": ("DFU-008/3",),
}

REASONS: Mapping[str, str] = MappingProxyType({name: reason for reason, names in _BY_REASON.items() for name in names})
"""Why there is no case, by the identifier of the requirement."""
