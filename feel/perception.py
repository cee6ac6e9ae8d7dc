"""From the waves of an array to what skin could feel of them: a map of perceived intensity.

The waves push the skin (radiation pressure), the skin moves as a viscoelastic half-space (`skin`), and each channel of
touch weighs the motion by its threshold (`receptors`). A channel's level at a place is the root of the summed squares
of displacement over threshold, of all frequencies: within a channel energy adds (Makous, Friedman and Vierck,
J. Neurosci. 15, 2808, 1995). A channel that sums over an area gets the mean square over a disc of this area around the
place. The most sensitive channel decides whether something is felt (Bolanowski et al., 1988), so the perceived
intensity is the greatest level of a channel; 1 is at the threshold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import HIGHEST, array_of, real, whole
from ..base.pictures import Drawable, axes_or_new, colour_bar
from ..solver.acoustics.array import TransducerArray
from ..solver.acoustics.medium import Medium, as_medium
from ..solver.acoustics.propagation import arrivals
from ..solver.fields.quantities import LOUDEST, radiation_pressure
from ..solver.geometry import place
from .arriving import as_waves
from .drawing import INTENSITY, draw_intensity, write_scale
from .receptors import TOUCH_CHANNELS
from .skin import MOST_HZ, NEGLIGIBLE, Skin, displaced
from .unfolding import SkinPlaces

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FeltMap", "feel", "felt_map", "radiation_pressures"]

EVERY = 10
"""Carrier periods from one sample of the radiation pressure to the next: 4 kHz at 40 kHz."""
SAMPLES_AT_A_TIME = 1024
MOST_PERIODS = 10_000_000


@dataclass(frozen=True, eq=False)
class FeltMap(Drawable):
    """The feeling that a stretch of time could cause in skin, taken for one period of a stimulus that repeats.

    Parameters
    ----------
    places : SkinPlaces
        k places of skin.
    rate : float
        Sample rate of the pressure, in hertz.
    samples : int
        Their number: the stretch lasts samples/rate seconds.
    frequencies : (f,) float
        Those with content, in hertz, above 0.
    spectra : (f, k) complex64
        Peak amplitude of the displacement of the skin at each, in metres, time factor e^{−iωt}.
    """

    places: SkinPlaces
    rate: float
    samples: int
    frequencies: NDArray[np.float64]
    spectra: NDArray[np.complex64]

    def __repr__(self) -> str:
        return f"FeltMap({len(self.intensity)} places, at most {self.intensity.max():.3g} × threshold)"

    @cached_property
    def levels(self) -> NDArray[np.float64]:
        """(c, k) what each channel of `TOUCH_CHANNELS` gets; 1 is at its threshold."""
        power = np.abs(self.spectra).astype(np.float64) ** 2
        weighed = [(channel, channel.threshold(self.frequencies) ** -2.0 @ power) for channel in TOUCH_CHANNELS]
        return np.sqrt([_summed(each[None], self.places, channel.area)[0] for channel, each in weighed])

    @cached_property
    def intensity(self) -> NDArray[np.float64]:
        """(k,) perceived intensity: the greatest level of a channel; 1 is at the threshold."""
        return np.asarray(self.levels.max(axis=0))

    @property
    def strongest(self) -> int:
        """The place of the greatest intensity."""
        return int(self.intensity.argmax())

    def intensity_over_time(self, window: float) -> NDArray[np.float64]:
        """Perceived intensity in one window after another, (w, k), each of about so many seconds.

        Raises
        ------
        ValueError
            If the window is longer than the stretch, or shorter than two samples.
        """
        window = real("window", window, 1 / self.rate, self.samples / self.rate * 2, "s")
        count = round(self.samples / self.rate / window)
        if not 1 <= count <= self.samples // 2:
            raise ValueError(
                f"a window of {window} s must last from {2 / self.rate:g} to {self.samples / self.rate:g} s"
            )
        bins = np.rint(self.frequencies * self.samples / self.rate).astype(int)
        edges = np.arange(count) * self.samples // count
        lengths = np.diff([*edges, self.samples])[:, None]
        found = np.zeros((count, self.spectra.shape[1]))
        for channel in TOUCH_CHANNELS:
            weighed = np.zeros((self.samples // 2 + 1, self.spectra.shape[1]), dtype=np.complex64)
            # SciPy's sign of time is the other one; a level is that of a peak, not of an rms.
            weighed[bins] = self.spectra.conj() / channel.threshold(self.frequencies)[:, None]
            over_time = scipy.fft.irfft(weighed * (self.samples / 2), self.samples, axis=0)
            power = 2 * np.add.reduceat(over_time**2, edges, axis=0) / lengths
            found = np.maximum(found, np.sqrt(_summed(power, self.places, channel.area)))
        return found

    def record(self) -> dict[str, object]:
        """Its numbers for JSON: intensities and levels are multiples of the threshold."""
        here = self.strongest
        return {
            "strongest": float(self.intensity[here]),
            "strongest_at_m": self.places.positions[here].tolist(),
            "channels": {
                channel.name: float(level) for channel, level in zip(TOUCH_CHANNELS, self.levels[:, here], strict=True)
            },
            "places": len(self.intensity),
            "felt_places": int((self.intensity >= 1).sum()),
        }

    def summary(self) -> str:
        """A few lines for people."""
        here, level = self.strongest, self.levels[:, self.strongest]
        most = self.spectra[:, here]
        loudest = self.frequencies[np.abs(most).argmax()] if len(most) else 0.0
        channels = ", ".join(f"{channel.name} {each:.3g}" for channel, each in zip(TOUCH_CHANNELS, level, strict=True))
        return (
            f"strongest {self.intensity[here]:.3g} × threshold at {place(self.places.positions[here])} ({channels})\n"
            f"largest vibration there {np.abs(most).max(initial=0) * 1e6:.3g} µm at {loudest:g} Hz\n"
            f"felt at {100 * (self.intensity >= 1).mean():.0f} % of {len(self.intensity)} places"
        )

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the perceived intensity over the flat skin; a line surrounds what is above the threshold."""
        axes, title = axes_or_new(ax), style.pop("title", "Perceived intensity over the skin, laid out flat")
        drawn = draw_intensity(axes, self.places, self.intensity, **style)
        axes.set_title(title)
        axes.legend(loc="upper left", fontsize="small", handlelength=1.5, frameon=False)
        rows, columns = self.places.mask.shape
        write_scale(colour_bar(axes, drawn, INTENSITY, fraction=0.046 * rows / columns, pad=0.02))
        return axes


def _summed(power: NDArray[np.floating], places: SkinPlaces, area: float) -> NDArray[np.float64]:
    """The mean of (w, k) powers over a disc of an area around each place; there is nothing where there is no skin."""
    reach = math.sqrt(area / math.pi) / places.spacing
    if reach < 1:
        return np.asarray(power, dtype=np.float64)
    steps = np.arange(-int(reach), int(reach) + 1)
    disc = np.hypot(steps, steps[:, None]) <= reach
    grid = np.zeros((len(power), *places.mask.shape))
    grid[:, places.mask] = power
    return np.asarray(scipy.ndimage.convolve(grid, disc[None] / disc.sum(), mode="constant")[:, places.mask])


def radiation_pressures(
    array: TransducerArray,
    waves: NDArray[np.complex64],
    places: SkinPlaces,
    medium: Medium | None = None,
    every: int = EVERY,
) -> NDArray[np.float32]:
    """Normal pressure of the waves on skin, in steps of ``every`` carrier periods.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    waves : (t, n) complex64
        What each emits at the beginning of each carrier period, 1 being full drive.
    places : SkinPlaces
        k places of skin; they lie still.
    medium : Medium, optional
        The air; 20 °C by default.
    every : int
        Carrier periods from one sample to the next.

    Returns
    -------
    (t', k) float32
        Pressure in Pa, t' = ⌈t/every⌉.

    Raises
    ------
    ValueError
        If the waves are not (t, n), ``every`` is not positive, or as `transfer_matrix`.

    Notes
    -----
    Skin reflects the wave. A plane wave that comes at an angle θ pushes with 2·⟨p²⟩/(ρc²)·cos²θ: momentum and area both
    bring a cosine. So each transducer's wave is weighed by its own cosine; what comes from behind does not push.

    The samples are not filtered before: a change above half of their rate is taken for a slower one. The resonance of
    transducers leaves little above 2 kHz: the felt intensity of two alternating foci, of a focus that is switched, and
    of one that moves in steps of 1 to 40 periods is right to 2 %. That of foci that alternate at random, in every
    period, is wrong by up to 13 %.

    All waves arrive at once. In truth those of the outer transducers come up to 0.2 ms later, which takes less than 2 %
    of what alternates at 200 Hz.
    """
    waves, every = as_waves(array, waves), whole("every", every, 1, MOST_PERIODS)
    medium = as_medium(medium)
    matrix, sampled = _pushing(array, places, medium), waves[::every]
    pushed = np.empty((len(matrix), len(sampled)), dtype=np.float32)
    for first in range(0, len(sampled), SAMPLES_AT_A_TIME):
        part = slice(first, first + SAMPLES_AT_A_TIME)
        arrived = matrix @ sampled[part].T
        pushed[:, part] = arrived.real**2 + arrived.imag**2
    pushed *= np.float32(radiation_pressure(1.0, medium))
    return pushed.T


def _pushing(array: TransducerArray, places: SkinPlaces, medium: Medium) -> NDArray[np.complex64]:
    """(k, n) the transfer matrix, each entry times the cosine of incidence."""
    positions, normals = places.positions, places.normals
    squares = np.square(positions).sum(axis=1)[:, None] + np.square(array.positions).sum(axis=1)
    way = np.sqrt(squares - 2 * positions @ array.positions.T)
    ahead = normals @ array.positions.T - np.einsum("ki,ki->k", normals, positions)[:, None]
    turns = way / medium.wavelength
    phase = (2 * np.pi * (turns - np.floor(turns))).astype(np.float32)
    matrix = arrivals(array, positions, medium)
    matrix *= np.maximum(ahead / way, 0).astype(np.float32)
    matrix *= np.cos(phase) + np.complex64(1j) * np.sin(phase)
    return matrix


def felt_map(pressures: ArrayLike, places: SkinPlaces, rate: float, skin: Skin | None = None) -> FeltMap:
    """The felt map of a pressure over time.

    Parameters
    ----------
    pressures : (t, k) float
        Normal pressure at each place, in Pa: one period of a stimulus that repeats.
    places : SkinPlaces
        The k places.
    rate : float
        Sample rate, in hertz.
    skin : Skin, optional
        Skin that feels, that of the hand by default.

    Raises
    ------
    ValueError
        If the pressures are not (t, k).
    """
    pushed = array_of("pressures", pressures, np.float32)
    if pushed.ndim != 2 or pushed.shape[1] != len(places.positions) or not len(pushed):
        raise ValueError(
            f"pressures have the shape {pushed.shape}; they must be (t, {len(places.positions)}), t at least 1"
        )
    if not np.abs(pushed).max() <= LOUDEST:
        raise ValueError(f"pressures must be finite and at most {LOUDEST:g} Pa, but some are not")
    rate = real("rate", rate, 0, HIGHEST, "Hz", above=True)
    samples = len(pushed)
    last = min(math.floor(MOST_HZ * samples / rate), (samples - 1) // 2)
    # SciPy's factor of time is e^{+iωt}.
    spectra = scipy.fft.rfft(pushed.T, workers=-1)[:, 1 : last + 1].conj().T * np.float32(2 / samples)
    content = np.abs(spectra).sum(axis=1)
    kept = np.flatnonzero(content > NEGLIGIBLE * content.max(initial=0))
    frequencies = (kept + 1) * rate / samples
    grid = np.zeros((len(kept), *places.mask.shape), dtype=np.complex64)
    grid[:, places.mask] = spectra[kept]
    moved = displaced(skin or Skin(), grid, frequencies, places.spacing)
    return FeltMap(places, rate, samples, frequencies, moved[:, places.mask])


def feel(
    array: TransducerArray,
    waves: NDArray[np.complex64],
    places: SkinPlaces,
    medium: Medium | None = None,
    skin: Skin | None = None,
    every: int = EVERY,
) -> FeltMap:
    """The felt map of the waves of an array; parameters and errors are those of `radiation_pressures`."""
    medium = as_medium(medium)
    pressures = radiation_pressures(array, waves, places, medium, every)
    return felt_map(pressures, places, medium.frequency / every, skin)
