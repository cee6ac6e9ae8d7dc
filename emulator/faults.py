"""What can go wrong with an emulated device: faults by name, place and period.

Each is a small value that says what happens, where, from which period on, and for how long or how often; what the
device reports then and what its outputs do is in docs/faults.md. `Emulator.inject` lets them happen; nothing here
decides what comes of it. Whatever is broken stays broken over RESET and power-up, as hardware does.

Places are counted as SPEC.md counts them: boards from 0, processors and the links that lead to them along the chain
from 0, bits of a port and of a byte from 0, transducers in array order.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, ClassVar, SupportsIndex, get_args, get_origin, get_type_hints

from ..protocol.board import (
    BOARDS,
    CHANNELS,
    CHANNELS_PER_PROCESSOR,
    CYCLES_PER_PERIOD,
    PROCESSORS,
    PROCESSORS_PER_BOARD,
)
from ..protocol.chain import (
    ROUTE,
    Collect,
    Commit,
    Identity,
    Load,
    Message,
    Number,
    Playing,
    Program,
    Report,
    Slice,
)
from ..protocol.codes import BLOCK_BYTES, FLASH_SECTOR_BYTES
from ..protocol.dfu import PAGE_BYTES
from ..protocol.enumeration import CONSOLE_ENDPOINT_IN, CONSOLE_ENDPOINT_OUT, ENDPOINT_IN, ENDPOINT_OUT
from ..protocol.timing import LEAST_CYCLES_PER_SYMBOL, MOST_DELAY
from .boards.processor import AMBIENT_C, SUPPLY_MV, Processor
from .control.chain import Passing
from .firmware.flash import FLASH_BYTES
from .interfaces.usb_device import Flip

if TYPE_CHECKING:
    from .machine import Emulator

__all__ = [
    "FAULTS",
    "BusReset",
    "BusSuspended",
    "ClockError",
    "DeadBoard",
    "DeadProcessor",
    "DoubledToken",
    "FailingPage",
    "FailingSector",
    "FlippedBit",
    "FlippedUsbBit",
    "HotBoard",
    "InjectedFault",
    "Injector",
    "LostSync",
    "LostToken",
    "OpenTransducer",
    "PowerCut",
    "PowerCutInWrite",
    "SilentHost",
    "SlowLink",
    "SlowProcessor",
    "StalledEndpoint",
    "StuckFlashBit",
    "StuckHigh",
    "StuckLow",
    "Unplugged",
    "WriteProtectedFlash",
    "WrongSupply",
]

MESSAGES: Mapping[str, type[Message]] = MappingProxyType(
    {kind.__name__.lower(): kind for kind in (Slice, Commit, Load, Program, Collect, Number, Report, Playing, Identity)}
)


@dataclass(frozen=True)
class Whole:
    """Whole numbers from `least` to `most`, or without end."""

    least: int
    most: int | None = None

    def __contains__(self, value: object) -> bool:
        """Whether a value is one of them."""
        if isinstance(value, bool) or not isinstance(value, SupportsIndex):
            return False
        return self.least <= operator.index(value) and (self.most is None or operator.index(value) <= self.most)

    def __str__(self) -> str:
        """For people."""
        return f"a whole number, {self.least} or more" if self.most is None else f"{self.least} to {self.most}"


@dataclass(frozen=True)
class Real:
    """Numbers from `least` to `most`."""

    least: float
    most: float

    def __contains__(self, value: object) -> bool:
        """Whether a value is one of them."""
        return isinstance(value, int | float) and not isinstance(value, bool) and self.least <= value <= self.most

    def __str__(self) -> str:
        """For people."""
        return f"a number from {self.least:g} to {self.most:g}"


@dataclass(frozen=True)
class OneOf:
    """A few values."""

    values: tuple[int | str, ...]

    def __contains__(self, value: object) -> bool:
        """Whether a value is one of them."""
        return not isinstance(value, bool | float) and value in self.values

    def __str__(self) -> str:
        """For people."""
        return f"one of {', '.join(map(str, self.values))}"


Limits = Whole | Real | OneOf

Period = Annotated[int, Whole(0)]
Periods = Annotated[int, Whole(1)]
Times = Annotated[int, Whole(1, 1_000_000)]
BoardNumber = Annotated[int, Whole(0, BOARDS - 1)]
ProcessorNumber = Annotated[int, Whole(0, PROCESSORS - 1)]
PortBit = Annotated[int, Whole(0, CHANNELS_PER_PROCESSOR - 1)]
ByteBit = Annotated[int, Whole(0, 7)]
MessageName = Annotated[str, OneOf(tuple(MESSAGES))]
TokenNumber = Annotated[int, Whole(0, max(kind.TOKENS for kind in MESSAGES.values()) - 1)]


def limits(kind: type[InjectedFault]) -> dict[str, tuple[Limits, bool]]:
    """What each field of a fault may be, and whether it may be None."""
    found: dict[str, tuple[Limits, bool]] = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        choices = get_args(hint)
        if type(None) in choices:
            found[name] = choices[0].__metadata__[0], True
        elif get_origin(hint) is Annotated:
            found[name] = hint.__metadata__[0], False
    return found


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """Something that goes wrong.

    Parameters
    ----------
    period : int, optional
        Of the device's, counted from its last period 0; at once by default. A restart in between does not put it off.

    Raises
    ------
    ValueError
        Where a field is not what it may be.
    """

    period: Period | None = None

    on_boards: ClassVar[bool] = False
    """Whether it concerns boards or the chain, which are as new after each start: it is brought about again then."""
    unfolds: ClassVar[bool] = True
    """Whether messages must travel along the chain token by token, for it to matter."""

    def __post_init__(self) -> None:
        """Check the fields."""
        for name, (allowed, optional) in limits(type(self)).items():
            value = getattr(self, name)
            if value not in allowed and not (optional and value is None):
                raise ValueError(f"{self.name()}: {name} = {value!r}; it must be {allowed}")

    @classmethod
    def name(cls) -> str:
        """What it is called in files and logs."""
        return re.sub(r"(?<!^)(?=[A-Z])", "-", cls.__name__).lower()

    def __str__(self) -> str:
        """Name and place, for the log."""
        values = ((field.name, getattr(self, field.name)) for field in fields(self) if field.name != "period")
        said = ", ".join(f"{name} {value}" for name, value in values if value is not None)
        return f"{self.name()}: {said}" if said else self.name()

    def begin(self, device: Emulator) -> None:
        """Bring it about; nothing changes where it is there already."""
        raise NotImplementedError

    def end(self, device: Emulator) -> None:
        """Undo it, if it ends by itself."""


@dataclass(frozen=True, kw_only=True)
class Lasting(InjectedFault):
    """Something that may end by itself.

    Parameters
    ----------
    periods : int, optional
        How long it lasts; for good by default.
    """

    periods: Periods | None = None


# Messages of the chain


@dataclass(frozen=True, kw_only=True)
class DamagedMessage(InjectedFault):
    """Messages that lose or get something on their way.

    Parameters
    ----------
    message : str
        Of which kind: slice, commit, load, program, collect, number, report, playing or identity.
    processor : int, optional
        To which processor they go, or from which they come; whichever by default.
    token : int
        Which of its tokens, counted from 0: three of the route header, the payload, END. By default the first behind
        the header. That of an answer cannot be damaged: where else it would lead the model does not know.
    times : int
        How many such messages.
    """

    message: MessageName
    processor: ProcessorNumber | None = None
    token: TokenNumber = ROUTE.size
    times: Times = 1

    last_token: ClassVar[int] = -1
    """The last one that can be damaged so, counted from the end."""

    def __post_init__(self) -> None:
        """Check the fields, and that there is such a token."""
        super().__post_init__()
        kind = MESSAGES[self.message]
        least = ROUTE.size if kind in (Report, Playing, Identity) else 0
        allowed = Whole(least, kind.TOKENS + self.last_token)
        if self.token not in allowed:
            raise ValueError(f"{self.name()}: token = {self.token!r}; of a {self.message} it must be {allowed}")

    def begin(self, device: Emulator) -> None:
        """Wait for such messages."""
        device.tampers.append(_Tamper(self, partial(device.log, "chain")))

    def damage(self, passing: Passing) -> Passing:
        """What becomes of a message."""
        raise NotImplementedError


class _Tamper:
    """Damages as many messages as a fault says."""

    def __init__(self, fault: DamagedMessage, log: Callable[[str], None]) -> None:
        self._fault = fault
        self._log = log
        self._left = fault.times

    def __call__(self, passing: Passing) -> Passing:
        """A message as it arrives."""
        fault = self._fault
        header, kind = passing.tokens[: ROUTE.size], MESSAGES[fault.message]
        # Every number goes to the same node: what tells them apart is the number itself, the first token behind.
        processor = passing.tokens[ROUTE.size] if kind is Number else passing.node
        concerns = header[-1:] == bytes([kind.CHANNEL_END]) and fault.processor in (None, processor)
        if not self._left or not concerns or len(passing.tokens) != kind.TOKENS:
            return passing
        self._left -= 1
        self._log(f"{fault.name()} of a {fault.message}, processor {processor}")
        return fault.damage(passing)


@dataclass(frozen=True, kw_only=True)
class LostToken(DamagedMessage):
    """A token that does not arrive; without END the route stays open."""

    def damage(self, passing: Passing) -> Passing:
        """Leave the token out."""
        tokens = passing.tokens[: self.token] + passing.tokens[self.token + 1 :]
        return passing._replace(tokens=tokens, ends=passing.ends and self.token < len(passing.tokens) - 1)


@dataclass(frozen=True, kw_only=True)
class DoubledToken(DamagedMessage):
    """A token that arrives twice; not END, which means nothing once a route is closed."""

    last_token: ClassVar[int] = -2

    def damage(self, passing: Passing) -> Passing:
        """Repeat the token."""
        return passing._replace(tokens=passing.tokens[: self.token + 1] + passing.tokens[self.token :])


@dataclass(frozen=True, kw_only=True)
class FlippedBit(DamagedMessage):
    """A token with a wrong bit; not END, which is no byte.

    Parameters
    ----------
    bit : int
        Of the token.
    """

    bit: ByteBit = 0

    last_token: ClassVar[int] = -2

    def damage(self, passing: Passing) -> Passing:
        """Flip the bit."""
        tokens = bytearray(passing.tokens)
        tokens[self.token] ^= 1 << self.bit
        return passing._replace(tokens=bytes(tokens))


@dataclass(frozen=True, kw_only=True)
class SlowLink(Lasting):
    """A link that is set up slower than the controller believes, in both directions.

    Parameters
    ----------
    link : int
        Link n leads to processor n.
    cycles_per_symbol, token_delay : int
        As of `protocol.timing.Link`, in core cycles.
    """

    link: ProcessorNumber
    cycles_per_symbol: Annotated[int, Whole(LEAST_CYCLES_PER_SYMBOL, MOST_DELAY)]
    token_delay: Annotated[int, Whole(0, MOST_DELAY)] = 0

    on_boards: ClassVar[bool] = True

    def begin(self, device: Emulator) -> None:
        """Set the link up."""
        slow = replace(device.chain.link, cycles_per_symbol=self.cycles_per_symbol, token_delay=self.token_delay)
        device.chain.links.set_link(self.link, slow)

    def end(self, device: Emulator) -> None:
        """Set it up like the others."""
        device.chain.links.set_link(self.link, device.chain.link)


# Processors and boards


@dataclass(frozen=True, kw_only=True)
class DeadProcessor(InjectedFault):
    """A processor without power: its outputs fall low at once, and nothing passes it.

    Parameters
    ----------
    processor : int
    """

    processor: ProcessorNumber

    on_boards: ClassVar[bool] = True

    def begin(self, device: Emulator) -> None:
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

    def begin(self, device: Emulator) -> None:
        """Take its power away."""
        for processor in _processors(device, self.board):
            device.chain.lose(processor.place)


def _processors(device: Emulator, board: int | None) -> list[Processor]:
    """The processors of a board, or of all."""
    return [processor for processor in device.processors if board in (None, processor.place // PROCESSORS_PER_BOARD)]


@dataclass(frozen=True, kw_only=True)
class StuckOutput(Lasting):
    """An output that nothing switches any more.

    Parameters
    ----------
    processor : int
    bit : int
        Of its port.
    """

    processor: ProcessorNumber
    bit: PortBit

    on_boards: ClassVar[bool] = True
    unfolds: ClassVar[bool] = False


@dataclass(frozen=True, kw_only=True)
class StuckHigh(StuckOutput):
    """An output that stays high, even without power."""

    def begin(self, device: Emulator) -> None:
        """Hold it."""
        device.processors[self.processor].force(high=1 << self.bit)

    def end(self, device: Emulator) -> None:
        """Let it go."""
        device.processors[self.processor].let_go(high=1 << self.bit)


@dataclass(frozen=True, kw_only=True)
class StuckLow(StuckOutput):
    """An output that stays low."""

    def begin(self, device: Emulator) -> None:
        """Hold it."""
        device.processors[self.processor].force(low=1 << self.bit)

    def end(self, device: Emulator) -> None:
        """Let it go."""
        device.processors[self.processor].let_go(low=1 << self.bit)


@dataclass(frozen=True, kw_only=True)
class OpenTransducer(InjectedFault):
    """A transducer that is not connected any more; its output switches as before.

    Parameters
    ----------
    transducer : int
        In array order.
    """

    transducer: Annotated[int, Whole(0, CHANNELS - 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Disconnect it."""
        device.open_since.setdefault(self.transducer, device.scheduler.now)


@dataclass(frozen=True, kw_only=True)
class ClockError(Lasting):
    """A board whose oscillator is not the shared one any more. What it has lost or gained by the end stays.

    Parameters
    ----------
    board : int
    ppm : float
        By how many millionths it runs fast, or slow where negative.
    """

    board: BoardNumber
    ppm: Annotated[float, Real(-1000, 1000)]

    on_boards: ClassVar[bool] = True

    def begin(self, device: Emulator) -> None:
        """Let it run at this rate."""
        for processor in _processors(device, self.board):
            processor.set_clock_error(round(1000 * self.ppm))

    def end(self, device: Emulator) -> None:
        """Let it run like the others."""
        for processor in _processors(device, self.board):
            processor.set_clock_error(0)


@dataclass(frozen=True, kw_only=True)
class LostSync(Lasting):
    """A sync line on which no pulse comes any more.

    Parameters
    ----------
    board : int, optional
        Where; on all boards by default.
    """

    board: BoardNumber | None = None

    on_boards: ClassVar[bool] = True

    def begin(self, device: Emulator) -> None:
        """Cut the line."""
        for processor in _processors(device, self.board):
            processor.sync_connected = False

    def end(self, device: Emulator) -> None:
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

    def begin(self, device: Emulator) -> None:
        """Heat or cool it."""
        for processor in _processors(device, self.board):
            processor.set_temperature(self.celsius)

    def end(self, device: Emulator) -> None:
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
        Where; on all boards by default.
    """

    millivolts: Annotated[int, Whole(0, 60_000)]
    board: BoardNumber | None = None

    on_boards: ClassVar[bool] = True

    def begin(self, device: Emulator) -> None:
        """Set the voltage."""
        for processor in _processors(device, self.board):
            processor.set_supply(self.millivolts)

    def end(self, device: Emulator) -> None:
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

    def begin(self, device: Emulator) -> None:
        """Slow it down."""
        device.processors[self.processor].slow_down(self.slowness)

    def end(self, device: Emulator) -> None:
        """Let it be as fast as it should."""
        device.processors[self.processor].slow_down(1)


# USB


@dataclass(frozen=True, kw_only=True)
class FlippedUsbBit(InjectedFault):
    """A bit that is wrong in packets of an endpoint, as a faulty memory leaves it: USB's own checksum is right.

    Parameters
    ----------
    endpoint : int
        Its address: 1 and 129 carry blocks and records, 3 and 131 the console.
    byte, bit : int
        Where in the packet; shorter ones pass unharmed and do not count.
    times : int
        How many packets.
    """

    endpoint: Annotated[int, OneOf((ENDPOINT_OUT, ENDPOINT_IN, CONSOLE_ENDPOINT_OUT, CONSOLE_ENDPOINT_IN))]
    byte: Annotated[int, Whole(0, BLOCK_BYTES - 1)]
    bit: ByteBit = 0
    times: Times = 1

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Wait for such packets."""
        device.usb.flips += [Flip(self.endpoint, self.byte, self.bit)] * self.times


@dataclass(frozen=True, kw_only=True)
class StalledEndpoint(InjectedFault):
    """An endpoint that the device halts by itself, until the host clears that; it needs a configured device.

    Parameters
    ----------
    endpoint : int
        Its address: 1 and 129 carry blocks and records, 3 and 131 the console.
    """

    endpoint: Annotated[int, OneOf((ENDPOINT_OUT, ENDPOINT_IN, CONSOLE_ENDPOINT_OUT, CONSOLE_ENDPOINT_IN))]

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Halt it."""
        device.usb.halt(self.endpoint)


@dataclass(frozen=True, kw_only=True)
class Unplugged(Lasting):
    """A USB cable that is pulled out, and plugged in again at the end. The device has power of its own."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Pull it out."""
        device.usb.unplug()

    def end(self, device: Emulator) -> None:
        """Plug it in."""
        device.usb.plug()


@dataclass(frozen=True, kw_only=True)
class BusReset(InjectedFault):
    """A reset of the bus that the host's programs did not ask for."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Reset it."""
        if device.usb.attached:
            device.usb.reset()


@dataclass(frozen=True, kw_only=True)
class BusSuspended(Lasting):
    """A bus that is suspended, and resumes at the end."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Suspend it."""
        if device.usb.attached:
            device.usb.suspend()

    def end(self, device: Emulator) -> None:
        """Let it resume."""
        device.usb.resume()


@dataclass(frozen=True, kw_only=True)
class SilentHost(Lasting):
    """A host of which nothing arrives over USB, whatever it sends."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Hear nothing."""
        device.usb.deaf = True

    def end(self, device: Emulator) -> None:
        """Hear again."""
        device.usb.deaf = False


# Power and flash


@dataclass(frozen=True, kw_only=True)
class PowerCut(Lasting):
    """A loss of all power, which comes back at the end."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Take the power away."""
        device.power_down()

    def end(self, device: Emulator) -> None:
        """Give it back."""
        device.power_up()


@dataclass(frozen=True, kw_only=True)
class PowerCutInWrite(InjectedFault):
    """A loss of all power while the flash is written.

    Parameters
    ----------
    written_bytes : int
        How many more bytes are programmed or, with their sector, erased; it is the next one that is cut short.
    off_periods : int, optional
        Until the power comes back; for good by default.
    """

    written_bytes: Annotated[int, Whole(0)]
    off_periods: Periods | None = None

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Wait for that byte."""
        device.flash.cut_power_after(self.written_bytes, lambda: device.inject(PowerCut(periods=self.off_periods)))


@dataclass(frozen=True, kw_only=True)
class WriteProtectedFlash(Lasting):
    """A flash that takes no command which changes anything."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Protect it."""
        device.flash.defects.write_protected = True

    def end(self, device: Emulator) -> None:
        """Protect it no more."""
        device.flash.defects.write_protected = False


@dataclass(frozen=True, kw_only=True)
class FailingSector(Lasting):
    """A sector of the flash that cannot be erased, as the flash says.

    Parameters
    ----------
    sector : int
        Of 4096 bytes.
    """

    sector: Annotated[int, Whole(0, FLASH_BYTES // FLASH_SECTOR_BYTES - 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Let it fail."""
        device.flash.defects.failing_sectors.add(self.sector)

    def end(self, device: Emulator) -> None:
        """Let it work."""
        device.flash.defects.failing_sectors.discard(self.sector)


@dataclass(frozen=True, kw_only=True)
class FailingPage(Lasting):
    """A page of the flash that cannot be programmed, as the flash says.

    Parameters
    ----------
    page : int
        Of 256 bytes.
    """

    page: Annotated[int, Whole(0, FLASH_BYTES // PAGE_BYTES - 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Let it fail."""
        device.flash.defects.failing_pages.add(self.page)

    def end(self, device: Emulator) -> None:
        """Let it work."""
        device.flash.defects.failing_pages.discard(self.page)


@dataclass(frozen=True, kw_only=True)
class StuckFlashBit(Lasting):
    """A bit of the flash that always reads the same, which the flash does not notice.

    Parameters
    ----------
    address : int
        Of its byte.
    bit : int
        Of the byte.
    value : int
        What it reads.
    """

    address: Annotated[int, Whole(0, FLASH_BYTES - 1)]
    bit: ByteBit
    value: Annotated[int, Whole(0, 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: Emulator) -> None:
        """Let it stick."""
        masks = self._masks(device)
        masks[self.address] = masks.get(self.address, 0) | 1 << self.bit

    def end(self, device: Emulator) -> None:
        """Let it be as it was written."""
        self._masks(device)[self.address] &= ~(1 << self.bit)

    def _masks(self, device: Emulator) -> dict[int, int]:
        defects = device.flash.defects
        return defects.stuck_at_1 if self.value else defects.stuck_at_0


FAULTS: Mapping[str, type[InjectedFault]] = MappingProxyType(
    {
        kind.name(): kind
        for kind in (
            LostToken,
            DoubledToken,
            FlippedBit,
            SlowLink,
            DeadProcessor,
            DeadBoard,
            StuckHigh,
            StuckLow,
            OpenTransducer,
            ClockError,
            LostSync,
            HotBoard,
            WrongSupply,
            SlowProcessor,
            FlippedUsbBit,
            StalledEndpoint,
            Unplugged,
            BusReset,
            BusSuspended,
            SilentHost,
            PowerCut,
            PowerCutInWrite,
            WriteProtectedFlash,
            FailingSector,
            FailingPage,
            StuckFlashBit,
        )
    }
)
"""All of them, by name."""


class Injector:
    """Lets faults begin and end in time, and brings them about again whenever the boards start anew.

    Parameters
    ----------
    device : Emulator
        With which something is wrong.
    """

    def __init__(self, device: Emulator) -> None:
        self._device = device
        self._standing: list[InjectedFault] = []
        """Those of the boards that are there."""

    def inject(self, fault: InjectedFault) -> None:
        """Let a fault begin at its period."""
        device = self._device
        if fault.period is None:
            self._begin(fault)
            return
        time = device.running.time
        begins = time.boundary(fault.period)
        if begins < device.scheduler.now:
            raise ValueError(f"{fault}: period {fault.period} is over; this is {time.period(device.scheduler.now)}")
        device.scheduler.at(begins, partial(self._begin, fault))

    def afflict(self) -> None:
        """The boards have just got power: bring about what is wrong with them."""
        for fault in self._standing:
            fault.begin(self._device)

    def _begin(self, fault: InjectedFault) -> None:
        device = self._device
        device.log("fault", f"{fault}, begins")
        if fault.on_boards:
            self._standing.append(fault)
        if fault.unfolds:
            device.unfold()
        if device.processors or not fault.on_boards:
            fault.begin(device)
        if isinstance(fault, Lasting) and fault.periods is not None:
            ends = device.scheduler.now + fault.periods * CYCLES_PER_PERIOD
            device.scheduler.at(ends, partial(self._end, fault))

    def _end(self, fault: InjectedFault) -> None:
        device = self._device
        device.log("fault", f"{fault}, ends")
        if fault.on_boards:
            self._standing.remove(fault)
        if device.processors or not fault.on_boards:
            fault.end(device)
            for other in self._standing:
                if type(other) is type(fault):
                    other.begin(device)  # it may concern the same thing
