"""What goes wrong on USB: packets, endpoints, the bus, the cable and the host."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from ...protocol.codes import BLOCK_BYTES
from ...protocol.enumeration import CONSOLE_ENDPOINT_IN, CONSOLE_ENDPOINT_OUT, ENDPOINT_IN, ENDPOINT_OUT
from ..interfaces.usb_device import Flip
from .fault import FaultTarget, InjectedFault, Lasting
from .limits import ByteBit, OneOf, Times, Whole

__all__ = ["BusReset", "BusSuspended", "FlippedUsbBit", "SilentHost", "StalledEndpoint", "Unplugged"]


@dataclass(frozen=True, kw_only=True)
class FlippedUsbBit(InjectedFault):
    """A bit that is wrong in packets of an endpoint, as a faulty memory leaves it: USB's own checksum is right.

    Parameters
    ----------
    endpoint : int
        The endpoint's address: 1 and 129 carry blocks and records, 3 and 131 the console.
    byte, bit : int
        The place in the packet; shorter ones pass unharmed and do not count.
    times : int
        How many packets.
    """

    endpoint: Annotated[int, OneOf((ENDPOINT_OUT, ENDPOINT_IN, CONSOLE_ENDPOINT_OUT, CONSOLE_ENDPOINT_IN))]
    byte: Annotated[int, Whole(0, BLOCK_BYTES - 1)]
    bit: ByteBit = 0
    times: Times = 1

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Wait for such packets."""
        device.usb.flips += [Flip(self.endpoint, self.byte, self.bit)] * self.times


@dataclass(frozen=True, kw_only=True)
class StalledEndpoint(InjectedFault):
    """An endpoint that the device halts by itself, until the host clears that; it needs a configured device.

    Parameters
    ----------
    endpoint : int
        The endpoint's address: 1 and 129 carry blocks and records, 3 and 131 the console.
    """

    endpoint: Annotated[int, OneOf((ENDPOINT_OUT, ENDPOINT_IN, CONSOLE_ENDPOINT_OUT, CONSOLE_ENDPOINT_IN))]

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Halt it."""
        device.usb.halt(self.endpoint)


@dataclass(frozen=True, kw_only=True)
class Unplugged(Lasting):
    """A USB cable that is pulled out, and plugged in again at the end. The device has power of its own."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Pull it out."""
        device.usb.unplug()

    def end(self, device: FaultTarget) -> None:
        """Plug it in."""
        device.usb.plug()


@dataclass(frozen=True, kw_only=True)
class BusReset(InjectedFault):
    """A reset of the bus that the host's programs did not ask for."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Reset it."""
        if device.usb.attached:
            device.usb.reset()


@dataclass(frozen=True, kw_only=True)
class BusSuspended(Lasting):
    """A bus that is suspended, and resumes at the end."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Suspend it."""
        if device.usb.attached:
            device.usb.suspend()

    def end(self, device: FaultTarget) -> None:
        """Let it resume."""
        device.usb.resume()


@dataclass(frozen=True, kw_only=True)
class SilentHost(Lasting):
    """A host of which nothing arrives over USB, whatever it sends."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Hear nothing."""
        device.usb.deaf = True

    def end(self, device: FaultTarget) -> None:
        """Hear again."""
        device.usb.deaf = False
