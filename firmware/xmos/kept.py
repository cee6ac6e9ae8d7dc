"""Assembly that clang has made of C, kept in a folder, so that nothing but a change of the C needs a compiler.

Each file states a digest of what it was made from, by which one is found that is out of date.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import NamedTuple

from ...base.storage import read_file, read_text
from ..xs1.assembler import AssemblySource
from ..xs1.clang import CompilerMissingError, compile_c, find_clang

__all__ = ["KeptAssembly"]

_MOST_BYTES = 1 << 24
_INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([\w./]+)[>"]', re.MULTILINE)
_DIGEST = re.compile(r"^# sha256 of it and what it includes: ([0-9a-f]{64})$", re.MULTILINE)
_LEFT_OUT = (".file", "#APP", "#NO_")  # beginnings of lines of clang's that say nothing


class KeptAssembly(NamedTuple):
    """A file of C, and where its assembly is kept.

    Parameters
    ----------
    source : Path
    folder : Path
        Folder of the assembly.
    includes : tuple of Path
        Folders in which clang looks for what the source includes, besides its own.
    options : tuple of str
        Options of clang besides those of `compile_c`.
    """

    source: Path
    folder: Path
    includes: tuple[Path, ...] = ()
    options: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """The file of the assembly."""
        return self.folder / f"{self.source.stem}.s"

    @property
    def stale(self) -> bool:
        """Whether the assembly was made from something else, or is missing."""
        if not self.path.exists():
            return True
        found = _DIGEST.search(read_text(self.path, _MOST_BYTES))
        return found is None or found[1] != self.digest()

    def digest(self) -> str:
        """SHA-256 of the options, and of the source and all that it includes but for the compiler's own headers."""
        seen: dict[Path, bytes] = {}
        waiting = [self.source]
        while waiting:
            path = waiting.pop()
            if path not in seen:
                seen[path] = read_file(path, _MOST_BYTES)
                for name in _INCLUDE.findall(seen[path].decode("utf-8")):
                    folders = (path.parent, *self.includes)
                    waiting += [folder / name for folder in folders if (folder / name).exists()][:1]
        whole = hashlib.sha256("\0".join(self.options).encode())
        for path in sorted(seen, key=lambda path: path.name):
            whole.update(path.name.encode() + b"\0" + seen[path])
        return whole.hexdigest()

    def read(self) -> AssemblySource:
        """The assembly as it is kept; raises `OSError` if it is not."""
        return AssemblySource.read(self.path)

    def compiled(self) -> AssemblySource:
        """The assembly made anew.

        Raises
        ------
        CompilerMissingError
            If no clang with the target xcore is installed.
        InputFileError
            If clang refuses the source.
        """
        if find_clang() is None:
            raise CompilerMissingError(
                f"assembly of {self.source} cannot be made, because no clang with the target xcore is installed; "
                "install clang (11 or newer), or take back the change of the C"
            )
        made = compile_c(self.source, options=(*self.options, *(f"-I{folder}" for folder in self.includes)))
        lines = [line.rstrip() for line in made.text.splitlines() if not line.strip().startswith(_LEFT_OUT)]
        name = self.source.name
        head = f"# Made by clang from {name}; do not edit.\n# sha256 of it and what it includes: {self.digest()}\n"
        return AssemblySource(self.path.name, head + "\n".join(lines) + "\n")

    def keep(self) -> None:
        """Make the assembly anew and write its file; raises as `compiled`."""
        made = self.compiled()
        self.folder.mkdir(exist_ok=True)
        self.path.write_text(made.text, encoding="utf-8")
