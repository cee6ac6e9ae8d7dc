"""A tracker's service that misbehaves while the loop plays: whatever it does, the outputs are silent in time."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from itertools import count
from threading import Event

import pytest
from phasewire import Emulator, TransducerArray, open_device
from phasewire.errors import TrackerLostError
from phasewire.host.hands import open_hands
from phasewire.host.hands.placing import PlacedHands
from phasewire.host.touching.loop import SILENCE_SECONDS, TouchLoop, TouchMoment
from websockets.sync.server import ServerConnection

from tests.host.hands.leap_service import LeapService, leap_frame

from .ring import Ring
from .test_loop import last_sound

pytestmark = pytest.mark.slow
PERIODS_PER_SECOND = 40_000
FRAMES, RATE = 20, 100
LONGEST = 60.0
SLACK = 0.003
"""Seconds from the time stamp of the last frame until the loop takes it as the last."""

Script = Callable[[LeapService, ServerConnection], object]


def garbage(service: LeapService, connection: ServerConnection) -> None:
    while not service.over.wait(0.01):
        connection.send("[" * 1000)


def flood_without_hands(service: LeapService, connection: ServerConnection) -> None:
    message = json.dumps(leap_frame(FRAMES, hands={}))
    while not service.over.is_set():
        connection.send(message)


ENDS: dict[str, tuple[Script, bool]] = {
    "garbage": (garbage, True),
    "a flood without hands": (flood_without_hands, False),
    "a stall": (lambda service, connection: service.stall(connection), False),
    "a close": (lambda _, connection: connection.close(), True),
    "a cut": (lambda _, connection: connection.socket.shutdown(socket.SHUT_RDWR), True),
}


@pytest.mark.parametrize(("misbehave", "lost"), ENDS.values(), ids=ENDS)
def test_the_outputs_are_silent(misbehave: Script, lost: bool) -> None:
    heard: list[float] = []
    played = Event()

    def script(connection: ServerConnection) -> None:
        for number in count():
            connection.send(json.dumps(leap_frame(number, 1e6 * number / RATE, palm=(0, 200, 0))))
            if played.wait(1 / RATE) or service.over.is_set():
                break
        misbehave(service, connection)

    with Emulator() as emulator, open_device(emulator.url) as device:

        def on_moment(moment: TouchMoment) -> None:
            if moment.hands:
                heard.append(device.time.monotonic())
            if len(heard) == FRAMES:
                played.set()

        service = LeapService(script)
        with service, PlacedHands(open_hands(service.url, device.time)) as hands:
            loop = TouchLoop(device, hands, [], Ring(), TransducerArray.grid(), on_moment=on_moment)
            if lost:
                with pytest.raises(TrackerLostError):
                    loop.run(LONGEST)
            else:
                with pytest.raises(Enough):
                    loop.run(LONGEST, on_progress=lambda _: enough(played, heard, device.time.monotonic()))
        assert not device.status().enabled
        emulator.run(400)
        sounded = last_sound(emulator) / PERIODS_PER_SECOND
    assert heard[0] < sounded < heard[-1] + SILENCE_SECONDS + SLACK


class Enough(Exception):
    """Ends a loop whose tracker has misbehaved for long enough."""


def enough(played: Event, heard: list[float], now: float) -> None:
    if played.is_set() and now > heard[-1] + 5 * SILENCE_SECONDS:
        raise Enough
