"""What the hardware can carry: how long an update takes from the host to the outputs, and how many go through.

Everything is counted in core cycles of 2.5 ns and in whole numbers (SPEC.md, chapter BUD). What a document of the
hardware gives is exact; what none gives is an estimate, said to be one where it stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from .board import (
    CARRIER_HZ,
    CHANNELS_PER_PROCESSOR,
    CORE_HZ,
    CYCLES_PER_PERIOD,
    MAX_WIDTH_TICKS,
    PROCESSORS,
    TICKS_PER_PERIOD,
)
from .chain import MEMORIES, SLICE_BYTES, Commit, Load, Slice
from .codes import AMPLITUDES, BLOCK_BYTES, Memory
from .framing import UART_BITS_PER_BYTE, frame_bytes

__all__ = [
    "FIVE_WIRE",
    "FULL_SPEED_PACKET_CYCLES",
    "HOP_CYCLES",
    "LINKS",
    "MICROFRAME_CYCLES",
    "MODULATE_CYCLES",
    "PACKETS_PER_MICROFRAME",
    "PACKET_CYCLES",
    "PROCESSOR_MEMORY",
    "PROCESSOR_MEMORY_BYTES",
    "RASTERISE_CYCLES",
    "SORT_CYCLES",
    "TWO_WIRE",
    "Budget",
    "Link",
    "Stage",
    "Threads",
    "block_loads",
    "slices_cycles",
    "update_cycles",
]

# USB 2.0, 5.8.4: at high speed at most 13 bulk packets of 512 bytes fit a microframe of 125 µs.
PACKETS_PER_MICROFRAME = 13
MICROFRAMES_PER_SECOND = 8000
MICROFRAME_CYCLES = CORE_HZ // MICROFRAMES_PER_SECOND
PACKET_CYCLES = MICROFRAME_CYCLES // PACKETS_PER_MICROFRAME

# USB 2.0, 5.8.4: at full speed at most 19 bulk packets of 64 bytes fit a frame of 1 ms.
FULL_SPEED_PACKET_CYCLES = CORE_HZ // 1000 // 19

LEAST_CYCLES_PER_SYMBOL = 2
MOST_DELAY = 2**11 - 1  # the fields of the links' registers have 11 bits

# An instruction of a thread takes as many cycles as threads run, and never fewer than four. The thread that speaks USB
# needs 80 million instructions a second, so no more than five run on the controller; four are enough on a processor.
LEAST_CYCLES_PER_INSTRUCTION = 4
USB_INSTRUCTIONS_PER_SECOND = 80_000_000
CONTROLLER_THREADS = CORE_HZ // USB_INSTRUCTIONS_PER_SECOND
PROCESSOR_THREADS = 4
CONTROLLER_CYCLES_PER_INSTRUCTION = max(LEAST_CYCLES_PER_INSTRUCTION, CONTROLLER_THREADS)
PROCESSOR_CYCLES_PER_INSTRUCTION = max(LEAST_CYCLES_PER_INSTRUCTION, PROCESSOR_THREADS)

# Instructions of firmware. Sorting and judging are counted by executing such code (`firmware/xmos/controller`); the
# times of the processors are bounds of the chain's own firmware (`firmware/xmos/processor`).
#   sorting:     320 pulses taken from their 12 bits, checked, their drive added up, and put into their slices, by three
#                of the controller's four workers
#   judging:     277 for the CRC-32 of a block, 69 for its header, and 1190 that the reference device's C needs for
#                state, plan and acknowledgement
#   rasterising: from the last token of a commit to its boundary 4341 cycles are executed, 5386 under a modulation, of
#                which the rasteriser itself takes 710 instructions, 229 of them after the table is handed over
#   port, messages, sync: bounds of a period's share
SORT_INSTRUCTIONS = 3_230
WORKERS = CONTROLLER_THREADS - 1
JUDGE_INSTRUCTIONS = 277 + 69 + 1_190
RASTERISE_INSTRUCTIONS = 1_100
MODULATE_INSTRUCTIONS = CHANNELS_PER_PROCESSOR * 8
PORT_INSTRUCTIONS = TICKS_PER_PERIOD * 5
MESSAGE_INSTRUCTIONS = 400
SYNC_INSTRUCTIONS = 20

SORT_CYCLES = 7_000  # executed: 4892 to 5448 while the fourth worker pauses, 6021 to 6743 if all five threads run
RASTERISE_CYCLES = RASTERISE_INSTRUCTIONS * PROCESSOR_CYCLES_PER_INSTRUCTION
MODULATE_CYCLES = MODULATE_INSTRUCTIONS * PROCESSOR_CYCLES_PER_INSTRUCTION
HOP_CYCLES = 40  # the delay of a switch is not published; 100 ns is assumed

PROCESSOR_MEMORY_BYTES = 65_536
PROCESSOR_MEMORY = {
    "slots": MEMORIES[Memory.SLOTS].size,
    "entries": MEMORIES[Memory.ENTRIES].size,
    "samples": MEMORIES[Memory.SAMPLES].size,
    "tables": 2 * TICKS_PER_PERIOD * 4,
    "slices": 3 * SLICE_BYTES,
    "widths": (MAX_WIDTH_TICKS + 1) * AMPLITUDES,
    "stacks": PROCESSOR_THREADS * 1024,
    "code": 24 * 1024,
}
"""What a processor stores, in bytes (clause CHN-013): slices are the mailbox, what waits and what plays, widths are
modulated ones; stacks and code are estimates."""


@dataclass(frozen=True)
class Link:
    """How fast a link carries tokens (clause BUD-002); one token is one byte.

    Parameters
    ----------
    name : str
        The name for people and URLs.
    wires : int
        Wires in each direction, 2 or 5.
    symbols_per_token : int
        10 on two wires, 4 on five.
    cycles_per_symbol : int
        Core cycles from one symbol to the next, 2 to 2047.
    token_delay : int
        Core cycles added after each token, 0 to 2047.

    Raises
    ------
    ValueError
        If a link cannot be set up so.
    """

    name: str
    wires: int
    symbols_per_token: int
    cycles_per_symbol: int = 2
    token_delay: int = 0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not LEAST_CYCLES_PER_SYMBOL <= self.cycles_per_symbol <= MOST_DELAY:
            raise ValueError(
                f"a link cannot send a symbol in {self.cycles_per_symbol} core cycles; "
                f"{LEAST_CYCLES_PER_SYMBOL} to {MOST_DELAY}"
            )
        if not 0 <= self.token_delay <= MOST_DELAY:
            raise ValueError(f"a link cannot wait {self.token_delay} core cycles after a token; 0 to {MOST_DELAY}")

    @property
    def cycles_per_token(self) -> int:
        """Core cycles that one token occupies the link."""
        return self.symbols_per_token * self.cycles_per_symbol + self.token_delay


FIVE_WIRE = Link("5wire", wires=5, symbols_per_token=4)
TWO_WIRE = Link("2wire", wires=2, symbols_per_token=10)
LINKS = {link.name: link for link in (FIVE_WIRE, TWO_WIRE)}

SLICES_TOKENS = PROCESSORS * Slice.TOKENS
COMMITS_TOKENS = PROCESSORS * Commit.TOKENS
UPDATE_TOKENS = SLICES_TOKENS + COMMITS_TOKENS


def slices_cycles(link: Link) -> int:
    """Core cycles that the ten slices of an update occupy the first link."""
    return SLICES_TOKENS * link.cycles_per_token


def update_cycles(link: Link) -> int:
    """Core cycles that one update, ten slices and ten commits, occupies the first link."""
    return UPDATE_TOKENS * link.cycles_per_token


def block_loads(items: int, memory: Memory) -> int:
    """Loads that a block's items cost on the chain (clause BUD-007): its slices, or all items to each processor."""
    return PROCESSORS * -(-items // MEMORIES[memory].per_load)


class Stage(NamedTuple):
    """A part of an update's way, on a time line whose 0 is the first bit that the host sends. Core cycles."""

    name: str
    begins: int
    ends: int
    updates_per_second: Fraction
    """How many go through it at most."""

    @property
    def cycles(self) -> int:
        """How long it takes."""
        return self.ends - self.begins


class Threads(NamedTuple):
    """What hardware threads do between two updates, in core cycles of all of them together."""

    where: str
    name: str
    threads: int
    cycles: int
    available: int


@dataclass(frozen=True)
class Budget:
    """An update's way from the host to the outputs, and how many updates it carries (SPEC.md, chapter BUD).

    Parameters
    ----------
    link : Link
        Set-up of the chain's links.
    stages : tuple of Stage
        Stages in the order of the way. The last is the wait for the boundary at its longest.
    """

    link: Link
    stages: tuple[Stage, ...]

    @classmethod
    def of(cls, link: Link, *, hop_cycles: int = HOP_CYCLES, baud: int | None = None) -> Budget:
        """The budget of a device.

        Parameters
        ----------
        link : Link
            Set-up of the chain's links.
        hop_cycles : int
            Delay of a switch, in core cycles.
        baud : int, optional
            Symbols per second of a serial line that blocks come by instead of USB.

        Raises
        ------
        ValueError
            If a delay is negative or a baud rate not positive.
        """
        if hop_cycles < 0:
            raise ValueError(f"a switch cannot delay by {hop_cycles} core cycles; at least 0")
        if baud is not None and baud <= 0:
            raise ValueError(f"a serial line of {baud} baud carries nothing; at least 1")
        hops = PROCESSORS * hop_cycles
        # A commit may arrive only once no other table waits (clause CHN-007), and its table must then be ready before
        # the next boundary: this lies between any two boundaries at which fields change.
        turn = COMMITS_TOKENS * link.cycles_per_token + hops + RASTERISE_CYCLES
        if baud is None:
            arrival = ("USB", PACKET_CYCLES, Fraction(PACKETS_PER_MICROFRAME * MICROFRAMES_PER_SECOND))
        else:
            bits = frame_bytes(BLOCK_BYTES) * UART_BITS_PER_BYTE
            arrival = ("serial", -(-bits * CORE_HZ // baud), Fraction(baud, bits))
        return cls(
            link,
            _one_after_another(
                arrival,
                ("sort", SORT_CYCLES, _rate(SORT_CYCLES)),
                ("links", update_cycles(link), _rate(update_cycles(link))),
                ("hops", hops, _rate(update_cycles(link))),
                ("rasterise", RASTERISE_CYCLES, _rate(RASTERISE_CYCLES)),
                ("boundary", CYCLES_PER_PERIOD - 1, Fraction(CARRIER_HZ, -(-turn // CYCLES_PER_PERIOD))),
            ),
        )

    @property
    def best_cycles(self) -> int:
        """From the first bit to the first tick of the new field, if that comes just in time for a boundary."""
        return self.stages[-1].begins

    @property
    def worst_cycles(self) -> int:
        """The same if a boundary has just been missed."""
        return self.stages[-1].ends

    def first_period(self, begins: int) -> int:
        """The period at which an update plays whose first bit is sent at a core cycle, on an idle chain."""
        return -(-(begins + self.best_cycles) // CYCLES_PER_PERIOD)

    @property
    def bottleneck(self) -> Stage:
        """The stage that lets the fewest updates through."""
        return min(self.stages, key=lambda stage: stage.updates_per_second)

    @property
    def periods_per_update(self) -> int:
        """Carrier periods between updates that the device holds for ever."""
        return -(-CARRIER_HZ // self.bottleneck.updates_per_second)

    @property
    def updates_per_second(self) -> Fraction:
        """The rate that holds, with a whole number of periods between updates."""
        return Fraction(CARRIER_HZ, self.periods_per_update)

    @property
    def spare_loads(self) -> int:
        """Loads that fit on the first link between two updates at the rate that holds."""
        between = self.periods_per_update * CYCLES_PER_PERIOD - update_cycles(self.link)
        return between // (Load.TOKENS * self.link.cycles_per_token)

    def periods_for(self, loads: int) -> int | None:
        """Periods that so many loads take beside updates at the rate that holds; None if nothing fits between them."""
        if not self.spare_loads:
            return None
        return -(-loads // self.spare_loads) * self.periods_per_update

    @property
    def threads(self) -> tuple[Threads, ...]:
        """What the hardware threads do at the rate that holds (clause BUD-008)."""
        between = self.periods_per_update * CYCLES_PER_PERIOD

        def processor(name: str, instructions: int, times: int) -> Threads:
            return Threads("processor", name, 1, times * instructions * PROCESSOR_CYCLES_PER_INSTRUCTION, between)

        usb = USB_INSTRUCTIONS_PER_SECOND * between // CORE_HZ * CONTROLLER_CYCLES_PER_INSTRUCTION
        work = (SORT_INSTRUCTIONS + JUDGE_INSTRUCTIONS) * CONTROLLER_CYCLES_PER_INSTRUCTION
        return (
            Threads("controller", "USB", 1, usb, between),
            # Whoever sends stands still while the link is busy.
            Threads("controller", "judge, sort, send", WORKERS, work + update_cycles(self.link), WORKERS * between),
            processor("port", PORT_INSTRUCTIONS, self.periods_per_update),
            processor("rasterise, modulate", RASTERISE_INSTRUCTIONS + MODULATE_INSTRUCTIONS, self.periods_per_update),
            processor("messages", MESSAGE_INSTRUCTIONS, self.periods_per_update),
            processor("sync", SYNC_INSTRUCTIONS, self.periods_per_update),
        )


def _rate(cycles: int) -> Fraction:
    return Fraction(CORE_HZ, cycles)


def _one_after_another(*parts: tuple[str, int, Fraction]) -> tuple[Stage, ...]:
    stages: list[Stage] = []
    for name, cycles, rate in parts:
        begins = stages[-1].ends if stages else 0
        stages.append(Stage(name, begins, begins + cycles, rate))
    return tuple(stages)
