"""The worked examples of SPEC.md, byte for byte, so that answers are compared with the text itself.

This module does not know the meaning of the bytes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from types import MappingProxyType

from .... import protocol

_EXAMPLE = re.compile(r"^```hex (\S+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_ZEROS = re.compile(r"00 × (\d+)")


def example(name: str) -> bytes:
    """The bytes of the example of this name, such as ``USB_BOS``; ValueError if there is none."""
    known = _examples()
    if name not in known:
        raise ValueError(f"SPEC.md has no example {name!r}; it has {', '.join(known)}")
    return known[name]


@cache
def _examples() -> Mapping[str, bytes]:
    text = files(protocol).joinpath("SPEC.md").read_text(encoding="utf-8")
    return MappingProxyType({name: _bytes(body) for name, body in _EXAMPLE.findall(text)})


def _bytes(body: str) -> bytes:
    """The text before the comments, in hexadecimal; ``00 × N`` are N zeros."""
    said = [line.partition("#")[0].strip() for line in body.splitlines()]
    runs = [_ZEROS.fullmatch(line) for line in said]
    return b"".join(bytes(int(run[1])) if run else bytes.fromhex(line) for line, run in zip(said, runs, strict=True))
