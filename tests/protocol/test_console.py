from __future__ import annotations

import re

import pytest
from phasewire.base.errors import CommandError
from phasewire.protocol.codes import ConsoleCode, Reason, Request
from phasewire.protocol.console import (
    COMMANDS,
    PROMPT,
    TEST_WIDTH_TICKS,
    LineEditor,
    format_error,
    format_fields,
    format_ok,
    help_fields,
    parse_command,
)

from tests.specification import SPEC, table

# The specification


def test_the_table_of_commands() -> None:
    said = [tuple(cell.strip("`") for cell in row) for row in table("commands")]
    known = [
        (name, str(form.argument or ""), form.request.name if form.request else "", form.meaning)
        for name, form in COMMANDS.items()
    ]
    assert said == known


def test_every_request_for_people_is_a_command() -> None:
    """WIRING is for programs: 320 numbers. REVERT is for programs that also check its result."""
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


def test_the_session_is_that_of_a_device() -> None:
    """With a model of a device that knows whether it is enabled, and the requests of this session."""
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


def test_endless_typing_takes_no_memory() -> None:
    editor = LineEditor()
    editor.feed(b"x" * 100_000)
    assert max(len(value) for value in vars(editor).values() if isinstance(value, bytearray)) == 81
