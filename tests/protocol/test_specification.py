"""Tables and examples of SPEC.md that no single module owns, held against the code."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from construct import Construct
from phasewire.protocol import Ack, Block, Kind, Pulses, Reason, State, Update, pack
from phasewire.protocol.blocks import pack_pulses
from phasewire.protocol.codes import AckFlag
from phasewire.protocol.layout import replies
from phasewire.protocol.layout.blocks import BLOCK
from phasewire.protocol.pulses import POWER

from tests.protocol.test_blocks import ACTION, COUNT, FIRST, HOLD, PERIOD, REPEATS, USED
from tests.specification import SPEC, fields, hex_examples, layout_rows, table


@pytest.mark.parametrize("name", ["ACK", "STATUS", "INFO", "CLOCK", "READ_BACK"])
def test_the_layouts_of_answers_are_construct_s(name: str) -> None:
    assert layout_rows(name) == fields(getattr(replies, name))


def test_the_layout_of_a_report_is_construct_s() -> None:
    (reports, _) = replies.PROCESSOR_REPORTS.subcons
    assert layout_rows("PROCESSOR_REPORT") == fields(reports.subcon.subcon)


def test_the_layout_of_a_block_is_construct_s() -> None:
    """By its offsets: the kinds of body share one header, which a block of each kind shows."""
    listed = layout_rows("BLOCK")
    cleared = BLOCK.subcons[1].subcon.subcon
    head = [(0, 2, "magic"), (2, 1, "version"), (3, 1, "kind"), (4, 4, "sequence")]
    assert [(part.sizeof(), part.name) for part in cleared.subcons[:-1]] == [row[1:] for row in head]
    assert listed[: len(head)] == head
    for body in cleared.subcons[-1].subcon.cases.values():
        assert listed[len(head) : -1] == fields(Header(body), offset=8)
    assert listed[-1] == (32, 480, "payload")


class Header:
    """The fields of a body that stand in the header."""

    def __init__(self, body: Construct) -> None:
        names = [part.name for part in body.subcons]
        self.subcons = body.subcons[: names.index("checksum") + 1]


def test_the_table_of_fields_says_what_kinds_use() -> None:
    columns = (PERIOD, FIRST, COUNT, HOLD, REPEATS, ACTION)
    listed = {
        row[0].strip("`"): {column for column, cell in zip(columns, row[1:], strict=False) if cell}
        for row in table("fields")
    }
    assert listed == {kind.name: USED[kind] for kind in Kind}


def test_the_table_of_power_is_the_code_s() -> None:
    text = SPEC.split("<!-- power -->")[1].split("**SAF-007**")[0]
    pairs = [
        (int(width), int(power))
        for widths, powers in re.findall(r"\| width \| (.*) \|\n.*\n\| power \| (.*) \|", text)
        for width, power in zip(widths.split(" | "), powers.split(" | "), strict=True)
    ]
    assert pairs == list(enumerate(POWER))


def _two_pulses() -> Pulses:
    phase, width = np.zeros(320, int), np.zeros(320, int)
    phase[:2], width[:2] = (99, 1), (25, 2)
    return Pulses(phase, width)


EXAMPLES: dict[str, Any] = {
    "PULSES": lambda: pack_pulses(Pulses([99, 1], [25, 2])),
    "UPDATE": lambda: pack(Block(Update(_two_pulses(), 1000), 7, restart=True)),
    "ACK": lambda: Ack(Reason.ACCEPTED, 7, 1000, 20_000, AckFlag(0), 7, State.READY).encode(),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_worked_examples_are_what_the_code_sends(name: str) -> None:
    assert hex_examples()[name] == EXAMPLES[name]()
