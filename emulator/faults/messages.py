"""What damages the messages of the chain, and the links that carry them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Annotated, ClassVar

from ...protocol.chain import (
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
from ...protocol.timing import LEAST_CYCLES_PER_SYMBOL, MOST_DELAY
from ..control.chain import Passing
from .fault import FaultTarget, InjectedFault, Lasting
from .limits import ByteBit, OneOf, ProcessorNumber, Times, Whole

__all__ = ["DoubledToken", "FlippedBit", "LostToken", "SlowLink"]

MESSAGES: Mapping[str, type[Message]] = MappingProxyType(
    {kind.__name__.lower(): kind for kind in (Slice, Commit, Load, Program, Collect, Number, Report, Playing, Identity)}
)

MessageName = Annotated[str, OneOf(tuple(MESSAGES))]
TokenNumber = Annotated[int, Whole(0, max(kind.TOKENS for kind in MESSAGES.values()) - 1)]


@dataclass(frozen=True, kw_only=True)
class DamagedMessage(InjectedFault):
    """Messages that lose or get something on their way.

    Parameters
    ----------
    message : str
        The kind of message: slice, commit, load, program, collect, number, report, playing or identity.
    processor : int, optional
        The processor to which they go, or from which they come; any by default.
    token : int
        The number of one of its tokens, counted from 0: three of the route header, the payload, END. By default the
        first after the header. That of an answer cannot be damaged: where else it would lead the model does not know.
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

    def begin(self, device: FaultTarget) -> None:
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
        # Every number goes to the same node: what tells them apart is the number itself, the first token after.
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
        The bit of the token.
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
        The fields of `protocol.timing.Link`, in core cycles.
    """

    link: ProcessorNumber
    cycles_per_symbol: Annotated[int, Whole(LEAST_CYCLES_PER_SYMBOL, MOST_DELAY)]
    token_delay: Annotated[int, Whole(0, MOST_DELAY)] = 0

    on_boards: ClassVar[bool] = True

    def begin(self, device: FaultTarget) -> None:
        """Set the link up."""
        slow = replace(device.chain.link, cycles_per_symbol=self.cycles_per_symbol, token_delay=self.token_delay)
        device.chain.links.set_link(self.link, slow)

    def end(self, device: FaultTarget) -> None:
        """Set it up like the others."""
        device.chain.links.set_link(self.link, device.chain.link)
