"""Requirements that no case can show, and why: a black box on a line does not reveal them.

Visible from outside are all traffic over USB and serial lines, all outputs tick by tick, and the effects of power,
cable, bus and the faults of `emulator.faults`. A requirement with a visible consequence needs a case and no entry here.
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
    "It limits currents and the voltage of a pull-up, which neither the data on the lines nor the outputs show; "
    "an ammeter and a voltmeter do.": ("USB-022",),
    "It fixes bytes of a message between controller and processors that carry nothing: if both agree on other ones, "
    "the outputs and all answers are the same.": ("CHN-012/1", "CHN-014/1"),
    "A processor's answer is only seen in the controller's own, which does not contain its time, and the "
    "controller may pass it on at any time.": ("CHN-016",),
    "The way of a message through a switch is only seen on the links: other routes would also reach every processor.": (
        "CHN-025/1",
        "CHN-025/2",
    ),
    "No fault of a bench makes a flash busy for 10 s: one that fails says so at once, and "
    "every other one is done in time.": ("DFU-008/3",),
}

REASONS: Mapping[str, str] = MappingProxyType({name: reason for reason, names in _BY_REASON.items() for name in names})
"""Why there is no case, by the identifier of the requirement."""
