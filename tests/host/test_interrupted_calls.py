"""Handlers of signals that close a device, or raise, anywhere within a call: outputs off, one error, no deadlock."""

from __future__ import annotations

import itertools
import signal
import sys
from collections.abc import Callable
from threading import Thread
from types import FrameType
from typing import Any

import numpy as np
import pytest
from phasewire import Device, Emulator, Pulses, open_device
from phasewire.base.errors import DeviceError
from phasewire.protocol import State
from phasewire.protocol.board import CARRIER_HZ, WATCHDOG_MS

FRAME = Pulses(np.full(320, 25), np.full(320, 25))
ROOMS = ("/host/", "/emulator/doors/", "/protocol/")
WATCHDOG_PERIODS = WATCHDOG_MS * CARRIER_HZ // 1000
MOMENTS = 25
"""The number of interruptions of a call, from its first function to its last."""


class Raised(Exception):
    """Raised by a handler."""


def show(device: Device) -> None:
    device.show(FRAME)


def stream(device: Device) -> None:
    device.stream(itertools.repeat(FRAME, 3), 20)


class Interruption:
    """Counts the functions of the host that begin, and sends a signal to this process when one of them does."""

    def __init__(self, at: int) -> None:
        self.at, self.begun = at, 0

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        if event == "call" and any(room in frame.f_code.co_filename for room in ROOMS):
            self.begun += 1
            if self.begun == self.at:
                signal.raise_signal(signal.SIGUSR1)


def interrupted(url: str, call: Callable[[Device], None], at: int, handle: Callable[[Device], None]) -> tuple[int, Any]:
    """Let a signal come in the middle of a call; how many functions that has begun, and what it has raised."""
    raised: BaseException | None = None
    interruption = Interruption(at)
    with Emulator() as emulator:
        device = open_device(emulator.url + url)
        call(device)  # so that nothing is imported or compiled in what is interrupted
        before = signal.signal(signal.SIGUSR1, lambda *_: handle(device))
        try:
            with device:
                sys.setprofile(interruption)
                try:
                    call(device)
                finally:
                    sys.setprofile(None)
        except BaseException as error:
            raised = error
        finally:
            signal.signal(signal.SIGUSR1, before)
        assert emulator.controller is not None
        if handle is not fail:  # before the call has the lock, `close` leaves it to the watchdog
            emulator.run(WATCHDOG_PERIODS)
        assert emulator.controller.state is State.OFF
        with pytest.raises(DeviceError, match="is closed; open it again"):
            device.status()
        other = Thread(target=device.close, daemon=True)  # waits for the lock, if anything still holds it
        other.start()
        other.join(10)
        assert not other.is_alive()
    return interruption.begun, raised


def fail(_device: Device) -> None:
    raise Raised


def close_and_exit(device: Device) -> None:
    device.close()
    sys.exit(3)


@pytest.mark.parametrize("url", ["", "?door=serial&baud=3000000"], ids=["usb", "serial"])
@pytest.mark.parametrize("call", [show, stream])
@pytest.mark.parametrize(
    ("handle", "kind"),
    [(Device.close, DeviceError), (fail, Raised), (close_and_exit, SystemExit)],
    ids=["close", "fail", "close-and-exit"],
)
def test_a_handler_within_a_call(
    url: str, call: Callable[[Device], None], handle: Callable[[Device], None], kind: type[BaseException]
) -> None:
    functions, raised = interrupted(url, call, 0, handle)
    assert (functions > MOMENTS, raised) == (True, None)
    for at in np.linspace(1, functions - 5, MOMENTS).astype(int).tolist():
        _, raised = interrupted(url, call, at, handle)
        assert raised is None or isinstance(raised, kind), (at, raised)
        if kind is DeviceError:
            assert raised is None or str(raised).endswith("is closed; open it again"), (at, raised)
