"""Programs that use USB meet emulated devices, on a Linux machine without USB and without special rights.

A `MockUsb` is a directory that replaces /sys and /dev, and sockets that replace usbfs. Debian's package umockdev has a
library which, preloaded into a program, redirects file names, ioctls and uevents there, so that lsusb, dfu-util, libusb
and programs on top of it run unchanged. The devices' time follows the wall clock meanwhile.

This module speaks the preloaded library's own protocol (libumockdev-preload.c, unchanged since version 0.16): an ioctl
comes as three unsigned longs on the socket of its device's node, and until it is answered the program's memory can be
read and written through that socket. Kernel drivers are missing: the console's interfaces do not become a serial line.
A libusb without udev, such as that of libusb-package, finds the devices at its start and never hears of changes,
because the library imitates udev's messages.
"""

from __future__ import annotations

import errno
import fcntl
import os
import selectors
import shutil
import socket
import struct
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import count, cycle
from pathlib import Path
from time import monotonic_ns
from typing import IO, Protocol, Self

from ...base.errors import DeviceNotFoundError, ReplyError
from ...protocol.board import CORE_HZ
from ...protocol.timing import MICROFRAME_CYCLES
from ..door import Stall
from ..scheduler import Scheduler
from .sysfs import BUS, device_files, device_properties, interface_files, interface_properties, node_name
from .usb_bus import Peripheral
from .usbfs import KernelDevice, UsbFile
from .waiting import PreciseSelector

__all__ = ["Machine", "MockUsb", "run_under_mock"]

WRAPPER = "umockdev-wrapper"
BUS_LINKS = "sys/bus/usb/devices"
SOCKETS = "ioctl/dev"
CHOICE = "bConfigurationValue"  # the only file of sysfs that changes
HUB = "devices/platform/phasewire/usb1"
ADDRESSES = range(2, 128)  # the bus's own hub would have 1

LONGEST_WAIT_CYCLES = CORE_HZ // 100
LONGEST_STEP_CYCLES = CORE_HZ // 4  # the most lost time that a slow or stopped machine catches up
ANSWER_S = 2.0  # a program that waits for its ioctl sends its memory at once, unless it was stopped
MOST_PROGRAMS = 64  # with one node open
LISTEN_S = 0.1  # then a uevent is lost, as when the kernel's buffer is full

_MESSAGE = struct.Struct("@LLL")  # its subject, and two arguments
_IOCTL, _DONE, _READ_MEMORY, _WRITE_MEMORY = 1, 3, 5, 6
_MINUS_ONE = 2 ** (8 * struct.calcsize("@L")) - 1  # as an unsigned long


class HasFileno(Protocol):
    """Anything that select() accepts."""

    def fileno(self) -> int:
        """Its number."""


class Machine(Protocol):
    """The part of an emulator that is needed here."""

    @property
    def scheduler(self) -> Scheduler:
        """Its time."""

    @property
    def usb(self) -> Peripheral:
        """Its USB side."""


def run_under_mock(
    command: Sequence[str],
    machines: Iterable[Machine],
    *,
    stdout: IO[bytes] | None = None,
    stderr: IO[bytes] | None = None,
) -> int:
    """Run a program that sees only emulated devices on USB.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    machines : iterable of Machine
        The devices. Their time continues from its present state.
    stdout, stderr : file, optional
        The destination of the program's output; by default this process's own.

    Returns
    -------
    int
        The program's exit code, or 128 plus the number of the signal that ended it, as in a shell.

    Raises
    ------
    DeviceNotFoundError
        If umockdev is not installed.
    ValueError
        If there is no program to run.
    """
    if not command:
        raise ValueError("there is no program to run; name one, such as lsusb")
    if not shutil.which(WRAPPER):
        raise DeviceNotFoundError(f"there is no program {WRAPPER}; on Debian and its kin: apt-get install umockdev")
    with MockUsb(machines) as bed:
        child = subprocess.Popen([WRAPPER, *command], env=bed.environment(), stdout=stdout, stderr=stderr)
        try:
            bed.serve(child.pid)
        finally:
            child.kill()  # needed only if serving was interrupted
            code = child.wait()
    return code if code >= 0 else 128 - code


class MockUsb:
    """A directory and sockets that replace a machine's USB: one bus, with a device in each of its ports.

    Parameters
    ----------
    machines : iterable of Machine
        The devices in ports 1, 2 and so on.

    Attributes
    ----------
    root : Path
        The directory.
    """

    def __init__(self, machines: Iterable[Machine]) -> None:
        self._addresses = cycle(ADDRESSES)
        self._sequence = count(1)
        self._selector = PreciseSelector()
        self._directory = tempfile.TemporaryDirectory(prefix="phasewire-")
        self.root = Path(self._directory.name)
        for folder in (BUS_LINKS, f"dev/bus/usb/{BUS:03}", f"{SOCKETS}/bus/usb/{BUS:03}"):
            (self.root / folder).mkdir(parents=True)
        self._ports: list[_Port] = []
        for number, machine in enumerate(machines, start=1):
            self._ports.append(_Port(self, number, machine))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        for port in self._ports:
            port.close()
        self._selector.close()
        self._directory.cleanup()

    def environment(self) -> dict[str, str]:
        """The environment of a program that uses this directory."""
        return {**os.environ, "UMOCKDEV_DIR": str(self.root)}

    def serve(self, pid: int) -> None:
        """Let the devices' time follow the wall clock until a child process has ended."""
        before = monotonic_ns()
        with os.fdopen(os.pidfd_open(pid)) as child:
            self.watch(child, lambda: None)  # so that its end stops the wait
            while os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                self._selector.select(min((port.rest() for port in self._ports), default=LONGEST_WAIT_CYCLES / CORE_HZ))
                now = monotonic_ns()
                for port in self._ports:
                    port.run((now - before) * CORE_HZ // 10**9)
                before = now
                # Requests of programs arrive at this time: a device that told a program to come back later checks it.
                for key, _ in self._selector.select(0):
                    key.data()
            self.forget(child)

    def watch(self, file: HasFileno, action: Callable[[], None]) -> None:
        """Call an action whenever a file can be read."""
        self._selector.register(file, selectors.EVENT_READ, action)

    def forget(self, file: HasFileno) -> None:
        """Stop watching a file."""
        self._selector.unregister(file)

    def new_address(self) -> int:
        """The next free address on the bus."""
        taken = {port.address for port in self._ports}
        return next(address for address in self._addresses if address not in taken)

    def announce(self, action: str, path: str, properties: Mapping[str, str]) -> None:
        """Tell all listening programs what came or went, in the kernel's words (a uevent)."""
        lines = [f"{action}@/{path}", f"ACTION={action}", f"DEVPATH=/{path}", "SUBSYSTEM=usb"]
        lines += [f"{name}={value}" for name, value in properties.items()]
        lines += [f"SEQNUM={next(self._sequence)}"]
        message = "".join(f"{line}\0" for line in lines).encode()
        for listener in self.root.glob("event*"):
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender, suppress(OSError):  # it no longer listens
                sender.settimeout(LISTEN_S)
                sender.sendto(message, str(listener))


class _Port:
    """A port of the bus, and the programs' view of the device in it."""

    def __init__(self, bed: MockUsb, number: int, machine: Machine) -> None:
        self._bed = bed
        self._number = number
        self._machine = machine
        self._due = machine.scheduler.now
        self._met: int | None = None  # the last attachment of the device that was seen
        self._nodes: list[_Node] = []
        self._shown: _Node | None = None  # of the nodes, that of the present attachment
        self.run(0)

    @property
    def address(self) -> int | None:
        """The address of the device on the bus."""
        return self._shown.device.address if self._shown else None

    def rest(self) -> float:
        """The time until the next action, in seconds, without a request."""
        upcoming = self._shown.device.next_time() if self._shown else self._machine.scheduler.next_time()
        wait = LONGEST_WAIT_CYCLES if upcoming is None else upcoming - self._due
        return min(max(wait, MICROFRAME_CYCLES), LONGEST_WAIT_CYCLES) / CORE_HZ

    def run(self, cycles: int) -> None:
        """Let time pass."""
        self._due += min(cycles, LONGEST_STEP_CYCLES)
        scheduler, usb = self._machine.scheduler, self._machine.usb
        if self._shown:
            self._shown.device.run_until(self._due)
            if not self._shown.device.present:
                self._remove()
        scheduler.run_until(max(self._due, scheduler.now))
        if self._shown is None and usb.attached and usb.generation != self._met:
            self._met = usb.generation
            self._add()

    def close(self) -> None:
        """Remove everything, even while programs still run."""
        self._remove()
        for node in self._nodes:
            node.close()

    def _add(self) -> None:
        try:
            device = KernelDevice(self._machine.usb, self._machine.scheduler, self._bed.new_address())
        except (Stall, ReplyError):
            return  # a kernel gives up, too
        self._shown = _Node(self._bed, self._number, device)
        self._nodes.append(self._shown)

    def _remove(self) -> None:
        if self._shown:
            self._shown.remove()
            self._shown = None


class _Node:
    """A device that is or was attached: its directories in sysfs, its node in /dev, and programs that have it open."""

    def __init__(self, bed: MockUsb, port: int, device: KernelDevice) -> None:
        self.device = device
        self._bed = bed
        self._port = port
        self._programs: set[_Program] = set()
        self._poll_file = PollFile(bed.root / "dev" / node_name(device))
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        place = bed.root / SOCKETS / node_name(device)
        place.unlink(missing_ok=True)  # of an earlier device with this address
        self._socket.bind(str(place))
        self._socket.listen()
        bed.watch(self._socket, self._open)
        path = f"{HUB}/{BUS}-{port}"
        self._folders = {path: (device_properties(device), device_files(device, port))}
        for interface in device.interfaces:
            if interface.bAlternateSetting == 0:
                name = f"{BUS}-{port}:{device.head.bConfigurationValue}.{interface.bInterfaceNumber}"
                about = interface_properties(device, interface), interface_files(device, interface)
                self._folders[f"{path}/{name}"] = about
        device.on_choice = self._show_choice
        for path, (properties, files) in self._folders.items():
            self._make_folder(path, files)
            bed.announce("add", path, properties)

    def remove(self) -> None:
        """The device has gone. Programs are told, and keep open files, even those just being opened."""
        (self._bed.root / "dev" / node_name(self.device)).unlink()
        self.device.disconnect()
        for path, (properties, _) in reversed(self._folders.items()):
            (self._bed.root / BUS_LINKS / Path(path).name).unlink()
            shutil.rmtree(self._bed.root / "sys" / path)
            self._bed.announce("remove", path, properties)

    def close(self) -> None:
        """Drop the programs, too."""
        self._bed.forget(self._socket)
        self._socket.close()
        for program in list(self._programs):
            self._leave(program)
        self._poll_file.close()

    def _make_folder(self, path: str, files: Mapping[str, bytes]) -> None:
        """Make a directory of sysfs, and the link that leads to it."""
        folder, link = self._bed.root / "sys" / path, self._bed.root / BUS_LINKS / Path(path).name
        folder.mkdir(parents=True)
        for name, content in files.items():
            (folder / name).write_bytes(content)
        (folder / "subsystem").symlink_to(os.path.relpath(self._bed.root / "sys/bus/usb", folder))
        link.symlink_to(os.path.relpath(folder, link.parent))

    def _open(self) -> None:
        """A program opens it."""
        try:
            connection, _ = self._socket.accept()
        except OSError:  # no file is free for it, or it has gone
            return
        if len(self._programs) == MOST_PROGRAMS:
            connection.close()
            return
        program = _Program(connection, self.device.open(self._show))
        self._programs.add(program)
        self._bed.watch(connection, partial(self._serve, program))

    def _serve(self, program: _Program) -> None:
        """A program has a request, or has gone."""
        try:
            program.serve()
        except OSError:
            self._leave(program)

    def _leave(self, program: _Program) -> None:
        self._programs.remove(program)
        self._bed.forget(program.connection)
        program.connection.close()
        program.file.close()
        self._show()

    def _show_choice(self) -> None:
        """Another configuration was selected, or none."""
        file = self._bed.root / BUS_LINKS / f"{BUS}-{self._port}" / CHOICE
        new = file.with_suffix(".new")
        new.write_bytes(device_files(self.device, self._port)[CHOICE])
        new.replace(file)  # at once, because a program may be reading it

    def _show(self) -> None:
        self._poll_file.show(any(program.file.writable for program in self._programs))


class PollFile:
    """The file in place of a device's node. It only signals POLLOUT: it is a pipe, full or not."""

    def __init__(self, path: Path) -> None:
        os.mkfifo(path)
        self._pipe = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, 1)  # one page, which one byte fills
        os.write(self._pipe, b"\0")
        self._writable = False

    def show(self, writable: bool) -> None:
        """Make poll() signal POLLOUT, or not."""
        if writable and not self._writable:
            os.read(self._pipe, 1)
        elif self._writable and not writable:
            os.write(self._pipe, b"\0")
        self._writable = writable

    def close(self) -> None:
        """Close it."""
        os.close(self._pipe)


class _Program:
    """A program with an open node: its requests, and its memory while it waits for the answer."""

    def __init__(self, connection: socket.socket, file: UsbFile) -> None:
        connection.settimeout(ANSWER_S)
        self.connection = connection
        self.file = file
        self._began = b""

    def serve(self) -> None:
        """Take one ioctl, or its first bytes; raises `OSError` if the program is gone."""
        self._began += self._receive(_MESSAGE.size - len(self._began), partly=True)
        if len(self._began) < _MESSAGE.size:
            return  # the devices do not wait for the rest
        kind, request, argument = _MESSAGE.unpack(self._began)
        self._began = b""
        if kind == _IOCTL:
            self.file.ioctl(request, argument, self, self._reply)
        else:
            self._reply(-errno.EINVAL)  # read() and write()

    def read(self, address: int, size: int) -> bytes:
        """Bytes of its memory; raises `OSError` if the program is gone."""
        if not size:
            return b""
        self._send(_MESSAGE.pack(_READ_MEMORY, address, size))
        return self._receive(size)

    def write(self, address: int, data: bytes) -> None:
        """Change its memory."""
        if data:
            self._send(_MESSAGE.pack(_WRITE_MEMORY, address, len(data)) + data)

    def _reply(self, result: int) -> None:
        outcome = (result, 0) if result >= 0 else (_MINUS_ONE, -result)
        self.connection.setblocking(False)  # a program waits for its only answer
        self._send(_MESSAGE.pack(_DONE, *outcome))
        self.connection.settimeout(ANSWER_S)

    def _send(self, data: bytes) -> None:
        try:
            self.connection.sendall(data)
        except OSError:  # it has gone, or reads nothing; the next read notices
            with suppress(OSError):
                self.connection.shutdown(socket.SHUT_RDWR)

    def _receive(self, size: int, partly: bool = False) -> bytes:
        data = bytearray()
        while len(data) < size and not (data and partly):
            piece = self.connection.recv(size - len(data))
            if not piece:
                raise ConnectionResetError("the program has closed its file")
            data += piece
        return bytes(data)
