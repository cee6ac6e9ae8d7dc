"""A session that pages direct: hands touch objects on a device, and every setting can be changed while they do.

Three threads meet here. That of the device plays, and takes snapshots; that of the server hears what pages ask for, and
only notes it, but for a stop, which a thread of its own brings to the device at once; that of the view paints. A change
of the method, the frequency or the placing of points begins a new loop of touch, with its ramps; the other ones go on
within the loop.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, fields
from functools import partial
from threading import Thread
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..emulator import Emulator
from ..emulator.faults import FAULTS, InjectedFault
from ..emulator.faults.fault import limits
from ..emulator.faults.limits import Whole
from ..emulator.scenario import fault_of
from ..errors import DeviceError, DeviceRefusedError, InputFileError, PhasewireError
from ..host import Device
from ..host.hands.frames import HandFrame
from ..host.hands.sources import HandSource
from ..host.touching.loop import TouchLoop, TouchMoment
from ..protocol.board import PROCESSORS_PER_BOARD
from ..solver import Toucher, TransducerArray
from ..solver.contact.hand import Hand
from ..solver.contact.mesh import Mesh
from ..solver.objects.parsing import MovingObject
from .hands import MouseHands
from .settings import Settings
from .shelf import Shelf
from .tap import Tap
from .view import View

__all__ = ["Studio"]

LOOP_SETTINGS = ("method", "frequency", "spacing", "corners")
"""What a loop of touch keeps for its life."""
REST_SECONDS = 1 / 30


class Studio:
    """Plays on a device what pages ask for. It is the view's director.

    Parameters
    ----------
    device : Device
        To play on.
    array : TransducerArray
        Of the device.
    shelf : Shelf
        The objects.
    source : HandSource
        The hands; `MouseHands` are moved by pages.
    settings : Settings
        With which it begins.
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
        self.settings = settings
        self._objects: tuple[MovingObject, ...] = shelf.put(settings.objects)
        self._todo: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._playing, self._renew, self._lost = True, False, False
        self._loop: TouchLoop | None = None
        self._begin = device.time.monotonic()
        self.controls: tuple[str, ...] = ("stop", "play", "objects", "past")
        if isinstance(source, MouseHands):
            self.controls += ("hand",)
        if emulator is not None:
            self.controls += ("faults", "waves")
        self.object_kinds = shelf.kinds
        self.faults = _faults() if emulator is not None else ()
        self._view: View | None = None
        self._tap: Tap | None = None
        self._over: Callable[[], bool] = lambda: False
        self._hands: tuple[Hand, ...] = ()

    # What pages ask for, in the server's thread

    def stop(self) -> None:
        """Turn the outputs off, and leave them off until `go`."""
        self._playing = False
        Thread(target=self._turn_off, name="phasewire stop", daemon=True).start()

    def _turn_off(self) -> None:
        try:
            self._device.stop()
        except DeviceError as error:
            self._say(f"the device did not answer to the stop: {error}; its watchdog turns the outputs off")

    def go(self) -> None:
        """Play again."""
        self._playing = True

    def gone(self) -> None:
        """The last page has gone: turn the outputs off, unless it was told otherwise."""
        if not self._unwatched:
            self.stop()

    def fault(self, fault: dict[str, Any] | None) -> None:
        """Inject a fault into an emulated device, or clear the faults of any."""
        if fault is None:
            self._todo.put(self._clear_faults)
            return
        if self._emulator is None:
            raise ValueError("faults can be injected into an emulated device only")
        try:
            made = fault_of("fault", fault)
        except InputFileError as error:
            raise ValueError(str(error)) from error
        self._todo.put(partial(self._inject, made))

    def _inject(self, fault: InjectedFault) -> None:
        assert self._emulator is not None
        assert self._tap is not None
        self._emulator.inject(fault)
        board = getattr(fault, "board", None)
        if board is None and (processor := getattr(fault, "processor", None)) is not None:
            board = processor // PROCESSORS_PER_BOARD
        if board is not None:
            self._tap.injected[board] = fault.name()

    def _clear_faults(self) -> None:
        assert self._tap is not None
        self._tap.injected.clear()
        self._device.clear_faults()

    def apply(self, settings: Settings) -> None:
        """Play by these settings from now on."""
        before, self.settings = self.settings, settings
        if settings.objects != before.objects:
            self._objects = self._shelf.put(settings.objects)
        if settings.hand is not None and settings.hand != before.hand and isinstance(self._source, MouseHands):
            self._source.follow(settings.hand)
        if (settings.amplitude, settings.silenced) != (before.amplitude, before.silenced) and self._loop is not None:
            self._loop.turn_down(self._gains())
        if any(getattr(settings, name) != getattr(before, name) for name in LOOP_SETTINGS):
            self._renew = True

    def _gains(self) -> NDArray[np.float32]:
        gains = np.full(len(self._array), self.settings.amplitude, np.float32)
        gains[list(self.settings.silenced)] = 0
        return gains

    # In the device's thread

    def warm_up(self) -> None:
        """Load what is compiled, which the first touch must not wait for. The outputs are off still."""
        self._new_loop(self._source).warm_up()

    def run(self, view: View, over: Callable[[], bool] = lambda: False) -> None:
        """Play until it is over, or the hands end.

        Raises
        ------
        PhasewireError
            If the device or the tracker is lost.
        """
        self._view, self._over = view, over
        with Tap(self._device, view, self._emulator) as self._tap:
            self._run(view)

    def _run(self, view: View) -> None:
        if not self._unwatched:
            self._rest_until(lambda: view.server.pages > 0, "waiting")
        while not (self._source.ended or self._over()):
            if self._playing:
                self._play()
            else:
                self._rest_until(lambda: self._playing, "stopped")
        self._show_rest("ended", at_once=True)

    def _new_loop(self, source: HandSource) -> TouchLoop:
        settings = self.settings
        return TouchLoop(
            self._device,
            source,
            self._objects_at,
            Toucher(settings.spacing, settings.corners),
            self._array,
            method=settings.method,
            frequency=settings.frequency,
            on_moment=self._seen,
        )

    def _play(self) -> None:
        """Play with one loop of touch, until it must be another one."""
        self._renew = False
        if self._lost and not self._find_again():
            return
        self._loop = self._new_loop(_Lease(self._source, self))
        self._loop.turn_down(self._gains())
        try:
            self._loop.run()
        except DeviceRefusedError as error:
            if self._playing:  # nobody has stopped it
                self._playing = False
                self._say(f"the device refuses to play: {error}")
        except DeviceError as error:
            self._playing, self._lost = False, True
            self._say(f"{error}; Play tries again")
        finally:
            self._loop = None

    def _find_again(self) -> bool:
        """Whether a device that was lost is back."""
        try:
            self._device.reopen()
        except DeviceError as error:
            self._playing = False
            self._say(f"{error}; Play tries again")
        else:
            self._lost = False
        return not self._lost

    def _objects_at(self, moment: float) -> Sequence[Mesh]:
        return [thing.at(moment - self._begin) for thing in self._objects]

    def _seen(self, moment: TouchMoment) -> None:
        """Show what was just played, if it is time."""
        assert self._tap is not None
        assert self._loop is not None
        self._tap.take_moment(moment, self._loop)

    def serve(self) -> None:
        """Do what pages have asked for, in the thread that plays."""
        while True:
            try:
                task = self._todo.get_nowait()
            except queue.Empty:
                return
            try:
                task()
            except (PhasewireError, ValueError) as error:
                self._say(str(error))

    @property
    def renewed(self) -> bool:
        """Whether the loop that plays must end."""
        return self._renew or not self._playing or self._over()

    def _rest_until(self, done: Callable[[], bool], state: str) -> None:
        """Let time pass with the outputs off."""
        while not (done() or self._over() or self._source.ended):
            self.serve()
            time.sleep(REST_SECONDS)
            if self._emulator is not None:
                self._device.time.sleep(REST_SECONDS)
            self._show_rest(state)

    def _show_rest(self, state: str, *, at_once: bool = False) -> None:
        assert self._tap is not None
        frame = self._source.next_frame(0) if not self._source.ended else None
        if frame is not None:
            self._hands = tuple(tracked.hand for tracked in frame.hands)
        if at_once or self._tap.due:
            objects = self._objects_at(self._device.time.monotonic())
            try:
                self._tap.take(hands=self._hands, objects=objects, state=state)
            except DeviceError as error:
                self._say(str(error))

    def _say(self, text: str) -> None:
        assert self._view is not None
        self._view.say(text, error=True)


class _Lease:
    """The hands of a studio for one loop, which ends when the studio needs another."""

    def __init__(self, source: HandSource, studio: Studio) -> None:
        self._source, self._studio = source, studio
        self.name, self.notes, self.rate, self.live = source.name, source.notes, source.rate, source.live

    @property
    def ended(self) -> bool:
        """Whether the loop must end."""
        return self._studio.renewed or self._source.ended

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The newest frame; what pages have asked for is done before."""
        self._studio.serve()
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
