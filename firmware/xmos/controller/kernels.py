"""Execute and measure the controller's kernels: checks, CRC-32, sorting and sending of a block.

Two programs are linked of the sources beside this file. One is written by hand and shares the work among threads as a
controller does: a thread that never pauses stands for USB, some check and sort, one sends. The other calls one function
of the reference device (`firmware/core`) as the compiler translates it, among four threads that never pause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ....base.errors import BlockError
from ....protocol.blocks import Block, Entries, Entry, Slot, Update, checksum, pack, pulse_words, unpack
from ....protocol.board import CHANNELS, MAX_WIDTH_TICKS, PROCESSORS
from ....protocol.chain import SLICE_BYTES, Commit, Slice
from ....protocol.codes import BLOCK_BYTES, CONTROLLER_NODE, PAYLOAD_BYTES, Kind, Reason
from ....protocol.pulses import POWER, Pulses
from ....protocol.wiring import Wiring
from ...xs1.assembler import AssemblySource, assemble, runtime
from ...xs1.core import Core, Stop
from ...xs1.program import RAM_BASE, LinkedProgram

__all__ = [
    "CASES",
    "FUNCTIONS",
    "SPLITS",
    "Call",
    "Case",
    "Fetch",
    "Passage",
    "Split",
    "call",
    "expected",
    "pass_blocks",
]

Fetch = Literal["off", "pessimistic"]
"""Whether instructions are fetched without delay, or as `phasewire.firmware.xs1.Core` says."""

FOLDER = Path(__file__).parent
PIECES = CHANNELS // 8
DRIVE_LIMIT = 1000 * CHANNELS
"""The highest: no pulses are above it."""

_PATIENCE = 400_000  # cycles
_END = 1  # the code of END


class Split(NamedTuple):
    """How sorting threads share the 40 pieces of 8 pulses. The first of them, which leads, also checks the block.

    Parameters
    ----------
    scatter, pack : tuple of int
        Pieces of each thread, up to four of them.
    """

    scatter: tuple[int, ...]
    pack: tuple[int, ...]


SPLITS = {
    1: Split((40,), (40,)),
    2: Split((17, 23), (19, 21)),
    3: Split((8, 16, 16), (12, 14, 14)),
    4: Split((4, 12, 12, 12), (9, 10, 10, 11)),
}
"""The best for so many sorting threads."""


class Case(NamedTuple):
    """A block for the kernels.

    Parameters
    ----------
    name : str
    wiring : Wiring
    block : bytes
    limit : int
        Most total drive (clause SAF-006).
    """

    name: str
    wiring: Wiring
    block: bytes
    limit: int = DRIVE_LIMIT


class Passage(NamedTuple):
    """A block's way through the hand-written kernels. Cycles count from that of the USB thread's hand-over.

    Parameters
    ----------
    reason : Reason
        ACCEPTED, or why it is refused.
    power : int
        Total drive (clause SAF-006), if the block has pulses.
    slices : bytes
        Ten slices of 48 bytes.
    messages : tuple of bytes
        The messages that went onto the link, as `phasewire.protocol.chain.Message.encode` gives them: those of an
        accepted UPDATE.
    sorted_cycles : int
        Until it is decided on and its slices are complete.
    sent_cycles : int
        Until the last token has left; 0 without messages. The core does not count the time of route headers.
    """

    reason: Reason
    power: int
    slices: bytes
    messages: tuple[bytes, ...]
    sorted_cycles: int
    sent_cycles: int


class Call(NamedTuple):
    """A call of a function of the reference device.

    Parameters
    ----------
    result : int
        What it returned.
    instructions, cycles : int
        Counts from the call to the return, among five running threads.
    slices, record : bytes
        The memory that it may have written to.
    functions : dict of int
        Instructions of each function that took part.
    """

    result: int
    instructions: int
    cycles: int
    slices: bytes
    record: bytes
    functions: dict[str, int]


@cache
def _threads(split: Split, busy: bool) -> LinkedProgram:
    defines = {f"HELPER_{k}": int(k < len(split.scatter)) for k in range(1, 4)} | {"BUSY": int(busy)}
    for name, shares in (("SCATTER", split.scatter), ("PACK", split.pack)):
        if len(shares) not in range(1, 5) or sum(shares) != PIECES:
            raise ValueError(f"shares {shares} are not {PIECES} pieces for up to four threads")
        defines |= {f"{name}_{k}": share for k, share in enumerate((*shares, 0, 0, 0)[:4])}
    hand = ("main", "sort", "crc", "send", "tasks")
    return assemble([*_written(*hand), *_generated("judge", "prepare", "pul"), runtime()], defines=defines)


def _written(*names: str) -> list[AssemblySource]:
    return [AssemblySource.read(FOLDER / f"{name}.s") for name in names]


def _generated(*names: str) -> list[AssemblySource]:
    return [AssemblySource.read(FOLDER / "generated" / f"{name}.s", library=True) for name in names]


class _Board:
    """A core with one of the programs."""

    def __init__(self, program: LinkedProgram, core: Core) -> None:
        self.program, self.core = program, core
        core.run(0)

    def put(self, name: str, values: bytes) -> None:
        """Write to memory."""
        self.core.memory[self._place(name) :][: len(values)] = np.frombuffer(values, np.uint8)

    def get(self, name: str, size: int) -> bytes:
        """Read from memory."""
        return bytes(self.core.memory[self._place(name) :][:size])

    def count(self, name: str) -> int:
        """How often the instruction at a label was executed."""
        return int(self.core.profile[self._place(name) // 2])

    def words(self, name: str, count: int) -> list[int]:
        """Read from memory."""
        return [int(word) for word in np.frombuffer(self.get(name, 4 * count), "<u4")]

    def run(self, until: int) -> None:
        """Execute up to a cycle; raises `RuntimeError` if the program traps."""
        while (stop := self.core.run(until)) is Stop.MESSAGE:
            pass
        if stop is not Stop.REACHED:
            raise RuntimeError(f"the program stopped: {self.core.trap}")

    def run_to(self, name: str, count: int, *, step: int = 1) -> int:
        """Execute until a label has been passed so many times; returns the cycle."""
        latest = self.core.cycle + _PATIENCE
        while self.count(name) < count:
            if self.core.cycle > latest:
                raise RuntimeError(f"{name} was not reached within {_PATIENCE} cycles")
            self.run(self.core.cycle + step)
        return int(self.core.cycle)

    def _place(self, name: str) -> int:
        return int(self.program.symbols[name]) - RAM_BASE


def pass_blocks(
    cases: Sequence[Case],
    *,
    split: Split = SPLITS[3],
    busy: bool = False,
    fetch: Fetch = "off",
    interval: int | None = None,
    cycles_per_token: int = 8,
    period: int = 1000,
) -> list[Passage]:
    """Let blocks pass through the hand-written kernels.

    Parameters
    ----------
    cases : sequence of Case
        All with the same wiring.
    split : Split
        Division of the work among threads.
    busy : bool
        Whether one more thread never pauses. With three that sort, five then issue all the time.
    fetch : {"off", "pessimistic"}
        As for `phasewire.firmware.xs1.Core`.
    interval : int, optional
        Cycles from a block to the next. If None, a block comes once the one before has been sent.
    cycles_per_token : int
        Rate of the link: 8 on five wires, 20 on two.
    period : int
        Period that the commits name.

    Returns
    -------
    list of Passage
        One for each case.
    """
    program = _threads(split, busy)
    board = _Board(program, Core(program.image, node=CONTROLLER_NODE, fetch=fetch, lockstep=True, profile=True))
    core = board.core
    core.link_cycles_per_token = cycles_per_token
    board.put("wiring", cases[0].wiring.channels.astype("<u2").tobytes())
    board.put("period", period.to_bytes(8, "little"))
    board.run(3_000_000)  # tables are made, and all wait
    passages: list[Passage] = []
    sent: list[tuple[bytes, int]] = []
    began: list[int] = []
    for number, case in enumerate(cases, 1):
        board.put("block", case.block)
        board.put("limit", case.limit.to_bytes(4, "little"))
        board.put("job", program.symbols["block"].to_bytes(4, "little"))
        began.append(board.run_to("received", number))
        ready = board.run_to("decided", number)
        board.run(ready + 20)
        reason, power, slices = board.words("verdict", 3)
        content = core.memory[slices - RAM_BASE :][: PROCESSORS * SLICE_BYTES].tobytes()
        passages.append(Passage(Reason(reason), power, content, (), ready - began[-1], 0))
        if interval is not None:
            board.run(began[-1] + interval)
        elif reason == Reason.ACCEPTED and case.block[3] == Kind.UPDATE:
            board.run_to("sent", board.count("sent") + 1, step=50)
            board.run(core.cycle + 200)
    if interval is not None:
        board.run(core.cycle + 40_000)
    for message in core.take_messages():
        route = (message.destination >> 16).to_bytes(2, "big") + bytes([message.destination >> 8 & 0xFF])
        sent.append((route + message.tokens.astype(np.uint8).tobytes(), message.ends))
    for place, passage in enumerate(passages):
        if passage.reason is Reason.ACCEPTED and cases[place].block[3] == Kind.UPDATE:
            own, sent = sent[: 2 * PROCESSORS], sent[2 * PROCESSORS :]
            messages = tuple(tokens for tokens, _ in own)
            passages[place] = passage._replace(messages=messages, sent_cycles=own[-1][1] - began[place])
    return passages


FUNCTIONS = {
    "pw_block_check": "header, payload, pulses and CRC-32 by tables",
    "pw_pulses_valid": "reserved pulses",
    "pw_pulses_power": "total drive",
    "pw_crc32": "CRC-32 of a block by tables",
    "pw_pulses_sort": "ten slices",
    "pw_commit_checksum": "of one commit",
    "plan": "judge, plan, sort and acknowledge: all of pw_device_block and pw_ack_put",
}
"""Of the reference device, and what they do here."""


@cache
def _functions(stand_ins: bool) -> LinkedProgram:
    names = ("plan", "ack", "num", "blk_stores", "blk_plan", "sta")
    if stand_ins:
        sources = [*_written("functions", "standing_in"), *_generated(*names, "blk")]
    else:
        sources = [*_written("functions"), *_generated(*names, "blk", "pul", "sums", "chn")]
    known = ("plan", "plan_prepare") if stand_ins else (*FUNCTIONS, "plan_prepare")
    table = "".join(f"\t.long {name}\n" for name in known)
    return assemble([*sources, AssemblySource("table.s", f'\t.section .dp.data,"awd"\n{table}'), runtime()])


def call(
    function: str, case: Case, *, fetch: Fetch = "off", stand_ins: bool = False, slices: bytes = b"", period: int = 1000
) -> Call:
    """Call a function of the reference device.

    Parameters
    ----------
    function : str
        One of `FUNCTIONS`.
    case : Case
        The block, and the wiring.
    fetch : {"off", "pessimistic"}
        As for `phasewire.firmware.xs1.Core`.
    stand_ins : bool
        Whether ``plan`` finds that others have checked and sorted the pulses, and CRC-32 is by the processor's
        instruction.
    slices : bytes
        Slices for ``pw_commit_checksum``, which takes the first 48 bytes.
    period : int
        Period for ``pw_commit_checksum``.
    """
    program = _functions(stand_ins)
    block, wiring = program.symbols["block"], program.symbols["wiring"]
    payload, at = block + BLOCK_BYTES - PAYLOAD_BYTES, program.symbols["slices"]
    arguments = {
        "pw_block_check": (block, BLOCK_BYTES, program.symbols["record"]),
        "pw_pulses_valid": (payload, CHANNELS),
        "pw_pulses_power": (payload, CHANNELS),
        "pw_crc32": (0, block, BLOCK_BYTES),
        "pw_pulses_sort": (payload, wiring, at),
        "pw_commit_checksum": (at, period & 0xFFFFFFFF, period >> 32),
    }.get(function, ())
    given = (*arguments, 0, 0, 0, 0)[:4]
    registers = (*given, program.symbols[function], program.symbols["plan_prepare"])
    core = Core(program.image, fetch=fetch, lockstep=True, profile=True, registers=registers)
    board = _Board(program, core)
    board.put("wiring", case.wiring.channels.astype("<u2").tobytes())
    board.put("block", case.block)
    board.put("slices", slices)
    began = board.run_to("called", 1)
    before = core.profile.copy()
    ended = board.run_to("returned", 1)
    spent = core.profile - before
    functions = {
        function.name: int(spent[(function.address - RAM_BASE) // 2 :][: function.size // 2].sum())
        for function in program.functions
    }
    for other in ("start", "called", "returned", "spin"):
        functions.pop(other, None)
    functions = {name: count for name, count in functions.items() if count}
    return Call(
        int(core.registers(0)[0]),
        sum(functions.values()),
        ended - began,
        board.get("slices", PROCESSORS * SLICE_BYTES),
        board.get("record", 32),
        functions,
    )


@dataclass(frozen=True)
class Expected:
    """What the protocol's own functions make of a case; as `Passage` has it."""

    reason: Reason
    power: int
    slices: bytes
    messages: tuple[bytes, ...]


def expected(case: Case, period: int = 1000) -> Expected:
    """What the protocol's own functions make of a case.

    Parameters
    ----------
    case : Case
    period : int
        Period that the commits name.
    """
    payload = np.frombuffer(case.block[-PAYLOAD_BYTES:], np.uint8)
    codes = pulse_words(payload)
    power = int(POWER[np.minimum(codes >> 7, MAX_WIDTH_TICKS)].sum())
    by_channel = case.wiring.sort(codes)
    reason = Reason.ACCEPTED
    try:
        body = unpack(case.block).body
    except BlockError as error:
        reason = Reason(error.reason)
    else:
        if isinstance(body, Update | Slot) and power > case.limit:
            reason = Reason.DRIVE
    pairs = by_channel[::2].astype(np.uint32) | by_channel[1::2].astype(np.uint32) << 12
    slices = pairs.astype("<u4").view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
    pieces = [Slice(n, slices[n * SLICE_BYTES :][:SLICE_BYTES]) for n in range(PROCESSORS)]
    sends = reason is Reason.ACCEPTED and case.block[3] == Kind.UPDATE
    messages = (*pieces, *(Commit.of(period, piece) for piece in pieces)) if sends else ()
    return Expected(reason, power, slices, tuple(message.encode() for message in messages))


def _cases() -> tuple[Case, ...]:
    rng = np.random.default_rng(23)
    row_major, permuted = Wiring(np.arange(CHANNELS)), Wiring(rng.permutation(CHANNELS))
    backwards, scattered = Wiring(np.arange(CHANNELS)[::-1]), Wiring(np.arange(CHANNELS) * 77 % CHANNELS)

    def pulses(phase: ArrayLike, width: ArrayLike) -> Pulses:
        return Pulses(np.broadcast_to(phase, CHANNELS), np.broadcast_to(width, CHANNELS))

    def update(what: Pulses) -> bytes:
        return pack(Block(Update(what), 1, restart=True))

    def spoilt(block: bytes, at: int, value: int) -> bytes:
        """With another byte, and the checksum that belongs to it."""
        changed = bytearray(block)
        changed[at] = value
        changed[28:32] = checksum(bytes(changed)).to_bytes(4, "little")
        return bytes(changed)

    drawn = pulses(rng.integers(0, 100, CHANNELS), rng.integers(0, 26, CHANNELS))
    limit = int(POWER[drawn.width].sum())
    wrong = bytearray(update(drawn))
    wrong[28] ^= 1
    entries = tuple(Entry(n % 256, 65535 - n) for n in range(120))
    return (
        Case("silence", row_major, update(pulses(0, 0))),
        Case("full drive", Wiring.strips(), update(pulses(99, MAX_WIDTH_TICKS))),
        Case("random, at the drive limit", permuted, update(drawn), limit),
        Case("random, above the drive limit", backwards, update(drawn), limit - 1),
        Case("the last pulse is reserved", scattered, spoilt(update(drawn), BLOCK_BYTES - 1, 26 << 3)),
        Case("the checksum is wrong", permuted, bytes(wrong)),
        Case("slot", permuted, pack(Block(Slot(255, drawn), 2))),
        Case("120 entries", permuted, pack(Block(Entries(entries, 0), 3))),
    )


CASES = _cases()
"""Blocks that are accepted, with few and many pulses; refused, in each way that depends on pulses; and stores."""
