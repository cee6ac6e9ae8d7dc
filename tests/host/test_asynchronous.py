from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import wraps
from typing import Any, ParamSpec

import numpy as np
import pytest
from phasewire import Device, Emulator, Pulses, open_device
from phasewire.emulator.faults import Unplugged
from phasewire.host.streaming import asynchronous
from phasewire.host.streaming.asynchronous import AsyncDevice, open_device_async
from phasewire.protocol.codes import State

FULL = Pulses(np.full(320, 25), np.full(320, 25))


Given = ParamSpec("Given")


def awaited(test: Callable[Given, Coroutine[Any, Any, None]]) -> Callable[Given, None]:
    """A test that is a coroutine function, run by an event loop of its own."""

    @wraps(test)
    def run(*arguments: Given.args, **named: Given.kwargs) -> None:
        asyncio.run(asyncio.wait_for(test(*arguments, **named), 60))

    return run


async def all_ended() -> None:
    """Wait until no call is under way any more, not even one whose result is dropped."""
    async with asyncio.timeout(5):
        while any(thread.name == "phasewire" for thread in threading.enumerate()):
            await asyncio.sleep(0.01)


def test_it_has_every_method_of_a_device() -> None:
    def names(kind: type) -> set[str]:
        return {name for name in vars(kind) if not name.startswith("_")}

    assert names(Device) | {"calibration"} == names(AsyncDevice)
    methods = {name for name in names(AsyncDevice) if callable(getattr(AsyncDevice, name))} - {"stream"}
    assert {"close", "keep_playing", "show"} <= methods
    for name in methods:
        assert inspect.signature(getattr(AsyncDevice, name)) == inspect.signature(getattr(Device, name))


@pytest.mark.parametrize(
    ("asynchronous", "synchronous"), [(open_device_async, open_device), (AsyncDevice.stream, Device.stream)]
)
def test_opening_and_streaming_take_the_same_arguments_as_without_async(
    asynchronous: Callable[..., object], synchronous: Callable[..., object]
) -> None:
    def taken(function: Callable[..., object]) -> dict[str, tuple[object, ...]]:
        parameters = inspect.signature(function).parameters.values()
        return {each.name: (each.kind, each.default, each.name == "source" or each.annotation) for each in parameters}

    assert taken(asynchronous) == taken(synchronous)


@awaited
async def test_awaited_results_are_those_of_the_device(emulator: Emulator) -> None:
    async with await open_device_async(emulator.url) as device:
        ack = await device.show(FULL)
        status = await device.status()
        assert (status.state, status.since_period) == (State.PLAYING, ack.commit_period)
        assert (await device.read_back()).pulses == FULL
        assert device.name.endswith(emulator.serial)
        assert device.info.channels == 320
        assert device.serial == emulator.serial
        assert device.calibration is None
        began = device.time.monotonic()
        await device.keep_playing(0.25)
        assert device.time.monotonic() - began >= 0.25
        assert (await device.status()).state is State.PLAYING
    assert not emulator.running.status().enabled


@awaited
async def test_a_device_is_opened_by_async_with_alone_or_by_await(emulator: Emulator) -> None:
    async with open_device_async(emulator.url) as device:
        await device.show(FULL)
        assert emulator.running.status().enabled
    assert not emulator.running.status().enabled
    async with await asyncio.create_task(open_device_async(emulator.url)) as device:
        assert device.serial == emulator.serial


@awaited
async def test_the_loop_goes_on_while_a_stream_from_an_asynchronous_source_plays(emulator: Emulator) -> None:
    turns = 0

    async def source() -> AsyncIterator[Pulses]:
        for width in (3, 5, 7) * 20:
            await asyncio.sleep(0)
            yield Pulses(np.full(320, 25), np.full(320, width))

    async def count() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0.001)

    async with await open_device_async(emulator.url) as device:
        counting = asyncio.create_task(count())
        report = await device.stream(source(), 1000)
        counting.cancel()
        assert (report.accepted, report.late) == (60, 0)
        assert (await device.read_back()).pulses.width[0] == 7
    assert turns > 5


@pytest.mark.parametrize("source", ["quick", "stuck"])
@awaited
async def test_a_cancelled_stream_leaves_the_outputs_off_and_nothing_running(emulator: Emulator, source: str) -> None:
    begun = asyncio.Event()

    async def frames() -> AsyncIterator[Pulses]:
        while True:
            yield FULL
            begun.set()
            if source == "stuck":
                await asyncio.sleep(1000)

    async with await open_device_async(emulator.url) as device:
        streaming = asyncio.create_task(device.stream(frames(), 1000))
        await begun.wait()
        streaming.cancel()
        with pytest.raises(asyncio.CancelledError):
            await streaming
        assert not (await device.status()).enabled


@awaited
async def test_a_cancelled_stream_is_cancelled_even_if_its_device_is_out_of_reach(emulator: Emulator) -> None:
    begun = asyncio.Event()
    device = await open_device_async(emulator.url)

    async def frames() -> AsyncIterator[Pulses]:
        yield FULL
        yield FULL
        emulator.inject(Unplugged())
        begun.set()
        await asyncio.sleep(1000)

    streaming = asyncio.create_task(device.stream(frames(), 1000))
    await begun.wait()
    streaming.cancel()
    with pytest.raises(asyncio.CancelledError):
        await streaming


@awaited
async def test_a_stop_needs_no_thread_of_the_event_loop() -> None:
    """All threads of the event loop may be busy, such as with other devices' streams."""
    release = threading.Event()
    with Emulator() as emulator, ThreadPoolExecutor(1) as threads:
        asyncio.get_running_loop().set_default_executor(threads)
        async with await open_device_async(emulator.url) as device:
            await device.show(FULL)
            taken = asyncio.create_task(asyncio.to_thread(release.wait, 20))
            try:
                async with asyncio.timeout(5):
                    await device.stop()
                    assert not (await device.status()).enabled
            finally:
                release.set()
                await taken


@awaited
async def test_a_device_that_was_opened_for_a_cancelled_task_is_closed(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    reached, release = threading.Event(), threading.Event()

    def slowly(*arguments: Any, **options: Any) -> Device:
        reached.set()
        assert release.wait(10)
        return open_device(*arguments, **options)

    monkeypatch.setattr(asynchronous, "open_device", slowly)
    opening = asyncio.create_task(open_device_async(emulator.url))
    await asyncio.to_thread(reached.wait, 10)
    for _ in range(2):  # an impatient user cancels twice
        opening.cancel()
        await asyncio.sleep(0.02)
        assert not opening.done()
    release.set()
    with pytest.raises(asyncio.CancelledError):
        await opening
    with open_device(emulator.url) as other:  # it is free again
        assert not other.status().enabled


@awaited
async def test_leaving_is_not_cut_short(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    reached, release = threading.Event(), threading.Event()
    genuine = Device.__exit__

    def slowly(self: Device, *arguments: Any) -> None:
        reached.set()
        assert release.wait(10)
        genuine(self, *arguments)

    monkeypatch.setattr(Device, "__exit__", slowly)

    async def use() -> None:
        async with await open_device_async(emulator.url) as device:
            await device.show(FULL)

    using = asyncio.create_task(use())
    await asyncio.to_thread(reached.wait, 10)
    using.cancel()
    asyncio.get_running_loop().call_later(0.05, release.set)
    with pytest.raises(asyncio.CancelledError):
        await using
    assert not emulator.running.status().enabled


@awaited
async def test_a_stream_that_is_cancelled_before_it_has_begun_does_not_begin(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its source is synchronous and without end, and the device is stopped first."""
    stopped = threading.Event()
    stop, begin = Device.stop, Device.stream

    def stopping(self: Device) -> None:
        stop(self)
        stopped.set()

    def beginning(self: Device, *arguments: Any, **options: Any) -> object:
        assert stopped.wait(10)
        return begin(self, *arguments, **options)

    def frames() -> Iterator[Pulses]:
        while True:
            yield FULL

    monkeypatch.setattr(Device, "stop", stopping)
    monkeypatch.setattr(Device, "stream", beginning)
    async with await open_device_async(emulator.url) as device:
        streaming = asyncio.create_task(device.stream(frames(), 1000))
        await asyncio.sleep(0.01)
        streaming.cancel()
        async with asyncio.timeout(10):
            with pytest.raises(asyncio.CancelledError):
                await streaming
        assert not (await device.status()).enabled
        await all_ended()


@awaited
async def test_a_source_that_blocks_its_thread_delays_no_other_call(emulator: Emulator) -> None:
    asked, release = threading.Event(), threading.Event()

    def frames() -> Iterator[Pulses]:
        yield FULL
        asked.set()
        release.wait(20)
        yield FULL

    async with await open_device_async(emulator.url) as device:
        streaming = asyncio.create_task(device.stream(frames(), 1000))
        await asyncio.to_thread(asked.wait, 10)
        streaming.cancel()
        async with asyncio.timeout(10):
            with pytest.raises(asyncio.CancelledError):
                await streaming
        assert not (await device.status()).enabled
        release.set()
        await all_ended()
        assert not (await device.status()).enabled


@awaited
async def test_a_stream_that_is_cancelled_while_it_asks_for_a_frame_ends(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread is just about to ask the event loop, for a frame that never comes."""
    genuine = asyncio.run_coroutine_threadsafe

    async def frames() -> AsyncIterator[Pulses]:
        yield FULL
        await asyncio.sleep(1000)

    def ask(coroutine: Any, loop: asyncio.AbstractEventLoop) -> Future[Any]:
        asked.append(coroutine)
        if len(asked) == 2:
            loop.call_soon_threadsafe(streaming.cancel)
            assert stopped.wait(10)
        return genuine(coroutine, loop)

    asked: list[object] = []
    stopped = threading.Event()
    stop = Device.stop

    def stopping(self: Device) -> None:
        stop(self)
        stopped.set()

    monkeypatch.setattr(asyncio, "run_coroutine_threadsafe", ask)
    monkeypatch.setattr(Device, "stop", stopping)
    async with await open_device_async(emulator.url) as device:
        streaming = asyncio.create_task(device.stream(frames(), 1000))
        async with asyncio.timeout(10):
            with pytest.raises(asyncio.CancelledError):
                await streaming
        await all_ended()


@pytest.mark.parametrize("end", ["normal", "refused", "cancelled", "error"])
@awaited
async def test_an_asynchronous_source_is_closed_however_the_stream_ends(emulator: Emulator, end: str) -> None:
    closed = False
    begun = asyncio.Event()

    async def frames() -> AsyncIterator[Pulses]:
        nonlocal closed
        try:
            for _ in range(3):
                yield FULL
                begun.set()
            if end == "cancelled":
                await asyncio.sleep(1000)
            if end == "refused":
                yield Pulses(np.zeros(3), np.zeros(3))
            if end == "error":
                raise RuntimeError("no more ideas")
        finally:
            await asyncio.sleep(0)
            closed = True

    async with await open_device_async(emulator.url) as device:
        streaming = asyncio.create_task(device.stream(frames(), 1000))
        await begun.wait()
        if end == "cancelled":
            streaming.cancel()
        await asyncio.wait([streaming])
        assert closed
        assert end != "error" or str(streaming.exception()) == "no more ideas"
        assert end == "normal" or not (await device.status()).enabled


@awaited
async def test_a_cancelled_keep_playing_stops_keeping_the_device_playing(emulator: Emulator) -> None:
    async with await open_device_async(emulator.url) as device:
        await device.show(FULL)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(device.keep_playing(1e6), 0.05)
        await all_ended()
