"""The field in front of an aperture slice by slice, by FFT, the paper's (4) and (5).

Time factor e^{-iωt}, outgoing wave e^{+ikr}/r.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from ...base.arguments import length
from ..geometry import frozen
from .aperture import Aperture
from .diffraction import KERNELS
from .medium import Medium

__all__ = ["slice_field"]

MAX_SAMPLES = 10_000_000


def slice_field(
    aperture: Aperture, z: float, extent: float, medium: Medium | None = None, kernel: str = "rayleigh"
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Field of an aperture over a square parallel to it, by one fast convolution; the paper's (4) and (5).

    Parameters
    ----------
    aperture : Aperture
        Aperture in the plane z = 0, around the origin.
    z : float
        Height of the square, in metres; several pixels at least.
    extent : float
        Side of the square, in metres, rounded down to an even number of pixels so that one sample is in the middle.
    medium : Medium, optional
        The air; 20 °C by default. Absorption is left out.
    kernel : str
        A key of `KERNELS`.

    Returns
    -------
    axis : (n,) float
        The samples' x, and y, in metres, one per pixel's side.
    field : (n, n) complex
        Pressure per strength, in Pa/(Pa·m), rows along y; e^{ikr}/r on the axis far away.

    Raises
    ------
    ValueError
        If the kernel is unknown, a number is out of range or there are too many samples.

    Notes
    -----
    The transform is as long as field and aperture together. With one of the field's own length the convolution is
    circular: what leaves the square on one side comes in again on the other, an error of tens of per cent.
    """
    if kernel not in KERNELS:
        raise ValueError(f"unknown kernel {kernel!r}; known are {', '.join(KERNELS)}")
    z, extent = length("z", z), length("extent", extent)
    half = int(extent / aperture.pixel / 2 + 1e-9)
    count = 2 * half + 1
    if (count + max(aperture.image.shape)) ** 2 > MAX_SAMPLES:
        raise ValueError(f"{extent} m in pixels of {aperture.pixel} m makes more than {MAX_SAMPLES} samples")
    axis = np.arange(-half, half + 1, dtype=np.float64) * aperture.pixel
    # Offsets from a pixel of the aperture to a sample of the field, from the smallest to the largest.
    spans = [count + side - 1 for side in aperture.image.shape]
    y, x = ((np.arange(span) - (span - 1) / 2) * aperture.pixel for span in spans)
    distance = np.sqrt(y[:, None] ** 2 + x[None, :] ** 2 + z**2)
    wave = KERNELS[kernel].wave(z, distance, (medium or Medium()).wavenumber)
    lengths = [scipy.fft.next_fast_len(span + side - 1) for span, side in zip(spans, aperture.image.shape, strict=True)]
    product = scipy.fft.fft2(wave, lengths) * scipy.fft.fft2(aperture.image, lengths)
    rows, columns = aperture.image.shape
    field = scipy.fft.ifft2(product)[rows - 1 : rows - 1 + count, columns - 1 : columns - 1 + count]
    return frozen(axis), frozen(np.ascontiguousarray(field / aperture.image.sum()))
