"""A device of a USB/IP server, attached to this Linux computer as one of its own.

The kernel's module vhci-hcd is a host controller whose ports are plugged through sockets. It is told by files of sysfs
which socket belongs to which port; the tool ``usbip`` does the same. A device that detaches itself and comes back, as
for new firmware, ends its connection: `follow` attaches it again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ...base.errors import DeviceAccessError, DeviceNotFoundError
from ...protocol.usbip import PORT
from .transport import Timekeeper
from .usbip_link import take

__all__ = ["CONTROLLER", "PORT", "Attached", "attach", "follow"]

CONTROLLER = Path("/sys/devices/platform/vhci_hcd.0")
"""Where the kernel's module is told what to attach."""

_SUPER_SPEED = 5
_FREE = 4  # VDEV_ST_NULL
_LOOK_SECONDS = 0.05


@dataclass(frozen=True)
class Attached:
    """A device that is attached.

    Parameters
    ----------
    port : int
        The host controller's port.
    bus_id : str
        The device, as its server calls it.
    vendor, product : int
        Its numbers.
    """

    port: int
    bus_id: str
    vendor: int
    product: int


def attach(host: str, port: int = PORT, bus_id: str = "1-1", controller: Path = CONTROLLER) -> Attached:
    """Attach a device of a USB/IP server to this computer.

    Parameters
    ----------
    host : str
        The server.
    port : int
        Its TCP port.
    bus_id : str
        The device, as the server calls it.
    controller : Path
        The folder of the host controller in sysfs.

    Raises
    ------
    DeviceNotFoundError
        If this computer has no such host controller or no free port, or the server does not answer or has no such
        device.
    DeviceAccessError
        If this process may not attach devices.
    """
    if not controller.exists():
        raise DeviceNotFoundError(f"{controller} is missing: load the kernel's module by `modprobe vhci-hcd`, as root")
    line, device = take(host, port, bus_id)
    try:
        with line:
            free = _free_port(controller, device.speed)
            order = f"{free} {line.fileno()} {device.device_id} {device.speed}\n"
            (controller / "attach").write_text(order)  # the kernel takes the socket over
    except PermissionError as error:
        raise DeviceAccessError(f"{error.filename} cannot be written: attach devices as root") from error
    except OSError as error:
        raise DeviceNotFoundError(f"{controller} does not take device {bus_id}: {error}") from error
    return Attached(free, bus_id, device.vendor, device.product)


def follow(
    connect: Callable[[], Attached], clock: Timekeeper, patience_seconds: float, controller: Path = CONTROLLER
) -> Iterator[Attached]:
    """Attach a device, and attach it again each time that it has left; each attachment is yielded once.

    Parameters
    ----------
    connect : callable
        Attaches it.
    clock : Timekeeper
        The clock to wait by.
    patience_seconds : float
        How long a device that has left may be missing.
    controller : Path
        The folder of the host controller in sysfs.

    Raises
    ------
    DeviceNotFoundError, DeviceAccessError
        As `attach`, if the device is not there at first, or does not come back.
    """
    attached = connect()
    while True:
        yield attached
        while attached.port not in _free_ports(controller):
            clock.sleep(_LOOK_SECONDS)
        end = clock.monotonic() + patience_seconds
        while True:
            try:
                attached = connect()
                break
            except DeviceNotFoundError:
                if clock.monotonic() >= end:
                    raise
                clock.sleep(_LOOK_SECONDS)


def _free_port(controller: Path, speed: int) -> int:
    hub = "ss" if speed >= _SUPER_SPEED else "hs"
    free = [port for port, kind in _free_ports(controller).items() if kind == hub]
    if not free:
        raise DeviceNotFoundError(f"{controller} has no free port; detach a device by `usbip detach`")
    return free[0]


def _free_ports(controller: Path) -> dict[int, str]:
    """Ports to which nothing is attached, and the kind of hub of each."""
    rows = [line.split() for file in sorted(controller.glob("status*")) for line in file.read_text().splitlines()]
    return {int(row[1]): row[0] for row in rows if row[0] in ("hs", "ss") and int(row[2]) == _FREE}
