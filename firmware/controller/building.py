"""Compile the C of the kernels into ``generated/``, which is committed, so that nothing else needs a compiler.

``python -m phasewire.firmware.controller.building`` does it. Each file begins with a digest of the C that it is of, by
which a test finds one that is out of date.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
from pathlib import Path
from typing import NamedTuple

from ...xs1.clang import find_clang

__all__ = ["SOURCES", "compiled", "digest", "stated_digest"]

FOLDER = Path(__file__).parent
GENERATED = FOLDER / "generated"
REFERENCE = FOLDER.parents[1] / "reference" / "core"

OPTIONS = ("--target=xcore", "-std=c11", "-O2", "-ffreestanding", "-fno-strict-aliasing", "-S")
_PATIENCE_S = 60
_INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([\w./]+)[>"]', re.MULTILINE)


class CSource(NamedTuple):
    """A file that is compiled."""

    path: Path

    @property
    def output(self) -> Path:
        """Where its assembly is kept."""
        return GENERATED / f"{self.path.stem}.s"


SOURCES = (
    *(CSource(FOLDER / f"{name}.c") for name in ("judge", "plan", "prepare")),
    *(
        CSource(REFERENCE / f"{name}.c")
        for name in ("ack", "blk", "blk_plan", "blk_stores", "chn", "num", "pul", "sta", "sums")
    ),
)
"""All that is compiled: what is written here, and the reference device's functions as they are."""


def digest(source: CSource) -> str:
    """SHA-256 of a file and of all that it includes, but for the compiler's own headers."""
    seen: dict[Path, bytes] = {}
    waiting = [source.path]
    while waiting:
        path = waiting.pop()
        if path not in seen:
            seen[path] = path.read_bytes()
            for name in _INCLUDE.findall(seen[path].decode()):
                found = (folder / name for folder in (path.parent, FOLDER, REFERENCE) if (folder / name).exists())
                waiting.extend(list(found)[:1])
    whole = hashlib.sha256()
    for path in sorted(seen, key=lambda path: path.name):
        whole.update(path.name.encode() + b"\0" + seen[path])
    return whole.hexdigest()


def stated_digest(source: CSource) -> str:
    """The digest that the committed assembly states."""
    return source.output.read_text().splitlines()[0].rpartition(" ")[2]


def compiled(source: CSource) -> str:
    """The assembly of a file, with its digest.

    Raises
    ------
    RuntimeError
        If no clang has a target for the XS1.
    """
    clang = find_clang()
    if clang is None:
        raise RuntimeError("no clang with the target xcore is installed; any from 11 on that lists it will do")
    command = [clang, *OPTIONS, f"-I{FOLDER}", f"-I{REFERENCE}", str(source.path), "-o", "-"]
    text = subprocess.run(command, capture_output=True, text=True, check=True, timeout=_PATIENCE_S).stdout
    name = source.path.relative_to(FOLDER.parents[1]).as_posix()
    return f"# compiled of {name}, sha256 {digest(source)}\n{text}"


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    for each in SOURCES:
        each.output.write_text(compiled(each))
