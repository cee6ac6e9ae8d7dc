"""What skin and ears get from waves over time: what is felt, heard, and how loud it is where people sit.

Its functions take the waves that transducers emit, a row for each carrier period, or a field at points. They know the
solver's array and air, and nothing of ticks, packets or devices: `hil` brings them the waves that the bits of a device
make.
"""

from __future__ import annotations

__all__: list[str] = []


def __dir__() -> list[str]:
    return __all__
