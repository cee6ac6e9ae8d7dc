"""Small programs on a core, for the tests of the core."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from phasewire.firmware.xs1.assembler import AssemblySource, assemble
from phasewire.firmware.xs1.core import Core, Stop

PORT_32A, PORT_1F, PORT_8C, PORT_4A = 0x200000, 0x10400, 0x80200, 0x40000
CLOCK_1, CLOCK_2 = 0x106, 0x206
STACK = 0x1F000
WORD = 0xFFFFFFFF


def constant(register: str, value: int) -> str:
    """Load a constant; uses r11."""
    value &= WORD
    if value < 1 << 16:
        return f"ldc {register}, {value}\n"
    low = f"ldc r11, {value & 0xFFFF}\nor {register}, {register}, r11\n"
    return f"ldc {register}, {value >> 16}\nshl {register}, {register}, 16\n{low}"


def clocked(port: int, divide: int, clock: int = CLOCK_1, *, port_in: str = "r4", clock_in: str = "r5") -> str:
    """Begin to use a port with a clock block of its own, whose period is 2 * divide reference cycles; uses r0."""
    return f"""
        {constant(port_in, port)}
        setc res[{port_in}], 8
        {constant(clock_in, clock)}
        setc res[{clock_in}], 8
        ldc r0, {divide}
        setd res[{clock_in}], r0
        setclk res[{port_in}], {clock_in}
        setc res[{clock_in}], 15
    """


def image(text: str) -> bytes:
    """Assemble; instructions may also be separated by semicolons."""
    return assemble([AssemblySource("test.s", text.replace("; ", "\n"))]).image


def core(text: str, *registers: int, **options: Any) -> Core:
    """A core with a program, and a stack for thread 0."""
    made = Core(image(text), registers=registers, **options)
    made.registers(0)[14] = STACK
    return made


def execute(
    text: str,
    *registers: int,
    cycles: int = 100_000,
    watch: int | None = None,
    pins: Iterable[tuple[int, int, int]] = (),
    **options: Any,
) -> Core:
    """A core that has executed a program, which ends by waiting for nothing.

    A port may be watched. ``pins`` are ports, cycles and values from outside.
    """
    made = core(text + "\nclre\nwaiteu\n", *registers, **options)
    if watch is not None:
        made.watch(watch)
    for pin in pins:
        made.drive(*pin)
    assert made.run(made.cycle + cycles) is Stop.REACHED, made.trap
    return made


def set_words(made: Core, address: int, words: Any) -> None:
    values = np.asarray(words, np.int64).astype(np.uint32)
    made.memory[address - 0x10000 :][: 4 * len(values)] = values.view(np.uint8)


def get_words(made: Core, address: int, count: int) -> list[int]:
    return [int(word) for word in made.memory[address - 0x10000 :][: 4 * count].view(np.uint32)]
