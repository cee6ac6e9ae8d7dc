"""A device of a USB/IP server, attached to this Linux computer as one of its own.

The kernel's module vhci-hcd is a host controller whose ports are plugged through sockets. It is told by files of sysfs
which socket belongs to which port; the tool ``usbip`` does the same. A device that detaches itself and comes back, as
for new firmware, ends its connection: `follow` attaches it again.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ...errors import DeviceAccessError, DeviceNotFoundError
from .transport import Timekeeper

__all__ = ["CONTROLLER", "PORT", "Attached", "attach", "follow"]

PORT = 3240
"""The TCP port that is registered for USB/IP."""
CONTROLLER = Path("/sys/devices/platform/vhci_hcd.0")
"""Where the kernel's module is told what to attach."""

_VERSION, _IMPORT, _IMPORTED = 0x0111, 0x8003, 0x0003  # of the Linux kernel's Documentation/usb/usbip_protocol.rst
_REQUEST, _REPLY, _DEVICE = struct.Struct(">HHI32s"), struct.Struct(">HHI"), struct.Struct(">256s32sIIIHHHBBBBBB")
_REASONS = {2: "another client has it", 4: "there is no such device"}
_SUPER_SPEED = 5
_FREE = 4  # VDEV_ST_NULL
_SECONDS = 10.0
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
    try:
        with socket.create_connection((host, port), timeout=_SECONDS) as line:
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            line.sendall(_REQUEST.pack(_VERSION, _IMPORT, 0, bus_id.encode()))
            _, code, status = _REPLY.unpack(_receive(line, _REPLY.size))
            if code != _IMPORTED or status:
                reason = _REASONS.get(status, f"it answers {code:#06x}, status {status}")
                raise DeviceNotFoundError(f"{host}:{port} does not give device {bus_id}: {reason}")
            fields = _DEVICE.unpack(_receive(line, _DEVICE.size))
            bus, number, speed, vendor, product = fields[2:7]
            line.settimeout(None)  # the kernel takes the socket over
            free = _free_port(controller, speed)
            (controller / "attach").write_text(f"{free} {line.fileno()} {bus << 16 | number} {speed}\n")
    except PermissionError as error:
        raise DeviceAccessError(f"{error.filename} cannot be written: attach devices as root") from error
    except (OSError, EOFError) as error:
        raise DeviceNotFoundError(f"the USB/IP server at {host}:{port} cannot be used: {error}") from error
    return Attached(free, bus_id, vendor, product)


def follow(
    connect: Callable[[], Attached], clock: Timekeeper, patience_seconds: float, controller: Path = CONTROLLER
) -> Iterator[Attached]:
    """Attach a device, and attach it again each time that it has left; each attachment is yielded once.

    Parameters
    ----------
    connect : callable
        Attaches it.
    clock : Timekeeper
        To wait by.
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


def _receive(line: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = line.recv(count - len(data))
        if not part:
            raise EOFError("it has closed the connection")
        data += part
    return data
