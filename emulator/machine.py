"""The emulated device: five boards of two processors, their chain, the controller before it, its flash and its power.

By default it models what firmware on such boards would do, at the port clock and on the links. The ten processors may
execute real firmware instead, instruction by instruction; the controller is always a model.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import count
from typing import Literal, NamedTuple, Self, get_args

from ..base.arguments import whole
from ..base.errors import DeviceError
from ..protocol.board import (
    BOARDS,
    CORE_HZ,
    CYCLES_PER_PERIOD,
    CYCLES_PER_TICK,
    PROCESSORS,
    PROCESSORS_PER_BOARD,
    TICKS_PER_PERIOD,
)
from ..protocol.chain import Identity
from ..protocol.codes import Fault
from ..protocol.enumeration import HIGH_SPEED, Speed
from ..protocol.firmware import Image
from ..protocol.timing import FIVE_WIRE, Link
from ..protocol.wiring import Wiring
from .boards.package import Package
from .boards.processor import Processor
from .boards.sync import SyncLine
from .control.chain import Chain, ModelledChain, Numbering, Tamper
from .control.controller import Controller
from .control.requests import Identification
from .faults import InjectedFault
from .faults.injector import Injector
from .firmware.dfu import DfuMode
from .firmware.flash import Flash
from .firmware.loader import (
    FACTORY_IMAGE,
    Boot,
    DeviceIdentity,
    boot,
    confirm,
    give_up_upgrades,
    load_cycles,
    make_flash,
)
from .interfaces.serial_line import SerialLine
from .interfaces.usb_device import UsbDevice
from .ports.capture import Capture
from .ports.clock import BoardClock, Timebase
from .scheduler import NEVER, Branch, Scheduler
from .trace import Tracer

__all__ = ["Emulator", "Event", "FirmwareChoice", "open_emulator", "open_emulators"]

NOT_OPEN = "; an Emulator answers in a with statement, or after its open()"
"""The end of an error of a program that finds no emulator."""
LOG_EVENTS = 10_000
PAST_CAPTURES = 16
SYNC_WAIT_CYCLES = 5 * CORE_HZ
"""How long a device waits for the first pulse on a line that it listens to (clause CHN-026)."""
MOST_CYCLES_PER_SYMBOL = 255  # a byte of INFO, clause REQ-002

FirmwareChoice = Literal["model", "xs1"]
"""Whether processors are models, or execute what the flash contains."""

_open_emulators: dict[str, Emulator] = {}
_serials = count(1)


def open_emulators() -> list[Emulator]:
    """The emulators that are open in this process, as devices on a bus."""
    return list(_open_emulators.values())


def open_emulator(serial: str) -> Emulator | None:
    """The emulator of a serial number that is open in this process, if there is one."""
    return _open_emulators.get(serial)


class Event(NamedTuple):
    """Something that happened inside the device."""

    time: float
    """Seconds since power was first applied."""
    where: str
    what: str


class Emulator:
    """One emulated device. It answers to its `url` in a ``with`` statement, or between `open` and `close`.

    Parameters
    ----------
    wiring : Wiring, optional
        How the transducers are connected to the outputs.
    table : Wiring, optional
        The wiring table that the controller sorts by; the true one by default.
    link : Link
        Set-up of the chain's links; at most 255 core cycles a symbol.
    speed : Speed
        Speed of the USB bus, `HIGH_SPEED` or `FULL_SPEED`.
    clock_offset_ticks : mapping of int to int, optional
        How many ticks the port clocks of a board run late, by board.
    serial : str, optional
        Serial number; made up by default, and what a flash says if one is given.
    flash : Flash, optional
        A flash with another firmware, or from an earlier time; as it leaves the factory by default.
    unfolded : bool
        Whether every message travels along the chain token by token, even if nothing can go wrong.
    history_periods : int, optional
        The least number of periods for which outputs are kept; for ever by default, 640 bytes for each update.
    sync : SyncLine, optional
        The line of another device, to listen to; its own by default, which it drives.
    firmware : Image, "model" or "xs1"
        "model": the processors are models, whatever the flash contains. "xs1": they execute what the flash contains,
        which is by default the firmware of this package; or that image. Executed processors are never folded.

    Attributes
    ----------
    usb : UsbDevice
        What the bus sees; it stays the same whatever becomes of the device.
    line : SerialLine or None
        The device's UART; None while the device starts or waits for new firmware.
    controller : Controller or None
        None while the device starts.
    executes : bool
        Whether the processors execute their firmware, so that a second of theirs takes some seconds.

    Notes
    -----
    Time stands still unless a transfer passes or `run` is called, so that the same calls give the same capture.
    """

    def __init__(
        self,
        wiring: Wiring | None = None,
        *,
        table: Wiring | None = None,
        link: Link = FIVE_WIRE,
        speed: Speed = HIGH_SPEED,
        clock_offset_ticks: Mapping[int, int] | None = None,
        serial: str | None = None,
        flash: Flash | None = None,
        unfolded: bool = False,
        history_periods: int | None = None,
        sync: SyncLine | None = None,
        firmware: Image | FirmwareChoice = "model",
    ) -> None:
        if link.cycles_per_symbol > MOST_CYCLES_PER_SYMBOL:
            raise ValueError(
                f"links of {link.cycles_per_symbol} core cycles a symbol: INFO tells at most {MOST_CYCLES_PER_SYMBOL}"
            )
        self._offsets = {
            board: whole("clock offset", n, -NEVER, NEVER) for board, n in (clock_offset_ticks or {}).items()
        }
        for board, ticks in self._offsets.items():
            if board not in range(BOARDS) or ticks < 0:
                raise ValueError(
                    f"clock offset {ticks} of board {board}: boards are 0 to {BOARDS - 1}, offsets not negative"
                )
        if not isinstance(firmware, Image) and firmware not in get_args(FirmwareChoice):
            raise ValueError(f"firmware {firmware!r}: give 'model', 'xs1' or an image")
        self.executes = firmware != "model"
        if flash is None:
            made_up = f"EMU-{next(_serials):04d}" if serial is None else serial
            identity = DeviceIdentity(made_up, table or wiring or Wiring.strips())
            flash = make_flash(identity, _factory_image(firmware))
        elif isinstance(firmware, Image):
            raise ValueError("a flash has its own firmware; give a flash or an image, not both")
        self.flash = flash
        self._identity = DeviceIdentity.read(flash)
        self.serial = self._identity.serial
        self._wiring = wiring or self._identity.wiring
        self._link = link
        self._unfolded = unfolded or self.executes
        self._history_periods = None if history_periods is None else whole("history_periods", history_periods, 1, NEVER)
        self._first_period = 0
        self._pulses_fail = False
        self.closed = False
        self.scheduler = Scheduler()
        self._own_sync = SyncLine()
        self.sync = self._own_sync if sync is None else sync
        """The sync line that this device drives, or listens to."""
        self.tracer = Tracer()
        self.events: deque[Event] = deque(maxlen=LOG_EVENTS)
        self.open_since: dict[int, int] = {}
        """Transducers that are not connected, each with the core cycle since when."""
        self.tampers: list[Tamper] = []
        """What damages the messages of the chain."""
        self.processors: Sequence[Package] = []
        self._faults = Injector(self)
        self.usb = UsbDevice(
            self.scheduler,
            self.serial,
            speed=speed,
            enter_dfu=self._enter_dfu,
            restart=self.restart,
            tracer=self.tracer,
        )
        self.controller: Controller | None = None
        self.line: SerialLine | None = None
        self._life: Branch | None = None
        self.past: deque[Capture] = deque(maxlen=PAST_CAPTURES)
        """What was captured before the device was started anew, the last time and before."""
        self.power_up()
        self.run_until_started()

    def __repr__(self) -> str:
        state = "off" if self.controller is None else self.controller.state.name
        return f"Emulator({self.serial}, {state})"

    # Power

    @property
    def powered(self) -> bool:
        """Whether it has power."""
        return self._life is not None

    def power_up(self) -> None:
        """Get power, or get it back: nothing is known, all outputs are low (clause SAF-001)."""
        if self.powered:
            self.power_down()
        self.flash.power_up(self.scheduler)
        self._start()

    def power_down(self) -> None:
        """Lose power at once, whatever goes on: the outputs fall low, and a write to the flash stays half done."""
        self._stop()
        self.flash.cut_power()

    def restart(self) -> None:
        """Begin as at power-up; what the flash is doing is finished first (clauses REQ-013 and DFU-015)."""
        self._stop()
        self._start()

    def revert(self) -> None:
        """Restart, and go back to the factory's image on the way (clauses REQ-014 and FWU-022)."""
        self._stop()
        self._start(give_up_upgrades(self.flash))

    def _start(self, before: Iterable[int] = ()) -> None:
        self._life = Branch(self.scheduler)
        self._life.at(max(self.flash.busy_until, self.scheduler.now), partial(self._prepare, iter(before)))

    def _prepare(self, steps: Iterator[int]) -> None:
        """Boot once these steps are taken, each of which lasts until a core cycle."""
        assert self._life is not None
        until = next(steps, None)
        if until is None:
            self._boot()
        else:
            self._life.at(until, partial(self._prepare, steps))

    def _stop(self) -> None:
        """End all that goes on but in the flash."""
        if self._drives_sync:
            self.sync.fail(self.scheduler.now)
        if self.controller is not None:
            self.past.append(self.capture())
        if self._life is not None:
            self._life.end()
        self.controller = self.line = self._life = None
        self.processors = []
        self.usb.disconnect()

    def _boot(self) -> None:
        try:
            booted = boot(self.flash)
        except DeviceError as error:
            self.log("loader", str(error))
            return
        start = max(self.flash.busy_until, self.scheduler.now)
        assert self._life is not None
        self._life.at(start + sum(load_cycles(booted.image, self._link)), lambda: self._number(booted))
        self.log("loader", f"starts firmware {booted.image.version} from bank {booted.bank.name}")

    def _number(self, booted: Boot) -> None:
        assert self._life is not None
        self.chain = self._executed_chain(booted) if self.executes else self._modelled_chain(booted)
        self.processors = self.chain.processors
        self._faults.afflict()
        self._life.at(self.scheduler.now + self.chain.starting_cycles, partial(self._begin_numbering, booted))

    def _begin_numbering(self, booted: Boot) -> None:
        assert self._life is not None
        Numbering(self._life, self.chain, partial(self._begin, booted))

    def _modelled_chain(self, booted: Boot) -> Chain:
        assert self._life is not None
        processors = [self._processor(place, booted) for place in range(PROCESSORS)]
        return ModelledChain(self._life, processors, self._link, self.tracer, self.tampers)

    def _processor(self, place: int, booted: Boot) -> Processor:
        assert self._life is not None
        return Processor(
            self._life,
            place,
            BoardClock(self._offsets.get(place // PROCESSORS_PER_BOARD, 0)),
            booted.image.version,
            self._processor_id(place),
            self._processor_logger(place),
            self.tracer,
        )

    def _executed_chain(self, booted: Boot) -> Chain:
        from .boards.executed import ExecutedProcessor  # numba takes longer to import than everything else together
        from .control.executed_chain import ExecutedChain

        assert self._life is not None
        processors = [
            ExecutedProcessor(
                self._life,
                place,
                BoardClock(),
                booted.image.program(place),
                self._processor_id(place),
                self._link,
                self._offsets.get(place // PROCESSORS_PER_BOARD, 0),
                self._processor_logger(place),
            )
            for place in range(PROCESSORS)
        ]
        return ExecutedChain(self._life, processors, self._link, self.tracer, self.tampers)

    def _processor_id(self, place: int) -> int:
        return int.from_bytes(_unique_id(f"{self.serial}/{place}"), "little")

    def _processor_logger(self, place: int) -> Callable[[str], None]:
        board, number = divmod(place, PROCESSORS_PER_BOARD)
        return self._logger(f"board {board} processor {number}")

    def _begin(self, booted: Boot, identities: list[Identity]) -> None:
        """The chain has been numbered: period 0 begins with the next tick."""
        assert self._life is not None
        self._pulses_fail = False
        origin, faults = -(-self.scheduler.now // CYCLES_PER_TICK) * CYCLES_PER_TICK, booted.faults
        if self._drives_sync:
            self.sync.drive(origin)
        elif (pulse := self.sync.next_pulse(origin)) is not None and pulse <= origin + SYNC_WAIT_CYCLES:
            origin = pulse
            self.sync.listen(self._lose_sync)
        else:
            origin, faults = origin + SYNC_WAIT_CYCLES, faults | Fault.SYNC
        come_up = partial(self._come_up, booted._replace(faults=faults), identities, Timebase(origin))
        self._life.at(origin, come_up)

    def share_sync(self, line: SyncLine | None) -> None:
        """From the next restart on listen to a sync line or, without one, drive its own."""
        self.sync = self._own_sync if line is None else line

    @property
    def _drives_sync(self) -> bool:
        return self.sync is self._own_sync

    def _lose_sync(self, cycle: int) -> None:
        """The device that drives the sync line begins anew."""
        if self._life is not None:
            self._life.at(max(cycle, self.scheduler.now), self._miss_pulses)

    def _miss_pulses(self) -> None:
        self._pulses_fail = True
        if self.controller is not None:
            self.controller.unfold()
            for processor in self.processors:
                processor.sync_connected = False

    def _come_up(self, booted: Boot, identities: list[Identity], time: Timebase) -> None:
        """Period 0 begins; the device answers from now on (clause TIM-002)."""
        assert self._life is not None
        self.tracer.begin_anew(time.origin)
        for processor in self.processors[: len(identities)]:
            processor.start(time)
        self._bank = booted.bank
        self.controller = Controller(
            self._life,
            time,
            self.chain,
            identities,
            Identification(_unique_id(self.serial), booted.image.version, booted.bank, self._identity.wiring),
            log=self._logger("controller"),
            restart=self.restart,
            revert=self.revert,
            confirm=lambda: confirm(self.flash, booted.bank),
            faults=booted.faults,
        )
        if self._unfolded:
            self.controller.unfold()
        if self._pulses_fail:  # the one that it begins with has never come
            self._miss_pulses()
            self.controller.raise_fault(Fault.SYNC, "no pulse on the sync line")
        self._first_period = 0
        self._plan_to_forget()
        self.line = SerialLine(self.controller, detach=self.usb.detach)
        console = SerialLine(self.controller, detach=self.usb.detach, needs_dtr=True)
        self.usb.connect(self.controller, console, booted.image.version)

    def _plan_to_forget(self) -> None:
        if self._history_periods is not None and self._life is not None:
            self._life.at(self.scheduler.now + 2 * self._history_periods * CYCLES_PER_PERIOD, self._forget)

    def _forget(self) -> None:
        """Drop what the outputs did long ago."""
        assert self._history_periods is not None
        self.running.settle()
        self._first_period = self._time.period(self.scheduler.now) - self._history_periods
        for processor in self.processors:
            processor.forget(processor.clock.own_tick(self._first_period * TICKS_PER_PERIOD) // TICKS_PER_PERIOD)
        self._plan_to_forget()

    def _enter_dfu(self) -> DfuMode:
        """The device has left the bus to come back in DFU mode; serial lines are silent there (clause STA-005)."""
        assert self._life is not None
        self.line = None
        return DfuMode(self._life, self.flash, self._bank, self._identity.keys)

    # On the bus

    @property
    def url(self) -> str:
        """The URL by which a host finds it while it is open."""
        return f"emulator:{self.serial}"

    def open(self) -> Self:
        """Answer to the `url` from now on, without ``with``, as over the cells of a notebook; returns the emulator.

        Raises
        ------
        ValueError
            If it is closed, or one of its serial number is open.
        """
        if self.closed:
            raise ValueError("this emulator is closed; make a new one")
        if self.serial in _open_emulators:
            raise ValueError(f"an emulator with the serial number {self.serial!r} is already open")
        _open_emulators[self.serial] = self
        return self

    __enter__ = open

    def close(self) -> None:
        """Unplug it for good; nothing happens if it is closed already."""
        if _open_emulators.get(self.serial) is self:
            del _open_emulators[self.serial]
        self.closed = True
        self.usb.unplug()

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _logger(self, where: str) -> Callable[[str], None]:
        return lambda what: self.log(where, what)

    def log(self, where: str, what: str) -> None:
        """Enter something that happens now into `events`."""
        self.events.append(Event(self.scheduler.now / CORE_HZ, where, what))

    # Time and what is seen

    @property
    def _time(self) -> Timebase:
        return self.running.time

    @property
    def running(self) -> Controller:
        """The controller; raises `ValueError` while the device starts."""
        if self.controller is None:
            why = "has not started yet; let time pass" if self.powered else "has no power"
            raise ValueError(f"the device {why}")
        return self.controller

    def run_until_started(self) -> None:
        """Let time pass until period 0 has begun."""
        while self.controller is None:
            upcoming = self.scheduler.next_time()
            if upcoming is None:
                raise DeviceError("the device does not start: it has no power, or nothing in its flash boots")
            self.scheduler.run_until(upcoming)

    def run(self, periods: int) -> None:
        """Let carrier periods of 25 µs pass, to the end of the last one."""
        periods = whole("periods", periods, 0, NEVER // CYCLES_PER_PERIOD)
        boundary = self._time.boundary(self._time.first_boundary(self.scheduler.now))
        self.scheduler.run_until(boundary + periods * CYCLES_PER_PERIOD)

    def run_until(self, period: int) -> None:
        """Let time pass until a carrier period begins; none passes if it already has."""
        self.scheduler.run_until(self._time.boundary(whole("period", period, 0, NEVER // CYCLES_PER_PERIOD)))

    def watch(self) -> None:
        """From now on keep what goes on inside, message by message, in `tracer`."""
        self.tracer.watching = True
        self.unfold()

    def capture(self) -> Capture:
        """Everything that the outputs did since period 0, as far as it is kept."""
        self.running.settle()
        return Capture(
            self._wiring,
            self.running.now_tick,
            tuple(processor.track() for processor in self.processors),
            {transducer: max(self._time.tick(cycle), 0) for transducer, cycle in self.open_since.items()},
            self._first_period * TICKS_PER_PERIOD,
        )

    # What goes wrong

    def inject(self, *faults: InjectedFault) -> None:
        """Let things go wrong, now or at the periods that they name (see `faults`).

        Raises
        ------
        ValueError
            If a period is over, or none is counted because the device has not started.
        """
        for fault in faults:
            self._faults.inject(fault)

    def unfold(self) -> None:
        """From now on let every message travel along the chain token by token."""
        self._unfolded = True
        if self.controller is not None:
            self.controller.unfold()


def _factory_image(firmware: Image | FirmwareChoice) -> Image:
    if isinstance(firmware, Image):
        return firmware
    if firmware == "model":
        return FACTORY_IMAGE
    from ..firmware.xmos.images import device_image  # only executed devices need it

    return device_image()


def _unique_id(name: str) -> bytes:
    return hashlib.sha256(name.encode()).digest()[:8]
