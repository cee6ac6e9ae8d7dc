"""Writing files so that nothing is lost: whole or not at all, and only where that was meant."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["check_outputs", "replacing"]


def check_outputs(outputs: Iterable[Path | str | None], inputs: Iterable[Path] = ()) -> None:
    """Check before any work that its results can be written and will overwrite nothing that it needs.

    Parameters
    ----------
    outputs : iterable of path, str or None
        Files to be written; None and ``-`` stand for no file.
    inputs : iterable of path
        Files that are read.

    Raises
    ------
    ValueError
        Where an output is an input, or stands twice.
    OSError
        Where it is a folder, or its folder does not exist or cannot be written.
    """
    taken = {path.resolve(): "is also what is read" for path in inputs}
    for output in outputs:
        if output is None or output == "-":
            continue
        path = Path(output)
        if path.is_dir():
            raise IsADirectoryError(f"{str(output)!r} cannot be written: it is a folder")
        if path.exists() and not path.is_file():
            continue  # a pipe or a terminal: nothing is replaced
        real = path.resolve()
        if not real.parent.is_dir():
            raise FileNotFoundError(f"{path} cannot be written: there is no folder {path.parent}")
        if not os.access(real.parent, os.W_OK):
            raise PermissionError(f"{path} cannot be written: its folder is read-only")
        if real in taken:
            raise ValueError(f"{path} cannot be written: it {taken[real]}")
        taken[real] = "is to be written twice"


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path that takes the place of ``path`` if the block succeeds.

    A link is followed, and what is no plain file, such as a pipe, is written to as it is.

    Raises
    ------
    OSError
        Where the folder cannot be written; whatever stood at ``path`` is untouched.
    """
    if path.exists() and not path.is_file():
        yield path
        return
    real = path.resolve()
    handle, name = tempfile.mkstemp(prefix=".phasewire-", dir=real.parent)
    os.close(handle)
    part = Path(name)
    try:
        yield part
        part.chmod(real.stat().st_mode if real.exists() else _plain_mode())
        part.replace(real)
    finally:
        part.unlink(missing_ok=True)


def _plain_mode() -> int:
    """The mode of a plain new file; a temporary one is private."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
