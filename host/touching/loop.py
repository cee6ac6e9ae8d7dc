"""The loop: hands in, fields out, and silence when there are none.

It takes the newest frame of hands that is due, finds where they touch, lets the points fade in or out, renders them,
and sends what is new. Between frames it keeps the turns going, and the ramps.

It waits for the source no longer than until the next turn. A source without news for `STALL_SECONDS` is taken for a
hand that has left: the field fades, and is silent 50 ms after the last news. Of a live source, only a frame that
`Liveness` finds new is news: a tracker that hangs may repeat itself for ever. If this program itself is held up, or a
source does not come back from a call, the device's watchdog does it, which is set to the same time. When such a program
comes back it begins anew, with a ramp, and counts that it was held up.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from math import inf
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import DeviceError, DeviceRefusedError, TrackerError
from ...protocol.codes import Reason
from ...solver import TransducerArray
from ...solver.contact.hand import Hand
from ...solver.contact.mesh import Mesh
from ...solver.contact.touch import MOST_POINTS, Touch, Toucher
from ...solver.geometry import frozen
from ...solver.rendering.outline import Outline
from ...solver.rendering.ways import Way, parse_way
from ...solver.shapes.points import reachable
from ..hands.frames import HandFrame
from ..hands.liveness import Liveness
from ..hands.sources import HandSource
from ..streaming.device import Device
from ..streaming.limiting import Limit
from ..streaming.session import WATCHDOG_BLOCKS
from .fading import Fading
from .fields import PoseSolver, PulseCycle
from .prediction import Predictor
from .report import TouchReport
from .tally import Tally
from .turns import Alternation, turns_for

__all__ = ["MOST_RAMP_SECONDS", "RAMP_SECONDS", "SILENCE_SECONDS", "TouchLoop", "TouchMoment"]

SILENCE_SECONDS = 0.05
"""After the last news of the source, or the last touch, the outputs are silent by then."""
RAMP_SECONDS = 0.02
MOST_RAMP_SECONDS = 0.04
STALL_RAMP_SECONDS = 0.008
STALL_SECONDS = SILENCE_SECONDS - STALL_RAMP_SECONDS - 0.004
"""Without news, the field fades: longer than the time between two frames of a camera, 33 ms. The rest is for the
last step of the ramp, and for the way to the outputs."""
WATCHDOG_SECONDS = SILENCE_SECONDS
PROGRESS_SECONDS = 0.1
EARLY_SECONDS = 1e-4
"""By which a frame may come too early for the rate: those of a source of just this rate do, now and then."""
LEAD_SECONDS = 100e-6
"""From the arrival of a block to its field: some carrier periods."""
LEARNING = 0.02
"""The share of the newest pose in the mean time that a pose takes, by which hands are moved ahead."""


WARM_UP_METRES = 0.2
SHORTEST_STEP_SECONDS = 1e-4


class TouchPoints(NamedTuple):
    """What is touched now: ids (m,), positions (m, 3) and amplitudes (m,)."""

    ids: NDArray[np.int64]
    positions: NDArray[np.float64]
    amplitudes: NDArray[np.float64]


NO_POINTS = TouchPoints(np.empty(0, np.int64), np.empty((0, 3)), np.empty(0))


class TouchMoment(NamedTuple):
    """One frame on its way: what was seen, what it touches, and what is played for it.

    Parameters
    ----------
    frame : HandFrame
        The frame as the source gave it.
    time : float
        The time of the frame, by the device's clock in seconds.
    hands : tuple of Hand
        The hands as they were predicted.
    objects : sequence of Mesh
        The objects where they were.
    touch : Touch
        Arcs and points of the hands.
    fading : Fading
        The points that are played, with their ramps.
    cycle : PulseCycle or None
        What is played for them, again and again; None in silence.
    """

    frame: HandFrame
    time: float
    hands: tuple[Hand, ...]
    objects: Sequence[Mesh]
    touch: Touch
    fading: Fading
    cycle: PulseCycle | None


class TouchLoop:
    """Plays on a device what hands touch, until the source of hands ends.

    Parameters
    ----------
    device : Device
        The device to play on; the loop turns its outputs off at its end, and leaves it open.
    source : HandSource
        Opened with the device's clock, ``PlacedHands(open_hands(url, device.time), pose)``.
    objects : sequence of Mesh, or callable
        What can be touched; or a function of the moment, by the device's clock, for what moves.
    toucher : Toucher
        Finds the points; it decides on their distance and their number.
    array : TransducerArray
        The array of the device.
    method : str
        The method by which fields are solved.
    render : Way or str
        The way in which way points are rendered; a text is read by `parse_way`. Two fields in turn, the default, are
        sent as they come. For any other way the device repeats what it has stored, and a pose takes longer (`turns`).
    ramp : float
        Seconds in which a point comes and goes, 0 to `MOST_RAMP_SECONDS`.
    predict : bool
        Whether hands are moved ahead by their velocity.
    most_points : int
        The most points with those that fade out; the toucher's own limit by custom.
    rate : float, optional
        Frames per second that are taken at most; all by default.
    limit : callable, optional
        Turns down a pose, such as for people's ears; see `limiting.Limit`.
    on_moment : callable, optional
        A function that is called with the `TouchMoment` of each frame, after its field was sent.

    Raises
    ------
    ValueError
        If a number is out of range.

    Attributes
    ----------
    method : str
        As given.
    """

    def __init__(
        self,
        device: Device,
        source: HandSource,
        objects: Sequence[Mesh] | Callable[[float], Sequence[Mesh]],
        toucher: Toucher,
        array: TransducerArray,
        *,
        method: str = "wgs",
        render: Way | str = "two-sided:envelope=square",
        ramp: float = RAMP_SECONDS,
        predict: bool = True,
        most_points: int = MOST_POINTS,
        rate: float | None = None,
        limit: Limit | None = None,
        on_moment: Callable[[TouchMoment], None] | None = None,
    ) -> None:
        way = parse_way(render) if isinstance(render, str) else render
        if not 0 <= ramp <= MOST_RAMP_SECONDS:
            raise ValueError(f"a ramp of {ramp:g} s must lie between 0 and {MOST_RAMP_SECONDS:g} s")
        if rate is not None and not rate > 0:
            raise ValueError(f"a rate of {rate:g} hand frames/s must be positive")
        self._gap = 0.0 if rate is None else 1 / rate
        self.method = method
        self._next = -inf
        """When the next frame may be taken."""
        self._device, self._source, self._toucher, self._array = device, source, toucher, array
        self._objects = objects if callable(objects) else lambda _moment: objects
        self._most, self._ramp, self._on_moment = most_points, ramp, on_moment
        self._predictor = Predictor() if predict else None
        self._clock, self._stops = device.time, device.stops
        self._watchdog_before = device.status().watchdog_ms / 1000
        self._watchdog = max(WATCHDOG_SECONDS, WATCHDOG_BLOCKS / device.most_updates_per_second)
        self._turns = turns_for(device, way, self._watchdog)
        self._fields = PoseSolver(array, way, method, self._turns.most_frames, device.calibration, limit)
        self._liveness = Liveness()
        self._follows = source.live and self._clock is not time  # an emulated device's time does not pass by itself
        self._wall_begin, self._begin = time.monotonic(), self._clock.monotonic()
        self._fading = Fading.nothing()
        self._points = NO_POINTS
        self._strokes: tuple[NDArray[np.float64], ...] = ()
        """Of what was touched last: points that fade out are on them still."""
        self._pose_at = self._heard_at = self._begin
        self._warm = self._stalled = False
        self._takes = 0.0
        self._tally = Tally()

    @property
    def report(self) -> TouchReport:
        """As it stands."""
        return self._tally.report(self._clock.monotonic() - self._begin, self._turns, self._fields.least_gain)

    @property
    def alternation(self) -> Alternation | None:
        """How the fields take turns; None before the first."""
        return self._turns.alternation

    @property
    def gains(self) -> NDArray[np.float32] | None:
        """By which the solved drives are scaled, (n,); None before they are set."""
        return self._fields.gains

    def set_gains(self, gains: NDArray[np.float32]) -> None:
        """Scale the solved drive of each transducer by its gain, (n,) from 0 to 1, from the next pose on.

        Any thread may call it.

        Raises
        ------
        ValueError
            If there are not as many gains as transducers, or one is out of range.
        """
        if gains.shape != (len(self._array),) or not ((gains >= 0) & (gains <= 1)).all():
            raise ValueError(f"gains must be {len(self._array)} numbers from 0 to 1")
        self._fields.gains = gains

    def run(self, seconds: float = inf, on_progress: Callable[[TouchReport], None] | None = None) -> TouchReport:
        """Play until the source ends, or for so many seconds by the device's clock.

        Parameters
        ----------
        seconds : float
            How long at most.
        on_progress : callable, optional
            A function that is called with the report as it stands some ten times a second, and at the end, however that
            comes.

        Returns
        -------
        TouchReport
            What became of every frame.

        Raises
        ------
        TrackerError
            If the tracker is lost; the field fades first.
        DeviceError
            If the device refuses or the line fails. After any error the outputs are off, or will be when the
            watchdog's time is over if the device cannot be reached.
        """
        with self._silent_afterwards(on_progress), _without_collections():
            if not self._warm:
                self.warm_up()
            self._device.set_watchdog(self._watchdog)
            self._wall_begin, self._begin = time.monotonic(), self._clock.monotonic()
            self._heard_at, told = self._begin, self._wall_begin
            try:
                while not self._source.ended and (now := self._caught_up()) < self._begin + seconds:
                    self.turn(min(self._due(), self._begin + seconds) - now)
                    if on_progress is not None and time.monotonic() - told >= PROGRESS_SECONDS:
                        told = time.monotonic()
                        on_progress(self.report)
            except TrackerError:
                self._release()
                raise
            self._release()
        return self.report

    @contextmanager
    def _silent_afterwards(self, on_progress: Callable[[TouchReport], None] | None) -> Iterator[None]:
        try:
            yield
        finally:
            with suppress(DeviceError):  # out of reach: its watchdog does it
                self._device.stop()
                self._device.set_watchdog(self._watchdog_before)
            if on_progress is not None:
                on_progress(self.report)

    # One step

    def turn(self, timeout: float) -> None:
        """Wait so many seconds for a frame, play it or else what is due: one turn of the loop."""
        frame = self._source.next_frame(max(timeout, 0.0))
        now = self._caught_up()
        if frame is not None and self._is_news(frame, now):
            self._heard_at, self._stalled = now, False
            stamp = frame.time + self._offset
            if stamp >= self._next - EARLY_SECONDS:
                self._next = (self._next if stamp < self._next + self._gap else stamp) + self._gap
                self._survive(partial(self._take, frame, stamp))
                return
        self._survive(self._go_on)

    def _is_news(self, frame: HandFrame, now: float) -> bool:
        """Whether a frame is news at a moment by the device's clock; what is none is counted."""
        if not self._source.live or self._liveness.stale(frame, now - self._offset) is None:
            return True
        self._tally.passed_over(frame)
        return False

    @property
    def _offset(self) -> float:
        """Seconds by which the device's clock is ahead of that of the frames."""
        return self._begin - self._wall_begin if self._follows else 0.0

    def _caught_up(self) -> float:
        """The device's time; if the source is live, an emulated one's passes as the wall clock's has until now."""
        if self._follows:
            behind = (time.monotonic() - self._wall_begin) - (self._clock.monotonic() - self._begin)
            if behind > 0:
                self._clock.sleep(behind)
        return self._clock.monotonic()

    def _survive(self, step: Callable[[], None]) -> None:
        """Take a step; if the watchdog has turned the outputs off before, begin anew: the next pose enables them."""
        if self._device.stops != self._stops:
            raise DeviceRefusedError(f"{self._device.name} has turned its outputs off: it was stopped", Reason.DISABLED)
        try:
            step()
        except DeviceRefusedError as error:
            if error.reason is not Reason.DISABLED or not self._device.status().watchdog_fired:
                raise
            self._tally.held_up += 1
            self._fading = Fading.nothing()
            self._turns.forget()

    def _due(self) -> float:
        """When the loop must go on without a frame."""
        due = self._turns.due
        if self._ramping:
            due = min(due, self._pose_at + self._turns.pace)
        return due if self._stalled else min(due, self._heard_at + STALL_SECONDS)

    def _take(self, frame: HandFrame, stamp: float) -> None:
        """Play a frame of hands that is of a moment by the device's clock."""
        begun, now = perf_counter(), self._clock.monotonic()
        self._tally.took(frame)
        hands = self._hands_of(frame, now)
        objects = self._objects(now)
        touch = self._toucher.touch(hands, objects, stamp)
        self._points = self._reached(touch)
        cut = perf_counter()
        if self._clock.monotonic() >= self._turns.due:  # it would be late after the solution
            self._turns.keep()
        cycle = self._pose(now, self._ramp)
        solved = perf_counter()
        if cycle is not None and self._turns.show(cycle):
            sent = perf_counter()
            wait = max(now - stamp, 0.0)
            self._tally.sent(wait, cut - begun, solved - cut, sent - solved)
            self._takes += LEARNING * (sent - begun - self._takes)
        if self._on_moment is not None:
            self._on_moment(TouchMoment(frame, stamp, hands, objects, touch, self._fading, cycle))

    def _go_on(self) -> None:
        """Without a frame: keep ramps and turns going, and let the field fade if the source has stalled."""
        now = self._clock.monotonic()
        if not self._stalled and now >= self._heard_at + STALL_SECONDS:
            self._stalled, self._points = True, NO_POINTS
            self._tally.stalls += len(self._fading) > 0
        if self._ramping and now >= self._pose_at + self._turns.pace:
            cycle = self._pose(now, min(self._ramp, STALL_RAMP_SECONDS) if self._stalled else self._ramp)
            if cycle is not None and self._turns.show(cycle):
                return
        if now >= self._turns.due:
            self._turns.keep()

    @property
    def _ramping(self) -> bool:
        """Whether the field changes though no hand moves."""
        return self._fading.changing or len(self._fading) > len(self._points.ids)

    def _hands_of(self, frame: HandFrame, now: float) -> tuple[Hand, ...]:
        """Where the hands of a frame will be when its field begins."""
        if self._predictor is None:
            return tuple(tracked.hand for tracked in frame.hands)
        return self._predictor.hands(frame, now - self._offset + self._takes + LEAD_SECONDS)

    def _reached(self, touch: Touch) -> TouchPoints:
        """The points of a touch that the array can reach; the others are counted."""
        if touch.points is None:
            return NO_POINTS
        points = TouchPoints(touch.ids, touch.points.positions, touch.points.amplitudes)
        inside = reachable(self._array, points.positions)
        if not inside.all():
            self._tally.out_of_reach += int((~inside).sum())
            points = TouchPoints(points.ids[inside], points.positions[inside], points.amplitudes[inside])
        if self._fields.draws and len(points.ids):
            self._strokes = self._reached_strokes(touch, points)
        self._tally.touched(len(points.ids))
        return points

    def _reached_strokes(self, touch: Touch, points: TouchPoints) -> tuple[NDArray[np.float64], ...]:
        """The parts of the arcs of a touch that the array can reach; if there are none, the points."""
        reached: list[NDArray[np.float64]] = []
        for stroke in Outline.of(touch).strokes:
            inside = reachable(self._array, stroke)
            reached += np.split(stroke, np.flatnonzero(np.diff(inside)) + 1)[not inside[0] :: 2]
        return tuple(reached) or tuple(points.positions[:, None])

    def _pose(self, now: float, ramp: float) -> PulseCycle | None:
        """The fields for the points as they are now, with their ramps; None if there are none, in silence."""
        if not len(self._points.ids) and not len(self._fading):
            return None
        passed = now - self._pose_at
        if not self._fading.changing:  # a ramp that begins now has its first step only
            passed = min(passed, self._turns.pace)
        self._pose_at = now
        change = max(passed, SHORTEST_STEP_SECONDS) / ramp if ramp > 0 else 1.0
        self._fading = self._fading.step(*self._points, change, self._most)
        if len(self._fading):
            return self._fields.solve(self._fading, self._strokes)
        self._turns.silence()
        self._fields.forget()
        return None

    def _release(self) -> None:
        """Let the field fade, and fall silent."""
        self._points = NO_POINTS
        while len(self._fading):
            self._clock.sleep(max(self._due() - self._clock.monotonic(), 0.0))
            self._survive(self._go_on)

    def warm_up(self) -> None:
        """Load what is compiled, which the first touch must not wait for; `run` does it if it was not done before.

        The first time on a machine it is compiled, which takes a minute. The outputs are off still.
        """
        objects = self._objects(self._clock.monotonic())
        for mesh in objects:
            hand = Hand.flat(mesh.vertices[mesh.faces[0, 0]])
            for hands in ((), (hand,), (hand.moved((0, 0, 1e-3)),), ()):  # what comes, stays and goes
                self._toucher.touch(hands, objects)
        self._toucher.forget()
        above = self._array.positions.mean(axis=0) + WARM_UP_METRES * self._array.normals.mean(axis=0)
        points = frozen(above + np.eye(3) * 0.01)
        reachable(self._array, points)
        warm = Fading.nothing().step(np.arange(3), points, np.ones(3), 1.0, 3)
        for strokes in ((points,), (points, points)):  # as many as ``auto`` tells apart
            self._fields.solve(warm, strokes)
        self._fields.forget()
        self._warm = True


@contextmanager
def _without_collections() -> Iterator[None]:
    """Keep what is there already out of the garbage collector's sight: looking through it takes some milliseconds."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
