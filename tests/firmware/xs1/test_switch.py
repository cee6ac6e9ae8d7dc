"""The switch of a node: control messages, registers, routes."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.firmware.xs1.core import Core, Sent
from phasewire.firmware.xs1.switch import (
    ANSWER_CYCLES,
    DIMENSION_DIRECTION,
    NODE_ID,
    SLINK,
    SWITCH_CONFIGURATION,
    XLINK,
    LinkField,
    Switch,
    serve,
)

from tests.firmware.xs1.cores import core

CONTROL = 0x100
READC, WRITEC, ACK, NACK, END = (CONTROL | token for token in (0xC1, 0xC0, 0x03, 0x04, 0x01))
DOWN = 1


def read(register: int) -> list[int]:
    """A question whose answer goes to channel end 5 of node 0x1234."""
    return [READC, 0x12, 0x34, 0x05, *register.to_bytes(2, "big"), END]


def written(register: int, value: int) -> list[int]:
    return [WRITEC, 0x12, 0x34, 0x05, *register.to_bytes(2, "big"), *value.to_bytes(4, "big"), END]


def test_a_register_is_written_and_read() -> None:
    switch = Switch()
    reply = switch.answer(written(DIMENSION_DIRECTION, 0x89ABCDEF))
    assert reply is not None
    assert (reply.destination, reply.tokens.tolist()) == (0x12340502, [ACK, END])
    answer = switch.answer(read(DIMENSION_DIRECTION))
    assert answer is not None
    assert (answer.destination, answer.tokens.tolist()) == (0x12340502, [ACK, 0x89, 0xAB, 0xCD, 0xEF, END])


def test_its_node_changes_before_it_answers() -> None:
    switch = Switch(0xFFFF)
    assert switch.answer(written(NODE_ID, 7)) is not None
    assert switch.node == 7


@pytest.mark.parametrize("register", [0x09, 0x0B, 0x0E, 0x30, 0x88, 0xFFFF])
def test_a_register_that_does_not_exist_is_refused(register: int) -> None:
    for message in (read(register), written(register, 1)):
        reply = Switch().answer(message)
        assert reply is not None
        assert reply.tokens.tolist() == [NACK, END]


def test_a_register_that_is_read_only_is_refused() -> None:
    reply = Switch().answer(written(0, 1))
    assert reply is not None
    assert reply.tokens.tolist() == [NACK, END]


@pytest.mark.parametrize(
    "tokens",
    [[], [END], read(5)[1:], read(5)[:-2], [*read(5)[:-1], 0, END], written(5, 1)[:-2], [0xC1, *read(5)[1:]],
     [*read(5)[:3], CONTROL | 2, *read(5)[4:]], [CONTROL | 0xC2, *read(5)[1:]]],
)  # fmt: skip
def test_a_malformed_message_has_no_answer(tokens: list[int]) -> None:
    assert Switch().answer(tokens) is None


@pytest.mark.parametrize("answers", [False, True])
def test_hello_asks_for_credit(answers: bool) -> None:
    said = []

    def hello(link: int) -> bool:
        said.append(link)
        return answers

    switch = Switch(hello=hello)
    switch.write(XLINK + 2, LinkField.HELLO)
    assert not said, "the link is not enabled"
    switch.write(XLINK + 2, LinkField.ENABLE | LinkField.HELLO | LinkField.WIDE | 5)
    assert said == [2]
    assert switch.has_credit(2) == answers
    expected = LinkField.ENABLE | LinkField.WIDE | 5 | (LinkField.TX_CREDIT if answers else 0)
    assert switch.registers[XLINK + 2] == expected, "HELLO reads as 0"
    switch.give_credit(2)
    assert switch.has_credit(2)
    switch.write(XLINK + 2, 0)
    assert not switch.has_credit(2)
    switch.give_credit(2)
    assert not switch.has_credit(2)


def test_the_highest_bit_that_differs_names_the_direction() -> None:
    switch = Switch(0b0110)
    for link, direction in ((0, 0), (3, DOWN)):
        switch.write(XLINK + link, LinkField.ENABLE)
        switch.write(SLINK + link, direction << 8)
    switch.write(DIMENSION_DIRECTION, 0x0000_1001)
    switch.write(DIMENSION_DIRECTION + 1, 0x1000_0000)
    assert switch.route(0b0110) is None
    assert [switch.route(0b0110 ^ 1 << bit) for bit in range(16)] == [3, 0, 0, 3, *11 * [0], 3]
    assert switch.route(0b0110 ^ 0b1010) == 3
    assert switch.route(0b0110 ^ 0b0111) == 0
    switch.write(XLINK + 3, 0)
    with pytest.raises(ValueError, match="direction 1, which no enabled link has"):
        switch.route(0b0111)


def test_wrong_numbers_are_refused() -> None:
    with pytest.raises(ValueError, match="0 to 65535"):
        Switch(65536)
    with pytest.raises(ValueError, match="links 0 to 7"):
        Switch().has_credit(8)


def asked(tokens: list[int], node: int, ends: int) -> Sent:
    """A control message that has left a core."""
    return Sent(5, node << 16 | SWITCH_CONFIGURATION, np.array(tokens, np.uint16), ends - 50, ends)


def listening() -> Core:
    """A core that takes the six tokens of an answer at channel end 0, one after the other."""
    inputs = "chkct res[r0], 3; in r1, res[r0]; chkct res[r0], 1"
    return core(f"getr r0, 2; {inputs}; getr r2, 1; in r3, res[r2]; waiteu", node=0x1234)


@pytest.mark.parametrize(("executed", "ends"), [(100, 100), (100, 90), (10_000, 100)])
def test_a_core_is_answered_after_a_time_or_as_soon_as_it_can_be(executed: int, ends: int) -> None:
    made, switch = listening(), Switch(0x1234)
    made.run(executed)
    question = [READC, 0x12, 0x34, 0x00, 0, NODE_ID, END]
    assert serve(made, switch, asked(question, 0x1234, ends))
    at = max(ends + ANSWER_CYCLES, executed + 1)
    made.run(at - 1)
    assert made.threads()[0].waits_for == "a token"
    made.run(at + 100)
    assert made.registers(0)[1] == 0x1234
    assert made.trap is None


def test_an_answer_is_not_before_tokens_that_wait() -> None:
    made, switch = listening(), Switch(0x1234)
    made.deliver(0, [ACK, 0, 0, 0, 1, END], np.full(6, 5000))
    assert serve(made, switch, asked([READC, 0x12, 0x34, 0x00, 0, NODE_ID, END], 0x1234, 100))
    assert made.earliest_delivery(0) == 5000
    made.run(6000)
    assert made.registers(0)[1] == 1


def test_a_write_of_the_node_is_answered_to_the_new_one() -> None:
    made, switch = listening(), Switch(0x1234)
    body = [0, NODE_ID, 0, 0, 0, 7, END]
    assert not serve(made, switch, asked([WRITEC, 0x12, 0x34, 0x00, *body], 0x1234, 100))
    assert made.node == switch.node == 7
    assert serve(made, switch, asked([WRITEC, 0x00, 0x07, 0x00, *body], 7, 100))


@pytest.mark.parametrize(
    "question",
    [
        [READC, 0x12, 0x34, 200, 0, NODE_ID, END],
        [READC, 0x12, 0x34, 32, 0, NODE_ID, END],
        [READC, 0x12, 0x35, 0, 0, NODE_ID, END],
        [READC, 0x12, 0x34, 0, END],
    ],
    ids=["channel end 200", "channel end 32", "another node", "malformed"],
)
def test_an_answer_for_nobody_is_dropped(question: list[int]) -> None:
    made, switch = listening(), Switch(0x1234)
    assert not serve(made, switch, asked(question, 0x1234, 100))
    made.run(10_000)
    assert made.trap is None
    assert made.threads()[0].waits_for == "a token"
    assert [made.earliest_delivery(end) for end in range(32)] == 32 * [10_001]
