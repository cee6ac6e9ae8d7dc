"""The output amplifier: from a port's bits to the voltage on a transducer.

It turns logic levels of 0 and 5 V into 0 and 15 V. The 15 V are the paper's (section 4.1); how fast it switches is an
assumption, for no schematic of the boards is published. It loads nothing and rings at nothing: an edge is a straight
ramp, and ramps of one edge end within a tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...protocol.board import TICK_HZ, TICKS_PER_PERIOD
from ...protocol.codes import SUPPLY_RANGE_MV

__all__ = ["FULL_DRIVE_V", "NOMINAL_SUPPLY_V", "Amplifier"]

NOMINAL_SUPPLY_V = 15.0
FULL_DRIVE_V = NOMINAL_SUPPLY_V * 2 / math.pi
"""Peak fundamental, in volts, of the widest pulse at the nominal supply: a drive of magnitude 1."""
SUPPLIES_V = (SUPPLY_RANGE_MV[0] / 1000, SUPPLY_RANGE_MV[-1] / 1000)


@dataclass(frozen=True)
class Amplifier:
    """One amplifier; all channels have the same.

    Parameters
    ----------
    supply_v : float
        The output's high level in volts, 12 to 18; 15 in the paper.
    edge_s : float
        How long the output takes to rise or to fall, in seconds, at most a tick of 0.5 µs. The default, 50 ns, is an
        assumption: common gate drivers charge the 2.5 nF of a transducer about that fast.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    supply_v: float = NOMINAL_SUPPLY_V
    edge_s: float = 50e-9

    def __post_init__(self) -> None:
        """Check the ranges."""
        low, high = SUPPLIES_V
        if not low <= self.supply_v <= high:
            raise ValueError(f"supply_v {self.supply_v} V must lie between {low:g} and {high:g} V")
        if not 0 <= self.edge_s <= 1 / TICK_HZ:
            raise ValueError(f"edge_s {self.edge_s} s must lie between 0 and a tick, {1 / TICK_HZ:g} s")

    @property
    def _lost(self) -> float:
        """The part of a tick's mean that its edge still owes to the level before."""
        return self.edge_s * TICK_HZ / 2

    @property
    def tick_voltages(self) -> NDArray[np.float64]:
        """Mean voltage over a tick, (2, 2), by the level in the tick before (row) and in this one (column)."""
        levels = np.arange(2)
        return self.supply_v * (levels + self._lost * (levels[:, None] - levels))

    def voltage(self, levels: ArrayLike, before: ArrayLike = 0) -> NDArray[np.float64]:
        """The exact mean of the output over each tick, which can be fed to a zero-order hold.

        Parameters
        ----------
        levels : (t, ...) int
            0 or 1 in each of t ticks.
        before : (...) int
            The level in the tick before the first.

        Returns
        -------
        (t, ...) float
            The voltage, V.
        """
        now = np.asarray(levels, dtype=np.intp)
        earlier = np.concatenate([np.broadcast_to(np.asarray(before, dtype=np.intp), now[:1].shape), now[:-1]])
        return np.asarray(self.tick_voltages[earlier, now])

    @property
    def gain(self) -> complex:
        """What becomes of a drive's fundamental, whatever the pulse, relative to instant edges at the nominal supply.

        Time factor e^{-iωt}. The phase is the delay by half an edge. That means over ticks stand for ramps costs
        4e-4 of the magnitude at 50 ns; of the ramps themselves it would be 7e-6.
        """
        a_tick_later = np.exp(2j * np.pi / TICKS_PER_PERIOD)
        return complex(self.supply_v / NOMINAL_SUPPLY_V * (1 - self._lost + self._lost * a_tick_later))
