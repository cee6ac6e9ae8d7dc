"""What goes wrong with boards: their processors, outputs, oscillators, sync line, temperature and supply."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from ...protocol.board import CHANNELS, PROCESSORS_PER_BOARD
from ..boards.package import AMBIENT_C, SUPPLY_MV, Package
from .fault import FaultTarget, InjectedFault, Lasting
from .limits import BoardNumber, PortBit, ProcessorNumber, Real, Whole

__all__ = [
    "ClockError",
    "DeadBoard",
    "DeadProcessor",
    "HotBoard",
    "LostSync",
    "OpenTransducer",
    "SlowProcessor",
    "StuckHigh",
    "StuckLow",
    "WrongSupply",
]


@dataclass(frozen=True, kw_only=True)
class DeadProcessor(InjectedFault):
    """A processor without power: its outputs fall low at once, and nothing passes it.

    Parameters
    ----------
    processor : int
    """

    processor: ProcessorNumber

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Take its power away."""
        device.chain.lose(self.processor)


@dataclass(frozen=True, kw_only=True)
class DeadBoard(InjectedFault):
    """A board without power: both its processors are dead.

    Parameters
    ----------
    board : int
    """

    board: BoardNumber

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Take its power away."""
        for processor in _processors(device, self.board):
            device.chain.lose(processor.place)


def _processors(device: FaultTarget, board: int | None) -> list[Package]:
    """The processors of a board, or of all."""
    return [processor for processor in device.processors if board in (None, processor.place // PROCESSORS_PER_BOARD)]


@dataclass(frozen=True, kw_only=True)
class StuckOutput(Lasting):
    """An output that nothing switches any more.

    Parameters
    ----------
    processor : int
    bit : int
        The output of its port.
    """

    processor: ProcessorNumber
    bit: PortBit

    on_boards: ClassVar[bool] = True
    unfolds: ClassVar[bool] = False


@dataclass(frozen=True, kw_only=True)
class StuckHigh(StuckOutput):
    """An output that stays high, even without power."""

    def begin(self, device: FaultTarget) -> None:
        """Hold it."""
        device.processors[self.processor].force(high=1 << self.bit)

    def end(self, device: FaultTarget) -> None:
        """Let it go."""
        device.processors[self.processor].let_go(high=1 << self.bit)


@dataclass(frozen=True, kw_only=True)
class StuckLow(StuckOutput):
    """An output that stays low."""

    def begin(self, device: FaultTarget) -> None:
        """Hold it."""
        device.processors[self.processor].force(low=1 << self.bit)

    def end(self, device: FaultTarget) -> None:
        """Let it go."""
        device.processors[self.processor].let_go(low=1 << self.bit)


@dataclass(frozen=True, kw_only=True)
class OpenTransducer(InjectedFault):
    """A transducer that is not connected any more; its output switches as before.

    Parameters
    ----------
    transducer : int
        Its number in array order.
    """

    transducer: Annotated[int, Whole(0, CHANNELS - 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Disconnect it."""
        device.open_since.setdefault(self.transducer, device.scheduler.now)


@dataclass(frozen=True, kw_only=True)
class ClockError(Lasting):
    """A board whose oscillator is not the shared one any more. What it has lost or gained by the end stays.

    Parameters
    ----------
    board : int
    ppm : float
        How many millionths it runs fast, or slow if negative.
    """

    board: BoardNumber
    ppm: Annotated[float, Real(-1000, 1000)]

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Let it run at this rate."""
        for processor in _processors(device, self.board):
            processor.set_clock_error(round(1000 * self.ppm))

    def end(self, device: FaultTarget) -> None:
        """Let it run like the others."""
        for processor in _processors(device, self.board):
            processor.set_clock_error(0)


@dataclass(frozen=True, kw_only=True)
class LostSync(Lasting):
    """A sync line on which no pulse comes any more.

    Parameters
    ----------
    board : int, optional
        The board concerned; all boards by default.
    """

    board: BoardNumber | None = None

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Cut the line."""
        for processor in _processors(device, self.board):
            processor.sync_connected = False

    def end(self, device: FaultTarget) -> None:
        """Connect it."""
        for processor in _processors(device, self.board):
            processor.sync_connected = True


@dataclass(frozen=True, kw_only=True)
class HotBoard(Lasting):
    """A board that has another temperature than the room; above 85 °C it is too hot.

    Parameters
    ----------
    board : int
    celsius : int
    """

    board: BoardNumber
    celsius: Annotated[int, Whole(-40, 127)]

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Heat or cool it."""
        for processor in _processors(device, self.board):
            processor.set_temperature(self.celsius)

    def end(self, device: FaultTarget) -> None:
        """Let it be as warm as the room."""
        for processor in _processors(device, self.board):
            processor.set_temperature(AMBIENT_C)


@dataclass(frozen=True, kw_only=True)
class WrongSupply(Lasting):
    """A supply of the output amplifiers that has another voltage; outside 12 to 18 V it is wrong.

    Parameters
    ----------
    millivolts : int
    board : int, optional
        The board concerned; all boards by default.
    """

    millivolts: Annotated[int, Whole(0, 60_000)]
    board: BoardNumber | None = None

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Set the voltage."""
        for processor in _processors(device, self.board):
            processor.set_supply(self.millivolts)

    def end(self, device: FaultTarget) -> None:
        """Set it right."""
        for processor in _processors(device, self.board):
            processor.set_supply(SUPPLY_MV)


@dataclass(frozen=True, kw_only=True)
class SlowProcessor(Lasting):
    """A processor whose threads need more cycles than their budget.

    Parameters
    ----------
    processor : int
    slowness : int
        Times as many.
    """

    processor: ProcessorNumber
    slowness: Annotated[int, Whole(2, 1000)]

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Slow it down."""
        device.processors[self.processor].slow_down(self.slowness)

    def end(self, device: FaultTarget) -> None:
        """Let it be as fast as it should."""
        device.processors[self.processor].slow_down(1)
