"""A broken text console (chapter CON)."""

from __future__ import annotations

from typing import Any

from ....base.errors import CommandError
from ....emulator.control import controller
from ....emulator.control.controller import Controller
from ....emulator.interfaces import console
from ....emulator.interfaces.serial_line import SerialLine
from ....protocol import console as words
from ....protocol.codes import ConsoleCode, State
from ....protocol.console import COMMANDS, MAX_LINE_CHARACTERS, PROMPT, Command, LineEditor
from ....protocol.requests import VALUES
from .patching import Patch, mutant

OK = "ok\r\n"
ERASING = (0x08, 0x7F)
BELL = b"\a"
SHOWN_ERASED = b"\b \b"


def _parse(patch: Patch, around: Any) -> None:
    """Change how the device reads a line."""
    patch.wrap(console, "parse_command", around)


# Lines


class _Longer(LineEditor):
    """A line editor that takes one character more."""

    def _type(self, byte: int) -> bytes:
        if len(self._line) == MAX_LINE_CHARACTERS and byte in range(0x20, 0x7F):
            self._line.append(byte)
            return bytes([byte])
        if len(self._line) == MAX_LINE_CHARACTERS + 1 and byte in range(0x20, 0x7F):
            self._line.append(byte)
            return BELL
        if len(self._line) > MAX_LINE_CHARACTERS + 1 and byte in range(0x20, 0x7F):
            return BELL
        return super()._type(byte)


@mutant("CON-001", "CON-003", "CON-006")
def lines_may_have_81_characters(patch: Patch) -> None:
    """A line of 81 characters is accepted: the buffer has 82 bytes, and the comparison is off by one."""

    def around(original: Any) -> Any:
        return lambda line: original(line if len(line) != MAX_LINE_CHARACTERS + 1 else line.strip())

    patch.replace(console, "LineEditor", _Longer)
    _parse(patch, around)


class _Eager(LineEditor):
    """A line editor that answers a deletion even if the line is empty."""

    def _type(self, byte: int) -> bytes:
        return SHOWN_ERASED if byte in ERASING and not self._line else super()._type(byte)


@mutant("CON-003")
def backspace_moves_at_an_empty_line(patch: Patch) -> None:
    """Backspace sends 08 20 08 even if the line is empty, and so wipes out the prompt."""
    patch.replace(console, "LineEditor", _Eager)


class _TwoEnds(LineEditor):
    """A line editor that takes CR and LF for two ends of line."""

    def feed(self, data: bytes) -> tuple[list[str], bytes]:
        self._after_return = False
        return super().feed(data)


@mutant("CON-003")
def cr_lf_ends_two_lines(patch: Patch) -> None:
    """CR LF ends a line and an empty line after it, which gets a prompt of its own."""
    patch.replace(console, "LineEditor", _TwoEnds)


class _Literal(LineEditor):
    """A line editor that takes DEL for a character."""

    def _type(self, byte: int) -> bytes:
        if byte == ERASING[1]:
            self._line.append(byte)
            return b"?"
        return super()._type(byte)


@mutant("CON-003")
def del_takes_nothing_back(patch: Patch) -> None:
    """DEL (7F) counts as a character that is not printable; it should delete one, as 08 does."""
    patch.replace(console, "LineEditor", _Literal)


@mutant("CON-003", wraps=(console.Console, "_carry_out"))
def echo_0_is_not_heeded(original: Any, self: Any, command: Command) -> Any:
    """`echo 0` is answered with ok, but typed characters still come back."""
    answer = original(self, command)
    self._editor.echo = True
    return answer


@mutant("CON-002", wraps=(SerialLine, "open"))
def console_greets(original: Any, self: Any) -> None:
    """When DTR is set the console sends a prompt before anything was typed."""
    original(self)
    self._say(PROMPT.encode("ascii"))


# Judgement


@mutant("CON-001")
def case_does_not_matter(patch: Patch) -> None:
    """Commands are understood in capitals too."""
    _parse(patch, lambda original: lambda line: original(line.lower()))


@mutant("CON-006", by=_parse)
def command_is_judged_before_its_characters(original: Any) -> Any:
    """An unknown command with an unprintable character gives COMMAND; CHARACTER should come first."""

    def parse(line: str) -> Any:
        try:
            return original(line)
        except CommandError as error:
            words = line.split()
            if error.reason == ConsoleCode.CHARACTER and words and words[0] not in COMMANDS:
                raise CommandError("no such command", ConsoleCode.COMMAND) from None
            raise

    return parse


@mutant("CON-006", "CON-005", by=_parse)
def ranges_are_not_judged(original: Any) -> Any:
    """A number outside its range is passed on: the request refuses it, or the last transducer is used."""

    def parse(line: str) -> Any:
        try:
            return original(line)
        except CommandError as error:
            if error.reason != ConsoleCode.RANGE:
                raise
            name, number = line.split()
            form = COMMANDS[name]
            assert form.argument is not None
            last = form.argument.values[-1]
            return Command(name, int(number) if form.request in VALUES else min(int(number), last))

    return parse


@mutant("CON-006", "CON-001", by=_parse)
def signs_before_numbers_are_taken(original: Any) -> Any:
    """A number may have a plus sign: the library function that reads it allows one."""

    def parse(line: str) -> Any:
        words = [word[1:] if word.startswith("+") and word[1:].isdecimal() else word for word in line.split()]
        return original(" ".join(words) if "+" in line else line)

    return parse


@mutant("CON-006", by=_parse)
def arguments_too_many_are_ignored(original: Any) -> Any:
    """Text after a command without arguments is ignored; ARGUMENTS should be the answer."""

    def parse(line: str) -> Any:
        try:
            return original(line)
        except CommandError as error:
            name = (line.split() or [""])[0]
            if error.reason == ConsoleCode.ARGUMENTS and COMMANDS[name].argument is None:
                return Command(name)
            raise

    return parse


# Answers


@mutant("CON-002", wraps=(console.Console, "_answer"))
def ok_is_missing_after_clear(original: Any, self: Any, line: str) -> Any:
    """`clear` is carried out and answered with only the prompt."""
    text, then = original(self, line)
    return (text.removesuffix(OK) if line.split() == ["clear"] else text), then


@mutant("CON-007", wraps=(console, "answer_fields"))
def keys_of_status_are_sorted(original: Any, command: Command, data: bytes) -> Any:
    """`status` answers its keys in alphabetical order, not in the order of the record."""
    found = original(command, data)
    return sorted(found) if command.name == "status" else found


@mutant("CON-007", wraps=(words, "_word"))
def no_bits_are_said_as_0(original: Any, value: object) -> Any:
    """An empty set of bits reads 0 instead of none."""
    found = original(value)
    return "0" if found == "none" else found


@mutant("CON-007")
def bytes_are_said_in_capitals(patch: Patch) -> None:
    """Bytes are printed in capital hexadecimal digits: the library does so."""
    patch.wrap(
        words, "_word", lambda original: lambda said: said.hex().upper() if type(said) is bytes else original(said)
    )


@mutant("CON-003", "SER-010", wraps=(console.Console, "begin_line"))
def echo_is_on_again_after_frames(original: Any, self: Any) -> Any:
    """When a line returns from frames echo is on again, even after `echo 0`: its editor is new."""
    self._editor.echo = True
    return original(self)


@mutant("CON-005", "CON-007")
def help_forgets_a_command(patch: Patch) -> None:
    """`help` omits the last command, which was added later."""
    patch.wrap(console, "help_fields", lambda original: lambda: original()[:-1])


@mutant("CON-007", wraps=(console, "answer_fields"))
def later_of_info_is_told(original: Any, command: Command, data: bytes) -> Any:
    """`info` also prints the bytes that belong to later versions."""
    found = original(command, data)
    return [*found, ("later", data[48:].hex())] if command.name == "info" else found


# Effects


@mutant("CON-008")
def test_drives_a_width_of_3(patch: Patch) -> None:
    """`test` drives its transducer with a width of 3 ticks instead of 2."""
    patch.replace(controller, "TEST_WIDTH_TICKS", 3)


@mutant("CON-008", wraps=(Controller, "test_transducer"))
def test_is_not_counted(original: Any, self: Any, transducer: int, door: Any) -> None:
    """The blocks of `test` are not counted as accepted."""
    accepted = self._device.accepted
    original(self, transducer, door)
    self._device.accepted = accepted


@mutant("CON-004", "STA-005", wraps=(console.Console, "_ask"))
def stop_is_refused_in_fault(original: Any, self: Any, command: Command) -> Any:
    """While a fault is not cleared `stop` is refused, although stopping twice does no harm."""
    if command.name == "stop" and self._controller.state is State.FAULT:
        raise CommandError("there is a fault", ConsoleCode.REFUSED)
    return original(self, command)


@mutant("CON-004", "SAF-003", wraps=(console.Console, "_ask"))
def commands_are_no_signs_of_life(original: Any, self: Any, command: Command) -> Any:
    """`status` and `faults` do not feed the watchdog, although the request STATUS does."""
    watchdog = self._controller._machine.watchdog
    fed = watchdog._fed
    answer = original(self, command)
    if command.name in ("status", "faults"):
        watchdog._fed = fed
    return answer
