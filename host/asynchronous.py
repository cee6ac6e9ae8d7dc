"""The asyncio face of a device: the methods of `Device`, awaited, and streams from asynchronous sources.

Each call runs on a thread of its own, so that the event loop goes on; the device itself lets one call after the other
at its line.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, Awaitable, Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from functools import partial, wraps
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar

from ..errors import DeviceError
from ..protocol.replies import Info
from .device import Device, open_device
from .frames import Frame, Frames
from .streaming import StreamReport

__all__ = ["AsyncDevice", "open_device_async"]

P = ParamSpec("P")
R = TypeVar("R")


async def open_device_async(url: str | None = None, **options: Any) -> AsyncDevice:
    """Open a device as `open_device` does; use it in an ``async with`` statement.

    When the task is cancelled the device is closed again when this returns.
    """
    opening = asyncio.ensure_future(asyncio.to_thread(partial(open_device, url, **options)))
    try:
        return AsyncDevice(await asyncio.shield(opening))
    except asyncio.CancelledError:
        await asyncio.wait([opening])
        if opening.exception() is None:
            opening.result().close()
        raise


def _awaited(method: Callable[Concatenate[Device, P], R]) -> Callable[Concatenate[AsyncDevice, P], Awaitable[R]]:
    """A method of `Device`, on a thread."""

    @wraps(method)
    async def call(self: AsyncDevice, /, *arguments: P.args, **options: P.kwargs) -> R:
        return await asyncio.to_thread(partial(method, self.device, *arguments, **options))

    return call


class AsyncDevice:
    """A device whose methods are awaited. They take and give what those of `Device` do, and raise the same errors.

    Parameters
    ----------
    device : Device
        It may be used beside this one, from any thread.
    """

    def __init__(self, device: Device) -> None:
        self.device = device

    @property
    def info(self) -> Info:
        """What the device says that it is."""
        return self.device.info

    @property
    def name(self) -> str:
        """Product and serial number."""
        return self.device.name

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await asyncio.shield(asyncio.to_thread(self.device.__exit__, kind, error, traceback))

    status = _awaited(Device.status)
    clock = _awaited(Device.clock)
    wiring = _awaited(Device.wiring)
    processors = _awaited(Device.processors)
    read_back = _awaited(Device.read_back)
    enable = _awaited(Device.enable)
    stop = _awaited(Device.stop)
    reset = _awaited(Device.reset)
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

    async def stream(self, source: Frames | AsyncIterable[Frame], rate: float, **options: Any) -> StreamReport:
        """Play frames as `Device.stream` does. The source may be asynchronous.

        When the task is cancelled the outputs are turned off, and the stream has ended when this returns.
        """
        waiting = _Waiting(asyncio.get_running_loop())
        frames = waiting.iterate(source) if isinstance(source, AsyncIterable) else source
        running = asyncio.ensure_future(asyncio.to_thread(partial(self.device.stream, frames, rate, **options)))
        try:
            return await asyncio.shield(running)
        except asyncio.CancelledError:
            waiting.give_up()
            with suppress(DeviceError):  # out of reach: its watchdog does it
                await asyncio.to_thread(self.device.stop)
            await asyncio.wait([running])
            running.exception()  # that it was stopped is no news
            raise


class _Waiting:
    """A thread's way to what an event loop makes."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._next: Future[Frame] | None = None
        self._over = False

    def iterate(self, source: AsyncIterable[Frame]) -> Iterator[Frame]:
        """The items of an asynchronous source, on a thread that may wait for them."""
        items = aiter(source)

        async def following() -> Frame:
            return await anext(items)

        while not self._over:
            self._next = asyncio.run_coroutine_threadsafe(following(), self._loop)
            if self._over:  # since the loop looked
                self._next.cancel()
            try:
                yield self._next.result()
            except StopAsyncIteration:
                return

    def give_up(self) -> None:
        """Let the thread wait no longer."""
        self._over = True
        if self._next is not None:
            self._next.cancel()
