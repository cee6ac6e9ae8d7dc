"""The emulated device: five boards of two processors, their chain, the controller before it, and their power.

It models what firmware on such boards would do, at the port clock and on the links; it executes no XS1 instructions.
"""

from __future__ import annotations

import hashlib
import operator
from collections import deque
from collections.abc import Callable, Mapping
from itertools import count
from typing import NamedTuple, Self

from ..protocol.board import (
    BOARDS,
    CORE_HZ,
    CYCLES_PER_PERIOD,
    CYCLES_PER_TICK,
    PROCESSORS,
    PROCESSORS_PER_BOARD,
)
from ..protocol.chain import Identity
from ..protocol.codes import Bank, Fault
from ..protocol.timing import FIVE_WIRE, Link
from ..protocol.wiring import Wiring
from .capture import Capture
from .chain import Chain, Numbering
from .clock import BoardClock, Timebase
from .controller import Controller, Identification
from .processor import Processor
from .scheduler import Scheduler
from .trace import Tracer
from .usb_device import UsbDevice

__all__ = ["Emulator", "Event", "plugged"]

LOG_EVENTS = 10_000
MOST_CYCLES_PER_SYMBOL = 255  # a byte of INFO, clause REQ-002
FIRMWARE = (0, 1, 0)

_plugged: dict[str, Emulator] = {}
_serials = count(1)


def plugged() -> list[Emulator]:
    """The emulators plugged in to this process, as devices on a bus."""
    return list(_plugged.values())


class Event(NamedTuple):
    """Something that happened inside the device."""

    time: float
    """Seconds since power was first applied."""
    where: str
    what: str


class Emulator:
    """One emulated device. As a context manager it is plugged in and answers to its `url`.

    Parameters
    ----------
    wiring : Wiring, optional
        How the transducers are connected to the outputs.
    table : Wiring, optional
        The wiring table that the controller sorts by; the true one by default.
    link : Link
        Set-up of the chain's links; at most 255 core cycles a symbol.
    clock_offset_ticks : mapping of int to int, optional
        For a board, how many ticks its port clocks run late.
    serial : str, optional
        Serial number; made up by default.
    unfolded : bool
        Whether every message travels along the chain token by token, even where nothing can go wrong.

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
        clock_offset_ticks: Mapping[int, int] | None = None,
        serial: str | None = None,
        unfolded: bool = False,
    ) -> None:
        if link.cycles_per_symbol > MOST_CYCLES_PER_SYMBOL:
            raise ValueError(
                f"links of {link.cycles_per_symbol} core cycles a symbol: INFO tells at most {MOST_CYCLES_PER_SYMBOL}"
            )
        self._offsets = {board: operator.index(ticks) for board, ticks in (clock_offset_ticks or {}).items()}
        for board, ticks in self._offsets.items():
            if board not in range(BOARDS) or ticks < 0:
                raise ValueError(
                    f"clock offset {ticks} of board {board}: boards are 0 to {BOARDS - 1}, offsets not negative"
                )
        self._wiring = wiring or Wiring.strips()
        self._table = table or self._wiring
        self._link = link
        self._unfolded = unfolded
        self.serial = f"EMU-{next(_serials):04d}" if serial is None else serial
        self.unplugged = False
        self.claimed_by: object | None = None
        self.scheduler = Scheduler()
        self.tracer = Tracer()
        self.events: deque[Event] = deque(maxlen=LOG_EVENTS)
        self._open_transducers: frozenset[int] = frozenset()
        self.controller: Controller | None = None
        self.power_up()
        while self.controller is None:
            upcoming = self.scheduler.next_time()
            assert upcoming is not None
            self.scheduler.run_until(upcoming)
        self.scheduler.run_until(self.controller.time.origin)

    # Power

    def power_up(self) -> None:
        """Begin as at power-up: nothing is known, all outputs are low (clauses SAF-001 and REQ-013)."""
        self.controller = None
        self._processors = [self._processor(place) for place in range(PROCESSORS)]
        self._chain = Chain(self.scheduler, self._processors, self._link, self.tracer)
        Numbering(self.scheduler, self._chain, self._come_up)

    def _processor(self, place: int) -> Processor:
        board, number = divmod(place, PROCESSORS_PER_BOARD)
        unique_id = int.from_bytes(hashlib.sha256(f"{self.serial}/{place}".encode()).digest()[:8], "little")
        log = self._logger(f"board {board} processor {number}")
        return Processor(self.scheduler, place, BoardClock(self._offsets.get(board, 0)), FIRMWARE, unique_id, log)

    def _come_up(self, identities: list[Identity]) -> None:
        """The chain has been numbered: period 0 begins at the next tick."""
        time = Timebase(-(-self.scheduler.now // CYCLES_PER_TICK) * CYCLES_PER_TICK)
        for processor in self._processors[: len(identities)]:
            processor.start(time)
        unique_id = hashlib.sha256(self.serial.encode()).digest()[:8]
        self.controller = Controller(
            self.scheduler,
            time,
            self._chain,
            identities,
            Identification(unique_id, FIRMWARE, Bank.FACTORY, self._table),
            log=self._logger("controller"),
            restart=self.power_up,
            confirm=lambda: None,
            faults=Fault(0),
        )
        if self._unfolded:
            self.controller.unfold()
        self.usb = UsbDevice(self.controller, self.serial)

    # On the bus

    @property
    def url(self) -> str:
        """The URL by which a host finds it while it is plugged in."""
        return f"emulator:{self.serial}"

    def __enter__(self) -> Self:
        if self.unplugged:
            raise ValueError("an emulator that was unplugged has lost its power; make a new one")
        if self.serial in _plugged:
            raise ValueError(f"an emulator with the serial number {self.serial!r} is already plugged in")
        _plugged[self.serial] = self
        return self

    def __exit__(self, *exception: object) -> None:
        del _plugged[self.serial]
        self.unplugged = True

    def _logger(self, where: str) -> Callable[[str], None]:
        return lambda what: self.events.append(Event(self.scheduler.now / CORE_HZ, where, what))

    # Time and what is seen

    @property
    def _time(self) -> Timebase:
        return self.running.time

    @property
    def running(self) -> Controller:
        """The controller; raises `ValueError` while the device starts."""
        if self.controller is None:
            raise ValueError("the device has not started yet; let time pass")
        return self.controller

    def run(self, periods: int) -> None:
        """Let carrier periods of 25 µs pass, to the end of the last one."""
        if operator.index(periods) < 0:
            raise ValueError(f"{periods} periods cannot pass; at least 0")
        boundary = self._time.boundary(self._time.first_boundary(self.scheduler.now))
        self.scheduler.run_until(boundary + periods * CYCLES_PER_PERIOD)

    def run_until(self, period: int) -> None:
        """Let time pass until a carrier period begins; none passes if it already has."""
        self.scheduler.run_until(self._time.boundary(operator.index(period)))

    def capture(self) -> Capture:
        """Everything that the outputs did since period 0."""
        self.running.settle()
        return Capture(
            self._wiring,
            self.running.now_tick,
            tuple(processor.track() for processor in self._processors),
            self._open_transducers,
        )
