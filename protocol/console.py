"""The text console: what a person at a terminal can ask a device, as pure functions (SPEC.md, chapter CON).

Typed bytes become lines in `LineEditor`, a line becomes a `Command` in `parse_command`, and the answer becomes text
again in `answer_fields`, `format_fields`, `format_ok` and `format_error`. `COMMANDS` is the one table of what there is.
Most commands stand for a control request; what a device does on one is the device's business.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum, IntFlag
from types import MappingProxyType
from typing import NamedTuple

from ..base.errors import CommandError
from .board import CHANNELS
from .codes import ConsoleCode, Hardware, Request
from .replies import ClockReading, Info, ReadBack, Status, decode_reports
from .requests import VALUES

__all__ = [
    "COMMANDS",
    "MAX_LINE_CHARACTERS",
    "PROMPT",
    "TEST_WIDTH_TICKS",
    "Argument",
    "Command",
    "CommandForm",
    "LineEditor",
    "answer_fields",
    "format_error",
    "format_fields",
    "format_ok",
    "help_fields",
    "parse_command",
]

PROMPT = "> "
MAX_LINE_CHARACTERS = 80
TEST_WIDTH_TICKS = 2

END_OF_LINE = "\r\n"
PRINTABLE = range(0x20, 0x7F)
CARRIAGE_RETURN, LINE_FEED = 0x0D, 0x0A
ERASING = (0x08, 0x7F)
CANCELLING = (0x03, 0x15)
BELL = b"\a"
STAND_IN = b"?"


class Argument(NamedTuple):
    """A whole number that a command takes."""

    name: str
    values: range

    def __str__(self) -> str:
        return f"{self.name} {self.values[0]} to {self.values[-1]}"


class CommandForm(NamedTuple):
    """How a command is written and what it does (clause CON-005).

    Parameters
    ----------
    request : Request or None
        The control request that it stands for; None for one without.
    meaning : str
        The line of the command in the help.
    argument : Argument or None
        What must follow the name.
    """

    request: Request | None
    meaning: str
    argument: Argument | None = None


COMMANDS: Mapping[str, CommandForm] = MappingProxyType(
    {
        "help": CommandForm(None, "list the commands"),
        "version": CommandForm(Request.INFO, "versions of protocol and firmware"),
        "info": CommandForm(Request.INFO, "what this device is"),
        "status": CommandForm(Request.STATUS, "what it is doing"),
        "faults": CommandForm(Request.STATUS, "the faults that are set"),
        "clock": CommandForm(Request.CLOCK, "its time"),
        "boards": CommandForm(Request.PROCESSORS, "one line for each processor"),
        "pulses": CommandForm(
            Request.PULSES, "the pulse that a transducer plays", Argument("transducer", range(CHANNELS))
        ),
        "identify": CommandForm(
            Request.IDENTIFY, "blink the light of a board", Argument("board", VALUES[Request.IDENTIFY])
        ),
        "enable": CommandForm(Request.ENABLE, "enable the outputs"),
        "stop": CommandForm(Request.DISABLE, "silence and disable the outputs; works at any time"),
        "test": CommandForm(None, "drive one transducer alone, weakly", Argument("transducer", range(CHANNELS))),
        "watchdog": CommandForm(
            Request.WATCHDOG, "set the watchdog time in ms", Argument("ms", VALUES[Request.WATCHDOG])
        ),
        "limit": CommandForm(
            Request.LIMIT, "set the limit on the total drive", Argument("transducers", VALUES[Request.LIMIT])
        ),
        "clear": CommandForm(Request.CLEAR_FAULTS, "clear the faults"),
        "reset": CommandForm(Request.RESET, "start again as from power-up"),
        "dfu": CommandForm(None, "restart in DFU mode"),
        "frames": CommandForm(None, "how to go over to frames"),
        "echo": CommandForm(None, "send back what is typed", Argument("on", range(2))),
    }
)


class Command(NamedTuple):
    """A command as it was given: its name, and its argument if it takes one."""

    name: str
    argument: int | None = None


def parse_command(line: str) -> Command | None:
    """Read one line as a command; a line without words is none.

    Raises
    ------
    CommandError
        With the first `ConsoleCode` that applies (clause CON-006).
    """
    if len(line) > MAX_LINE_CHARACTERS:
        raise CommandError(f"a line has at most {MAX_LINE_CHARACTERS} characters", ConsoleCode.LENGTH)
    if any(ord(character) not in PRINTABLE for character in line):
        raise CommandError("a line has printable ASCII characters only", ConsoleCode.CHARACTER)
    words = line.split()
    if not words:
        return None
    name, *given = words
    if name not in COMMANDS:
        raise CommandError(f"no command {name}; help lists them", ConsoleCode.COMMAND)
    wanted = COMMANDS[name].argument
    if wanted is None:
        if given:
            raise CommandError(f"{name} takes no argument", ConsoleCode.ARGUMENTS)
        return Command(name)
    if len(given) != 1 or not given[0].isdecimal():
        raise CommandError(f"{name} takes one whole number, {wanted}", ConsoleCode.ARGUMENTS)
    value = int(given[0])
    if value not in wanted.values:
        raise CommandError(f"{name} takes {wanted}, not {value}", ConsoleCode.RANGE)
    return Command(name, value)


def answer_fields(command: Command, data: bytes) -> list[tuple[str, str]]:
    """Keys and values that a command tells of the answer to its request (clause CON-007).

    Parameters
    ----------
    command : Command
    data : bytes
        What the request was answered; of a command that tells nothing of it, anything.
    """
    match command:
        case Command("version"):
            info = vars(Info.decode(data))
            return _in_words({name: info[name] for name in ("oldest_version", "newest_version", "firmware")})
        case Command("info"):
            info = vars(Info.decode(data))
            known = {name: value for name, value in info.items() if name != "later"}
            hardware = info["hardware"]
            return _in_words(known | {"hardware": Hardware(hardware) if hardware in set(Hardware) else hardware})
        case Command("status"):
            return _in_words(vars(Status.decode(data)))
        case Command("faults"):
            return _in_words({"faults": Status.decode(data).faults})
        case Command("clock"):
            return _in_words(vars(ClockReading.decode(data)))
        case Command("boards"):
            reports = [_in_words(vars(report)) for report in decode_reports(data)]
            return [(f"processor {node}", ", ".join(map(" ".join, report))) for node, report in enumerate(reports)]
        case Command("pulses", int(transducer)):
            pulses = ReadBack.decode(data).pulses
            return _in_words({"phase": pulses.phase[transducer], "width": pulses.width[transducer]})
    return []


def _in_words(fields: Mapping[str, object]) -> list[tuple[str, str]]:
    return [(name, _word(value)) for name, value in fields.items()]


def _word(value: object) -> str:
    match value:
        case IntFlag():
            return "+".join(str(flag.name) for flag in value) or "none"
        case Enum():
            return value.name
        case bytes():
            return value.hex()
        case tuple():
            return ".".join(map(str, value))
        case None:
            return "0"  # the bank of a processor that is not there
    return str(value)


def _printable(text: str) -> str:
    if not all(ord(character) in PRINTABLE for character in text):
        raise ValueError(f"the console answers in printable ASCII, not with {text!r}")
    return text


def format_fields(fields: Iterable[tuple[str, object]]) -> str:
    """Lines ``key: value`` of an answer.

    Raises
    ------
    ValueError
        If one would not be a line of printable ASCII.
    """
    return "".join(_printable(f"{key}: {value}") + END_OF_LINE for key, value in fields)


def format_ok() -> str:
    """The last line of an answer to a command that was carried out."""
    return "ok" + END_OF_LINE


def format_error(code: ConsoleCode, text: str) -> str:
    """The last line of an answer to a command that was not; `text` is printable ASCII."""
    return f"error {code.value} {_printable(text)}" + END_OF_LINE


def help_fields() -> list[tuple[str, str]]:
    """The answer to ``help``: each command as it is written, and what it does."""
    return [
        (f"{name} {form.argument.name.upper()}" if form.argument else name, form.meaning)
        for name, form in COMMANDS.items()
    ]


class LineEditor:
    """Collects typed bytes into lines and says what the terminal shall show (clause CON-003).

    Parameters
    ----------
    echo : bool
        Whether what is typed is sent back.
    """

    def __init__(self, *, echo: bool = True) -> None:
        self.echo = echo
        self._line = bytearray()
        self._after_return = False

    def feed(self, data: bytes) -> tuple[list[str], bytes]:
        """Take the next bytes; return the lines that they end and the bytes to send back.

        A line is what was typed, one character for each byte; one that grew too long has one character too many.
        """
        lines, shown = [], bytearray()
        for byte in data:
            ends = byte == CARRIAGE_RETURN or (byte == LINE_FEED and not self._after_return)
            self._after_return = byte == CARRIAGE_RETURN
            if ends:
                lines.append(self._line.decode("latin-1"))
                self._line.clear()
                shown += END_OF_LINE.encode()
            elif byte != LINE_FEED:
                shown += self._type(byte)
        return lines, bytes(shown) if self.echo else b""

    def _type(self, byte: int) -> bytes:
        """Change the line by one byte that does not end it; return what the terminal shall show."""
        width = min(len(self._line), MAX_LINE_CHARACTERS)
        if byte in CANCELLING:
            self._line.clear()
            return b"\b \b" * width
        if byte in ERASING:
            # The one too many was never shown.
            visible = 0 < len(self._line) <= MAX_LINE_CHARACTERS
            del self._line[-1:]
            return b"\b \b" if visible else b""
        if len(self._line) <= MAX_LINE_CHARACTERS:
            self._line.append(byte)
        if len(self._line) > MAX_LINE_CHARACTERS:
            return BELL
        return bytes([byte]) if byte in PRINTABLE else STAND_IN
