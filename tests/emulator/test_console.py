from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.interfaces.console import Console
from phasewire.protocol.codes import State
from phasewire.protocol.requests import Setup

from tests.emulator.model_controller import ANSWERS, VECTORS, ModelController, Nowhere
from tests.from_spec import parse_command, read_status, typed
from tests.specification import table

RESET = Setup(0x41, 13, 0, 0, 0)
RECORDS = {case["name"]: bytes.fromhex(case["hex"]) for case in VECTORS["records"]["vectors"]}


def console_of(controller: ModelController, detach: Callable[[], None] = lambda: None) -> Console:
    return Console(controller, Nowhere(), detach)


def answer(controller: ModelController, line: str) -> str:
    """What a line is answered, without its echo."""
    text, _ = console_of(controller).feed(line.encode() + b"\r")
    return text.decode().removeprefix(line + "\r\n")


@pytest.mark.parametrize("exchange", VECTORS["exchanges"]["vectors"], ids=lambda exchange: str(exchange["name"]))
def test_the_exchanges_of_the_vectors(exchange: dict[str, str]) -> None:
    controller = ModelController()
    controller.tested = 17
    if (of := exchange.get("of")) in RECORDS:
        controller.status = read_status(RECORDS[of])
        controller.state = State(controller.status["state"])
    elif of in ANSWERS:
        controller.processors = ANSWERS[of]
    assert answer(controller, exchange["line"]) == exchange["answer"]


@pytest.mark.parametrize("state", State)
def test_dfu_is_refused_where_the_state_has_no_way_to_it(state: State) -> None:
    """A row of the table in STA-003 for DETACH names the states that have one."""
    (leaving,) = [row[0] for row in table("table: transitions") if row[1] == "`DETACH`"]
    controller = ModelController()
    controller.state = state
    done = []
    text, then = console_of(controller, lambda: done.append("dfu")).feed(b"dfu\r")
    assert not done
    if f"`{state.name}`" not in leaving:
        assert text == f"dfu\r\nerror 6 DFU mode is not entered from the state {state.name}\r\n> ".encode()
        assert then is None
    else:
        assert text == b"dfu\r\nok\r\n> "
        assert then
        then()
        assert done == ["dfu"]


def test_reset_is_answered_first_and_nothing_is_read_behind_it() -> None:
    controller = ModelController()
    text, then = console_of(controller).feed(b"reset\renable\r")
    assert text == b"reset\r\nok\r\n> "
    assert not controller.asked
    assert then
    then()
    assert controller.asked == [RESET]


@pytest.mark.parametrize(
    ("line", "arrivals"),
    [
        ("", 0),
        ("   ", 0),
        ("halt", 0),
        ("limit 400", 0),
        ("st\x7ftatus \t", 0),
        ("help", 1),
        ("limit 4", 1),
        ("test 0", 1),
    ],
)
def test_only_commands_prove_that_somebody_is_there(line: str, arrivals: int) -> None:
    """FWU-020: noise on a line that nobody uses must not confirm new firmware."""
    controller = ModelController()
    answer(controller, line)
    assert controller.arrivals == arrivals


@given(st.binary(), st.lists(st.sampled_from(["status\r", "help\n", "test 3\r\n", "x" * 82, "limit 400\r"])))
def test_each_line_is_answered_once(noise: bytes, lines: list[str]) -> None:
    """By the oracle of the specification, which knows the lines, their echo and the code for each that is refused."""
    keys = noise + "".join(lines).encode()
    text, _ = console_of(ModelController()).feed(keys)
    shown, (ends, echo) = text.decode("ascii"), typed(keys)
    codes = [code for code in map(parse_command, ends) if isinstance(code, int)]
    assert shown.count("> ") - echo.count(b"> ") == len(ends)
    assert [int(code) for code in re.findall(r"(?m)^error (\d) (?!DISABLED)", shown)] == codes
