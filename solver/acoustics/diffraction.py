"""Diffraction: the kernels of the Rayleigh integrals, and the integral over the face of one transducer.

Time factor e^{-iωt}, outgoing wave e^{+ikr}/r. A face is given by its rings: what remains of a disc, or of an image
averaged over the azimuth, is a few radii ρ with weights that sum to 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from .aperture import Aperture

__all__ = ["KERNELS", "REFERENCE_DISTANCE", "Kernel", "disc_rings", "face_rings", "image_rings", "integrate"]

REFERENCE_DISTANCE = 0.30
"""Distance in metres at which a data sheet states the pressure, and at which the kernel as printed is made to agree."""

SAMPLES_AT_A_TIME = 2_000_000  # bounds the memory of an integral


@dataclass(frozen=True)
class Kernel:
    """What one point of the face sends to a point of the air.

    Scaled so that a face of any shape makes e^{ikr}/r on its axis far away (as printed: at 0.30 m), it is
    (z/R)^cosine · (R/0.30 m)^growth · e^{ikR}/R, and for RS-I also 1 + i/kR.

    Parameters
    ----------
    cosine : int
        Power of z/R.
    growth : float
        Power of R by which it falls less than 1/R.
    near : bool
        Whether the near field's 1 + i/kR belongs to it.
    """

    cosine: int
    growth: float = 0.0
    near: bool = False

    def wave(self, z: float, distance: NDArray[np.float64], wavenumber: float) -> NDArray[np.complex128]:
        """The kernel at a height ``z`` and distances R in metres, (...) each; in 1/m."""
        wave = np.exp(1j * wavenumber * distance) / distance * (z / distance) ** self.cosine
        if self.growth:
            wave *= (distance / REFERENCE_DISTANCE) ** self.growth
        return np.asarray(wave * (1 + 1j / (wavenumber * distance)) if self.near else wave)

    def front(self, sine: NDArray[np.float64], distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """The factor cos^cosine θ · (r/0.30 m)^growth that is not smooth in sin²θ and 1/r, (...)."""
        factor = np.sqrt(np.maximum(0.0, 1 - sine**2)) ** self.cosine
        return np.asarray(factor * (distance / REFERENCE_DISTANCE) ** self.growth if self.growth else factor)


KERNELS = {
    "rayleigh": Kernel(cosine=0),
    "rayleigh-1": Kernel(cosine=1, near=True),
    "as-printed": Kernel(cosine=1, growth=0.5),
}
"""Kernels by name.

``rayleigh``
    RS-II, a moving face in a rigid baffle: e^{ikR}/R.
``rayleigh-1``
    RS-I, a face of given pressure in a soft baffle: z·(1/R − ik)·e^{ikR}/R², divided by −ik.
``as-printed``
    The paper's (2) to the letter, without its 1/(iλ): z·e^{ikR}/(R²)^{3/4}: the exponent of two dimensions, for which
    the field falls as r^{-1/2} and not, as in its section 7 and in air, as 1/r. It has no length that
    would make a strength in Pa·m of its amplitude; it is scaled to agree with the others at 0.30 m. It is here to
    follow the paper, not to predict anything.
"""


def face_rings(face: float | Aperture, wavenumber: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Radii (n,) in metres and weights (n,) of a face: an image, or the disc of a radius in metres."""
    return image_rings(face, wavenumber) if isinstance(face, Aperture) else disc_rings(face, wavenumber)


def disc_rings(radius: float, wavenumber: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Radii (n,) in metres and weights (n,) of a disc: Gauss–Legendre quadrature over ρ², in which all is smooth."""
    node, weight = np.polynomial.legendre.leggauss(_rings(radius, wavenumber))
    return radius * np.sqrt((node + 1) / 2), (weight / 2).astype(np.complex128)


def image_rings(aperture: Aperture, wavenumber: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Radii (n,) in metres and weights (n,) of an image's mean over the azimuth.

    The azimuth is averaged because nobody knows how an element was turned when it was soldered. What a wave makes of a
    ring is a smooth function of ρ², so the image enters by its Legendre moments in ρ² alone, and those give the weights
    with which the function's values at the Gauss nodes yield the same sum. Each pixel is a point in its middle: its
    weight, the open part of its area, has blurred it once already.
    """
    reach, (rows, columns) = aperture.reach, aperture.axes()
    count = _rings(reach, wavenumber)
    node, weight = np.polynomial.legendre.leggauss(count)
    used = aperture.image != 0
    at = 2 * np.add.outer(rows**2, columns**2)[used] / reach**2 - 1
    amplitude = aperture.image[used] / aperture.image.sum()
    moments = np.array([amplitude @ scipy.special.eval_legendre(order, at) for order in range(count)])
    orders = np.arange(count)
    basis = (2 * orders + 1) / 2 * scipy.special.eval_legendre(orders, node[:, None])
    return reach * np.sqrt((node + 1) / 2), weight * (basis @ moments)


def _rings(radius: float, wavenumber: float) -> int:
    """Number of rings for 1e-9 of scale from two radii on."""
    return 8 + math.ceil(wavenumber * radius)


def integrate(
    kernel: Kernel,
    rings: tuple[NDArray[np.float64], NDArray[np.complex128]],
    sine_squared: NDArray[np.float64],
    inverse_distance: NDArray[np.float64],
    wavenumber: float,
) -> NDArray[np.complex128]:
    """The Rayleigh integral (p,) over rings, times r·e^{-ikr} and without the kernel's `front`: 1 on the axis far away.

    ``rings`` are radii in metres and complex weights, (n,) each. The points have sin²θ and 1/r in 1/m, (p,) each, of
    which 0 is the far field; the integral is a smooth function of both. ``wavenumber`` is in rad/m.

    R² = r² + ρ² − 2rρ·sinθ·cosφ, in which R − r is taken as (R² − r²)/(R + r), so that no digits are lost far away.
    Over the azimuth the trapezoid rule is exact to rounding after a few points; half a turn is enough.
    """
    radius, weight = rings
    angles = 12 + 2 * math.ceil(wavenumber * float(radius.max()))
    azimuth = (np.arange(angles) + 0.5) * (math.pi / angles)
    across = np.outer(radius, np.cos(azimuth)).ravel()
    square = np.repeat(radius**2, angles)
    weights = np.repeat(weight / angles, angles)
    result = np.empty(len(sine_squared), dtype=np.complex128)
    at_a_time = max(1, SAMPLES_AT_A_TIME // len(weights))
    for first in range(0, len(result), at_a_time):
        part = slice(first, first + at_a_time)
        inverse = inverse_distance[part, None]
        excess = inverse * square - 2 * np.sqrt(sine_squared[part, None]) * across  # (R² − r²)/r
        ratio = np.sqrt(np.maximum(0.0, 1 + inverse * excess))  # R/r
        wave = np.exp(1j * wavenumber * excess / (ratio + 1)) * ratio ** (kernel.growth - 1 - kernel.cosine)
        if kernel.near:
            wave *= 1 + 1j * inverse / (wavenumber * ratio)
        result[part] = wave @ weights
    return result
