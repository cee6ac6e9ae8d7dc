"""Apertures: the moving part of a transducer's face, as an image."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, length
from ...base.errors import InputFileError
from ...base.storage import FilePath, open_plain
from ..archives import read_array
from ..geometry import frozen

__all__ = ["IMAGE_FILES", "Aperture"]

MAX_SIDE = 2048  # pixels
LARGEST = 1.0  # metres; side of an aperture
FAINTEST = 1e-6  # of the aperture's amplitudes: the least sum on the axis


@dataclass(frozen=True, eq=False)
class Aperture:
    """An image of the moving face, or of the openings of a grille; two with the same contents are equal.

    Parameters
    ----------
    image : (rows, columns) float or complex
        Amplitude of the face in each pixel, of magnitude at most 1: 0 is closed, 1 is open. A pixel on an edge has the
        open part of its area; a complex number also has a phase. The image's middle is the transducer's; x grows with
        the column and y with the row.
    pixel : float
        Side of a pixel, in metres. The wave is sampled once per pixel: at 40 kHz, pixels of 0.2 mm make an error of
        2e-4 of the strength, pixels of 0.1 mm one of 5e-5.

    Attributes
    ----------
    digest : str
        Digest of the contents, in hexadecimal.

    Raises
    ------
    ValueError
        If the image is empty, too large, not finite or beyond 1, the pixel is out of range, or nothing would be
        emitted along the axis, the direction for which the strength of a transducer is stated.
    """

    image: NDArray[np.complex128]
    pixel: float
    digest: str = field(init=False, repr=False)

    def __init__(self, image: ArrayLike, pixel: float) -> None:
        values = array_of("an aperture's image", image, np.complex128) + 0.0  # without negative zeros
        pixel = length("pixel", pixel, LARGEST)
        if values.ndim != 2 or not values.size:
            raise ValueError(f"an aperture's image must have the shape (rows, columns), not {values.shape}")
        if max(values.shape) > MAX_SIDE:
            raise ValueError(f"an aperture's image of {values.shape} pixels is too large; at most {MAX_SIDE} a side")
        if not 0 < pixel * max(values.shape) <= LARGEST:
            raise ValueError(
                f"an aperture's pixel of {pixel} m must be positive, and {max(values.shape)} of them in a row at most "
                f"{LARGEST:g} m"
            )
        if not (within := np.abs(values) <= 1 + 1e-9).all():
            row, column = np.unravel_index(np.argmin(within), values.shape)
            raise ValueError(f"pixel {row}, {column} of an aperture is {values[row, column]}, beyond a magnitude of 1")
        if not abs(values.sum()) > FAINTEST * np.abs(values).sum():
            raise ValueError("an aperture that emits nothing along its axis has no strength; open some of it")
        object.__setattr__(self, "image", frozen(values))
        object.__setattr__(self, "pixel", float(pixel))
        contents = f"{values.shape} {float(pixel).hex()} ".encode() + values.tobytes()
        object.__setattr__(self, "digest", hashlib.sha256(contents).hexdigest())

    def __repr__(self) -> str:
        rows, columns = self.image.shape
        return f"Aperture({rows} × {columns} pixels of {self.pixel * 1e3:g} mm)"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Aperture) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def reach(self) -> float:
        """Distance from the middle to the furthest corner of a pixel that is not closed, in metres."""
        y, x = (np.abs(axis) + self.pixel / 2 for axis in self.axes())
        return float(np.hypot(y[:, None], x[None, :])[self.image != 0].max())

    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates of the pixels' middles: y (rows,) and x (columns,), in metres."""
        rows, columns = ((np.arange(count) - (count - 1) / 2) * self.pixel for count in self.image.shape)
        return rows, columns

    @classmethod
    def disc(cls, radius: float, pixel: float = 1e-4) -> Aperture:
        """A disc, each pixel weighted by how much of its area lies within.

        Without that weight the edge is a staircase and the field an order of magnitude less accurate.

        Parameters
        ----------
        radius : float
            Radius of the disc, in metres.
        pixel : float
            Side of a pixel, in metres.
        """
        radius = length("radius", radius, LARGEST)
        pixel = length("pixel", pixel, radius)
        half = math.ceil(radius / pixel)
        if 2 * half > MAX_SIDE:
            raise ValueError(f"a pixel of {pixel} m is too small for a radius of {radius} m; at most {MAX_SIDE} a side")
        # One quadrant in units of a pixel. Over a column, the circle's height is above a pixel's top up to `full`, and
        # above its bottom up to `some`; between the two the area is that under the circle.
        size = radius / pixel
        low, high = np.arange(half)[None, :], np.arange(1, half + 1)[None, :]
        bottom, top = low.T, high.T
        full = np.clip(np.sqrt(np.maximum(0.0, size**2 - top**2)), low, high)
        some = np.clip(np.sqrt(np.maximum(0.0, size**2 - bottom**2)), low, high)

        def under(x: NDArray[np.float64]) -> NDArray[np.float64]:
            inside = np.minimum(x, size)
            height = np.sqrt((size - inside) * (size + inside))
            return np.asarray((inside * height + size**2 * np.arcsin(inside / size)) / 2)

        quadrant = np.clip(full - low + under(some) - under(full) - bottom * (some - full), 0.0, 1.0)
        upper = np.concatenate([quadrant[:, ::-1], quadrant], axis=1)
        return cls(np.concatenate([upper[::-1], upper]), pixel)

    @classmethod
    def from_image(cls, path: FilePath, width: float) -> Aperture:
        """An aperture from a picture, such as a photograph of the grille.

        Parameters
        ----------
        path : str or Path
            A .png file, in which white is open and black or transparent is closed, or an .npy file of numbers as in
            `image`.
        width : float
            Width of the picture, in metres.

        Raises
        ------
        InputFileError
            If the file is of another kind, or its contents make no aperture.
        OSError
            If it cannot be opened.
        """
        path, width = Path(path), length("width", width, LARGEST)
        if path.suffix.lower() not in IMAGE_FILES:
            raise InputFileError(f"{path}: apertures are read from {' or '.join(IMAGE_FILES)} files")
        open_plain(path).close()  # so that a missing file is not taken for a bad one
        try:
            image = IMAGE_FILES[path.suffix.lower()](path)
            if image.ndim != 2 or not image.size:
                raise ValueError(f"it must have rows and columns, not the shape {image.shape}")
            return cls(image, width / image.shape[1])
        except Exception as error:  # on foreign bytes the readers raise nearly anything
            raise InputFileError(f"{path}: {error}") from error


def _read_png(path: Path) -> NDArray[np.float64]:
    from matplotlib.image import imread  # matplotlib takes as long to import as everything else together
    from PIL.PngImagePlugin import PngImageFile

    with PngImageFile(path) as file:  # which reads the size and no pixel
        if max(file.size) > MAX_SIDE:
            raise ValueError(f"a picture of {file.size} pixels is too large; at most {MAX_SIDE} a side")
    picture = np.asarray(imread(path), dtype=np.float64)
    if picture.ndim == 2:
        return picture
    colours = picture.shape[2]
    opaque = picture[..., -1] if colours in (2, 4) else 1.0
    return np.asarray(picture[..., : 3 if colours > 2 else 1].mean(axis=2) * opaque)


def _read_npy(path: Path) -> NDArray[np.complex128]:
    return np.asarray(read_array(path), dtype=np.complex128)


IMAGE_FILES = {".png": _read_png, ".npy": _read_npy}
"""Readers of images by the suffix of a file's name."""
