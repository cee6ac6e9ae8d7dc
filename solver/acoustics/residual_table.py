"""Look-up tables of a transducer's residual, for the models whose integral is too slow to take at every point."""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from platformdirs import user_cache_path

from ...base.arguments import real
from ...base.errors import InputFileError
from ...base.storage import replacing
from ..archives import read_arrays
from ..geometry import frozen
from .aperture import Aperture
from .diffraction import KERNELS, Kernel, face_rings, integrate
from .medium import Medium
from .transducer import Transducer

__all__ = ["CACHE_VARIABLE", "ResidualTable", "cache_folder"]

CACHE_VARIABLE = "PHASEWIRE_CACHE"
FORMAT = "phasewire-residual-1"  # to be changed with anything that changes the values
MAX_VALUES = 300_000
NEAREST = 0.05  # metres


@dataclass(frozen=True, eq=False)
class ResidualTable:
    """A model's `residual` over sin²θ and 1/r, of one kind of transducer in one air.

    The table holds the smooth part of the residual, and never e^{ikr}: linear interpolation is then within 1e-4 of
    scale. Rows go with sin²θ and not with sinθ, because the residual is even in it: as many rows are three times as
    accurate, and no root has to be taken. The wave of an image is its mean over the azimuth, see `image_rings`.

    Parameters
    ----------
    values : (rows, columns) complex
        The values in C order. Row i is sin²θ = i · `sine_squared_step`, the last one 1; column j is
        1/r = j · `inverse_distance_step`, from the far field, 0, to 1/`nearest`.
    kernel : Kernel
        Its `front` is to be multiplied with what is interpolated: cos^cosine θ · (r/0.30 m)^growth, which is 1 for
        RS-II.
    nearest : float
        Distance in metres from which the table can be used.
    """

    values: NDArray[np.complex128]
    kernel: Kernel
    nearest: float

    @property
    def sine_squared_step(self) -> float:
        """Step of sin²θ from row to row."""
        return 1.0 / (len(self.values) - 1)

    @property
    def inverse_distance_step(self) -> float:
        """Step of 1/r from column to column, in 1/m."""
        return 1.0 / (self.nearest * (len(self.values[0]) - 1))

    @classmethod
    def of(cls, transducer: Transducer, medium: Medium | None = None, nearest: float = NEAREST) -> ResidualTable:
        """The table of a transducer, from memory, from the cache's folder, or computed.

        Parameters
        ----------
        transducer : Transducer
            Transducer of a model that is a Rayleigh integral.
        medium : Medium, optional
            The air; 20 °C by default.
        nearest : float
            Distance in metres from which the table is to be used; at least the transducer's own.

        Raises
        ------
        ValueError
            If the model needs no table, or the table would be too near or too large.

        Notes
        -----
        65 × 9 values for the default disc from 5 cm on, 65 × 46 from two radii on. More for a larger face, so that the
        accuracy stays: rows grow as (k·reach)², columns as k·reach²/nearest.
        """
        if transducer.model not in KERNELS:
            raise ValueError(f"model {transducer.model!r} needs no table; {', '.join(KERNELS)} do")
        nearest = real("nearest", nearest, 0, 1e6, "m")
        if nearest < transducer.nearest * (1 - 1e-9):
            raise ValueError(
                f"a table from {nearest} m on is too near; a face that reaches {transducer.reach * 1e3:.2f} mm needs "
                f"at least {transducer.nearest * 1e3:.2f} mm"
            )
        return _table(
            transducer.model, transducer.face, transducer.reach, (medium or Medium()).wavenumber, float(nearest)
        )

    def __call__(self, sine: ArrayLike, distance: ArrayLike) -> NDArray[np.complex128]:
        """The residual by linear interpolation.

        Parameters
        ----------
        sine : (...) float
            sinθ, between 0 and 1.
        distance : (...) float
            r in metres, at least `nearest`.

        Returns
        -------
        (...) complex
            The residual, within 1e-4 of scale of the integral.

        Raises
        ------
        ValueError
            If a value is out of range.
        """
        sine, distance = np.asarray(sine, dtype=np.float64), np.asarray(distance, dtype=np.float64)
        if not ((sine >= 0) & (sine <= 1)).all():
            raise ValueError(f"sines from {sine.min()} to {sine.max()} must lie between 0 and 1")
        if not (distance >= self.nearest * (1 - 1e-9)).all():
            raise ValueError(f"a distance of {distance.min()} m is nearer than the table's {self.nearest} m")
        rows, columns = self.values.shape
        x, y = sine**2 * (rows - 1), np.minimum(self.nearest / distance, 1.0) * (columns - 1)
        row, column = np.minimum(x.astype(np.intp), rows - 2), np.minimum(y.astype(np.intp), columns - 2)
        right, down = y - column, x - row
        upper = self.values[row, column] * (1 - right) + self.values[row, column + 1] * right
        lower = self.values[row + 1, column] * (1 - right) + self.values[row + 1, column + 1] * right
        return np.asarray((upper + (lower - upper) * down) * self.kernel.front(sine, distance))


def cache_folder() -> Path:
    """Folder of files that can be computed again: ``$PHASEWIRE_CACHE``, else the user's cache folder."""
    return Path(os.environ.get(CACHE_VARIABLE) or user_cache_path("phasewire"))


@lru_cache(maxsize=4)
def _table(model: str, face: float | Aperture, reach: float, wavenumber: float, nearest: float) -> ResidualTable:
    # A step of 0.19/(k·reach)² in sin²θ, or of 0.0375/(k·reach²) in 1/r, is an error of about 4e-5.
    rows = 1 + max(64, math.ceil((wavenumber * reach) ** 2 / 0.19))
    columns = 1 + max(8, math.ceil(wavenumber * reach**2 / nearest / 0.0375))
    if rows * columns > MAX_VALUES:
        raise ValueError(
            f"a face that reaches {reach * 1e3:.1f} mm needs a table of {rows} × {columns} values from {nearest} m on; "
            f"at most {MAX_VALUES} are possible"
        )
    kernel = KERNELS[model]
    shown = face.digest if isinstance(face, Aperture) else face.hex()
    key = f"{FORMAT} {kernel} {shown} {wavenumber.hex()} {nearest.hex()} {rows} {columns}"
    path = cache_folder() / f"residual-{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"
    values = _read(path, (rows, columns))
    if values is None:
        rings = face_rings(face, wavenumber)
        sine_squared, inverse = np.repeat(np.linspace(0, 1, rows), columns), np.linspace(0, 1 / nearest, columns)
        values = integrate(kernel, rings, sine_squared, np.tile(inverse, rows), wavenumber).reshape(rows, columns)
        _write(path, values)
    return ResidualTable(frozen(values), kernel, nearest)


def _read(path: Path, shape: tuple[int, int]) -> NDArray[np.complex128] | None:
    """Values from the cache; None if they are missing or damaged, which the file's checksum shows."""
    try:
        values = read_arrays(path)["values"]
    except (InputFileError, KeyError, OSError):
        return None
    sound = values.shape == shape and values.dtype == np.complex128 and values.flags.c_contiguous
    return values if sound and np.isfinite(values).all() else None


def _write(path: Path, values: NDArray[np.complex128]) -> None:
    """Keep values in the cache, whole or not at all; if that is impossible, they are computed again next time."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as part, part.open("wb") as file:
            np.savez(file, values=values)
