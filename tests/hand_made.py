"""Bits made by hand, in the place of a capture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from phasewire import Wiring


@dataclass(frozen=True)
class HandMade:
    words: NDArray[np.uint32]
    wiring: Wiring

    @property
    def start_tick(self) -> int:
        return 0

    @property
    def end_tick(self) -> int:
        return len(self.words)

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        assert 0 <= start <= stop <= len(self.words)
        return self.words[start:stop]

    @classmethod
    def of(cls, waves: dict[int, str], wiring: Wiring | None = None) -> HandMade:
        """From strings of 0 and 1 for some channels; all others are low."""
        (length,) = {len(wave) for wave in waves.values()}
        words = np.zeros((length, 10), np.uint32)
        for channel, wave in waves.items():
            for tick, level in enumerate(wave):
                words[tick, channel // 32] |= np.uint32(int(level) << channel % 32)
        return cls(words, wiring or Wiring.strips())
