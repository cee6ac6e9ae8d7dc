"""Takes snapshots of a device that plays, as seldom as a view needs them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import inf
from threading import Event, Thread
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..emulator import Capture, Emulator
from ..errors import DeviceError, DeviceStalledError
from ..host import Device
from ..host.touching.loop import TouchLoop, TouchMoment
from ..host.touching.report import TouchReport
from ..protocol.board import BOARDS, PROCESSORS_PER_BOARD, TICKS_PER_PERIOD
from ..protocol.plain import flag_names
from ..protocol.replies import Status
from .snapshot import Rig, Snapshot, Waves
from .view import View

__all__ = ["BITS", "EXACT", "Tap", "rig_of"]

RATE, READ_BACK_RATE = 40.0, 5.0
"""Snapshots per second: of an emulated device, whose bits are in this process, and of another, which must be asked."""
REPORT_SECONDS = 0.5
WAVE_PERIODS = 3
STRONGEST_PERIODS, STRONGEST_STEP = 200, 10
"""Of a field that the device modulates, the strongest of these periods is shown."""
BITS, READ_BACK = "bits of the emulated boards", "pulses read back from the device"
EXACT = "bits of the emulated boards in this period alone"


def rig_of(device: Device, array: Any) -> Rig:
    """What a view shows of a device with an array."""
    return Rig(array, device.name, device.wiring(), device.calibration)


class Tap:
    """Shows on a view what a device emits, in a ``with`` statement.

    The thread that plays gives away what only it can: of an emulated device a capture, whose time stands still
    meanwhile. A thread of the tap makes a snapshot of it, or asks a device that is not emulated.

    Parameters
    ----------
    device : Device
        That plays.
    view : View
        Shows it.
    emulator : Emulator, optional
        The device, if it is emulated in this process; its bits are what is shown then.
    """

    def __init__(self, device: Device, view: View, emulator: Emulator | None = None) -> None:
        self._device, self._view, self._emulator = device, view, emulator
        self._gap = 1 / (READ_BACK_RATE if emulator is None else RATE)
        self._taken = self._asked = self._counted = -inf
        self._boards: tuple[str, ...] = ("",) * BOARDS
        self.injected: dict[int, str] = {}
        """Faults that were injected into boards: the device does not know of which board a fault is."""
        self._status: Status | None = None
        self._halves: dict[int, NDArray[np.complex128]] = {}
        self.figures: tuple[tuple[str, str], ...] = ()
        """Label and value of what else the page shows about the playing."""
        self._newest: Callable[[], None] | None = None
        self._changed, self._closing = Event(), Event()
        self._thread = Thread(target=self._work, name="phasewire tap", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Show what was taken last, and end."""
        self._closing.set()
        self._changed.set()
        self._thread.join()

    @property
    def due(self) -> bool:
        """Whether the view needs another snapshot."""
        return self._view.server.pages > 0 and time.monotonic() - self._taken >= self._gap

    def take(self, half: int | None = None, origin: int = 0, **seen: Any) -> None:
        """Show a snapshot of this moment. It is to be called in the thread that plays.

        Parameters
        ----------
        half : int, optional
            Two fields take turns, each for so many carrier periods; by default there is one.
        origin : int
            A period at which the first of the two begins.
        **seen
            What else `Snapshot` has.
        """
        self._take(half, origin, lambda: seen)

    def take_moment(self, moment: TouchMoment, loop: TouchLoop) -> None:
        """Show what hands touch and what a loop plays for it, if it is time."""
        if self.due:
            self._take(loop.half_periods, 0, partial(self._touched, moment, loop))

    def _take(self, half: int | None, origin: int, seen: Callable[[], dict[str, Any]]) -> None:
        self._taken = time.monotonic()
        if self._emulator is None:
            self._newest = lambda: self._ask(half, origin, seen())
        else:
            if self._report_is_due():
                self._report()  # in this thread: a transfer lets the device's time pass
            capture = self._capture()
            self._newest = lambda: self._show(capture, half, origin, seen())
        self._changed.set()

    def _touched(self, moment: TouchMoment, loop: TouchLoop) -> dict[str, Any]:
        """What a moment of touch adds to a snapshot."""
        if (now := time.monotonic()) - self._counted >= REPORT_SECONDS:
            self._counted = now
            self.figures = touch_line(loop.report)
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

    # In the tap's own thread

    def _work(self) -> None:
        """Make a snapshot of what was taken last, again and again."""
        while not self._closing.is_set():
            self._changed.wait()
            self._changed.clear()
            newest, self._newest = self._newest, None
            if newest is not None:
                try:
                    newest()
                except DeviceError:
                    continue  # whoever plays on it says so

    def _ask(self, half: int | None, origin: int, seen: dict[str, Any]) -> None:
        """Show what a device that is not emulated says of itself."""
        if self._report_is_due():
            self._report()
        self._view.show(self._read_back(half, origin, self._with_state(seen)))

    def _show(self, capture: Capture | None, half: int | None, origin: int, seen: dict[str, Any]) -> None:
        """Show what an emulated device has played."""
        seen = self._with_state(seen)
        if capture is None:
            self._view.show(
                Snapshot(self._silence(), **seen | {"origin": "the device is starting", "state": "waiting"})
            )
            return
        self._view.show(self._captured(capture, capture.periods - 1, half, origin, seen))
        at = self._view.settings.at
        if (
            at is not None
            and (near := self._view.was(at)) is not None
            and capture.start_tick <= at * TICKS_PER_PERIOD <= capture.end_tick - TICKS_PER_PERIOD
        ):
            waves = _waves(self._view, capture, at + 1)
            self._view.show_past(replace(near, drives=capture.drives(at, at + 1), period=at, waves=waves, origin=EXACT))

    def _with_state(self, seen: dict[str, Any]) -> dict[str, Any]:
        return seen | {"line": (*self.figures, *self._state_line()), "boards": self._boards}

    def _report_is_due(self) -> bool:
        if (now := time.monotonic()) - self._asked < REPORT_SECONDS:
            return False
        self._asked = now
        return True

    def _capture(self) -> Capture | None:
        assert self._emulator is not None
        try:
            capture = self._emulator.capture()
        except ValueError:  # it restarts
            return None
        return capture if capture.periods - 1 > capture.start_tick // TICKS_PER_PERIOD else None

    def _captured(self, capture: Capture, last: int, half: int | None, origin: int, seen: dict[str, Any]) -> Snapshot:
        begin = -(-capture.start_tick // TICKS_PER_PERIOD)
        if half is None:
            recent = capture.drives(max(begin, last + 1 - STRONGEST_PERIODS), last + 1)[::-STRONGEST_STEP]
            drives = recent[np.abs(recent).sum(axis=1).argmax()][None]
        else:
            turn, passed = divmod(last - origin, half)
            before = max(begin, last - passed - 1)
            pair = [capture.drives(period, period + 1)[0] for period in (last, before)]
            drives = np.stack(pair if turn % 2 == 0 else pair[::-1])
        waves = _waves(self._view, capture, last + 1)
        return Snapshot(drives, last, **{"origin": BITS, "waves": waves} | seen)

    def _read_back(self, half: int | None, origin: int, seen: dict[str, Any]) -> Snapshot:
        """What the device says that it plays; of two fields the one that plays, and the other as it was last read."""
        try:
            read = self._device.read_back()
        except DeviceStalledError:  # it has no such request in its state
            return Snapshot(self._silence(), **{"origin": "not readable"} | seen)
        drive = read.pulses.to_drive()
        if half is None:
            return Snapshot(drive[None], read.read_period, **{"origin": READ_BACK} | seen)
        self._halves[(read.read_period - origin) // half % 2] = drive
        pair = np.stack([self._halves.get(number, drive) for number in range(2)])
        return Snapshot(pair, read.read_period, **{"origin": READ_BACK} | seen)

    def _silence(self) -> NDArray[np.complex64]:
        return np.zeros((1, len(self._view.rig.array)), np.complex64)

    def _report(self) -> None:
        """Ask the device what is wrong with it."""
        try:
            self._status = self._device.status()
            reports = self._device.processors()
        except DeviceError:
            return  # whoever plays on it will say so
        said = [
            "not there" if report.bank is None else flag_names(report.faults) if report.faults else ""
            for report in reports
        ]
        boards = [said[first : first + PROCESSORS_PER_BOARD] for first in range(0, len(said), PROCESSORS_PER_BOARD)]
        self._boards = tuple(
            ", ".join(dict.fromkeys(filter(None, (*board, self.injected.get(number)))))
            for number, board in enumerate(boards)
        )

    def _state_line(self) -> tuple[tuple[str, str], ...]:
        if self._status is None:
            return ()
        status = self._status
        faults = flag_names(status.faults) if status.faults else "none"
        return (
            ("Device", status.state.name.lower()),
            ("Faults", faults),
            ("Blocks", f"{status.accepted} accepted, {status.refused} refused, {status.late} late"),
            ("Missed commits", str(status.missed_commits)),
            ("Temperature", f"{status.temperature_c} °C"),
        )


def touch_line(report: TouchReport) -> tuple[tuple[str, str], ...]:
    """The figures of a loop of touch, for the page."""
    return (
        ("Hand frames", f"{report.rate:.0f}/s"),
        ("Latency", str(report.latency) if report.latency.count else "–"),
        ("Late blocks", str(report.late)),
        ("Turns slipped", str(report.slipped)),
        ("Frames dropped", str(report.dropped)),
        ("Held up", str(report.held_up)),
    )


def _waves(view: View, capture: Capture, last: int) -> Waves | None:
    """The waves of the watched transducers in the periods before one."""
    watched = view.settings.watched
    first = last - WAVE_PERIODS
    if not watched or first * TICKS_PER_PERIOD < capture.start_tick:
        return None
    bits = capture.channels(first * TICKS_PER_PERIOD, last * TICKS_PER_PERIOD)
    return Waves(watched, first * TICKS_PER_PERIOD, bits[:, capture.wiring.channels[list(watched)]])
