"""Tables and examples of SPEC.md that belong to no single module, against the code."""

from __future__ import annotations

import pytest
from construct import Construct
from phasewire.protocol.codes import ChannelEnd, Kind
from phasewire.protocol.layout import chain, firmware, replies, serial, usb
from phasewire.protocol.layout.blocks import BLOCK

from tests.from_spec import used_fields
from tests.specification import fields, layout_rows, table

LAYOUTS: dict[str, Construct] = {
    **{name: getattr(replies, name) for name in ("ACK", "STATUS", "INFO", "CLOCK", "READ_BACK")},
    "PROCESSOR_REPORT": replies.PROCESSOR_REPORTS.subcons[0].subcon.subcon,
    **{end.name: getattr(chain, end.name) for end in ChannelEnd},
    **{name: getattr(serial, name) for name in ("SERIAL_REQUEST", "SERIAL_REPLY")},
    "LINE_CODING": usb.LINE_CODING,
    **{name: getattr(firmware, name) for name in ("SEGMENT_ENTRY", "DFU_SUFFIX", "BOOT_RECORD", "DFU_STATUS")},
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_printed_layouts_are_construct_s(name: str) -> None:
    assert layout_rows(name) == fields(LAYOUTS[name])


def test_the_layout_of_an_image_s_header_is_construct_s() -> None:
    assert layout_rows("IMAGE_HEADER") == [*fields(firmware.IMAGE_HEADER), (28, 4, "checksum")]


def test_the_layout_of_a_block_is_construct_s() -> None:
    """By offsets: all kinds of body share one header, as a block of each kind shows."""
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
    columns = ("period", "first", "count", "hold", "repeats", "action")
    for name, *cells in table("fields"):
        used = {column for column, cell in zip(columns, cells, strict=False) if cell}
        assert used == set(used_fields(Kind[name.strip("`")], 1))
