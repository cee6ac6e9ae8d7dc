from __future__ import annotations

import asyncio
import inspect
from collections.abc import AsyncIterator, Coroutine
from typing import Any

import numpy as np
import pytest
from phasewire import Device, Emulator, Pulses
from phasewire.emulator.doors.backend import Port
from phasewire.emulator.faults import Unplugged
from phasewire.errors import DeviceNotFoundError, DeviceRefusedError
from phasewire.host.asynchronous import AsyncDevice, open_device_async
from phasewire.protocol.codes import State
from phasewire.protocol.quantise import PulseFrames

FULL = Pulses(np.full(320, 25), np.full(320, 25))


def run(main: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(main, 60))


def test_it_has_every_method_of_a_device_but_those_that_end_it() -> None:
    def methods(kind: type) -> set[str]:
        return {name for name, value in vars(kind).items() if callable(value) and not name.startswith("_")}

    assert methods(Device) - methods(AsyncDevice) == {"close", "keep_playing"}
    assert methods(AsyncDevice) <= methods(Device)
    for name in methods(AsyncDevice) - {"stream"}:
        assert inspect.signature(getattr(AsyncDevice, name)) == inspect.signature(getattr(Device, name))


def test_what_is_awaited_is_what_the_device_says() -> None:
    async def main() -> None:
        with Emulator() as emulator:
            async with await open_device_async(emulator.url) as device:
                ack = await device.show(FULL)
                status = await device.status()
                assert (status.state, status.since_period) == (State.PLAYING, ack.commit_period)
                assert (await device.read_back()).pulses == FULL
                assert device.name.endswith(emulator.serial)
                assert device.info.channels == 320
            assert not emulator.running.status().enabled

    run(main())


def test_errors_come_through() -> None:
    async def main() -> None:
        with pytest.raises(DeviceNotFoundError):
            await open_device_async("nonsense:")
        async with await open_device_async("emulator:") as device:
            with pytest.raises(ValueError, match="board"):
                await device.identify(7)
            with pytest.raises(DeviceRefusedError):
                await device.play([(3, 10)])

    run(main())


def test_the_loop_goes_on_while_a_stream_from_an_asynchronous_source_plays() -> None:
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

    async def main() -> None:
        with Emulator() as emulator:
            async with await open_device_async(emulator.url) as device:
                counting = asyncio.create_task(count())
                report = await device.stream(source(), 1000)
                counting.cancel()
                assert (report.accepted, report.late) == (60, 0)
                assert (await device.read_back()).pulses.width[0] == 7

    run(main())
    assert turns > 5


def test_a_stream_of_an_array_and_two_tasks_at_one_device() -> None:
    async def main() -> None:
        with Emulator() as emulator:
            async with await open_device_async(emulator.url) as device:
                frames = PulseFrames(np.zeros((400, 320), np.uint8), np.full((400, 320), 2, np.uint8))
                streaming = asyncio.create_task(device.stream(frames, 4000))
                while not streaming.done():
                    assert (await device.status()).late == 0
                assert (await streaming).accepted == 400

    run(main())


@pytest.mark.parametrize("source", ["quick", "stuck"])
def test_a_cancelled_stream_leaves_the_outputs_off_and_nothing_running(source: str) -> None:
    begun = asyncio.Event()

    async def frames() -> AsyncIterator[Pulses]:
        while True:
            yield FULL
            begun.set()
            if source == "stuck":
                await asyncio.sleep(1000)

    async def main() -> None:
        with Emulator() as emulator:
            async with await open_device_async(emulator.url) as device:
                streaming = asyncio.create_task(device.stream(frames(), 1000))
                await begun.wait()
                streaming.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await streaming
                assert not (await device.status()).enabled

    run(main())


def test_a_cancelled_stream_is_cancelled_also_where_its_device_is_out_of_reach() -> None:
    begun = asyncio.Event()

    async def main() -> None:
        with Emulator() as emulator:
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

    run(main())


def test_a_device_that_is_opened_when_nobody_waits_for_it_any_more_is_closed_again() -> None:
    async def main() -> None:
        with Emulator() as emulator:
            opening = asyncio.create_task(open_device_async(emulator.url))
            await asyncio.sleep(0)
            opening.cancel()
            with pytest.raises(asyncio.CancelledError):
                await opening
            assert emulator.running.status().accepted == 1, "it was opened"
            assert not Port.of(emulator.usb).claims

    run(main())


def test_an_error_of_the_source_ends_the_stream_with_the_outputs_off() -> None:
    async def frames() -> AsyncIterator[Pulses]:
        yield FULL
        raise RuntimeError("no more ideas")

    async def main() -> None:
        async with await open_device_async("emulator:") as device:
            with pytest.raises(RuntimeError, match="no more ideas"):
                await device.stream(frames(), 1000)
            assert not (await device.status()).enabled

    run(main())
