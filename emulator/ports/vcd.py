"""An excerpt of a capture as a VCD file (value change dump, IEEE 1364-2005 chapter 18), for GTKWave and its like.

Each output is a wire in the scope of its board and processor; a comment says which transducers they drive. What goes on
inside the device can stand beside them as signals, down to the core cycle.

The standard has no time scale but 1, 10 or 100 of a unit: a tick is five times 100 ns and, in a file with signals, a
core cycle 25 times 100 ps. Time 0 is the beginning of period 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import merge
from operator import itemgetter
from typing import Any, TextIO, TypeAlias

from vcd import VCDWriter
from vcd.writer import Variable

from ...base.storage import FilePath, replacing
from ...protocol.board import CORE_HZ, CYCLES_PER_TICK, TICK_HZ
from ...protocol.wiring import Pin
from ..trace import Signal
from .excerpt import Excerpt

__all__ = ["write_vcd"]

ValueChange: TypeAlias = tuple[int, Variable[Any], int]  # time in units, and the new value


def write_vcd(path: FilePath, excerpt: Excerpt, signals: Sequence[Signal] = ()) -> None:
    """Write an excerpt as a VCD file, with signals beside its outputs.

    The same arguments give the same bytes. The libsigrok of today's distributions (0.5.2) stops reading at a signal of
    more than one bit.

    Raises
    ------
    ValueError
        If a signal is none, or two have one name.
    OSError
        If the file cannot be written; what stood there is untouched.
    """
    for signal in signals:
        signal.check()
    names = [signal.name for signal in signals]
    if len(set(names)) != len(names):
        raise ValueError("two signals have one name")
    with replacing(path) as part, part.open("w", encoding="ascii", newline="\n") as stream:
        _write(stream, excerpt, signals)


def _write(stream: TextIO, excerpt: Excerpt, signals: Sequence[Signal]) -> None:
    timescale, units_per_second = ("100 ps", 10**10) if signals else ("100 ns", 10**7)
    units_per_tick, units_per_cycle = units_per_second // TICK_HZ, units_per_second // CORE_HZ
    first_cycle, end_cycle = excerpt.start * CYCLES_PER_TICK, excerpt.stop * CYCLES_PER_TICK

    def output_changes() -> Iterator[ValueChange]:
        for ticks, which, levels in excerpt.changes():
            times = (ticks * units_per_tick).tolist()
            yield from zip(times, (outputs[place] for place in which.tolist()), levels.tolist(), strict=True)

    def signal_changes(signal: Signal, variable: Variable[Any]) -> Iterator[ValueChange]:
        for cycle, value in signal.changes:
            if first_cycle < cycle < end_cycle:
                yield cycle * units_per_cycle, variable, value

    with VCDWriter(
        stream,
        timescale,
        date="",
        comment=_legend(excerpt),
        version="phasewire",
        init_timestamp=excerpt.start * units_per_tick,
    ) as writer:
        outputs = [
            writer.register_var(_scope(channel), name, "wire", size=1, init=level)
            for channel, name, level in zip(excerpt.channels, excerpt.names, excerpt.before.tolist(), strict=True)
        ]
        sources = [output_changes()]
        for signal in signals:
            scope, _, name = signal.name.rpartition(".")
            variable = writer.register_var(scope, name, "wire", size=signal.width, init=signal.value_at(first_cycle))
            sources.append(signal_changes(signal, variable))
        for time, variable, value in merge(*sources, key=itemgetter(0)):
            writer.change(variable, time, value)
        writer.close(excerpt.stop * units_per_tick)


def _scope(channel: int) -> str:
    pin = Pin.of(channel)
    return f"board{pin.board}.processor{pin.processor}"


def _legend(excerpt: Excerpt) -> str:
    rows = zip(excerpt.names, excerpt.transducers, strict=True)
    return "\n".join(["Outputs and the transducers that they drive:", *(f"{name} {place}" for name, place in rows)])
