"""The asyncio interface of a device: the methods of `Device`, awaited, and streams from asynchronous sources.

Each call runs on a thread of its own, so that the event loop goes on, and no call, in particular `stop`, waits for
another call's thread; the device itself carries out one call after the other. If a task is cancelled during a call,
only the result is lost, with three exceptions: a device that is being opened is closed again, a stream is ended, and
the end of the ``async with`` statement is completed.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, Awaitable, Callable, Coroutine, Generator, Iterator
from concurrent import futures
from concurrent.futures import Future
from contextlib import suppress
from contextvars import copy_context
from functools import partial, wraps
from threading import Thread
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar

from ...base.errors import DeviceError
from ...protocol.replies import Info
from ..transports.transport import Timekeeper
from .calibration import Calibration
from .device import Device, open_device
from .envelopes import Envelope
from .frames import Frame, Frames
from .streaming import LOOK_AHEAD_SECONDS, StreamReport

__all__ = ["AsyncDevice", "open_device_async"]

P = ParamSpec("P")
R = TypeVar("R")

STOPS, STOP_SECONDS = 10, 0.1
"""How often a stream is told to end, and how long it may take each time."""
SLICE_SECONDS = 0.1
"""How long a device is kept playing for a task that may have been cancelled."""


def _on_thread(call: Callable[[], R]) -> Future[R]:
    """Make a call on a thread of its own, without an executor's queue; the interpreter does not wait for it either."""
    future = Future[R]()
    future.set_running_or_notify_cancel()  # it cannot be cancelled

    def run() -> None:
        try:
            future.set_result(call())
        except BaseException as error:
            future.set_exception(error)

    Thread(target=copy_context().run, args=(run,), name="phasewire", daemon=True).start()
    return future


async def _to_the_end(future: Future[R]) -> R:
    """The result of a call that must end even if the task is cancelled; the cancellation is raised afterwards."""
    waited = asyncio.wrap_future(future)
    cancelled: asyncio.CancelledError | None = None
    while not waited.done():
        try:
            await asyncio.wait([waited])
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        waited.exception()  # comes second
        raise cancelled
    return waited.result()


class _Opening(Coroutine[Any, Any, "AsyncDevice"]):
    """A device that is being opened: a coroutine, or what an ``async with`` statement enters."""

    def __init__(self, opening: Coroutine[Any, Any, AsyncDevice]) -> None:
        self._opening = opening

    def send(self, value: Any, /) -> Any:
        return self._opening.send(value)

    def throw(self, *error: Any) -> Any:
        return self._opening.throw(*error)

    def close(self) -> None:
        self._opening.close()

    def __await__(self) -> Generator[Any, Any, AsyncDevice]:
        return self._opening.__await__()

    async def __aenter__(self) -> AsyncDevice:
        self._device = await self._opening
        return await self._device.__aenter__()

    async def __aexit__(self, *error: Any) -> None:
        await self._device.__aexit__(*error)


def open_device_async(
    url: str | None = None, *, calibration: Calibration | None = None, observe: bool = False
) -> _Opening:
    """Open a device as `open_device` does: ``async with open_device_async(url) as device``, or with ``await``.

    If the task is cancelled meanwhile, the device is closed again before this returns.
    """
    return _Opening(_open(url, calibration, observe))


async def _open(url: str | None, calibration: Calibration | None, observe: bool) -> AsyncDevice:
    opening = _on_thread(partial(open_device, url, calibration=calibration, observe=observe))
    try:
        return AsyncDevice(await asyncio.wrap_future(opening))
    except asyncio.CancelledError:
        await _to_the_end(_on_thread(partial(_close, opening)))
        raise


def _close(opening: Future[Device]) -> None:
    """Wait until a device is open, and close it."""
    with suppress(DeviceError, ValueError), opening.result():
        pass


def _awaited(method: Callable[Concatenate[Device, P], R]) -> Callable[Concatenate[AsyncDevice, P], Awaitable[R]]:
    """A method of `Device`, on a thread."""

    @wraps(method)
    async def call(self: AsyncDevice, /, *arguments: P.args, **options: P.kwargs) -> R:
        return await asyncio.wrap_future(_on_thread(partial(method, self.device, *arguments, **options)))

    return call


class AsyncDevice:
    """A device with awaitable methods. They have the arguments, results and errors of those of `Device`.

    Parameters
    ----------
    device : Device
        It may be used in addition, from any thread.
    """

    def __init__(self, device: Device) -> None:
        self.device = device

    def __repr__(self) -> str:
        return f"AsyncDevice({self.name})"

    @property
    def info(self) -> Info:
        """The device's description of itself."""
        return self.device.info

    @property
    def name(self) -> str:
        """Product and serial number."""
        return self.device.name

    @property
    def serial(self) -> str:
        """Serial number, empty if the line does not provide it."""
        return self.device.serial

    @property
    def stops(self) -> int:
        """How often its outputs were turned off by `stop`, `reset` or the end of ``with``, in any thread."""
        return self.device.stops

    @property
    def channels(self) -> int:
        """How many transducers it has."""
        return self.device.channels

    @property
    def slots(self) -> int:
        """How many frames it can store."""
        return self.device.slots

    @property
    def most_updates_per_second(self) -> float:
        """How many frames the device and the line to it can take."""
        return self.device.most_updates_per_second

    @property
    def time(self) -> Timekeeper:
        """The device's clock; waiting by it blocks the event loop."""
        return self.device.time

    @property
    def calibration(self) -> Calibration | None:
        """The deviations of each transducer, as given."""
        return self.device.calibration

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await _to_the_end(_on_thread(partial(self.device.__exit__, kind, error, traceback)))

    close = _awaited(Device.close)

    status = _awaited(Device.status)
    clock = _awaited(Device.clock)
    wiring = _awaited(Device.wiring)
    processors = _awaited(Device.processors)
    read_back = _awaited(Device.read_back)
    enable = _awaited(Device.enable)
    stop = _awaited(Device.stop)
    reset = _awaited(Device.reset)
    reopen = _awaited(Device.reopen)
    identify = _awaited(Device.identify)
    set_watchdog = _awaited(Device.set_watchdog)
    set_drive_limit = _awaited(Device.set_drive_limit)
    clear_faults = _awaited(Device.clear_faults)
    show = _awaited(Device.show)
    store = _awaited(Device.store)
    play = _awaited(Device.play)
    modulate = _awaited(Device.modulate)
    end_modulation = _awaited(Device.end_modulation)
    silence = _awaited(Device.silence)

    async def keep_playing(self, seconds: float) -> None:
        """Let what plays go on for a time, as `Device.keep_playing` does; cancelling the task ends that."""
        end = self.time.monotonic() + seconds
        part = _awaited(Device.keep_playing)
        await part(self, min(seconds, SLICE_SECONDS))
        while (left := end - self.time.monotonic()) > 0:
            await part(self, min(left, SLICE_SECONDS))

    async def stream(
        self,
        source: Frames | AsyncIterable[Frame],
        rate: float,
        *,
        look_ahead: float = LOOK_AHEAD_SECONDS,
        envelope: Envelope | None = None,
        reconnect: bool = False,
        on_progress: Callable[[StreamReport], None] | None = None,
    ) -> StreamReport:
        """Play frames as `Device.stream` does. The source may be asynchronous, and is closed in the end.

        If the task is cancelled the outputs are turned off, and the stream has ended when this returns. Only a
        synchronous source that blocks its thread is left running; its later frames are not played. The source is
        iterated, and `on_progress` is called, on that thread, not on the event loop's.
        """
        feed: _Feed | None = None
        frames: Frames
        if isinstance(source, AsyncIterable):
            frames = feed = _Feed(source)
        else:
            frames = source
        cancelled = False

        def play() -> StreamReport:
            if cancelled:
                raise asyncio.CancelledError
            return self.device.stream(
                frames,
                rate,
                look_ahead=look_ahead,
                envelope=envelope,
                reconnect=reconnect,
                on_progress=on_progress,
            )

        playing = _on_thread(play)
        try:
            return await asyncio.wrap_future(playing)
        except asyncio.CancelledError:
            cancelled = True
            if feed is not None:
                feed.give_up()
            await _to_the_end(_on_thread(partial(self._end, playing)))
            raise
        finally:
            if feed is not None and playing.done():
                await feed.close()

    def _end(self, playing: Future[StreamReport]) -> None:
        """Stop repeatedly until a stream has ended, because it may have been about to begin at the first stop."""
        for _ in range(STOPS):
            with suppress(DeviceError):  # out of reach: its watchdog does it
                self.device.stop()
            if futures.wait([playing], STOP_SECONDS).done:
                return


class _Feed:
    """An asynchronous source, for a thread that iterates over it; other methods are for the event loop's thread."""

    def __init__(self, source: AsyncIterable[Frame]) -> None:
        self._loop = asyncio.get_running_loop()
        self._items = aiter(source)
        self._asking: asyncio.Task[Frame] | None = None
        self._over = False

    def __iter__(self) -> Iterator[Frame]:
        while True:
            following = asyncio.run_coroutine_threadsafe(self._following(), self._loop)
            try:
                item = following.result()
            except StopAsyncIteration:
                return
            yield item

    async def _following(self) -> Frame:
        if self._over:
            raise asyncio.CancelledError
        self._asking = asyncio.current_task()
        return await anext(self._items)

    def give_up(self) -> None:
        """End the wait of the thread."""
        self._over = True
        if self._asking is not None:
            self._asking.cancel()

    async def close(self) -> None:
        """Close a source that can be closed, such as an asynchronous generator, so that it cleans up now."""
        if hasattr(self._items, "aclose"):
            await self._items.aclose()
