"""Whole firmware images of a device (SPEC.md, chapter FWU), of which the chain processors' program is real."""

from __future__ import annotations

from ...protocol.codes import Target
from ...protocol.firmware import Image, Segment
from ...protocol.versions import Version
from .build import FIRST_VERSION, processor_segment

__all__ = ["CONTROLLER_STAND_IN", "device_image"]

CONTROLLER_STAND_IN = b"stands for the program of the controller"
"""Nothing executes it."""


def device_image(version: tuple[int, int, int] = FIRST_VERSION) -> Image:
    """An image with the chain processors' program for all ten, which says that it is this version."""
    segments = (
        Segment(Target.ALL_PROCESSORS, processor_segment(version)),
        Segment(Target.CONTROLLER, CONTROLLER_STAND_IN),
    )
    return Image(Version(*version), segments)
