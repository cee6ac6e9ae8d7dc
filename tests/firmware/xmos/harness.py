"""One executed chain processor on a bench: its switch, its links, its sync line and its port."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from phasewire.firmware.xmos.build import load_processor
from phasewire.firmware.xs1.core import Core, Sent, Stop
from phasewire.firmware.xs1.switch import SWITCH_CONFIGURATION, XLINK, LinkField, Switch
from phasewire.protocol.board import CYCLES_PER_MS, CYCLES_PER_PERIOD, CYCLES_PER_TICK, TICKS_PER_PERIOD
from phasewire.protocol.chain import Collect, Commit, Identity, Load, Message, Number, Playing, Report, Slice, decode
from phasewire.protocol.codes import SYNC_PERIODS, ChannelEnd

OUTPUT_PORT, SYNC_PORT, SUPPLY_PORT, TEMPERATURE_PORT = 0x200000, 0x10400, 0x10500, 0x80200
CONTROL, END = 0x100, 0x101
SAMPLED_AT = 195
"""In each tick the pins are looked at so many cycles after its beginning."""
LINK_SETUP = LinkField.ENABLE | LinkField.WIDE | 1 << 11 | 1
HEADER_TOKENS = 3


def tokens_of(message: Message | bytes) -> NDArray[np.uint16]:
    """What reaches the channel end: the payload and END, without the header."""
    data = message.encode() if isinstance(message, Message) else message
    tokens = np.frombuffer(data[HEADER_TOKENS:], np.uint8).astype(np.uint16)
    tokens[-1] |= CONTROL
    return tokens


class Bench:
    """A processor with its board.

    Parameters
    ----------
    program : bytes, optional
        The kept image by default.
    hello : bool
        Whether the link behind answers.
    token_cycles : int
        Core cycles of a token on the link from the controller.
    """

    def __init__(
        self,
        program: bytes | None = None,
        *,
        hello: bool = True,
        lockstep: bool = False,
        unique_id: int = 0x0123456789ABCDEF,
        token_cycles: int = 8,
        fetch: str = "off",
        profile: bool = False,
        temperature: int = 25,
        supply: int = 1,
        config_cycles: int = 40,
    ) -> None:
        image = load_processor().image if program is None else program
        self.core = Core(
            image,
            node=0xFFFF,
            registers=(unique_id & 0xFFFFFFFF, unique_id >> 32),
            lockstep=lockstep,
            fetch=fetch,  # type: ignore[arg-type]
            profile=profile,
        )
        self.answers_hello = hello
        self.hellos: list[int] = []
        self.switch = Switch(hello=self._hello)
        self.switch.write(XLINK, LINK_SETUP)
        self.token_cycles = token_cycles
        self.config_cycles = config_cycles
        self.origin: int | None = None
        self.sync_due = True
        self.free_at = 0
        self.sent: list[tuple[Sent, Message]] = []
        self.core.watch(OUTPUT_PORT)
        self._changes: list[tuple[NDArray[np.int64], NDArray[np.uint32]]] = []
        self._next_pulse = 0
        self.core.drive(TEMPERATURE_PORT, 0, temperature & 0xFF)
        self.core.drive(SUPPLY_PORT, 0, supply)

    def _hello(self, link: int) -> bool:
        assert link == 1
        self.hellos.append(self.core.cycle)
        return self.answers_hello

    @property
    def number(self) -> int:
        """Its node."""
        return self.switch.node

    def run(self, until: int) -> None:
        """Execute up to a cycle, this one included."""
        while True:
            stop = self.core.run(until)
            if stop is Stop.MESSAGE:
                for sent in self.core.take_messages():
                    self._take(sent)
            elif stop is Stop.LOG_FULL:
                self._drain()
            elif stop is Stop.TRAPPED:
                raise AssertionError(f"{self.core.trap}")
            else:
                return

    def _take(self, sent: Sent) -> None:
        if sent.destination & 0xFFFF == SWITCH_CONFIGURATION:
            assert sent.destination >> 16 == self.switch.node, "a request to another switch"
            reply = self.switch.answer(sent.tokens)
            assert reply is not None, f"a malformed request {sent.tokens}"
            self.core.set_node(self.switch.node)
            assert reply.destination >> 16 == self.switch.node, "the answer of the switch leaves the node"
            at = max(self.core.cycle + 1, sent.ends + self.config_cycles) + 8 * np.arange(len(reply.tokens))
            self.core.deliver(reply.destination >> 8 & 0xFF, reply.tokens, at)
            return
        node, end = sent.destination >> 16, sent.destination >> 8 & 0xFF
        assert sent.tokens[-1] == END
        assert not (sent.tokens[:-1] & CONTROL).any()
        header = node.to_bytes(2, "big") + bytes([end])
        self.sent.append((sent, decode(header + sent.tokens.astype(np.uint8).tobytes())))

    def answers(self) -> list[Message]:
        """What it has sent to the controller since the last call."""
        messages = [message for _, message in self.sent]
        self.sent.clear()
        return messages

    def deliver(self, channel_end: int, tokens: Sequence[int] | NDArray[np.uint16], at: int) -> int:
        """Bring tokens, the first at a cycle or when the link is free; returns the cycle of the last."""
        first = max(at, self.free_at, self.core.cycle + 1)
        times = first + self.token_cycles * np.arange(len(tokens))
        self.core.deliver(channel_end, np.asarray(tokens), times)
        self.free_at = int(times[-1]) + self.token_cycles * (1 + HEADER_TOKENS)
        return int(times[-1])

    def bring(self, message: Message, at: int = 0) -> int:
        """Bring a message, its first token at a cycle or when the link is free; returns the cycle of its END."""
        return self.deliver(int(message.CHANNEL_END), tokens_of(message), at)

    def bring_by(self, message: Message, at: int) -> int:
        """Bring a message so that its END is there at a cycle."""
        tokens = tokens_of(message)
        last = self.deliver(int(message.CHANNEL_END), tokens, at - self.token_cycles * (len(tokens) - 1))
        assert last == at, f"END is there at {last}, not {at}"
        return last

    def set_temperature(self, celsius: int, at: int) -> None:
        self.core.drive(TEMPERATURE_PORT, at, celsius & 0xFF)

    def set_supply(self, good: int, at: int) -> None:
        self.core.drive(SUPPLY_PORT, at, good)

    def begin(self, number: int = 3) -> None:
        """Number it, and begin period 0."""
        self.take_number(number)
        self.sync()

    def take_number(self, number: int = 3) -> Identity:
        """Number it; returns its identity."""
        self.bring(Number(number), at=20_000)  # a message before there is a channel end would be lost
        for _ in range(1200):
            self.run(self.core.cycle + CYCLES_PER_MS)
            if self.sent:
                break
        (identity,) = self.answers()
        assert isinstance(identity, Identity)
        return identity

    def sync(self, pulses: int = 60) -> None:
        """Begin period 0 soon, and drive the sync line from then on."""
        self.origin = self.core.cycle + 2 * CYCLES_PER_PERIOD
        for pulse in range(pulses if self.sync_due else 1):
            self.pulse(self.origin + pulse * SYNC_PERIODS * CYCLES_PER_PERIOD)
        self.run(self.origin + 300)

    def pulse(self, at: int) -> None:
        """The sync line is high for a tick."""
        self.core.drive(SYNC_PORT, at, 1)
        self.core.drive(SYNC_PORT, at + CYCLES_PER_TICK, 0)

    def boundary(self, period: int) -> int:
        """The cycle at which a period begins."""
        assert self.origin is not None
        return self.origin + period * CYCLES_PER_PERIOD

    def run_to(self, period: int, cycles: int = 0) -> None:
        """Execute up to the beginning of a period, and so many cycles more or less."""
        self.run(self.boundary(period) + cycles)

    @property
    def period(self) -> int:
        """That has begun."""
        assert self.origin is not None
        return (self.core.cycle - self.origin) // CYCLES_PER_PERIOD

    def _drain(self) -> None:
        self._changes.append(self.core.port_log(OUTPUT_PORT))

    def changes(self) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
        """All changes of the pins so far: cycles and words."""
        self._drain()
        self._changes = [tuple(np.concatenate(parts) for parts in zip(*self._changes, strict=True))]  # type: ignore[list-item]
        return self._changes[0]

    def words(self, first: int, last: int) -> NDArray[np.uint32]:
        """The words of the port in the ticks of periods from one up to, not including, another, (n, 50)."""
        assert self.boundary(last) <= self.core.cycle
        cycles, words = self.changes()
        at = self.boundary(first) + SAMPLED_AT + CYCLES_PER_TICK * np.arange((last - first) * TICKS_PER_PERIOD)
        index = np.searchsorted(cycles, at, side="right")
        return np.concatenate([[0], words]).astype(np.uint32)[index].reshape(-1, TICKS_PER_PERIOD)

    def ask(self, answer: ChannelEnd = ChannelEnd.REPORT, at: int = 0) -> Message:
        """Ask a question and run until the answer is there."""
        ends = self.bring(Collect(self.number, answer), at)
        before = len(self.sent)
        self.run(ends + CYCLES_PER_MS // 2)
        assert len(self.sent) == before + 1, "no answer within 0.5 ms (CHN-016)"
        return self.sent.pop()[1]

    def report(self, at: int = 0) -> Report:
        answer = self.ask(ChannelEnd.REPORT, at)
        assert isinstance(answer, Report)
        return answer

    def playing(self, at: int = 0) -> Playing:
        answer = self.ask(ChannelEnd.PLAYING, at)
        assert isinstance(answer, Playing)
        return answer

    def commit(self, period: int, packed: bytes, *, by: int | None = None) -> int:
        """Bring a slice and its commit, which is there at a cycle or soon; returns the cycle of its END."""
        piece = Slice(self.number, packed)
        commit = Commit.of(period, piece)
        if by is None:
            self.bring(piece)
            return self.bring(commit)
        self.bring(piece, by - 100 * self.token_cycles)
        return self.bring_by(commit, by)

    def load(self, loads: Iterator[Load] | Sequence[Load], at: int = 0) -> int:
        """Bring loads one after the other; returns the cycle of the last END."""
        return max(self.bring(load, at) for load in loads)
