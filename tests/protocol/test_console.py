from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.errors import CommandError
from phasewire.protocol.codes import ConsoleCode, Reason, Request
from phasewire.protocol.console import (
    COMMANDS,
    PROMPT,
    TEST_WIDTH_TICKS,
    Command,
    LineEditor,
    format_error,
    format_fields,
    format_ok,
    help_fields,
    parse_command,
)

from tests.specification import SPEC, codes, table

BOUNDED = [(name, form.argument) for name, form in COMMANDS.items() if form.argument]
BARE = [name for name, form in COMMANDS.items() if not form.argument]


def refusal(line: str) -> ConsoleCode:
    with pytest.raises(CommandError) as refused:
        parse_command(line)
    return ConsoleCode(refused.value.reason)


# The specification


def test_the_table_of_codes() -> None:
    assert codes("ConsoleCode") == {code.name: code.value for code in ConsoleCode}


def test_the_table_of_commands() -> None:
    said = [tuple(cell.strip("`") for cell in row) for row in table("commands")]
    known = [
        (name, str(form.argument or ""), form.request.name if form.request else "", form.meaning)
        for name, form in COMMANDS.items()
    ]
    assert said == known


def test_every_request_for_people_is_a_command() -> None:
    """WIRING is for programs: 320 numbers. REVERT is for those that also look what became of it."""
    assert {form.request for form in COMMANDS.values()} == {*Request, None} - {Request.WIRING, Request.REVERT}


def test_the_width_of_a_test_is_the_specification_s() -> None:
    (clause,) = re.findall(r"^\*\*CON-008\*\*.*?\n\n", SPEC, re.MULTILINE | re.DOTALL)
    assert f"width {TEST_WIDTH_TICKS} " in clause.replace("\n", " ")


ANSWERS: dict[str, str] = {
    "watchdog 5000": format_ok(),
    "test 17": format_ok(),
    "enable": format_ok(),
    "pulses 17": format_fields([("phase", 0), ("width", TEST_WIDTH_TICKS)]) + format_ok(),
    "stop": format_ok(),
    "frames": format_fields([("frames", "send the byte 00")]) + format_ok(),
}


def test_the_session_is_what_a_device_would_say() -> None:
    """With a model of a device that knows whether it is enabled, and what it was asked in this session."""
    (session,) = re.findall(r"^```console\n(.*?)^```", SPEC, re.MULTILINE | re.DOTALL)
    typed = re.findall(r"^> (.*)$", session, re.MULTILINE)
    assert len(typed) == 9
    editor, shown, enabled = LineEditor(), PROMPT, False
    for line in typed:
        lines, echo = editor.feed(line.encode() + b"\r")
        assert lines == [line]
        try:
            command = parse_command(line)
        except CommandError as error:
            answer = format_error(ConsoleCode(error.reason), str(error))
        else:
            assert command
            enabled = (enabled or command.name == "enable") and command.name != "stop"
            refused = command.name == "test" and not enabled
            answer = (
                format_error(ConsoleCode.REFUSED, f"DISABLED: {Reason.DISABLED.text}") if refused else ANSWERS[line]
            )
        shown += echo.decode() + answer + PROMPT
    assert shown.removesuffix(PROMPT) == session.replace("\n", "\r\n")


# Commands


@pytest.mark.parametrize("name", BARE)
def test_commands_without_an_argument(name: str) -> None:
    assert parse_command(name) == Command(name)
    assert parse_command(f"  {name} ") == Command(name)
    assert refusal(f"{name} 1") == ConsoleCode.ARGUMENTS


@pytest.mark.parametrize(
    ("name", "lowest", "highest"),
    [
        ("pulses", 0, 319),
        ("identify", 0, 4),
        ("test", 0, 319),
        ("watchdog", 10, 60_000),
        ("limit", 0, 320),
        ("echo", 0, 1),
    ],
)
def test_commands_with_an_argument(name: str, lowest: int, highest: int) -> None:
    assert parse_command(f"{name} {lowest}") == Command(name, lowest)
    assert parse_command(f" {name}   00{highest}  ") == Command(name, highest)
    assert refusal(f"{name} {highest + 1}") == ConsoleCode.RANGE
    assert refusal(f"{name} {'9' * 60}") == ConsoleCode.RANGE
    if lowest:
        assert refusal(f"{name} {lowest - 1}") == ConsoleCode.RANGE
    for wrong in ("", " x", " -1", " 1.0", " 0x1", " 1 2", " 1_0"):
        assert refusal(name + wrong) == ConsoleCode.ARGUMENTS


def test_no_command_with_an_argument_is_left_out() -> None:
    assert [name for name, _ in BOUNDED] == ["pulses", "identify", "test", "watchdog", "limit", "echo"]


@pytest.mark.parametrize("line", ["", "   ", " " * 80])
def test_a_line_without_words_is_no_command(line: str) -> None:
    assert parse_command(line) is None


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("x" * 81 + "\n", ConsoleCode.LENGTH),
        (" " * 81, ConsoleCode.LENGTH),
        ("hält", ConsoleCode.CHARACTER),
        ("status\t", ConsoleCode.CHARACTER),
        ("limit \x1b[A", ConsoleCode.CHARACTER),
        ("limit ²", ConsoleCode.CHARACTER),
        ("\x7f", ConsoleCode.CHARACTER),
        ("Status", ConsoleCode.COMMAND),
        ("halt 1 2 3", ConsoleCode.COMMAND),
        ("limit", ConsoleCode.ARGUMENTS),
        ("limit 321", ConsoleCode.RANGE),
    ],
)
def test_the_first_failure_is_the_one_reported(line: str, code: ConsoleCode) -> None:
    assert refusal(line) == code


def test_an_error_names_the_value_and_what_would_be_right() -> None:
    with pytest.raises(ValueError, match="limit takes transducers 0 to 320, not 400"):
        parse_command("limit 400")
    with pytest.raises(CommandError, match="no command halt; help lists them"):
        parse_command("halt")


# Answers


def test_answers_by_hand() -> None:
    assert format_fields([("state", "READY"), ("accepted", 12)]) == "state: READY\r\naccepted: 12\r\n"
    assert format_fields([]) == ""
    assert format_ok() == "ok\r\n"
    assert format_error(ConsoleCode.RANGE, "too much") == "error 5 too much\r\n"


@pytest.mark.parametrize("text", ["two\r\nlines", "10 µs", "\x1b[31m"])
def test_answers_are_printable(text: str) -> None:
    with pytest.raises(ValueError, match="printable ASCII"):
        format_fields([("key", text)])
    with pytest.raises(ValueError, match="printable ASCII"):
        format_error(ConsoleCode.REFUSED, text)


def test_help_lists_every_command() -> None:
    lines = format_fields(help_fields()).splitlines()
    assert [re.split(r"[ :]", line)[0] for line in lines] == list(COMMANDS)
    assert "watchdog MS: set the watchdog time in ms" in lines
    assert max(map(len, lines)) <= 80


# Typing


class Terminal:
    """What a terminal shows: the current line, changed by backspaces and spaces."""

    def __init__(self) -> None:
        self.lines, self.column = [""], 0

    def show(self, echo: bytes) -> None:
        for character in echo.decode("ascii"):
            if character == "\b":
                self.column -= 1
                assert self.column >= 0
            elif character == "\r":
                self.column = 0
            elif character == "\n":
                self.lines.append("")
            elif character != "\a":
                line = self.lines[-1]
                self.lines[-1] = line[: self.column] + character + line[self.column + 1 :]
                self.column += 1


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n"])
def test_each_end_of_line_ends_one_line(end: bytes) -> None:
    lines, echo = LineEditor().feed(b"info" + end + b"stop" + end + end)
    assert lines == ["info", "stop", ""]
    assert echo == b"info\r\nstop\r\n\r\n"


def test_a_line_feed_then_a_return_are_two_ends() -> None:
    assert LineEditor().feed(b"a\n\rb\r")[0] == ["a", "", "b"]
    assert LineEditor().feed(b"a\rb\n")[0] == ["a", "b"]


def test_backspace_and_cancelling() -> None:
    editor = LineEditor()
    assert editor.feed(b"stap\x7f\x08op") == ([], b"stap" + 2 * b"\b \b" + b"op")
    assert editor.feed(b"\x7f" * 5)[1] == 4 * b"\b \b"
    assert editor.feed(b"halt\x03\r") == ([""], b"halt" + 4 * b"\b \b" + b"\r\n")
    assert editor.feed(b"halt\x15stop\r")[0] == ["stop"]


def test_an_unprintable_character_has_the_line_refused() -> None:
    lines, echo = LineEditor().feed(b"st\x1bop\xff\r")
    assert echo == b"st?op?\r\n"
    assert refusal(lines[0]) == ConsoleCode.CHARACTER


def test_a_line_too_long_rings_and_is_refused_not_cut() -> None:
    editor = LineEditor()
    stop = b"stop".ljust(80)
    assert editor.feed(stop + b"xyz") == ([], stop + b"\a\a\a")
    (line,), _ = editor.feed(b"\r")
    assert refusal(line) == ConsoleCode.LENGTH
    assert editor.feed(stop + b"x\x15") == ([], stop + b"\a" + 80 * b"\b \b")
    (line,), echo = editor.feed(stop + b"x\x7f\r")
    assert parse_command(line) == Command("stop")
    assert echo == stop + b"\a\r\n"


def test_without_echo_nothing_is_sent_back() -> None:
    editor = LineEditor(echo=False)
    assert editor.feed(b"echo 1\r") == (["echo 1"], b"")
    editor.echo = True
    assert editor.feed(b"info\r") == (["info"], b"info\r\n")


TYPED = st.one_of(
    st.binary(max_size=200),
    st.lists(st.sampled_from([b"a", b"x" * 79, b"\x7f", b"\x08", b"\x15", b"\xff", b"\r", b"\n"]), max_size=30).map(
        b"".join
    ),
)


@given(TYPED, st.integers(0, 200))
def test_lines_do_not_depend_on_how_the_bytes_are_cut(typed: bytes, place: int) -> None:
    editor = LineEditor()
    first, second = editor.feed(typed[:place]), editor.feed(typed[place:])
    assert (first[0] + second[0], first[1] + second[1]) == LineEditor().feed(typed)


@given(TYPED)
def test_the_terminal_shows_the_line_that_is_taken(typed: bytes) -> None:
    lines, echo = LineEditor().feed(typed + b"\r")
    terminal = Terminal()
    terminal.show(echo)
    taken = [re.sub(r"[^ -~]", "?", line[:80]) for line in lines]
    assert [line.rstrip() for line in terminal.lines] == [line.rstrip() for line in [*taken, ""]]


def taken_or_refused(line: str) -> bool:
    """Whether a line is a command or nothing; nothing but a `CommandError` with a printable text may stop it."""
    try:
        command = parse_command(line)
    except CommandError as error:
        return format_error(ConsoleCode(error.reason), str(error)) == f"error {error.reason} {error}\r\n"
    return command is None or command.name in COMMANDS


@given(TYPED)
def test_any_bytes_are_commands_or_refused(typed: bytes) -> None:
    lines, _ = LineEditor().feed(typed + b"\r")
    assert all(len(line) <= 81 and taken_or_refused(line) for line in lines)


WORDS = st.lists(st.one_of(st.sampled_from(list(COMMANDS)), st.from_regex(r"[0-9]{1,6}", fullmatch=True), st.text()))


@given(st.one_of(st.text(), WORDS.map(" ".join)))
def test_any_text_is_a_command_or_refused(line: str) -> None:
    assert taken_or_refused(line)


def test_endless_typing_takes_no_memory() -> None:
    editor = LineEditor()
    editor.feed(b"x" * 100_000)
    assert max(len(value) for value in vars(editor).values() if isinstance(value, bytearray)) == 81
