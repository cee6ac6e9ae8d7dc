"""One class of tests over all lines to a device: for a user of `Device` they are all alike.

A real bus is tried with the same driver under umockdev, by the tests of the emulator's doors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial

import numpy as np
import pytest
from phasewire import Device, Emulator, Pulses, open_device
from phasewire.base.errors import DeviceError, DeviceRefusedError, DeviceStalledError
from phasewire.protocol.codes import Reason, State
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.firmware.core import building
from tests.host.serving import served_url

# pyserial 3.5 names the thread of RFC 2217 in a way that Python 3.10 deprecated.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")

CHANNELS = 320
WATCHDOG_SECONDS = 10.0  # a busy machine is no reason to fall silent
RAMP = Pulses(np.arange(CHANNELS) % 100, np.arange(CHANNELS) % 26)
ROWS = Pulses(np.arange(CHANNELS) // 20, np.full(CHANNELS, 10))
FULL = Pulses(np.full(CHANNELS, 25), np.full(CHANNELS, 25))


@contextmanager
def in_process(door: str, link: Link = FIVE_WIRE, speed: Speed = HIGH_SPEED) -> Iterator[str]:
    """The URL of an emulated device in this process."""
    with Emulator(link=link, speed=speed) as emulator:
        yield emulator.url + door


@contextmanager
def served(scheme: str) -> Iterator[str]:
    """The URL of an emulated device in a thread of its own, whose time is the wall clock's."""
    with served_url(scheme) as (url, _):
        yield url


LINES: dict[str, Callable[[], AbstractContextManager[str]]] = {
    "usb-high-speed": partial(in_process, ""),
    "usb-full-speed": partial(in_process, "", speed=FULL_SPEED),
    "usb-2wire": partial(in_process, "", link=TWO_WIRE),
    "usbip": partial(served, "usbip"),
    "uart-115200": partial(in_process, "?door=serial"),
    "uart-3M": partial(in_process, "?door=serial&baud=3000000"),
    "serial": partial(served, "serial"),
    "socket": partial(served, "socket"),
    "rfc2217": partial(served, "rfc2217"),
    "reference-usbip": partial(building.served, "usbip"),
    "reference-socket": partial(building.served, "socket"),
}


class Opened:
    """A device that can be closed and opened again."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.device = open_device(url)

    def close(self) -> None:
        """Close it as a `with` statement does."""
        self.device.__exit__(None, None, None)

    def reopen(self) -> None:
        """Open it again."""
        self.device = open_device(self.url)


@pytest.fixture(scope="class", params=LINES)
def opened(request: pytest.FixtureRequest) -> Iterator[Opened]:
    with LINES[request.param]() as url:
        line = Opened(url)
        yield line
        line.close()


@pytest.fixture
def device(opened: Opened) -> Device:
    """The device, with its outputs off and nothing playing."""
    opened.device.stop()
    opened.device.set_watchdog(WATCHDOG_SECONDS)
    return opened.device


def reason_of(error: pytest.ExceptionInfo[DeviceRefusedError]) -> Reason:
    return Reason(error.value.reason)


class TestEveryLine:
    def test_a_device_describes_itself(self, device: Device) -> None:
        info = device.info
        assert (info.channels, info.columns, info.rows, info.boards) == (CHANNELS, 20, 16, 5)
        assert info.speaks(1)
        assert device.serial in device.name
        reports = device.processors()
        assert (len(reports), {report.firmware for report in reports}) == (10, {info.firmware})

    def test_what_is_shown_is_what_plays(self, device: Device) -> None:
        device.enable()
        assert device.status().state is State.READY
        for pulses in (RAMP, ROWS):
            ack = device.show(pulses)
            device.time.sleep(0.001)
            back = device.read_back()
            assert back.since_period == ack.commit_period
            assert back.pulses == pulses
        assert device.status().state is State.PLAYING

    def test_refusals_say_why(self, device: Device) -> None:
        device.set_drive_limit(100)
        with pytest.raises(DeviceRefusedError, match=r"a total drive of 320 is above the limit of 100$") as raised:
            device.show(FULL)
        assert reason_of(raised) is Reason.DRIVE
        device.stop()
        device.set_drive_limit(CHANNELS)
        device.show(FULL)
        with pytest.raises(DeviceRefusedError, match="never stored") as raised:
            device.play([(200, 10)])
        assert reason_of(raised) is Reason.EMPTY
        device.show(RAMP)  # a refusal breaks nothing

    def test_a_request_in_the_wrong_state_is_an_error_of_its_own(self, device: Device) -> None:
        device.enable()
        with pytest.raises(DeviceStalledError):
            device.set_drive_limit(1)
        assert device.status().drive_limit == CHANNELS

    def test_a_stream_arrives_in_order_and_whole(self, device: Device) -> None:
        before = device.status()
        frames = [RAMP, ROWS, FULL, RAMP, ROWS, FULL]
        report = device.stream(frames, 15.0, look_ahead=0.3)
        after = device.status()
        assert (report.accepted, report.damaged, report.unanswered, report.refused) == (6, 0, 0, 0)
        assert after.accepted - before.accepted >= 6
        assert after.refused == before.refused
        assert report.last_period - report.first_period >= 5 * 40_000 // 15

    def test_a_reset_empties_its_stores_and_the_same_device_comes_back(self, device: Device) -> None:
        device.store(7, RAMP)
        name = device.name
        device.reset()
        assert device.name == name
        assert not device.status().enabled
        with pytest.raises(DeviceRefusedError) as raised:
            device.play([(7, 10)])
        assert reason_of(raised) is Reason.EMPTY

    def test_closing_leaves_the_outputs_off_and_the_line_to_the_next(self, device: Device, opened: Opened) -> None:
        device.show(FULL)
        unique = device.info.unique_id
        opened.close()
        with pytest.raises(DeviceError, match="is closed; open it again"):
            device.status()
        opened.reopen()
        assert opened.device.info.unique_id == unique
        assert opened.device.status().state is State.OFF
        assert opened.device.show(RAMP).sequence == 1  # after the one that began the session
