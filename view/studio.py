"""A session that pages direct: hands touch objects on a device, and every setting can be changed while they do.

==================  ======================================================================================
playing             the thread that calls `Studio.run`; it alone touches the loop of touch, and an emulated device
server              hears what pages ask for; it only notes it
stop                brings a stop to a device that is not emulated (`Stopper`)
shelf               prepares objects, which may take seconds; the loop goes on with the others meanwhile
hand, tap, view     move the hand of the page, make snapshots, paint them
==================  ======================================================================================

A change of `LOOP_SETTINGS` begins a new loop, with its ramps. The others take effect within the loop.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, fields
from functools import partial
from math import inf
from types import TracebackType
from typing import Any, Self

from ..base.errors import DeviceError, DeviceRefusedError, InputFileError, PhasewireError
from ..emulator import Emulator
from ..emulator.faults import FAULTS, InjectedFault
from ..emulator.faults.fault import limits
from ..emulator.faults.limits import Whole
from ..emulator.scenario import fault_of
from ..host import Device
from ..host.hands.frames import HandFrame
from ..host.hands.sources import HandSource
from ..host.touching.loop import TouchLoop, TouchMoment
from ..protocol.board import CARRIER_HZ, PROCESSORS_PER_BOARD
from ..solver import Toucher, TransducerArray
from ..solver.contact.hand import Hand
from ..solver.contact.mesh import Mesh
from ..solver.objects.parsing import MovingObject
from ..solver.rendering.ways import Halves
from .comparing import gains_of
from .hands import MouseHands
from .newest import NewestTask
from .settings import ObjectSetting, Settings
from .shelf import Shelf
from .stopping import Stopper
from .tap import Tap
from .view import Director, View

__all__ = ["Studio"]

LOOP_SETTINGS = ("method", "frequency", "spacing", "corners")
"""What a loop of touch keeps for its life."""
REST_SECONDS = 1 / 30


class Studio(Director):
    """Plays on a device what pages ask for. It is the view's director.

    Parameters
    ----------
    device, array
        Device to play on, and its transducers.
    shelf : Shelf
        Objects to choose from.
    source : HandSource
        Source of hands; `MouseHands` are moved by pages.
    settings : Settings
        The first settings.
    emulator : Emulator, optional
        The device, if it is emulated in this process.
    unwatched : bool
        Whether it plays on when the last page has gone, and begins before the first has come.
    """

    def __init__(
        self,
        device: Device,
        array: TransducerArray,
        shelf: Shelf,
        source: HandSource,
        settings: Settings,
        *,
        emulator: Emulator | None = None,
        unwatched: bool = False,
    ) -> None:
        self._device, self._array, self._shelf, self._source = device, array, shelf, source
        self._emulator, self._unwatched = emulator, unwatched
        self._settings = settings
        self._objects: tuple[MovingObject, ...] = shelf.put(settings.objects)
        self._todo: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._stopper = Stopper(device, emulator)
        self._playing, self._lost = True, False
        self._begin = device.time.monotonic()
        self._hands: tuple[Hand, ...] = ()
        self._loop: TouchLoop | None = None
        self.controls = ("stop", "play", "objects")
        if isinstance(source, MouseHands):
            self.controls += ("hand",)
        if emulator is not None:
            self.controls += ("faults", "waves")
        self.object_kinds = shelf.kinds
        self.faults = _faults() if emulator is not None else ()

    # In the server's thread

    def stop(self) -> None:
        """Turn the outputs off, and leave them off until `go`."""
        self._playing = False
        self._stopper.stop()

    def go(self) -> None:
        """Play again."""
        self._playing = True

    def gone(self) -> None:
        """The last page has gone: turn the outputs off, unless `unwatched`."""
        if not self._unwatched:
            self.stop()

    def fault(self, fault: dict[str, Any]) -> None:
        """Inject a fault into an emulated device."""
        if self._emulator is None:
            raise ValueError("faults can be injected into an emulated device only")
        try:
            made = fault_of("fault", fault)
        except InputFileError as error:
            raise ValueError(str(error)) from error
        self._todo.put(partial(self._inject, made))

    def clear_faults(self) -> None:
        """Clear the faults whose cause is gone."""
        self._todo.put(self._clear_faults)

    def apply(self, settings: Settings) -> None:
        """Play by these settings from now on."""
        self._todo.put(partial(self._apply, settings))

    # In the playing thread

    def warm_up(self) -> None:
        """Load what is compiled, which the first touch must not wait for. The outputs are off still."""
        self._new_loop(self._source).warm_up()

    def run(self, view: View, over: Callable[[], bool] = lambda: False) -> None:
        """Play until it is over, or the hands end.

        `PhasewireError` if the tracker is lost.
        """
        self._view, self._over = view, over
        self._shelving = NewestTask("phasewire shelf", lambda error: self._say(str(error)))
        try:
            with Tap(self._device, view, self._emulator) as self._tap:
                if not self._unwatched:
                    self._rest_until(lambda: view.server.pages > 0, "waiting")
                while not (self._source.ended or over()):
                    if self._playing:
                        self._play()
                    else:
                        self._rest_until(lambda: self._playing, "stopped")
                self._show_rest("ended")
        finally:
            self._shelving.close()

    def _new_loop(self, source: HandSource) -> TouchLoop:
        settings = self._settings
        loop = TouchLoop(
            self._device,
            source,
            self._objects_at,
            Toucher(settings.spacing, settings.corners),
            self._array,
            method=settings.method,
            render=Halves(settings.frequency, "square"),
            on_moment=self._seen,
        )
        loop.set_gains(gains_of(settings, len(self._array)))
        return loop

    def _play(self) -> None:
        """Play with one loop of touch, until it must be another one."""
        self._stopper.wait()
        stops = self._stopper.count
        try:
            if self._lost:
                self._device.reopen()
                self._lost = False
            self._stopper.serve()
            ends = partial(self._must_end, self._settings)
            self._loop = self._new_loop(_Lease(self._source, self._serve, ends))
            self._loop.run()
        except DeviceRefusedError as error:
            if self._stopper.count == stops:  # no page has stopped it
                self._playing = False
                self._say(f"the device refuses to play: {error}")
        except DeviceError as error:
            self._playing, self._lost = False, True
            self._say(f"{error}; Play tries again")

    def _must_end(self, settings: Settings) -> bool:
        """Whether a loop that was made by these settings must end."""
        changed = any(getattr(settings, name) != getattr(self._settings, name) for name in LOOP_SETTINGS)
        return changed or not self._playing or self._over()

    def _serve(self) -> None:
        """Do what pages have asked for."""
        self._stopper.serve()
        while True:
            try:
                task = self._todo.get_nowait()
            except queue.Empty:
                return
            try:
                task()
            except (PhasewireError, ValueError) as error:
                self._say(str(error))

    def _apply(self, settings: Settings) -> None:
        before, self._settings = self._settings, settings
        if settings.objects != before.objects:
            self._shelving.offer(partial(self._put, settings.objects))
        if settings.hand is not None and settings.hand != before.hand and isinstance(self._source, MouseHands):
            self._source.follow(settings.hand)
        if (settings.amplitude, settings.silenced) != (before.amplitude, before.silenced) and self._loop is not None:
            self._loop.set_gains(gains_of(settings, len(self._array)))

    def _put(self, objects: Sequence[ObjectSetting]) -> None:
        """Prepare objects, in the shelf's thread."""
        self._objects = self._shelf.put(objects)

    def _inject(self, fault: InjectedFault) -> None:
        assert self._emulator is not None
        self._emulator.inject(fault)
        board = getattr(fault, "board", None)
        if board is None and (processor := getattr(fault, "processor", None)) is not None:
            board = processor // PROCESSORS_PER_BOARD
        if board is not None:
            periods = getattr(fault, "periods", None)
            self._tap.inject(board, fault.name(), inf if periods is None else periods / CARRIER_HZ)

    def _clear_faults(self) -> None:
        self._device.clear_faults()

    def _objects_at(self, moment: float) -> Sequence[Mesh]:
        return [thing.at(moment - self._begin) for thing in self._objects]

    def _seen(self, moment: TouchMoment) -> None:
        """Show what was just played, if it is time."""
        assert self._loop is not None
        self._tap.take_moment(moment, self._loop)

    def _rest_until(self, done: Callable[[], bool], state: str) -> None:
        """Let time pass with the outputs off."""
        while not (done() or self._over() or self._source.ended):
            try:
                self._serve()
                time.sleep(REST_SECONDS)
                if self._emulator is not None:
                    self._device.time.sleep(REST_SECONDS)
            except DeviceError as error:
                self._lost = True
                self._say(str(error))
            if self._tap.due:
                self._show_rest(state)

    def _show_rest(self, state: str) -> None:
        frame = self._source.next_frame(0) if not self._source.ended else None
        if frame is not None:
            self._hands = tuple(tracked.hand for tracked in frame.hands)
        self._tap.take(hands=self._hands, objects=self._objects_at(self._device.time.monotonic()), state=state)

    def _say(self, text: str) -> None:
        self._view.say(text, error=True)


class _Lease:
    """The hands of a studio for one loop. ``serve`` does what pages ask for; ``ends`` says if the loop must end."""

    def __init__(self, source: HandSource, serve: Callable[[], None], ends: Callable[[], bool]) -> None:
        self._source, self._serve, self._ends = source, serve, ends
        self.name, self.notes, self.rate, self.live = source.name, source.notes, source.rate, source.live

    @property
    def ended(self) -> bool:
        """Whether the loop must end, as it asks in each turn; a stop is carried out first, without a ramp."""
        self._serve()
        return self._ends() or self._source.ended

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The newest frame."""
        return self._source.next_frame(timeout)

    def __iter__(self) -> Iterator[HandFrame]:
        return self

    def __next__(self) -> HandFrame:
        return next(self._source)

    def close(self) -> None:
        """It is the studio's."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def _faults() -> tuple[dict[str, Any], ...]:
    """All faults that can be injected, with their fields, for the page."""
    return tuple({"name": name, "fields": _fields(kind)} for name, kind in FAULTS.items())


def _fields(kind: type[InjectedFault]) -> list[dict[str, Any]]:
    """The fields of a fault but for its period: it happens at once."""
    defaults = {each.name: None if each.default is MISSING else each.default for each in fields(kind)}
    found = []
    for name, (allowed, optional) in limits(kind).items():
        if name == "period":
            continue
        found.append(
            {
                "name": name,
                "least": getattr(allowed, "least", None),
                "most": getattr(allowed, "most", None),
                "values": getattr(allowed, "values", None),
                "whole": isinstance(allowed, Whole),
                "optional": optional,
                "default": defaults[name],
            }
        )
    return found
