"""Objects in volumes, such as those of computed tomography: the surface around all that is denser than a level.

NumPy arrays (NPY, NPZ), NIfTI files by nibabel, NRRD files by pynrrd and DICOM series by pydicom; marching cubes of
scikit-image. These libraries come with the extra ``volumes``.
"""

from __future__ import annotations

import gzip
import math
import re
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

from ...base.arguments import length, real, whole
from ...base.errors import InputFileError
from ...base.extras import install_command
from ...base.storage import FilePath, read_file
from ..archives import read_array, read_arrays
from ..contact.mesh import MOST_FACES, Mesh
from .mesh_files import LARGEST, mesh_of

__all__ = ["VOLUMES", "Volume", "read_volume", "read_volume_mesh", "volume_suffix"]

MOST_BYTES = 500_000_000
"""Of a volume, packed or not."""
MOST_VOXELS = 2**27
MOST_SLICES = 4096
MOST_LEVEL = 1e30
UNEVEN = 0.01
"""Largest difference between distances of slices, relative to the distance."""
VOLUMES = ".npy, .npz, .nii, .nii.gz, .nrrd and .dcm files, DICOMDIR, and folders with DICOM slices"
NRRD_TYPES = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "f4": ("float",),
    "f8": ("double",),
}
NRRD_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "μm": 1e-6}
METRES = {"meter": 1.0, "mm": 1e-3, "micron": 1e-6}


@dataclass(frozen=True, eq=False)
class Volume:
    """A grid of values in space.

    Parameters
    ----------
    values : (i, j, k) float
        Values in units of their own, at least 2 along each axis.
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

        `ValueError` if the level is not within the values, or the surface has more than `MOST_FACES` faces.
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
    series: str | int | None = None,
) -> Mesh:
    """Read the object in a volume: all that has values above a level.

    Its coordinates are those of the volume: a patient's in medical files, in metres; otherwise from the first value.

    Parameters
    ----------
    path : str or Path
        An NPY file; an NPZ file with one array of three dimensions, and if wanted its ``spacing`` in metres; a NIfTI
        file; an NRRD file with its data in it; or DICOM: a folder with slices, a file DICOMDIR, or a .dcm file of an
        enhanced object with several frames.
    level : float
        Level in the volume's units, which are Hounsfield's in a CT.
    spacing : float, optional
        Distance of neighbouring values, in metres, for a file that does not say it.
    step : int
        The surface is made from the means of as many values each way. Larger steps give fewer faces and less noise.
    status : function, optional
        Function that gets a line of text for each stage, for people who wait.
    series : str or int, optional
        The one of several: a DICOM series by its number, description or UID, or a volume of a NIfTI file from 0.

    Raises
    ------
    InputFileError
        If the file is damaged or of another kind, holds several volumes of which none is named, does not say its
        spacing, has no such level, or the library that reads it is not installed; the message names the file. If the
        surface is larger than `LARGEST`: its spacing is then in another unit.
    ValueError
        If the spacing is not positive, or the step is less than 1.
    OSError
        If it cannot be opened.
    """
    spacing = None if spacing is None else length("spacing", spacing)
    level, step = real("level", level, -MOST_LEVEL, MOST_LEVEL), whole("step", step, 1, MOST_VOXELS)
    path, tell = Path(path), status or (lambda _said: None)
    tell(f"reading {path}")
    volume = read_volume(path, spacing, None if series is None else str(series))
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


def read_volume(path: Path, spacing: float | None = None, series: str | None = None) -> Volume:
    """Read a volume; parameters and errors as `read_volume_mesh`."""
    if (suffix := volume_suffix(path)) is None:
        raise InputFileError(f"{path}: volumes are read from {VOLUMES}")
    kind, read = VOLUME_FILES[suffix]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read(path, spacing, series)
    except InputFileError:
        raise
    except Exception as error:  # on foreign bytes the libraries raise nearly anything, OSError without a number too
        if isinstance(error, OSError) and error.errno is not None:
            raise
        reason = str(error) if type(error) is ValueError else f"it is damaged ({type(error).__name__}: {error})"
        raise InputFileError(f"{path} cannot be used as a {kind}: {reason}") from error


def volume_suffix(path: Path) -> str | None:
    """The suffix of a volume's name, "/" if it is a folder without one or a DICOMDIR, None for any other file."""
    if path.name.upper() == "DICOMDIR":
        return "/"
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


def _read_npy(path: Path, spacing: float | None, _series: str | None) -> Volume:
    return _evenly(path, read_array(path), spacing)


def _read_npz(path: Path, spacing: float | None, _series: str | None) -> Volume:
    arrays = read_arrays(path)
    volumes = [name for name, values in arrays.items() if values.ndim == 3]
    if len(volumes) != 1:
        raise ValueError(f"it must have one array of three dimensions, and has {len(volumes)}")
    return _evenly(path, arrays[volumes[0]], arrays.get("spacing", spacing))


def _read_nifti(path: Path, spacing: float | None, series: str | None) -> Volume:
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
    count = math.prod(shape[3:])
    if math.prod(shape) * stored.itemsize > len(data) or len(shape) < 3 or count < 1:
        raise ValueError(f"it announces {shape} values, and must hold volumes of three dimensions")
    which = 0 if count == 1 and series is None else _whole(series)
    if not 0 <= which < count:
        raise InputFileError(f"{path} has {count} volumes: pass series=0 to {count - 1} for one of them")
    unit = METRES.get(image.header.get_xyzt_units()[0])
    if unit is None and spacing is None:
        raise InputFileError(f"{path} does not say its unit of length: pass spacing=…, the metres between its values")
    values = np.asarray(image.dataobj, dtype=np.float32).reshape(*shape[:3], count)[..., which]
    if spacing is not None:
        return _evenly(path, values, spacing)
    return Volume(values, image.affine[:3, 3] * unit, image.affine[:3, :3].T * unit)


def _whole(text: str | None) -> int:
    return int(text) if text is not None and text.isascii() and text.isdecimal() else -1


def _read_nrrd(path: Path, spacing: float | None, _series: str | None) -> Volume:
    """Its header is read by pynrrd; its data here, which pynrrd would unpack without a bound."""
    nrrd, stream = _needed(path, "nrrd", "pynrrd"), BytesIO(read_file(path, MOST_BYTES))
    header = nrrd.read_header(stream)
    if any(key in header for key in ("data file", "datafile", "line skip", "byte skip")):
        raise ValueError("its data are in another file, or do not follow its header; save it in one file")
    data, encoding = stream.read(), header["encoding"]
    if encoding in ("gz", "gzip"):
        data = _unpacked(data)
    elif encoding != "raw":
        raise ValueError(f"its encoding {encoding} is not supported; save it as gzip or raw")
    order = {"little": "<", "big": ">"}.get(header.get("endian", "little"), "=")
    sizes = [int(size) for size in header["sizes"]]
    kind = next(kind for kind, names in NRRD_TYPES.items() if header["type"] in names)
    stored = np.dtype(order + kind)
    if len(sizes) != 3 or stored.itemsize * math.prod(sizes) != len(data):
        raise ValueError(f"it announces {sizes} values of {stored}, and has {len(data)} bytes; it must hold one volume")
    values = np.frombuffer(data, stored).reshape(sizes, order="F")
    steps = header.get("space directions")
    if steps is None and "spacings" in header:
        steps = np.diag(header["spacings"])
    named = [str(unit).strip('"') for unit in header.get("space units", [])]
    unit = NRRD_METRES.get(named[0]) if named else 1e-3 if len(str(header.get("space", "")).split("-")) == 3 else None
    if spacing is not None or steps is None or unit is None:
        return _evenly(path, values, spacing)
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=np.float64)
    return Volume(values.astype(np.float32), origin * unit, np.asarray(steps, dtype=np.float64) * unit)


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
    ("Rows", "numbers of rows"),
    ("Columns", "numbers of columns"),
    ("PixelSpacing", "distances of pixels"),
    ("ImageOrientationPatient", "orientations"),
)


GROUPS = {
    "PixelSpacing": "PixelMeasuresSequence",
    "ImageOrientationPatient": "PlaneOrientationSequence",
    "ImagePositionPatient": "PlanePositionSequence",
    "RescaleSlope": "PixelValueTransformationSequence",
    "RescaleIntercept": "PixelValueTransformationSequence",
}
"""Where an enhanced object keeps what may differ from frame to frame."""


def _read_dicom(path: Path, _spacing: float | None, series: str | None) -> Volume:
    """The slices of a series, in the order of their places; files of other kinds are ignored."""
    pydicom = _needed(path, "pydicom", "pydicom")
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.is_file())
    directory = [file for file in files if file.name.upper() == "DICOMDIR"]
    files = [file for file in files if file not in directory]
    if not files and directory:
        files = _files_of(pydicom, directory[0])
    if len(files) > MOST_SLICES:
        raise ValueError(f"it has {len(files)} files; at most {MOST_SLICES} may be")
    every, left = [], MOST_BYTES
    for file in files:
        data = read_file(file, left)
        if data[128:132] == b"DICM":
            every += _slices_in(pydicom, file, data)
            left -= len(data)
    slices = _chosen(path, every, series)
    if len(slices) < 2:
        raise ValueError(f"it has {len(slices)} slices in DICOM files; at least 2 are needed: name their folder")
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
    values = np.stack([slices[which].values() for which in order])
    between = (places[order[-1]] - places[order[0]]) / (len(slices) - 1)
    axes = np.array([between, down * row_step, along * column_step])
    return Volume(values, places[order[0]] / 1000, axes / 1000)


def _files_of(pydicom: Any, directory: Path) -> list[Path]:
    """The files that a DICOMDIR names, in folders below its own."""
    listed = pydicom.dcmread(BytesIO(read_file(directory, MOST_BYTES))).DirectoryRecordSequence
    names = [record.ReferencedFileID for record in listed if record.get("ReferencedFileID")]
    parts = [[name] if isinstance(name, str) else list(name) for name in names]
    if wrong := [name for name in parts if not all(re.fullmatch(r"[\w-][\w.-]*", part) for part in name)]:
        raise ValueError(f"it names {wrong[0]}, which is no file below its folder")
    return [file for name in parts if (file := directory.parent.joinpath(*name)).is_file()]


def _chosen(path: Path, slices: list[_Slice], series: str | None) -> list[_Slice]:
    """The slices of the only series, or of the one that is named."""
    found: dict[str, list[_Slice]] = {}
    for piece in slices:
        found.setdefault(str(piece.SeriesInstanceUID), []).append(piece)
    if series is None and len(found) < 2:
        return slices
    fitting = [each for each in found.values() if series in each[0].names]
    if len(fitting) != 1:
        names = [" ".join(filter(None, each[0].names[:2])) or uid for uid, each in found.items()]
        known = "; ".join(f"{name} ({len(each)} slices)" for name, each in zip(names, found.values(), strict=True))
        raise InputFileError(
            f"{path} has {len(found)} series: {known}; pass one's number, description or UID as series=…"
        )
    return fitting[0]


class _Slice:
    """A frame of a DICOM object, with its place."""

    def __init__(self, name: str, piece: Any, frame: int) -> None:
        self._piece, self._frame = piece, frame
        shared, each = (piece.get(f"{kind}FunctionalGroupsSequence") for kind in ("Shared", "PerFrame"))
        self._groups = [each[frame]] if each else []
        self._groups += [shared[0]] if shared else []
        for tag in ("ImagePositionPatient", *(tag for tag, _ in SAME), "SeriesInstanceUID"):
            value = self._tag(tag)
            if value is None:
                raise ValueError(f"{name} has no {tag}")
            setattr(self, tag, value)
        self.names = [str(piece.get(tag, "")) for tag in ("SeriesNumber", "SeriesDescription", "SeriesInstanceUID")]

    def __getattr__(self, tag: str) -> Any:
        raise AttributeError(tag)

    def _tag(self, tag: str) -> Any:
        for group in self._groups:
            if GROUPS.get(tag) in group and tag in (inner := group[GROUPS[tag]][0]):
                return inner[tag].value
        return self._piece.get(tag)

    def values(self) -> NDArray[np.float32]:
        """(rows, columns) values in the series' units."""
        slope, intercept = (self._tag(tag) for tag in ("RescaleSlope", "RescaleIntercept"))
        pixels = self._piece.pixel_array
        if pixels.ndim == 3:
            pixels = pixels[self._frame]
        scaled: NDArray[np.float32] = (
            pixels * float(1 if slope is None else slope) + float(0 if intercept is None else intercept)
        ).astype(np.float32)
        return scaled


def _slices_in(pydicom: Any, file: Path, data: bytes) -> list[_Slice]:
    """Read the slices of a file and check that it has all that is needed."""
    syntax = pydicom.filereader.read_file_meta_info(file).get("TransferSyntaxUID")
    if syntax not in PLAIN:
        raise ValueError(f"{file.name} is compressed ({syntax}), which is not supported; save it uncompressed")
    piece = pydicom.dcmread(BytesIO(data))
    frames = int(piece.get("NumberOfFrames", 1))
    if "PixelData" not in piece:
        raise ValueError(f"{file.name} has no PixelData")
    if piece.get("SamplesPerPixel", 1) != 1:
        raise ValueError(f"{file.name} has colours; slices without are needed")
    placed = len(piece.get("PerFrameFunctionalGroupsSequence", ()))
    if not 1 <= frames <= MOST_SLICES or (frames > 1 and placed != frames):
        raise ValueError(f"{file.name} has {frames} frames, and does not say where each of them lies")
    return [_Slice(file.name, piece, frame) for frame in range(frames)]


VOLUME_FILES: dict[str, tuple[str, Callable[[Path, float | None, str | None], Volume]]] = {
    ".npy": ("NPY file", _read_npy),
    ".npz": ("NPZ file", _read_npz),
    ".nii": ("NIfTI file", _read_nifti),
    ".nii.gz": ("NIfTI file", _read_nifti),
    ".nrrd": ("NRRD file", _read_nrrd),
    ".dcm": ("DICOM series", _read_dicom),
    "/": ("DICOM series", _read_dicom),
}
"""Kind of file and reader of each, by the suffix of its name; "/" is a folder."""
