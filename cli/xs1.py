"""Commands for programs of an XS1 core: ``xs1 asm``, ``disasm``, ``run`` and ``trace``.

No device is needed for any of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer
from rich.console import Console
from rich.table import Column, Table

from ..base.errors import InputFileError
from ..base.signals import loading
from ..base.storage import check_outputs, read_file, read_text, write_file
from ..firmware.xs1.assembler import AssemblySource, assemble, runtime
from ..firmware.xs1.clang import compile_c
from ..firmware.xs1.disassembler import DisassembledLine, disassemble, listing
from ..firmware.xs1.instructions import REGISTERS
from ..firmware.xs1.names import THREAD_REGISTERS, parse_port, port_name, resource_name
from ..firmware.xs1.program import CYCLES_PER_SECOND, MEMORY_BYTES, LinkedProgram, read_map
from .console import JsonOption, among, console_for, write_json

if TYPE_CHECKING:
    from ..firmware.xs1.execution import Execution, Outcome

__all__ = ["commands"]

commands = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Assemble, disassemble, run and trace programs of an XS1 core, the chip of the chain's processors.",
    epilog="Begin with: phasewire xs1 asm play.s -o play.bin",
)

MAP_SUFFIX = ".map"
MOST_MAP_BYTES = 1 << 22
WORD_BITS = 32
CYCLES_PER_MS = CYCLES_PER_SECOND // 1000
MOST_CYCLES = 10**11
"""Of a run: some minutes of the core's time."""
MOST_STEPS = 1_000_000
MOST_SEARCHED = 100 * CYCLES_PER_MS
"""For the place from which to trace."""
MOST_TRACED = 100 * CYCLES_PER_MS
MOST_ROWS = 24
BAR = 30  # characters
FETCH_RULES, BOTH = ("off", "pessimistic"), "both"

ProgramArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="A program as `phasewire xs1 asm` writes it: memory from 0x10000 on.")
]
MapOption = Annotated[
    Path | None,
    typer.Option(
        "--map", metavar="FILE", help="The names of its addresses; by default the .map file beside it, if there is one."
    ),
]
RegisterOption = Annotated[
    list[str] | None,
    typer.Option(
        "--reg",
        metavar="REGISTER=VALUE",
        help="A register of thread 0 at the beginning, r0 to r11, cp, dp, sp or lr; may be given again.",
    ),
]
InputOption = Annotated[
    list[str] | None,
    typer.Option(
        "--input",
        metavar="PORT=CYCLE:VALUE,…",
        help="Values on input pins from cycles on, such as 1F=0:0,4000:1; may be given again.",
    ),
]
LockstepOption = Annotated[
    bool,
    typer.Option(
        "--lockstep",
        help="Execute in the order of cycles, slower: for threads that share memory without synchronising.",
    ),
]


@commands.command(epilog="Example: phasewire xs1 asm play.s -D PERIODS=40 -o play.bin")
def asm(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE", help="Assembly (.s) or C (.c, which needs clang with the target xcore)."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The program to write.")],
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="FILE", help="Its map: names of addresses; by default FILE with .map at its end."
        ),
    ] = None,
    define: Annotated[
        list[str] | None,
        typer.Option("--define", "-D", metavar="NAME=VALUE", help="A number that sources know; may be given again."),
    ] = None,
    show_listing: Annotated[bool, typer.Option("--list", help="Print the program, disassembled.")] = False,
    json_target: JsonOption = None,
) -> None:
    """Assemble and link a program, and show how much memory it takes.

    It lies at 0x10000 and begins with the first source. Functions that clang calls, such as memcpy or a division of
    64 bits, are added if they are needed.
    """
    names = output.with_suffix(MAP_SUFFIX) if map_file is None else map_file
    check_outputs([output, names, json_target], sources)
    defines = dict(_definition(text) for text in define or [])
    program = assemble([*(_source(path, defines) for path in sources), runtime()], defines=defines)
    write_file(output, program.image)
    write_file(names, program.map_text())
    out = console_for(json_target)
    if show_listing:
        out.out(listing(disassemble(program)))
    table = Table(
        "section", "address", Column("bytes", justify="right"), box=None, padding=(0, 2, 0, 0), pad_edge=False
    )
    for section in program.sections:
        table.add_row(section.name, f"0x{section.address:x}", f"{section.size:,}")
    out.print(table)
    size = len(program.image)
    out.print(f"{output}: {size:,} bytes; {MEMORY_BYTES - size:,} of {MEMORY_BYTES:,} are left. Map: {names}")
    write_json(
        json_target,
        {
            "format": "phasewire-program-1",
            "file": str(output),
            "map": str(names),
            "base": program.base,
            "bytes": size,
            "bytes_left": MEMORY_BYTES - size,
            "sections": [section._asdict() for section in program.sections],
            "functions": [function._asdict() for function in program.functions],
        },
    )


@commands.command(epilog="Example: phasewire xs1 disasm play.bin --start main --stop 0x10040")
def disasm(
    file: ProgramArgument,
    map_file: MapOption = None,
    start: Annotated[
        str | None, typer.Option(metavar="PLACE", help="A symbol of the map, or an address such as 0x10000.")
    ] = None,
    stop: Annotated[
        str | None,
        typer.Option(metavar="PLACE", help="The place before which to stop; by default the end of the code."),
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Disassemble a program: addresses, bytes, instructions, and names if there is a map."""
    program = _load(file, map_file, [json_target])
    lines = disassemble(program, *(None if text is None else _place(text, program) for text in (start, stop)))
    console_for(json_target).out(listing(lines).rstrip("\n"))
    write_json(
        json_target,
        {"format": "phasewire-disassembly-1", "file": str(file), "lines": [_line_record(line) for line in lines]},
    )


def _line_record(line: DisassembledLine) -> dict[str, Any]:
    return {
        "address": line.address,
        "bytes": line.content.hex(),
        "text": line.text,
        "labels": list(line.labels),
        "target": line.target,
    }


@commands.command(epilog="Example: phasewire xs1 run play.bin --ms 0.5 --watch 32A --profile")
def run(
    file: ProgramArgument,
    map_file: MapOption = None,
    cycles: Annotated[
        int | None, typer.Option(min=1, max=MOST_CYCLES, metavar="N", help="Execute N core cycles of 2.5 ns.")
    ] = None,
    milliseconds: Annotated[
        float | None, typer.Option("--ms", metavar="X", help="Execute for X ms of the core's time, 1 by default.")
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(metavar="PLACE", help="End when this instruction was executed: a symbol, or an address."),
    ] = None,
    register: RegisterOption = None,
    pins: InputOption = None,
    watch: Annotated[
        list[str] | None, typer.Option(metavar="PORT", help="Show the output of this port; may be given again.")
    ] = None,
    fetch: Annotated[
        str,
        typer.Option(
            metavar="RULE",
            help="Stalls for fetching instructions: off, pessimistic, or both, one run each. The real chip is between.",
            autocompletion=among((*FETCH_RULES, BOTH)),
        ),
    ] = "off",
    lockstep: LockstepOption = False,
    profile: Annotated[bool, typer.Option("--profile", help="Show how many issue slots each function took.")] = False,
    vcd: Annotated[
        Path | None, typer.Option("--vcd", metavar="FILE", help="Also write the watched ports as a VCD file.")
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Execute a program on one core, instruction by instruction, and show the end.

    Thread 0 begins at 0x10000. The core has a switch, but nothing is at the other end of its links.

    The exit code is 1 if a thread traps and has no handler.
    """
    with loading():
        from ..firmware.xs1.execution import Setup, execute
        from ..firmware.xs1.vcd import write_port_vcd

    if fetch not in (*FETCH_RULES, BOTH):
        raise ValueError(f"--fetch {fetch}: it is {', '.join(FETCH_RULES)} or {BOTH}")
    if vcd is not None and not watch:
        raise ValueError("--vcd needs a port to write: name it by --watch, such as --watch 32A")
    program = _load(file, map_file, [json_target, vcd])
    most = _cycles(cycles, milliseconds)
    place = None if until is None else _instruction(until, program)
    values, inputs = _registers(register, program), _inputs(pins)
    ports = _ports(watch)
    outcomes = {}
    for rule in FETCH_RULES if fetch == BOTH else (fetch,):
        setup = Setup(program, values, inputs, ports, cast("Any", rule), lockstep)
        outcomes[rule] = execute(setup, most, place=place)
    out = console_for(json_target)
    _print_outcomes(out, outcomes)
    first = next(iter(outcomes.values()))
    if len(outcomes) > 1:
        out.print(f"\nWith --fetch {fetch} the rest is about fetch {next(iter(outcomes))}.")
    _print_state(out, first)
    _print_ports(out, first, ports)
    _print_messages(out, first)
    if profile:
        _print_profile(out, first)
    if vcd is not None:
        write_port_vcd(vcd, {port: first.execution.changes(port) for port in ports}, first.execution.core.cycle + 1)
        out.print(f"\nWritten to {vcd}.")
    write_json(
        json_target,
        {
            "format": "phasewire-program-run-1",
            "file": str(file),
            "runs": [_outcome_record(rule, outcome, profile) for rule, outcome in outcomes.items()],
        },
    )
    if any(outcome.execution.core.trap for outcome in outcomes.values()):
        raise typer.Exit(1)


@commands.command(epilog="Example: phasewire xs1 trace play.bin --from start --count 20 --view")
def trace(
    file: ProgramArgument,
    map_file: MapOption = None,
    begin: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="CYCLE|PLACE",
            help="Begin at a cycle, or when a place is first executed: a symbol, or an address such as 0x10000.",
        ),
    ] = "0",
    count: Annotated[int, typer.Option(min=0, max=MOST_STEPS, metavar="N", help="Show N instructions.")] = 32,
    thread: Annotated[
        int | None, typer.Option(min=0, max=7, metavar="T", help="Show the instructions of this thread alone.")
    ] = None,
    register: RegisterOption = None,
    pins: InputOption = None,
    fetch: Annotated[
        str,
        typer.Option(
            metavar="RULE",
            help="Stalls for fetching instructions: off or pessimistic.",
            autocompletion=among(FETCH_RULES),
        ),
    ] = "off",
    show_view: Annotated[
        bool,
        typer.Option("--view", help="At the end show all threads: registers, instructions around pc; and port words."),
    ] = False,
    json_target: JsonOption = None,
) -> None:
    """Execute a program, and show each instruction: cycle, thread, place, and the registers that it changes."""
    with loading():
        from ..firmware.xs1.debugger import steps, view
        from ..firmware.xs1.execution import Execution, Setup, first_cycle
        from ..firmware.xs1.names import PORT_IDS

    if fetch not in FETCH_RULES:
        raise ValueError(f"--fetch {fetch}: it is {' or '.join(FETCH_RULES)}")
    program = _load(file, map_file, [json_target])
    setup = Setup(
        program,
        _registers(register, program),
        _inputs(pins),
        tuple(PORT_IDS.values()),
        cast("Any", fetch),
        lockstep=True,
    )
    execution = Execution(setup)
    if begin.isdecimal():
        first = _bounded(begin, "--from")
    else:
        place = _instruction(begin, program)
        found = first_cycle(setup, lambda other: other.has_executed(place), MOST_SEARCHED)
        if found is None:
            within = f"{MOST_SEARCHED:,} cycles ({MOST_SEARCHED / CYCLES_PER_MS:,.0f} ms), or traps before"
            raise ValueError(f"--from {begin}: the program does not come there within {within}")
        first = found.core.cycle
    if first:
        execution.run(first - 1)
    out = console_for(json_target)
    shown = []
    if count:
        out.print(f"{'cycle':>12} thread  {'place':<24} {'instruction':<28} changes", style="bold")
    for step in steps(execution, first + MOST_TRACED) if count else ():
        if thread in (None, step.thread):
            changes = " ".join(f"{name}=0x{value:x}" for name, value in step.changed.items())
            place_text = program.describe(step.address)
            out.out(f"{step.cycle:12,} {step.thread:>6}  {place_text:<24} {step.text:<28} {changes}".rstrip())
            shown.append(step)
        if len(shown) == count:
            break
    if len(shown) < count:
        out.print(_why_no_more(execution, first))
    if show_view:
        out.print()
        out.out(view(execution))
    write_json(
        json_target,
        {
            "format": "phasewire-program-trace-1",
            "file": str(file),
            "steps": [step._asdict() | {"place": program.describe(step.address)} for step in shown],
            "state": _state_record(execution),
        },
    )


# Values of options


def _definition(text: str) -> tuple[str, int]:
    """The name and the number of a definition."""
    name, equals, value = text.partition("=")
    number = _integer(value)
    if not (equals and re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII)) or number is None:
        raise ValueError(f"-D {text}: write NAME=VALUE with a number, such as PERIODS=40 or MASK=0xff")
    return name, number


def _integer(text: str) -> int | None:
    """A number that fits a word, decimal or with 0x or 0b; None if it is none."""
    try:
        number = int(text, 0)
    except ValueError:
        return None
    return number if -(1 << WORD_BITS - 1) <= number < 1 << WORD_BITS else None


def _place(text: str, program: LinkedProgram) -> int:
    """The address that an option means."""
    if text in program.symbols and text not in program.constants:
        return program.symbols[text]
    address = _integer(text)
    if address is None:
        names = [name for name in program.symbols if name not in program.constants]
        near = get_close_matches(text, names, 3)
        known = f"near it are {', '.join(near)}" if near else "the map has none like it" if names else "there is no map"
        raise ValueError(f"unknown symbol {text!r}: {known}; or write an address, such as 0x{program.base:x}")
    if not program.base <= address <= program.end:
        raise ValueError(f"address {text} is not in the program, which is from 0x{program.base:x} to 0x{program.end:x}")
    return address


def _instruction(text: str, program: LinkedProgram) -> int:
    """The address of an instruction that an option means."""
    address = _place(text, program)
    if address % 2 or address == program.end:
        raise ValueError(f"{text} is 0x{address:x}, where no instruction can be: it must be even, and in the program")
    return address


def _cycles(cycles: int | None, milliseconds: float | None) -> int:
    """How many cycles to execute at most."""
    if cycles is not None and milliseconds is not None:
        raise ValueError("give --cycles or --ms, not both")
    if cycles is not None:
        return cycles
    wanted = 1.0 if milliseconds is None else milliseconds
    if not 1 / CYCLES_PER_MS <= wanted <= MOST_CYCLES / CYCLES_PER_MS:  # also NaN
        raise ValueError(f"--ms {wanted:g} ms: give 0.0000025 ms (one cycle) to {MOST_CYCLES / CYCLES_PER_MS:,.0f} ms")
    return round(wanted * CYCLES_PER_MS)


def _bounded(text: str, option: str) -> int:
    """A cycle."""
    if len(text) > 12 or int(text) > MOST_CYCLES:
        raise ValueError(f"{option} {text}: a cycle is 0 to {MOST_CYCLES:,}")
    return int(text)


def _registers(texts: Sequence[str] | None, program: LinkedProgram) -> dict[int, int]:
    """The registers of thread 0, by number."""
    values = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        number = program.symbols.get(value, _integer(value))
        if not equals or number is None:
            raise ValueError(f"--reg {text}: write REGISTER=VALUE with a number or a symbol, such as r0=0x20")
        if name not in REGISTERS:
            raise ValueError(f"--reg {text}: unknown register {name!r}; known are {', '.join(REGISTERS)}")
        values[REGISTERS.index(name)] = number
    return values


def _ports(texts: Sequence[str] | None) -> tuple[int, ...]:
    return tuple(dict.fromkeys(parse_port(text) for text in texts or ()))


def _inputs(texts: Sequence[str] | None) -> list[tuple[int, int, int]]:
    """What is driven onto input pins, in the order of cycles."""
    changes = []
    for text in texts or ():
        name, equals, pairs = text.partition("=")
        port = parse_port(name)
        for pair in pairs.split(",") if equals else [""]:
            cycle, _, value = pair.partition(":")
            number = _integer(value)
            if not cycle.isdecimal() or number is None:
                raise ValueError(f"--input {text}: write PORT=CYCLE:VALUE,CYCLE:VALUE, such as 1F=0:0,4000:1")
            if not 0 <= number < 1 << (port >> 16):
                raise ValueError(f"--input {text}: {value} does not fit port {name}, whose width is {port >> 16} bit")
            changes.append((port, _bounded(cycle, f"--input {text}:"), number))
    changes.sort(key=lambda change: change[1])
    return changes


# Output of an execution


def _print_outcomes(out: Console, outcomes: Mapping[str, Outcome]) -> None:
    columns = (Column(name, justify="right") for name in ("last cycle", "time/µs", "instructions"))
    table = Table("fetch", "ended because", *columns, box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for rule, outcome in outcomes.items():
        time = f"{(outcome.cycle + 1) / CYCLES_PER_MS * 1000:,.4f}"
        count = f"{outcome.execution.core.instructions:,}"
        table.add_row(rule, outcome.ending.value, f"{outcome.cycle:,}", time, count)
    out.print(table)


def _print_state(out: Console, outcome: Outcome) -> None:
    """The threads, and the trap if there is one."""
    from ..firmware.xs1.debugger import describe_thread, describe_trap

    out.print()
    for thread in outcome.execution.core.threads():
        if thread.state != "free":
            out.out(describe_thread(thread, outcome.execution.setup.program))
    if text := describe_trap(outcome.execution):
        out.out(text, style="bold red")


def _print_ports(out: Console, outcome: Outcome, ports: Sequence[int]) -> None:
    for port in ports:
        cycles, words = outcome.execution.changes(port)
        changes = "1 change" if len(cycles) == 1 else f"{len(cycles):,} changes"
        out.print(f"\nPort {port_name(port)}: {changes} of its output.")
        if not len(cycles):
            continue
        digits = -(-(port >> 16) // 4)
        columns = (Column(name, justify="right") for name in ("cycle", "time/µs", "word"))
        table = Table(*columns, box=None, padding=(0, 2, 0, 0), pad_edge=False)
        for cycle, word in zip(cycles[:MOST_ROWS].tolist(), words[:MOST_ROWS].tolist(), strict=True):
            table.add_row(f"{cycle:,}", f"{cycle / CYCLES_PER_MS * 1000:,.4f}", f"0x{word:0{digits}x}")
        out.print(table)
        if len(cycles) > MOST_ROWS:
            out.print(f"and {len(cycles) - MOST_ROWS:,} more; --vcd and --json write all of them")


def _print_messages(out: Console, outcome: Outcome) -> None:
    messages = outcome.execution.messages
    if messages:
        out.print(f"\nMessages to other nodes: {len(messages):,}.")
    for sent in messages[:MOST_ROWS]:
        tokens = " ".join(_token(int(token)) for token in sent.tokens)
        out.out(
            f"cycles {sent.begins:,} to {sent.ends:,}: from channel end {sent.channel_end} "
            f"to node 0x{sent.destination >> 16:04x}, {resource_name(sent.destination & 0xFFFF)}: {tokens}"
        )
    if len(messages) > MOST_ROWS:
        out.print(f"and {len(messages) - MOST_ROWS:,} more; --json writes all of them")


def _token(token: int) -> str:
    """A token in hexadecimal; a control token in brackets."""
    return f"[{token & 0xFF:02x}]" if token > 0xFF else f"{token:02x}"


def _print_profile(out: Console, outcome: Outcome) -> None:
    from ..firmware.xs1.debugger import profile_by_function

    columns = (Column(name, justify="right") for name in ("instructions", "issue slots", "share"))
    table = Table("function", *columns, Column("", no_wrap=True), box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for function in profile_by_function(outcome.execution):
        bar = "#" * max(1, round(function.share * BAR))
        numbers = f"{function.instructions:,}", f"{function.slots:,}", f"{function.share:.1%}"
        table.add_row(function.name, *numbers, bar)
    out.print()
    out.print(table)
    if not outcome.execution.setup.program.functions:
        out.print("Without a map there are no names of functions: give --map.")


def _why_no_more(execution: Execution, first: int) -> str:
    from ..firmware.xs1.debugger import describe_trap

    if execution.core.trap is not None:
        return describe_trap(execution)
    if execution.idle:
        return f"Nothing can happen any more after cycle {execution.core.cycle:,}."
    return f"No more in the {MOST_TRACED:,} cycles from cycle {first:,} on."


def _outcome_record(rule: str, outcome: Outcome, profile: bool) -> dict[str, Any]:
    from ..firmware.xs1.debugger import profile_by_function

    execution = outcome.execution
    record: dict[str, Any] = {
        "fetch": rule,
        "ending": outcome.ending.name,
        "cycle": outcome.cycle,
        "seconds": (outcome.cycle + 1) / CYCLES_PER_MS / 1000,
    } | _state_record(execution)
    record["messages"] = [
        {
            "channel_end": sent.channel_end,
            "destination": sent.destination,
            "begins": sent.begins,
            "ends": sent.ends,
            "tokens": sent.tokens.tolist(),
        }
        for sent in execution.messages
    ]
    if profile:
        record["profile"] = [function._asdict() for function in profile_by_function(execution)]
    return record


def _state_record(execution: Execution) -> dict[str, Any]:
    core, program = execution.core, execution.setup.program
    changes = {port_name(port): execution.changes(port) for port in execution.setup.watched}
    return {
        "executed_to_cycle": core.cycle,
        "instructions": core.instructions,
        "trap": None if core.trap is None else core.trap._asdict() | {"place": program.describe(core.trap.pc)},
        "threads": [
            thread._asdict()
            | {
                "place": program.describe(thread.pc),
                "registers": dict(zip(THREAD_REGISTERS, core.registers(thread.number).tolist(), strict=True)),
            }
            for thread in core.threads()
            if thread.state != "free"
        ],
        "ports": {
            name: {"cycles": cycles.tolist(), "words": words.tolist()} for name, (cycles, words) in changes.items()
        },
    }


# Files


def _source(path: Path, defines: dict[str, int]) -> AssemblySource:
    match path.suffix.lower():
        case ".s":
            return AssemblySource.read(path)
        case ".c":
            return compile_c(path, defines=defines)
    raise InputFileError(f"{path} is no source; give assembly, FILE.s, or C, FILE.c")


def _load(file: Path, map_file: Path | None, outputs: Sequence[str | Path | None]) -> LinkedProgram:
    """The program in a file, with the names of its map if there is one."""
    beside = file.with_suffix(MAP_SUFFIX)
    if map_file is None and beside != file and beside.is_file():
        map_file = beside
    check_outputs(outputs, [file, *([map_file] if map_file else [])])
    image = read_file(file, MEMORY_BYTES)
    if not image:
        raise InputFileError(f"{file} is empty; a program has 1 to {MEMORY_BYTES} bytes")
    if map_file is None:
        return LinkedProgram(image)
    return read_map(read_text(map_file, MOST_MAP_BYTES), image, file=str(map_file))
