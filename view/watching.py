"""A view beside a command that plays: it watches, and can stop, but changes nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from threading import Thread
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..emulator import Emulator
from ..errors import DeviceError
from ..host import Device, StreamReport
from ..host.playing.frames import Frame, Frames, frame_source
from ..host.touching.loop import TouchLoop, TouchMoment
from ..solver import TransducerArray, TwoSided
from .settings import Settings
from .tap import Tap, rig_of
from .view import Onlooker, View

__all__ = ["Watch"]

FIRST_PAGE_SECONDS = 60.0
STEP_SECONDS = 1 / 30


class _Stopper(Onlooker):
    """Turns a device off if a page says so, or if the last one is closed."""

    def __init__(self, device: Device, emulated: bool) -> None:
        self._device = device
        self.over = False
        """Whether the command has ended by itself."""
        self.controls = ("stop", "past", "waves") if emulated else ("stop", "past")

    def stop(self) -> None:
        """Turn the outputs off, which ends the command."""
        if not self.over:
            Thread(target=self._turn_off, name="phasewire stop", daemon=True).start()

    gone = stop

    def _turn_off(self) -> None:
        with suppress(DeviceError):  # out of reach: its watchdog does it
            self._device.stop()


class Watch:
    """Shows what a command plays, in a ``with`` statement.

    Parameters
    ----------
    device : Device
        On which it plays.
    array : TransducerArray
        Of the device.
    emulator : Emulator, optional
        The device, if it is emulated in this process.
    settings : Settings, optional
        With which the page begins.

    Attributes
    ----------
    view : View
        The page.
    """

    def __init__(
        self, device: Device, array: TransducerArray, emulator: Emulator | None = None, settings: Settings | None = None
    ) -> None:
        self._device, self._emulator = device, emulator
        self._stopper = _Stopper(device, emulator is not None)
        self.view = View(rig_of(device, array), director=self._stopper, settings=settings, embedded=False)
        self._tap = Tap(device, self.view, emulator)

    def __enter__(self) -> Self:
        self._tap.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stopper.over = True
        self._tap.__exit__(kind, error, traceback)
        self.view.close()

    def wait_for_page(self) -> bool:
        """Wait until a browser shows the page, at most a minute; false if none did."""
        return self.view.server.seen.wait(FIRST_PAGE_SECONDS)

    def moment(self, moment: TouchMoment, loop: TouchLoop) -> None:
        """Show what hands have just touched, if it is time."""
        self._tap.take_moment(moment, loop)

    def frames(self, frames: Frames, rate: float) -> Frames:
        """The same frames, and the page shows them; for an emulated device they keep the pace of the wall clock."""
        if self._emulator is None:
            return frames
        return self._paced(frames, rate)

    def _paced(self, frames: Frames, rate: float) -> Iterator[Frame]:
        source = frame_source(frames, self._device.calibration, self._device.info.channels)
        began, number = time.monotonic(), 0
        while len((taken := source.take(1)).phase):
            time.sleep(max(0.0, began + number / rate - time.monotonic()))
            self.look()
            yield taken.pulses(0)
            number += 1

    def progress(self, report: StreamReport) -> None:
        """Show the figures of a stream, and what the device plays."""
        self._tap.figures = (
            ("Rate", f"{report.rate:g}/s, played {report.played_rate:.0f}/s"),
            ("Frames", f"{report.accepted} accepted, {report.late} late, {report.refused} refused"),
            ("Underruns", str(report.underruns)),
        )
        self.look()

    def look(self, half: int | None = None, origin: int = 0, **seen: Any) -> None:
        """Show what the device emits, if it is time; parameters as `Tap.take`."""
        if self._tap.due:
            self._tap.take(half, origin, **seen)

    def play(self, solution: TwoSided, seconds: float, begins: int) -> None:
        """Let two fields take turns by the wall clock, from a period on; otherwise as `Device.keep_playing`."""
        strengths = solution.points.amplitudes / solution.points.amplitudes.max()
        points = np.column_stack([solution.points.positions, strengths])
        half = solution.modulation.periods
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            began = time.monotonic()
            self._device.keep_playing(min(STEP_SECONDS, left))
            time.sleep(max(0.0, min(STEP_SECONDS, left) - (time.monotonic() - began)))
            self.look(half, begins, points=points, ids=np.arange(len(points)))
