"""The switch of a node: control messages, registers, routes."""

from __future__ import annotations

import pytest
from phasewire.xs1.switch import DIMENSION_DIRECTION, NODE_ID, SLINK, XLINK, LinkField, Switch

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
