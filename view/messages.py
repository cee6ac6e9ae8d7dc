"""What the page and the server say to each other, in bytes.

A message to the page is a u32 with the length of a text, the text, and arrays. The text is JSON in UTF-8, padded with
spaces to a multiple of 8 bytes together with its length; its ``arrays`` says of each array type, shape and place after
the text. Numbers are little-endian. The page answers in JSON, and ``ack`` for each frame that it has taken in.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ACK", "MOST_COMMAND_BYTES", "PageCommand", "encode", "read_command"]

ACK = "ack"
MOST_COMMAND_BYTES = 2**16
WORD, ALIGNED = 4, 8
TYPES = {"u1": "<u1", "u4": "<u4", "f4": "<f4"}
VERBS = ("stop", "go", "fault", "clear-faults")


class PageCommand(NamedTuple):
    """What a page asks for: settings, or something to do."""

    settings: Mapping[str, Any]
    do: str | None = None
    fault: Mapping[str, Any] | None = None


def encode(kind: str, fields: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]] | None = None) -> bytes:
    """A message to the page, whose kind is ``setup``, ``settings``, ``objects``, ``frame`` or ``notice``.

    ``fields`` are written as JSON, and ``arrays`` as uint8, uint32 or float32: other floats and whole numbers are
    converted to the last two.
    """
    table, parts, at = {}, [], 0
    for name, values in (arrays or {}).items():
        short = "u1" if values.dtype == np.uint8 else "f4" if values.dtype.kind == "f" else "u4"
        data = np.ascontiguousarray(values, TYPES[short]).tobytes()
        data += bytes(-len(data) % WORD)
        table[name] = {"type": short, "shape": values.shape, "at": at}
        parts.append(data)
        at += len(data)
    text = json.dumps({"kind": kind, **fields, "arrays": table}, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(WORD + len(text)) % ALIGNED)
    return b"".join((struct.pack("<I", len(text)), text, *parts))


def read_command(text: str) -> PageCommand:
    """What a page asks for.

    `ValueError` if the text is none of the possible commands.
    """
    try:
        said = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"a command must be JSON: {error}") from error
    if isinstance(said, dict):
        if said.keys() == {"set"} and isinstance(said["set"], dict):
            return PageCommand(said["set"])
        if said.get("do") in VERBS and said.keys() <= {"do", "fault"}:
            fault = said.get("fault")
            if (said["do"] == "fault") == isinstance(fault, dict):
                return PageCommand({}, said["do"], fault)
    raise ValueError(f'a command must be {{"set": {{...}}}} or {{"do": …}} with {", ".join(VERBS)}')
