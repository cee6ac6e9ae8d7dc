"""Reads SPEC.md, so that tests can compare the code with it: clauses, tables and worked examples."""

from __future__ import annotations

import re
from pathlib import Path

from construct import Construct, RawCopy, Renamed, SizeofError

__all__ = ["SPEC", "clauses", "codes", "fields", "hex_examples", "layout_rows", "table"]

SPEC = (Path(__file__).parents[1] / "protocol" / "SPEC.md").read_text(encoding="utf-8")


def clauses() -> list[str]:
    """Identifiers of all clauses, in the order of the text."""
    return re.findall(r"^\*\*([A-Z]{3}-\d{3})\*\*", SPEC, re.MULTILINE)


def table(mark: str) -> list[list[str]]:
    """The cells of the table that follows ``<!-- mark -->``, without its head."""
    after = SPEC.split(f"<!-- {mark} -->\n", 1)[1].lstrip("\n")
    lines = after.split("\n\n", 1)[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]


def codes(name: str) -> dict[str, int]:
    """A table of codes, value | `name` | …, as name to value."""
    return {row[1].strip("`"): int(row[0], 0) for row in table(f"table: {name}")}


def layout_rows(name: str) -> list[tuple[int, int, str]]:
    """A table of a layout, offset | bytes | field | …, as (offset, size, field)."""
    return [(int(row[0]), int(row[1]), row[2].strip("`")) for row in table(f"layout: {name}")]


def fields(layout: Construct, offset: int = 0) -> list[tuple[int, int, str]]:
    """The same of a construct layout: its fields of a fixed size, down into those that carry a checksum."""
    found: list[tuple[int, int, str]] = []
    for part in layout.subcons:
        if isinstance(part, Renamed) and isinstance(part.subcon, RawCopy):
            found += fields(part.subcon.subcon, offset)
        elif part.name is not None:
            try:
                found.append((offset, part.sizeof(), part.name))
            except SizeofError:
                break
        else:
            continue
        offset = found[-1][0] + found[-1][1]
    return found


def hex_examples() -> dict[str, bytes]:
    """The worked examples: fenced blocks of the kind ``hex NAME``; `#` begins a comment, ``00 × N`` is N zeros."""
    found = {}
    for name, body in re.findall(r"^```hex (\S+)\n(.*?)^```", SPEC, re.MULTILINE | re.DOTALL):
        octets = bytearray()
        for line in body.splitlines():
            text = line.split("#")[0]
            if (zeros := re.fullmatch(r"\s*00 × (\d+)\s*", text)) is not None:
                octets += bytes(int(zeros[1]))
            else:
                octets += bytes.fromhex(text)
        found[name] = bytes(octets)
    return found
