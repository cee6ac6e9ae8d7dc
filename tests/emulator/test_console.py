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
from tests.specification import SPEC, table

RESET = Setup(0x41, 13, 0, 0, 0)
RECORDS = {case["name"]: bytes.fromhex(case["hex"]) for case in VECTORS["records"]["vectors"]}


def console_of(controller: ModelController, detach: Callable[[], None] = lambda: None) -> Console:
    return Console(controller, Nowhere(), detach)


def answer(controller: ModelController, line: str) -> str:
    """What a line is answered, without its echo."""
    text, _ = console_of(controller).feed(line.encode() + b"\r")
    return text.decode().removeprefix(line + "\r\n")


def test_the_session_of_the_specification() -> None:
    """Its first prompt answers an empty line, for the device says nothing when it starts."""
    (session,) = re.findall(r"^```console\n(.*?)^```", SPEC, re.MULTILINE | re.DOTALL)
    lines = re.findall(r"^> (.*)$", session, re.MULTILINE)
    assert len(lines) == 9
    console = console_of(ModelController())
    shown = b"".join(console.feed(line.encode() + b"\r").text for line in ["", *lines])
    assert shown.decode() == "\r\n" + session.replace("\n", "\r\n") + "> "


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


@pytest.mark.parametrize(
    ("line", "setup"),
    [
        ("version", Setup(0xC1, 1, 0, 0, 64)),
        ("info", Setup(0xC1, 1, 0, 0, 64)),
        ("status", Setup(0xC1, 2, 0, 0, 64)),
        ("faults", Setup(0xC1, 2, 0, 0, 64)),
        ("clock", Setup(0xC1, 9, 0, 0, 24)),
        ("boards", Setup(0xC1, 11, 0, 0, 160)),
        ("pulses 319", Setup(0xC1, 10, 0, 0, 496)),
        ("identify 4", Setup(0x41, 12, 4, 0, 0)),
        ("enable", Setup(0x41, 4, 0, 0, 0)),
        ("stop", Setup(0x41, 5, 0, 0, 0)),
        ("watchdog 5000", Setup(0x41, 6, 5000, 0, 0)),
        ("limit 0", Setup(0x41, 7, 0, 0, 0)),
        ("clear", Setup(0x41, 8, 0, 0, 0)),
    ],
)
def test_commands_ask_for_what_the_requests_do(line: str, setup: Setup) -> None:
    controller = ModelController()
    assert answer(controller, line).endswith("ok\r\n> ")
    assert controller.asked == [setup]


def test_every_command_is_carried_out() -> None:
    for command, argument, *_ in table("commands"):
        line = command.strip("`") + (" 10" if argument.startswith("ms") else " 0" if argument else "")
        controller = ModelController()
        controller.state = State.READY if line.startswith("test") else State.OFF
        assert answer(controller, line).endswith("ok\r\n> "), line


def test_what_stalls_is_refused_and_says_why() -> None:
    controller = ModelController()
    controller.state = State.READY
    assert answer(controller, "limit 10") == "error 6 a limit is set while the outputs are off\r\n> "


def test_a_test_is_refused_while_the_queue_has_no_room() -> None:
    controller = ModelController(room=0)
    controller.state = State.READY
    assert answer(controller, "test 0") == "error 6 the queue has no room\r\n> "
    assert controller.tested is None


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


def test_a_line_is_answered_before_what_is_typed_behind_it_is_sent_back() -> None:
    text = console_of(ModelController()).feed(b"stop\recho 0\rfaults\r").text
    assert text == b"stop\r\nok\r\n> echo 0\r\nok\r\n> faults: none\r\nok\r\n> "


def test_echo_comes_back() -> None:
    text = console_of(ModelController()).feed(b"echo 0\rstop\recho 1\rstop").text
    assert text == b"echo 0\r\nok\r\n> ok\r\n> ok\r\n> stop"


def test_a_new_line_forgets_what_was_typed_and_keeps_the_echo_off() -> None:
    console = console_of(ModelController())
    console.feed(b"echo 0\rst")
    assert console.begin_line() == b"> "
    assert console.feed(b"op\r").text == b"error 3 no command op; help lists them\r\n> "


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
