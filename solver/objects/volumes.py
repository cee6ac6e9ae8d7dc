"""Objects in volumes, such as those of computed tomography: the surface around all that is denser than a level.

NumPy arrays (NPY, NPZ), NIfTI files by nibabel and folders of DICOM slices by pydicom; marching cubes of scikit-image.
All three come with the extra ``volumes``.
"""

from __future__ import annotations

import gzip
import math
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputFileError
from ...extras import install_command
from ...storage import FilePath, read_file
from ..archives import read_array, read_arrays
from ..arguments import check_positive
from ..contact.mesh import MOST_FACES, Mesh
from .mesh_files import LARGEST, mesh_of

__all__ = ["VOLUMES", "Volume", "read_volume", "read_volume_mesh", "volume_suffix"]

MOST_BYTES = 500_000_000
"""Of a volume, packed or not."""
MOST_VOXELS = 2**27
MOST_SLICES = 4096
UNEVEN = 0.01
"""Largest difference between distances of slices, relative to the distance."""
VOLUMES = ".npy, .npz, .nii and .nii.gz files, and folders with DICOM slices"
METRES = {"meter": 1.0, "mm": 1e-3, "micron": 1e-6}


@dataclass(frozen=True, eq=False)
class Volume:
    """A grid of values in space.

    Parameters
    ----------
    values : (i, j, k) float
        In units of their own; each at least 2 values long.
    origin : (3,) float
        Place of the first value, in metres.
    axes : (3, 3) float
        Row by row the step along i, j and k, in metres.
    """

    values: NDArray[np.float32]
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check that it is a grid, and not too large."""
        if self.values.ndim != 3 or min(self.values.shape) < 2:
            raise ValueError(f"a volume must have three dimensions of at least 2 values, not {self.values.shape}")
        if self.values.size > MOST_VOXELS:
            raise ValueError(f"{self.values.size} values are too many; at most {MOST_VOXELS} are possible")
        if not np.isfinite(self.values).all():
            raise ValueError("some of its values are not finite")
        if not np.isfinite(self.origin).all() or not 1e-30 < abs(float(np.linalg.det(self.axes))) < 1e9:
            raise ValueError(f"its grid, with the steps {self.axes.tolist()} m, spans no space")

    def coarser(self, step: int) -> Volume:
        """The volume whose values are means of blocks of ``step`` values each way; incomplete blocks are left out."""
        if step == 1:
            return self
        if not 1 <= step <= min(self.values.shape) // 2:
            raise ValueError(f"step {step} must be a whole number from 1 to {min(self.values.shape) // 2}")
        blocks = [length // step for length in self.values.shape]
        whole = self.values[tuple(slice(0, count * step) for count in blocks)]
        split = whole.reshape([length for count in blocks for length in (count, step)])
        return Volume(
            split.mean(axis=(1, 3, 5)), self.origin + (step - 1) / 2 * self.axes.sum(axis=0), self.axes * step
        )

    def surface(self, level: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """The closed surface around all values above a level: (v, 3) vertices in metres and (f, 3) faces.

        The space outside the grid counts as the smallest of its values, so that the surface is closed there too.

        Raises
        ------
        ValueError
            If the level is not within the values, or the surface has more than `MOST_FACES` faces.
        """
        from skimage import measure

        low, high = float(self.values.min()), float(self.values.max())
        if not low < level < high:
            raise ValueError(f"level {level:g} must lie between its values, which go from {low:g} to {high:g}")
        padded = np.pad(self.values, 1, constant_values=low)
        above = padded > level
        crossings = sum(int(np.count_nonzero(np.diff(above, axis=axis))) for axis in range(3))
        if crossings > MOST_FACES:  # of edges, each a vertex: a surface has about two faces for each
            raise ValueError(
                f"its surface at {level:g} has some {2 * crossings} faces; at most {MOST_FACES} are possible: pass a "
                f"larger step, such as {math.ceil(math.sqrt(2 * crossings / MOST_FACES)) + 1}"
            )
        marching_cubes: Any = measure.marching_cubes  # which has no types
        vertices, faces, _, _ = marching_cubes(padded, level, allow_degenerate=False)
        outward = faces if np.linalg.det(self.axes) < 0 else faces[:, ::-1]
        return self.origin + (vertices.astype(np.float64) - 1) @ self.axes, outward.astype(np.int64)


def read_volume_mesh(
    path: FilePath,
    level: float,
    spacing: float | None = None,
    step: int = 1,
    status: Callable[[str], None] | None = None,
) -> Mesh:
    """Read the object in a volume: all that has values above a level.

    Its coordinates are those of the volume: a patient's in medical files, in metres; otherwise from the first value.

    Parameters
    ----------
    path : str or Path
        An NPY file; an NPZ file with one array of three dimensions, and if wanted its ``spacing`` in metres; a NIfTI
        file; or a folder with the slices of one DICOM series.
    level : float
        In the volume's units, which are Hounsfield's in a CT.
    spacing : float, optional
        Between neighbouring values, in metres, for a file that does not say it.
    step : int
        The surface is made from the means of as many values each way. Larger steps give fewer faces and less noise.
    status : function, optional
        Is called with a line of text for each stage, for people who wait.

    Raises
    ------
    InputFileError
        If the file is damaged or of another kind, does not say its spacing, has no such level, or the library that
        reads it is not installed; the message names the file. If the surface is larger than `LARGEST`: its spacing is
        then in another unit.
    ValueError
        If the spacing is not positive, or the step is less than 1.
    OSError
        If it cannot be opened.
    """
    if spacing is not None:
        check_positive(spacing, "spacing")
    if step < 1:
        raise ValueError(f"step {step} must be at least 1")
    path, tell = Path(path), status or (lambda _said: None)
    tell(f"reading {path}")
    volume = read_volume(path, spacing)
    tell(f"{path}: making a surface from {volume.values.size} values")
    _needed(path, "skimage", "scikit-image")
    try:
        vertices, faces = volume.coarser(step).surface(level)
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error
    if (size := float(np.ptp(vertices, axis=0).max())) > LARGEST:
        raise InputFileError(
            f"{path}: its surface at {level:g} is {size:.4g} m large, larger than {LARGEST:g} m, with values "
            f"{float(np.linalg.norm(volume.axes, axis=1).max()):.3g} m apart; spacing is in metres, 0.002 for 2 mm"
        )
    return mesh_of(vertices, faces, path, 1.0, tell)


def read_volume(path: Path, spacing: float | None = None) -> Volume:
    """Read a volume; parameters and errors as `read_volume_mesh`."""
    if (suffix := volume_suffix(path)) is None:
        raise InputFileError(f"{path}: volumes are read from {VOLUMES}")
    kind, read = VOLUME_FILES[suffix]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read(path, spacing)
    except InputFileError:
        raise
    except Exception as error:  # on foreign bytes the libraries raise nearly anything, OSError without a number too
        if isinstance(error, OSError) and error.errno is not None:
            raise
        reason = str(error) if type(error) is ValueError else f"it is damaged ({type(error).__name__}: {error})"
        raise InputFileError(f"{path} cannot be used as a {kind}: {reason}") from error


def volume_suffix(path: Path) -> str | None:
    """The suffix of a volume's name, "/" if it is a folder without one, None for any other file."""
    known = (suffix for suffix in VOLUME_FILES if path.name.lower().endswith(suffix))
    return next(known, "/" if path.is_dir() else None)


def _needed(path: Path, module: str, package: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        message = f"{path}: {package} is needed for this, and is not installed: {install_command('volumes')}"
        raise InputFileError(message) from error


def _evenly(path: Path, values: NDArray[Any], spacing: Any) -> Volume:
    if spacing is None:
        raise InputFileError(f"{path} does not say how far its values are apart: pass spacing=…, in metres")
    if values.dtype.kind not in "buif":
        raise ValueError(f"values of the type {values.dtype} are no numbers of one kind")
    steps = np.broadcast_to(np.asarray(spacing, dtype=np.float64), 3)
    return Volume(values.astype(np.float32), np.zeros(3), np.diag(steps))


def _read_npy(path: Path, spacing: float | None) -> Volume:
    return _evenly(path, read_array(path), spacing)


def _read_npz(path: Path, spacing: float | None) -> Volume:
    arrays = read_arrays(path)
    volumes = [name for name, values in arrays.items() if values.ndim == 3]
    if len(volumes) != 1:
        raise ValueError(f"it must have one array of three dimensions, and has {len(volumes)}")
    return _evenly(path, arrays[volumes[0]], arrays.get("spacing", spacing))


def _read_nifti(path: Path, spacing: float | None) -> Volume:
    data = read_file(path, MOST_BYTES)
    if path.suffix.lower() == ".gz":
        data = _unpacked(data)
    nibabel = _needed(path, "nibabel", "nibabel")
    kinds = {348: nibabel.Nifti1Image, 540: nibabel.Nifti2Image}
    kind = kinds.get(int.from_bytes(data[:4], "little")) or kinds.get(int.from_bytes(data[:4], "big"))
    if kind is None:
        raise ValueError("its first four bytes are those of no NIfTI header")
    logger = nibabel.imageglobals.logger
    before, logger.disabled = logger.disabled, True  # it prints what it dislikes, and then raises
    try:
        image = kind.from_bytes(data)
    finally:
        logger.disabled = before
    shape, stored = image.header.get_data_shape(), image.header.get_data_dtype()
    if math.prod(shape) * stored.itemsize > len(data) or len(shape) < 3 or math.prod(shape[3:]) != 1:
        raise ValueError(f"it announces {shape} values, and must hold one volume of three dimensions")
    unit = METRES.get(image.header.get_xyzt_units()[0])
    if unit is None and spacing is None:
        raise InputFileError(f"{path} does not say its unit of length: pass spacing=…, the metres between its values")
    values = np.asarray(image.dataobj, dtype=np.float32).reshape(shape[:3])
    if spacing is not None:
        return _evenly(path, values, spacing)
    return Volume(values, image.affine[:3, 3] * unit, image.affine[:3, :3].T * unit)


def _unpacked(data: bytes) -> bytes:
    try:
        with gzip.GzipFile(fileobj=BytesIO(data)) as packed:
            unpacked = packed.read(MOST_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise ValueError(f"it cannot be unpacked: {error}") from error
    if len(unpacked) > MOST_BYTES:
        raise ValueError(f"unpacked it has more than {MOST_BYTES} bytes")
    return unpacked


# DICOM


PLAIN = ("1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2")
"""Transfer syntaxes without compression: the announced size can be compared with the file's."""
SAME = (
    ("SeriesInstanceUID", "series"),
    ("Rows", "numbers of rows"),
    ("Columns", "numbers of columns"),
    ("PixelSpacing", "distances of pixels"),
    ("ImageOrientationPatient", "orientations"),
)


def _read_dicom(path: Path, _spacing: float | None) -> Volume:
    """The slices of a folder, in the order of their places; other files in it are ignored."""
    files = sorted(file for file in path.iterdir() if file.is_file() and file.name.upper() != "DICOMDIR")
    if len(files) > MOST_SLICES:
        raise ValueError(f"it has {len(files)} files; at most {MOST_SLICES} may be")
    pydicom = _needed(path, "pydicom", "pydicom")
    slices, left = [], MOST_BYTES
    for file in files:
        data = read_file(file, left)
        if data[128:132] == b"DICM":
            slices.append(_slice_in(pydicom, file, data))
            left -= len(data)
    if len(slices) < 2:
        raise ValueError(f"it has {len(slices)} slices in DICOM files; at least 2 are needed")
    for tag, what in SAME:
        if len(kinds := {str(getattr(piece, tag)) for piece in slices}) > 1:
            raise ValueError(f"its slices have {len(kinds)} different {what}; keep those of one series in it")
    first = slices[0]
    along, down = np.array(first.ImageOrientationPatient, dtype=np.float64).reshape(2, 3)
    places = np.array([piece.ImagePositionPatient for piece in slices], dtype=np.float64)
    heights = places @ np.cross(along, down)
    order = np.argsort(heights, kind="stable")
    steps = np.diff(heights[order])
    distance = float(np.median(steps))
    if not steps.min() > 0:
        raise ValueError("two of its slices lie at the same place")
    if (wrong := np.abs(steps - distance) > UNEVEN * distance).any():
        below, above = heights[order][np.argmax(wrong) : np.argmax(wrong) + 2]
        raise ValueError(
            f"its slices are {distance:g} mm apart, but {above - below:g} mm from {below:g} to {above:g} mm"
        )
    row_step, column_step = (float(step) for step in first.PixelSpacing)
    values = np.stack([_values_of(slices[which]) for which in order])
    between = (places[order[-1]] - places[order[0]]) / (len(slices) - 1)
    axes = np.array([between, down * row_step, along * column_step])
    return Volume(values, places[order[0]] / 1000, axes / 1000)


def _slice_in(pydicom: Any, file: Path, data: bytes) -> Any:
    """Read a slice and check that it has all that is needed."""
    syntax = pydicom.filereader.read_file_meta_info(file).get("TransferSyntaxUID")
    if syntax not in PLAIN:
        raise ValueError(f"{file.name} is compressed ({syntax}), which is not supported; save it uncompressed")
    piece = pydicom.dcmread(BytesIO(data))
    tags = ("ImagePositionPatient", "PixelData", *(tag for tag, _ in SAME))
    if missing := [tag for tag in tags if tag not in piece]:
        raise ValueError(f"{file.name} has no {missing[0]}")
    if piece.get("NumberOfFrames", 1) != 1 or piece.get("SamplesPerPixel", 1) != 1:
        raise ValueError(f"{file.name} has several frames or colours; slices of one are needed")
    return piece


def _values_of(piece: Any) -> NDArray[np.float32]:
    slope, intercept = float(getattr(piece, "RescaleSlope", 1)), float(getattr(piece, "RescaleIntercept", 0))
    values: NDArray[np.float32] = (piece.pixel_array * slope + intercept).astype(np.float32)
    return values


VOLUME_FILES: dict[str, tuple[str, Callable[[Path, float | None], Volume]]] = {
    ".npy": ("NPY file", _read_npy),
    ".npz": ("NPZ file", _read_npz),
    ".nii": ("NIfTI file", _read_nifti),
    ".nii.gz": ("NIfTI file", _read_nifti),
    "/": ("DICOM series", _read_dicom),
}
"""Kind of file and reader of each, by the suffix of its name; "/" is a folder."""
