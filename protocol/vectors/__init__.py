"""Golden vectors: bytes and what they mean, for whoever builds firmware or a host from SPEC.md.

`vectors` makes them and `text` writes them down as JSON, one case a line; vectors.json beside SPEC.md is that text.
Each module here is for one part of the specification. The tests judge every case by other means than the code that made
it.
"""

from __future__ import annotations

import json
from typing import Any

from ..codes import PROTOCOL_VERSION
from . import blocks, chain, firmware, replies, serial, usb

__all__ = ["text", "vectors"]

HOW_TO_READ = (
    "Cases for the phasewire protocol, by the parts of its specification, SPEC.md. Each part says in 'about' what its",
    "cases have in common; each case has a name that no other has, and says in 'shows' what it is for. Rows of tables",
    "have neither.",
    "All bytes are hexadecimal, without spaces, in the order in which they travel. Numbers are whole and go up to",
    "2^64 - 1: use a reader of JSON that keeps 64 bits. Codes appear by the names of SPEC.md, sets of flags as lists",
    "of names. Pulses are runs [phase, width, how many in a row], in array order or in the order of a port's bits.",
    "An encoder must make 'hex' of the fields, and a decoder the fields of 'hex'. What stands in a part whose name",
    "begins with 'refused' must be refused, for the reason given; it breaks the clause of SPEC.md in 'clause'.",
    "This file is generated (make vectors) and versioned with the protocol.",
)

SECTIONS = {
    "pulse_pairs": blocks.pulse_pairs,
    "modulated_widths": blocks.modulated_widths,
    "powers": blocks.powers,
    "blocks": blocks.blocks,
    "refused_blocks": blocks.refused_blocks,
    "block_numbers": blocks.block_numbers,
    "records": replies.records,
    "refused_records": replies.refused_records,
    "packets": replies.packets,
    "refused_packets": replies.refused_packets,
    "device_transitions": replies.transitions,
    "requests": usb.requests,
    "refused_requests": usb.refused_requests,
    "answers": replies.answers,
    "refused_answers": replies.refused_answers,
    "descriptors": usb.descriptors,
    "chain_messages": chain.chain_messages,
    "refused_chain_messages": chain.refused_chain_messages,
    "slices_and_commits": chain.slices_and_commits,
    "frames": serial.frames,
    "refused_frames": serial.refused_frames,
    "streams": serial.streams,
    "typing": serial.typing,
    "commands": serial.commands,
    "exchanges": serial.exchanges,
    "test_keys": firmware.test_keys,
    "images": firmware.images,
    "refused_images": firmware.refused_images,
    "signatures": firmware.signatures,
    "boot_records": firmware.boot_records,
    "boot_orders": firmware.boot_orders,
    "dfu_replies": firmware.dfu_replies,
    "dfu_blocks": firmware.dfu_blocks,
    "dfu_transitions": firmware.dfu_transitions,
}


def vectors() -> dict[str, Any]:
    """All golden vectors, as JSON can hold them: always the same."""
    head = {"format": "phasewire-vectors-1", "protocol_version": PROTOCOL_VERSION, "how_to_read": list(HOW_TO_READ)}
    return head | {name: make() for name, make in SECTIONS.items()}


def text() -> str:
    """The vectors as the text of vectors.json: JSON with one case on each line."""

    def line(value: Any) -> str:
        return json.dumps(value, allow_nan=False)

    def listed(values: list[Any], indent: str) -> str:
        return "[\n" + ",\n".join(f"{indent} {line(value)}" for value in values) + f"\n{indent}]"

    parts = []
    for name, value in vectors().items():
        match value:
            case {"about": about, "vectors": cases}:
                written = f'{{\n  "about": {line(about)},\n  "vectors": {listed(cases, "  ")}\n }}'
            case list():
                written = listed(value, " ")
            case _:
                written = line(value)
        parts.append(f" {line(name)}: {written}")
    return "{\n" + ",\n".join(parts) + "\n}\n"
