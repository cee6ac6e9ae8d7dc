"""The program's C, compiled by gcc, makes the tables and decides as the specification and the Python model do."""

from __future__ import annotations

import ctypes
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from phasewire.emulator.boards.processor import Processor
from phasewire.emulator.ports.clock import BoardClock, Timebase
from phasewire.emulator.scheduler import Scheduler
from phasewire.emulator.trace import Tracer
from phasewire.protocol.chain import Collect, Commit, Load, Message, Number, Program, Slice
from phasewire.protocol.codes import ChannelEnd, Memory
from phasewire.protocol.pulses import MODULATED_WIDTH

from .host_library import CMessage, CTold, load, word

PERIOD = 10_000
NUMBER = 5


@pytest.fixture
def library(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> ctypes.CDLL:
    shared = tmp_path_factory.getbasetemp() / "firmware-host"
    made: Path = shared / str(abs(hash(request.node.name)))
    return load(made)


def test_the_tables_are_those_of_the_specification(library: ctypes.CDLL) -> None:
    """PUL-004 and PUL-006, for every pulse and every sample."""
    library.memories_begin()
    begins, ends = ((ctypes.c_uint8 * 4096).in_dll(library, name) for name in ("pulse_begins", "pulse_ends"))
    wrong = []
    for code in range(4096):
        phase, width = code & 127, code >> 7
        begin = (phase - width) // 2 % 50
        expected = (begin, (begin + width) % 50) if 0 < width <= 25 and phase < 100 else (0, 0)
        if (begins[code], ends[code]) != expected:
            wrong.append(code)
    assert not wrong
    widths = np.ctypeslib.as_array((ctypes.c_uint8 * (256 * 26)).in_dll(library, "widths")).reshape(256, 26)
    assert np.array_equal(widths, MODULATED_WIDTH)


class Host:
    """play.c and handle.c beside the Python model, with a time that only the test moves."""

    def __init__(self, library: ctypes.CDLL, first_time: int, first_period: int = 0) -> None:
        self.library = library
        self.first_time = first_time
        library.memories_begin()
        library.test_number(NUMBER)
        word(library, "test_temperature").value = 25
        library.play_begin()
        word(library, "first_time").value = first_time
        library.play_started()
        self.scheduler = Scheduler()
        self.model = Processor(self.scheduler, NUMBER, BoardClock(), (1, 2, 3), 7, lambda _: None, Tracer())
        self.model.receive(Number(NUMBER).encode())
        self.model.start(Timebase(0))
        self.decided = 0

    def at(self, cycle: int) -> None:
        """It is some cycle after the beginning of period 0."""
        word(self.library, "test_time").value = (self.first_time + cycle // 4) % 2**32
        self.scheduler.run_until(cycle)

    def bring(self, message: Message) -> None:
        self.model.receive(message.encode())
        tokens = message.encode()[3:-1]
        made = CMessage()
        made.kind = int(message.CHANNEL_END)
        if isinstance(message, Slice):
            data = np.frombuffer(tokens, "<u4").tolist()
            crc = 0xFFFFFFFF ^ data[0]
            for value in data[1:]:
                crc = self.library.crc_word(crc, value) & 0xFFFFFFFF
            data = [*data, crc]
        elif isinstance(message, Program | Collect | Number):
            data = [tokens[0], *np.frombuffer(tokens[1:], "<u4").tolist()]
        else:
            data = np.frombuffer(tokens, "<u4").tolist()
        for place, value in enumerate(data):
            made.body[place] = value
        handled = isinstance(message, Load | Collect | Number)
        (self.library.handle_message if handled else self.library.play_message)(ctypes.byref(made))

    def decide(self, period: int) -> None:
        """Let both come to the boundary of a period: the C decides some time before."""
        word(self.library, "heard").value = word(self.library, "test_time").value
        word(self.library, "test_time").value = (self.first_time + (period * PERIOD - 5400) // 4) % 2**32
        self.library.play_wake()
        self.library.play_time()
        word(self.library, "test_time").value = (self.first_time + (period * PERIOD - 4400) // 4) % 2**32
        self.decided += 1

    @property
    def told(self) -> Any:
        return CTold.in_dll(self.library, "told")


def pulses(rng: np.random.Generator) -> bytes:
    codes = rng.integers(0, 100, 32) | rng.integers(0, 26, 32) << 7
    return sum(int(code) << 12 * place for place, code in enumerate(codes)).to_bytes(48, "little")


@pytest.mark.parametrize("seed", range(4))
def test_it_decides_as_the_model(library: ctypes.CDLL, seed: int) -> None:
    """Random commits, sequences and modulations: the same pulses, since the same period, under the same sample."""
    rng = np.random.default_rng(seed)
    host = Host(library, first_time=int(rng.integers(0, 2**32)))
    host.at(100)
    slots = [pulses(rng) for _ in range(8)]
    for slot, packed in enumerate(slots):
        host.bring(Load(NUMBER, Memory.SLOTS, slot, packed))
    entries = np.stack([rng.integers(0, 8, 12), rng.integers(0, 4, 12)], axis=1).astype("<u2")
    host.bring(Load(NUMBER, Memory.ENTRIES, 7, entries.tobytes()))
    samples = rng.integers(0, 256, 48).astype(np.uint8)
    host.bring(Load(NUMBER, Memory.SAMPLES, 11, samples.tobytes()))
    for period in range(1, 800):
        host.at((period - 1) * PERIOD + 2000)
        for _ in range(int(rng.integers(0, 3))):
            due, kind = period + int(rng.integers(0, 5)), int(rng.integers(0, 12))
            if kind < 3:
                piece = Slice(NUMBER, pulses(rng))
                host.bring(piece)
                host.bring(Commit.of(due, piece))
            elif kind == 3:
                host.bring(Commit(NUMBER, due, int(rng.integers(0, 2**32))))
            elif kind < 7:
                first, count = int(rng.integers(7, 13)), int(rng.integers(0, 7))
                host.bring(
                    Program(
                        NUMBER, Memory.ENTRIES, due, first if count else 0, count, 0, int(count and rng.integers(3))
                    )
                )
            elif kind < 9:
                first, count = int(rng.integers(11, 40)), int(rng.integers(0, 19))
                hold = int(count and rng.integers(1, 4))
                host.bring(Program(NUMBER, Memory.SAMPLES, due, first if count else 0, count, hold))
            elif kind == 9:
                celsius = int(rng.integers(60, 100))
                host.model.set_temperature(celsius)
                library.play_temperature(celsius)
                word(library, "test_temperature").value = celsius
        host.decide(period)
        host.at(period * PERIOD + 10)
        since, packed = host.model.history.segments().at(period)
        told = host.told.after
        assert (told.since, ctypes.string_at(told.slice, 48)) == (since, packed), f"period {period}"
        _, applied = host.model.history.segments().rows(period, period + 1)
        if packed == bytes(48) and library.test_is_silent() & 1:
            continue
        row = word(library, "test_row").value
        assert bytes((ctypes.c_uint32 * 12).in_dll(library, "test_slice")) == packed, f"period {period}"
        assert min(row, 255) == applied[0] or np.array_equal(
            MODULATED_WIDTH[min(row, 255)], MODULATED_WIDTH[applied[0]]
        )
    assert host.told.missed == host.model.missed_commits
    assert host.told.after.carried_out == host.model.carried_out


def test_periods_have_64_bits(library: ctypes.CDLL) -> None:
    """A commit that differs from the next period in its high half waits on (TIM-002)."""
    host = Host(library, 0)
    host.at(100)
    piece = Slice(NUMBER, pulses(np.random.default_rng(1)))
    host.bring(piece)
    host.bring(Commit.of(2**32 + 1, piece))
    for period in range(1, 4):
        host.at((period - 1) * PERIOD + 2000)
        host.decide(period)
    assert library.test_is_silent() & 1
    assert host.told.missed == 0


def test_the_crc_steps_are_those_of_the_chip(library: ctypes.CDLL) -> None:
    """The stand-in of the test agrees with zlib, as the chip's instruction does."""
    data = bytes(range(48))
    crc = 0x9226F562
    for value in np.frombuffer(data, "<u4").tolist():
        crc = library.crc_word(crc, value) & 0xFFFFFFFF
    assert ~library.crc_word(crc, 0) & 0xFFFFFFFF == zlib.crc32(data)


@pytest.mark.parametrize("channel_end", [ChannelEnd.LOAD])
def test_loads_are_kept_and_wrong_ones_counted(library: ctypes.CDLL, channel_end: ChannelEnd) -> None:
    """CHN-012, against the Python decoder: random headers of loads."""
    rng = np.random.default_rng(5)
    Host(library, 0)
    memories = {1: np.zeros(12288, np.uint8), 2: np.zeros(4096, np.uint8), 3: np.zeros(4096, np.uint8)}
    sizes, items = {1: 48, 2: 4, 3: 1}, {1: 256, 2: 1024, 3: 4096}
    damaged = 0
    for _ in range(3000):
        memory = int(rng.integers(0, 5))
        first = (int(rng.integers(0, 4100)), int(rng.integers(0, 256)), 0xFFFF, 1020, 4090)[rng.integers(0, 5)]
        count = (1, 1, 2, 12, 13, 48, 49, 0, 255, int(rng.integers(0, 50)))[rng.integers(0, 10)]
        if memory in items and rng.integers(8) == 0:  # the last item, or one more
            first = items[memory] - count + int(rng.integers(0, 2))
            first = max(first, 0)
        data = rng.integers(1, 256, 48).astype(np.uint8)
        used = count * sizes.get(memory, 1)
        if rng.integers(4):
            data[used:] = 0
        message = CMessage()
        message.kind = int(channel_end)
        body = bytes([memory]) + first.to_bytes(2, "little") + bytes([count]) + data.tobytes()
        for place, value in enumerate(np.frombuffer(body, "<u4").tolist()):
            message.body[place] = value
        library.handle_message(ctypes.byref(message))
        good = memory in sizes and count and used <= 48 and first + count <= items[memory] and not data[used:].any()
        if good:
            memories[memory][first * sizes[memory] :][:used] = data[:used]
        else:
            damaged += 1
    for memory, name in ((1, "slots"), (2, "entries"), (3, "samples")):
        kept = np.ctypeslib.as_array((ctypes.c_uint8 * memories[memory].size).in_dll(library, name))
        assert np.array_equal(kept, memories[memory]), name
    assert damaged > 500
