"""The emulated device: five boards of two processors, their chain and the USB controller before it.

It models what firmware on such boards would do, at the port clock and on the links; it executes no XS1 instructions.
"""

from __future__ import annotations

import hashlib
import operator
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import count
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..protocol.board import (
    BOARDS,
    CORE_HZ,
    CYCLES_PER_PERIOD,
    CYCLES_PER_TICK,
    PROCESSORS,
    PROCESSORS_PER_BOARD,
)
from ..protocol.timing import FIVE_WIRE, Link
from ..protocol.wiring import Wiring
from .capture import Capture
from .controller import Controller
from .processor import Processor
from .scheduler import Scheduler
from .usb_device import UsbDevice

__all__ = ["Emulator", "Event", "plugged"]

LOG_EVENTS = 10_000
MOST_CYCLES_PER_SYMBOL = 255  # a byte of INFO, clause REQ-002

_plugged: dict[str, Emulator] = {}
_serials = count(1)


def plugged() -> list[Emulator]:
    """The emulators plugged in to this process, as devices on a bus."""
    return list(_plugged.values())


class Event(NamedTuple):
    """Something that happened inside the device."""

    time: float
    """Seconds since power-up."""
    where: str
    what: str


def _frozen(rows: Sequence[Any]) -> NDArray[Any]:
    values = np.array(rows)
    values.setflags(write=False)
    return values


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
    ) -> None:
        if link.cycles_per_symbol > MOST_CYCLES_PER_SYMBOL:
            raise ValueError(
                f"links of {link.cycles_per_symbol} core cycles a symbol: INFO tells at most {MOST_CYCLES_PER_SYMBOL}"
            )
        offsets = {board: operator.index(ticks) for board, ticks in (clock_offset_ticks or {}).items()}
        for board, ticks in offsets.items():
            if board not in range(BOARDS) or ticks < 0:
                raise ValueError(
                    f"clock offset {ticks} of board {board}: boards are 0 to {BOARDS - 1}, offsets not negative"
                )
        self._wiring = wiring or Wiring.strips()
        self.serial = f"EMU-{next(_serials):04d}" if serial is None else serial
        self.unplugged = False
        self.claimed_by: object | None = None
        self.scheduler = Scheduler()
        self.events: deque[Event] = deque(maxlen=LOG_EVENTS)
        self._processors = []
        for node in range(PROCESSORS):
            board, processor = divmod(node, PROCESSORS_PER_BOARD)
            log = self._logger(f"board {board} processor {processor}")
            self._processors.append(Processor(self.scheduler, offsets.get(board, 0), log))
        unique_id = hashlib.sha256(self.serial.encode()).digest()[:8]
        self._controller = Controller(
            self.scheduler, self._processors, table or self._wiring, link, unique_id, self._logger("controller")
        )
        self.usb = UsbDevice(self._controller, self.serial)

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

    def run(self, periods: int) -> None:
        """Let carrier periods of 25 µs pass, to the end of the last one."""
        if operator.index(periods) < 0:
            raise ValueError(f"{periods} periods cannot pass; at least 0")
        boundary = -(-self.scheduler.now // CYCLES_PER_PERIOD) * CYCLES_PER_PERIOD
        self.scheduler.run_until(boundary + periods * CYCLES_PER_PERIOD)

    def run_until(self, period: int) -> None:
        """Let time pass until a carrier period begins; none passes if it already has."""
        self.scheduler.run_until(operator.index(period) * CYCLES_PER_PERIOD)

    def capture(self) -> Capture:
        """Everything that the outputs did since power-up."""
        return Capture(
            self._wiring,
            self.scheduler.now // CYCLES_PER_TICK,
            tuple(_frozen(processor.starts) for processor in self._processors),
            tuple(_frozen(processor.tables) for processor in self._processors),
        )
