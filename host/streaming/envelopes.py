"""Envelopes for `Device.modulate`: skin feels not the carrier but the change of its strength."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, flag, real, spelt
from ...base.errors import InputFileError
from ...base.storage import FilePath, read_file
from ...protocol.board import CARRIER_HZ
from ...protocol.codes import AMPLITUDES, MODULATION_SAMPLES
from ...solver.shapes.notation import read_parameters

__all__ = ["Envelope", "parse_envelope", "read_envelope", "sine"]

STEPS, LEAST_STEPS = 200, 40
"""Samples in one period of the fastest sine, at most and, if the carrier leaves room for so many, at least."""
HOLDS = 64
"""Of which the best is chosen."""
LOWEST_HZ, HIGHEST_HZ = CARRIER_HZ / (MODULATION_SAMPLES * (2**16 - 1)), CARRIER_HZ / 2
MOST_SINES = 16
SAME = 1e-12
"""Part of a frequency below which an error is rounding."""
WAV = ".wav"
MOST_WAV_BYTES = 100_000_000
SLOWEST_RATE = 1000
"""Samples per second of a WAV file on a device, at least: slower ones would lose what skin feels."""


class Envelope(NamedTuple):
    """Amplitudes, 0 to 255, and for how many carrier periods each holds."""

    samples: bytes
    hold: int

    def __repr__(self) -> str:
        return f"Envelope({len(self.samples)} samples, {self.frequency:g} Hz)"

    @property
    def frequency(self) -> float:
        """How often its samples are repeated in a second; there may be several periods of a sine in them."""
        return CARRIER_HZ / (len(self.samples) * self.hold)


def sine(
    frequency: float | Sequence[float], depth: float = 1.0, *, phase: float | Sequence[float] = 0.0, force: bool = False
) -> Envelope:
    """An amplitude that falls and rises as a cosine, or as the mean of several.

    Parameters
    ----------
    frequency : float or (k,) float
        The frequency in Hz, up to 20 000. Skin feels 40 to 400 Hz, 200 Hz best. It is met as nearly as
        `MODULATION_SAMPLES` in whole carrier periods allow, and exactly if they have a whole number of its periods.
    depth : float
        1 for down to silence, 0 for none.
    phase : float or (k,) float
        The phase of the cosine at the beginning, in degrees.
    force : bool
        Whether the radiation pressure, which goes with the square of the amplitude, follows the cosine, and not the
        amplitude itself.

    Raises
    ------
    ValueError
        If a number is out of range, or the frequencies have no period in common that the device can keep.
    """
    frequencies = _several("frequency", frequency, LOWEST_HZ, HIGHEST_HZ, "Hz")
    turns = _several("phase", phase, -360_000, 360_000, "degrees") / 360
    depth, force = real("depth", depth, 0, 1), flag("force", force)
    if len(turns) not in (1, len(frequencies)):
        raise ValueError(f"phase has {len(turns)} values, frequency {len(frequencies)}: one for each is needed")
    hold, count, cycles = _loop(frequencies)
    at = cycles * (np.arange(count)[:, None] + 0.5) / count + turns
    return _envelope(1 - depth * (1 - np.cos(2 * np.pi * at).mean(axis=1)) / 2, hold, force=force)


def read_envelope(path: FilePath, *, force: bool = False) -> Envelope:
    """The sound of a WAV file as an envelope, repeated: its lowest value is silence, its highest full drive.

    Parameters
    ----------
    path : str or Path
        A mono file of PCM or float samples, of 4.1 s at most. It is resampled to the rate of the device, as what
        repeats without end.
    force : bool
        As for `sine`.

    Raises
    ------
    InputFileError
        If it is no such file; the message says what would be.
    OSError
        If it cannot be opened.
    """
    import scipy  # which takes long to import

    force = flag("force", force)
    data = read_file(path, MOST_WAV_BYTES)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", scipy.io.wavfile.WavFileWarning)  # chunks that say nothing of the sound
            rate, samples = scipy.io.wavfile.read(BytesIO(data))
    except Exception as error:  # on foreign bytes it raises nearly anything
        raise InputFileError(f"{path} is no WAV file of PCM or float samples: {error}") from error
    if samples.ndim != 1:
        raise InputFileError(f"{path} has {samples.shape[1]} channels; an envelope is mono: mix them, or leave one")
    if rate < 1 or len(samples) < 2:
        raise InputFileError(f"{path} holds {len(samples)} samples at {rate} Hz; there must be sound in it")
    seconds = len(samples) / rate
    hold = math.ceil(seconds * CARRIER_HZ / MODULATION_SAMPLES)
    if hold * SLOWEST_RATE > CARRIER_HZ:
        raise InputFileError(
            f"{path} lasts {seconds:.3g} s; the device keeps {MODULATION_SAMPLES} samples, so at most "
            f"{MODULATION_SAMPLES / SLOWEST_RATE:.3g} s are possible at {SLOWEST_RATE} samples a second: cut it"
        )
    sound = samples.astype(np.float64)
    if not np.isfinite(sound).all() or (low := sound.min()) == (high := sound.max()):
        raise InputFileError(f"{path} is silence, or has values that are no numbers; there must be sound in it")
    count = max(2, round(seconds * CARRIER_HZ / hold))
    level = scipy.signal.resample((sound - low) / (high - low), count)
    return _envelope(np.clip(level, 0, 1), hold, force=force)


@dataclass(frozen=True)
class _Written:
    """What the notation of an envelope has after its frequencies, or its file."""

    depth: float = 1.0
    phase: float = 0.0
    force: bool = False


def parse_envelope(text: str) -> Envelope | None:
    """An envelope from text: ``200``, ``150+250:depth=0.5,phase=90,force=yes`` or ``tune.wav:force=yes``.

    Returns
    -------
    Envelope or None
        None for ``0``.

    Raises
    ------
    ValueError
        If it is none of these, or as `sine`.
    InputFileError, OSError
        As `read_envelope`.
    """
    name, _, parameters = text.rpartition(":") if "=" in text.rpartition(":")[2] else (text, "", "")
    options = read_parameters("modulation", parameters, _Written)
    if name.lower().endswith(WAV):
        if set(options) - {"force"}:
            raise ValueError(f"modulation {text!r}: a {WAV} file has the parameter force alone")
        return read_envelope(name, **options)
    try:
        frequencies = [spelt(part) for part in name.split("+")]
    except ValueError:
        raise ValueError(
            f"modulation {text!r} must be a frequency in Hz, such as 200, several as in 150+250, or a {WAV} file"
        ) from None
    return sine(frequencies, **options) if frequencies != [0] else None


def _several(name: str, values: ArrayLike, least: float, most: float, unit: str) -> NDArray[np.float64]:
    if np.ndim(values) == 0:
        return np.array([real(name, values, least, most, unit)])
    several = [real(name, value, least, most, unit) for value in array_of(name, values, np.float64).ravel()]
    if not 1 <= len(several) <= MOST_SINES:
        raise ValueError(f"{name} has {len(several)} values; 1 to {MOST_SINES} are possible")
    return np.array(several)


def _loop(frequencies: NDArray[np.float64]) -> tuple[int, int, NDArray[np.float64]]:
    """The hold, the number of samples, and the periods of each sine in them that meet the frequencies best.

    Of equally good ones the finest, and then the shortest.
    """
    shortest, longest = CARRIER_HZ / frequencies.max(), CARRIER_HZ / frequencies.min()
    first = max(1, math.ceil(shortest / STEPS - SAME), math.ceil(longest / MODULATION_SAMPLES - SAME))
    if first > shortest / 2:
        raise ValueError(
            f"frequency {frequencies.min():g} Hz and {frequencies.max():g} Hz do not fit {MODULATION_SAMPLES} samples"
        )
    counts = np.arange(2, MODULATION_SAMPLES + 1)
    best, found = math.inf, (0, 0, frequencies)
    for hold in range(first, min(max(first, int(shortest / LEAST_STEPS)), first + HOLDS) + 1):
        cycles = np.maximum(np.rint(frequencies[:, None] * (counts * hold / CARRIER_HZ)), 1)
        error = np.abs(cycles * (CARRIER_HZ / (counts * hold)) / frequencies[:, None] - 1).max(axis=0)
        error[error < SAME] = 0
        if error.min() < best:
            at = int(error.argmin())
            best, found = float(error[at]), (hold, int(counts[at]), cycles[:, at])
    return found


def _envelope(level: NDArray[np.float64], hold: int, *, force: bool) -> Envelope:
    """Amplitudes of a level from 0 to 1, or those whose radiation pressure follows it."""
    amplitudes = np.sqrt(level) if force else level
    return Envelope(np.rint(amplitudes * (AMPLITUDES - 1)).astype(np.uint8).tobytes(), hold)
