"""The command that attaches a device of a USB/IP server to this computer: ``attach``."""

from __future__ import annotations

import re
import time
from itertools import islice
from typing import Annotated

import typer

from ..host.transports.vhci import PORT, Attached, attach, follow
from .console import console_for

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)


@commands.command(name="attach", epilog="Example: phasewire attach 127.0.0.1 --loop")
def attach_device(
    server: Annotated[str, typer.Argument(metavar="HOST[:PORT]", help="The USB/IP server.")],
    bus_id: Annotated[str, typer.Argument(metavar="BUSID", help="The device, as the server calls it.")] = "1-1",
    loop: Annotated[
        bool,
        typer.Option(
            "--loop",
            help="Attach the device again each time that it leaves, as it does for new firmware; until Ctrl-C.",
        ),
    ] = False,
    patience: Annotated[
        float, typer.Option(min=0, metavar="SECONDS", help="How long a device that has left may be missing, in s.")
    ] = 30.0,
) -> None:
    """Attach a device of a USB/IP server, such as `phasewire emulate`, to this Linux computer.

    This needs the rights of root and the kernel's module vhci-hcd. The device stays attached until it leaves by itself
    or is detached by `usbip detach`. The exit code is 3 if the server, the device or the module is missing.
    """
    host, port = _address(server)
    out = console_for(None)

    def connect() -> Attached:
        return attach(host, port, bus_id)

    for attached in islice(follow(connect, time, patience), None if loop else 1):
        out.print(
            f"{attached.bus_id} ({attached.vendor:04x}:{attached.product:04x}) is attached at port {attached.port}"
        )


def _address(server: str) -> tuple[str, int]:
    found = re.fullmatch(r"(?:\[(?P<inner>[^\[\]]+)\]|(?P<name>[^\[\]:]+))(?::(?P<port>\d{1,5}))?", server)
    port = int(found["port"] or PORT) if found else 0
    if not (found and 0 < port < 1 << 16):
        raise typer.BadParameter(f"{server!r} must be HOST or HOST:PORT", param_hint="HOST[:PORT]")
    return found["inner"] or found["name"], port
