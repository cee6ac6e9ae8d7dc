from __future__ import annotations

import re

import pytest
from phasewire.base.errors import CommandError
from phasewire.protocol.codes import ConsoleCode, Request
from phasewire.protocol.console import (
    COMMANDS,
    TEST_WIDTH_TICKS,
    LineEditor,
    format_error,
    format_fields,
    format_ok,
    parse_command,
)

from tests.specification import SPEC

# The specification


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


# Commands


def test_an_error_names_the_value_and_what_would_be_right() -> None:
    with pytest.raises(ValueError, match="limit takes transducers 0 to 320, not 400"):
        parse_command("limit 400")
    with pytest.raises(CommandError, match="no command halt; help lists them"):
        parse_command("halt")


# Answers


@pytest.mark.parametrize("text", ["two\r\nlines", "10 µs", "\x1b[31m"])
def test_answers_are_printable(text: str) -> None:
    with pytest.raises(ValueError, match="printable ASCII"):
        format_fields([("key", text)])
    with pytest.raises(ValueError, match="printable ASCII"):
        format_error(ConsoleCode.REFUSED, text)


# Typing


def test_endless_typing_takes_no_memory() -> None:
    editor = LineEditor()
    editor.feed(b"x" * 100_000)
    assert max(len(value) for value in vars(editor).values() if isinstance(value, bytearray)) == 81
