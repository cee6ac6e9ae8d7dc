from __future__ import annotations

from collections.abc import Callable

import pytest
from phasewire.emulator.interfaces.console import Console
from phasewire.protocol.codes import State

from tests.emulator.model_controller import ANSWERS, VECTORS, ModelController, Nowhere
from tests.from_spec import read_status
from tests.specification import table

RECORDS = {case["name"]: bytes.fromhex(case["hex"]) for case in VECTORS["records"]["vectors"]}


def console_of(controller: ModelController, detach: Callable[[], None] = lambda: None) -> Console:
    return Console(controller, Nowhere(), detach)


def answer(controller: ModelController, line: str) -> str:
    """The answer to a line, without its echo."""
    text, *_ = console_of(controller).feed(line.encode() + b"\r")
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
def test_dfu_is_refused_in_states_that_do_not_allow_it(state: State) -> None:
    """A row of the table in STA-003 for DETACH names the states that have one."""
    (leaving,) = [row[0] for row in table("table: transitions") if row[1] == "`DETACH`"]
    controller = ModelController()
    controller.state = state
    done = []
    text, then, _ = console_of(controller, lambda: done.append("dfu")).feed(b"dfu\r")
    assert not done
    if f"`{state.name}`" not in leaving:
        assert text == f"dfu\r\nerror 6 DFU mode is not entered from the state {state.name}\r\n> ".encode()
        assert then is None
    else:
        assert text == b"dfu\r\nok\r\n> "
        assert then
        then()
        assert done == ["dfu"]
