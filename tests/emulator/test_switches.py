"""Every route of a message by chapter CHN, at every stage of numbering."""

from __future__ import annotations

import pytest
from phasewire.emulator.boards.switches import Destination, Direction, destination, route
from phasewire.protocol.chain import Number

UNNUMBERED = 0xFFFF
CONTROLLER = 0x00FF


def stage(numbered: int) -> list[int]:
    """The nodes of the chain when so many processors have their numbers."""
    return [*range(numbered), *[UNNUMBERED] * (10 - numbered)]


def walk(nodes: list[int], start: int, node: int) -> int | None:
    """The place at which a message ends, -1 for the controller; None if it leaves the chain."""
    place, came = start, start
    for _ in range(12):
        own = CONTROLLER if place == -1 else nodes[place]
        direction = route(own, node)
        if direction is Direction.HERE:
            return place
        came, place = place, place + (1 if direction is Direction.DOWN else -1)
        if place not in range(-1, 10) or (came != start and place == came):
            return None
    return None


@pytest.mark.parametrize("numbered", range(11))
def test_a_message_reaches_every_processor_that_has_its_number(numbered: int) -> None:
    nodes = stage(numbered)
    for processor in range(numbered):
        assert walk(nodes, -1, processor) == processor
        assert destination(nodes, processor) == Destination(processor, reached=True)


@pytest.mark.parametrize("numbered", range(10))
def test_a_number_reaches_the_first_processor_without_one(numbered: int) -> None:
    nodes = stage(numbered)
    assert walk(nodes, -1, Number(numbered).node) == numbered
    assert destination(nodes, Number(numbered).node) == Destination(numbered, reached=True)


@pytest.mark.parametrize("numbered", range(11))
def test_an_answer_reaches_the_controller_from_every_processor(numbered: int) -> None:
    """From those without a number too: they send everything up."""
    for processor in range(10):
        assert walk(stage(numbered), processor, CONTROLLER) == -1


def test_an_unassigned_number_turns_back_at_the_first_processor_without_one() -> None:
    assert destination(stage(3), 7) == Destination(3, reached=False)


@pytest.mark.parametrize("bit", range(4, 8))
def test_bits_7_to_4_lead_up(bit: int) -> None:
    assert route(5, 5 | 1 << bit) is Direction.UP
    assert destination(stage(10), 5 | 1 << bit) == Destination(0, reached=False)


@pytest.mark.parametrize("bit", range(8, 16))
def test_bits_15_to_8_lead_down(bit: int) -> None:
    assert route(5, 5 | 1 << bit | 0xFF) is Direction.DOWN


@pytest.mark.parametrize(
    ("own", "node", "direction"),
    [
        (0b0101, 0b0111, Direction.DOWN),  # bit 1 of 5 is 0
        (0b0101, 0b0001, Direction.UP),  # bit 2 of 5 is 1
        (0b0111, 0b1000, Direction.DOWN),  # bit 3 of 7 is 0, whatever the lower ones are
        (0b1000, 0b0111, Direction.UP),
        (0b0101, 0b0101, Direction.HERE),
        (UNNUMBERED, UNNUMBERED, Direction.HERE),
        (UNNUMBERED, 9, Direction.UP),
        (CONTROLLER, 0, Direction.DOWN),
        (CONTROLLER, CONTROLLER, Direction.HERE),
    ],
)
def test_the_highest_bit_that_differs_decides(own: int, node: int, direction: Direction) -> None:
    assert route(own, node) is direction


def test_a_chain_has_processors() -> None:
    with pytest.raises(ValueError, match="without processors"):
        destination([], 0)
