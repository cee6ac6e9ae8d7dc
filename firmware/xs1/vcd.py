"""Words of ports as a VCD file (value change dump, IEEE 1364-2005 chapter 18), for GTKWave and its like."""

from __future__ import annotations

from collections.abc import Mapping
from heapq import merge
from operator import itemgetter
from typing import TYPE_CHECKING

from vcd import VCDWriter

from ...base.storage import FilePath, replacing
from .names import port_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["write_port_vcd"]

_TIMESCALE, _UNITS_PER_CYCLE = "100 ps", 25  # the standard has 1, 10 and 100 of a unit only


def write_port_vcd(
    path: FilePath, changes: Mapping[int, tuple[NDArray[np.int64], NDArray[np.uint32]]], end: int
) -> None:
    """Write a file in which each port is a wire of its width.

    Parameters
    ----------
    path : str or Path
    changes : mapping
        The cycles of each port, by its identifier, and the words from then on; words are 0 before the first.
    end : int
        The cycle at which the file ends.

    Raises
    ------
    OSError
        If the file cannot be written; what stood there is untouched.
    """
    with (
        replacing(path) as part,
        part.open("w", encoding="ascii", newline="\n") as stream,
        VCDWriter(stream, _TIMESCALE, date="", comment="Ports of an XS1 core", version="phasewire") as writer,
    ):
        sources = []
        for port, (cycles, words) in changes.items():
            wire = writer.register_var("core", f"port_{port_name(port)}", "wire", size=port >> 16, init=0)
            sources.append([(cycle, wire, word) for cycle, word in zip(cycles.tolist(), words.tolist(), strict=True)])
        for cycle, wire, word in merge(*sources, key=itemgetter(0)):
            writer.change(wire, cycle * _UNITS_PER_CYCLE, word)
        writer.close(end * _UNITS_PER_CYCLE)
