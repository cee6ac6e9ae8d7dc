"""Frames and sources of frames: everything that can be played becomes pulses here, with the calibration applied.

A *frame* is `Pulses`, a `Solution`, or a drive, (n,) complex. A calibration corrects drives; pulses stay unchanged. A
*source* returns frames in turn; this module does not know when they are due, and does not send them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import real
from ...protocol.board import CARRIER_HZ
from ...protocol.pulses import Pulses
from ...protocol.quantise import PulseFrames, check_pulses, quantise
from ...protocol.replies import Info
from ...solver import Completion, ControlPoints, Cycle, Medium, Quieting, Solution, Solver, TransducerArray
from .calibration import Calibration
from .limiting import TurnedDown

__all__ = [
    "Frame",
    "FrameSource",
    "Frames",
    "LoopedFrames",
    "PulseFrames",
    "StoredFrames",
    "beginning",
    "checked_rate",
    "differences",
    "frame_source",
    "interpolated_frames",
    "limited_frames",
    "solved",
    "to_pulses",
]

NUMBERS = "iufc"  # kinds of types for drives
LEAST_RATE = 1e-3
"""Frames per second; a slower stream is mostly waiting."""

PERIODS_AT_A_TIME = 400
"""10 ms of interpolated frames: a slow source must not fill the memory."""
ROUNDING = 1e-9
"""Of frames: a rate that is no binary fraction must not lose one."""

Frame: TypeAlias = Pulses | Solution | NDArray[Any]
"""A frame: pulses, or a drive, (n,) complex of magnitude at most 1, alone or in a solution."""


@runtime_checkable
class StoredFrames(Protocol):
    """Pulses of stored frames, such as a `Recording`."""

    @property
    def channels(self) -> int:
        """The number of transducers."""

    def __len__(self) -> int: ...

    def read(self, start: int, stop: int) -> PulseFrames:
        """Frames from one number to before another."""


Frames: TypeAlias = NDArray[Any] | PulseFrames | StoredFrames | Iterable[Frame]
"""A source of a stream: drives (k, n), pulses of k frames, a recording, or frames one by one."""


class FrameSource(Protocol):
    """Frames in turn, as pulses."""

    ready: bool
    """Whether they are ready; otherwise each is made when it is taken, and better late than early."""

    def take(self, most: int) -> PulseFrames:
        """The next frames, at most so many; none at the end.

        Raises
        ------
        ValueError
            If an item is no frame; it is named by its number in the source, from 0.
        """


class LoopedFrames:
    """The frames of a cycle, again and again: `StoredFrames` that were quantised once.

    Parameters
    ----------
    cycle : Cycle
        A cycle of drives; its envelope is not applied.
    rate : float
        Frames per second.
    calibration : Calibration, optional
        The calibration of the device, applied to the drives.
    frames : int
        After which it ends.
    down : TurnedDown, optional
        How much a limit turns down what is emitted.

    Raises
    ------
    ValueError
        If a drive is beyond 1.
    """

    def __init__(
        self,
        cycle: Cycle,
        rate: float,
        calibration: Calibration | None = None,
        frames: int = sys.maxsize,
        down: TurnedDown | None = None,
    ) -> None:
        self._pulses = (down or TurnedDown(None)).pulses(cycle.drives, calibration)
        self._frames = frames
        self._cycle_frames_per_frame = cycle.carrier / rate / cycle.hold

    @property
    def channels(self) -> int:
        """The number of transducers."""
        return int(self._pulses.phase.shape[1])

    def __len__(self) -> int:
        return self._frames

    def read(self, start: int, stop: int) -> PulseFrames:
        """Frames from one number to before another."""
        passed = np.arange(start, min(stop, self._frames)) * self._cycle_frames_per_frame
        rows = np.floor(passed + ROUNDING).astype(np.int64) % len(self._pulses.phase)
        return PulseFrames(self._pulses.phase[rows], self._pulses.width[rows])


def checked_rate(rate: float) -> float:
    """A rate in frames per second; `ValueError` if no frames can be played at it."""
    return real("rate", rate, LEAST_RATE, unit="frames/s")


def differences(
    array: TransducerArray | None, medium: Medium | None, what: Info, rig: TransducerArray | None = None
) -> list[str]:
    """The differences between a device and what frames were made for, as far as that is known: they change the field.

    An array with another number of transducers is not reported: its frames are refused anyway. The transducers of a
    rig are where its description says.
    """
    found = []
    own = (TransducerArray.grid(what.columns, what.rows, what.pitch) if rig is None else rig).positions
    if array is not None and array.positions.shape == own.shape and not np.allclose(array.positions, own, atol=1e-6):
        places = f"{what.columns} × {what.rows} transducers, {what.pitch * 1e3:g} mm apart"
        found.append(f"the device has {places}" if rig is None else "the transducers of the rig are at other places")
    if medium is not None and medium.frequency != what.carrier_hz:
        found.append(f"the device's carrier has {what.carrier_hz} Hz, not {medium.frequency:g} Hz")
    return found


def to_pulses(frame: Frame, calibration: Calibration | None, channels: int) -> Pulses:
    """The pulses of one frame.

    Parameters
    ----------
    frame : Pulses, Solution or (n,) complex
        The frame to play.
    calibration : Calibration, optional
        The calibration of the device, applied to a drive.
    channels : int
        Transducers of the device.

    Raises
    ------
    ValueError
        If the frame is for another number of transducers, its drive is not finite or beyond 1, or a calibration would
        be applied to a solution for calibrated transducers.
    """
    if isinstance(frame, Pulses):
        if len(frame) != channels:
            raise ValueError(f"{len(frame)} pulses for a device with {channels} transducers")
        return frame
    drive = _drive(frame, calibration, channels)
    return Pulses.from_drive(drive if calibration is None else calibration.apply(drive))


def interpolated_frames(
    frames: Frames, rate: float, calibration: Calibration | None, down: TurnedDown
) -> Iterator[Pulses]:
    """Frames of drives, led over into each other: the pulses of every carrier period.

    Each frame is complete at the end of its time, phase by the shorter way, so it is late by as much. It begins in
    silence.

    Parameters
    ----------
    frames : Frames
        Frames of drives.
    rate : float
        Frames per second; each lasts the nearest whole number of carrier periods.
    calibration : Calibration, optional
        The calibration of the device.
    down : TurnedDown
        How much a limit turns down what is emitted.

    Raises
    ------
    ValueError
        If the frames hold pulses, or as `to_pulses`; the frame is named.
    """
    periods = max(round(CARRIER_HZ / rate), 1)
    quieting: Quieting | None = None
    for number, drive in _drives_of(frames):
        if quieting is None:
            quieting = Quieting(len(drive), Completion(periods, periods))
        for begin in range(0, periods, PERIODS_AT_A_TIME):
            count = min(PERIODS_AT_A_TIME, periods - begin)
            with _naming(number):
                led = quieting.follow(np.broadcast_to(drive.astype(np.complex64), (count, len(drive))))
                pulses = down.pulses(led, calibration)
            yield from (pulses.pulses(period) for period in range(count))


def limited_frames(frames: Frames, calibration: Calibration | None, down: TurnedDown) -> Iterator[Pulses]:
    """The pulses of frames of drives, turned down so far that each keeps a limit.

    Raises
    ------
    ValueError
        If the frames hold pulses, or as `to_pulses`; the frame is named.
    """
    for number, drive in _drives_of(frames):
        with _naming(number):
            pulses = down.pulses(drive[None], calibration)
        yield pulses.pulses(0)


def _drives_of(frames: Frames) -> Iterator[tuple[int, NDArray[np.complex128]]]:
    """Frames by their number, as drives, (n,)."""
    if isinstance(frames, PulseFrames | StoredFrames):
        raise ValueError("frames that hold pulses are played unchanged; only drives can be turned down or led over")
    for number, frame in enumerate(frames):
        with _naming(number):
            if isinstance(frame, Pulses):
                raise ValueError("pulses are played unchanged; only drives can be turned down or led over")
            yield number, np.asarray(frame.drive if isinstance(frame, Solution) else frame, np.complex128)


@contextmanager
def _naming(number: int) -> Iterator[None]:
    """Name the frame in a `ValueError`."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"frame {number}: {error}") from error


def solved(points: Iterable[ControlPoints], solver: Solver) -> Iterator[Solution]:
    """Frames from control points, each solved when it is taken.

    Raises
    ------
    ValueError
        If there is no solution for the points; the frame is named.
    """
    for number, frame in enumerate(points):
        try:
            solution = solver.solve(frame)
        except ValueError as error:
            raise ValueError(f"frame {number}: {error}") from error
        yield solution


def frame_source(source: Frames, calibration: Calibration | None, channels: int) -> FrameSource:
    """A source of pulses from any frames.

    Parameters
    ----------
    source : (k, n) complex, PulseFrames, Recording, or iterable of frames
        Arrays and recordings are read piece by piece, and never copied as a whole. A frame of an iterable is requested
        only when it is taken, so it may be endless, and make each frame at the last moment.
    calibration : Calibration, optional
        The calibration of the device, applied to drives.
    channels : int
        Transducers of the device.

    Raises
    ------
    ValueError
        If the source is none, or for another number of transducers.
    """
    if calibration is not None and len(calibration) != channels:
        raise ValueError(f"a calibration of {len(calibration)} transducers for a device with {channels}")
    if isinstance(source, StoredFrames):
        if source.channels != channels:
            raise ValueError(f"frames of {source.channels} transducers for a device with {channels}")
        return _Counted(len(source), source.read)
    if isinstance(source, PulseFrames):
        for name, values in source._asdict().items():
            _check_table(name, values, channels)
            if values.dtype != np.uint8:
                raise ValueError(f"{name} of frames must be uint8, not {values.dtype}")
        if len(source.phase) != len(source.width):
            raise ValueError(f"{len(source.phase)} frames of phases but {len(source.width)} of widths")
        return _Counted(len(source.phase), partial(_checked, source))
    if isinstance(source, np.ndarray) and source.dtype.kind in NUMBERS:
        _check_table("drives", source, channels)
        return _Counted(len(source), lambda start, stop: _quantised(source[start:stop], calibration, start))
    if isinstance(source, Pulses | Solution) or not isinstance(source, Iterable):
        raise ValueError(
            f"{type(source).__name__} is no source of frames; an array of drives (k, {channels}), PulseFrames, a "
            "recording, or an iterable of frames is one"
        )
    return _OneByOne(iter(source), calibration, channels)


class _Counted:
    """Frames that are ready; `read` makes pulses of those from one number to before another."""

    ready = True

    def __init__(self, frames: int, read: Callable[[int, int], PulseFrames]) -> None:
        self._frames, self._read = frames, read
        self._next = 0

    def take(self, most: int) -> PulseFrames:
        start, self._next = self._next, min(self._next + most, self._frames)
        return self._read(start, self._next)


class _OneByOne:
    """Frames that are made when they are requested."""

    ready = False

    def __init__(self, frames: Iterator[Frame], calibration: Calibration | None, channels: int) -> None:
        self._frames = enumerate(frames)
        self._calibration, self._channels = calibration, channels

    def take(self, most: int) -> PulseFrames:
        taken = [self._pulses(number, frame) for number, frame in islice(self._frames, most)]
        return PulseFrames.joined(taken, self._channels)

    def _pulses(self, number: int, frame: Frame) -> PulseFrames:
        try:
            if isinstance(frame, Pulses):
                pulses = to_pulses(frame, None, self._channels)
                return PulseFrames(pulses.phase[None], pulses.width[None])
            drive = _drive(frame, self._calibration, self._channels)
        except ValueError as error:
            raise ValueError(f"frame {number}: {error}") from error
        return _quantised(drive[None], self._calibration, number)


def _drive(frame: Solution | NDArray[Any], calibration: Calibration | None, channels: int) -> NDArray[Any]:
    """The drive of a frame other than pulses, (n,) complex."""
    if isinstance(frame, Solution):
        if calibration is not None and (frame.array.response != 1).any():
            raise ValueError(
                "this was solved for an array with responses of its own, which a calibration would correct again; "
                "leave one of the two out"
            )
        frame = frame.drive
    drive = np.asarray(frame)
    if drive.dtype.kind not in NUMBERS:
        raise ValueError(f"a frame is Pulses, a Solution, or a drive ({channels},) complex, not {type(frame).__name__}")
    if drive.shape != (channels,):
        raise ValueError(f"a drive of the shape {drive.shape} for a device with {channels} transducers")
    return drive


def _quantised(drives: NDArray[Any], calibration: Calibration | None, first: int) -> PulseFrames:
    """Pulses of (k, n) drives; the first has this number."""
    return quantise(drives if calibration is None else calibration.apply(drives, first), first=first)


def _checked(pulses: PulseFrames, start: int, stop: int) -> PulseFrames:
    """Those from one number to before another."""
    part = PulseFrames(pulses.phase[start:stop], pulses.width[start:stop])
    check_pulses(part, start)
    return part


def _check_table(name: str, values: NDArray[Any], channels: int) -> None:
    if values.ndim != 2 or values.shape[1] != channels:
        raise ValueError(f"{name} of frames must have the shape (k, {channels}), not {values.shape}")


def beginning(frames: Frames, count: int) -> Frames:
    """The first frames of a source, at most so many."""
    if isinstance(frames, PulseFrames):
        return PulseFrames(frames.phase[:count], frames.width[:count])
    if isinstance(frames, StoredFrames):
        return _Beginning(frames, count)
    if isinstance(frames, np.ndarray):
        return frames[:count]
    return islice(frames, count)


class _Beginning:
    """The first of stored frames."""

    def __init__(self, frames: StoredFrames, count: int) -> None:
        self._frames, self._count = frames, count

    @property
    def channels(self) -> int:
        return self._frames.channels

    def __len__(self) -> int:
        return min(len(self._frames), self._count)

    def read(self, start: int, stop: int) -> PulseFrames:
        return self._frames.read(start, min(stop, len(self)))
