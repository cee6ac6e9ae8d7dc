"""Recordings: frames of pulses in an HDF5 file, with all that is needed to play them again and to tell what they were.

A recording holds pulses, not drives: what is played from it is bit by bit what would have been played when it was made,
and no calibration is applied again. Any program that reads HDF5 can read it: the datasets ``phase`` and ``width`` are
(k, n) uint8, in half ticks and ticks; ``positions`` and ``normals``, (n, 3), are the array's, in metres; the group
``calibration`` holds what was applied, if anything; attributes say the rest by their names. All of it has checksums.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import InputFileError
from ...protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from ...protocol.quantise import PulseFrames, check_pulses
from ...solver import Medium, TransducerArray
from ...storage import replacing
from .calibration import Calibration
from .frames import Frames, frame_source

__all__ = ["SUFFIX", "Recording", "record"]

SUFFIX = ".h5"
FORMAT = "phasewire-recording-1"
CLOCK = {"carrier_hz": CARRIER_HZ, "ticks_per_period": TICKS_PER_PERIOD}
CHUNK_FRAMES = 256
"""Frames that are compressed together and read at once: 6 ms of them at the highest rate."""
MOST_FRAMES = 2**40
HDF5_VERSION = ("v110", "v110")  # from which on metadata have checksums


def record(
    path: Path,
    frames: Frames,
    rate: float,
    *,
    array: TransducerArray | None = None,
    medium: Medium | None = None,
    calibration: Calibration | None = None,
    source: str = "",
) -> int:
    """Write frames to a file, whole or not at all, as they come; the memory that it takes does not grow with them.

    Parameters
    ----------
    path : Path
        The file, by custom with the suffix `SUFFIX`.
    frames : (k, n) complex, PulseFrames, Recording, or iterable of frames
        What to record, see `frame_source`; it must have an end.
    rate : float
        Frames per second.
    array : TransducerArray, optional
        The n transducers; the default grid by default.
    medium : Medium, optional
        The air for which the frames were made; 20 °C by default.
    calibration : Calibration, optional
        To be applied to frames that come as drives.
    source : str
        Where the frames come from, for people.

    Returns
    -------
    int
        How many frames there were.

    Raises
    ------
    ValueError
        Where the rate is not positive and finite, or a frame is none.
    OSError
        Where the file cannot be written, or stands for something else than a file.
    """
    import h5py

    if not 0 < rate < np.inf:
        raise ValueError(f"a rate of {rate:g} frames/s must be positive and finite")
    if path.exists() and not path.is_file():
        raise OSError(f"{path} cannot be written: a recording must be a plain file")
    array, medium = array or TransducerArray.grid(), medium or Medium()
    pulses = frame_source(frames, calibration, len(array))
    written = 0
    with replacing(path) as part, h5py.File(part, "w", libver=HDF5_VERSION) as file:
        for name, text in (("format", FORMAT), ("source", source), ("made_by", f"phasewire {version('phasewire')}")):
            octets = text.encode()  # of fixed length, as others would stand where no checksum reaches
            file.attrs.create(name, octets, dtype=h5py.string_dtype("utf-8", max(len(octets), 1)))
        file.attrs.update(CLOCK, rate_hz=float(rate))
        _write_table(file, "positions", array.positions)
        _write_table(file, "normals", array.normals)
        file.create_group("medium").attrs.update(asdict(medium))
        if calibration is not None:
            for field in fields(calibration):
                _write_table(file.require_group("calibration"), field.name, getattr(calibration, field.name))
        rows = [_growing(file, name, len(array)) for name in PulseFrames._fields]
        while len((taken := pulses.take(CHUNK_FRAMES)).phase):
            end = written + len(taken.phase)
            for dataset, values in zip(rows, taken, strict=True):
                dataset.resize(end, axis=0)
                dataset[written:] = values
            written = end
    return written


def _write_table(group: Any, name: str, values: NDArray[Any]) -> None:
    group.create_dataset(name, data=values, chunks=values.shape, fletcher32=True)


def _growing(file: Any, name: str, channels: int) -> Any:
    return file.create_dataset(
        name,
        shape=(0, channels),
        maxshape=(None, channels),
        chunks=(CHUNK_FRAMES, channels),
        dtype=np.uint8,
        compression="gzip",
        fletcher32=True,
    )


class Recording:
    """A recording that is open for reading. Frames are read as they are asked for, some hundred at a time.

    `Recording.open` opens one; use it in a ``with`` statement. `frame_source` takes it as it is.

    Attributes
    ----------
    rate : float
        Frames per second.
    array : TransducerArray
        Positions and normals of the transducers, in metres.
    medium : Medium
        The air for which the frames were made.
    calibration : Calibration or None
        What was applied to those frames that came as drives.
    source : str
        Where the frames came from, for people.
    made_by : str
        Program and version.
    """

    def __init__(self, path: Path, file: Any) -> None:
        self._path, self._file = path, file
        if file.attrs.get("format") != FORMAT.encode():
            raise InputFileError(f"{path} is not a recording; `phasewire record` makes one")
        for name, own in CLOCK.items():
            if file.attrs[name] != own:
                raise InputFileError(f"{path} was made for a device of {name} {file.attrs[name]}; here it is {own}")
        self.rate = float(file.attrs["rate_hz"])
        if not 0 < self.rate < np.inf:
            raise ValueError(f"its rate is {self.rate:g} frames/s")
        self.source, self.made_by = (file.attrs[name].decode() for name in ("source", "made_by"))
        self._rows = [file[name] for name in PulseFrames._fields]
        self._frames, self.channels = shape = self._rows[0].shape
        if any(rows.shape != shape or rows.dtype != np.uint8 for rows in self._rows) or self._frames > MOST_FRAMES:
            raise ValueError("its pulses are no tables of bytes of one shape")
        positions, normals = (_table(file, name, (self.channels, 3)) for name in ("positions", "normals"))
        self.array = TransducerArray(positions, normals)
        air = file["medium"].attrs
        self.medium = Medium(**{field.name: air[field.name].item() for field in fields(Medium)})
        self.calibration: Calibration | None = None
        if "calibration" in file:
            columns = [_table(file["calibration"], field.name, (self.channels,)) for field in fields(Calibration)]
            self.calibration = Calibration(*columns)
        self._begin, self._chunk = -1, PulseFrames.joined([], self.channels)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open a recording.

        Raises
        ------
        InputFileError
            Where the file is truncated, corrupted or no recording.
        OSError
            Where it cannot be opened.
        """
        import h5py

        with path.open("rb"):  # so that a missing file is not taken for a bad one
            pass
        with _blamed(path):
            file = h5py.File(path, "r")
            try:
                return cls(path, file)
            except BaseException:
                file.close()
                raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __len__(self) -> int:
        return int(self._frames)

    @property
    def seconds(self) -> float:
        """How long it plays at its own rate."""
        return len(self) / self.rate

    def read(self, start: int, stop: int) -> PulseFrames:
        """Frames from one number to before another, as far as there are any.

        Raises
        ------
        InputFileError
            Where the file is damaged there.
        ValueError
            Where it has been closed.
        """
        if not self._file:
            raise ValueError(f"{self._path} is closed; open it again")
        parts, wanted = [], range(len(self))[start:stop]
        at = wanted.start
        while at < wanted.stop:
            begin = at - at % CHUNK_FRAMES
            end = min(wanted.stop, begin + CHUNK_FRAMES)
            parts.append(PulseFrames(*(values[at - begin : end - begin] for values in self._chunk_at(begin))))
            at = end
        return PulseFrames.joined(parts, self.channels)

    def _chunk_at(self, begin: int) -> PulseFrames:
        if begin != self._begin:
            with _blamed(self._path):
                chunk = PulseFrames(*(rows[begin : begin + CHUNK_FRAMES] for rows in self._rows))
                check_pulses(chunk, begin)
            self._begin, self._chunk = begin, chunk
        return self._chunk


@contextmanager
def _blamed(path: Path) -> Iterator[None]:
    """Turn what reading a damaged or foreign file raises, which is nearly anything, into `InputFileError`."""
    try:
        yield
    except InputFileError:
        raise
    except Exception as error:
        raise InputFileError(f"{path} is truncated, corrupted or no recording: {error}") from error


def _table(group: Any, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    dataset = group[name]
    if dataset.shape != shape:
        raise ValueError(f"{name} has the shape {dataset.shape}, not {shape}")
    return np.asarray(dataset[...])
