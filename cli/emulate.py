"""The command that offers emulated devices to other programs: ``emulate``."""

from __future__ import annotations

import asyncio
import gc
import ipaddress
import json
import shlex
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console

from ..base.pictures import check_picture_path, save_figure
from ..base.signals import loading
from ..base.storage import check_outputs, claimed
from ..emulator.doors.address import SPEEDS
from ..emulator.doors.serving import Server, precise_loop
from ..emulator.doors.station import Pace, Station
from ..emulator.doors.uart import Uart
from ..emulator.doors.usbip_session import Exported
from ..emulator.doors.warming import load_kernels
from ..emulator.firmware.flash import Flash
from ..emulator.firmware.loader import keep
from ..emulator.machine import Emulator
from ..emulator.ports.export import check_export_path, export
from ..emulator.scenario import read_scenario
from ..emulator.timeline import CYCLES_PER_MICROSECOND, draw_timeline, way_of_an_update
from ..protocol.board import CORE_HZ
from ..protocol.framing import BAUD
from ..protocol.timing import FIVE_WIRE, LINKS, Link
from ..protocol.usbip import PORT
from .console import among, console_for, error_console, write_json

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

BUS = 1
MOST_DEVICES = 127  # on one bus (USB 2.0, 8.3.2.1)
PACES = {pace.value: pace for pace in Pace}
PTY, TCP = "pty", "tcp"
STATUS_SECONDS = 0.5
HISTORY_PERIODS = 4_000  # the outputs are not examined, and a device may be served for days

Choice = TypeVar("Choice")


@dataclass
class Stand:
    """An emulated device and its addresses."""

    emulator: Emulator
    station: Station
    bus_id: str | None = None
    serial_line: str | None = None
    usbredir_port: int | None = None

    def record(self) -> dict[str, Any]:
        """The record for scripts."""
        return {
            "serial": self.emulator.serial,
            "bus_id": self.bus_id,
            "serial_line": self.serial_line,
            "usbredir_port": self.usbredir_port,
        }


@dataclass(frozen=True)
class Wishes:
    """The doors to open."""

    usbip: bool
    usbredir: bool
    serial: str | None
    host: str
    port: int
    serial_port: int
    baud: int
    seconds: float | None
    json_target: str | None


@commands.command(epilog="Example: phasewire emulate --serial pty --seconds 60")
def emulate(
    context: typer.Context,
    usbip: Annotated[
        bool, typer.Option("--usbip", help="Offer the devices by USB/IP; the default if no door is requested.")
    ] = False,
    usbredir: Annotated[
        bool, typer.Option("--usbredir", help="Offer each device to a QEMU by usbredir, on a TCP port of its own.")
    ] = False,
    serial: Annotated[
        str | None,
        typer.Option(
            metavar="pty|tcp",
            help="Offer the UART of each device, as a pseudo-terminal or as a TCP port of its own.",
            autocompletion=among((PTY, TCP)),
        ),
    ] = None,
    count: Annotated[int | None, typer.Option(min=1, max=MOST_DEVICES, help="How many devices; 1 by default.")] = None,
    serial_numbers: Annotated[
        list[str] | None,
        typer.Option("--serial-number", metavar="TEXT", help="Serial number; give one for each device, or none."),
    ] = None,
    link: Annotated[
        str, typer.Option(help=f"Links of the chain: {' or '.join(LINKS)}.", autocompletion=among(LINKS))
    ] = FIVE_WIRE.name,
    speed: Annotated[
        str, typer.Option(help=f"Speed of the USB bus: {' or '.join(SPEEDS)}.", autocompletion=among(SPEEDS))
    ] = "high",
    pace: Annotated[
        str,
        typer.Option(
            help="What makes the devices' time pass: wall, the wall clock, or fast, only the requests that they get, "
            "as fast as they can be computed, so that a slow host trips no watchdog. Streams need wall.",
            autocompletion=among(PACES),
        ),
    ] = Pace.WALL.value,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="How long to serve, in s; until Ctrl-C by default.")
    ] = None,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on. With another than 127.0.0.1 whoever reaches this computer can use the devices: "
            "neither USB/IP nor a serial line authenticates or encrypts."
        ),
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port of USB/IP; 0 for any free one.")] = PORT,
    serial_port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="TCP port of the first device's UART; 0 for any free one, for each."),
    ] = 0,
    baud: Annotated[int, typer.Option(help="Of the UARTs, in bits per second.")] = BAUD,
    shared_sync: Annotated[
        bool, typer.Option("--shared-sync", help="Let the devices share one sync line, which the first one drives.")
    ] = False,
    scenario: Annotated[
        Path | None,
        typer.Option(
            help="TOML file with faults of each device and their times.", exists=True, dir_okay=False, readable=True
        ),
    ] = None,
    flash: Annotated[
        Path | None,
        typer.Option(
            help="File that is the device's flash: read at the start if it exists, written at each step of an "
            "upgrade and at the end. Another emulator cannot use it at the same time.",
            dir_okay=False,
        ),
    ] = None,
    program: Annotated[
        str | None,
        typer.Option(
            "--umockdev",
            metavar="COMMAND",
            help='Run a program, such as "lsusb -v", that sees only these devices on USB. It '
            "needs umockdev: apt-get install umockdev on Debian and its kin.",
        ),
    ] = None,
    exported: Annotated[
        Path | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="At the end write the last 0.1 s or more of the first device's outputs to FILE.vcd or FILE.sr.",
        ),
    ] = None,
    timeline: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Serve nothing; draw one update on its way through all stages."),
    ] = None,
    json_target: Annotated[
        str | None,
        typer.Option(
            "--json",
            metavar="FILE",
            help="Write the addresses of the devices as JSON to FILE, once they exist; - is a line on standard output.",
        ),
    ] = None,
) -> None:
    """Serve emulated devices to other programs, until Ctrl-C.

    By USB/IP a Linux machine attaches them as real USB devices, with its own drivers: usb: and any program that uses
    USB find them there. A serial line carries the console and frames.
    """
    check_outputs([json_target, exported, timeline, flash])
    if timeline:
        check_picture_path(timeline)
    if exported:
        check_export_path(exported)
    numbers = _serial_numbers(count, serial_numbers or [])
    if serial not in (None, PTY, TCP):
        raise ValueError(f"unknown kind of serial line {serial!r}; known are {PTY} and {TCP}")
    wanted_link, wanted_speed = _chosen("link", link, LINKS), _chosen("speed", speed, SPEEDS)
    wanted_pace = _chosen("pace", pace, PACES)
    if timeline:
        _draw_way(timeline, wanted_link)
        return
    if flash and len(numbers) > 1:
        raise ValueError(f"{flash} is the flash of one device, not of {len(numbers)}")
    if flash:
        context.with_resource(claimed(flash))  # two devices would each lose what the other one writes
    faults = read_scenario(scenario) if scenario else ()
    emulators: list[Emulator] = []
    for number in numbers:
        emulators.append(
            Emulator(
                link=wanted_link,
                speed=wanted_speed,
                serial=number,
                flash=Flash.load(flash) if flash and flash.exists() else None,
                history_periods=HISTORY_PERIODS,
                sync=emulators[0].sync if shared_sync and emulators else None,
            )
        )
        emulators[-1].inject(*faults)
    if flash:
        keep(emulators[0].flash, flash, _complain)
    with loading():
        load_kernels()
    try:
        if program is not None:
            from ..emulator.doors.umockdev import run_under_mock  # for Linux only

            code = run_under_mock(shlex.split(program), emulators)
        else:
            wishes = Wishes(
                usbip or not (usbredir or serial), usbredir, serial, host, port, serial_port, baud, seconds, json_target
            )
            stands = [Stand(emulator, _station(emulator, wanted_pace)) for emulator in emulators]
            with suppress(KeyboardInterrupt), asyncio.Runner(loop_factory=precise_loop) as runner:
                runner.run(_serve(stands, wishes))  # Ctrl-C comes here if the loop cannot handle signals
            code = 0
            console_for(json_target).print("Ended; the devices are gone.")
        if exported:
            export(emulators[0].capture(), exported)
    finally:
        if flash:
            emulators[0].power_down()
            emulators[0].flash.save(flash)
    if code:
        raise typer.Exit(code)


def _complain(error: OSError) -> None:
    error_console().print(f"warning: the flash is not kept: {error}", style="yellow")


def _draw_way(path: Path, link: Link) -> None:
    """Draw one update on its way."""
    spans = way_of_an_update(Emulator(link=link))
    ready = max(span.ends for span in spans if span.kind == "rasterise") / CYCLES_PER_MICROSECOND
    plays = min(span.begins for span in spans if span.kind == "plays") / CYCLES_PER_MICROSECOND
    title = (
        f"One update on {link.wires}-wire links: all tables ready {ready:.1f} µs after its first bit, "
        f"played from the boundary at {plays:.1f} µs on"
    )
    save_figure(draw_timeline(spans, title), path)
    console_for(None).print(f"{title}. Picture: {path}")


def _serial_numbers(count: int | None, given: Sequence[str]) -> Sequence[str | None]:
    """A serial number for each device, or None for a random one."""
    if not given:
        return [None] * (count or 1)
    if count not in (None, len(given)):
        raise ValueError(f"{count} devices need as many serial numbers, or none; there are {len(given)}")
    if len(set(given)) < len(given):
        raise ValueError(f"two devices cannot have the same serial number: {', '.join(given)}")
    return given


def _chosen(what: str, name: str, choices: Mapping[str, Choice]) -> Choice:
    if name not in choices:
        raise ValueError(f"unknown {what} {name!r}; known are {' and '.join(choices)}")
    return choices[name]


def _station(emulator: Emulator, pace: Pace) -> Station:
    """An emulated device's time; it is patient while its firmware does not run, as in DFU mode."""
    return Station(emulator.scheduler, pace, patient=lambda: emulator.line is None)


async def _serve(stands: Sequence[Stand], wishes: Wishes) -> None:
    """Open the doors, print the addresses, and serve."""
    messages = error_console()
    stations = {stand.emulator.serial: stand.station for stand in stands}
    gc.freeze()  # what is loaded stays; collecting it again and again would delay the devices' time
    async with Server(stations, messages.print) as server:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(NotImplementedError):  # not on every system
                loop.add_signal_handler(number, server.stop)
        exports = [Exported(BUS, at, each.emulator.usb, each.station) for at, each in enumerate(stands, start=1)]
        usbip_port = await _offer_usbip(server, stands, exports, wishes) if wishes.usbip else None
        if wishes.usbredir:
            for stand, exported in zip(stands, exports, strict=True):
                stand.usbredir_port = await server.listen_usbredir(exported, wishes.host, 0)
        for index, stand in enumerate(stands if wishes.serial else ()):
            await _offer_line(server, stand, wishes, index)
        _announce(stands, wishes, usbip_port)
        with _status_line(messages, stands):
            await server.serve(wishes.seconds)


async def _offer_usbip(server: Server, stands: Sequence[Stand], exports: Sequence[Exported], wishes: Wishes) -> int:
    for stand, exported in zip(stands, exports, strict=True):
        stand.bus_id = exported.describe().bus_id
    return await server.listen_usbip({each.describe().bus_id: each for each in exports}, wishes.host, wishes.port)


async def _offer_line(server: Server, stand: Stand, wishes: Wishes, index: int) -> None:
    uart = Uart(lambda: stand.emulator.line, stand.emulator.scheduler, wishes.baud)
    if wishes.serial == PTY:
        stand.serial_line = server.open_pty(uart, stand.station)
    else:
        wanted = wishes.serial_port and wishes.serial_port + index
        port = await server.listen_serial(uart, stand.station, wishes.host, wanted)
        stand.serial_line = f"socket://{_in_url(wishes.host)}:{port}"


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _announce(stands: Sequence[Stand], wishes: Wishes, usbip_port: int | None) -> None:
    """Print the addresses of the devices, and the commands to type."""
    out = console_for(wishes.json_target)
    if usbip_port is not None:
        where = f"{_in_url(wishes.host)}:{usbip_port}"
        out.print(f"By USB/IP on {wishes.host}, port {usbip_port}. On the Linux machine that attaches them, as root:")
        out.print("  modprobe vhci-hcd")
        for stand in stands:
            out.print(f"  phasewire attach {where} {stand.bus_id} --loop    # {stand.emulator.serial}")
    if wishes.usbredir:
        out.print(f"By usbredir on {wishes.host}. Options of a QEMU that uses a device:")
        for stand in stands:
            out.print(
                f"  -device usb-ehci -chardev socket,id=usb,host={wishes.host},port={stand.usbredir_port} "
                f"-device usb-redir,chardev=usb    # {stand.emulator.serial}"
            )
    if wishes.serial:
        out.print(f"By serial lines of {wishes.baud} baud:")
        for stand in stands:
            out.print(
                f"  python -m serial.tools.miniterm {stand.serial_line} {wishes.baud}    # {stand.emulator.serial}"
            )
    if not _is_loopback(wishes.host) and (wishes.usbip or wishes.usbredir or wishes.serial == TCP):
        error_console().print(
            f"warning: whoever reaches {wishes.host} can use these devices, and read their traffic", style="yellow"
        )
    record = {
        "format": "phasewire-emulate-1",
        "usbip": None if usbip_port is None else {"host": wishes.host, "port": usbip_port},
        "devices": [stand.record() for stand in stands],
    }
    if wishes.json_target == "-":
        typer.echo(json.dumps(record))
    else:
        write_json(wishes.json_target, record)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


@contextmanager
def _status_line(console: Console, stands: Sequence[Stand]) -> Iterator[None]:
    """Show the state of the devices on one line, if there is a terminal for it."""
    if not console.is_terminal:
        yield
        return
    with console.status("") as status:

        async def renew() -> None:
            while True:
                status.update("; ".join(map(_how_it_is, stands)) + " (Ctrl-C ends)")
                await asyncio.sleep(STATUS_SECONDS)

        task = asyncio.get_running_loop().create_task(renew())
        try:
            yield
        finally:
            task.cancel()


def _how_it_is(stand: Stand) -> str:
    station = stand.station
    behind = station.seconds_behind
    late = f", {behind:.1f} s behind the clock" if behind > STATUS_SECONDS else ""
    controller = stand.emulator.controller
    state = controller.state.name if controller else "starting"
    return f"{stand.emulator.serial} {state} at {station.scheduler.now / CORE_HZ:.1f} s{late}"
