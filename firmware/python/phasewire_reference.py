"""The reference device in C, as a device of phasewire: its time is the host's, so that no verdict hangs on a clock.

With this folder on `PYTHONPATH`, phasewire finds the entry points beside this module::

    make -C firmware library
    PYTHONPATH=firmware/python phasewire conformance --device reference: --door reference-uart: \
        --capture reference: --levers reference: --allow reset --allow flash --allow drive

``reference-uart:`` is its UART, and ``reference:NAME`` a device of its own for each name. `PHASEWIRE_REFERENCE` names
another library, such as one with your changes, and `PHASEWIRE_REFERENCE_SPEED=full` puts it on a full-speed bus.
Whoever carries the core to a board can test in the same way (`library/library.h`).
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from phasewire.emulator import faults
from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.emulator.doors.serial_port import EmulatedPort
from phasewire.emulator.faults import InjectedFault
from phasewire.emulator.faults.fault import Lasting
from phasewire.emulator.faults.messages import MESSAGES, DamagedMessage
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.levers import SET_CONFIGURATION, EmulatorLevers, Levers
from phasewire.hil.conformance.sight.capture import Observer, Seen, Unseen, check_stretch
from phasewire.hil.conformance.sight.marks import Mark
from phasewire.protocol.board import CYCLES_PER_TICK, PROCESSORS, PROCESSORS_PER_BOARD, TICKS_PER_PERIOD
from phasewire.protocol.codes import FLASH_SECTOR_BYTES, DescriptorType
from phasewire.protocol.descriptors import descriptors
from phasewire.protocol.dfu import PAGE_BYTES
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed
from phasewire.protocol.requests import Setup
from phasewire.protocol.wiring import Wiring

LIBRARY, SPEED = "PHASEWIRE_REFERENCE", "PHASEWIRE_REFERENCE_SPEED"
BUILT = Path(__file__).parents[1] / "build" / "gcc" / "libphasewire-reference.so"
MOST_DATA = 2048
NAK, STALL = -1, -2
RESET, SUSPEND, RESUME = range(3)
NEVER = 2**64 - 1
BAUD = 3_000_000


@lru_cache(1)
def library() -> ctypes.CDLL:
    """The library, with the types of its functions (`library/library.h`)."""
    path = os.environ.get(LIBRARY, str(BUILT))
    found = ctypes.CDLL(path)
    pointer, number, flag, size = ctypes.c_void_p, ctypes.c_uint64, ctypes.c_bool, ctypes.c_size_t
    types: dict[str, tuple[Any, list[Any]]] = {
        "new": (pointer, [pointer, ctypes.c_char_p, flag]),
        "free": (None, [pointer]),
        "power": (None, [pointer, flag]),
        "now": (number, [pointer]),
        "due": (number, [pointer]),
        "run": (None, [pointer, number]),
        "serves": (flag, [pointer]),
        "origin": (number, [pointer]),
        "attached": (flag, [pointer]),
        "generation": (ctypes.c_uint32, [pointer]),
        "plug": (None, [pointer, flag]),
        "bus": (None, [pointer, ctypes.c_int]),
        "control": (ctypes.c_int, [pointer, ctypes.c_char_p, pointer]),
        "out": (ctypes.c_int, [pointer, ctypes.c_uint8, ctypes.c_char_p, size]),
        "in": (ctypes.c_int, [pointer, ctypes.c_uint8, pointer]),
        "configured": (flag, [pointer]),
        "hear": (size, [pointer, ctypes.c_char_p, size]),
        "say": (size, [pointer, pointer, size]),
        "break": (None, [pointer]),
        "words": (flag, [pointer, number, size, pointer]),
        "fault": (flag, [pointer, pointer]),
    }
    for name, (result, arguments) in types.items():
        function = getattr(found, f"machine_{name}")
        function.restype, function.argtypes = result, arguments
    return found


class Machine:
    """One device of the library, with the methods that phasewire's bus, port and levers use of an emulator.

    Parameters
    ----------
    wiring : Wiring
    serial : str
        Serial number.
    speed : Speed
        Speed of its bus.
    """

    closed = False

    def __init__(self, wiring: Wiring | None = None, serial: str = "REFERENCE-1", speed: Speed = HIGH_SPEED) -> None:
        self._c = library()
        channels = np.ascontiguousarray((wiring or Wiring.strips()).channels, np.uint16)
        self._self = self._c.machine_new(channels.ctypes.data, serial.encode(), speed is HIGH_SPEED)
        self.serial = serial
        self.url = f"reference:{serial}"
        self.scheduler = Time(self)
        self.usb = Bus(self, speed)
        self.line = Line(self)
        self.power_up()
        self.scheduler.run_until(0)

    def __del__(self) -> None:
        """Give the memory back."""
        self.call("free")

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a function of the library."""
        return getattr(self._c, f"machine_{name}")(self._self, *arguments)

    def power_up(self) -> None:
        """Give it power; it comes to the bus when it is ready."""
        self.call("power", True)

    def power_down(self) -> None:
        """Take its power away."""
        self.call("power", False)

    @property
    def running(self) -> SimpleNamespace:
        """When period 0 began, as an emulator says it."""
        return SimpleNamespace(time=SimpleNamespace(origin=int(self.call("origin")) * CYCLES_PER_TICK))

    def capture(self) -> SimpleNamespace:
        """What the ports play, by ticks, as an emulator's capture says it."""
        return SimpleNamespace(bits=lambda first, last: self.words(first // TICKS_PER_PERIOD, last // TICKS_PER_PERIOD))

    def words(self, first: int, last: int) -> np.ndarray:
        """The words of the ports in some periods, (50 · periods, 10); raises `Unseen` if they were not kept."""
        words = np.empty(((last - first) * TICKS_PER_PERIOD, PROCESSORS), np.uint32)
        if not self.call("words", first, last - first, words.ctypes.data):
            raise Unseen(f"periods {first} to {last} have not all played since the device started")
        return words

    def inject(self, fault: InjectedFault) -> None:
        """Let something go wrong, now or at its period; raises `Inconclusive` if the library has no such fault."""
        begins = now = int(self.call("now"))
        if fault.period is not None:
            begins = int(self.call("origin")) + fault.period * TICKS_PER_PERIOD
            if begins < now:
                raise ValueError(f"{fault}: period {fault.period} is over")
        lasts = fault.periods if isinstance(fault, Lasting) else None
        ends = NEVER if lasts is None else begins + lasts * TICKS_PER_PERIOD
        trouble = Trouble(*kind_and_places(fault), begins, ends, getattr(fault, "times", 1), *details(fault))
        if not self.call("fault", ctypes.byref(trouble)):
            raise Inconclusive("too much is wrong with the reference device at once")


# Faults

EVERYWHERE = (1 << PROCESSORS) - 1
KINDS: tuple[type[InjectedFault], ...] = (
    faults.LostToken,
    faults.DoubledToken,
    faults.FlippedBit,
    faults.SlowLink,
    faults.DeadProcessor,
    faults.SlowProcessor,
    faults.ClockError,
    faults.LostSync,
    faults.HotBoard,
    faults.WrongSupply,
    faults.StuckFlashBit,
    faults.FailingSector,
    faults.FailingPage,
    faults.WriteProtectedFlash,
    faults.PowerCutInWrite,
)
"""In the order of `enum machine_trouble`."""
SYMBOLS_PER_TOKEN = 4
"""On five wires (clause BUD-002)."""


class Trouble(ctypes.Structure):
    """`struct machine_fault` of the library."""

    _fields_ = (
        ("kind", ctypes.c_uint32),
        ("places", ctypes.c_uint32),
        ("begin", ctypes.c_uint64),
        ("end", ctypes.c_uint64),
        ("times", ctypes.c_uint32),
        ("what", ctypes.c_int32),
        ("where", ctypes.c_int32),
        ("value", ctypes.c_int32),
    )


def kind_and_places(fault: InjectedFault) -> tuple[int, int]:
    """The kind of a fault for the library, and the processors at which it is, as bits; raises `Inconclusive`."""
    if isinstance(fault, faults.DeadBoard):
        return KINDS.index(faults.DeadProcessor), of_board(fault.board)
    if type(fault) not in KINDS:
        raise Inconclusive(f"the reference device has no lever for {fault}")
    if (board := getattr(fault, "board", None)) is not None:
        return KINDS.index(type(fault)), of_board(board)
    processor = getattr(fault, "processor", getattr(fault, "link", None))
    return KINDS.index(type(fault)), EVERYWHERE if processor is None else 1 << processor


def of_board(board: int) -> int:
    """The processors of a board, as bits."""
    return ((1 << PROCESSORS_PER_BOARD) - 1) << board * PROCESSORS_PER_BOARD


def details(fault: InjectedFault) -> tuple[int, int, int]:
    """What, where and by how much, as the library has it of this kind."""
    match fault:
        case DamagedMessage():
            return MESSAGES[fault.message].CHANNEL_END, fault.token, getattr(fault, "bit", 0)
        case faults.SlowLink():
            return 0, 0, SYMBOLS_PER_TOKEN * fault.cycles_per_symbol + fault.token_delay
        case faults.SlowProcessor():
            return 0, 0, fault.slowness
        case faults.ClockError():
            return 0, 0, round(1000 * fault.ppm)
        case faults.HotBoard():
            return 0, 0, fault.celsius
        case faults.WrongSupply():
            return 0, 0, fault.millivolts
        case faults.StuckFlashBit():
            return fault.bit, fault.address, fault.value
        case faults.FailingSector():
            return 0, fault.sector * FLASH_SECTOR_BYTES, 0
        case faults.FailingPage():
            return 0, fault.page * PAGE_BYTES, 0
        case faults.PowerCutInWrite():
            return 0, fault.written_bytes, -1 if fault.off_periods is None else fault.off_periods
        case _:
            return 0, 0, 0


class Time:
    """Its time in core cycles; it passes in ticks of 0.5 µs."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    @property
    def now(self) -> int:
        """Core cycles since it was made."""
        return int(self._machine.call("now")) * CYCLES_PER_TICK

    def run_until(self, cycle: int) -> None:
        """Let time pass to the first tick that does not begin before a core cycle."""
        self._machine.call("run", max(-(-cycle // CYCLES_PER_TICK), self._machine.call("now")))

    def next_time(self) -> int | None:
        """The core cycle at which something is due; None if nothing is."""
        due = int(self._machine.call("due"))
        return None if due == NEVER else max(due * CYCLES_PER_TICK, self.now + CYCLES_PER_TICK)


class Bus:
    """Its USB device."""

    def __init__(self, machine: Machine, speed: Speed) -> None:
        self._machine = machine
        self._packet = ctypes.create_string_buffer(MOST_DATA)
        self.speed = speed
        self.suspended = False

    @property
    def attached(self) -> bool:
        """Whether it is on the bus."""
        return bool(self._machine.call("attached"))

    @property
    def generation(self) -> int:
        """How often it has come to the bus."""
        return int(self._machine.call("generation"))

    @property
    def configuration(self) -> int:
        """The selected configuration, 0 for none."""
        return int(self._machine.call("configured"))

    @property
    def enumeration(self) -> SimpleNamespace:
        """The descriptors by which a host knows it, as it answers them."""
        (device,) = descriptors(self._descriptor(DescriptorType.DEVICE))
        return SimpleNamespace(device=device, configuration=self._descriptor(DescriptorType.CONFIGURATION))

    def _descriptor(self, kind: DescriptorType) -> bytes:
        return self.control(Setup(0x80, 6, kind << 8, 0, MOST_DATA))

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a request; raises `Stall` if it is answered so."""
        ctypes.memmove(self._packet, data, len(data))
        size = self._machine.call("control", setup.encode(), self._packet)
        if size < 0:
            raise Stall(setup.name)
        return self._packet.raw[:size] if setup.is_in else b""

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        """Send a packet."""
        taken = self._machine.call("out", endpoint, bytes(packet), len(packet))
        return {NAK: Handshake.NAK, STALL: Handshake.STALL}.get(taken, Handshake.ACK)

    def stream_out(self, _endpoint: int, _data: memoryview, began: int, _deadline: int) -> tuple[int, int]:
        """Take nothing at once: a transfer goes packet by packet."""
        return 0, began

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        """Ask for a packet."""
        size = self._machine.call("in", endpoint, self._packet)
        return {NAK: Handshake.NAK, STALL: Handshake.STALL}.get(size) or self._packet.raw[:size]

    def reset(self) -> None:
        """Reset the bus; in DFU mode the device then leaves it to boot."""
        self.suspended = False
        self._machine.call("bus", RESET)

    def suspend(self) -> None:
        """Suspend the bus."""
        self.suspended = True
        self._machine.call("bus", SUSPEND)

    def resume(self) -> None:
        """Let the bus be driven again."""
        self.suspended = False
        self._machine.call("bus", RESUME)

    def unplug(self) -> None:
        """Pull the cable."""
        self.suspended = False
        self._machine.call("plug", False)

    def plug(self) -> None:
        """Plug it in again."""
        self._machine.call("plug", True)


class Line:
    """Its UART, without time between bytes."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._waiting = bytearray()
        self._refused = bytearray()
        self._room = ctypes.create_string_buffer(MOST_DATA)

    @property
    def pending(self) -> int:
        """Bytes that wait for the host."""
        if self._refused:
            self.receive(b"")
        size = self._machine.call("say", self._room, MOST_DATA)
        self._waiting += self._room.raw[:size]
        return len(self._waiting)

    def receive(self, data: bytes) -> None:
        """Take bytes of the host; what the device has no room for is offered again."""
        data = bytes(self._refused) + data
        taken = self._machine.call("hear", data, len(data))
        self._refused = bytearray(data[taken:])

    def take(self, room: int) -> bytes:
        """At most so many bytes for the host."""
        data = bytes(self._waiting[:room])
        del self._waiting[:room]
        return data

    def hang_up(self) -> None:
        """A break."""
        self._machine.call("break")
        self._waiting.clear()


class Port(EmulatedPort):
    """Its UART as a port of pyserial, at 3 Mbaud."""


class Sight(Observer):
    """Its outputs, in its present life."""

    name = "reference"

    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    def seen(self, first_period: int, last_period: int) -> Seen:
        """The outputs over some periods."""
        check_stretch(first_period, last_period)
        words = self._machine.words(first_period, last_period)
        return Seen(first_period, last_period, words, np.full(PROCESSORS, 2**32 - 1, np.uint32))


class Surroundings(EmulatorLevers):
    """Power, bus, cable and faults; the machine drives its sync line and listens to no other."""

    share_sync, drive_sync = Levers.share_sync, Levers.drive_sync  # type: ignore[assignment]

    def configure(self) -> None:
        """Let a host on the bus reset and configure the device."""
        self._emulator.usb.reset()
        self._emulator.usb.control(SET_CONFIGURATION)


_spares = count(1)
_named: WeakValueDictionary[str, Machine] = WeakValueDictionary()


@lru_cache(1)
def the_machine() -> Machine:
    """The device of this process that has no name."""
    return Machine(speed=FULL_SPEED if os.environ.get(SPEED) == "full" else HIGH_SPEED)


def machine_of(name: str) -> Machine:
    """The device of this process, or one with a name, which is there as long as somebody has it open."""
    if not name:
        return the_machine()
    if (machine := _named.get(name)) is None:
        machine = _named[name] = Machine(serial=name, speed=the_machine().usb.speed)
    return machine


def make_spare(key: Any) -> str:
    """The name of a device that nobody has used, for what breaks one for good."""
    if key is not None:
        raise Inconclusive("the reference device trusts no keys")
    return f"SPARE-{next(_spares)}"


def open_bus(url: str) -> EmulatorBackend:
    """The bus of ``reference:``."""
    return EmulatorBackend([machine_of(url.partition(":")[2])])  # type: ignore[list-item]


def open_port(url: str) -> Port:
    """The UART of ``reference-uart:``."""
    return Port(machine_of(url.partition(":")[2]), BAUD)  # type: ignore[arg-type]


def open_capture(rest: str, _channels: Mapping[str, int], _marks: Sequence[Mark]) -> Sight:
    """The capture ``reference:``."""
    return Sight(machine_of(rest))


def open_levers(rest: str) -> Surroundings:
    """The levers ``reference:``."""
    return Surroundings(machine_of(rest))  # type: ignore[arg-type]
