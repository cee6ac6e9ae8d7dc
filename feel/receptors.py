"""The channels of touch: the least vibration of skin that each answers to, over frequency, and the area it sums over.

Bolanowski, Gescheider, Verrillo and Checkosky ("Four channels mediate the mechanical aspects of touch", J. Acoust. Soc.
Am. 84, 1680, 1988) separated thresholds from 0.4 to 500 Hz at the thenar eminence, with a contactor of 2.9 cm². The
numbers below are approximate: they were not digitised from the figures, and may be wrong by 3 dB. They have the
published slopes: P falls by 12 dB per octave to its minimum from 250 to 300 Hz, and rises by 12 above; NP I falls by
some 5 and is nearly flat from 10 to 40 Hz; NP III is nearly flat. From 500 to 800 Hz, the end of P's range, its slope
is continued.

P sums energy over area: its threshold falls by 3 dB per doubling of the contactor from 0.02 to 2.9 cm². The others do
not (Verrillo, J. Acoust. Soc. Am. 35, 1962, 1963; Gescheider, Bolanowski and Hardick, Somatosens. Mot. Res. 18, 191,
2001).

Left out: NP II, which decides only under contactors below 0.02 cm² and is otherwise masked by P; the temporal summation
of P, which takes a second; age, temperature, and the differences between people and between places of the hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["TOUCH_CHANNELS", "TouchChannel"]

MICROMETRE = 1e-6
CONTACTOR = 2.9e-4
"""m², of the thresholds."""


@dataclass(frozen=True)
class TouchChannel:
    """A channel of touch.

    Parameters
    ----------
    name, fibres : str
        Names of the channel, and of the nerve fibres that serve it.
    area : float
        Area over which it sums energy, in m²: to this area its thresholds apply. 0 if it does not sum.
    thresholds : tuple of (float, float)
        Frequency in hertz, ascending, and the least displacement that is felt, in dB re 1 µm (peak).
    """

    name: str
    fibres: str
    area: float
    thresholds: tuple[tuple[float, float], ...]

    def __repr__(self) -> str:
        return f"TouchChannel({self.name}, {self.fibres}, {self.thresholds[0][0]:g} to {self.thresholds[-1][0]:g} Hz)"

    def threshold(self, frequency: ArrayLike) -> NDArray[np.float64]:
        """Least peak displacement that is felt at frequencies in hertz, (...) m; infinite outside the table.

        Between the frequencies of the table it is a straight line in dB over the logarithm of frequency.
        """
        f = np.asarray(frequency, dtype=np.float64)
        known, level = np.array(self.thresholds).T
        inside = (f >= known[0]) & (f <= known[-1])
        decibels = np.interp(np.log(np.where(inside, f, known[0])), np.log(known), level)
        return np.asarray(np.where(inside, MICROMETRE * 10 ** (decibels / 20), np.inf))


_P = (
    *((10, 34), (20, 22), (30, 15), (40, 10), (60, 3), (100, -6), (150, -13), (200, -17), (250, -20), (300, -20)),
    *((400, -17), (500, -12), (800, -4)),
)
_NP_I = ((1, 30), (3, 24), (10, 16), (20, 13), (30, 11), (40, 11), (60, 12), (100, 15), (150, 20))
_NP_III = ((0.4, 27), (1, 26), (3, 24), (10, 22), (20, 20), (40, 20), (60, 21), (100, 24))
TOUCH_CHANNELS = (
    TouchChannel("P", "FA II", CONTACTOR, _P),
    TouchChannel("NP I", "FA I", 0.0, _NP_I),
    TouchChannel("NP III", "SA I", 0.0, _NP_III),
)
"""In the order of a `FeltMap`'s levels."""
