"""Takes snapshots of a device that plays, as seldom as a view needs them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DeviceError
from ..emulator import Capture, Emulator
from ..host import Device
from ..host.touching.loop import TouchLoop, TouchMoment
from ..host.touching.report import TouchReport
from ..host.touching.turns import Alternation
from ..protocol.board import BOARDS, PROCESSORS_PER_BOARD, TICKS_PER_PERIOD
from ..protocol.codes import Feature
from ..protocol.plain import flag_names
from ..protocol.replies import Status
from ..solver import TransducerArray
from .newest import NewestTask
from .snapshot import Emitter, PlayedPose, Snapshot, Waves
from .view import View

__all__ = ["BITS", "EXACT", "Tap", "emitter_of"]

RATE, READ_BACK_RATE = 40.0, 5.0
"""Snapshots per second: of an emulated device, whose bits are in this process, and of another, which must be asked."""
REPORT_SECONDS = 0.5
WAVE_PERIODS = 3
STRONGEST_PERIODS, STRONGEST_STEP = 200, 10
"""Of a field that the device modulates, the strongest of these periods is shown."""
TURNS_BACK = 4
"""Turns before the one that plays in which the fields of a moment are looked for."""
MOST_POSES = 16
POSE_SECONDS = 0.5
"""For which the last moment that was played completely stays the one to compare."""
SAME = 1e-3
"""Greatest difference of two drives of the same pulse; a tick more or less changes a drive by more."""
PARTS = "no moment is played completely: points are fading, hands move too fast, or a fault changes what plays"
PARTS_READ = "the device is read back one field at a time, and the fields read are not of one moment"
BITS, READ_BACK = "bits of the emulated boards", "pulses read back from the device"
EXACT = "bits of the emulated boards in this period alone"
STARTING, UNREADABLE = "the device is starting", "the device cannot be read back"


def emitter_of(device: Device, array: TransducerArray) -> Emitter:
    """What a view shows of a device with an array."""
    return Emitter(array, device.name, device.wiring(), device.calibration)


class Tap:
    """Shows on a view what a device emits, in a ``with`` statement.

    Call its methods in the playing thread. There it only takes a capture of ``emulator``, the device if it is emulated
    in this process; its bits are what is shown then. Its own thread makes the snapshot, and asks a device that is not
    emulated. ``figures`` are label and value of what the page shows about the playing, beside the device's state.
    """

    def __init__(self, device: Device, view: View, emulator: Emulator | None = None) -> None:
        self._device, self._view, self._emulator = device, view, emulator
        self._silence = np.zeros((1, len(view.emitter.array)), np.complex64)
        self._gap = 1 / (READ_BACK_RATE if emulator is None else RATE)
        self._taken = self._asked = self._counted = -inf
        self._boards: tuple[str, ...] = ("",) * BOARDS
        self._injected: dict[int, tuple[str, float]] = {}
        """Of each board the last fault that was injected, and until when by the device's time."""
        self._status: Status | None = None
        self._turns: Alternation | None = None
        self._halves: dict[int, NDArray[np.complex128]] = {}
        """Of a device that is not emulated: both fields, as they were last read."""
        self._poses: deque[PlayedPose] = deque(maxlen=MOST_POSES)
        """What was solved for the last moments; their drives are not known yet."""
        self._whole: tuple[float, PlayedPose] | None = None
        """The last moment that was seen to be played completely, and when."""
        self.figures: tuple[tuple[str, str], ...] = ()

    def __enter__(self) -> Self:
        self._task = NewestTask("phasewire tap", self._say)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Show what was taken last, and end."""
        self._task.close()

    def _say(self, error: Exception) -> None:
        self._view.say(f"the device is not shown: {error}", error=True)

    @property
    def due(self) -> bool:
        """Whether the view needs another snapshot."""
        return self._view.server.pages > 0 and time.monotonic() - self._taken >= self._gap

    def take(self, turns: Alternation | None = None, **seen: Any) -> None:
        """Show a snapshot of this moment, with other fields of `Snapshot`; ``turns`` says how fields take turns."""
        self._take(turns, lambda: seen)

    def take_moment(self, moment: TouchMoment, loop: TouchLoop) -> None:
        """Show what hands touch and what a loop plays for it, if it is time."""
        if moment.cycle is not None:
            self._poses.append(PlayedPose(moment.fading, self._silence, loop.method, moment.cycle.frames, loop.gains))
        if self.due:
            self._take(loop.alternation, partial(self._touched, moment, loop))

    def inject(self, board: int, fault: str, seconds: float) -> None:
        """Name a fault that was injected at its board: the device does not know of which board a fault is."""
        self._injected[board] = fault, self._device.time.monotonic() + seconds

    def _take(self, turns: Alternation | None, seen: Callable[[], dict[str, Any]]) -> None:
        self._taken = time.monotonic()
        poses = tuple(reversed(self._poses))
        if self._emulator is None:
            self._task.offer(lambda: self._ask(turns, poses, seen()))
        else:
            if self._report_is_due():
                self._report()  # in this thread: a transfer lets the device's time pass
            capture = self._capture()
            self._task.offer(lambda: self._show(capture, turns, poses, seen()))

    def _capture(self) -> Capture | None:
        """What the outputs of an emulated device did; None while it starts."""
        assert self._emulator is not None
        try:
            capture = self._emulator.capture()
        except ValueError:
            return None
        return capture if capture.periods - 1 > capture.start_tick // TICKS_PER_PERIOD else None

    def _report_is_due(self) -> bool:
        if (now := time.monotonic()) - self._asked < REPORT_SECONDS:
            return False
        self._asked = now
        return True

    def _report(self) -> None:
        """Ask the device what is wrong with it."""
        try:
            self._status = self._device.status()
            reports = self._device.processors()
        except DeviceError:
            return  # the playing thread reports it
        now = self._device.time.monotonic()
        said = [
            "not there" if report.bank is None else flag_names(report.faults) if report.faults else ""
            for report in reports
        ]
        self._boards = tuple(
            ", ".join(
                dict.fromkeys(filter(None, (*said[first : first + PROCESSORS_PER_BOARD], self._fault(board, now))))
            )
            for board, first in enumerate(range(0, len(said), PROCESSORS_PER_BOARD))
        )

    def _fault(self, board: int, now: float) -> str:
        """The fault that was injected into a board, if it lasts."""
        fault, until = self._injected.get(board, ("", -inf))
        return fault if now < until else ""

    # In the tap's own thread

    def _touched(self, moment: TouchMoment, loop: TouchLoop) -> dict[str, Any]:
        """What a moment of touch adds to a snapshot."""
        if (now := time.monotonic()) - self._counted >= REPORT_SECONDS:
            self._counted = now
            self.figures = touch_figures(loop.report)
        fading = moment.fading
        points = np.empty((0, 4))
        if len(fading):
            points = np.column_stack([fading.positions, fading.amplitudes * fading.levels])
        return {
            "hands": moment.hands,
            "objects": moment.objects,
            "points": points,
            "ids": fading.ids,
            "arcs": moment.touch.arcs,
        }

    def _ask(self, turns: Alternation | None, poses: Sequence[PlayedPose], seen: dict[str, Any]) -> None:
        """Show what a device that is not emulated says of itself."""
        if self._report_is_due():
            self._report()
        drives, period, source = self._read_back(turns)
        whole = self._newest_whole(poses, list(self._halves.items()), PARTS_READ)
        self._view.show(Snapshot(drives, period, **{"source": source, "whole": whole} | self._with_state(seen)))

    def _read_back(self, turns: Alternation | None) -> tuple[NDArray[Any], int, str]:
        """What a device says that it plays: fields, the period, and where they come from.

        Of two fields one plays; the other is shown as it was last read, as soon as it was. Of more the one that plays
        is shown.
        """
        if Feature.READ_BACK not in self._device.info.features:
            return self._silence, 0, UNREADABLE
        try:
            read = self._device.read_back()
        except DeviceError:
            return self._silence, 0, UNREADABLE
        drive = read.pulses.to_drive()
        if turns is None or turns != self._turns or not drive.any():
            self._halves.clear()
        self._turns = turns
        if turns is not None and turns.count == 2:
            self._halves[turns.number(read.read_period)] = drive
        both = [self._halves[number] for number in range(2)] if len(self._halves) == 2 else [drive]
        return np.stack(both), read.read_period, READ_BACK

    def _newest_whole(
        self, poses: Sequence[PlayedPose], plays: list[tuple[int, NDArray[Any]]], why: str
    ) -> PlayedPose | str:
        """The newest moment of which all fields have been played, or ``why`` there is none.

        ``poses`` are what was solved for the last moments, and ``plays`` what was emitted last: the number of the field
        in its cycle, and its drives (n,); the newest first in both.
        """
        for pose in poses:
            if (drives := _played(pose, plays)) is not None:
                self._whole = time.monotonic(), pose._replace(drives=drives)
                break
        if self._whole is None or time.monotonic() - self._whole[0] > POSE_SECONDS:
            return why
        return self._whole[1]

    def _show(
        self, capture: Capture | None, turns: Alternation | None, poses: Sequence[PlayedPose], seen: dict[str, Any]
    ) -> None:
        """Show what an emulated device has played."""
        seen = self._with_state(seen)
        if capture is None:
            self._view.show(Snapshot(self._silence, **{"state": "waiting"} | seen | {"source": STARTING}))
            return
        last = capture.periods - 1
        waves, whole = self._waves(capture, last + 1), None
        if turns is None:
            drives = _strongest(capture, last)
        else:
            plays = _plays(capture, last, turns)
            drives = _fields(plays, turns.count)
            whole = self._newest_whole(poses, plays, PARTS)
        self._view.show(Snapshot(drives, last, **{"source": BITS, "waves": waves, "whole": whole} | seen))
        at = self._view.settings.at
        kept = range(-(-capture.start_tick // TICKS_PER_PERIOD), capture.periods)
        if at is not None and at in kept and (near := self._view.was(at)) is not None:
            waves = self._waves(capture, at + 1)
            self._view.show_past(replace(near, drives=capture.drives(at, at + 1), period=at, waves=waves, source=EXACT))

    def _waves(self, capture: Capture, end: int) -> Waves | None:
        """The waves of the watched transducers in the periods before one."""
        watched, first = self._view.settings.watched, (end - WAVE_PERIODS) * TICKS_PER_PERIOD
        if not watched or first < capture.start_tick:
            return None
        bits = capture.channels(first, end * TICKS_PER_PERIOD)
        return Waves(watched, first, bits[:, capture.wiring.channels[list(watched)]])

    def _with_state(self, seen: dict[str, Any]) -> dict[str, Any]:
        figures = self.figures if self._status is None else (*self.figures, *_state_figures(self._status))
        return seen | {"figures": figures, "boards": self._boards}


def _strongest(capture: Capture, last: int) -> NDArray[np.complex64]:
    """The strongest field up to a period, (1, n)."""
    begin = -(-capture.start_tick // TICKS_PER_PERIOD)
    recent: NDArray[np.complex64] = capture.drives(max(begin, last + 1 - STRONGEST_PERIODS), last + 1)
    recent = recent[::-STRONGEST_STEP]
    return np.asarray(recent[np.abs(recent).sum(axis=1).argmax()][None])


def _plays(capture: Capture, last: int, turns: Alternation) -> list[tuple[int, NDArray[np.complex64]]]:
    """What was emitted in a period and at the end of each of some turns before it, the newest first.

    Each is the number of its field, and its drives, (n,).
    """
    begin = -(-capture.start_tick // TICKS_PER_PERIOD)
    ended = last - (last - turns.begins) % turns.hold - 1
    periods = [last, *(ended - number * turns.hold for number in range(max(TURNS_BACK, turns.count - 1)))]
    return [
        (turns.number(period), capture.drives(period, period + 1)[0])
        for period in (max(begin, each) for each in periods)
    ]


def _fields(plays: list[tuple[int, NDArray[Any]]], count: int) -> NDArray[Any]:
    """Each of so many fields in turn when it played last, (count, n)."""
    newest = dict(reversed(plays))
    return np.stack([newest.get(number, plays[-1][1]) for number in range(count)])


def _played(pose: PlayedPose, plays: list[tuple[int, NDArray[Any]]]) -> NDArray[Any] | None:
    """The emitted drives of all fields of a pose, (k, n); None if one of them was not played."""
    assert pose.solved is not None
    found = []
    for number in range(len(pose.solved.phase)):
        sent = pose.solved.pulses(number).to_drive()
        drive = next((each for which, each in plays if which == number and np.abs(each - sent).max() < SAME), None)
        if drive is None:
            return None
        found.append(drive)
    return np.stack(found)


def touch_figures(report: TouchReport) -> tuple[tuple[str, str], ...]:
    """The figures of a loop of touch, for the page."""
    return (
        ("Hand frames", f"{report.rate:.0f}/s"),
        ("Latency", str(report.latency) if report.latency.count else "–"),
        ("Late blocks", str(report.late)),
        ("Turns slipped", str(report.slipped)),
        ("Frames dropped", str(report.dropped)),
        ("Frames stale", str(report.stale)),
        ("Held up", str(report.held_up)),
    )


def _state_figures(status: Status) -> tuple[tuple[str, str], ...]:
    return (
        ("Device", status.state.name.lower()),
        ("Faults", flag_names(status.faults) if status.faults else "none"),
        ("Blocks", f"{status.accepted} accepted, {status.refused} refused, {status.late} late"),
        ("Missed commits", str(status.missed_commits)),
        ("Temperature", f"{status.temperature_c} °C"),
    )
