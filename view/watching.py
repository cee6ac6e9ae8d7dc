"""A view beside a command that plays: it watches, and can stop, but changes nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from ..emulator import Emulator
from ..host import Device, StreamReport
from ..host.streaming.frames import Frame, Frames, frame_source
from ..host.touching.loop import TouchLoop, TouchMoment
from ..host.touching.turns import Alternation
from ..solver import ControlPoints, TransducerArray
from .snapshot import rows_of
from .stopping import Stopper
from .tap import Tap, emitter_of
from .view import Director, View

__all__ = ["Watch", "watch"]

FIRST_PAGE_SECONDS = 60.0
STEP_SECONDS = 1 / 30


class _StopOnly(Director):
    """Lets a page stop, and stops if the last one is closed."""

    def __init__(self, stopper: Stopper, emulated: bool) -> None:
        self._stopper = stopper
        self.over = False
        """Whether the command has ended by itself."""
        self.controls = ("stop", "waves") if emulated else ("stop",)

    def stop(self) -> None:
        """Turn the outputs off, which ends the command."""
        if not self.over:
            self._stopper.stop()

    gone = stop


@contextmanager
def watch(device: Device, array: TransducerArray, emulator: Emulator | None = None) -> Iterator[Watch]:
    """A view of what is played in this block on a device, which is ``emulator`` if it is emulated in this process."""
    stopper = Stopper(device, emulator)
    director = _StopOnly(stopper, emulator is not None)
    with View(emitter_of(device, array), director=director, embedded=False) as view, Tap(device, view, emulator) as tap:
        try:
            yield Watch(device, view, tap, stopper, paced=emulator is not None)
        finally:
            director.over = True


class Watch:
    """Shows on ``view`` what a command plays; made by `watch`. Call its methods in the playing thread."""

    def __init__(self, device: Device, view: View, tap: Tap, stopper: Stopper, *, paced: bool) -> None:
        self._device, self.view, self._tap, self._stopper, self._paced = device, view, tap, stopper, paced

    def wait_for_page(self) -> bool:
        """Wait until a browser shows the page, at most a minute; false if none did."""
        return self.view.server.seen.wait(FIRST_PAGE_SECONDS)

    def check(self) -> None:
        """Carry out a stop that a page has asked for.

        `DeviceRefusedError` if a page has stopped the command, or the last one was closed.
        """
        self._stopper.serve()
        self._stopper.check()

    def moment(self, moment: TouchMoment, loop: TouchLoop) -> None:
        """Show what hands have just touched, if it is time."""
        self.check()
        self._tap.take_moment(moment, loop)

    def frames(self, frames: Frames, rate: float) -> Frames:
        """The same frames, and the page shows them; for an emulated device they keep the pace of the wall clock."""
        self.check()
        return self._in_time(frames, rate) if self._paced else frames

    def _in_time(self, frames: Frames, rate: float) -> Iterator[Frame]:
        source = frame_source(frames, self._device.calibration, self._device.info.channels)
        began, number = time.monotonic(), 0
        while len((taken := source.take(1)).phase):
            due = began + number / rate
            while (left := due - time.monotonic()) > 0:
                time.sleep(min(left, STEP_SECONDS))
                self.check()
            self._look()
            yield taken.pulses(0)
            number += 1

    def progress(self, report: StreamReport) -> None:
        """Show the figures of a stream, and what the device plays."""
        self._tap.figures = (
            ("Rate", f"{report.rate:g}/s, played {report.played_rate:.0f}/s"),
            ("Frames", f"{report.accepted} accepted, {report.late} late, {report.refused} refused"),
            ("Underruns", str(report.underruns)),
        )
        self._look()

    def play(self, points: ControlPoints, steps: Sequence[tuple[int, int]], seconds: float, begins: int) -> None:
        """Let a sequence go on by the wall clock; otherwise as `Device.keep_playing`.

        The steps are those of `Device.play` for the points; if there are two, both fields are shown. ``begins`` is the
        period at which it began.
        """
        shown = rows_of(points)
        turns = Alternation(steps[0][1], begins) if len(steps) == 2 else None
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            began, step = time.monotonic(), min(STEP_SECONDS, left)
            self.check()
            self._device.keep_playing(step)
            time.sleep(max(0.0, step - (time.monotonic() - began)))
            if self._tap.due:
                self._tap.take(turns, points=shown, ids=np.arange(len(shown)))

    def _look(self) -> None:
        """Show what the device emits, if it is time."""
        self.check()
        if self._tap.due:
            self._tap.take()
